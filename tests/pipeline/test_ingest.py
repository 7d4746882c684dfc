"""Ingest against real servers on the loopback: what is due is asked for, an outage takes nothing away."""

import json
import os
import signal
import socket
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack, closing, suppress
from datetime import UTC, date, datetime, timedelta
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from bella.archive import Manners, Received, find_datasets, mirror, open_archive, received, set_aside, versions
from bella.catalogue import Catalogue, EventQuery, Freshness
from bella.cli import app
from bella.exceptions import InputError
from bella.pipeline.ingest import EPHEMERIS, EPHEMERIS_EVERY, Stopped, bring_up_to_date, follow, pause
from bella.pipeline.linked_events import refresh_events
from bella.settings import Settings
from bella.spacecraft.ephemeris import read_nodes
from bella.spacecraft.horizons import HORIZONS_IDS
from tests.archive.server import Server, body, cdf, cut_after, path_of, status, visible, whole_without_length
from tests.commands import BELLA
from tests.spacecraft.horizons_server import SIGNATURE, horizons, vectors
from tests.waiting import PATIENCE_S, until

NOW = datetime(2026, 11, 28, 12, tzinfo=UTC)
DAY, HOUR = timedelta(days=1), timedelta(hours=1)
(K0, STEREO, WIND) = find_datasets(["WI_K0_WAV", "STEREO_LEVEL2_SWAVES", "WI_L2_WAV_RAD1"])
OMNI = "pub/data/omni/low_res_omni/omni2_2026.dat"
SRS = "stp/space-weather/swpc-products/daily_reports/solar_region_summaries/2026/11/20261127SRS.txt"


class World:
    """An archive, a Horizons, and a home folder that is filled from them."""

    def __init__(self, archive: Server, horizons_url: str, home: Path) -> None:
        self.archive = archive
        self.settings = Settings(
            home=home,
            archive=archive.url,
            regions_archive=archive.url,
            horizons_url=horizons_url,
            archive_interval_s=0.001,
            archive_timeout_s=5,
            recent_days=3,
            in_situ=home / "mirror" / "in-situ",
            regions=home / "mirror" / "regions",
        )
        home.mkdir()
        for dataset in find_datasets(()):  # each folder is there, so that no data set is silent
            for year in (2025, 2026):
                archive.put(f"{dataset.folders(date(year, 1, 1))[0]}/readme.txt", b"x")
        for name in ("omni/low_res_omni", *(f"{one}/coho1hr_magplasma/cdf/2026" for one in COHO)):
            archive.put(f"pub/data/{name}/readme.txt", b"x")
        for month in ("10", "11"):
            archive.put(f"{SRS.rpartition('/')[0][:-2]}{month}/readme.txt", b"x")

    def freshness(self) -> dict[str, Freshness]:
        with closing(Catalogue.open(self.settings.catalogue_url)) as catalogue:
            return {one.dataset: one for one in catalogue.operation.freshness()}

    def mirrored(self) -> list[str]:
        return [Path(name).name for name in visible(self.settings.mirror_root)]


COHO = ("psp", "stereo/ahead", "solar-orbiter")


@pytest.fixture
def world(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[World]:
    monkeypatch.setenv("no_proxy", "127.0.0.1")
    monkeypatch.setattr(mirror, "Manners", partial(Manners, sleep=lambda _: None))  # the waits: tests/archive
    with ExitStack() as stack:
        url, _ = stack.enter_context(horizons(vectors))
        yield World(stack.enter_context(Server()), url, tmp_path / "home")


def test_one_round_brings_spectra_winds_regions_and_positions(world: World) -> None:
    k0 = world.archive.put(path_of(K0, date(2026, 11, 27)), cdf())
    world.archive.put(OMNI, b"2026 331 0 400.0\n")
    world.archive.put(SRS, b":Product: 1127SRS.txt\n")
    done = bring_up_to_date(world.settings, NOW)
    known = world.freshness()
    assert known["WI_K0_WAV"].state == "ok"
    assert known["WI_K0_WAV"].newest_day == date(2026, 11, 27)
    assert known["WI_K0_WAV"].next_utc == NOW + HOUR
    assert known["STEREO_LEVEL2_SWAVES"].state == "no file yet"
    assert known["OMNI2_HOURLY"].newest_day == NOW.date()
    assert known["NOAA_SRS"].newest_day == date(2026, 11, 27)
    assert {one.state for one in known.values()} == {"ok", "no file yet"}
    assert (world.settings.mirror_root / k0).read_bytes() == cdf()
    assert next(world.settings.in_situ.rglob("omni2_2026.dat")).is_file()  # type: ignore[union-attr]
    assert next(world.settings.regions.rglob("20261127SRS.txt")).is_file()  # type: ignore[union-attr]
    until = {body: np.datetime64("2000-01-01", "ms") + ms[-1] for body, (ms, _) in read_nodes(_table(world)).items()}
    assert min(until.values()) > np.datetime64("2027-11-27")
    assert set(until) >= {"STEREO-A"}
    assert done.new_days[-2:] == (date(2026, 11, 27), date(2026, 11, 28))
    assert received([world.settings.mirror_root / k0]) == Received(NOW, NOW)


def _table(world: World) -> Path:
    return world.settings.ephemeris_extension


def test_latency_decides_when_to_ask(world: World) -> None:
    bring_up_to_date(world.settings, NOW)
    world.archive.asked.clear()
    bring_up_to_date(world.settings, NOW + 0.9 * HOUR)
    assert world.archive.asked == []
    later = bring_up_to_date(world.settings, NOW + 1.1 * HOUR)
    assert {one.dataset for one in later.asked} == {"WI_K0_WAV", "NOAA_SRS"}
    assert [pause(days) for days in (1, 2, 15, 125)] == [HOUR, 2 * HOUR, 15 * HOUR, DAY]


def test_an_outage_takes_nothing_away_and_is_told_apart_from_no_file(world: World) -> None:
    k0 = world.archive.put(path_of(K0, date(2026, 11, 27)), cdf())
    bring_up_to_date(world.settings, NOW)
    before = world.freshness()
    world.archive.faults.update({f"{K0.folders(NOW.date())[0]}/": [status(403)] * 99})
    for number in range(1, 4):
        bring_up_to_date(world.settings, NOW + number * HOUR)
    known = world.freshness()["WI_K0_WAV"]
    assert known.state == "silent"
    assert known.silent_since_utc == NOW + HOUR
    assert known.answered_utc == before["WI_K0_WAV"].answered_utc == NOW
    assert known.newest_day == date(2026, 11, 27)
    assert known.failures == 3
    assert "403" in known.message
    assert known.next_utc == NOW + 3 * HOUR + timedelta(minutes=20)  # 5, 10, 20 minutes
    assert (world.settings.mirror_root / k0).read_bytes() == cdf()
    world.archive.faults.clear()
    bring_up_to_date(world.settings, NOW + 4 * HOUR)
    assert world.freshness()["WI_K0_WAV"].state == "ok"


def test_a_file_that_the_archive_no_longer_lists_stays(world: World) -> None:
    k0 = world.archive.put(path_of(K0, date(2026, 11, 27)), cdf())
    bring_up_to_date(world.settings, NOW)
    del world.archive.files[k0]
    bring_up_to_date(world.settings, NOW + 2 * DAY)
    assert (world.settings.mirror_root / k0).read_bytes() == cdf()
    assert world.freshness()["WI_K0_WAV"].newest_day == date(2026, 11, 27)


def test_a_new_version_is_fetched_and_a_held_file_is_asked_for_ever_more_seldom(world: World) -> None:
    first = world.archive.put(path_of(K0, date(2026, 11, 27)), cdf())
    bring_up_to_date(world.settings, NOW)
    world.archive.put(path_of(K0, date(2026, 11, 27), "02"), cdf(1))
    done = bring_up_to_date(world.settings, NOW + HOUR)
    assert done.new_days == (date(2026, 11, 27), NOW.date())[:1]
    assert world.mirrored() == [Path(first).name, Path(first).name.replace("v01", "v02")]
    stereo = world.archive.put(path_of(STEREO, date(2026, 11, 27)), cdf(2))
    settings = world.settings.model_copy(update={"recent_days": 30})
    # fetched, then asked for again after 1, 2, 4 and 8 days, and not in the rounds between
    for hours in (2, 14, 27, 40, 52, 77, 104, 149, 210):
        bring_up_to_date(settings, NOW + hours * HOUR)
    assert len(world.archive.asked_for(stereo)) == 5


def test_a_file_replaced_under_its_name_is_noticed(world: World) -> None:
    stereo = world.archive.put(path_of(STEREO, date(2026, 11, 27)), cdf())
    bring_up_to_date(world.settings, NOW)
    world.archive.put(stereo, cdf(1))
    assert bring_up_to_date(world.settings, NOW + 25 * HOUR).new_days == (date(2026, 11, 27),)
    assert (world.settings.mirror_root / stereo).read_bytes() == cdf(1)
    assert len(versions(world.settings.mirror_root / stereo)) == 2


def test_a_file_that_was_set_aside_is_asked_for_again(world: World) -> None:
    k0 = world.archive.put(path_of(K0, date(2026, 11, 27)), cdf())
    bring_up_to_date(world.settings, NOW)
    held = world.settings.mirror_root / k0
    held.write_bytes(b"damaged")
    set_aside(held, "not a CDF file")
    assert world.mirrored() == []
    assert held.with_name(f".{held.name}.damaged.txt").read_text() == "not a CDF file\n"
    bring_up_to_date(world.settings, NOW + HOUR)
    assert held.read_bytes() == cdf()


def test_a_file_that_was_cut_on_the_disk_is_set_aside_and_fetched_anew(world: World) -> None:
    k0 = world.archive.put(path_of(K0, date(2026, 11, 27)), cdf())
    bring_up_to_date(world.settings, NOW)
    held = world.settings.mirror_root / k0
    held.write_bytes(cdf()[:1000])
    bring_up_to_date(world.settings, NOW + HOUR)
    assert held.read_bytes() == cdf()
    assert held.with_name(f".{held.name}.damaged").read_bytes() == cdf()[:1000]
    assert "it has 1000 bytes" in held.with_name(f".{held.name}.damaged.txt").read_text()


@pytest.mark.parametrize(
    ("wrong", "state", "again"),
    [
        ((503, ""), ("silent", 1), timedelta(minutes=6)),
        ((200, SIGNATURE + "No ephemeris for target after A.D. 2026"), ("no file yet", 0), EPHEMERIS_EVERY),
    ],
)
def test_a_wrong_answer_about_one_body_keeps_the_others(
    world: World, wrong: tuple[int, str], state: tuple[str, int], again: timedelta
) -> None:
    def answer(query: dict[str, str]) -> tuple[int, str]:
        return wrong if query["COMMAND"] == HORIZONS_IDS["STEREO-A"] else vectors(query)

    with horizons(answer) as (url, _):
        settings = world.settings.model_copy(update={"horizons_url": url})
        bring_up_to_date(settings, NOW)
    known = world.freshness()[EPHEMERIS]
    assert (known.state, known.failures) == state
    assert "STEREO-A" not in read_nodes(_table(world))
    bring_up_to_date(world.settings, NOW + again)
    assert world.freshness()[EPHEMERIS].state == "ok"
    assert "STEREO-A" in read_nodes(_table(world))


def test_nothing_is_fetched_that_no_setting_asks_for(world: World) -> None:
    settings = world.settings.model_copy(update={"recent_days": 0, "in_situ": None, "regions": None})
    assert [one.dataset for one in bring_up_to_date(settings, NOW).asked] == [EPHEMERIS]
    assert world.archive.asked == []


def test_follow_survives_outages_and_ends_when_it_is_told_to(world: World, tmp_path: Path) -> None:
    world.archive.faults[f"{K0.folders(NOW.date())[0]}/"] = [status(403)] * 99
    environment = {
        "PATH": os.environ["PATH"],
        "no_proxy": "127.0.0.1",
        "BELLA_HOME": str(world.settings.home),
        "BELLA_ARCHIVE": world.archive.url,
        "BELLA_ARCHIVE_INTERVAL_S": "0.001",
        "BELLA_ARCHIVE_TIMEOUT_S": "1",
        "BELLA_RECENT_DAYS": "1",
        "BELLA_HORIZONS_URL": f"http://127.0.0.1:{_closed_port()}/",
    }
    with (tmp_path / "log").open("wb") as log:
        process = subprocess.Popen([BELLA, "fetch", "--follow"], env=environment, stdout=log, stderr=log)
    until(lambda: b'"round"' in (tmp_path / "log").read_bytes() or process.poll() is not None)
    assert process.poll() is None, (tmp_path / "log").read_text()
    process.send_signal(signal.SIGTERM)
    assert process.wait(PATIENCE_S) == 0, (tmp_path / "log").read_text()
    known = world.freshness()
    assert known[EPHEMERIS].state == "silent"
    assert "STEREO_LEVEL2_SWAVES" in known
    assert (world.settings.mirror_root / ".alive").is_file()
    assert "Traceback" not in (tmp_path / "log").read_text()


def test_follow_ends_although_something_swallows_the_signal_and_leaves_the_handlers_as_they_were(world: World) -> None:
    before, beats = signal.getsignal(signal.SIGTERM), []
    signal.set_wakeup_fd(-1)  # an event loop of another test may have left its own, closed

    def swallow() -> None:
        for _ in range(2):  # whoever stops a service may do so twice
            with suppress(Stopped):
                signal.raise_signal(signal.SIGTERM)
        beats.append(1)

    settings = world.settings.model_copy(update={"recent_days": 0, "in_situ": None, "regions": None})
    follow(settings, swallow)
    first = world.freshness()
    follow(settings, swallow)  # nothing is due
    follow(settings.model_copy(update={"recent_days": 1, "archive": "/nowhere"}), swallow)  # the round fails
    assert (len(beats) >= 3, world.freshness()) == (True, first)
    follow(world.settings, lambda: signal.raise_signal(signal.SIGINT))
    assert signal.getsignal(signal.SIGTERM) == before


def _closed_port() -> int:
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        return int(unused.getsockname()[1])


@pytest.mark.parametrize(
    ("options", "variables", "said"),
    [
        (["--follow"], {"BELLA_RECENT_DAYS": "0"}, "set BELLA_RECENT_DAYS"),
        (["--follow", "--from", "2012-06-07"], {}, "takes no days"),
        ([], {}, "give --follow"),
        (["--follow"], {"BELLA_RECENT_DAYS": "2", "BELLA_ARCHIVE": "/nowhere"}, "neither an http"),
    ],
)
def test_bad_input_is_one_line(tmp_path: Path, options: list[str], variables: dict[str, str], said: str) -> None:
    variables = {"BELLA_HOME": str(tmp_path / "home"), **variables}
    done = CliRunner().invoke(app, ["fetch", *options], env=variables)
    assert isinstance(done.exception, InputError)
    assert said in str(done.exception)
    assert not (tmp_path / "home").exists()


DONKI = {
    "FLR": {
        "flrID": "2026-11-27T10:00:00-FLR-001",
        "beginTime": "2026-11-27T10:00Z",
        "classType": "M1.0",
        "sourceLocation": "N10W20",
    },
    "CME": {"activityID": "2026-11-27T11:00:00-CME-001", "startTime": "2026-11-27T11:00Z"},
    "SEP": {"sepID": "2026-11-27T12:00:00-SEP-001", "eventTime": "2026-11-27T12:00Z", "instruments": []},
}
NOVEMBER = "startDate=2026-11-01&endDate=2026-11-30"
GOES = "json/goes/primary/xray-flares-7-day.json"
FLARES = f"DONKI/WS/get/FLR?{NOVEMBER}"


@pytest.fixture
def with_events(world: World) -> World:
    """The archive answers as DONKI and as SWPC, too."""
    lists = world.settings.home / "lists"
    more = {"events": lists, "donki_archive": world.archive.url, "swpc_archive": f"{world.archive.url}/"}
    world.settings = world.settings.model_copy(update=more)
    for kind, row in DONKI.items():
        world.archive.put(f"DONKI/WS/get/{kind}?{NOVEMBER}", json.dumps([row]).encode())
    flare = {
        "begin_time": "2026-11-28T09:00:00Z",
        "max_time": "2026-11-28T09:10:00Z",
        "max_class": "C2.0",
        "satellite": 18,
    }
    world.archive.put(GOES, json.dumps([flare]).encode())
    world.archive.put("json/edited_events.json", b"[]")
    return world


def events_of(world: World) -> set[str]:
    refresh_events(world.settings, NOW)
    with closing(Catalogue.open(world.settings.catalogue_url)) as catalogue:
        return {one.event.event_id for one in catalogue.events.events(EventQuery()).events}


def test_events_of_donki_and_swpc_are_fetched_and_read(with_events: World) -> None:
    world = with_events
    bring_up_to_date(world.settings, NOW)
    lists = world.settings.events
    assert lists
    assert {one.name for one in lists.iterdir() if not one.name.startswith(".")} == {
        "edited_events.json",
        "xray-flares-7-day.json",
        *(f"DONKI-{kind}-20261101.json" for kind in DONKI),
    }
    found = events_of(world)
    assert {one.partition(":")[0] for one in found} == {"DONKI", "GOES"}
    assert len(found) == 4
    known = world.freshness()
    assert {known[f"DONKI_{kind}"].state for kind in DONKI} == {known["GOES_FLARES"].state} == {"ok"}
    assert known["DONKI_FLR"].next_utc == NOW + HOUR
    bring_up_to_date(world.settings, NOW + 1.1 * HOUR)
    first, again = world.archive.asked_for(FLARES)
    assert "If-None-Match" in again
    assert "If-None-Match" not in first


def test_a_month_that_is_over_is_asked_for_more_and_more_seldom(with_events: World) -> None:
    world = with_events
    december = datetime(2026, 12, 2, 12, tzinfo=UTC)
    present = FLARES.replace(NOVEMBER, "startDate=2026-12-01&endDate=2026-12-31")
    world.archive.put(present, b"[]")
    asked = []
    for hours in (0, 2, 4, 47, 49):
        bring_up_to_date(world.settings, december + hours * HOUR)
        asked.append((len(world.archive.asked_for(present)), len(world.archive.asked_for(FLARES))))
    assert asked == [(1, 1), (2, 2), (3, 3), (4, 4), (5, 4)]


@pytest.mark.parametrize(
    "fault",
    [
        status(404),
        status(403),
        body(b"<html>maintenance</html>"),
        body(b""),
        whole_without_length(b'[{"flrID": "2026-11-27T10:00'),
        cut_after(20),
    ],
    ids=["not there", "forbidden", "a page", "nothing", "a part", "cut"],
)
def test_a_service_that_fails_takes_no_event_away(with_events: World, fault: Any) -> None:
    world = with_events
    bring_up_to_date(world.settings, NOW)
    before = events_of(world)
    world.archive.put(FLARES, json.dumps([DONKI["FLR"], DONKI["FLR"] | {"flrID": "other"}]).encode())
    world.archive.faults[FLARES] = [fault] * 9
    bring_up_to_date(world.settings, NOW + 2 * HOUR)
    known = world.freshness()["DONKI_FLR"]
    assert (known.state, known.silent_since_utc) == ("silent", NOW + 2 * HOUR)
    assert world.freshness()["DONKI_CME"].state == "ok"
    assert events_of(world) == before
    world.archive.faults.clear()
    bring_up_to_date(world.settings, NOW + 3 * HOUR)
    assert len(events_of(world)) == len(before) + 1


def test_services_without_an_address_are_not_asked(with_events: World) -> None:
    world = with_events
    world.settings = world.settings.model_copy(update={"donki_archive": "", "swpc_archive": ""})
    bring_up_to_date(world.settings, NOW)
    assert not {one for one in world.freshness() if one.startswith(("DONKI", "GOES", "SWPC"))}
    assert not any("DONKI" in path or path.startswith("json") for path, _ in world.archive.asked)


def test_a_month_of_events_is_fetched_by_its_day(with_events: World, tmp_path: Path) -> None:
    (flares,) = find_datasets(["DONKI_FLR"])
    with_events.archive.put(FLARES.replace("2026-11-", "2012-06-"), b"[]")
    done = open_archive(with_events.archive.url, interval_s=0.001).fetch(flares, date(2012, 6, 7), tmp_path)
    assert [one.path for one in done.files] == [tmp_path / "DONKI-FLR-20120601.json"]
    assert (done.state, done.complete) == ("fetched", True)
    assert [flares.span(date(2024, month, 9))[1].day for month in (2, 12)] == [29, 31]
