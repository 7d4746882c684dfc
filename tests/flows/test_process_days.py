"""Days of the archive, as a process: found, placed near the truth, done again exactly when their files are new."""

import json
import math
import os
import shutil
import signal
import subprocess
import time
from contextlib import closing
from dataclasses import dataclass
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bella.catalogue import Catalogue
from bella.records import Origin
from bella.simulation.archive_days import simulate_days, sky_of
from bella.simulation.burst import source_position_rsun
from tests.commands import BELLA, Sandbox
from tests.plotting.test_fleet import green, height

SIMULATED = (Origin.SIMULATED,)
DAY, SEED = date(2021, 2, 1), 1
DATASETS = (
    "WI_H1_WAV",
    "STEREO_LEVEL2_SWAVES",
    "PSP_FLD_L2_RFS_LFR",
    "PSP_FLD_L2_RFS_HFR",
    "SOLO_L3_RPW-TNR-SURV-FLUX",
    "SOLO_L3_RPW-HFR-SURV-FLUX",
)
START, STOP = datetime(2021, 2, 1, tzinfo=UTC), datetime(2021, 2, 2, tzinfo=UTC)


@pytest.fixture(scope="module")
def archive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("archive")
    simulate_days(root, [DAY], SEED, DATASETS)
    return root


@dataclass
class Processed:
    """A home after one run, and what the run said."""

    sandbox: Sandbox
    archive: Path
    day: dict[str, Any]


def process(sandbox: Sandbox, archive: Path) -> dict[str, Any]:
    done = sandbox.bella("run", "--from", f"{DAY}", "--archive", str(archive), "--json")
    (day,) = json.loads(done.stdout)
    return dict(day)


def catalogue_of(sandbox: Sandbox) -> Catalogue:
    return Catalogue.open(f"sqlite:///{sandbox.home / 'catalogue.sqlite'}")


@pytest.fixture(scope="module")
def processed(archive: Path, tmp_path_factory: pytest.TempPathFactory) -> Processed:
    """The day without PSP, whose data come months later."""
    early = tmp_path_factory.mktemp("early") / "archive"
    shutil.copytree(archive, early)
    shutil.rmtree(early / "pub/data/psp")
    sandbox = Sandbox.within(tmp_path_factory.mktemp("days"))
    return Processed(sandbox, early, process(sandbox, early))


def test_bursts_of_a_day_are_placed_where_they_were(processed: Processed) -> None:
    truths = sky_of(DAY, SEED).bursts
    assert processed.day["state"] == "searched"
    assert set(processed.day["observatories"]) == {"WIND", "STEREO-A", "SOLO"}
    assert processed.day["localised"]
    assert all(name.startswith("SIM-") for name in processed.day["localised"])
    with closing(catalogue_of(processed.sandbox)) as catalogue:
        for name in processed.day["localised"]:
            summary = catalogue.burst(name)
            assert summary.preferred is not None
            assert processed.day["answers"][name] == summary.preferred.answer.sentence
            solution = summary.preferred
            assert solution.series.edge in {"shared_profile", "half_rise"}
            rows = catalogue.localisations(solution.solution_id)
            truth = min(truths, key=lambda one: abs(utc(one.release_utc) - summary.burst.start_utc))
            source = source_position_rsun(truth, np.array([row.frequency_mhz for row in rows]))
            off = [math.hypot(row.x_rsun - x, row.y_rsun - y) for row, (x, y, _) in zip(rows, source, strict=True)]
            assert np.median(off) < 8.0, name
            assert {one.dataset for one in catalogue.sources(solution.solution_id)} <= set(DATASETS)
            joint = catalogue.track_fit(solution.solution_id)["joint"]
            assert joint["times"] > 40
            away = (joint["phi0_deg"]["mean"] - truth.phi0_deg + 180) % 360 - 180
            assert abs(away) < 4 * joint["phi0_deg"]["sd"], name


def utc(moment: np.datetime64) -> datetime:
    return datetime.fromisoformat(str(moment.astype("datetime64[ms]"))).replace(tzinfo=UTC)


def test_every_burst_is_in_the_catalogue_with_its_reason(processed: Processed) -> None:
    with closing(catalogue_of(processed.sandbox)) as catalogue:
        found = catalogue.detections(START, STOP, origins=SIMULATED)
        day = catalogue.searched_day(DAY, SIMULATED)
        assert catalogue.detections(START, STOP) == ()
        assert catalogue.searched_day(DAY) is None
        assert catalogue.bursts().total == 0
        assert catalogue.alerts() == ()
    assert day is not None
    assert set(day.observatories) == {"WIND", "STEREO-A", "SOLO"}
    placed = {one.burst_id for one in found if one.tier == "localisable"}
    assert placed == set(processed.day["localised"])
    for one in found:
        assert (one.reason == "") == (one.tier == "localisable"), one
        assert (one.burst_id == "") == (one.tier == "rejected"), one
    told = {name["burst_id"] for name in processed.day["refused"]}
    assert told == {one.burst_id for one in found if one.tier == "catalogued"}


def test_the_day_is_drawn_and_drawn_again_where_it_was_not(processed: Processed) -> None:
    figure = processed.sandbox.home / "figures" / "days" / f"{DAY}-simulated.png"
    assert [entry.name for entry in figure.parent.iterdir()] == [figure.name]
    assert green(figure) > 0.0, "boxes of bursts that were placed"
    drawn = figure.read_bytes()
    figure.unlink()

    again = process(processed.sandbox, processed.archive)

    assert again["state"] == "nothing new"
    assert figure.read_bytes() == drawn


def test_later_data_refine_the_same_bursts_and_nothing_else_is_done(processed: Processed, archive: Path) -> None:
    sandbox = processed.sandbox
    again = process(sandbox, processed.archive)
    assert (again["state"], again["localised"]) == ("nothing new", [])
    figure = sandbox.home / "figures" / "days" / f"{DAY}-simulated.png"
    three = height(figure)

    refined = process(sandbox, archive)

    assert height(figure) > 1.2 * three, "the new spacecraft has a panel"

    assert set(refined["observatories"]) == {"WIND", "STEREO-A", "SOLO", "PSP"}
    same = set(refined["localised"]) & set(processed.day["localised"])
    assert same, "a burst keeps its name when a spacecraft joins"
    with closing(catalogue_of(sandbox)) as catalogue:
        for name in same:
            versions = [one for one in catalogue.versions(name) if one.series.edge == "half_rise"]
            assert [one.version for one in versions] == [2, 1]
            assert versions[0].supersedes == versions[1].solution_id
            assert "PSP" in catalogue.burst(name).burst.observatories
    assert process(sandbox, archive)["state"] == "nothing new"


def test_a_day_without_files_and_a_damaged_file_are_told_apart(archive: Path, tmp_path: Path) -> None:
    damaged = tmp_path / "archive"
    shutil.copytree(archive, damaged)
    (victim,) = damaged.rglob("stereo_level2*.cdf")
    victim.write_bytes(victim.read_bytes()[:1000])
    sandbox = Sandbox.within(tmp_path / "home")

    done = sandbox.bella("run", "--from", "2021-01-31", "--to", "2021-02-01", "--archive", str(damaged), "--json")

    before, day = json.loads(done.stdout)
    assert before["state"] == "no data"
    assert day["state"] == "searched"
    assert "STEREO-A" not in day["observatories"]


def test_a_run_that_is_killed_leaves_nothing_half_done_and_loses_nothing(archive: Path, tmp_path: Path) -> None:
    sandbox = Sandbox.within(tmp_path)
    command = [BELLA, "run", "--from", f"{DAY}", "--archive", str(archive)]
    victim = subprocess.Popen(command, env=sandbox.environment, cwd=sandbox.elsewhere[0], start_new_session=True)
    store = sandbox.home / "store"
    until = time.monotonic() + 120
    while not (store.is_dir() and any(store.rglob("*.zarr"))) and time.monotonic() < until and victim.poll() is None:
        time.sleep(0.02)
    os.killpg(victim.pid, signal.SIGKILL)
    victim.wait()
    with closing(catalogue_of(sandbox)) as catalogue:
        assert catalogue.searched_day(DAY, SIMULATED) is None

    day = process(sandbox, archive)

    assert day["state"] == "searched"
    with closing(catalogue_of(sandbox)) as catalogue:
        kept = catalogue.referenced_paths()
        for name in day["localised"]:
            assert catalogue.burst(name).solutions
    assert all((store / path).is_dir() for path in kept)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--to", "2021-02-01"), "need a first one"),
        (("--from", "2021-02-02", "--to", "2021-02-01"), "exchange them"),
        (("--from", "2021-02-01", "--archive", "nowhere"), "neither an http(s) URL nor a folder"),
        (("--from", "2021-02-01", "--preset", "best"), "preset"),
    ],
)
def test_bad_options_are_refused_in_one_line(sandbox: Sandbox, arguments: tuple[str, ...], message: str) -> None:
    done = sandbox.bella("run", *arguments, code=2)

    assert message in done.stderr
    assert done.stderr.strip().splitlines()[-1].startswith("bella: ")
    assert "Traceback" not in done.stderr
