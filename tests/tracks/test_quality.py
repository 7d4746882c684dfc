"""Every flag of the misfit of a track is raised beyond its limit and not before it."""

from dataclasses import replace

import numpy as np
import pytest

from bella.records import Parameter
from bella.tracks.fit import is_no_spiral
from bella.tracks.model import WindPrior
from bella.tracks.quality import Quality, shared_band
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
        ("errors_too_large", {"misfit_p": 0.99988, "chi2": 17.0}, {"misfit_p": 0.99991, "chi2": 17.0}),
        ("errors_too_large", {"misfit_p": 1.0, "chi2": 19.0}, {"misfit_p": 1.0, "chi2": 17.0}),
        ("components_differ", {"plain_chi2": 2.45}, {"plain_chi2": 2.55}),
        ("components_differ", {"width_share": 0.135}, {"width_share": 0.145}),
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
