"""Wind and Sun around a burst in a run: what the folders hold reaches its solution; new files make a new version."""

import os
import shutil
from contextlib import closing
from dataclasses import replace
from datetime import UTC, date, datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from bella.arrivals import locate_receivers
from bella.bursts import half_maximum_arrivals
from bella.catalogue import Catalogue, Series, Solution
from bella.multilateration import localise
from bella.pipeline.day_files import DayFiles, with_surroundings
from bella.pipeline.publication import Draft, inputs_hash, publish
from bella.pipeline.surroundings import day_digest, has_wind, surroundings_of, wind_drawn
from bella.pipeline.tracks import Timing
from bella.records import MeasuredWind
from bella.settings import Settings
from tests.pipeline.examples import built_in_event, whole_track
from tests.plotting.reading import of_class, parsed
from tests.solar_wind.test_context import HOLES, SUMMARY
from tests.solar_wind.test_folder import hours

SERIES = Series("half_maximum", "posterior", "default", 2)
START = datetime(2012, 6, 7, 19, 20, tzinfo=UTC)
TIMING = Timing(half_maximum_arrivals(np.array([0.5])))
"""Arrival times that stay the same."""


def folders(below: Path) -> Settings:
    """Folders with three lists of one speed each, and the regions of the day."""
    found = Settings(home=below / "home", draws=200, in_situ=below / "in-situ", regions=below / "regions")
    for name, speed in (("omni", 480.0), ("sta", 400.0), ("stb", 400.0)):
        hours(below / "in-situ" / f"{name}.lst", speed)
    (below / "regions").mkdir()
    (below / "regions" / "20120608SRS.txt").write_text(SUMMARY)
    (below / "regions" / "coronal-holes-20120607T1200.csv").write_text(HOLES)
    return found


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    return folders(tmp_path)


@pytest.fixture(scope="module")
def localised() -> tuple[pd.DataFrame, xr.Dataset]:
    arrivals = locate_receivers(half_maximum_arrivals(np.geomspace(0.15, 2.0, 12)))
    return arrivals, localise(arrivals, draws=200)


Published = tuple[Solution, dict[str, Any], bool]


def published(localised: tuple[pd.DataFrame, xr.Dataset], settings: Settings) -> Published:
    """Publish the burst as a run does, unless the same inputs were published; and whether it is new."""
    arrivals, posterior = localised
    given, around = built_in_event(), surroundings_of(START, settings)
    sources, checksum = (*given.sources, *around.sources()), checksum_of(localised, settings)
    with closing(Catalogue.open(settings.catalogue_url, create=True)) as catalogue:
        same = catalogue.find_solution(given.burst.burst_id, SERIES, checksum, "0.2.0")
        if same is not None:
            return same, catalogue.track_fit(same.solution_id), False
        track, fitted = whole_track(posterior, Timing(arrivals, compared=False), SERIES, settings, around)
        draft = Draft(given.burst, SERIES, checksum, fitted.drawn, track, sources)
        solution = publish(draft, catalogue, settings)
        assert catalogue.sources(solution.solution_id) == sources
        return solution, catalogue.track_fit(solution.solution_id), True


def checksum_of(localised: tuple[pd.DataFrame, xr.Dataset], settings: Settings) -> str:
    sources = (*built_in_event().sources, *surroundings_of(START, settings).sources())
    return inputs_hash(Timing(localised[0]), sources, SERIES, settings)


@pytest.fixture(scope="module")
def first(
    localised: tuple[pd.DataFrame, xr.Dataset], tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, Solution, dict[str, Any]]:
    """Folders, in whose home the burst is published, and what was."""
    root = tmp_path_factory.mktemp("published")
    solution, track, new = published(localised, folders(root))
    assert new
    return root, solution, track


def test_wind_and_regions_reach_the_solution_and_its_figure(
    localised: tuple[pd.DataFrame, xr.Dataset], first: tuple[Path, Solution, dict[str, Any]]
) -> None:
    root, _, track = first

    wind, foot = track["companions"]["wind"], track["companions"]["footpoint"]
    assert [one["measured_km_s"] for one in wind["observatories"]] == [400.0, 400.0, 480.0]
    for one in wind["observatories"]:
        assert one["v_sw_km_s"]["mean"] == pytest.approx(one["measured_km_s"], rel=0.05)
    assert set(wind["measured"]) == {"fundamental", "harmonic"}
    for one in wind["measured"].values():
        speed, sd = MeasuredWind.model_validate(one).to(100.0)
        assert 330 < speed < 480
        assert 20 < sd < 80
    assert {one["observatory"]: one["v_sw_km_s"] for one in foot["connections"]}["WIND"] == 480.0
    assert {row["name"] for row in foot["regions"]["rows"]} >= {"CH1", "11494"}
    assert has_wind(track)
    around = surroundings_of(START, Settings(in_situ=root / "in-situ", regions=root / "regions"))
    figure = parsed(wind_drawn(localised[1], track, around))
    assert [len(of_class(figure, name)) for name in ("track", "fitted-spiral", "band")] == [1, 1, 1]


def test_new_wind_makes_a_new_version_and_the_same_wind_does_not(
    localised: tuple[pd.DataFrame, xr.Dataset], first: tuple[Path, Solution, dict[str, Any]], tmp_path: Path
) -> None:
    root = tmp_path / "copy"
    shutil.copytree(first[0], root)
    settings = Settings(home=root / "home", draws=200, in_situ=root / "in-situ", regions=root / "regions")
    assert published(localised, settings)[::2] == (first[1], False)
    hours(root / "in-situ" / "omni_newer.lst", 520.0)
    second, track, new = published(localised, settings)
    assert new
    assert (first[1].version, second.version) == (1, 2)
    assert track["companions"]["wind"]["observatories"][2]["measured_km_s"] == 520.0
    (root / "regions" / "20120608SRS.txt").write_text(SUMMARY.replace("N15W36", "N15W37"))
    assert checksum_of(localised, settings) not in {first[1].inputs_hash, second.inputs_hash}


def test_a_list_that_grows_by_a_day_makes_few_versions(settings: Settings) -> None:
    """Those of the day after, then by five days, and the last one with the rotation; later hours change nothing."""
    day, seen, of_days = START.date(), [], []
    for after_d in range(1, 20):
        hours(settings.home.parent / "in-situ" / "omni.lst", 480.0, (day - date(2012, 5, 1)).days + after_d)
        seen.append(inputs_hash(TIMING, surroundings_of(START, settings).sources(), SERIES, settings))
        of_days.append(day_digest(day, settings))
    changes = [after_d for after_d, (one, other) in enumerate(pairwise(seen), 2) if one != other]
    assert changes == [2, 7, 12, 15]
    days = [after_d for after_d, (one, other) in enumerate(pairwise(of_days), 2) if one != other]
    assert days == [2, 7, 12, 15], "the day is looked at again when a burst of it may change, and not before that"


def test_wind_that_differs_where_a_burst_does_not_use_it_makes_no_version(settings: Settings) -> None:
    path = settings.home.parent / "in-situ" / "omni.lst"

    def checksum(number: str, speed: str) -> str:
        lines = path.read_text().splitlines()
        changed = [f"2012 {number} 5 {speed}" if line.startswith(f"2012 {number} 5 ") else line for line in lines]
        path.write_text("".join(f"{line}\n" for line in changed))
        return inputs_hash(TIMING, surroundings_of(START, settings).sources(), SERIES, settings)

    before = checksum("200", "480")
    assert checksum("144", "999") == before, "14.6 days before"
    assert checksum("174", "999") == before, "14.4 days after"
    inside = checksum("146", "999"), checksum("172", "999")
    assert len({before, *inside}) == 3


def test_nothing_measured_is_said_and_stops_nothing(
    localised: tuple[pd.DataFrame, xr.Dataset], settings: Settings, tmp_path: Path
) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "damaged").mkdir()
    (tmp_path / "damaged" / "omni.lst").write_bytes(b"\x89PNG\r\n\x1a\n\x00\xff")
    (tmp_path / "damaged" / "20120608SRS.txt").write_bytes(b"\x00\xff")
    reasons = {
        "empty": "add hourly lists",
        "nowhere": "name it in BELLA_IN_SITU",
        "damaged": "left out: omni.lst cannot be read",
    }
    for name, reason in reasons.items():
        poor = settings.model_copy(update={"in_situ": tmp_path / name, "regions": tmp_path / name})
        around = surroundings_of(START, poor)
        assert around.sources() == ()
        track, _ = whole_track(localised[1], Timing(localised[0], compared=False), SERIES, poor, around)
        wind, foot = track["companions"]["wind"], track["companions"]["footpoint"]
        assert wind == {"flags": ["not_computed"], "reason": wind["reason"]}
        assert reason in wind["reason"]
        assert foot["regions"]["flags"] == ["not_computed"]
        assert not any(one["measured"] for one in foot["connections"])
        assert not has_wind(track)


def test_too_few_hours_are_no_wind(localised: tuple[pd.DataFrame, xr.Dataset], tmp_path: Path) -> None:
    (tmp_path / "omni.lst").write_text("2012 159 19 649\n")
    around = surroundings_of(START, Settings(in_situ=tmp_path))
    track, _ = whole_track(localised[1], Timing(localised[0], compared=False), SERIES, Settings(draws=200), around)
    assert "at least 24 are needed" in track["companions"]["wind"]["reason"]
    assert track["companions"]["footpoint"]["connections"][0]["v_sw_km_s"] == 649.0


def test_a_day_is_done_again_when_its_wind_is_new(settings: Settings, tmp_path: Path) -> None:
    files = DayFiles(date(2012, 6, 7), (), (), "0" * 64)
    nothing = Settings(home=tmp_path)
    assert with_surroundings(files, nothing) == files
    before = with_surroundings(files, settings).inputs_hash
    assert before != files.inputs_hash
    later = replace(files, day=date(2012, 10, 1))
    assert with_surroundings(later, settings).inputs_hash == later.inputs_hash, "nothing is known of October"
    hours(tmp_path / "in-situ" / "wind-2.lst", 300.0)
    assert with_surroundings(files, settings).inputs_hash != before


def test_a_day_has_a_checksum_whatever_is_in_its_folders(settings: Settings) -> None:
    day = date(2012, 6, 7)
    before = day_digest(day, settings)
    os.mkfifo(settings.home.parent / "regions" / "20120607SRS.txt")
    assert len({before, day_digest(day, settings), ""}) == 3
