"""Limits from which on a candidate is a burst, one by one."""

import numpy as np
import pytest

from bella.bursts.detection import (
    NO_DRIFT,
    NO_SUPPORT,
    _lasting,
    _why_none,
)
from bella.bursts.light_curves import decay_s
from bella.bursts.matched_filter import FREQUENCY_MHZ, over_quiet, search_grid
from tests.bursts.test_search_grid import quiet, with_column


def seen_in(low: int, high: int) -> np.ndarray:
    """Channels of the grid that see a candidate: so many below 2 MHz, from there down, and so many above it."""
    first = int(np.searchsorted(FREQUENCY_MHZ, 2.0))
    hit = np.zeros(FREQUENCY_MHZ.size, dtype=bool)
    hit[first - low : first + high] = True
    return hit


@pytest.mark.parametrize(
    ("low", "high", "undrifting", "revisit", "reason"),
    [
        (4, 10, (10.9, 5.0), 1.0, ""),
        (4, 10, (11.1, 5.0), 1.0, NO_DRIFT),
        (4, 10, (5.0, 9.9), 1.0, ""),
        (4, 10, (5.0, 10.1), 1.0, NO_DRIFT),
        (4, 10, (12.0, 10.9), 3.0, ""),  # a receiver that looks every three minutes sees less of a drift
        (4, 10, (12.2, 10.9), 3.0, NO_DRIFT),
        (4, 10, (12.0, 11.1), 3.0, NO_DRIFT),
        (3, 10, (8.3, 5.0), 1.0, ""),
        (3, 10, (8.4, 5.0), 1.0, NO_DRIFT),
        (3, 2, (5.0, 5.0), 1.0, NO_SUPPORT),
        (3, 3, (9.0, 5.0), 1.0, NO_DRIFT),
        (24, -7, (8.3, 5.0), 1.0, ""),  # three channels above 0.8 MHz
        (24, -7, (8.4, 5.0), 1.0, NO_SUPPORT),
        (24, -7, (9.0, 5.0), 2.0, ""),
        (24, -7, (9.2, 5.0), 2.0, NO_SUPPORT),
        (24, -7, (5.0, 9.9), 3.0, ""),
        (24, -7, (5.0, 10.1), 6.0, NO_SUPPORT),
        (20, -7, (5.0, 5.0), 3.0, NO_SUPPORT),  # 13 in all
    ],
)
def test_a_drift_has_to_fit_better_than_none(low, high, undrifting, revisit, reason) -> None:
    assert _why_none(seen_in(low, high), 10.0, undrifting, revisit) == reason


@pytest.mark.parametrize(("channel", "minutes"), [(20, 8), (35, 8), (35, 25)])
def test_how_long_a_channel_stays_near_its_peak(channel: int, minutes: int) -> None:
    grid = search_grid(over_quiet(with_column(quiet(), slice(300, 300 + minutes), slice(channel - 2, channel + 3))))
    usual_s = 60.0 + 2 * decay_s(FREQUENCY_MHZ[channel])

    assert _lasting(grid, 300, channel) == pytest.approx(60.0 * minutes / usual_s, rel=0.05)


@pytest.mark.parametrize(
    ("height_db", "after_db", "is_near"),
    [(10.0, 6.0, True), (10.0, 4.0, False), (30.0, 22.0, True), (30.0, 18.0, False)],
)
def test_near_its_peak_is_within_half_of_it_and_ten_db(height_db: float, after_db: float, is_near: bool) -> None:
    channel = 35
    channels = slice(channel - 2, channel + 3)
    spectrum = with_column(
        with_column(quiet(), slice(300, 308), channels, height_db), slice(308, 314), channels, after_db
    )
    grid = search_grid(over_quiet(spectrum))
    minutes = 14 if is_near else 8
    usual_s = 60.0 + 2 * decay_s(FREQUENCY_MHZ[channel])

    assert _lasting(grid, 300, channel) == pytest.approx(60.0 * minutes / usual_s, rel=0.05)
