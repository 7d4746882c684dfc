import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from bella.bursts.edges import gauss_hermite, gauss_hermite_edge, mode_widths
from bella.simulation.light_curves import PulseLaw


def test_published_values_of_the_curve() -> None:
    at = np.array([-2, -1, 0, 0.5, 1, 2, 3])
    expected = [0.083443, 0.610597, 1.030619, 0.821060, 0.540561, 0.239715, 0.064801]
    np.testing.assert_allclose(gauss_hermite(at, [1, 0, 1, 0.1, 0.05, 0]), expected, atol=1e-6)


@pytest.mark.parametrize(
    ("h3", "h4", "mode", "height", "half"),
    [
        (0.1, 0.05, -0.12947, 1.041981, -1.11821),
        (0.2, 0.0, -0.27122, 1.050007, -1.16697),
        (-0.2, 0.1, 0.19975, 1.096847, -0.83250),
    ],
)
def test_published_peaks(h3: float, h4: float, mode: float, height: float, half: float) -> None:
    def curve(x: float) -> float:
        return float(gauss_hermite(np.array(x), [1, 0, 1, h3, h4, 0]))

    assert mode_widths(h3, h4) == pytest.approx(mode, abs=1e-5)
    assert curve(mode_widths(h3, h4)) == pytest.approx(height, abs=1e-6)
    assert brentq(lambda x: curve(x) - height / 2, mode - 1.5, mode) == pytest.approx(half, abs=1e-5)


@pytest.mark.parametrize(("h3", "h4"), [(0.0, 0.0), (1e-200, 0.0), (0.0, 1e-12), (1e-12, -1e-99)])
def test_a_curve_that_is_nearly_a_gaussian_peaks_at_its_centre(h3: float, h4: float) -> None:
    assert mode_widths(h3, h4) == pytest.approx(0.0, abs=1e-9)


@settings(deadline=None, max_examples=25)
@given(
    centre=st.floats(900, 1500),
    width=st.floats(90, 250),
    h3=st.floats(-0.15, 0.2),
    h4=st.floats(-0.05, 0.1),
    scale=st.sampled_from([1e-15, 1.0, 1e9]),
)
def test_a_curve_of_its_own_kind_is_found_again(
    centre: float, width: float, h3: float, h4: float, scale: float
) -> None:
    time = np.arange(0, 2400, 38.0)

    edge = gauss_hermite_edge(time, scale * gauss_hermite(time, [1.0, centre, width, h3, h4, 0.05]))

    assert edge.flag == ""
    assert edge.arrival_s == pytest.approx(centre + width * (mode_widths(h3, h4) - 1), abs=0.05)


def observed(
    cadence_s: float, phase_s: float, random: np.random.Generator, frequency_mhz: float = 0.5
) -> tuple[np.ndarray, np.ndarray]:
    """Snapshots of a burst whose half-rise is at 0, with one part in twenty of noise."""
    time = np.arange(-600.0, 1500.0, cadence_s) + phase_s
    curve = PulseLaw("emg", 35.0, -0.77).curves(np.array([frequency_mhz]))
    power = curve.mean(0, time - 1, time + 1) * (1 + 0.05 * random.standard_normal(time.size))
    return time, power + 0.005 * random.standard_normal(time.size)


@pytest.mark.parametrize("cadence_s", [38.0, 7.0])
def test_edge_is_earlier_than_the_half_rise_with_little_scatter(cadence_s: float) -> None:
    random = np.random.default_rng(8)
    edges = [gauss_hermite_edge(*observed(cadence_s, random.uniform(0, cadence_s), random)) for _ in range(30)]

    off = np.array([edge.arrival_s for edge in edges])
    assert -20 < np.median(off) < -8
    assert np.std(off) < 5
    assert all(0 < edge.sigma_s < 15 for edge in edges)


def test_shift_and_gain_move_only_what_they_should() -> None:
    time, power = observed(38.0, 5.0, np.random.default_rng(1))
    edge = gauss_hermite_edge(time, power)

    later, louder = gauss_hermite_edge(time + 1234.5, power), gauss_hermite_edge(time, 10 * power)

    assert later.arrival_s == pytest.approx(edge.arrival_s + 1234.5, abs=1e-2)
    assert louder.arrival_s == pytest.approx(edge.arrival_s, abs=1e-2)
    assert louder.sigma_s == pytest.approx(edge.sigma_s, rel=1e-3)


@pytest.mark.parametrize(
    ("power", "reason"),
    [
        (np.full(40, np.nan), "no_samples"),
        (np.r_[np.ones(6), np.full(34, np.nan)], "no_samples"),
        (np.zeros(40), "no_signal"),
        (np.linspace(0, 1, 40) ** 6, "peak_outside"),
    ],
)
def test_light_curve_without_an_edge_says_why(power: np.ndarray, reason: str) -> None:
    edge = gauss_hermite_edge(np.arange(40) * 60.0, power)

    assert edge.flag == reason
    assert np.isnan(edge.arrival_s)
