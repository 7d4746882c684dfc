"""A thousand bursts a day: pages stay bounded, and nothing is lost."""

import re
import sqlite3
from collections.abc import Iterator
from datetime import datetime, timedelta

import pytest
from fastapi.testclient import TestClient

from api.app import create_app
from bella.catalogue import Catalogue, SearchedDay
from bella.plotting.svg import element, figure
from bella.settings import Settings
from tests.api.published import ONSET, published, settings_of
from tests.api.test_pages import page
from tests.catalogue.test_detections import received
from tests.plotting.synthetic import BURST_ID

COUNT, NAMES = 1000, ("WIND", "STEREO-A", "STEREO-B")
DAY = ONSET.date()


def onset(number: int) -> datetime:
    return ONSET.replace(hour=0, minute=0, second=0) + timedelta(seconds=80 * number)


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Settings:
    """A day with a thousand bursts that three spacecraft received, and as many that were rejected."""
    settings = settings_of(tmp_path_factory.mktemp("crowd"))
    rows = [
        received(0, name, start_utc=onset(n), end_utc=onset(n + 1), burst_id=f"T3-{n:04d}")
        for n in range(COUNT)
        for name in NAMES
    ]
    rejected = [received(0, start_utc=onset(n), tier="rejected", burst_id="") for n in range(COUNT)]
    with Catalogue.open(settings.catalogue_url, create=True) as catalogue:
        published(settings, catalogue)
        catalogue.record_day(SearchedDay(DAY, "a" * 64, "0.2.0", NAMES), [*rows, *rejected])
    with sqlite3.connect(settings.home / "catalogue.sqlite") as database:
        for number in range(COUNT - 1):
            for table in ("burst", "burst_observatory", "solution", "localisation", "preference", "track_fit"):
                copy(database, table, number)
    path = settings.day_figure(DAY)
    path.parent.mkdir(parents=True)
    boxes = [element("a", href=f"#T3-{number:04d}") for number in (3, 750)]
    path.write_text(figure("day", (100, 100), "drawn", *boxes))
    return settings


def copy(database: sqlite3.Connection, table: str, number: int) -> None:
    """Add the rows of the one burst again, under another id and, for the burst itself, at another time."""
    names = [row[1] for row in database.execute(f"pragma table_info({table})")]
    ids = {"burst_id", "solution_id", "store_path", "answer_id"}
    new, moment = f"T3-{number:04d}", onset(number).strftime("%Y-%m-%d %H:%M:%S.%f")
    chosen = [
        f"replace({name}, '{BURST_ID}', '{new}')"
        if name in ids
        else f"'{moment}'"
        if (table, name) == ("burst", "start_utc")
        else name
        for name in names
        if name != "id"
    ]
    own = "burst_id" if "burst_id" in names else "solution_id"
    database.execute(
        f"insert into {table} ({', '.join(n for n in names if n != 'id')}) "
        f"select {', '.join(chosen)} from {table} where {own} like '{BURST_ID}%'"
    )


@pytest.fixture
def reader(home: Settings) -> Iterator[TestClient]:
    with TestClient(create_app(home)) as client:
        yield client


def test_a_day_comes_in_parts_and_nothing_is_lost(reader: TestClient) -> None:
    seen: list[str] = []
    for part in range(1, 6):
        text = page(reader, f"/days/{DAY}?part={part}")
        assert len(text) < 450_000
        seen += re.findall(r'<tbody id="([^"]+)"', text)
    assert seen == [f"T3-{number:04d}" for number in range(COUNT)]
    first = page(reader, f"/days/{DAY}")
    assert "1000 bursts, from" in first
    assert "1000 rejected candidates" in first
    assert first.count("Why it is no burst") == 1
    assert '"#T3-0003"' in first
    assert f'"/days/{DAY}?burst=T3-0750#T3-0750"' in first
    assert 'id="T3-0750"' in page(reader, f"/days/{DAY}?burst=T3-0750")
    assert 'id="T3-0750"' not in page(reader, f"/days/{DAY}?burst=T3-0750&part=1"), "a part that is asked for is shown"
    assert 'id="T3-0003"' in page(reader, f"/days/{DAY}?burst=T3-nowhere")
    assert 'id="T3-0750"' in page(reader, f"/days/{DAY}?part=4")
    for wrong in ("0", "6", "x", "-1", "1" * 30):
        assert reader.get(f"/days/{DAY}?part={wrong}", headers={"Accept": "text/html"}).status_code == 422, wrong


def test_the_list_is_cut_and_its_figures_are_of_all(reader: TestClient) -> None:
    text = page(reader, "/")
    assert len(text) < 400_000
    assert "Showing 50 of 1000 bursts" in text
    assert "Figures of these 1000 bursts" in text
    assert text.count('class="figure thumbnail"') == 50
    large = page(reader, "/?limit=1000")
    assert len(large) < 1_200_000
    assert large.count('class="figure thumbnail"') == 0
    assert large.count('<th scope="row" class="when">') == COUNT
    kept = reader.get("/api/v1/figures/longitude.svg")
    assert len(kept.content) < 100_000
    assert kept.text.count("h0") == COUNT
