"""Lists of a folder in the catalogue, linked to bursts, whatever becomes of lists and bursts afterwards."""

import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bella.archive import find_datasets
from bella.catalogue import Catalogue, EventQuery, ListRead
from bella.exceptions import InputError
from bella.linked_events.events import at_sun
from bella.pipeline.ingest import feeds
from bella.pipeline.linked_events import refresh_events, released
from bella.records import Moment, Origin
from bella.settings import Settings
from tests.api.published import ONSET, published, synthetic_burst
from tests.catalogue.examples import burst, fitted, publication
from tests.fixtures_postgres import postgres_database
from tests.linked_events.published import DONKI_FLARES, FILES, SWPC
from tests.plotting.synthetic import BURST_ID

FLARE, FLARE_OF_SWPC = "DONKI:2012-06-07T19:24:00-FLR-001", "SWPC:20120607T1924"
CME, PARTICLES = "DONKI:2012-06-07T20:00:00-CME-001", "DONKI:2012-06-07T20:20:00-SEP-001"
RADIO = "TFCat stereo-a:17"
FEW = np.array([0.25, 0.5])


both = pytest.mark.parametrize("settings", ["sqlite", "postgresql"], indirect=True)


@pytest.fixture
def settings(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Settings]:
    lists = tmp_path / "lists"
    lists.mkdir()
    if getattr(request, "param", "sqlite") == "sqlite":
        yield filled(Settings(home=tmp_path / "home", database_url=None, events=lists))
        return
    with postgres_database() as url:
        yield filled(Settings(home=tmp_path / "home", database_url=url, events=lists))


def filled(settings: Settings) -> Settings:
    with Catalogue.open(settings.catalogue_url, create=True) as catalogue:
        published(settings, catalogue, frequencies=FEW)
    for name, content in FILES.items():
        put(settings, name, content)
    return settings


def put(settings: Settings, name: str, content: Any) -> None:
    assert settings.events is not None
    path = settings.events / name
    path.write_text(content if isinstance(content, str) else json.dumps(content), encoding="utf-8")


def near(settings: Settings, burst_id: str = BURST_ID) -> set[str]:
    with Catalogue.open(settings.catalogue_url) as catalogue:
        return {link.event.event_id for link in catalogue.events.of_burst(burst_id)}


def lists(settings: Settings) -> dict[str, ListRead]:
    with Catalogue.open(settings.catalogue_url) as catalogue:
        return {one.name: one for one in catalogue.events.lists()}


def known(settings: Settings, **asked: Any) -> list[str]:
    with Catalogue.open(settings.catalogue_url) as catalogue:
        return [one.event.event_id for one in catalogue.events.events(EventQuery(**asked)).events]


def released_late(sd_s: float) -> dict[str, Any]:
    """A track whose beam left the Sun two hours after the burst."""
    track = fitted()
    moment = Moment(q50="2012-06-07T21:30:00.000Z", sd=sd_s)
    return track.model_copy(update={"joint": track.joint.model_copy(update={"release_utc": moment})}).model_dump(
        mode="json"
    )


@both
def test_all_lists_are_read_and_linked_and_nothing_is_done_twice(settings: Settings) -> None:
    first = refresh_events(settings)
    assert near(settings) == {FLARE, FLARE_OF_SWPC, CME, PARTICLES, RADIO}
    assert {one.name for one in first.lists} == set(FILES)
    assert {one.state for one in first.lists} == {"read"}
    assert (first.changed_events, first.bursts) == (8, 1)
    swpc = lists(settings)["20120607events.txt"]
    assert (swpc.events, swpc.message) == (3, "")
    assert (swpc.first_utc, swpc.newest_utc) == (
        datetime(2012, 6, 7, 19, 24, tzinfo=UTC),
        datetime(2012, 6, 7, 23, 58, tzinfo=UTC),
    )
    again = refresh_events(settings)
    assert (again.changed_events, again.bursts) == (0, 0)
    assert again.lists[0].read_utc > first.lists[0].read_utc


@both
def test_events_come_by_start_kind_and_page(settings: Settings) -> None:
    refresh_events(settings)
    everything = known(settings)
    assert everything[:2] == [FLARE, FLARE_OF_SWPC]
    assert known(settings, kinds=frozenset({"cme", "radio"})) == [RADIO, CME, "TFCat stereo-a:18"]
    assert known(settings, linked=True, kinds=frozenset({"radio"})) == [RADIO]
    assert known(settings, start=datetime(2012, 6, 8, tzinfo=UTC)) == ["TFCat stereo-a:18"]
    assert known(settings, stop=datetime(2012, 6, 7, 19, 25, tzinfo=UTC)) == everything[:2]
    found, cursor = [], None
    with Catalogue.open(settings.catalogue_url) as catalogue:
        while True:
            page = catalogue.events.events(EventQuery(cursor=cursor, limit=3))
            assert page.total == 8
            found += page.events
            cursor = page.next_cursor
            if cursor is None:
                break
    assert [one.event.event_id for one in found] == everything
    (linked,) = (one for one in found if one.event.event_id == CME)
    assert list(linked.bursts) == [BURST_ID]
    assert linked.list_name == "CME-2012.json"


def test_delays_are_at_the_sun(settings: Settings) -> None:
    refresh_events(settings)
    with Catalogue.open(settings.catalogue_url) as catalogue:
        begun = released(catalogue, catalogue.burst(BURST_ID))
        links = {link.event.event_id: link.delay_s for link in catalogue.events.of_burst(BURST_ID)}
    light_s = 506.4  # from the Sun to Earth, on that day
    expected = (datetime(2012, 6, 7, 20, tzinfo=UTC) - begun).total_seconds() - light_s
    assert links[CME] == pytest.approx(expected, abs=0.5)
    assert links[FLARE] == links[FLARE_OF_SWPC] == pytest.approx(links[CME] - 36 * 60)


def test_a_burst_that_comes_later_is_linked_and_an_answer_that_changes_linked_anew(settings: Settings) -> None:
    refresh_events(settings)
    later = synthetic_burst(burst_id="T3-20120607-1935", start=ONSET + timedelta(minutes=4))
    with Catalogue.open(settings.catalogue_url) as catalogue:
        published(settings, catalogue, burst=later, frequencies=FEW)
    assert near(settings, later.burst_id) == set()
    assert refresh_events(settings).bursts == 1
    assert FLARE in near(settings, later.burst_id)
    # a release that is two hours later, known to a minute: the flare is over then
    track = released_late(60.0)
    with Catalogue.open(settings.catalogue_url) as catalogue:
        published(settings, catalogue, inputs_hash="b" * 64, frequencies=FEW, track_fit=track)
        assert released(catalogue, catalogue.burst(BURST_ID)) == datetime(2012, 6, 7, 21, 30, tzinfo=UTC)
    refresh_events(settings)
    assert near(settings) == set()


def test_a_release_that_is_not_known_well_says_less_than_the_emission(settings: Settings) -> None:
    for sd, expected in ((299.0, "21:30"), (301.0, "19:2")):
        track = released_late(sd)
        with Catalogue.open(settings.catalogue_url) as catalogue:
            published(settings, catalogue, inputs_hash=f"{sd}", frequencies=FEW, track_fit=track)
            summary = catalogue.burst(BURST_ID)
            assert f"{released(catalogue, summary):%H:%M}".startswith(expected)
            emitted = {
                one.frequency_mhz: one.emission_utc for one in catalogue.localisations(summary.solutions[0].solution_id)
            }
            assert emitted[0.25] != emitted[0.5]
            assert (released(catalogue, summary) == emitted[0.5]) == (sd > 300.0)
            without = replace(summary, solutions=())
            light_s = (ONSET - released(catalogue, without)).total_seconds()
        assert light_s == pytest.approx(0.9604 * 499.005, abs=2.0)  # to STEREO-A, the nearest


def test_a_burst_without_positions_began_its_light_time_before_its_onset(settings: Settings) -> None:
    with Catalogue.open(settings.catalogue_url) as catalogue:
        catalogue.publish(publication(of=burst("T3-20120608-0100"), localisations=()))
        summary = catalogue.burst("T3-20120608-0100")
        assert summary.solutions
        begun = released(catalogue, summary)
    assert begun == max(at_sun(summary.burst.start_utc, name) for name in summary.burst.observatories)


@both
def test_a_list_that_shrinks_loses_what_was_withdrawn_and_keeps_what_was_cut_off(settings: Settings) -> None:
    rows = [
        DONKI_FLARES[0] | {"flrID": f"{day}", "beginTime": f"2012-06-{day:02}T10:00Z", "peakTime": None}
        for day in (5, 6, 7, 8)
    ]
    put(settings, "FLR-2012.json", rows)
    refresh_events(settings)
    flares = [f"DONKI:{day}" for day in (5, 6, 7, 8)]
    assert [one for one in known(settings) if one in flares] == flares
    put(settings, "FLR-2012.json", [rows[1], rows[3]])
    assert refresh_events(settings).changed_events == 1
    assert [one for one in known(settings) if one in flares] == ["DONKI:5", "DONKI:6", "DONKI:8"]
    assert lists(settings)["FLR-2012.json"].events == 3
    put(settings, "FLR-2012.json", [])
    assert refresh_events(settings).changed_events == 0
    assert lists(settings)["FLR-2012.json"].events == 3


@pytest.mark.parametrize("content", ["", "{", "<html>", [{"flrID": "x"}]])
def test_a_list_that_is_damaged_takes_nothing_away_and_is_named(settings: Settings, content: Any) -> None:
    refresh_events(settings)
    put(settings, "FLR-2012.json", content)
    refresh_events(settings)
    flares = lists(settings)["FLR-2012.json"]
    assert flares.state == "refused"
    assert flares.message.startswith("FLR-2012.json")
    assert flares.events == 1
    assert FLARE in near(settings)
    put(settings, "FLR-2012.json", DONKI_FLARES)
    refresh_events(settings)
    assert (lists(settings)["FLR-2012.json"].state, lists(settings)["FLR-2012.json"].message) == ("read", "")


def test_a_list_whose_file_is_gone_takes_nothing_away(settings: Settings) -> None:
    refresh_events(settings)
    assert settings.events is not None
    (settings.events / "CME-2012.json").unlink()
    refresh_events(settings)
    gone = lists(settings)["CME-2012.json"]
    assert (gone.state, gone.message, gone.events) == ("gone", "its file is gone", 1)
    assert CME in near(settings)
    put(settings, "CME-2012.json", FILES["CME-2012.json"])
    refresh_events(settings)
    assert lists(settings)["CME-2012.json"].state == "read"


def test_an_event_that_was_corrected_is_linked_anew(settings: Settings) -> None:
    refresh_events(settings)
    put(settings, "FLR-2012.json", [DONKI_FLARES[0] | {"beginTime": "2012-06-07T12:00Z", "peakTime": None}])
    assert refresh_events(settings).bursts == 1
    assert FLARE not in near(settings)
    assert FLARE_OF_SWPC in near(settings)


def test_a_burst_loses_an_event_that_was_moved_to_another_year(settings: Settings) -> None:
    refresh_events(settings)
    put(settings, "FLR-2012.json", [DONKI_FLARES[0] | {"beginTime": "2014-06-07T12:00Z", "peakTime": None}])
    assert refresh_events(settings).bursts == 1
    assert FLARE not in near(settings)


def test_the_same_flare_in_two_files_is_one_event(settings: Settings) -> None:
    assert settings.events is not None
    (settings.events / "copies").mkdir()
    put(settings, "copies/again.txt", SWPC)
    refresh_events(settings)
    assert known(settings).count(FLARE_OF_SWPC) == 1
    assert set(lists(settings)) == {*FILES, "copies/again.txt"}


def test_simulated_bursts_are_linked_to_nothing(settings: Settings) -> None:
    simulated = replace(synthetic_burst(burst_id="SIM-20120607-1929"), origin=Origin.SIMULATED)
    with Catalogue.open(settings.catalogue_url) as catalogue:
        published(settings, catalogue, burst=simulated, frequencies=FEW)
    refresh_events(settings)
    assert near(settings, simulated.burst_id) == set()


def test_hidden_and_other_files_are_not_lists(settings: Settings) -> None:
    put(settings, ".partial.json", "{")
    put(settings, "README.md", "lists")
    refresh_events(settings)
    assert set(lists(settings)) == set(FILES)


def test_a_list_that_cannot_be_read_is_refused(settings: Settings) -> None:
    assert settings.events is not None
    path = settings.events / "CME-2012.json"
    path.unlink()
    path.symlink_to("/proc/self/mem")  # a file whose beginning nobody can read, root neither
    refresh_events(settings)
    assert lists(settings)["CME-2012.json"].state == "refused"


@pytest.mark.parametrize(
    ("folder", "said"), [(lambda _: None, "set BELLA_EVENTS"), (lambda home: home / "nowhere", "is no folder")]
)
def test_a_folder_that_is_not_there_is_named(folder: Callable[[Path], Path | None], said: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=said):
        refresh_events(Settings(home=tmp_path, database_url=None, events=folder(tmp_path)))


def test_the_fetcher_brings_the_daily_flares_of_noaa(tmp_path: Path) -> None:
    settings = Settings(home=tmp_path, database_url=None, events=tmp_path / "lists", recent_days=5)
    day = datetime(2012, 6, 7, tzinfo=UTC).date()
    (flares,) = find_datasets(["NOAA_EVENTS"])
    (feed,) = (one for one in feeds(settings, day) if one.datasets == (flares,))
    assert (feed.root, feed.target) == (settings.regions_archive, tmp_path / "lists")
    assert flares.folders(day) == ("stp/space-weather/swpc-products/daily_reports/solar_event_reports/2012/06",)
    assert flares.version("20120607events.txt", day) == (0,)
    assert not any(one.datasets == (flares,) for one in feeds(settings.model_copy(update={"events": None}), day))
