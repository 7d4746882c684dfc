"""The main job, as a process: what it prints, what it leaves, and that a second run changes nothing."""

import json
import math
import os
import shutil
import sqlite3
import struct
import subprocess
import sys
from contextlib import closing
from pathlib import Path
from subprocess import CompletedProcess

import numpy as np
import pytest
from fastapi.testclient import TestClient

from api.app import create_app
from bella.catalogue import Catalogue
from bella.settings import Settings
from tests.commands import BELLA, TIMEOUT_S, Sandbox

BURST = "T3-20120607-1929"
FirstRun = tuple[Sandbox, "CompletedProcess[str]"]


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
    shown = sandbox.bella("catalogue", "show", BURST).stdout.splitlines()
    assert shown[-1] == done.stdout.splitlines()[-1]
    listed = json.loads(sandbox.bella("catalogue", "list", "--json").stdout)
    assert [one["answer"]["sentence"] for one in listed] == [sentence]
    with TestClient(create_app(Settings(home=sandbox.home, database_url=None))) as client:
        assert client.get(f"/api/v1/bursts/{BURST}/track").json()["sentence"] == sentence
        assert sentence in client.get(f"/bursts/{BURST}").text


def test_published_result_is_reproduced(run_as_published: Sandbox) -> None:
    """Canizares et al. (2024): 10-150 solar radii, phi0 30 +- 2 deg, v_sw 400 +- 20 km/s."""
    with closing(catalogue_of(run_as_published)) as catalogue:
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


def test_joint_fit_agrees_with_the_paper_and_has_honest_errors(run_as_published: Sandbox) -> None:
    with closing(catalogue_of(run_as_published)) as catalogue:
        found = [one for one in catalogue.versions(BURST) if one.series.preset == "bella-2024"]
        tracks = {one.series.edge: catalogue.track_fit(one.solution_id) for one in found}
        flags = {one.series.edge: one.flags for one in found}
    joint = tracks["gauss_hermite"]["joint"]
    for name, published in tracks["gauss_hermite"]["published"].items():
        if name in {"phi0_deg", "v_sw_km_s"}:
            assert abs(joint[name]["mean"] - published["mean"]) < joint[name]["sd"]
            assert joint[name]["sd"] > 5 * tracks["gauss_hermite"]["two_step"][name]["sd"]
    assert "not_a_spiral" in flags["half_maximum"]
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
    series = [
        f"{edge}.posterior.default.2d.v1" for edge in ("gauss_hermite", "half_maximum", "half_rise", "shared_profile")
    ]
    fits = [f"{name}-{one}.png" for name in ("polar-fit", "density") for one in series]
    profile = "shared-profile-shared_profile.posterior.default.2d.v1.png"
    for name in ("constellation-posterior-default.svg", "spectra.svg", profile, *fits):
        path = sandbox.home / "figures" / BURST / name
        assert str(path) in done.stdout
        content = path.read_bytes()
        if path.suffix == ".svg":
            assert content.startswith(b"<svg ")
            continue
        assert content[:8] == b"\x89PNG\r\n\x1a\n"
        assert min(struct.unpack(">II", content[16:24])) > 500


def test_nothing_is_written_outside_the_home_folder(first_run: FirstRun) -> None:
    sandbox, _ = first_run
    assert sandbox.files_elsewhere() == []


def test_embedded_server_ends_with_the_command(first_run: FirstRun) -> None:
    sandbox, _ = first_run
    assert (sandbox.home / "prefect" / "prefect.db").stat().st_size > 0
    running = [path for path in Path("/proc").glob("[0-9]*/environ") if str(sandbox.home) in _environment(path)]
    assert running == []


def test_without_prefect_the_same_comes_out(first_run: FirstRun, direct_run: FirstRun) -> None:
    """Every row of results but times and names of groups; and the same words."""
    (sandbox, done), (other, alone) = first_run, direct_run
    assert not (other.home / "prefect").exists()
    assert contents(sandbox) == contents(other)
    assert done.stdout.splitlines()[-1] == alone.stdout.splitlines()[-1]


def contents(sandbox: Sandbox) -> dict[str, object]:
    found: dict[str, object] = {}
    with closing(catalogue_of(sandbox)) as catalogue:
        for one in catalogue.versions(BURST):
            key = one.solution_id
            rows, track = catalogue.localisations(key), catalogue.track_fit(key)
            found[key] = (one.inputs_hash, one.store_sha256, one.answer, one.flags, one.preferred, rows, track)
    return found


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
    assert len({line["run_id"] for line in lines}) == 1


def test_second_run_changes_nothing(first_run: FirstRun) -> None:
    sandbox, _ = first_run
    before, groups = rows_of(sandbox), groups_of(sandbox)
    done = sandbox.bella("run", "--direct", "--json")
    assert [row["new"] for row in json.loads(done.stdout)] == [False] * 4
    assert rows_of(sandbox) == before
    assert groups_of(sandbox) == groups


def test_figure_that_a_killed_run_did_not_draw_is_drawn_by_the_next(first_run: FirstRun) -> None:
    sandbox, _ = first_run
    constellation, spectra = (
        sandbox.home / "figures" / BURST / name for name in ("constellation-posterior-default.svg", "spectra.svg")
    )
    spectra.unlink()
    os.utime(constellation, (0, 0))
    sandbox.bella("run", "--direct")
    assert spectra.is_file()
    assert constellation.stat().st_mtime > 0


def test_other_preset_is_another_series_and_leaves_the_answer_as_it_was(direct_run: FirstRun, tmp_path: Path) -> None:
    sandbox = Sandbox.within(tmp_path)
    shutil.copytree(direct_run[0].home, sandbox.home)
    before = rows_of(sandbox)
    answer = sandbox.bella("catalogue", "list", "--json").stdout
    figures = sandbox.home / "figures" / BURST
    kept = (figures / "constellation-posterior-default.svg").read_bytes()
    done = sandbox.bella("run", "--direct", "--preset", "bella-2024", "--json")
    assert (figures / "constellation-posterior-bella-2024.svg").read_bytes() != kept
    assert (figures / "constellation-posterior-default.svg").read_bytes() == kept
    rows = json.loads(done.stdout)
    assert [(row["new"], row["preferred"]) for row in rows] == [(True, False)] * 4
    after = rows_of(sandbox)
    assert set(before["solution"]) < set(after["solution"])
    assert after["preference"] == before["preference"]
    (was,), (now,) = json.loads(answer), json.loads(sandbox.bella("catalogue", "list", "--json").stdout)
    assert now | {"solutions": []} == was | {"solutions": []}
    with closing(catalogue_of(sandbox)) as catalogue:
        assert {one.version for one in catalogue.versions(BURST)} == {1}


def test_killed_run_leaves_nothing_visible_and_the_next_one_finishes(sandbox: Sandbox) -> None:
    """Killed after the first posterior has its final name, before the commit that would make it visible."""
    script = (
        "import os, signal, bella.pipeline.publication as publication\n"
        "place = publication.place_group\n"
        "def placed_then_killed(staged, root, name):\n"
        "    path = place(staged, root, name)\n"
        "    if 'posterior' in name:\n"
        "        os.kill(os.getpid(), signal.SIGKILL)\n"
        "    return path\n"
        "publication.place_group = placed_then_killed\n"
        "import sys; sys.argv = ['bella', 'run']\n"
        "from bella.cli import main; main()\n"
    )
    killed = sandbox.run(str(Path(BELLA).with_name("python")), "-c", script, code=None)
    assert killed.returncode == -9, killed.stderr
    assert len(groups_of(sandbox)) == 2, "spectra and one posterior were in place"
    assert rows_of(sandbox)["solution"] == []
    sandbox.bella("run", "--direct")
    with closing(catalogue_of(sandbox)) as catalogue:
        assert {(one.series.edge, one.version) for one in catalogue.versions(BURST)} == {
            ("gauss_hermite", 1),
            ("half_maximum", 1),
            ("half_rise", 1),
            ("shared_profile", 1),
        }


def test_two_runs_at_once_end_with_one_result(sandbox: Sandbox) -> None:
    command = [BELLA, "run", "--direct"]
    runs = [
        subprocess.Popen(command, env=sandbox.environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        for _ in range(2)
    ]
    ends = [(run.communicate(timeout=TIMEOUT_S)[1].decode(), run.returncode) for run in runs]
    assert 0 in {code for _, code in ends}
    for stderr, code in ends:
        assert code == 0 or (code == 1 and "is being done by" in stderr), stderr
        assert "Traceback" not in stderr
    with closing(catalogue_of(sandbox)) as catalogue:
        assert [one.version for one in catalogue.versions(BURST)] == [1] * 4
        assert [one.series.edge for one in catalogue.versions(BURST) if one.preferred] == ["shared_profile"]


def test_damage_in_the_store_is_named(direct_run: FirstRun, tmp_path: Path) -> None:
    sandbox = Sandbox.within(tmp_path)
    shutil.copytree(direct_run[0].home, sandbox.home)
    assert "5 groups" in sandbox.bella("store", "verify").stdout
    with closing(catalogue_of(sandbox)) as catalogue:
        posterior, *_ = (one.store_path for one in catalogue.stored_groups() if one.sha256)
        (spectra,) = (one.store_path for one in catalogue.stored_groups() if one.sha256 is None)
    chunk = sandbox.home / "store" / posterior / "draws" / "c" / "0" / "0" / "0"
    content = bytearray(chunk.read_bytes())
    content[len(content) // 2] ^= 0xFF
    chunk.chmod(0o644)
    chunk.write_bytes(content)
    shutil.rmtree(sandbox.home / "store" / spectra)

    done = sandbox.bella("store", "verify", "--json", code=1)

    found = json.loads(done.stdout)
    assert {row["store_path"] for row in found["damaged"]} == {posterior, spectra}
    assert found["groups"] == 5
    assert posterior in done.stderr
    assert "2 of 5 groups are damaged" in done.stderr


def test_catalogue_and_status_tell_of_the_run(first_run: FirstRun) -> None:
    sandbox, _ = first_run
    listed = json.loads(sandbox.bella("catalogue", "list", "--json").stdout)
    assert [row["burst_id"] for row in listed] == [BURST]
    status = json.loads(sandbox.bella("status", "--json").stdout)
    assert {(run["subject"], run["state"]) for run in status["runs"]} == {(BURST, "done"), ("store", "done")}
    assert status["waiting"] == 0
    shown = sandbox.bella("catalogue", "show", BURST).stdout
    assert "v_sw, km/s" in shown
    assert "gauss_hermite" in shown
    unknown = sandbox.bella("catalogue", "show", "T3-19990101-0000", code=1)
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
