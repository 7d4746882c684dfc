"""The parts that a burst goes through: its inputs, its solution, what is published, and what ends or stops it."""

import hashlib
import json
import pickle
from contextlib import closing
from dataclasses import replace
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from fastapi.testclient import TestClient
from typer.testing import CliRunner

from api.app import create_app
from bella.arrivals import arrivals_csv, locate_receivers
from bella.bursts import EVENT, half_maximum_arrivals, published_arrivals
from bella.catalogue import Catalogue, Series, Submission
from bella.cli import app
from bella.exceptions import (
    BusyError,
    ConvergenceError,
    GeometryError,
    InputError,
    NoDataError,
    StoreError,
    UnreachableError,
)
from bella.flags import APPARENT_SOURCE
from bella.multilateration import localise
from bella.pipeline import progress
from bella.pipeline.day_files import ANSWERS, _sha256, remember_answers
from bella.pipeline.inputs import load_burst
from bella.pipeline.outcome import FAILED, DayOutcome, UnfinishedError
from bella.pipeline.publication import PLACES, Draft, inputs_hash, publish, solution_flags
from bella.pipeline.run import check_unchanged
from bella.pipeline.surroundings import fitted_spiral, surroundings_of
from bella.pipeline.tracks import Timing, attempted
from bella.pipeline.workers import prepare
from bella.records import Origin
from bella.settings import Settings
from bella.store import open_group
from bella.tracks.spiral import track_fit
from tests.pipeline.examples import built_in_event, whole_track

SERIES = Series("half_maximum", "posterior", "default", 2)
UNKNOWN = surroundings_of(datetime(2012, 6, 7, 19, 20, tzinfo=UTC), Settings(in_situ=None, regions=None))
"""Neither wind nor regions."""


@pytest.fixture(scope="module")
def located() -> Any:
    return locate_receivers(half_maximum_arrivals(np.array([0.3, 1.0])))


def test_inputs_hash_changes_with_everything_a_solution_depends_on(located: Any) -> None:
    sources = built_in_event().sources
    settings, timing = Settings(), Timing(located, located)
    directions = pd.DataFrame({"observatory": ["WIND"], "frequency_mhz": [0.5], "longitude_deg": [170.0]})
    same = inputs_hash(timing, sources, SERIES, settings)
    assert same == inputs_hash(Timing(located.copy(), located.copy()), sources[::-1], SERIES, settings)
    assert same == inputs_hash(replace(timing, directions=directions.head(0)), sources, SERIES, settings)
    later, moved = located.assign(sigma_s=located["sigma_s"] + 1e-6), located.assign(x_rsun=located["x_rsun"] + 1e-4)
    others = {
        *(inputs_hash(Timing(one, located), sources, SERIES, settings) for one in (later, moved)),
        *(inputs_hash(Timing(located, one), sources, SERIES, settings) for one in (later, moved, None)),
        inputs_hash(replace(timing, directions=directions), sources, SERIES, settings),
        inputs_hash(replace(timing, directions=directions.assign(longitude_deg=171.0)), sources, SERIES, settings),
        inputs_hash(timing, sources[1:], SERIES, settings),
        inputs_hash(timing, sources, replace(SERIES, preset="paper"), settings),
        inputs_hash(timing, sources, replace(SERIES, method="nuts"), settings),
        inputs_hash(timing, sources, SERIES, Settings(seed=1)),
        inputs_hash(timing, sources, SERIES, Settings(draws=10)),
    }
    assert len(others | {same}) == 13


def test_files_that_times_were_measured_in_count_in_place_of_the_times(located: Any) -> None:
    sources, settings = built_in_event().sources, Settings()
    timing = Timing(located, located, sources=sources)
    later = located.assign(sigma_s=located["sigma_s"] + 1e-6)
    same = inputs_hash(timing, (), SERIES, settings)
    assert same == inputs_hash(Timing(later, later, sources=sources[::-1]), (), SERIES, settings)
    near, moved = (located.assign(x_rsun=located["x_rsun"].round(PLACES) + by) for by in (0.04, 0.06))
    assert inputs_hash(replace(timing, arrivals=near), (), SERIES, settings) == inputs_hash(
        replace(timing, arrivals=located.assign(x_rsun=located["x_rsun"].round(PLACES))), (), SERIES, settings
    )
    fewer = located[located["observatory"] != located["observatory"].iloc[0]]
    others = {
        inputs_hash(replace(timing, sources=sources[1:]), (), SERIES, settings),
        inputs_hash(replace(timing, arrivals=fewer), (), SERIES, settings),
        inputs_hash(replace(timing, arrivals=moved), (), SERIES, settings),
        inputs_hash(timing, sources, SERIES, settings),
        inputs_hash(timing, (), replace(SERIES, edge="half_rise"), settings),
        inputs_hash(timing, (), SERIES, Settings(seed=1)),
    }
    assert len(others | {same}) == 7


def test_built_in_event_names_its_inputs() -> None:
    given = built_in_event()
    assert given.burst.burst_id == "T3-20120607-1929"
    assert set(given.arrivals) == {"gauss_hermite", "half_maximum", "half_rise", "shared_profile"}
    assert given.spectra is not None
    assert set(given.spectra.children) == set(given.burst.observatories)
    assert len({source.sha256 for source in given.sources}) == len(given.sources) >= 3
    assert given.is_timed, "its files make a new version, not the last digits of its times on another processor"
    channels = given.channel_arrivals["half_rise"]
    assert len(channels) == 104, "the joint fit takes the edges themselves, as for every burst found in spectra"
    assert channels["frequency_mhz"].nunique() > given.arrivals["half_rise"]["frequency_mhz"].nunique()


def test_a_submission_becomes_a_burst_of_its_own(tmp_path: Path) -> None:
    table = published_arrivals(np.array([0.2, 2.0]))
    text = arrivals_csv(table)
    sha256 = hashlib.sha256(text.encode()).hexdigest()
    (tmp_path / "S-20120607-abcdefghij.csv").write_text(text)
    given = load_burst("S-20120607-abcdefghij", tmp_path)
    assert (given.burst.burst_id, given.burst.origin) == ("S-20120607-abcdefghij", Origin.SUBMISSION)
    assert (given.burst.f_low_mhz, given.burst.f_high_mhz) == (0.2, 2.0)
    assert given.spectra is None
    assert given.sources[0].sha256 == sha256


def test_submission_that_was_changed_is_refused(tmp_path: Path) -> None:
    moment = datetime(2012, 6, 8, tzinfo=UTC)
    waiting = Submission("S-20120607-abcdefghij", "token", "0" * 64, "received", "", None, moment, moment)
    (tmp_path / "S-20120607-abcdefghij.csv").write_text(arrivals_csv(published_arrivals(np.array([0.2, 2.0]))))
    with pytest.raises(InputError, match="submit it again"):
        check_unchanged(waiting, tmp_path)


def test_track_of_a_solution_holds_every_method_and_its_draws_reach_the_store(tmp_path: Path) -> None:
    settings = Settings(home=tmp_path, draws=500)
    arrivals = locate_receivers(half_maximum_arrivals(np.geomspace(0.15, 2.0, 12)))
    given = built_in_event()
    track, fitted = whole_track(localise(arrivals, draws=200), Timing(arrivals), SERIES, settings, UNKNOWN)
    assert track["joint"]["times"] == 3 * 12
    assert track["joint"]["rotation_period_d"] == track["rotation_period_d"] == 24.47
    computed = {"semp", "weighted", "piecewise", "density_excess", "scattering", "footpoint", "models"}
    missing = {"wind", "triangulation", "fused"}
    assert set(track["companions"]) == computed | missing
    assert track["remark"] == track["companions"]["scattering"]["apparent"] == APPARENT_SOURCE
    assert {name for name, one in track["companions"].items() if "reason" in one} == missing
    with closing(Catalogue.open(settings.catalogue_url, create=True)) as catalogue:
        first = fitted.track.model_dump(mode="json")
        draft = Draft(given.burst, SERIES, "0" * 64, fitted.drawn, first, given.sources)
        solution = publish(draft, catalogue, settings)
        assert catalogue.track_fit(solution.solution_id) == json.loads(json.dumps(first))
        catalogue.add_companions(solution.solution_id, track["companions"])
        assert catalogue.track_fit(solution.solution_id) == json.loads(json.dumps(track))
        assert solution == catalogue.solution(solution.solution_id)
    assert set(track["joint"]["flags"]) <= set(solution.flags)
    with open_group(settings.store_root, solution.store_path) as group:
        wind = group["joint_draws"].sel(joint_parameter="v_sw_km_s")
        assert wind.sizes == {"joint_draw": 500}
        assert float(wind.median()) == pytest.approx(track["joint"]["v_sw_km_s"]["q50"], rel=0.2)
        assert group["joint_draws"].attrs["units"] == "as the name of the parameter says"


def test_what_cannot_be_computed_says_why_and_stops_nothing(located: Any) -> None:
    alone = located[located["frequency_mhz"] == 1.0]
    track, fitted = whole_track(localise(alone, draws=200), Timing(alone), SERIES, Settings(), UNKNOWN)
    assert track["joint"]["flags"] == ["too_few_frequencies"]
    assert "joint_draws" not in fitted.drawn
    found = track["companions"]
    assert found["semp"] == {"flags": ["not_computed"], "reason": found["semp"]["reason"]}
    assert "at least 4" in found["semp"]["reason"]
    assert "no track (fewer than four frequencies" in found["footpoint"]["reason"]
    assert found["piecewise"]["flags"] == ["too_few_positions"]
    assert found["density_excess"]["flags"] == []


@pytest.mark.parametrize(
    "error",
    [GeometryError("collinear"), NoDataError("outside"), InputError("wrong"), ConvergenceError("no maximum")],
)
def test_only_expected_errors_of_a_companion_are_recorded(error: Exception) -> None:
    def refuse() -> dict[str, Any]:
        raise error

    assert attempted(refuse) == {"flags": ["not_computed"], "reason": str(error)}
    with pytest.raises(ZeroDivisionError):
        attempted(lambda: {"ratio": 1 / 0})


def test_light_curves_of_the_built_in_event_are_carried_on_their_shared_profile() -> None:
    given = built_in_event()
    assert given.collapsed is not None
    assert set(given.collapsed["observatory"]) == set(EVENT.observatories)
    near = given.collapsed[given.collapsed["widths"].abs() < 0.2]
    assert near["height"].median() == pytest.approx(0.5, abs=0.1), "half of the rise is the zero of the time axis"


def test_burst_of_one_frequency_is_published_without_a_spiral(tmp_path: Path, located: Any) -> None:
    """Positions are worth having where there are too few of them for a track."""
    settings = Settings(home=tmp_path, draws=200)
    given = built_in_event()
    alone = located[located["frequency_mhz"] == 1.0]
    posterior = localise(alone, draws=settings.draws)
    with closing(Catalogue.open(settings.catalogue_url, create=True)) as catalogue:
        draft = Draft(given.burst, SERIES, "0" * 64, posterior, track_fit(posterior), given.sources)
        swept = replace(draft, burst=replace(given.burst, spectra_path="nowhere/spectra.zarr.zip"))
        with pytest.raises(StoreError, match=r"spectra\.zarr\.zip has left the store"):
            publish(swept, catalogue, settings)
        assert catalogue.bursts().total == 0
        solution = publish(draft, catalogue, settings)
    assert "too_few_positions" in solution.flags
    with TestClient(create_app(settings)) as client:
        page = client.get(f"/bursts/{given.burst.burst_id}")
        figure = client.get(f"/api/v1/bursts/{given.burst.burst_id}/figures/constellation.svg")
        track = client.get(f"/api/v1/bursts/{given.burst.burst_id}/track").json()
    assert page.status_code == figure.status_code == 200
    assert "no spiral was fitted" in page.text
    assert len(track["localisations"]) == 1
    shown = CliRunner().invoke(app, ["catalogue", "show", given.burst.burst_id], env={"BELLA_HOME": str(tmp_path)})
    assert shown.exit_code == 0, shown.output


def test_solution_flags_are_those_of_rows_and_fit() -> None:
    posterior = xr.Dataset({"flags": ("frequency", np.array(["", "b;a", "b"]))})
    assert solution_flags(posterior, {"two_step": {"flags": ["formal_errors"]}}) == ("a", "b", "formal_errors")
    both = {"two_step": {"flags": ["formal_errors"]}, "joint": {"flags": ["poor_fit"]}}
    assert solution_flags(posterior, both) == ("a", "b", "formal_errors", "poor_fit")
    assert solution_flags(posterior.isel(frequency=[0]), {}) == ()


@pytest.mark.parametrize(
    ("error", "again"),
    [(BusyError("x"), True), (UnreachableError("x"), True), (StoreError("x"), False), (ValueError("x"), False)],
)
def test_only_errors_that_may_pass_are_tried_again(error: Exception, *, again: bool) -> None:
    from prefect.states import Failed

    from flows.tasks import is_retriable

    state = Failed(data=error)
    assert is_retriable(None, None, state) is again  # type: ignore[arg-type]


def test_progress_counts_for_who_listens() -> None:
    received: list[tuple[str, int, int]] = []
    progress.counter("unheard", 2)(1)
    progress.listen(lambda *news: received.append(news))
    advance = progress.counter("localise", 5)
    advance(2)
    advance(3)
    assert received == [("localise", 0, 5), ("localise", 2, 5), ("localise", 5, 5)]


def test_environment_keeps_what_an_operator_has_set(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    names = ("PREFECT_HOME", "MPLCONFIGDIR", "NUMBA_CACHE_DIR", "PYTENSOR_FLAGS", "XDG_CACHE_HOME", "DO_NOT_TRACK")
    for name in names:
        monkeypatch.setenv(name, "")  # so that the test's own environment is restored afterwards
        monkeypatch.delenv(name)
    for name in ("PREFECT_SERVER_ANALYTICS_ENABLED", "PREFECT_LOGGING_LEVEL", "PREFECT_LOGGING_TO_API_ENABLED"):
        monkeypatch.setenv(name, "kept")
    for name in ("PREFECT_CLI_PROMPT", "PREFECT_INTERNAL_LOGGING_LEVEL", "XDG_CONFIG_HOME"):
        monkeypatch.setenv(name, "kept")
    prepare(Settings(home=tmp_path / "home"))
    import os

    assert os.environ["PREFECT_HOME"] == str(tmp_path / "home" / "prefect")
    assert os.environ["DO_NOT_TRACK"] == "1"
    assert os.environ["PREFECT_LOGGING_LEVEL"] == "kept"


def test_days_that_were_not_finished_come_back_whole_from_another_process() -> None:
    days = (DayOutcome(date(2021, 2, 1), FAILED, message="the disk is full"),)
    back = pickle.loads(pickle.dumps(UnfinishedError("1 of 1 days failed", days)))
    assert (str(back), back.outcomes) == ("1 of 1 days failed", days)
    assert days[0].new == 0


def test_a_folder_that_a_user_brings_counts_with_all_that_is_in_it(tmp_path: Path) -> None:
    store = tmp_path / "mine.zarr"
    (store / "c").mkdir(parents=True)
    (store / "zarr.json").write_text("{}")
    sums = set()
    for name, content in (("0", b"a"), ("0", b"b"), ("1", b"b")):
        (store / "c" / name).write_bytes(content)
        sums.add(_sha256(store))
    assert len(sums) == 3


def test_answers_that_cannot_be_kept_are_the_disk(tmp_path: Path) -> None:
    (tmp_path / ANSWERS).write_text("")
    with pytest.raises(StoreError, match=r"mirror .* cannot be written \(File exists\): make room"):
        remember_answers([], tmp_path)


def test_a_track_that_was_not_fitted_has_no_spiral_to_draw() -> None:
    known = {"phi0_deg": {"mean": 10.0}, "v_sw_km_s": {"mean": None}}
    assert all(fitted_spiral(xr.Dataset(), one) is None for one in ({}, {"phi0_deg": {"mean": 10.0}}, known))
