"""The main job, as a process: what it prints, what it leaves, and that a second run changes nothing."""

import json
import math
import os
import shutil
import sqlite3
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from subprocess import CompletedProcess

import numpy as np
import pytest
from fastapi.testclient import TestClient

from api.app import create_app
from bella.catalogue import Catalogue
from bella.settings import Settings
from tests.commands import Sandbox
from tests.conftest import REFERENCE_FILES
from tests.solar_wind.in_situ import lists_of

BURST = "T3-20120607-1929"
FirstRun = tuple[Sandbox, "CompletedProcess[str]"]
KILLED = """
import os, signal, sys
import bella.pipeline.publication as publication
from bella.cli import main

place = publication.place_group


def placed_then_killed(staged, root, name):
    path = place(staged, root, name)
    if "posterior" in name:
        os.kill(os.getpid(), signal.SIGKILL)
    return path


publication.place_group = placed_then_killed
sys.argv = ["bella", "run", "--preset", "bella-2024"]
main()
"""


DRAWS = "500"
a_second_preset = pytest.mark.acceptance
"""The whole event once more; its published track and runs that are killed are tested without it, too."""


@dataclass(frozen=True)
class AsPublished:
    """A home with the errors and the speed of the paper's code too.

    After a run that was killed came two without Prefect that began at once.
    """

    before: Sandbox
    killed: "CompletedProcess[str]"
    rows_after_kill: dict[str, list[tuple[object, ...]]]
    groups_after_kill: list[str]
    sandbox: Sandbox
    both: tuple["CompletedProcess[str]", ...]

    @property
    def done(self) -> "CompletedProcess[str]":
        """The run that published; where the other came after it, that one had nothing to do."""
        return next(one for one in self.both if one.returncode == 0 and '"new": true' in one.stdout)


@pytest.fixture(scope="module")
def variables(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Few draws, and a folder with the measured wind where the reference files are here."""
    folder = tmp_path_factory.mktemp("in-situ")
    if REFERENCE_FILES.is_dir():
        lists_of(folder, REFERENCE_FILES)
    return {"BELLA_IN_SITU": str(folder), "BELLA_DRAWS": DRAWS}


@pytest.fixture(scope="module")
def first_run(tmp_path_factory: pytest.TempPathFactory, variables: dict[str, str]) -> FirstRun:
    """The built-in event, run once with Prefect by a user who has nothing yet but the wind."""
    sandbox = Sandbox.within(tmp_path_factory.mktemp("first"), **variables)
    return sandbox, sandbox.bella("run")


@pytest.fixture(scope="module")
def as_published(first_run: FirstRun, tmp_path_factory: pytest.TempPathFactory) -> AsPublished:
    """After the default preset, the one of the paper's code, in a copy of the home."""
    before, sandbox = first_run[0], Sandbox.within(tmp_path_factory.mktemp("published"), BELLA_DRAWS=DRAWS)
    shutil.copytree(before.home, sandbox.home)
    killed = sandbox.run(sys.executable, "-c", KILLED, code=None)
    rows, groups = rows_of(sandbox), groups_of(sandbox)
    command = ("run", "--direct", "--preset", "bella-2024", "--json")
    with ThreadPoolExecutor(2) as pool:
        waiting = [pool.submit(sandbox.bella, *command, code=None) for _ in range(2)]
    return AsPublished(before, killed, rows, groups, sandbox, tuple(one.result() for one in waiting))


def catalogue_of(sandbox: Sandbox) -> Catalogue:
    return Catalogue.open(f"sqlite:///{sandbox.home / 'catalogue.sqlite'}")


def rows_of(sandbox: Sandbox) -> dict[str, list[tuple[object, ...]]]:
    """Every row of every table that holds results."""
    tables = ("burst", "solution", "localisation", "track_fit", "source_file", "preference")
    with closing(sqlite3.connect(sandbox.home / "catalogue.sqlite")) as database:
        return {name: database.execute(f"select * from {name} order by 1, 2").fetchall() for name in tables}


def groups_of(sandbox: Sandbox) -> list[str]:
    return sorted(str(path.relative_to(sandbox.home)) for path in (sandbox.home / "store" / BURST).iterdir())


def test_summary_says_what_was_found(first_run: FirstRun) -> None:
    _, done = first_run
    for word in (BURST, "gauss_hermite", "half_maximum", "n.c. (1.00)", "24.47", "25.38", "4 new solutions"):
        assert word in done.stdout, done.stdout
    assert "±" not in done.stdout
    assert "Traceback" not in done.stdout + done.stderr
    assert "localise" in done.stderr, "progress is shown on standard error"


def test_answer_is_the_same_in_run_list_show_and_api(first_run: FirstRun) -> None:
    sandbox, done = first_run
    with closing(catalogue_of(sandbox)) as catalogue:
        preferred = catalogue.burst(BURST).preferred
    assert preferred is not None
    assert (preferred.series.edge, preferred.series.preset) == ("shared_profile", "default")
    sentence = preferred.answer.sentence
    assert done.stdout.splitlines()[-1].startswith(f"{BURST}: {sentence} (shared_profile/posterior/default/2d, ")
    shown = sandbox.here("catalogue", "show", BURST).stdout.splitlines()
    assert shown[-1] == done.stdout.splitlines()[-1]
    listed = json.loads(sandbox.here("catalogue", "list", "--json").stdout)
    assert [one["answer"]["sentence"] for one in listed] == [sentence]
    with TestClient(create_app(Settings(home=sandbox.home, database_url=None))) as client:
        assert client.get(f"/api/v1/bursts/{BURST}/track").json()["sentence"] == sentence
        assert sentence in client.get(f"/bursts/{BURST}").text


@a_second_preset
def test_published_result_is_reproduced(as_published: AsPublished) -> None:
    """Canizares et al. (2024): 10-150 solar radii, phi0 30 +- 2 deg, v_sw 400 +- 20 km/s."""
    with closing(catalogue_of(as_published.sandbox)) as catalogue:
        solution = next(
            one
            for one in catalogue.versions(BURST)
            if (one.series.edge, one.series.preset) == ("gauss_hermite", "bella-2024")
        )
        track = catalogue.track_fit(solution.solution_id)
        rows = catalogue.localisations(solution.solution_id)
    radii = [math.hypot(row.x_rsun, row.y_rsun) for row in rows]
    assert len(rows) == 200
    assert (rows[0].frequency_mhz, rows[-1].frequency_mhz) == pytest.approx((0.15, 2.0))
    assert min(radii) == pytest.approx(12, abs=1.5)
    assert max(radii) == pytest.approx(152, abs=3)
    assert track["rotation_period_d"] == 24.47
    assert track["two_step"]["phi0_deg"]["mean"] == pytest.approx(30, abs=2)
    assert track["two_step"]["v_sw_km_s"]["mean"] == pytest.approx(400, abs=20)
    sidereal = track["two_step_other_rotations"]["25.38"]["v_sw_km_s"]["mean"]
    assert sidereal == pytest.approx(track["two_step"]["v_sw_km_s"]["mean"] * 24.47 / 25.38)
    assert {row.flags for row in rows} == {"speed_not_constrained"}
    assert all(row.contraction_v > 0.99 for row in rows)


@a_second_preset
def test_joint_fit_agrees_with_the_paper_and_has_honest_errors(as_published: AsPublished) -> None:
    with closing(catalogue_of(as_published.sandbox)) as catalogue:
        found = [one for one in catalogue.versions(BURST) if one.series.preset == "bella-2024"]
        tracks = {one.series.edge: catalogue.track_fit(one.solution_id) for one in found}
        flags = {one.series.edge: one.flags for one in found}
    joint = tracks["gauss_hermite"]["joint"]
    for name, published in tracks["gauss_hermite"]["published"].items():
        if name in {"phi0_deg", "v_sw_km_s"}:
            assert abs(joint[name]["mean"] - published["mean"]) < joint[name]["sd"]
            assert joint[name]["sd"] > 5 * tracks["gauss_hermite"]["two_step"][name]["sd"]
    assert "not_a_spiral" in flags["half_maximum"], "without a directional delay"
    assert "not_a_spiral" not in flags["gauss_hermite"]
    assert "errors_too_large" in flags["gauss_hermite"], "30 s for points on a smooth curve"
    for track in tracks.values():
        assert {name for name, one in track["companions"].items() if "not_computed" in one["flags"]} == {
            "wind",
            "triangulation",
            "fused",
        }


def test_edge_definition_changes_the_track(first_run: FirstRun) -> None:
    sandbox, _ = first_run
    with closing(catalogue_of(sandbox)) as catalogue:
        spread = {
            one.series.edge: np.ptp(
                [math.degrees(math.atan2(row.y_rsun, row.x_rsun)) for row in catalogue.localisations(one.solution_id)]
            )
            for one in catalogue.versions(BURST)
        }
    assert spread["gauss_hermite"] > 30
    assert spread["half_maximum"] < 20


def test_figures_are_pictures(first_run: FirstRun) -> None:
    sandbox, done = first_run
    profile = "shared-profile-shared_profile.posterior.default.2d.v1"
    for name in ("constellation-posterior-default.svg", "spectra.svg", f"{profile}.svg"):
        path = sandbox.home / "figures" / BURST / name
        assert str(path) in done.stdout
        assert path.read_bytes().startswith(b"<svg ")


def test_nothing_is_written_outside_the_home_folder(first_run: FirstRun) -> None:
    sandbox, _ = first_run
    assert sandbox.files_elsewhere() == []


def test_embedded_server_ends_with_the_command(first_run: FirstRun) -> None:
    sandbox, _ = first_run
    assert (sandbox.home / "prefect" / "prefect.db").stat().st_size > 0
    running = [path for path in Path("/proc").glob("[0-9]*/environ") if str(sandbox.home) in _environment(path)]
    assert running == []


def _environment(path: Path) -> str:
    try:
        return path.read_text(errors="replace")
    except OSError:
        return ""


def test_logs_carry_burst_and_run(first_run: FirstRun) -> None:
    sandbox, _ = first_run
    lines = [json.loads(line) for line in (sandbox.home / "logs" / "bella.log").read_text().splitlines()]
    published = [line for line in lines if line["event"] == "published"]
    assert {line["edge"] for line in published} == {"gauss_hermite", "half_maximum", "half_rise", "shared_profile"}
    assert {line["burst_id"] for line in published} == {BURST}
    of_runs = [line for line in lines if line["event"] != "catalogue upgraded"]  # which comes before there is a run
    assert len({line["run_id"] for line in of_runs}) == 1


def test_second_run_changes_nothing_and_draws_what_a_killed_run_did_not(first_run: FirstRun) -> None:
    sandbox, _ = first_run
    before, groups = rows_of(sandbox), groups_of(sandbox)
    constellation, spectra = (
        sandbox.home / "figures" / BURST / name for name in ("constellation-posterior-default.svg", "spectra.svg")
    )
    spectra.unlink()
    os.utime(constellation, (0, 0))
    done = sandbox.here("run", "--direct", "--json")
    assert [row["new"] for row in json.loads(done.stdout)] == [False] * 4
    assert rows_of(sandbox) == before
    assert groups_of(sandbox) == groups
    assert spectra.is_file()
    assert constellation.stat().st_mtime > 0


@a_second_preset
def test_killed_run_leaves_nothing_visible(as_published: AsPublished) -> None:
    """Killed after a posterior has its final name, before the commit that would make it visible."""
    assert as_published.killed.returncode == -9, as_published.killed.stderr
    (left,) = set(as_published.groups_after_kill) - set(groups_of(as_published.before))
    assert "posterior" in left
    assert as_published.rows_after_kill == rows_of(as_published.before)


@a_second_preset
def test_run_after_a_killed_one_finishes_another_series_and_leaves_the_answer_as_it_was(
    as_published: AsPublished,
) -> None:
    was, now = as_published.before, as_published.sandbox
    rows = json.loads(as_published.done.stdout)
    assert [(row["new"], row["preferred"]) for row in rows] == [(True, False)] * 4
    figures, kept = (one.home / "figures" / BURST for one in (now, was))
    ours = (kept / "constellation-posterior-default.svg").read_bytes()
    assert (figures / "constellation-posterior-bella-2024.svg").read_bytes() != ours
    assert (figures / "constellation-posterior-default.svg").read_bytes() == ours
    before, after = rows_of(was), rows_of(now)
    assert set(before["solution"]) < set(after["solution"])
    assert after["preference"] == before["preference"]
    (answer,), (same,) = (json.loads(one.here("catalogue", "list", "--json").stdout) for one in (was, now))
    assert same | {"solutions": []} == answer | {"solutions": []}
    with closing(catalogue_of(now)) as catalogue:
        found = catalogue.versions(BURST)
    assert sorted((one.series.preset, one.series.edge, one.version) for one in found) == [
        (preset, edge, 1)
        for preset in ("bella-2024", "default")
        for edge in ("gauss_hermite", "half_maximum", "half_rise", "shared_profile")
    ]


@a_second_preset
def test_two_runs_at_once_end_with_one_result(as_published: AsPublished) -> None:
    assert 0 in {one.returncode for one in as_published.both}
    for one in as_published.both:
        assert one.returncode == 0 or (one.returncode == 1 and "is being done by" in one.stderr), one.stderr
        assert "Traceback" not in one.stderr


def test_measured_wind_reaches_the_solution_and_its_figure(first_run: FirstRun, reference_files: Path) -> None:
    sandbox, _ = first_run
    with closing(catalogue_of(sandbox)) as catalogue:
        solution = next(one for one in catalogue.versions(BURST) if one.series.edge == "gauss_hermite")
        track = catalogue.track_fit(solution.solution_id)
    rmse = {one["observatory"]: one["rmse_km_s"] for one in track["companions"]["wind"]["observatories"]}
    assert rmse == pytest.approx({"WIND": 64, "STEREO-A": 127, "STEREO-B": 124}, abs=5)
    assert Settings(home=sandbox.home).solution_figure(BURST, solution.solution_id, "wind").is_file()
    assert "set BELLA_REGIONS" in track["companions"]["footpoint"]["regions"]["reason"]


def test_damage_in_the_store_is_named(first_run: FirstRun, tmp_path: Path) -> None:
    sandbox = Sandbox.within(tmp_path)
    shutil.copytree(first_run[0].home, sandbox.home)
    assert "5 groups" in sandbox.here("store", "verify").stdout
    with closing(catalogue_of(sandbox)) as catalogue:
        posterior, *_ = (one.store_path for one in catalogue.stored_groups() if one.sha256)
        (spectra,) = (one.store_path for one in catalogue.stored_groups() if one.sha256 is None)
    chunk = sandbox.home / "store" / posterior
    content = bytearray(chunk.read_bytes())
    content[len(content) // 2] ^= 0xFF
    chunk.chmod(0o644)
    chunk.write_bytes(content)
    (sandbox.home / "store" / spectra).unlink()

    done = sandbox.here("store", "verify", "--json", code=1)

    found = json.loads(done.stdout)
    assert {row["store_path"] for row in found["damaged"]} == {posterior, spectra}
    assert found["groups"] == 5
    assert posterior in done.stderr
    assert "2 of 5 groups are damaged" in done.stderr


def test_catalogue_and_status_tell_of_the_run(first_run: FirstRun) -> None:
    sandbox, _ = first_run
    listed = json.loads(sandbox.here("catalogue", "list", "--json").stdout)
    assert [row["burst_id"] for row in listed] == [BURST]
    status = json.loads(sandbox.here("status", "--json").stdout)
    assert {(run["subject"], run["state"]) for run in status["runs"]} == {(BURST, "done"), ("store", "done")}
    assert status["waiting"] == 0
    shown = sandbox.here("catalogue", "show", BURST).stdout
    assert "v_sw, km/s" in shown
    assert "gauss_hermite" in shown
    unknown = sandbox.here("catalogue", "show", "T3-19990101-0000", code=1)
    assert unknown.stderr.startswith("bella: ")
    assert unknown.stderr.count("\n") == 1


COMPLAINT = """
from bella.settings import Settings
from bella.pipeline.workers import prepare

prepare(Settings())
import logging
import prefect

prefect.get_client
logging.getLogger("prefect._internal.concurrency").error("an event was cut short")
"""


def test_what_prefect_says_to_itself_stays_unsaid(sandbox: Sandbox) -> None:
    done = sandbox.run(sys.executable, "-c", COMPLAINT)
    assert done.stderr == ""
