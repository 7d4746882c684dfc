"""Sources where wave directions cross, and the fit that takes them in."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from bella.tracks.joint_directions import DirectionTerms

from bella.exceptions import InputError
from bella.heliosphere import spiral_position_rsun
from bella.tracks import Ingredients, JointModel, JointOptions, check_directions, direction_terms
from bella.tracks.direction_companions import fused_companion, triangulation_companion
from tests.tracks.bursts import FREQUENCY_MHZ, simulated, standard

EPOCH = np.datetime64("2012-06-07T19:00", "ns")
PHI0_DEG, WIND_KM_S, ROTATION_D = 30.0, 400.0, 25.38
PLACES = {"A": (215.0, 0.0, 0.0), "B": (-97.0, 192.0, 0.0), "C": (-97.0, -192.0, 0.0)}


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


def test_directions_that_agree_narrow_the_joint_fit_and_those_that_do_not_are_told() -> None:
    grid = simulated(standard(JointModel(), PHI0_DEG, WIND_KM_S), JointModel(), np.random.default_rng(4))
    said = {}
    for off_deg in (0.0, 40.0):
        known = Ingredients(grid, 0.0, directions(frequency_mhz=FREQUENCY_MHZ[::4], off_deg=off_deg)[1])
        said[off_deg] = fused_companion(known, ROTATION_D, JointOptions(draws=1000))
    by_name = {one["name"]: one for one in said[0.0]["ingredients"]}
    assert by_name["wave_directions"]["sd_ratio"]["phi0_deg"] < 0.97
    assert "ingredients_disagree" not in said[0.0]["flags"]
    assert "ingredients_disagree" in said[40.0]["flags"]
    with pytest.raises(InputError, match="neither wave directions nor a measured wind"):
        fused_companion(Ingredients(grid, 0.0), ROTATION_D, JointOptions())


def test_lines_that_never_cross_are_ready_for_json() -> None:
    table, terms = directions()
    ahead = np.tile([1.0, 0.0, 0.0], (len(table), 1))
    rows = triangulation_companion(replace(terms, towards=ahead))["rows"]
    assert all(row["flags"] == ["parallel_lines"] and row["range_rsun"] is None for row in rows)
    json.dumps(rows, allow_nan=False)
