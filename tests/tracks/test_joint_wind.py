"""Winds that change on the way: field line and travel against integrals, and found where they are there."""

import numpy as np
import pytest
from scipy.integrate import quad

from bella.exceptions import InputError
from bella.heliosphere import angular_speed_rad_s, beam_travel_s, slowing_travel_s
from bella.tracks import JointModel, JointOptions, compare_models, fit_joint, joint_json, wind_knots
from bella.tracks.joint_wind import along_field_line, field_line_position_rsun
from bella.units import C_RSUN_S, R_SUN_KM, FloatArray
from tests.tracks.bursts import FREQUENCY_MHZ, simulated, standard

MODEL = JointModel()
KNOTS, SPEEDS = (30.0, 80.0), (300.0, 500.0, 350.0)
WINDS = tuple(np.array([[speed]]) for speed in SPEEDS)
RANGE = np.array([[10.0, 30.0, 50.0, 80.0, 200.0]])


def winding(range_rsun: float) -> float:
    speed = SPEEDS[int(np.searchsorted(KNOTS, range_rsun, side="right"))]
    return angular_speed_rad_s(25.38) * R_SUN_KM / speed


def integral(power: float, end: float) -> float:
    def element(r: float) -> float:
        return float(np.sqrt(1 + (winding(r) * r) ** 2) * r**power)

    return float(quad(element, 1.0, end, points=[knot for knot in KNOTS if knot < end], limit=200)[0])


def test_longitude_is_the_integral_of_the_winding() -> None:
    position = field_line_position_rsun(RANGE, np.array([[20.0]]), WINDS, KNOTS, 25.38)[0]
    for place, end in zip(position, RANGE[0], strict=True):
        turned = quad(winding, 1.0, end, points=[knot for knot in KNOTS if knot < end])[0]
        expected = np.radians(20.0) - turned
        np.testing.assert_allclose(place, [end * np.cos(expected), end * np.sin(expected), 0.0], rtol=1e-9, atol=1e-9)


def test_travel_is_the_integral_along_the_field_line() -> None:
    speed_c, slower, period_d = np.array([[0.2]]), np.array([[0.3]]), 25.38

    def slowed_travel(r: FloatArray, wind: FloatArray) -> FloatArray:
        return slowing_travel_s(r, speed_c, slower, wind, period_d)

    (steady,) = along_field_line(RANGE, WINDS, KNOTS, lambda r, wind: beam_travel_s(r, speed_c, wind, period_d))
    (slowing,) = along_field_line(RANGE, WINDS, KNOTS, slowed_travel)
    for found, slowed, end in zip(steady, slowing, RANGE[0], strict=True):
        assert found == pytest.approx(integral(0.0, end) / (0.2 * C_RSUN_S), rel=1e-8)
        assert slowed == pytest.approx(integral(0.3, end) / (0.2 * C_RSUN_S), rel=1e-6)


def test_knots_between_equal_winds_change_nothing() -> None:
    knotted = JointModel(knots_rsun=(40.0,))
    z = np.random.default_rng(1).standard_normal((20, 5))
    receiver = np.tile([215.0, 0.0, 3.0], (FREQUENCY_MHZ.size, 1, 1))
    plain = MODEL.delay_s(z, FREQUENCY_MHZ, receiver)
    both = knotted.delay_s(np.column_stack([z, z[:, 1]]), FREQUENCY_MHZ, receiver)
    np.testing.assert_allclose(both, plain, rtol=1e-12)


def test_the_prior_of_several_winds_adds_up_to_one() -> None:
    model = JointModel(knots_rsun=(30.0, 60.0))
    z = np.random.default_rng(4).standard_normal((100_000, 7))
    assert model.share_allowed(FREQUENCY_MHZ) == pytest.approx(model.allowed(z, FREQUENCY_MHZ).mean(), abs=0.003)


def test_evidence_finds_a_wind_that_changes_and_asks_for_no_more() -> None:
    """500 km/s out to 40 solar radii, 280 beyond; then 400 all the way."""
    rich = JointModel(knots_rsun=(40.0,))
    changing = np.append(standard(MODEL, 30.0, 500.0), (400 / 280 - 1) / 0.3)
    for z, truth in ((changing, rich), (standard(MODEL, 30.0, 400.0), MODEL)):
        grid = simulated(z, truth, np.random.default_rng(2), scale=0.1)
        best, other = compare_models(grid, [MODEL, rich], JointOptions(draws=1500))
        assert best.fit.model == truth
        assert best.log_bayes_factor == 0.0 > other.log_bayes_factor
    found = fit_joint(simulated(changing, rich, np.random.default_rng(2), scale=0.1), rich)
    inner, outer = (part["v_sw_km_s"] for part in joint_json(found)["segments"])
    assert inner["q2_5"] < 500.0 < inner["q97_5"]
    assert outer["q2_5"] < 280.0 < outer["q97_5"]


def test_knots_divide_the_sources() -> None:
    fit = fit_joint(simulated(standard(MODEL, 30.0, 400.0), MODEL, np.random.default_rng(1)))
    assert wind_knots(fit, FREQUENCY_MHZ, 1)[0] == pytest.approx(22 / np.median(FREQUENCY_MHZ), rel=0.15)
    assert list(wind_knots(fit, FREQUENCY_MHZ, 2)) == sorted(wind_knots(fit, FREQUENCY_MHZ, 2))
    nothing = fit_joint(simulated(standard(MODEL, 30.0, 400.0), MODEL, None).take(np.arange(2)))
    with pytest.raises(InputError, match="add frequencies"):
        wind_knots(nothing, FREQUENCY_MHZ, 1)
