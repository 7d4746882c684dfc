import numpy as np
import pytest

from bella.heliosphere.scattering import NO_DELAY, DirectionalDelay, one_minus_cosine, rise_s

SOURCE = np.array([20.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("receiver", "expected"),
    [
        ([215.0, 0.0, 0.0], 0.0),
        ([20.0, 150.0, 0.0], 1.0),
        ([20.0, 0.0, -3.0], 1.0),
        ([120.0, 60.0, 80.0], 1.0 - np.sqrt(0.5)),
        ([-215.0, 0.0, 0.0], 2.0),
    ],
)
def test_the_angle_is_that_between_the_ways_from_the_sun_and_to_the_receiver(
    receiver: list[float], expected: float
) -> None:
    assert one_minus_cosine(SOURCE, np.array(receiver)) == pytest.approx(expected, abs=1e-12)


def test_sources_and_receivers_broadcast() -> None:
    receivers = np.array([[215.0, 0.0, 0.0], [20.0, 150.0, 0.0], [-215.0, 0.0, 0.0]])

    assert one_minus_cosine(np.stack([SOURCE, 3.0 * SOURCE])[:, np.newaxis], receivers).shape == (2, 3)


@pytest.mark.parametrize(
    ("frequency_mhz", "first", "second"), [(0.2, 186.0, 170.0), (0.5, 90.0, 71.0), (1.0, 37.0, 30.0)]
)
def test_a_typical_rise_lies_between_those_of_the_two_real_bursts(
    frequency_mhz: float, first: float, second: float
) -> None:
    assert 0.95 * second < rise_s(np.array([frequency_mhz]))[0] < first


def test_a_delay_is_free_where_its_mean_or_its_deviation_is() -> None:
    assert not NO_DELAY.is_free
    assert DirectionalDelay(1.0, 0.0).is_free
    assert DirectionalDelay(0.0, 0.1).is_free
