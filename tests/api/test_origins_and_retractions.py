"""What is not real, and what was retracted, is unmistakable on pages, in the API and in files, and in no list."""

from collections.abc import Iterator
from dataclasses import replace

import pytest
from fastapi.testclient import TestClient

from api.app import create_app
from bella.catalogue import Catalogue, SourceFile
from bella.formats import BURSTS
from bella.plotting.svg import figure
from bella.records import Origin
from bella.settings import Settings
from tests.api.published import ONSET, published, settings_of, synthetic_burst
from tests.api.test_pages import page
from tests.catalogue.test_detections import DAY, received
from tests.formats.reading import read_back
from tests.plotting.synthetic import BURST_ID

SIM, TEST, SUBMITTED = "SIM-20120607-1929", "TEST-20120607-1929", "S-20120607-aaaaaaaaaa"
OTHERS = {SIM: Origin.SIMULATED, TEST: Origin.TEST, SUBMITTED: Origin.SUBMISSION}


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Settings:
    """A burst with two versions, a retracted one, one of each other origin, and a day twice."""
    settings = settings_of(tmp_path_factory.mktemp("home"))
    with Catalogue.open(settings.catalogue_url, create=True) as catalogue:
        published(settings, catalogue)
        published(settings, catalogue, inputs_hash="b" * 64)
        published(settings, catalogue, burst=synthetic_burst(burst_id="T3-20120607-2100"))
        for burst_id, origin in OTHERS.items():
            published(settings, catalogue, burst=replace(synthetic_burst(burst_id=burst_id), origin=origin))
        catalogue.retract("T3-20120607-2100", "timed on <interference>")
        catalogue.record_day(DAY, [received(3)])
        catalogue.record_day(replace(DAY, origin=Origin.SIMULATED), [received(5), received(7)])
        catalogue.record_day(replace(DAY, day=DAY.day.replace(day=25), origin=Origin.TEST), [])
    return settings


@pytest.fixture
def reader(home: Settings) -> Iterator[TestClient]:
    with TestClient(create_app(home), raise_server_exceptions=False) as client:
        yield client


@pytest.mark.parametrize(
    ("query", "expected"),
    [
        ("", {BURST_ID, SUBMITTED}),
        ("?origin=simulated", {SIM}),
        ("?origin=test", {TEST}),
        ("?origin=submission", {SUBMITTED}),
        ("?retracted=true", {BURST_ID, SUBMITTED, "T3-20120607-2100"}),
        ("?origin=all", {BURST_ID, *OTHERS}),
    ],
)
def test_lists_hold_what_is_asked_for(reader: TestClient, query: str, expected: set[str]) -> None:
    reply = reader.get(f"/api/v1/bursts{query}").json()
    assert {one["burst_id"] for one in reply["bursts"]} == expected
    assert reply["total"] == len(expected)
    html = reader.get(f"/{query}", headers={"Accept": "text/html"}).text
    for burst_id in (BURST_ID, *OTHERS, "T3-20120607-2100"):
        assert (f'href="/bursts/{burst_id}"' in html) == (burst_id in expected)


def test_an_unknown_origin_is_refused_everywhere(reader: TestClient) -> None:
    for path in ("bursts", "days", "days/2020-07-21", "alerts", "detections?start=2020-07-21&stop=2020-07-22"):
        mark = "&" if "?" in path else "?"
        assert reader.get(f"/api/v1/{path}{mark}origin=martian").status_code == 422, path
    assert reader.get("/days/2020-07-21?origin=martian").status_code == 422
    assert reader.get("/days?origin=martian").status_code == 422


@pytest.mark.parametrize(("burst_id", "origin"), OTHERS.items())
def test_page_api_and_csv_name_the_origin(reader: TestClient, burst_id: str, origin: Origin) -> None:
    reply = reader.get(f"/api/v1/bursts/{burst_id}").json()
    assert reply["origin"] == origin
    assert [one["origin"] for one in reply["solutions"]] == [origin]
    assert f"# origin: {origin}\n" in reader.get(f"/api/v1/bursts/{burst_id}/track?format=csv").text
    html = reader.get(f"/bursts/{burst_id}", headers={"Accept": "text/html"}).text
    assert f'id="origin">{origin}</span>' in html
    assert ('id="not-real"' in html) == (origin is not Origin.SUBMISSION)
    assert ('id="submitted"' in html) == (origin is Origin.SUBMISSION)
    real = reader.get(f"/bursts/{BURST_ID}", headers={"Accept": "text/html"}).text
    assert 'id="origin"' not in real.replace('<select id="origin"', "")
    assert 'id="not-real"' not in real


def test_days_and_detections_are_counted_by_origin(reader: TestClient) -> None:
    counts = {}
    for query in ("", "?origin=simulated", "?origin=all"):
        reply = reader.get(f"/api/v1/days{query}").json()
        counts[query] = [(one["day"], one["origin"], one["detections"]) for one in reply["days"]]
    real, simulated = ("2020-07-21", "archive", 1), ("2020-07-21", "simulated", 2)
    assert counts[""] == [real]
    assert counts["?origin=simulated"] == [simulated]
    assert counts["?origin=all"] == [("2020-07-25", "test", 0), real, simulated]
    for query, count, origin in (("", 1, "archive"), ("&origin=simulated", 2, "simulated"), ("&origin=test", 0, "")):
        found = reader.get(f"/api/v1/detections?start=2020-07-21&stop=2020-07-22{query}").json()["detections"]
        assert [one["origin"] for one in found] == [origin] * count
    assert reader.get("/api/v1/days/2020-07-21?origin=simulated").json()["origin"] == "simulated"
    assert reader.get("/api/v1/days/2020-07-25").json()["searched"] is False
    assert reader.get("/api/v1/days/2020-07-25?origin=test").json()["searched"] is True


def test_links_of_a_simulated_day_stay_with_it(reader: TestClient) -> None:
    (day,) = reader.get("/api/v1/days?origin=simulated").json()["days"]
    assert reader.get(day["links"]["self"]).json()["origin"] == "simulated"
    found = reader.get(day["links"]["detections"]).json()["detections"]
    assert {one["origin"] for one in found} == {"simulated"}
    html = reader.get(day["links"]["page"], headers={"Accept": "text/html"}).text
    assert 'id="not-real"' in html
    assert "Simulated data of WIND" in html
    assert "2 detections" in html
    plain = reader.get("/days/2020-07-21", headers={"Accept": "text/html"}).text
    assert 'id="not-real"' not in plain
    assert "1 detection\n" in plain
    listed = reader.get("/days?origin=all", headers={"Accept": "text/html"}).text
    assert 'href="/days/2020-07-21?origin=simulated"' in listed
    assert 'href="/days/2020-07-21"' in listed


def test_what_is_kept_apart_is_pointed_to(reader: TestClient, empty: Settings) -> None:
    assert "/days/2020-07-25?origin=test shows it in test data" in page(reader, "/days/2020-07-25", 404)
    assert "run bella run --from 2020-07-26" in page(reader, "/days/2020-07-26", 404)
    with TestClient(create_app(empty)) as client:
        assert not any('id="kept-apart"' in page(client, path) for path in ("/", "/days"))
        with Catalogue.open(empty.catalogue_url) as catalogue:
            published(empty, catalogue, burst=replace(synthetic_burst(burst_id=SIM), origin=Origin.SIMULATED))
            catalogue.record_day(replace(DAY, origin=Origin.TEST), [])
        assert '<a href="/?origin=all">bursts of all data</a> (1)' in page(client, "/")
        assert '<a href="/days?origin=all">days of all data</a> (1)' in page(client, "/days")


def test_figures_of_a_simulated_day_are_its_own(reader: TestClient, home: Settings) -> None:
    for origin, text in ((Origin.ARCHIVE, "real"), (Origin.SIMULATED, "drawn")):
        path = home.day_figure(DAY.day, origin)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(figure("day", (400, 100), text))
    real = reader.get("/api/v1/days/2020-07-21/figure.svg").text
    assert ">real</title>" in real
    assert "SIMULATED" not in real
    simulated = reader.get("/api/v1/days/2020-07-21/figure.svg?origin=simulated").text
    assert ">drawn</title>" in simulated
    assert "SIMULATED DATA" in simulated
    assert reader.get("/api/v1/days/2020-07-21/figure.svg?origin=test").status_code == 404


def test_a_calendar_of_simulated_days_says_so(reader: TestClient) -> None:
    assert "SIMULATED" not in reader.get("/days/calendar.svg").text
    assert "SIMULATED DATA" in reader.get("/days/calendar.svg?origin=simulated").text


def test_a_kept_figure_of_a_retracted_burst_says_so(reader: TestClient) -> None:
    kept = reader.get("/api/v1/bursts/T3-20120607-2100/figures/constellation.svg").text
    assert "RETRACTED BURST" in kept
    assert "Retracted burst: timed on &lt;interference&gt;." in kept


@pytest.mark.parametrize(("burst_id", "said"), [("T3-20120607-2100", "RETRACTED BURST"), (SIM, "SIMULATED DATA")])
def test_a_kept_figure_of_a_solution_says_so(reader: TestClient, home: Settings, burst_id: str, said: str) -> None:
    solution = reader.get(f"/api/v1/bursts/{burst_id}/versions?origin=all").json()["versions"][0]["solution_id"]
    path = home.solution_figure(burst_id, solution, "wind")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(figure("wind-map", (400, 100), "wind"))
    assert said in reader.get(f"/api/v1/solutions/{solution}/figures/wind.svg").text


def test_figures_of_a_selection_say_when_bursts_are_not_real(reader: TestClient) -> None:
    assert "SIMULATED" not in reader.get("/api/v1/figures/longitude.svg").text
    assert "SIMULATED DATA" in reader.get("/api/v1/figures/longitude.svg?origin=all").text


def test_a_retracted_burst_is_a_tombstone_everywhere(reader: TestClient) -> None:
    own = "/api/v1/bursts/T3-20120607-2100"
    reply = reader.get(own).json()
    assert reply["retracted"]["reason"] == "timed on <interference>"
    assert reply["retracted"]["retracted_utc"].endswith("Z")
    assert reply["sentence"] == "retracted: timed on <interference>"
    assert (reply["grade"], reply["preferred_solution"]) == (None, None)
    (solution,) = reply["solutions"]
    assert solution["retracted"] == reply["retracted"]
    assert solution["preferred"] is False
    assert reader.get(solution["links"]["self"]).json()["retracted"] == reply["retracted"]
    (version,) = reader.get(f"{own}/versions").json()["versions"]
    assert version["retracted"] == reply["retracted"]
    assert reader.get(f"{own}/track").json()["solution"]["retracted"] == reply["retracted"]
    assert "# retracted: timed on <interference>\n" in reader.get(f"{own}/track?format=csv").text
    assert reader.get(f"{solution['links']['zarr']}/zarr.json").status_code == 200
    html = reader.get("/bursts/T3-20120607-2100", headers={"Accept": "text/html"}).text
    assert 'id="retracted"' in html
    assert "timed on &lt;interference&gt;" in html
    assert "<interference>" not in html
    assert '<p class="answer"' not in html
    assert 'id="published"' in html
    assert "Show the preferred one" not in html


def test_tables_name_the_origin_and_the_reason_of_a_retraction(reader: TestClient) -> None:
    rows = reader.get("/api/v1/bursts?retracted=true&origin=all&format=parquet")
    found = read_back("parquet", rows.content, BURSTS)
    said = dict(zip(found["burst_id"], zip(found["origin"], found["retracted"], strict=True), strict=True))
    assert said["T3-20120607-2100"] == ("archive", "timed on <interference>")
    assert said[BURST_ID][1] == ""
    assert {origin for origin, _ in said.values()} >= {"archive", "submission", "simulated"}


def test_every_solution_lists_its_source_files(reader: TestClient) -> None:
    (solution,) = reader.get(f"/api/v1/bursts/{BURST_ID}").json()["solutions"]
    sources = reader.get(solution["links"]["self"]).json()["sources"]
    expected = SourceFile("synthetic", ONSET.date(), "1", "b" * 64, "done", "synthetic")
    assert sources == [
        {
            "dataset": expected.dataset,
            "day": f"{expected.day}",
            "version": expected.version,
            "sha256": expected.sha256,
            "uri": expected.uri,
        }
    ]
    shown = page(reader, f"/bursts/{BURST_ID}")
    assert expected.sha256 in str(shown)


def test_the_history_of_a_burst_tells_its_story(reader: TestClient) -> None:
    html = reader.get("/bursts/T3-20120607-2100", headers={"Accept": "text/html"}).text
    history = html[html.index('id="history"') : html.index("</ol>")]
    assert history.index("<strong>first answer</strong> (final)") < history.index("<strong>retracted</strong>: ")
    assert "timed on &lt;interference&gt;" in history
    both = reader.get(f"/bursts/{BURST_ID}", headers={"Accept": "text/html"}).text
    assert both.index("<strong>first answer</strong>") < both.index("<strong>new answer</strong>")
