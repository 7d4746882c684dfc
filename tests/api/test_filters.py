"""Filters and orders of lists of bursts: alike in JSON, in tables, and for the newest one."""

from collections.abc import Iterator
from datetime import timedelta
from typing import Any
from urllib.parse import urlencode

import httpx
import pytest
from fastapi.testclient import TestClient

from api.app import create_app
from api.queries import BurstFilter, BurstSelection, BurstSort
from bella.catalogue import BURST_SORTS, RANGES, Catalogue
from bella.catalogue.records import METHOD_ORDER
from bella.formats import BURSTS
from bella.settings import Settings
from tests.api.published import settings_of
from tests.catalogue.examples import START, burst, fitted, localisation, publication


@pytest.fixture(scope="module")
def placed(tmp_path_factory: pytest.TempPathFactory) -> Settings:
    """A at 26 degrees west, B at 170 east, C at 175 west without a good answer, D without any."""
    settings = settings_of(tmp_path_factory.mktemp("home"))
    settings.store_root.mkdir(parents=True)
    with Catalogue.open(settings.catalogue_url, create=True) as catalogue:
        for hours, (name, longitude, half_width) in enumerate(
            (("A", 26.0, 4.0), ("B", -170.0, 9.0), ("C", 175.0, 30.0))
        ):
            own = burst(name, START + timedelta(hours=hours), f_high_mhz=3.0 * (hours + 1))
            rows = (localisation(0.5, x_rsun=20.0 * (hours + 1), y_rsun=0.0, z_rsun=10.0, area68_rsun2=10.0),)
            fit = fitted(longitude, half_width_deg=half_width)
            flags = ("poor_fit",) if name == "C" else ()
            catalogue.publish(publication(of=own, track_fit=fit, localisations=rows, flags=flags))
        catalogue.publish(publication(of=burst("D", START + timedelta(hours=3)), localisations=()))
    return settings


@pytest.fixture
def reader(placed: Settings) -> Iterator[TestClient]:
    with TestClient(create_app(placed), raise_server_exceptions=False) as opened:
        yield opened


QUESTIONS = [
    ("", "DCBA"),
    ("sort=start", "ABCD"),
    ("sort=longitude", "BACD"),
    ("sort=-longitude", "CABD"),
    ("longitude_min=170&longitude_max=-165", "CB"),
    ("longitude_min=20&longitude_max=30", "A"),
    ("latitude_min=20&latitude_max=30", "A"),
    ("distance_min=50", "C"),
    ("distance_max=50&sort=distance", "AB"),
    ("wind_min=580&wind_max=600", "CBA"),
    ("wind_max=580", ""),
    ("area_min=10&area_max=10", "CBA"),
    ("area_min=10.1", ""),
    ("frequency_min=8&frequency_max=9", "DC"),
    ("grade=A&grade=B", "BA"),
    ("grade=ab", "BA"),
    ("tier=final&flag=poor_fit", "C"),
    ("without_flag=poor_fit", "DBA"),
    ("method=posterior&edge=half_maximum&preset=default&grade=A", "A"),
    ("method=nuts", ""),
    ("updated_since=2012-01-01&grade=A", "A"),
    ("updated_since=2999-01-01", ""),
    ("origin=simulated", ""),
    ("observatory=stereo a&grade=&tier=&wind_min=&flag=&sort=", "DCBA"),
]


@pytest.mark.parametrize(("query", "found"), QUESTIONS)
def test_json_and_tables_find_the_same(reader: TestClient, query: str, found: str) -> None:
    reply = reader.get(f"/api/v1/bursts?{query}").json()
    assert [one["burst_id"] for one in reply["bursts"]] == list(found)
    assert reply["total"] == len(found)
    rows = reader.get(f"/api/v1/bursts?{query}&format=csv").text.splitlines()
    table = [line for line in rows if not line.startswith("#")]
    assert [line.split(",")[0] for line in table[1:]] == list(found)


@pytest.mark.parametrize(("query", "found"), [(query, found) for query, found in QUESTIONS if "sort" not in query])
def test_the_newest_that_a_query_finds_has_an_address(reader: TestClient, query: str, found: str) -> None:
    reply = reader.get(f"/api/v1/bursts/latest?{query}")
    if found:
        assert reply.json() == reader.get(f"/api/v1/bursts/{found[0]}").json()
    else:
        assert (reply.status_code, "no burst is like that" in reply.text) == (404, True)


def test_pages_of_any_order_make_the_whole(reader: TestClient) -> None:
    for sort in ("-longitude", "updated", "-grade"):
        whole = [one["burst_id"] for one in reader.get(f"/api/v1/bursts?sort={sort}").json()["bursts"]]
        seen, following = [], f"/api/v1/bursts?sort={sort}&limit=1"
        while following:
            reply = reader.get(following).json()
            seen += [one["burst_id"] for one in reply["bursts"]]
            assert reply["total"] == len(whole)
            following = reply["next"]
        assert seen == whole


def test_a_cursor_of_another_question_is_refused(reader: TestClient) -> None:
    following = reader.get("/api/v1/bursts?limit=1").json()["next"]
    reply = reader.get(f"{following}&wind_min=300")
    assert (reply.status_code, reply.json()["detail"].partition(":")[0]) == (422, "cursor")
    assert reader.get(following.replace("limit=1", "limit=2")).status_code == 200


@pytest.mark.parametrize(
    ("query", "words"),
    [
        ("flag=beauty", "flag: no such flag; choose of speed_not_constrained"),
        ("without_flag=beauty", "without_flag: no such flag"),
        ("grade=E", "grade: input should be 'A', 'B', 'C' or 'D'"),
        ("tier=late", "'final' or 'preliminary'"),
        ("method=guess", "'posterior', 'nuts' or 'tdoa'"),
        ("sort=beauty", "'start', '-start', 'updated'"),
        ("wind_min=500&wind_max=400", "wind_min: is above wind_max"),
        ("longitude_min=361", "longitude_min: input should be less than or equal to 360"),
        ("frequency_min=nan", "frequency_min"),
        ("area_max=much", "area_max"),
        ("updated_since=noon", "updated_since: 'noon' is not a time"),
        ("observatory=Solr Orbiter", "observatory: no spacecraft is named"),
        ("longitude=3", "longitude: is not a parameter of this address; it takes origin, start, stop,"),
    ],
)
@pytest.mark.parametrize("path", ["bursts", "tracks", "localisations", "bursts/latest"])
def test_what_is_not_known_is_refused_with_what_is(reader: TestClient, path: str, query: str, words: str) -> None:
    reply = reader.get(f"/api/v1/{path}?{query}")
    if path != "bursts/latest" or not query.startswith("sort"):
        assert (reply.status_code, words in reply.json()["detail"]) == (422, True), reply.text


@pytest.mark.parametrize("path", ["bursts", "tracks", "localisations"])
@pytest.mark.parametrize("name", ["csv", "json", "ecsv"])
def test_all_that_a_query_finds_comes_in_one_reply(reader: TestClient, path: str, name: str) -> None:
    """The pages of one burst each hold the same rows as the whole."""
    query = {"grade": "ABC", "sort": "longitude", "format": name}
    whole = rows_of(reader.get(f"/api/v1/{path}", params=query | {"limit": "all"}))
    assert len(whole) == 3
    seen: list[Any] = []
    following: str | None = f"/api/v1/{path}?{urlencode(query)}&limit=1"
    while following:
        reply = reader.get(following)
        seen += rows_of(reply)
        following = reply.links.get("next", {}).get("url") or (
            reply.json().get("next") if path == "bursts" and name == "json" else None
        )
    assert seen == whole


def rows_of(reply: httpx.Response) -> list[Any]:
    """Rows of a table, or of a list of bursts."""
    assert reply.status_code == 200, reply.text
    if reply.headers["content-type"].startswith("application/json"):
        found = reply.json()
        return list(found.get("rows", found.get("bursts")))
    return [line for line in reply.text.splitlines() if not line.startswith("#")][1:]


def test_too_many_bursts_for_one_reply_are_refused(reader: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("api.tables.MOST_BURSTS", 3)
    refused = reader.get("/api/v1/tracks?limit=all&format=cdf").json()["detail"]
    assert "holds up to 3 bursts" in refused
    assert "json, csv, ecsv, votable, netcdf, parquet" in refused
    assert reader.get("/api/v1/tracks?limit=all&grade=A&format=cdf").status_code == 200
    assert reader.get("/api/v1/tracks?limit=all&format=ecsv").status_code == 200, "streamed, in any number"
    assert reader.get("/api/v1/tracks?limit=every").status_code == 422


def test_names_are_alike_everywhere() -> None:
    asked = set(BurstSelection.model_fields)
    assert {f"{name}_{end}" for name in RANGES for end in ("min", "max")} <= asked
    assert {one.removeprefix("-") for one in BurstSort.__args__} == set(BURST_SORTS)  # type: ignore[attr-defined]
    assert set(BurstFilter.model_json_schema()["properties"]["method"]["items"]["enum"]) == set(METHOD_ORDER)
    assert {"latitude_low_deg", "latitude_high_deg", "area68_rsun2", "updated_utc"} <= set(BURSTS.names)


def test_numbers_that_are_filtered_by_are_published(reader: TestClient) -> None:
    reply: dict[str, Any] = reader.get("/api/v1/bursts/A").json()
    solution = reply["solutions"][0]
    assert (solution["latitude_low_deg"], solution["latitude_high_deg"]) == pytest.approx((26.565, 26.565), abs=1e-3)
    assert solution["area68_rsun2"] == 10.0
    assert reply["updated_utc"] >= solution["created_utc"]
