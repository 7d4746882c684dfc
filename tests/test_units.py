"""Constants against their definitions, and conversion at the edge."""

import numpy as np
import pytest
from astropy import constants
from astropy import units as u

from bella.units import AU_KM, AU_RSUN, C_KM_S, C_RSUN_S, DAY_S, R_SUN_KM, RSUN, bare, within_half_turn_deg


def test_constants_are_the_nominal_ones() -> None:
    assert u.au.to(u.km) == AU_KM
    assert constants.R_sun.to_value(u.km) == R_SUN_KM
    assert constants.c.to_value(u.km / u.s) == C_KM_S
    assert u.day.to(u.s) == DAY_S


def test_derived_constants_as_printed() -> None:
    assert pytest.approx(215.03, abs=0.005) == AU_RSUN
    assert pytest.approx(0.430922, abs=5e-7) == C_RSUN_S
    assert pytest.approx(34.8, abs=0.05) == 15 / C_RSUN_S


def test_quantities_become_bare() -> None:
    values = bare([1, 2] * u.au, RSUN)
    np.testing.assert_allclose(values, [AU_RSUN, 2 * AU_RSUN], rtol=1e-12)
    assert values.dtype == np.float64
    assert bare(3 * RSUN, u.km) == pytest.approx(3 * R_SUN_KM)
    assert bare(500 * u.kHz, u.MHz).shape == ()


def test_another_kind_of_quantity_is_refused() -> None:
    with pytest.raises(u.UnitConversionError):
        bare(1 * u.s, u.km)


def test_angles_are_brought_within_half_a_turn() -> None:
    angles = np.array([0.0, 179.5, 180.0, 180.5, 360.0, -180.0, -540.5, 900.0])
    np.testing.assert_allclose(within_half_turn_deg(angles), [0.0, 179.5, 180.0, -179.5, 0.0, 180.0, 179.5, 180.0])
    assert within_half_turn_deg(-190.0) == 170.0
