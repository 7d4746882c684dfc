"""Sources where lines of sight come closest, and the companion of wave directions."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bella.exceptions import InputError
from bella.heliosphere import spiral_position_rsun
from bella.tracks.directions import DirectionTerms, check_directions, direction_terms
from bella.tracks.triangulation import triangulate, triangulation_companion

AU = 215.0
SOURCE = 50.0 * np.array([np.cos(np.radians(10)), np.sin(np.radians(10)), 0.0])
PAIR_RSUN = AU * np.array([[1.0, 0, 0], [np.cos(np.radians(90)), np.sin(np.radians(90)), 0]])
coordinate = st.floats(-200, 200)

FREQUENCY_MHZ = np.geomspace(0.15, 2.0, 40)
EPOCH = np.datetime64("2012-06-07T19:00", "ns")
PHI0_DEG, WIND_KM_S, ROTATION_D = 30.0, 400.0, 25.38
PLACES = {"A": (215.0, 0.0, 0.0), "B": (-97.0, 192.0, 0.0), "C": (-97.0, -192.0, 0.0)}


def at_longitudes(*degrees: float) -> np.ndarray:
    angle = np.radians(degrees)
    return AU * np.stack([np.cos(angle), np.sin(angle), np.zeros(len(degrees))], axis=-1)


def test_two_lines_meet_halfway_between_their_closest_points() -> None:
    # two skew lines by hand: along X at z = 0 and along Y at z = 2, seen from the same distance
    receivers = np.array([[10.0, 0, 0], [0, 10.0, 2.0]])
    towards = np.array([[-1.0, 0, 0], [0, -1.0, 0]])

    found = triangulate(receivers, towards, np.ones(2))

    np.testing.assert_allclose(found.position_rsun, [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(found.miss_rsun, [1, 1])
    assert found.flags == ()


@given(x=coordinate, y=coordinate, z=coordinate)
def test_exact_directions_give_the_source(x: float, y: float, z: float) -> None:
    source = np.array([x, y, z])
    receivers = at_longitudes(0.0, 100.0, -110.0)
    assume(np.linalg.norm(receivers - source, axis=1).min() > 5)

    found = triangulate(receivers, source - receivers, np.array([1.0, 2.0, 3.0]))

    np.testing.assert_allclose(found.position_rsun, source, atol=1e-6)
    assert found.flags == ()


@given(seed=st.integers(0, 2**31))
def test_turning_and_moving_the_frame_turns_and_moves_the_source(seed: int) -> None:
    random = np.random.default_rng(seed)
    receivers = at_longitudes(0.0, 90.0, 200.0)
    towards = SOURCE - receivers + random.normal(0, 5, (3, 3))
    turn, move = Rotation.random(random_state=seed).as_matrix(), random.normal(0, 100, 3)
    sigma = np.array([1.0, 2.0, 5.0])

    here, there = (
        triangulate(receivers, towards, sigma),
        triangulate(receivers @ turn.T + move, towards @ turn.T, sigma),
    )

    np.testing.assert_allclose(there.position_rsun, turn @ here.position_rsun + move, atol=1e-6)
    np.testing.assert_allclose(there.covariance_rsun2, turn @ here.covariance_rsun2 @ turn.T, atol=1e-6)
    assert there.condition_number == pytest.approx(here.condition_number)


def test_errors_are_as_large_as_their_scatter_and_as_published() -> None:
    # sd of x, y, z for 90 degrees between the spacecraft and 3 degrees of error: 8, 12, 7 solar radii
    random, receivers = np.random.default_rng(3), at_longitudes(-45.0, 45.0)
    exact = (SOURCE - receivers) / np.linalg.norm(SOURCE - receivers, axis=1)[:, None]
    trials = [
        triangulate(receivers, exact + random.normal(0, np.radians(3.0), (2, 3)), np.full(2, 3.0)) for _ in range(2000)
    ]

    off = np.array([trial.position_rsun - SOURCE for trial in trials])
    inside = [found @ np.linalg.solve(t.covariance_rsun2, found) < 3.527 for t, found in zip(trials, off, strict=True)]
    robust_sd = 0.5 * np.subtract(*np.quantile(off, [0.84, 0.16], axis=0))
    np.testing.assert_allclose(robust_sd, [8, 12, 7], rtol=0.1)
    assert np.mean(inside) == pytest.approx(0.68, abs=0.05)


def test_geometry_near_the_baseline_shows_in_the_condition_number() -> None:
    across, beside = at_longitudes(-75.0, 75.0), at_longitudes(-45.0, 45.0)
    poor = triangulate(across, SOURCE - across, np.full(2, 3.0))
    good = triangulate(beside, SOURCE - beside, np.full(2, 3.0))

    assert poor.condition_number > 100 * good.condition_number
    assert np.sqrt(poor.covariance_rsun2[1, 1]) > 100


def test_parallel_lines_have_no_source() -> None:
    found = triangulate(PAIR_RSUN, np.array([[-1.0, 0, 0], [-1.0, 1e-4, 0]]), np.ones(2))

    assert found.flags == ("parallel_lines",)
    assert np.isnan(found.position_rsun).all()
    assert np.isnan(found.covariance_rsun2).all()


def test_unlike_errors_do_not_make_lines_parallel() -> None:
    found = triangulate(PAIR_RSUN, SOURCE - PAIR_RSUN, np.array([1.0, 100.0]))

    assert found.flags == ()
    np.testing.assert_allclose(found.position_rsun, SOURCE, atol=1e-6)


def test_source_behind_a_spacecraft_is_flagged() -> None:
    found = triangulate(PAIR_RSUN, PAIR_RSUN - SOURCE, np.ones(2))

    np.testing.assert_allclose(found.position_rsun, SOURCE, atol=1e-6)
    assert found.flags == ("behind_spacecraft",)


@pytest.mark.parametrize(
    ("receivers", "towards", "sigma", "reason"),
    [
        (PAIR_RSUN[:1], PAIR_RSUN[:1], np.ones(1), "two spacecraft or more"),
        (PAIR_RSUN, PAIR_RSUN[:1], np.ones(2), "are not N x 3"),
        (PAIR_RSUN, np.zeros((2, 3)), np.ones(2), "missing or zero"),
        (PAIR_RSUN, -PAIR_RSUN, np.array([1.0, 0.0]), "not a finite angle"),
        (PAIR_RSUN, -PAIR_RSUN, np.array([1.0, np.inf]), "not a finite angle"),
        (PAIR_RSUN, -PAIR_RSUN, np.array([1.0, np.nan]), "not a finite angle"),
        (PAIR_RSUN, np.full((2, 3), np.nan), np.ones(2), "missing or zero"),
    ],
)
def test_bad_lines_are_refused(receivers: np.ndarray, towards: np.ndarray, sigma: np.ndarray, reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        triangulate(receivers, towards, sigma)


def source_rsun(frequency_mhz: np.ndarray) -> np.ndarray:
    return spiral_position_rsun(40.0 * 0.55 / frequency_mhz, PHI0_DEG, WIND_KM_S, ROTATION_D)


def directions(
    names: tuple[str, ...] = ("A", "B"), frequency_mhz: np.ndarray = FREQUENCY_MHZ, off_deg: float = 0.0
) -> tuple[pd.DataFrame, DirectionTerms]:
    """Directions that point at the spiral, turned by an angle."""
    parts = []
    for name in names:
        x, y, _ = (source_rsun(frequency_mhz) - np.array(PLACES[name])).T
        place = dict(zip(("x_rsun", "y_rsun", "z_rsun"), PLACES[name], strict=True))
        parts.append(
            pd.DataFrame(
                {"frequency_mhz": frequency_mhz, "longitude_deg": np.degrees(np.arctan2(y, x)) + off_deg}
            ).assign(observatory=name, latitude_deg=0.0, sigma_deg=2.0, **place)
        )
    table = check_directions(pd.concat(parts, ignore_index=True))
    return table, direction_terms(table, table.iloc[:0], EPOCH, 3.0)


def test_lines_cross_at_the_source() -> None:
    rows = triangulation_companion(directions()[1])["rows"]
    assert len(rows) == 5
    x, y, _ = source_rsun(np.array([row["frequency_mhz"] for row in rows])).T
    np.testing.assert_allclose([row["range_rsun"] for row in rows], np.hypot(x, y), rtol=0.07)
    np.testing.assert_allclose([row["longitude_deg"] for row in rows], np.degrees(np.arctan2(y, x)), atol=4.0)
    assert all(row["flags"] == [] and row["observatories"] == ["A", "B"] for row in rows)
    assert all(row["miss_rsun"] < 1e-6 and 0 < row["range_sd_rsun"] < 40 for row in rows)


def test_the_distance_scatters_as_stated() -> None:
    """Directions of 2 degrees of their own and 3 that are shared, of which one spacecraft has one each."""
    terms = directions(frequency_mhz=np.array([0.3]))[1]
    rng, found = np.random.default_rng(1), []
    for _ in range(400):
        turn = np.radians(np.hypot(2.0, 3.0)) * rng.standard_normal(2)
        x, y, z = terms.towards.T
        turned = np.stack([x * np.cos(turn) - y * np.sin(turn), x * np.sin(turn) + y * np.cos(turn), z], axis=1)
        found += triangulation_companion(replace(terms, towards=turned))["rows"]
    scatter = np.std([row["range_rsun"] for row in found])
    assert scatter == pytest.approx(np.median([row["range_sd_rsun"] for row in found]), rel=0.15)


def test_three_lines_that_agree_place_a_source_better_than_two() -> None:
    two, three = (triangulation_companion(directions(names)[1])["rows"] for names in (("A", "B"), ("A", "B", "C")))
    assert all(b["range_sd_rsun"] < a["range_sd_rsun"] for a, b in zip(two, three, strict=True))


def test_spacecraft_need_frequencies_near_one_another() -> None:
    with pytest.raises(InputError, match="no two spacecraft"):
        triangulation_companion(directions(("A",))[1])
    apart = [directions((name,), FREQUENCY_MHZ * factor) for name, factor in (("A", 1.0), ("B", 100.0))]
    table = pd.concat([one for one, _ in apart], ignore_index=True)
    with pytest.raises(InputError, match="no two spacecraft"):
        triangulation_companion(direction_terms(table, table.iloc[:0], EPOCH))
    with pytest.raises(InputError, match="no wave directions"):
        triangulation_companion(None)


def test_lines_that_cannot_cross_have_flags_and_no_numbers() -> None:
    """Both spacecraft look along the line between them."""
    frequency = np.geomspace(0.2, 2.0, 6)
    table = pd.concat(
        [
            pd.DataFrame({"frequency_mhz": frequency, "observatory": name, "longitude_deg": longitude}).assign(
                latitude_deg=0.0, sigma_deg=2.0, x_rsun=x, y_rsun=0.0, z_rsun=0.0
            )
            for name, longitude, x in (("A", 180.0, 215.0), ("B", 0.0, -215.0))
        ],
        ignore_index=True,
    )
    checked = check_directions(table)
    rows = triangulation_companion(direction_terms(checked, checked.iloc[:0], EPOCH))["rows"]
    assert all(row["flags"] == ["parallel_lines"] and row["range_rsun"] is None for row in rows)


def test_lines_that_never_cross_are_ready_for_json() -> None:
    table, terms = directions()
    ahead = np.tile([1.0, 0.0, 0.0], (len(table), 1))
    rows = triangulation_companion(replace(terms, towards=ahead))["rows"]
    assert all(row["flags"] == ["parallel_lines"] and row["range_rsun"] is None for row in rows)
    json.dumps(rows, allow_nan=False)
