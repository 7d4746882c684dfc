"""Families of light curves against independent formulas and numerics, and the laws of rise and decay."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import quad
from scipy.optimize import brentq, minimize_scalar

from bella.exceptions import InputError
from bella.simulation.light_curves import FAMILIES, PulseLaw, decay_over_rise, draw_pulse_law, pulses

Curve = Callable[[np.ndarray], np.ndarray]
REAL_RISES_S = {0.2: 186.0, 0.5: 90.0, 1.0: 37.0, 2.0: 11.0}
"""Of 2012-06-07, by frequency in MHz."""
EXTRAPOLATED_RISES_S = {0.2: 71.0, 0.5: 35.0, 1.0: 20.6, 2.0: 12.1}
"""1.5 s (f / 30 MHz)^-0.77."""

# a member of each family in seconds, written without the code that is tested, and where to look for its maximum
RAW: dict[str, list[tuple[Curve, tuple[float, float]]]] = {
    "norris": [
        (lambda t, a=a, b=b: np.where(t > 0, np.exp(-a / np.maximum(t, 1e-9) - np.maximum(t, 0) / b), 0.0), (1.0, 2e3))
        for a, b in ((150.0, 90.0), (30.0, 200.0))
    ],
    "gauss_exponential": [
        (
            lambda t, d=d: np.where(
                t < 0, stats.norm.pdf(t, scale=40.0) / stats.norm.pdf(0, scale=40.0), np.exp(-t / d)
            ),
            (-1.0, 1.0),
        )
        for d in (90.0, 250.0)
    ],
    "bi_gauss": [
        (lambda t, d=d: np.exp(-(t**2) / (2 * np.where(t < 0, 30.0, d) ** 2)), (-1.0, 1.0)) for d in (60.0, 150.0)
    ],
    "emg": [(lambda t, k=k: stats.exponnorm.pdf(t, k, scale=35.0), (-50.0, 300.0)) for k in (1.5, 5.0)],
    "gamma": [(lambda t, k=k: stats.gamma.pdf(t, k, scale=60.0), (1.0, 900.0)) for k in (1.8, 5.0)],
    "logistic_exponential": [
        (lambda t, d=d: np.exp(-t / d) / (1 + np.exp(-t / 20.0)), (-100.0, 200.0)) for d in (70.0, 240.0)
    ],
    "log_normal": [
        (lambda t, s=s: np.exp(-(np.log(np.maximum(t, 1e-9) / 80) ** 2) / (2 * s**2)), (20.0, 300.0))
        for s in (0.4, 0.8)
    ],
}
CASES = [(family, *case) for family, cases in RAW.items() for case in cases]


def landmarks(curve: Curve, between: tuple[float, float]) -> tuple[float, float, float, float]:
    """Half-rise, maximum, time of 1/e, and the height of the maximum."""
    top = minimize_scalar(lambda t: -curve(np.array(t)), bounds=between, method="bounded", options={"xatol": 1e-9}).x
    peak = float(curve(np.array(top)))
    half = brentq(lambda t: curve(np.array(t)) - 0.5 * peak, top - 500.0, top)
    return half, top, brentq(lambda t: curve(np.array(t)) - peak / np.e, top, top + 5000.0), peak


@pytest.mark.parametrize(("family", "curve", "between"), CASES)
def test_a_curve_is_that_of_its_family(family: str, curve: Curve, between: tuple[float, float]) -> None:
    half, top, fallen, peak = landmarks(curve, between)
    found = pulses(family, np.array([top - half]), np.array([fallen - top]))
    after = np.linspace(-300.0, 1500.0, 1801)

    off = np.abs(found.at(0, after) - curve(half + after) / peak)
    assert np.quantile(off, 0.99) < 1e-3
    assert off.max() < 0.04  # where a curve begins with a corner
    assert found.at(0, np.array(0.0)) == pytest.approx(0.5, abs=1e-4)
    assert found.at(0, np.array(top - half)) == pytest.approx(1.0, abs=2e-3)


@pytest.mark.parametrize("length_s", [0.1, 7.0, 60.0, 400.0])
@pytest.mark.parametrize(("family", "curve", "between"), CASES)
def test_a_receiver_measures_the_mean_over_its_integration(
    family: str, curve: Curve, between: tuple[float, float], length_s: float
) -> None:
    half, top, fallen, peak = landmarks(curve, between)
    found = pulses(family, np.array([top - half]), np.array([fallen - top]))
    for middle in (-40.0, 0.0, 25.0, 300.0):
        ends = (middle - 0.5 * length_s, middle + 0.5 * length_s)
        mean = (
            quad(lambda t: float(curve(np.array(half + t))) / peak, *ends, points=(0.0, -half), limit=200)[0] / length_s
        )

        assert found.mean(0, np.array(ends[0]), np.array(ends[1])) == pytest.approx(mean, abs=3e-4)


def test_all_of_a_pulse_is_within_its_reach() -> None:
    for family in FAMILIES:
        found = pulses(family, np.array([50.0]), np.array([50.0 * decay_over_rise(family)[0] * 1.5]))
        (first,), (last,) = found.reach_s()
        whole = found.mean(0, np.array(-700.0), np.array(9000.0)) * 9700.0
        assert found.mean(0, np.array(first), np.array(last)) * (last - first) == pytest.approx(whole, rel=2e-3)
        assert first < -20.0 < 100.0 < last


def test_a_family_keeps_to_what_it_can_be() -> None:
    least, most = decay_over_rise("gamma")
    steep = pulses("gamma", np.array([10.0, 10.0]), np.array([10.0 * most, 1e4]))

    np.testing.assert_allclose(steep.height[0], steep.height[1])
    assert 1.2 < least < 2.0 < most


def test_drawn_rises_hold_real_bursts_and_laws_that_are_faster() -> None:
    laws = [draw_pulse_law(np.random.default_rng(seed)) for seed in range(400)]
    for rises_s in (REAL_RISES_S, EXTRAPOLATED_RISES_S):
        for frequency_mhz, rise_s in rises_s.items():
            drawn = [law.rises_s(np.array([frequency_mhz]))[0] for law in laws]
            assert np.quantile(drawn, 0.01) < rise_s < np.quantile(drawn, 0.99)
    assert {law.family for law in laws} == set(FAMILIES)
    decays = [law.decays_s(np.array([0.5]))[0] for law in laws]
    assert 100.0 < np.median(decays) < 200.0  # between the laws of Kontar et al. 2019 and of Alvarez & Haddock 1973


def test_a_law_has_the_slope_and_bend_that_it_says() -> None:
    law = PulseLaw("emg", 60.0, -1.0, 0.1, 150.0, -1.1)
    octaves = 0.5 * np.exp(np.array([-1.0, 0.0, 1.0]))

    np.testing.assert_allclose(law.rises_s(octaves), 60.0 * np.exp([1.1, 0.0, -0.9]))
    np.testing.assert_allclose(law.decays_s(octaves), 150.0 * np.exp([1.1, 0.0, -1.1]))


def test_what_is_no_law_is_refused() -> None:
    with pytest.raises(InputError, match="light curve 'square' is not known; choose one of norris"):
        PulseLaw("square")
    with pytest.raises(InputError, match="rise_s is 0; give a number of seconds above zero"):
        PulseLaw(rise_s=0.0)
