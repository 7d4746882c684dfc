"""Simulated bursts through the whole pipeline, and the table and page about them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from scipy import stats

from bella.calibration.found import (
    MOST_BURSTS,
    FoundBurst,
    Quantity,
    Task,
    _holds,
    _inside,
    _longitude,
    _position_quality,
    case_of,
    find_all,
    follow,
    tasks_of,
)
from bella.calibration.found_page import found_page
from bella.calibration.found_table import (
    FoundRow,
    found_csv,
    found_rows,
    parse_found,
    published_rows,
    stratum_of,
    wilson_interval,
)
from bella.exceptions import InputError
from bella.records import Interval, JointTrack, Moment, Parameter
from bella.simulation.strata import FIRST_JUDGING_SEED

DOCS = Path(__file__).parents[2] / "docs"
GOOD = Quantity(in68=1.0, in95=1.0, error=1.0, width=4.0)


@pytest.fixture(scope="module")
def two_fleets() -> list[FoundBurst]:
    """One clean burst of three spacecraft and one of two."""
    return list(find_all([Task("clean", "2012", 1), Task("clean", "pair", 2)]))


def test_three_spacecraft_give_every_number(two_fleets: list[FoundBurst]) -> None:
    final = two_fleets[0]
    assert (final.reason, final.tier, final.spacecraft) == ("", "final", 3)
    assert final.position is not None
    assert final.phi0 is not None
    assert final.wind is not None
    assert final.beam is not None
    assert not final.lost
    # a clean burst is placed: the numbers are of the truth of this burst and in these units
    assert final.position.error < 5.0
    assert final.phi0.error < 10.0
    assert final.wind.error < 300.0
    assert final.beam.error < 0.1


def test_two_spacecraft_give_a_longitude_alone(two_fleets: list[FoundBurst]) -> None:
    preliminary = two_fleets[1]
    assert (preliminary.reason, preliminary.tier, preliminary.grade) == ("", "preliminary", "D")
    assert (preliminary.edge, preliminary.spacecraft) == ("half_rise", 2)
    assert preliminary.phi0 is not None
    assert (preliminary.position, preliminary.wind, preliminary.beam) == (None, None, None)
    assert preliminary.phi0.width < 180.0


def test_a_burst_is_compared_with_its_own_truth() -> None:
    task = Task("clean", "2012", 1)
    case = case_of(task)
    turned = replace(case.drawn, burst=replace(case.burst, phi0_deg=case.burst.phi0_deg + 90.0))
    # the spectra are those that were received: a cached property is kept in the instance
    other = replace(case, drawn=turned)
    vars(other)["spectra"] = case.spectra
    wrong = follow(task, other)
    assert wrong.phi0 is not None
    assert (wrong.phi0.in68, wrong.phi0.in95) == (0.0, 0.0)
    assert wrong.phi0.error == pytest.approx(90.0, abs=10.0)
    assert wrong.position is not None
    assert wrong.position.in95 < 0.1
    assert wrong.lost


def test_only_bursts_for_judging_are_taken() -> None:
    assert case_of(Task("clean", "2012", 7)).seed == FIRST_JUDGING_SEED + 7


def test_a_burst_that_nobody_receives_has_a_reason() -> None:
    task = Task("clean", "2012", 1)
    case = case_of(task)
    silent = replace(case, drawn=replace(case.drawn, burst=replace(case.burst, contrast=1e-6)))
    assert follow(task, silent) == FoundBurst(task, reason="not detected")


def test_bursts_of_seeds_do_not_overlap() -> None:
    first, second = (tasks_of(["clean"], MOST_BURSTS, seed) for seed in (0, 1))
    assert not {one.number for one in first} & {one.number for one in second}
    assert len(set(first)) == 3 * MOST_BURSTS


@pytest.mark.parametrize(
    ("strata", "bursts", "seed", "message"),
    [
        (["far"], 2, 1, "stratum 'far' is not known"),
        (["clean"], 0, 1, "0 bursts"),
        (["clean"], MOST_BURSTS + 1, 1, f"{MOST_BURSTS + 1} bursts"),
        (["clean"], 2, -1, "seed -1"),
    ],
)
def test_bad_choices_are_refused(strata: list[str], bursts: int, seed: int, message: str) -> None:
    with pytest.raises(InputError, match=message):
        tasks_of(strata, bursts, seed)


def test_no_worker_can_do_nothing() -> None:
    with pytest.raises(InputError, match="0 workers"):
        next(find_all([], 0))


@pytest.mark.parametrize(
    ("apart_sd", "in68", "in95", "lost"),
    [
        (1.50, 1.0, 1.0, False),
        (1.52, 0.0, 1.0, False),
        (2.46, 0.0, 0.0, False),
        (3.43, 0.0, 0.0, False),
        (3.45, 0, 0, True),
    ],
)
def test_regions_of_positions_are_those_of_two_dimensions(
    apart_sd: float, in68: float, in95: float, lost: bool
) -> None:
    # circles of 1.51, 2.448 and 3.439 standard deviations hold 68, 95 and 99.73 % (Rayleigh: sqrt(-2 ln(1 - p)))
    case = case_of(Task("clean", "2012", 1))
    frequency_mhz = np.array([0.3, 0.5, 1.0])
    truth = case.truth("WIND", frequency_mhz)
    # standard deviations 2 and 1 along axes turned by 30 deg; the positions are off along the long one
    long, short = np.array([np.sqrt(0.75), 0.5]), np.array([-0.5, np.sqrt(0.75)])
    covariance = 4.0 * np.outer(long, long) + np.outer(short, short)
    columns = {
        "x_rsun": truth["x_rsun"] + 2.0 * apart_sd * long[0],
        "y_rsun": truth["y_rsun"] + 2.0 * apart_sd * long[1],
        "cov_xx_rsun2": np.full(3, covariance[0, 0]),
        "cov_xy_rsun2": np.full(3, covariance[0, 1]),
        "cov_yy_rsun2": np.full(3, covariance[1, 1]),
    }
    posterior = xr.Dataset(
        {name: ("frequency", np.asarray(value)) for name, value in columns.items()}, {"frequency": frequency_mhz}
    )
    found, is_lost = _position_quality(posterior, case)
    assert (found.in68, found.in95, is_lost) == (in68, in95, lost)
    assert (found.error, found.width) == pytest.approx((2.0 * apart_sd, 4.0))


def parameter(low: float, middle: float, high: float) -> Parameter:
    half = high - low
    return Parameter(q2_5=middle - half, q16=low, q50=middle, q84=high, q97_5=middle + half)


@pytest.mark.parametrize(("truth", "in68", "in95"), [(11.0, 1.0, 1.0), (13.0, 0.0, 1.0), (7.0, 0.0, 1.0), (15, 0, 0)])
def test_intervals_hold_what_is_between_their_ends(truth: float, in68: float, in95: float) -> None:
    found = _inside(parameter(8.0, 10.0, 12.0), truth)
    assert found == Quantity(in68=in68, in95=in95, error=abs(truth - 10.0), width=4.0)


def joint(phi0: Parameter, *parts: tuple[float, float, float]) -> JointTrack:
    region = tuple(Interval(low=low, high=high, probability=p) for low, high, p in parts)
    empty = Parameter()
    return JointTrack(
        model="test",
        rotation_period_d=25.0,
        epoch_utc="",
        phi0_deg=phi0,
        phi0_68=region,
        phi0_95=region,
        v_sw_km_s=empty,
        beam_speed_c=empty,
        release_utc=Moment(),
    )


@pytest.mark.parametrize("truth", [-179.0, 181.0])
def test_a_longitude_is_compared_around_the_circle(truth: float) -> None:
    found = _longitude(joint(parameter(177.0, 179.0, 182.0)), truth)
    assert found is not None
    assert (found.in68, found.error) == (1.0, pytest.approx(2.0))


def test_of_several_parts_each_counts_and_the_error_is_of_the_likeliest() -> None:
    track = joint(parameter(-40.0, 0.0, 40.0), (170.0, 190.0, 0.2), (20.0, 50.0, 0.48))
    inside, outside = _longitude(track, -175.0), _longitude(track, 0.0)
    assert inside is not None
    assert outside is not None
    assert (inside.in68, inside.width, inside.error) == (1.0, 50.0, pytest.approx(150.0))
    assert (outside.in68, outside.error) == (0.0, pytest.approx(35.0))


def test_no_longitude_is_no_number() -> None:
    assert _longitude(joint(Parameter()), 0.0) is None


def test_regions_end_where_they_say() -> None:
    part = (Interval(low=170.0, high=200.0, probability=0.7),)
    assert [_holds(part, one) for one in (169.0, 171.0, -161.0, -159.0)] == [False, True, True, False]


@pytest.mark.parametrize(("hits", "number"), [(0, 5), (3, 10), (17, 24), (24, 24)])
def test_interval_is_that_of_wilson(hits: int, number: int) -> None:
    expected = stats.binomtest(hits, number).proportion_ci(0.95, method="wilson")
    np.testing.assert_allclose(wilson_interval(hits / number, number), expected, atol=1e-12)


def final(stratum: str, number: int, phi0: Quantity | None = GOOD, **changed: object) -> FoundBurst:
    one = FoundBurst(
        Task(stratum, "2012", number),
        tier="final",
        grade="A",
        edge="shared_profile",
        spacecraft=3,
        position=GOOD,
        phi0=phi0,
        wind=GOOD,
        beam=GOOD,
    )
    return replace(one, **changed)  # type: ignore[arg-type]


BAD = Quantity(in68=0.0, in95=0.0, error=9.0, width=2.0)
MANY = [
    *(final("clean", number) for number in range(6)),
    *(final("pairs", number, BAD, grade="C", edge="half_rise", position=BAD, lost=True) for number in range(2)),
    FoundBurst(Task("pairs", "2012", 2), reason="not detected"),
    final("pairs", 3, tier="preliminary", grade="D", position=None, wind=None, beam=None),
]


def row(rows: list[FoundRow], **named: str) -> FoundRow:
    key = {"fleet": "2012", "tier": "final", "edge": "all", "grade": "all", "quantity": "phi0", **named}
    (found,) = [one for one in rows if all(getattr(one, name) == value for name, value in key.items())]
    return found


def test_groups_count_their_own_bursts() -> None:
    rows = found_rows(MANY, 3)
    clean, pairs, everything = (row(rows, stratum=name) for name in ("clean", "pairs", "all"))
    assert [(one.simulated, one.answers, one.bursts) for one in (clean, pairs, everything)] == [
        (6, 6, 6),
        (4, 2, 2),
        (10, 8, 8),
    ]
    assert [one.cover68 for one in (clean, pairs, everything)] == [1.0, 0.0, 0.75]
    assert (everything.cover95_low, everything.cover95_high) == pytest.approx(wilson_interval(0.75, 8))
    assert (everything.median_error, everything.median_width) == (1.0, 4.0)
    assert row(rows, stratum="all", quantity="position").lost == 0.25
    assert row(rows, stratum="all", grade="C").cover68 == 0.0
    assert row(rows, stratum="all", edge="shared_profile").bursts == 6
    assert row(rows, stratum="all", tier="preliminary").bursts == 1
    assert {one.seed for one in rows} == {3}


def test_a_table_is_read_as_it_was_written() -> None:
    rows = found_rows([*MANY, FoundBurst(Task("clean", "pair", 0), reason="not detected")], 3)
    assert parse_found(found_csv(rows)) == rows
    with pytest.raises(InputError, match="its columns are others"):
        parse_found("stratum,fleet\n")


def test_departures_are_levels_outside_the_wilson_interval() -> None:
    rows = found_rows(MANY, 3)
    # none of two: up to 0.658 with Wilson
    assert row(rows, stratum="pairs").departures == ("the 68 % interval holds 0.00", "the 95 % interval holds 0.00")
    assert row(rows, stratum="clean").departures == ()
    many = found_rows([final("clean", number) for number in range(30)], 3)
    assert row(many, stratum="clean").departures == ("the 68 % interval holds 1.00",)


def test_page_says_what_does_not_hold() -> None:
    page = found_page(found_rows(MANY, 3), table="table.csv")
    said = "- Longitude of the footpoint, pairs, three spacecraft (final, 2 bursts): the 68 % interval holds 0.00 and"
    assert said in page
    assert "Longitude of the footpoint, clean" not in page
    assert "| three | 10 | 8 final, 1 preliminary | 7 |" in page
    assert "`bella calibrate --found --bursts 6 --seed 3`" in page


def test_a_solution_stands_beside_bursts_timed_as_it_was() -> None:
    rows = found_rows(MANY, 3)
    found = stratum_of(3, "shared_profile", "final", rows)
    assert [(one.quantity, one.stratum, one.bursts) for one in found] == [
        (name, "all", 6) for name in ("position", "phi0", "wind", "beam")
    ]
    assert [one.cover68 for one in stratum_of(3, "half_rise", "final", rows)] == [0.0, 0.0, 1.0, 1.0]


@pytest.mark.parametrize(("spacecraft", "edge"), [(1, "shared_profile"), (4, "shared_profile"), (3, "gauss_hermite")])
def test_a_solution_that_was_never_simulated_has_no_rows(spacecraft: int, edge: str) -> None:
    assert stratum_of(spacecraft, edge, "final", found_rows(MANY, 3)) == ()


def test_published_table_is_that_of_the_page() -> None:
    text = (DOCS / "calibration-found.csv").read_text(encoding="utf-8")
    rows = parse_found(text)
    assert tuple(rows) == published_rows()
    assert (DOCS / "calibration-found.md").read_text(encoding="utf-8") == found_page(
        rows, table="calibration-found.csv"
    )


@pytest.mark.parametrize(
    ("spacecraft", "edge", "tier", "numbers"),
    [
        (3, "shared_profile", "final", ["position", "phi0", "wind", "beam"]),
        (4, "shared_profile", "final", ["position", "phi0", "wind", "beam"]),
        (5, "shared_profile", "final", ["position", "phi0", "wind", "beam"]),
        (2, "half_rise", "preliminary", ["phi0"]),
        (2, "half_rise", "final", []),
    ],
)
def test_real_solutions_find_their_stratum(spacecraft: int, edge: str, tier: str, numbers: list[str]) -> None:
    assert [one.quantity for one in stratum_of(spacecraft, edge, tier)] == numbers  # type: ignore[arg-type]
