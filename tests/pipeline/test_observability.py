"""What a fleet would tell: against the Gaussian limit, and what is said where positions are missing."""

from datetime import date

import numpy as np
import pytest

from bella.exceptions import InputError
from bella.multilateration.priors import find_preset
from bella.multilateration.uncertainty_map import Receivers, exact_covariance
from bella.pipeline.observability import PLANNED_LONGITUDES_DEG, PLANNED_RSUN, predicted
from bella.spacecraft import position

DAY, FLEET = date(2013, 5, 13), ("WIND", "STEREO-A", "STEREO-B")


def test_sharp_regions_have_the_area_of_their_covariance() -> None:
    found = predicted(DAY, FLEET, 4.0, 0.5)
    where = np.array([position(name, np.datetime64("2013-05-13T12:00"))[0] for name in FLEET])
    np.testing.assert_allclose([found.receivers_rsun[name] for name in FLEET], where, atol=0.01)
    longitude, distance = 60.0, 50.0
    angle = np.radians(longitude)
    point = distance * np.array([[np.cos(angle), np.sin(angle)]])
    priors = find_preset("default").priors
    (covariance,) = exact_covariance(point, Receivers(FLEET, where, np.full(3, 4.0)), priors, processes=1)
    area = -2.0 * np.log(1.0 - 0.68) * np.pi * np.sqrt(np.linalg.det(covariance))
    radius = found.row(distance)[PLANNED_LONGITUDES_DEG.index(longitude)]
    assert radius == pytest.approx(np.sqrt(area / np.pi), rel=0.1)
    assert found.localisable
    assert found.missing == {}


def test_the_distance_of_the_frequency_is_one_of_the_rows() -> None:
    found = predicted(DAY, FLEET, 20.0, 0.2)
    assert found.frequency_rsun == pytest.approx(53.0, abs=5.0)  # Leblanc et al. (1998), plasma frequency 0.1 MHz
    assert sorted({*PLANNED_RSUN, found.frequency_rsun}) == list(found.distances_rsun)
    assert len(found.radius68_rsun) == len(found.distances_rsun)
    assert {len(row) for row in found.radius68_rsun} == {len(PLANNED_LONGITUDES_DEG)}


def test_larger_errors_make_larger_regions() -> None:
    small, large = (predicted(DAY, FLEET, sigma, 0.5).row(50.0) for sigma in (5.0, 20.0))
    assert np.median(np.array(large) / np.array(small)) == pytest.approx(4.0, rel=0.25)


def test_spacecraft_without_a_position_are_named_and_left_out() -> None:
    found = predicted(date(2016, 5, 13), ("WIND", "STEREO-A", "STEREO-B", "JUNO"), 15.0, 0.5)
    assert set(found.receivers_rsun) == {"WIND", "STEREO-A"}
    assert "2014-09-30" in found.missing["STEREO-B"]
    assert "JUNO" in found.missing["JUNO"]
    assert (found.localisable, found.distances_rsun, found.radius68_rsun) == (False, (), ())


def test_a_frequency_that_is_emitted_nowhere_is_refused() -> None:
    with pytest.raises(InputError):
        predicted(DAY, FLEET, 15.0, 1e6)
