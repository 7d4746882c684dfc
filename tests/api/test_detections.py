"""Detections and days over REST: no data, no burst and not localised are three answers."""

from collections.abc import Iterator
from dataclasses import replace

import pytest
from fastapi.testclient import TestClient

from api.app import create_app
from bella.catalogue import Catalogue
from bella.settings import Settings
from tests.catalogue.test_detections import DAY, received


@pytest.fixture
def searched(empty: Settings) -> Iterator[TestClient]:
    """A day with a burst that was placed, one that was not, and a candidate that was refused."""
    group = {"tier": "catalogued", "reason": "not localisable: group", "isolated": False}
    refused = {"tier": "rejected", "reason": "no_drift", "burst_id": ""}
    with Catalogue.open(empty.catalogue_url) as catalogue:
        catalogue.record_day(DAY, [received(3), replace(received(7), **group), replace(received(9), **refused)])
    with TestClient(create_app(empty), raise_server_exceptions=False) as reader:
        yield reader


def test_detections_come_by_onset_with_their_reasons(searched: TestClient) -> None:
    reply = searched.get(
        "/api/v1/detections", params={"start": "2020-07-21", "stop": "2020-07-22", "sort": "start"}
    ).json()

    assert [(one["tier"], one["reason"], one["burst_id"]) for one in reply["detections"]] == [
        ("localisable", "", "T3-20200721-0300"),
        ("catalogued", "not localisable: group", "T3-20200721-0700"),
        ("rejected", "no_drift", None),
    ]
    assert reply["detections"][0]["start_utc"] == "2020-07-21T03:00:00Z"
    assert (reply["returned"], reply["truncated"]) == (3, False)


def test_a_short_reply_says_that_there_are_more(searched: TestClient) -> None:
    wanted = {"start": "2020-07-21", "stop": "2020-07-22", "limit": 2}
    reply = searched.get("/api/v1/detections", params=wanted).json()

    assert (reply["returned"], reply["truncated"], reply["total"]) == (2, True, 3)
    rest = searched.get(reply["next"]).json()
    assert (rest["returned"], rest["truncated"], rest["next"]) == (1, False, None)
    onsets = [one["start_utc"] for page in (reply, rest) for one in page["detections"]]
    assert onsets == sorted(onsets, reverse=True)
    assert len(set(onsets)) == 3
    assert searched.get(f"{reply['next']}&tier=rejected").status_code == 422


def test_detections_are_of_one_tier_burst_or_spacecraft(searched: TestClient) -> None:
    for query, total in (
        ("tier=rejected", 1),
        ("burst=T3-20200721-0700", 1),
        ("observatory=wind", 3),
        ("observatory=PSP&tier=&start=", 0),
    ):
        assert searched.get(f"/api/v1/detections?{query}").json()["total"] == total
    assert "'localisable', 'catalogued' or 'rejected'" in searched.get("/api/v1/detections?tier=good").text


def test_days_go_on_at_a_cursor(searched: TestClient, empty: Settings) -> None:
    with Catalogue.open(empty.catalogue_url) as catalogue:
        for day in (19, 20):
            catalogue.record_day(replace(DAY, day=DAY.day.replace(day=day)), [])
    reply, days = searched.get("/api/v1/days?limit=1").json(), []
    while True:
        days += [one["day"] for one in reply["days"]]
        assert (reply["total"], reply["truncated"]) == (3, reply["next"] is not None)
        if reply["next"] is None:
            break
        following = reply["next"]
        reply = searched.get(following).json()
    assert days == ["2020-07-21", "2020-07-20", "2020-07-19"]
    assert searched.get(f"{following}&from=2020-07-01").status_code == 422


def test_a_day_says_who_had_data_and_whether_it_was_searched(searched: TestClient) -> None:
    known, unknown = (searched.get(f"/api/v1/days/{day}").json() for day in ("2020-07-21", "2020-07-22"))

    assert (known["searched"], known["observatories"], known["code_version"]) == (True, ["WIND", "STEREO-A"], "0.2.0")
    assert (unknown["searched"], unknown["observatories"], unknown["code_version"]) == (False, [], None)


@pytest.mark.parametrize(
    ("path", "word"),
    [
        ("/api/v1/detections?start=2020-07-22&stop=2020-07-21", "exchange them"),
        ("/api/v1/detections?start=noon&stop=2020-07-21", "write a UTC time"),
        ("/api/v1/detections?cursor=x", "cursor: is not one of ours"),
        ("/api/v1/detections?start=2020-07-21&stop=2020-07-22&observatries=WIND", "observatries"),
        ("/api/v1/days/yesterday", "is not a day"),
    ],
)
def test_bad_questions_are_answered_in_one_line(searched: TestClient, path: str, word: str) -> None:
    reply = searched.get(path)

    assert reply.status_code in {400, 422}
    assert word in reply.text
