"""Every flag of the misfit of a track is raised beyond its limit and not before it."""

from dataclasses import replace

import numpy as np
import pytest

from bella.records import Parameter
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
