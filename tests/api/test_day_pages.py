"""Searched days over REST and as pages: every burst that was received, placed or not, and what was not searched."""

import re
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, date, datetime, timedelta

import pytest
from fastapi.testclient import TestClient

from api.app import create_app
from bella.catalogue import Catalogue
from bella.records import DayAnswer
from bella.settings import Settings
from tests.api.published import published, settings_of, synthetic_burst
from tests.api.test_pages import page
from tests.catalogue.test_detections import DAY, received

PLACED = "T3-20200721-0300"
GROUP = {"tier": "catalogued", "reason": "not localisable: received by 2 of 3 spacecraft, gap_in_flank at SOLO"}
REFUSED = {"tier": "rejected", "reason": "few_channels_above_0.8_mhz", "burst_id": ""}

TABLE = '<table class="days">'
DRAWN = '<svg class="figure day" viewBox="0 0 400 100"><title>day</title></svg>'


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Settings:
    """Five searched days over three months; the 21st of July has a burst that was placed, and its figure."""
    found = [
        *(received(3, name) for name in ("WIND", "STEREO-A", "SOLO")),
        *(received(7, name, **GROUP) for name in ("WIND", "SOLO")),
        received(8, "JUICE", tier="catalogued", reason="", burst_id=""),
        received(9, **REFUSED),
    ]
    settings = settings_of(tmp_path_factory.mktemp("days"))
    with Catalogue.open(settings.catalogue_url, create=True) as catalogue:
        for offset in (-40, -1, 1, 20):
            catalogue.record_day(replace(DAY, day=DAY.day + timedelta(days=offset)), [])
        catalogue.record_day(replace(DAY, answer=DayAnswer.LOCALISED), found)
        onset = datetime(2020, 7, 21, 3, tzinfo=UTC)
        published(settings, catalogue, burst=synthetic_burst(burst_id=PLACED, start=onset))
        published(settings, catalogue, burst=synthetic_burst())
    figure = settings.day_figure(DAY.day)
    figure.parent.mkdir(parents=True)
    figure.write_text(DRAWN)
    return settings


@pytest.fixture
def reader(home: Settings) -> Iterator[TestClient]:
    with TestClient(create_app(home), raise_server_exceptions=False) as client:
        yield client


def test_days_come_newest_first_with_their_counts(reader: TestClient) -> None:
    reply = reader.get("/api/v1/days", params={"from": "2020-07-20", "to": "2020-07-22"}).json()

    assert [one["day"] for one in reply["days"]] == ["2020-07-22", "2020-07-21", "2020-07-20"]
    one = reply["days"][1]
    counts = [one[name] for name in ("detections", "rejected", "bursts", "shared", "localised")]
    assert counts == [6, 1, 2, 2, 1]
    assert one["observatories"] == ["WIND", "STEREO-A"]
    assert (reply["total"], reply["returned"], reply["truncated"], reply["next"]) == (3, 3, False, None)
    for name in ("self", "page", "figure", "detections"):
        assert reader.get(one["links"][name]).status_code == 200
    assert len(reader.get(one["links"]["detections"]).json()["detections"]) == 7


def test_next_leads_through_all_days_within_the_range(reader: TestClient) -> None:
    path, seen = "/api/v1/days?from=2020-07-01&limit=2", []
    while path:
        reply = reader.get(path).json()
        assert reply["truncated"] == (reply["next"] is not None)
        seen += [one["day"] for one in reply["days"]]
        path = reply["next"]

    assert seen == ["2020-08-10", "2020-07-22", "2020-07-21", "2020-07-20"]


@pytest.mark.parametrize(
    ("query", "word"),
    [
        ("from=2020-07-22&to=2020-07-21", "exchange them"),
        ("from=yesterday", "is not a day"),
        ("limit=367", "limit"),
        ("start=2020-07-21", "start: is not a parameter"),
    ],
)
def test_bad_questions_are_answered_in_one_line_and_on_the_page(reader: TestClient, query: str, word: str) -> None:
    reply = reader.get(f"/api/v1/days?{query}")
    assert (reply.status_code, reply.headers["content-type"]) == (422, "application/problem+json")
    assert word in reply.json()["detail"]

    text = page(reader, f"/days?{query}", 422)
    assert word in text[text.index('id="fault"') :]


def test_the_figure_is_sent_once_and_again_when_it_was_redrawn(reader: TestClient, home: Settings) -> None:
    first = reader.get("/api/v1/days/2020-07-21/figure.svg")
    assert (first.status_code, first.headers["content-type"]) == (200, "image/svg+xml")
    known = {"If-None-Match": first.headers["etag"]}
    assert reader.get("/api/v1/days/2020-07-21/figure.svg", headers=known).status_code == 304

    home.day_figure(DAY.day).write_text(DRAWN.replace(">day<", ">redrawn<"))
    again = reader.get("/api/v1/days/2020-07-21/figure.svg", headers=known)

    assert again.status_code == 200
    assert ">redrawn</title>" in again.text
    missing = reader.get("/api/v1/days/2020-07-22/figure.svg")
    assert missing.status_code == 404
    assert "bella run --from 2020-07-22" in missing.json()["detail"]


def test_the_list_of_days_is_by_month_and_pages(reader: TestClient) -> None:
    text = page(reader, "/days")
    assert re.findall(r'href="/days/([0-9-]+)"', text[: text.index(TABLE)])[-1] == "2020-06-11", "the calendar"
    text = text[text.index(TABLE) :] + text[: text.index(TABLE)]
    assert re.findall(r'scope="rowgroup" colspan="7">([^<]+)<', text) == ["August 2020", "July 2020", "June 2020"]
    assert re.findall(r'href="/days/([0-9-]+)"', text)[0] == "2020-08-10"
    assert "5 days." in text
    row = text[text.index('href="/days/2020-07-21"') :].split("</tr>")[0]
    assert re.findall(r'class="number">(\d+)<', row) == ["6", "2", "2", "1"]

    text = page(reader, "/days?limit=3")
    assert "Showing the newest 3 of 5 days" in text
    (onward,) = re.findall(r'href="(/days\?[^"]+)" rel="next"', text)
    text = page(reader, onward.replace("&amp;", "&"))
    text = text[text.index(TABLE) :]
    assert re.findall(r'href="/days/([0-9-]+)"', text) == ["2020-07-20", "2020-06-11"]
    assert "Newest days" in text


def test_no_day_yet_and_none_in_the_range_are_told_apart(reader: TestClient) -> None:
    text = page(reader, "/days?from=1999-01-01&to=1999-02-01")
    assert 'id="no-match"' in text
    assert 'id="no-days"' not in text
    assert "bella run --from 1999-01-01" in text


def test_an_installation_without_days_says_what_to_run(empty: Settings) -> None:
    with TestClient(create_app(empty)) as client:
        text = page(client, "/days")
    assert 'id="no-days"' in text
    assert "bella run --from" in text
    assert "BELLA_RECENT_DAYS" in text


def test_a_day_shows_bursts_with_why_they_were_not_placed(reader: TestClient) -> None:
    text = page(reader, "/days/2020-07-21")
    groups = re.findall(r"<tbody.*?</tbody>", text[text.index('class="received stack"') : text.index("<details>")])
    assert len(groups) == 3
    assert f'href="/bursts/{PLACED}"' in groups[0]
    assert groups[0].count("<tr>") == 3
    assert 'class="chip good">localised' in groups[0]
    assert "/bursts/" not in groups[1]
    assert "received by 2 of 3 spacecraft, gap in flank at SOLO" in groups[1]
    assert "not localisable" not in text
    assert "JUICE" in groups[2]
    assert "position is not known" in groups[2]
    rejected = text[text.index("<details>") : text.index("</details>")]
    assert "1 rejected candidate<" in rejected
    assert "few channels above 0.8 MHz" in rejected
    assert 'class="figure day"' in text


@pytest.mark.parametrize(
    ("asked", "shown"),
    [
        ("06:00,09:30", "21600,34200"),
        ("20:00,24:00", "72000,86400"),
        ("09:00,06:00", "0,86400"),
        ("09:00,09:05", "0,86400"),
        ("x", "0,86400"),
        ("23:00,24:59", "82800,86400"),
    ],
)
def test_a_part_of_a_day_is_shown_and_a_broken_link_shows_all(home: Settings, asked: str, shown: str) -> None:
    home.day_figure(DAY.day).write_text(DRAWN.replace("<svg ", '<svg data-time="0,86400" '))
    with TestClient(create_app(home)) as client:
        text = page(client, f"/days/2020-07-21?t={asked}")
    assert f'data-time="{shown}"' in text
    assert ('aria-current="true">whole day' in text) == (shown == "0,86400")


def test_the_calendar_is_a_file_of_any_kind_with_its_caption(reader: TestClient) -> None:
    listed = page(reader, "/days?from=2020-07-01&to=2020-08-31")
    for kind, begins in (("svg", b"<svg "), ("png", b"\x89PNG"), ("pdf", b"%PDF")):
        address = f"/days/calendar.{kind}?from=2020-07-01&to=2020-08-31"
        assert f'href="{address.replace("&", "&amp;")}"' in listed
        made = reader.get(address)
        assert made.content.startswith(begins)
        assert made.headers["content-disposition"] == f'inline; filename="bella_days_2020-07-20_2020-08-10.{kind}"'
    kept = " ".join(reader.get("/days/calendar.svg?from=2020-07-01&to=2020-08-31").text.replace("</text>", " ").split())
    assert "Searched days from 2020-07-20 to 2020-08-10." in kept
    assert "/days?from=2020-07-01" in kept
    assert reader.get("/days/calendar.svg?from=1990-01-01&to=1990-01-02").status_code == 404
    assert reader.get("/days/calendar.svg?from=never").status_code == 422
    assert reader.get("/days/calendar.gif").status_code == 422


def test_a_day_leads_to_the_searched_days_beside_it(reader: TestClient) -> None:
    text = page(reader, "/days/2020-07-22")
    assert re.search(r'href="/days/2020-07-21" rel="prev"', text)
    assert re.search(r'href="/days/2020-08-10" rel="next"', text)
    assert 'rel="next"' not in page(reader, "/days/2020-08-10")


def test_a_quiet_day_that_is_not_drawn_says_both(reader: TestClient) -> None:
    text = page(reader, "/days/2020-07-22")
    assert 'id="quiet"' in text
    assert 'id="not-drawn"' in text
    assert "<img" not in text[text.index('id="main"') :]
    assert "<details>" not in text


def test_a_day_that_was_not_searched_says_what_to_run(reader: TestClient) -> None:
    text = page(reader, "/days/2020-07-23", 404)
    assert "2020-07-23 was not searched: run bella run --from 2020-07-23" in text
    assert 'href="/days"' in text
    assert "is not a day" in page(reader, "/days/today", 422)
    assert page(reader, f"/days/{date.max}", 404)


def test_bursts_and_the_catalogue_lead_to_days(reader: TestClient) -> None:
    assert f'href="/days/2020-07-21?burst={PLACED}#{PLACED}"' in page(reader, f"/bursts/{PLACED}")
    assert f'id="{PLACED}"' in page(reader, "/days/2020-07-21")
    assert "/days/2012" not in page(reader, f"/bursts/{synthetic_burst().burst_id}"), "that day was not searched"
    main = page(reader, "/")
    assert 'href="/days"' in main[main.index('id="main"') :]


def test_reasons_cannot_write_into_the_page(empty: Settings) -> None:
    with Catalogue.open(empty.catalogue_url) as catalogue:
        catalogue.record_day(DAY, [received(3, reason="<script>alert(1)</script>", tier="catalogued")])
    with TestClient(create_app(empty)) as client:
        assert "<script>alert" not in page(client, "/days/2020-07-21")


def test_answers_about_days_look_different_and_say_why(empty: Settings) -> None:
    reason = "WIND: its records are 900 s apart, too coarse"
    days = {DAY.day + timedelta(days=number): answer for number, answer in enumerate(DayAnswer)}
    with Catalogue.open(empty.catalogue_url) as catalogue:
        for day, answer in days.items():
            catalogue.record_day(replace(DAY, day=day, answer=answer, reason=reason), [])
    with TestClient(create_app(empty)) as client:
        listed = page(client, "/days")
        calendar, listed = listed[: listed.index(TABLE)], listed[listed.index(TABLE) :]
        sentences = set()
        for day, answer in days.items():
            name = f"answer-{answer.replace(' ', '-')}"
            row = listed[listed.index(f'href="/days/{day}"') :].split("</tr>")[0]
            assert name in row
            assert f"strip {name}" in calendar
            assert f">{answer}</span>" in row
            assert reason in row
            text = page(client, f"/days/{day}")
            (said,) = re.findall(rf'class="day-answer {name}" id="day-answer">(.*?)</p>', text)
            sentences.add(said)
            assert reason in text[text.index('id="day-reason"') :]
            assert ('id="unsearched"' in text) == (answer in {"no data", "archive silent", "not searchable"})
            assert f".{name} " in client.get("/static/bella.css").text
    assert len(sentences) == len(DayAnswer)
