"""How often answers like a burst's held the truth: in the replies, on the page and in the list of the command."""

import json
from pathlib import Path

from fastapi.testclient import TestClient
from typer.testing import CliRunner

from api.app import create_app
from bella.calibration.tried import NOT_TRIED, Answered, tried
from bella.catalogue import Catalogue
from bella.cli import app
from tests.api.published import published, settings_of
from tests.api.test_pages import page
from tests.plotting.synthetic import BURST_ID


def test_replies_page_and_command_say_how_often_such_answers_held(tmp_path: Path) -> None:
    settings = settings_of(tmp_path / "home")
    with Catalogue.open(settings.catalogue_url, create=True) as catalogue:
        solution = published(settings, catalogue, edge="shared_profile", preset="default")
    found = tried(Answered(3, "shared_profile", solution.answer.tier, solution.answer.grade))
    assert found is not None
    with TestClient(create_app(settings)) as reader:
        burst = reader.get(f"/api/v1/bursts/{BURST_ID}").json()
        one = reader.get(burst["solutions"][0]["links"]["self"]).json()
        alone = reader.get(burst["solutions"][0]["links"]["calibration"]).json()
        html = page(reader, f"/bursts/{BURST_ID}")
    assert burst["calibration"] == one["calibration"] == alone
    assert (alone["sentence"], alone["stratum"], alone["page"]) == (
        found.sentence,
        found.stratum,
        "docs/calibration-found.md",
    )
    for reply, row in zip(alone["rows"], found.rows, strict=True):
        assert all(value == getattr(row, name) for name, value in reply.items())
    assert found.sentence in html
    shown = CliRunner().invoke(app, ["catalogue", "show", BURST_ID], env={"BELLA_HOME": str(settings.home)})
    assert found.sentence in shown.output
    assert solution.answer.sentence in shown.output.splitlines()[-1]
    listed = CliRunner().invoke(app, ["catalogue", "show", BURST_ID, "--json"], env={"BELLA_HOME": str(settings.home)})
    assert found.sentence in json.loads(listed.output)["calibration"]


def test_an_answer_that_was_not_tried_says_so(tmp_path: Path) -> None:
    settings = settings_of(tmp_path / "home")
    with Catalogue.open(settings.catalogue_url, create=True) as catalogue:
        published(settings, catalogue, edge="gauss_hermite")
    with TestClient(create_app(settings)) as reader:
        burst = reader.get(f"/api/v1/bursts/{BURST_ID}").json()
        alone = reader.get(burst["solutions"][0]["links"]["calibration"])
        assert NOT_TRIED in page(reader, f"/bursts/{BURST_ID}")
    assert burst["calibration"] == alone.json()
    assert (alone.json()["sentence"], alone.json()["stratum"], alone.json()["rows"]) == (NOT_TRIED, None, [])
