"""The replay in short: faults leave the catalogue as it is in peace; and what they could break would be noticed."""

import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from benchmarks import replay
from benchmarks.replay import REVISED, Home, Plan, compare, is_clean, lay_out, releases, report, simulate
from tests.waiting import until

TWO = ("WI_H1_WAV", "STA_L3_WAV_LFR", "STA_L3_WAV_HFR")
SHORT = Plan(days=1, kills=2, seed=10, duplicates=2, datasets=TWO, has_revisions=False)
"""Two spacecraft: their preliminary tracks are published in the same way, and take a tenth of the time."""


def test_faults_leave_the_catalogue_as_it_is_in_peace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(replay, "STEP_D", 400)  # all files at once
    steps = releases(SHORT, simulate(tmp_path / "simulated", SHORT))
    assert len(steps) == 1
    homes = []
    for name in ("quiet", "disturbed"):
        lay_out(tmp_path / name / "archive", SHORT.all_days)
        homes.append(Home(tmp_path / name / "bella-home", tmp_path / name / "archive"))
        homes[-1].path.mkdir()
        replay.replay(homes[-1], SHORT, steps, tmp_path / "simulated", quiet=name == "quiet")
    quiet, disturbed = homes
    found = report(quiet, disturbed, SHORT)
    assert is_clean(found), found
    assert found["bursts"] == found["solutions"] == 1
    assert found["faults"]["run killed"] >= 1
    next(disturbed.settings.store_root.glob("*/half_rise*.zarr.zip")).unlink()
    damaged = report(quiet, disturbed, SHORT)
    assert not is_clean(damaged)
    assert len(damaged["half_published"]) == 1


def test_files_appear_in_the_order_of_their_latency_and_are_revised(tmp_path: Path) -> None:
    plan = Plan(days=2, kills=0, seed=1, datasets=("WI_K0_WAV", "STEREO_LEVEL2_SWAVES", REVISED))
    steps = releases(plan, simulate(tmp_path, plan))
    first, *_, last = [{(path.name[:7].lower(), version) for path, version in step} for step in steps]
    assert first == {("wi_k0_w", "v01"), ("stereo_", "v01")}
    assert last == {("solo_l3", "v02")}


@pytest.mark.acceptance
def test_replay_of_days_with_everything(tmp_path: Path) -> None:
    found = compare(Plan(days=2, kills=8, seed=5), tmp_path)
    assert is_clean(found), found


def test_no_run_is_left_where_the_replay_is_stopped(tmp_path: Path) -> None:
    options = ["--days", "1", "--kills", "0", "--dataset", "WI_H1_WAV", "--folder", str(tmp_path)]
    with (tmp_path / "log").open("wb") as log:
        stopped = subprocess.Popen([sys.executable, "-m", "benchmarks.replay", *options], stdout=log, stderr=log)
    until(lambda: _running(f"{tmp_path}/quiet/bella-home"), "a run has begun")
    stopped.send_signal(signal.SIGTERM)
    assert stopped.wait(60) != 0
    assert _running(str(tmp_path)) == []


def _running(name: str) -> list[str]:
    """Command lines of the processes that name it."""
    found = []
    for place in Path("/proc").glob("[0-9]*/cmdline"):
        with suppress(OSError):
            found.append(place.read_bytes().replace(b"\0", b" ").decode(errors="replace"))
    return [one for one in found if name in one]
