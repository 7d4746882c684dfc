"""One answer per burst: page, list, API, CSV and command line say the same, whichever solution is the preferred one."""

import json
import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from fastapi.testclient import TestClient
from typer.testing import CliRunner

from api.app import create_app
from bella.catalogue import Catalogue
from bella.cli import app
from bella.settings import Settings
from tests.api.published import publish_event, published, settings_of, synthetic_burst
from tests.plotting.synthetic import BURST_ID

BURST = f"/api/v1/bursts/{BURST_ID}"
BY_EDGE = {
    "half_maximum": "13° W (9 to 17), 13 to 152 R_sun, wind 2000 km/s (1710 to 2380), grade A",
    "gauss_hermite": "29° W (25 to 33), 13 to 152 R_sun, wind 420 km/s (360 to 500), grade A",
}
HTML = {"Accept": "text/html"}


@pytest.fixture(scope="module")
def template(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Home folder with both edges of the event, and one of them by another preset."""
    settings = settings_of(tmp_path_factory.mktemp("template") / "home")
    with Catalogue.open(settings.catalogue_url, create=True) as catalogue:
        publish_event(settings, catalogue)
        path = catalogue.burst(BURST_ID).burst.spectra_path
        published(settings, catalogue, burst=synthetic_burst(spectra_path=path), edge="gauss_hermite", preset="robust")
    return settings.home


@pytest.fixture
def home(template: Path, tmp_path: Path) -> Settings:
    """Copy of that folder."""
    return settings_of(shutil.copytree(template, tmp_path / "home"))


@pytest.fixture
def reader(home: Settings) -> Iterator[TestClient]:
    with TestClient(create_app(home)) as client:
        yield client


def command(home: Settings, *arguments: str, code: int = 0) -> str:
    result = CliRunner().invoke(app, ["catalogue", *arguments, "--home", str(home.home)], env={"COLUMNS": "300"})
    assert result.exit_code == code, result.output
    return result.output


def answers(reader: TestClient, home: Settings) -> dict[str, str]:
    """The answer about the burst by every way to ask for it, without parameters."""
    listed = reader.get("/api/v1/bursts").json()["bursts"][0]
    csv = reader.get(f"{BURST}/track", params={"format": "csv"}).text
    page, catalogue = (reader.get(path, headers=HTML).text for path in (f"/bursts/{BURST_ID}", "/"))
    return {
        "burst": reader.get(BURST).json()["sentence"],
        "list": listed["sentence"],
        "preferred of list": next(one["sentence"] for one in listed["solutions"] if one["preferred"]),
        "first of list": listed["solutions"][0]["sentence"],
        "track": reader.get(f"{BURST}/track").json()["sentence"],
        "solution of track": reader.get(f"{BURST}/track").json()["solution"]["sentence"],
        "posterior": reader.get(f"{BURST}/posterior").json()["sentence"],
        "csv": re.findall(r"^# answer: (.+)$", csv, re.MULTILINE)[0],
        "page": said_by_page(re.findall(r'id="answer">(.+?)</p>', page, re.DOTALL)[0]),
        "catalogue page": re.findall(r'aria-label="Track of [^:]+: ([^"]+)"', catalogue)[0],
        "catalogue list": json.loads(command(home, "list", "--json"))[0]["answer"]["sentence"],
        "catalogue show": command(home, "show", BURST_ID).splitlines()[-1].split(": ", 1)[1].rpartition(" (")[0],
    }


def said_by_page(html: str) -> str:
    """Answer as it stands in replies; a page has the grade before it, and the sign of the Sun."""
    words = re.sub(r"<[^>]+>", "", html).split()
    said = " ".join(words[2:]).replace("R\N{SUN}", "R_sun")
    return f"{said}, grade {words[1]}"


@pytest.mark.parametrize("edge", list(BY_EDGE))
def test_every_way_to_ask_gives_the_preferred_answer(reader: TestClient, home: Settings, edge: str) -> None:
    command(home, "prefer", BURST_ID, f"{edge}/posterior/bella-2024", "--reason", "for a test")
    found = answers(reader, home)
    assert {name: words.strip() for name, words in found.items()} == dict.fromkeys(found, BY_EDGE[edge])
    for part in ("track", "posterior"):
        reply = reader.get(f"{BURST}/{part}").json()
        assert (reply["preferred"], reply["grade"], reply["tier"]) == (True, "A", "final")
        assert reply["solution"]["edge"] == edge


def test_replies_say_which_one_is_preferred_and_who_chose_it(reader: TestClient, home: Settings) -> None:
    reply = reader.get(BURST).json()
    assert {(s["edge"], s["preset"]): s["preferred"] for s in reply["solutions"]} == {
        ("half_maximum", "bella-2024"): True,
        ("gauss_hermite", "bella-2024"): False,
        ("gauss_hermite", "robust"): False,
    }
    assert reply["preference"]["chosen_by"] == "rule"
    assert (reply["grade"], reply["preferred_solution"]) == ("A", reply["solutions"][0]["solution_id"])
    assert [reply["solutions"][0][f"phi0{end}_deg"] for end in ("", "_low", "_high")] == pytest.approx([13, 8.6, 17.4])
    other = reader.get(f"{BURST}/track", params={"edge": "gauss_hermite"}).json()
    assert (other["preferred"], other["sentence"]) == (False, BY_EDGE["gauss_hermite"])
    regions = reader.get(f"{BURST}/regions", params={"frequency_mhz": 0.3}).json()["regions"]
    assert {one["edge"]: one["preferred"] for one in regions} == {"half_maximum": True, "gauss_hermite": False}
    csv = reader.get(f"{BURST}/track", params={"format": "csv", "edge": "gauss_hermite"}).text
    assert "# preferred: no" in csv
    command(home, "prefer", BURST_ID, "gauss_hermite/posterior/robust", "--reason", "outliers")
    reply = reader.get(BURST).json()
    assert (reply["preference"]["chosen_by"], reply["preference"]["reason"]) == ("person", "outliers")
    versions = reader.get(f"{BURST}/versions").json()["versions"]
    assert [one["preset"] for one in versions if one["preferred"]] == ["robust"]


@pytest.mark.parametrize(
    "query",
    [
        {"method": "foo"},
        {"method": "nuts"},
        {"preset": "paper"},
        {"edge": "half_rise"},
        {"preset": "robust", "edge": "half_maximum"},
    ],
)
def test_series_that_does_not_exist_is_said_not_to_exist(reader: TestClient, query: dict[str, str]) -> None:
    parts = ("track", "posterior", "figures/constellation.svg", "figures/spectra.svg", "regions?frequency_mhz=0.3")
    for path in (f"/bursts/{BURST_ID}", *(f"{BURST}/{part}" for part in parts)):
        reply = reader.get(path, params={**query, **({"frequency_mhz": "0.3"} if "regions" in path else {})})
        assert reply.status_code == 404, path
        detail = reply.json()["detail"]
        assert detail.startswith("this burst has no such series: "), path
        assert all(value in detail for value in query.values())
        assert "half_maximum/posterior/bella-2024 v1" in detail
    page = reader.get(f"/bursts/{BURST_ID}", params=query, headers=HTML)
    assert page.status_code == 404
    assert "this burst has no such series: " in page.text
    assert "No spiral was fitted" not in page.text


def test_page_of_another_series_says_that_it_is_not_the_preferred_one(reader: TestClient) -> None:
    text = re.sub(r"\s+", " ", reader.get(f"/bursts/{BURST_ID}?preset=robust", headers=HTML).text)
    assert said_by_page(re.findall(r'id="answer">(.+?)</p>', text)[0]) == BY_EDGE["half_maximum"]
    other = re.findall(r'id="other-series">(.+?)</p>', text)[0]
    assert "another answer" in other
    assert BY_EDGE["gauss_hermite"] in other.replace("R\N{SUN}", "R_sun")
    assert "preset=robust&amp;version=1" in text
    preferred = reader.get(f"/bursts/{BURST_ID}", headers=HTML).text
    assert 'id="other-series"' not in preferred


def test_list_page_leaves_out_flags_that_nearly_every_burst_has(home: Settings) -> None:
    with Catalogue.open(home.catalogue_url) as catalogue:
        flags = ("formal_errors", "speed_not_constrained", "v_sw_not_constrained", "multimodal")
        published(home, catalogue, inputs_hash="b" * 64, flags=flags)
    with TestClient(create_app(home)) as reader:
        text = reader.get("/", headers=HTML).text
    rows = text[text.index("<tbody>") :]
    assert "multimodal" in rows
    for words in ("formal errors", "speed not constrained", "v sw not constrained"):
        assert words not in rows


def test_commands_print_the_answer_and_refuse_what_is_not_clear(home: Settings) -> None:
    assert json.loads(command(home, "list", "--json"))[0]["answer"]["sentence"] == BY_EDGE["half_maximum"]
    pinned = command(home, "prefer", BURST_ID, "gauss_hermite/posterior/robust/2d", "--reason", "outliers").splitlines()
    assert pinned[0] == f"Preferred {BURST_ID}.gauss_hermite.posterior.robust.2d.v1"
    assert pinned[-1].endswith("(gauss_hermite/posterior/robust/2d, pinned, outliers)")
    row = json.loads(command(home, "list", "--json"))[0]
    assert (row["chosen_by"], row["reason"]) == ("person", "outliers")
    narrow = CliRunner().invoke(app, ["catalogue", "list", "--home", str(home.home)], env={"COLUMNS": "40"})
    assert BURST_ID in narrow.stdout
    shown = json.loads(command(home, "show", BURST_ID, "--json"))
    details = shown.pop("details")
    assert shown == row | {"events": []}
    assert [one["solution_id"] for one in details] == row["solutions"]
    assert all(one["localisations"] and one["track"] for one in details)
    assert command(home, "prefer", BURST_ID, "--auto").splitlines()[-1].endswith("chosen by the rule)")
    for wrong in ((), ("gauss_hermite", "--auto"), ("--auto", "--reason", "x"), ("gauss_hermite",)):
        assert CliRunner().invoke(app, ["catalogue", "prefer", BURST_ID, *wrong, "--home", str(home.home)]).exit_code
