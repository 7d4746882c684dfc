"""Days of the archive: localised near the truth, refined under the same id, done again when their files change."""

import json
import math
import os
import shutil
import signal
import subprocess
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from datetime import UTC, date, datetime, timedelta
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fastapi.testclient import TestClient

from api.app import create_app
from bella.bursts.timing import SHARED
from bella.catalogue import BurstQuery, Catalogue, DetectionQuery
from bella.pipeline.day_files import DayFiles, Mirror
from bella.pipeline.draw import Drawn, complete
from bella.pipeline.outcome import OVERTAKEN, DayOutcome, UnfinishedError, check_finished
from bella.pipeline.page_figures import first_look_path, kept_first_look
from bella.pipeline.run import Direct, Run, process_day, process_days
from bella.pipeline.workers import Workers
from bella.records import DayAnswer, Origin
from bella.settings import COLLAPSED_FIGURE, Settings
from bella.simulation.archive_days import write_spectra
from bella.simulation.burst import source_position_rsun
from bella.simulation.day import observe_day
from bella.simulation.instruments import instruments
from benchmarks.detection import FLEET
from tests.bursts.recorded import burst_at, sky
from tests.commands import BELLA, Sandbox
from tests.plotting.test_days import green, height
from tests.waiting import until

DAY, SEED = date(2021, 2, 1), 1
BURSTS = tuple(burst_at(hour, DAY, phi0_deg=phi0) for hour, phi0 in ((4.0, 30.0), (9.0, 45.0)))
"""As few as show what is tested: one is localised in the end, the other is received by two spacecraft alone."""
DATASETS = (
    "WI_H1_WAV",
    "STEREO_LEVEL2_SWAVES",
    "PSP_FLD_L2_RFS_LFR",
    "PSP_FLD_L2_RFS_HFR",
    "SOLO_L3_RPW-TNR-SURV-FLUX",
    "SOLO_L3_RPW-HFR-SURV-FLUX",
)
START, STOP = datetime(2021, 2, 1, tzinfo=UTC), datetime(2021, 2, 2, tzinfo=UTC)


def archive_of(root: Path) -> Path:
    """Archive with the day, of whose bursts the spacecraft whose data come months later see only the first."""
    for number, dataset in enumerate(DATASETS):
        rng = np.random.default_rng([SEED, number])
        what = sky(BURSTS[:1] if dataset.startswith(("PSP", "SOLO")) else BURSTS)
        theirs = [one for one in instruments(dataset, DAY) if one.receiver.observatory in FLEET]
        write_spectra([observe_day(one, [what], DAY, rng) for one in theirs], dataset, DAY, root)
    return root


@pytest.fixture(scope="module")
def archive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return archive_of(tmp_path_factory.mktemp("archive"))


def process(settings: Settings, archive: Path | None, workers: int = 1) -> DayOutcome:
    with Workers(workers, settings) as pool, Direct(1) as executor:
        done = process_days([DAY], None if archive is None else str(archive), Run(settings, "test", pool), executor)
    check_finished(done.outcomes, done.unreachable)
    (day,) = done.outcomes
    return day


@dataclass
class Refined:
    """A home after a run with two spacecraft and one with all, and what they said."""

    settings: Settings
    early: DayOutcome
    early_contents: dict[str, Any]
    again: DayOutcome
    late: DayOutcome
    heights: tuple[float, float]


@pytest.fixture(scope="module")
def two(archive: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The archive without the spacecraft whose data come months later."""
    copy = shutil.copytree(archive, tmp_path_factory.mktemp("two") / "archive")
    shutil.rmtree(copy / "pub/data/psp")
    shutil.rmtree(copy / "pub/data/solar-orbiter")
    return copy


@pytest.fixture(scope="module")
def refined(archive: Path, two: Path, tmp_path_factory: pytest.TempPathFactory) -> Refined:
    """The day first without the spacecraft whose data come months later."""
    settings = Settings(home=tmp_path_factory.mktemp("days"), in_situ=None, regions=None, draws=500)
    early = process(settings, two)
    kept = contents(settings)
    figure = settings.day_figure(DAY, Origin.SIMULATED)
    first = height(figure)
    figure.unlink()
    again = process(settings, None)
    late = process(settings, archive)
    return Refined(settings, early, kept, again, late, (first, height(figure)))


def names(outcomes: tuple[object, ...]) -> set[str]:
    return {one.solution.burst_id for one in outcomes}  # type: ignore[attr-defined]


def test_bursts_of_a_day_are_localised_where_they_were(refined: Refined) -> None:
    assert (refined.late.state, refined.late.answer) == ("searched", "localised")
    assert set(refined.late.observatories) == {"WIND", "STEREO-A", "SOLO", "PSP"}
    assert len(names(refined.late.localised)) == len(names(refined.late.preliminary)) == 1
    with closing(Catalogue.open(refined.settings.catalogue_url)) as catalogue:
        for name in names(refined.late.localised):
            summary = catalogue.burst(name)
            solution = summary.preferred
            assert solution is not None
            assert solution.series.edge in {"shared_profile", "half_rise"}
            if solution.answer.grade == "D":
                continue  # several tracks explain its times, and it says so
            rows = catalogue.localisations(solution.solution_id)
            truth = min(BURSTS, key=lambda one: abs(utc(one.release_utc) - summary.burst.start_utc))
            source = source_position_rsun(truth, np.array([row.frequency_mhz for row in rows]))
            off = [math.hypot(row.x_rsun - x, row.y_rsun - y) for row, (x, y, _) in zip(rows, source, strict=True)]
            assert np.median(off) < 8.0, name
            assert {one.dataset for one in catalogue.sources(solution.solution_id)} <= set(DATASETS)
            assert catalogue.track_fit(solution.solution_id)["joint"]["times"] > 40


def test_what_pages_show_at_first_is_drawn_with_the_run(refined: Refined) -> None:
    with closing(Catalogue.open(refined.settings.catalogue_url)) as catalogue:
        for name in names(refined.late.localised) | names(refined.late.preliminary):
            summary = catalogue.burst(name)
            assert summary.preferred is not None
            look = kept_first_look(first_look_path(summary.burst, summary.preferred, refined.settings))
            assert look is not None
            assert {"constellation", "spectra"} <= set(look.figures)
            assert ("evolution" in look.figures) == (summary.preferred.answer.tier == "final")
            track = catalogue.track_fit(summary.preferred.solution_id)
            assert complete([Drawn(summary.preferred, track)])
            assert not complete([Drawn(summary.preferred, track | {"companions_pending": True})])


def utc(moment: np.datetime64) -> datetime:
    return datetime.fromisoformat(str(moment.astype("datetime64[ms]"))).replace(tzinfo=UTC)


def test_every_burst_is_in_the_catalogue_with_its_reason(refined: Refined) -> None:
    with closing(Catalogue.open(refined.settings.catalogue_url)) as catalogue:
        found = catalogue.detections(DetectionQuery(START, STOP, origins=frozenset({Origin.SIMULATED}))).detections
        day = catalogue.searched_day(DAY, (Origin.SIMULATED,))
    assert day is not None
    assert day.answer is DayAnswer.LOCALISED
    assert {one.burst_id for one in found if one.tier == "localisable"} == names(refined.late.localised)
    for one in found:
        assert (one.reason == "") == (one.tier == "localisable"), one
        assert (one.burst_id == "") == (one.tier == "rejected"), one
    assert {name for name, _ in refined.late.refused} == {one.burst_id for one in found if one.tier == "catalogued"}
    assert green(refined.settings.day_figure(DAY, Origin.SIMULATED)) > 0.0, "boxes of bursts that were localised"


def test_light_curves_on_their_shared_profile_are_drawn_for_bursts_timed_by_it(refined: Refined) -> None:
    solutions = [one.solution for one in refined.late.localised]
    drawn = {
        one.solution_id: refined.settings.solution_figure(one.burst_id, one.solution_id, COLLAPSED_FIGURE).is_file()
        for one in solutions
    }
    assert drawn == {one.solution_id: one.series.edge == SHARED for one in solutions}
    assert any(drawn.values())


def test_two_spacecraft_give_a_preliminary_track_at_once(refined: Refined) -> None:
    assert refined.early.answer is DayAnswer.NOT_LOCALISABLE
    assert refined.early.localised == ()
    assert refined.early.preliminary
    reasons = dict(refined.early.refused)
    for one in refined.early.preliminary:
        assert one.solution.answer.tier == "preliminary"
        assert one.solution.answer.sentence.startswith("preliminary: ")
        assert one.track["joint"]["phi0_deg"]["q50"] is None, "regions, never one number"
        assert "one_edge" not in one.track["joint"]["flags"], "the second edge was asked"
        assert "a preliminary track is published" in reasons[one.solution.burst_id]


def test_the_third_spacecraft_makes_it_final_under_the_same_id(refined: Refined) -> None:
    same = names(refined.early.preliminary) & names(refined.late.localised)
    assert same
    with closing(Catalogue.open(refined.settings.catalogue_url)) as catalogue:
        for name in same:
            versions = catalogue.versions(name)
            first = next(one for one in versions if one.answer.tier == "preliminary")
            second = next(one for one in versions if one.supersedes == first.solution_id)
            assert (first.version, second.version, second.series) == (1, 2, first.series)
            preferred = catalogue.burst(name).preferred
            assert preferred is not None
            assert preferred.answer.tier == "final"
            for one in versions:
                track = catalogue.track(one.solution_id)
                assert track is not None
                if one.answer.tier == "final" and track.joint.phi0_deg.q50 is not None:
                    assert track.preliminary is not None
                    assert track.preliminary.solution_id == first.solution_id
                    assert 0.0 < track.preliminary.level < 1.0
            kept = catalogue.solution(first.solution_id).spectra_path
            assert kept is not None
            assert (refined.settings.store_root / kept).is_file(), "spectra of a version stay with it"


def test_nothing_is_done_twice_and_a_figure_that_is_missing_is_drawn(refined: Refined) -> None:
    assert (refined.again.state, refined.again.answer) == ("nothing new", "not localisable")
    assert refined.heights[1] > 1.2 * refined.heights[0], "new spacecraft have panels"
    assert process(refined.settings, None).state == "nothing new"


def test_files_of_the_next_day_make_no_new_version_of_bursts_that_do_not_reach_it(
    refined: Refined, tmp_path: Path
) -> None:
    settings = refined.settings.model_copy(update={"home": tmp_path / "home"})
    shutil.copytree(refined.settings.home, settings.home)
    rng, following = np.random.default_rng(9), DAY + timedelta(days=1)
    theirs = instruments("WI_H1_WAV", following)
    write_spectra([observe_day(one, [sky(())], following, rng) for one in theirs], "WI_H1_WAV", following, tmp_path)
    shutil.copytree(tmp_path / "pub", settings.mirror_root / "pub", dirs_exist_ok=True)
    after = process(settings, None)
    assert (after.state, after.observatories) == ("searched", refined.late.observatories)
    known = {one.solution.solution_id for one in (*refined.late.localised, *refined.late.preliminary)}
    assert {one.solution.solution_id for one in (*after.localised, *after.preliminary)} == known


@dataclass
class Overtaken:
    """A home in which runs of the day ended early, since newer files had come, and its state and tracks after each."""

    settings: Settings
    states: list[str]
    searched: list[Any]
    tracks: list[list[dict[str, Any]]]


def after(calls: int, asked: Iterator[int], _: DayFiles) -> bool:
    """Whether a run is overtaken, which is not so at its first calls."""
    return next(asked) >= calls


@pytest.fixture(scope="module")
def overtaken(archive: Path, tmp_path_factory: pytest.TempPathFactory) -> Overtaken:
    """Overtaken at once, and after the first step of every burst."""
    settings = Settings(home=tmp_path_factory.mktemp("overtaken"), in_situ=None, regions=None, draws=500)
    shutil.copytree(archive / "pub", settings.mirror_root / "pub")
    files, done = Mirror(settings).day(DAY), Overtaken(settings, [], [], [])
    for calls in (0, 1):
        run = Run(settings, "test", Workers(1, settings), is_overtaken=partial(after, calls, iter(range(9))))
        done.states.append(process_day(files, (), run).state)
        with closing(Catalogue.open(settings.catalogue_url)) as catalogue:
            done.searched.append(catalogue.searched_day(DAY, (Origin.SIMULATED,)))
            found = catalogue.bursts(BurstQuery(origins=frozenset(Origin))).bursts
            done.tracks.append([catalogue.track_fit(each.solution_id) for one in found for each in one.solutions])
    return done


def test_a_day_that_is_overtaken_ends_after_its_step_and_is_not_recorded(overtaken: Overtaken) -> None:
    assert overtaken.states == [OVERTAKEN] * 2
    assert overtaken.searched == [None] * 2
    assert [len(tracks) for tracks in overtaken.tracks] == [0, len(BURSTS)]
    pending = [track["companions_pending"] for track in overtaken.tracks[1]]
    assert sorted(pending) == [False, True], "a preliminary track stands alone"


def test_pages_of_a_preliminary_and_a_final_burst_are_served(refined: Refined) -> None:
    with TestClient(create_app(refined.settings)) as client:
        for name in names(refined.early.preliminary) | names(refined.late.localised):
            assert client.get(f"/bursts/{name}").status_code == 200
            assert client.get(f"/api/v1/bursts/{name}/track").status_code == 200
        days = client.get("/api/v1/days?origin=simulated").json()["days"]
    assert [day["answer"] for day in days if day["day"] == f"{DAY}"] == ["localised"]


def contents(settings: Settings) -> dict[str, Any]:
    """Everything about results but when they were made, and what their groups are called."""
    with closing(Catalogue.open(settings.catalogue_url)) as catalogue:
        found: dict[str, Any] = {
            "day": catalogue.searched_day(DAY, (Origin.SIMULATED,)),
            "detections": catalogue.detections_of(DAY, (Origin.SIMULATED,)),
        }
        for burst in catalogue.bursts(BurstQuery(origins=frozenset(Origin))).bursts:
            for one in catalogue.versions(burst.burst.burst_id):
                key = one.solution_id
                rows, track = catalogue.localisations(key), catalogue.track_fit(key)
                found[key] = (one.inputs_hash, one.store_sha256, one.answer, one.flags, one.preferred, rows, track)
    return found


@pytest.fixture(scope="module")
def expected(overtaken: Overtaken) -> dict[str, Any]:
    """Results of one process without Prefect, which finished the day after two runs that were overtaken."""
    assert process(overtaken.settings, None).state == "searched"
    return contents(overtaken.settings)


def test_results_are_the_same_from_two_processes(two: Path, refined: Refined, tmp_path: Path) -> None:
    """Of preliminary tracks; final ones take ten times longer and are compared below."""
    settings = Settings(home=tmp_path, in_situ=None, regions=None, draws=500)
    process(settings, two, workers=2)
    assert contents(settings) == refined.early_contents
    assert len(refined.early_contents) == 2 + len(refined.early.preliminary) > 2


@pytest.mark.acceptance
def test_final_results_are_the_same_from_two_processes(archive: Path, expected: dict[str, Any], tmp_path: Path) -> None:
    settings = Settings(home=tmp_path, in_situ=None, regions=None, draws=500)
    process(settings, archive, workers=2)
    assert contents(settings) == expected
    solutions = [one for key, one in expected.items() if key not in {"day", "detections"}]
    assert {answer.tier for _, _, answer, *_ in solutions} == {"final", "preliminary"}


@pytest.mark.acceptance  # seven processes, one of them with Prefect
def test_results_are_the_same_with_prefect_after_a_run_that_was_killed(
    archive: Path, expected: dict[str, Any], tmp_path: Path
) -> None:
    sandbox = Sandbox.within(tmp_path)
    command = [BELLA, "run", "--from", f"{DAY}", "--archive", str(archive), "--workers", "2"]
    environment = sandbox.environment | {"BELLA_DRAWS": "500"}
    victim = subprocess.Popen([*command, "--direct"], env=environment, cwd=sandbox.elsewhere[0], start_new_session=True)
    store = sandbox.home / "store"
    until(lambda: any(store.glob("SIM-*/*posterior*.zarr.zip")) or victim.poll() is not None, pause_s=0.02)
    os.killpg(victim.pid, signal.SIGKILL)
    victim.wait()
    home = Settings(home=sandbox.home, in_situ=None, regions=None, draws=500)
    with closing(Catalogue.open(home.catalogue_url)) as catalogue:
        assert catalogue.searched_day(DAY, (Origin.SIMULATED,)) is None

    done = sandbox.run(*command, "--json", BELLA_DRAWS="500")

    (day,) = json.loads(done.stdout)
    assert (day["state"], day["answer"]) == ("searched", "localised")
    assert contents(home) == expected
    with closing(Catalogue.open(home.catalogue_url)) as catalogue:
        assert all((home.store_root / path).is_file() for path in catalogue.referenced_paths())
    assert sandbox.files_elsewhere() == []


def test_a_day_that_is_not_done_is_no_success() -> None:
    fine = DayOutcome(DAY, "no data", DayAnswer.NO_DATA)
    check_finished([fine, DayOutcome(DAY, "searched", DayAnswer.NO_BURST)])
    for answer in (DayAnswer.ARCHIVE_SILENT, DayAnswer.NOT_SEARCHABLE):
        with pytest.raises(UnfinishedError, match=f"1 of 2 day is not done: 2021-02-01 {answer}") as caught:
            check_finished([fine, DayOutcome(DAY, str(answer), answer)])
        assert len(caught.value.outcomes) == 2
    check_finished([DayOutcome(DAY, "archive silent", DayAnswer.ARCHIVE_SILENT)], is_asked_for=False)
    with pytest.raises(UnfinishedError, match="not searchable"):
        check_finished([DayOutcome(DAY, "not searchable", DayAnswer.NOT_SEARCHABLE)], is_asked_for=False)
    with pytest.raises(UnfinishedError, match="2 of 2 days are not done: 2021-02-01 the disk is full"):
        check_finished([DayOutcome(DAY, "failed", message="the disk is full")] * 2)
    with pytest.raises(UnfinishedError, match="a data set could not be asked for"):
        check_finished([fine], ["WI_H1_WAV: no answer"])
    with pytest.raises(UnfinishedError, match="2 data sets could not be asked for"):
        check_finished([fine], ["WI_H1_WAV: no answer", "STEREO: no answer"])
