"""A burst in two steps: its answer first, what other methods say of it under the same id, whatever comes between."""

import time
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from sqlalchemy import text

from bella.answer import answer_of, read_track
from bella.catalogue import Catalogue, Solution
from bella.exceptions import BusyError, StoreError
from bella.pipeline.burst import (
    PRELIMINARY,
    Begun,
    BurstOutcome,
    Choice,
    begin_burst,
    continue_burst,
    preliminary_level,
    process_burst,
)
from bella.pipeline.draw import Drawn, draw_burst, figure_paths
from bella.pipeline.housekeeping import sweep_store
from bella.pipeline.inputs import BurstInput
from bella.pipeline.surroundings import surroundings_of
from bella.settings import Settings
from bella.store.layout import age_s
from tests.pipeline.examples import built_in_event
from tests.waiting import until

FIRST, SECOND = "half_rise", "half_maximum"


@pytest.fixture(scope="module")
def given() -> BurstInput:
    """The built-in event at a few frequencies, with two edges; models are compared for the first alone."""
    event = built_in_event()
    few = {edge: event.arrivals[edge] for edge in (SECOND, FIRST)}
    few = {edge: table[table["frequency_mhz"].isin(kept(table))] for edge, table in few.items()}
    return replace(event, arrivals=few, channel_arrivals={}, channel_edges={}, spectra=None, collapsed=None)


def kept(table: pd.DataFrame) -> pd.Series:
    """Ten of the frequencies of a table."""
    known = table["frequency_mhz"].unique()
    return pd.Series(known[:: len(known) // 10])


def settings_of(home: Path) -> Settings:
    return Settings(home=home, draws=200, in_situ=None, regions=None)


def begun_at(given: BurstInput, settings: Settings) -> Begun:
    begun = begin_burst(given, Choice(), settings, "first")
    assert isinstance(begun, Begun)
    return begun


def finished(done: Begun | BurstOutcome, settings: Settings) -> BurstOutcome:
    while isinstance(done, Begun):
        done = continue_burst(done, settings, "first")
    return done


def tracks(settings: Settings) -> dict[str, tuple[Solution, dict[str, Any]]]:
    with closing(Catalogue.open(settings.catalogue_url)) as catalogue:
        (burst,) = catalogue.bursts().bursts
        return {one.series.edge: (one, catalogue.track_fit(one.solution_id)) for one in burst.solutions}


@pytest.fixture(scope="module")
def whole(
    given: BurstInput, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Settings, dict[str, Any], dict[str, Any]]:
    """A burst of both steps, and what was known of it after each."""
    settings = settings_of(tmp_path_factory.mktemp("whole"))
    begun = begun_at(given, settings)
    early = tracks(settings)
    assert [one.solution.series.edge for one in finished(begun, settings).outcomes] == [FIRST, SECOND]
    return settings, early, tracks(settings)


def test_the_preferred_edge_is_served_first_and_nothing_of_its_answer_waits(whole: Any) -> None:
    _, early, late = whole
    assert set(early) == {FIRST}
    assert set(late) == {FIRST, SECOND}
    (solution, track), (later, full) = early[FIRST], late[FIRST]
    assert solution.preferred
    assert later == solution
    assert track.pop("companions_pending")
    assert track.pop("companions") == {}
    assert not full["companions_pending"]
    assert {name: full[name] for name in track} == track
    assert "models" in late[SECOND][1]["companions"]
    assert "models" not in full["companions"]
    for known, fit in late.values():
        said = read_track(fit)
        assert said is not None
        bare = said.model_copy(update={"companions": {}})
        assert answer_of(bare, ()) == answer_of(said, ()), known


def test_a_run_that_was_killed_between_the_steps_is_made_up_for_by_the_next(
    given: BurstInput, whole: Any, tmp_path: Path
) -> None:
    settings = settings_of(tmp_path)
    begun_at(given, settings)
    done = process_burst(given, Choice(), settings, "next")
    assert [one.new for one in done.outcomes] == [False, True]
    again = tracks(settings)
    for edge, (solution, track) in whole[2].items():
        assert again[edge][1] == track
        assert again[edge][0].store_sha256 == solution.store_sha256
        assert again[edge][0].solution_id == solution.solution_id
    assert all(not one.new for one in process_burst(given, Choice(), settings, "third").outcomes)
    with closing(Catalogue.open(settings.catalogue_url)) as catalogue:
        attempts = {one.subject: one.attempts for one in catalogue.stage_runs()}
    assert attempts == {given.burst.burst_id: 3}, "no other run can come in between the steps of one"


def test_what_another_run_works_on_is_left_to_it(given: BurstInput, whole: Any) -> None:
    settings = whole[0]
    with (
        closing(Catalogue.open(settings.catalogue_url)) as catalogue,
        catalogue.lease("localise", given.burst.burst_id, "other", 60.0),
        pytest.raises(BusyError),
    ):
        process_burst(given, Choice(), settings, "mine")


def test_a_burst_that_no_edge_places_says_why_and_publishes_nothing(given: BurstInput, tmp_path: Path) -> None:
    done = begin_burst(given, Choice(method="guess"), settings_of(tmp_path), "mine")
    assert isinstance(done, BurstOutcome)
    assert "guess" in done.reason
    assert done.outcomes == ()


def test_a_sweep_between_the_steps_spares_what_a_live_run_works_on(tmp_path: Path) -> None:
    settings = settings_of(tmp_path).model_copy(update={"lease_s": 0.05})
    group = settings.store_root / "T3-1" / "half_rise.zarr.zip"
    group.parent.mkdir(parents=True)
    group.touch()
    with closing(Catalogue.open(settings.catalogue_url, create=True)) as catalogue:
        with catalogue.lease("localise", "T3-1", "slow", 60.0):
            until(lambda: age_s(group, time.time()) > settings.lease_s)
            assert sweep_store(catalogue, settings, "housekeeping") == []
        assert group.is_file()
        assert sweep_store(catalogue, settings, "housekeeping") == ["T3-1/half_rise.zarr.zip"]


def of_two(given: BurstInput) -> BurstInput:
    """The burst as Wind and STEREO-A received it, by the edge of which the two agree."""
    table = given.arrivals[SECOND]
    arrivals = table[table["observatory"] != "STEREO-B"]
    return replace(given, arrivals={SECOND: arrivals}, burst=replace(given.burst, observatories=("WIND", "STEREO-A")))


def test_a_preliminary_track_is_made_once_and_yields_to_a_final_one(given: BurstInput, tmp_path: Path) -> None:
    settings = settings_of(tmp_path)
    (first,) = process_burst(of_two(given), Choice(), settings, "first").outcomes
    (again,) = process_burst(of_two(given), Choice(), settings, "again").outcomes
    assert (first.solution.answer.tier, first.new, again.new) == (PRELIMINARY, True, False)
    assert again.solution.solution_id == first.solution.solution_id

    final = begun_at(given, settings).outcomes[0]
    refused = process_burst(of_two(given), Choice(), settings, "late")
    assert refused.outcomes == ()
    assert refused.reason == f"two spacecraft give no more than {final.solution.solution_id}, which stands"


def test_a_final_longitude_has_no_level_in_a_preliminary_track_of_an_older_version(
    given: BurstInput, tmp_path: Path
) -> None:
    settings = settings_of(tmp_path)
    (first,) = process_burst(of_two(given), Choice(), settings, "first").outcomes
    known = read_track(first.track)
    assert known is not None
    longitude = known.joint.phi0_deg.model_copy(update={"q50": -20.0})
    final = known.model_copy(update={"joint": known.joint.model_copy(update={"phi0_deg": longitude})})
    with closing(Catalogue.open(settings.catalogue_url)) as catalogue:
        burst_id = first.solution.burst_id
        level = preliminary_level(catalogue, burst_id, final)
        assert level is not None
        assert (level.solution_id, level.phi0_deg) == (first.solution.solution_id, -20.0)
        assert 0.0 < level.level < 1.0
        assert preliminary_level(catalogue, "T3-20010101-0000", final) is None
        with catalogue._engine.begin() as connection:
            connection.execute(text("UPDATE track_fit SET fit = '{}'"))
        assert preliminary_level(catalogue, burst_id, final) is None


def test_figures_that_cannot_be_drawn_end_nothing_and_a_store_that_fails_is_the_disk(
    given: BurstInput, whole: Any
) -> None:
    settings, _, late = whole
    solution, track = late[FIRST]
    around = surroundings_of(given.burst.start_utc, settings)
    figures = figure_paths(given, [Drawn(solution, track)], settings)
    for figure in figures:
        figure.unlink()

    draw_burst(given, [Drawn(solution, {**track, "joint": "no fit"})], settings, around)
    assert not any(figure.is_file() for figure in figures)

    with pytest.raises(StoreError):
        draw_burst(given, [Drawn(replace(solution, store_path="gone.zarr.zip"), track)], settings, around)

    draw_burst(given, [Drawn(solution, track)], settings, around)
    assert all(figure.is_file() for figure in figures)
