import numpy as np
import pytest

from bella.bursts.edges import first_maximum


def pulses(*heights_at: tuple[float, float], width: float = 6.0) -> np.ndarray:
    samples = np.arange(200.0)
    return sum(height * np.exp(-0.5 * ((samples - at) / width) ** 2) for height, at in heights_at)


def test_a_brighter_second_maximum_is_passed_over() -> None:
    assert first_maximum(pulses((0.8, 60), (1.0, 100)), 6.0) == 60


def test_a_first_maximum_below_the_share_that_counts_is_a_precursor() -> None:
    assert first_maximum(pulses((0.4, 60), (1.0, 100)), 6.0) == 100


def test_a_shallow_dip_is_not_the_end() -> None:
    together = pulses((0.9, 60), (1.0, 75))
    assert 0.85 < together[65:70].min() < 0.88

    assert first_maximum(together, 6.0) == together.argmax()


@pytest.mark.parametrize("samples_on_rise", [0.3, 6.0])
def test_noise_does_not_make_a_maximum(samples_on_rise: float) -> None:
    random = np.random.default_rng(4)
    width = 7.0 * max(samples_on_rise / 6.0, 0.2)
    for _ in range(50):
        noisy = pulses((1.0, 100), width=width) * random.normal(1.0, 0.05, 200) + random.normal(0.0, 0.02, 200)
        assert abs(first_maximum(noisy, samples_on_rise) - 100) <= width


@pytest.mark.parametrize("power", [np.zeros(5), np.ones(1), -np.arange(1.0, 4.0), np.arange(4.0)])
def test_a_light_curve_without_a_dip_has_its_highest_sample(power: np.ndarray) -> None:
    assert first_maximum(power, 1.0) == power.argmax()
