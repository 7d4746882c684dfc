"""The commands ``bella events read`` and ``list``, and events in ``bella catalogue show``."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from bella.catalogue import Catalogue
from bella.cli import app
from bella.exceptions import InputError, StoreError
from tests.api.published import publish_event, settings_of
from tests.linked_events.published import FILES
from tests.plotting.synthetic import BURST_ID


def test_lists_are_read_listed_and_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    settings, lists = settings_of(tmp_path / "home"), tmp_path / "lists"
    with Catalogue.open(settings.catalogue_url, create=True) as catalogue:
        publish_event(settings, catalogue)
    monkeypatch.setenv("BELLA_HOME", str(settings.home))
    monkeypatch.delenv("BELLA_DATABASE_URL", raising=False)
    run = CliRunner().invoke
    monkeypatch.delenv("BELLA_EVENTS", raising=False)
    assert "set BELLA_EVENTS" in str(run(app, ["events", "read"]).exception)
    monkeypatch.setenv("BELLA_EVENTS", str(lists))
    assert isinstance(run(app, ["events", "read"]).exception, InputError)

    lists.mkdir()
    for name, content in FILES.items():
        (lists / name).write_text(content)
    read = json.loads(run(app, ["events", "read", "--json"]).stdout)
    assert {one["name"]: one["events"] for one in read} == {
        "20120607events.txt": 3,
        "CME-2012.json": 1,
        "FLR-2012.json": 1,
        "SEP-2012.json": 1,
        "type3.tfcat": 2,
    }
    assert all(one["newest_utc"].endswith("Z") and one["linked_utc"].endswith("Z") for one in read)
    assert run(app, ["events", "read"]).stdout.splitlines()[-1] == "8 events of 5 lists are known"

    asked = ["events", "list", "--from", "2012-06-07", "--to", "2012-06-07", "--linked"]
    found = json.loads(run(app, [*asked, "--json"]).stdout)
    assert {one["kind"] for one in found} == {"flare", "cme", "particles", "radio"}
    assert all(list(one["bursts"]) == [BURST_ID] for one in found)
    assert run(app, [*asked, "--kind", "cme"]).stdout.splitlines()[-1] == "1 of 1 events"
    assert isinstance(run(app, [*asked, "--kind", "storm"]).exception, InputError)

    shown = run(app, ["catalogue", "show", BURST_ID]).stdout
    assert "Near      flare C3.4 2012-06-07 19:24 (" in shown
    assert "after it at the Sun, DONKI:2012-06-07T20:00:00-CME-001)" in shown
    assert len(json.loads(run(app, ["catalogue", "show", BURST_ID, "--json"]).stdout)["events"]) == 5

    (lists / "FLR-2012.json").write_text("{")
    broken = run(app, ["events", "read"])
    assert isinstance(broken.exception, StoreError)
    assert "1 of 5 lists are not usable: FLR-2012.json is damaged" in str(broken.exception)
