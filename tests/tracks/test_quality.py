"""Every flag of the misfit of a track is raised beyond its limit and not before it."""

from dataclasses import replace

import numpy as np
import pytest

from bella.arrivals import SHAPE_LENGTH_LN_F, error_scale_s
from bella.records import Parameter
from bella.tracks.fit import is_no_spiral
from bella.tracks.likelihood import Likelihood, evidence_of
from bella.tracks.model import Track, TrackModel, WindPrior
from bella.tracks.posterior import around_the_circle
from bella.tracks.quality import Quality, _left_out, doubted, shared_band, without_outliers
from tests.tracks.foreign import FOUR, Burst

GOOD = Quality(
    chi2=90.0,
    freedom=90.0,
    misfit_p=0.5,
    plain_chi2=1.0,
    offsets={"WIND": Parameter(mean=1.0, sd=2.0)},
    shared_band=1.0,
    width_share=0.05,
)


def raised(**changes: object) -> set[str]:
    return {name for name, on in replace(GOOD, **changes).flags.items() if on}  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("flag", "below", "beyond"),
    [
        ("poor_fit", {"misfit_p": 1.1e-4}, {"misfit_p": 0.9e-4}),
        ("errors_too_large", {"misfit_p": 0.99988, "chi2": 1.7}, {"misfit_p": 0.99991, "chi2": 1.7}),
        ("errors_too_large", {"misfit_p": 1.0, "chi2": 1.9}, {"misfit_p": 1.0, "chi2": 1.7}),
        ("components_differ", {"plain_chi2": 2.45}, {"plain_chi2": 2.55}),
        ("components_differ", {"width_share": 0.069}, {"width_share": 0.071}),
        ("edges_differ", {"added": 0.1}, {"added": 0.15}),
        ("two_spacecraft", {"shared_band": 0.61}, {"shared_band": 0.59}),
        ("arrivals_down_weighted", {"dropped": 0}, {"dropped": 1}),
        (
            "clock_offset",
            {"offsets": {"WIND": Parameter(mean=-5.9, sd=2.0)}},
            {"offsets": {"WIND": Parameter(mean=-6.1, sd=2.0)}},
        ),
    ],
)
def test_a_flag_is_raised_beyond_its_limit(flag: str, below: dict[str, object], beyond: dict[str, object]) -> None:
    assert raised(**below) == set()
    assert raised(**beyond) == {flag}


@pytest.mark.parametrize("received", [6, 12, 24])
def test_the_shared_band_is_where_a_third_spacecraft_was_timed(received: int) -> None:
    grid = Burst().arrivals()
    grid.arrival_s[received:, 2] = np.nan
    log = np.log(grid.frequency_mhz)

    expected = (log[received - 1] + 0.15 - log[0]) / (log[-1] - log[0])
    assert shared_band(grid) == pytest.approx(expected, abs=0.01)
    four = Burst().arrivals(receivers=FOUR)
    four.arrival_s[received:, 2] = np.nan
    assert shared_band(four) == 1.0


@pytest.mark.parametrize(
    ("measured", "sd", "prior", "expected"),
    [
        (1.0, 100.0, WindPrior(), False),  # nothing is measured
        (1.0, 100.0, WindPrior(0.5, 0.4), False),  # nor here, though winds above 1500 km/s have 0.28 beforehand
        (0.45, 0.16, WindPrior(0.5, 0.4), False),  # a fast wind, with 0.13
        (0.30, 0.16, WindPrior(), False),  # 1300 km/s fit as well as faster ones
        (0.15, 0.16, WindPrior(), False),  # three times less well, as for half-maximum edges of 2012-06-07
        (0.08, 0.16, WindPrior(), True),  # five times less well
        (-0.3, 0.16, WindPrior(), True),  # the longitude grows with distance
        (0.0, 0.10, WindPrior(), True),  # it stays
    ],
)
def test_only_winds_that_explain_more_than_fast_spirals_do_exclude_a_spiral(
    measured: float, sd: float, prior: WindPrior, expected: bool
) -> None:
    slowness = np.linspace(-2.0, 4.0, 60_001)
    log = -0.5 * ((slowness - prior.slowness) / prior.slowness_sd) ** 2 - 0.5 * ((slowness - measured) / sd) ** 2
    weight = np.exp(log - log.max())
    assert is_no_spiral(400.0 / np.clip(slowness, 0.1, 3.0), weight / weight.sum(), prior) is expected


def likelihood_of(late_s: dict[int, float], **noise: float) -> Likelihood:
    """Times of a burst without noise, some of them late."""
    grid = Burst().arrivals(receivers=FOUR, **noise)
    times = grid.arrival_s.copy()
    for row, by_s in late_s.items():
        times[row, 1] += by_s
    return Likelihood(Track(TrackModel(), (0.16, 1.9)), evidence_of(replace(grid, arrival_s=times)))


@pytest.mark.parametrize(("sigmas", "dropped"), [(5.5, 0), (6.6, 1)])
def test_a_time_six_errors_away_from_all_others_is_left_out(sigmas: float, dropped: int) -> None:
    unit = likelihood_of({14: 10.0})
    away = float(np.abs(_left_out(unit, around_the_circle(unit))).max()) / 10.0

    assert without_outliers(likelihood_of({14: sigmas / away}))[2] == dropped


def test_no_more_than_a_tenth_of_the_times_is_left_out() -> None:
    spoilt = likelihood_of({row: 300.0 * (-1) ** row for row in range(20)})

    assert without_outliers(spoilt)[2] == 12


def test_doubted_errors_are_a_minute_apart_and_half_of_the_rise() -> None:
    before = likelihood_of({})
    seen = before.seen
    added = doubted(before).seen.noise_s2 - seen.noise_s2
    first, again = (np.flatnonzero(seen.observatory == 0)[place] for place in (0, -1))
    other = np.flatnonzero(seen.observatory == 1)[0]
    apart = np.log(seen.rows.frequency_mhz[again] / seen.rows.frequency_mhz[first])
    scale = error_scale_s(seen.rows.rise_s)[[first, again]]

    assert added[first, other] == 0.0
    assert added[first, first] == pytest.approx(60.0**2 + (0.45 * scale[0]) ** 2 * (1 + 1 / 9))
    shared = np.exp(-0.5 * (apart / SHAPE_LENGTH_LN_F) ** 2)
    assert added[first, again] == pytest.approx(60.0**2 + 0.45**2 * scale[0] * scale[1] * shared)
