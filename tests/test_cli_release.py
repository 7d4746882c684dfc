"""The commands ``bella release make`` and ``bella release verify``."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from bella.catalogue import Catalogue
from bella.cli import app
from bella.exceptions import InputError, StoreError
from tests.api.published import publish_event, settings_of


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    settings = settings_of(tmp_path_factory.mktemp("home"))
    with Catalogue.open(settings.catalogue_url, create=True) as catalogue:
        publish_event(settings, catalogue)
    return settings.home


def test_a_release_is_made_and_verified(home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BELLA_HOME", str(home))
    monkeypatch.delenv("BELLA_DATABASE_URL", raising=False)
    run = CliRunner().invoke
    asked = ["release", "make", "1.0", "--output", str(tmp_path), "--creator", "Doe, Jane", "--from", "2012-06-07"]
    made = json.loads(run(app, [*asked, "--to", "2012-06-07", "--json"]).stdout)
    folder = tmp_path / "bella-1.0"
    assert made["folder"] == str(folder)
    assert (made["rows"]["bursts"], made["posteriors"]) == (1, 1)
    assert (made["first_day"], made["last_day"]) == ("2012-06-07", "2012-06-07")
    assert (made["creators"], made["publisher"]) == (["Doe, Jane"], "Doe, Jane")

    assert json.loads(run(app, ["release", "verify", str(folder), "--json"]).stdout) == made
    said = run(app, ["release", "verify", str(folder)]).stdout.splitlines()
    assert said[-1] == f"{folder} is whole: 1 bursts, every file as its checksum says"
    assert "localisations" in "".join(said)

    (folder / "index.html").chmod(0o644)
    (folder / "index.html").write_text("other")
    again = run(app, ["release", "verify", str(folder)])
    assert isinstance(again.exception, StoreError)
    assert "index.html is changed" in str(again.exception)
    assert isinstance(run(app, [*asked]).exception, InputError)
    assert isinstance(run(app, ["release", "verify", str(tmp_path / "none")]).exception, InputError)
    assert isinstance(run(app, [*asked, "--origin", "mars"]).exception, InputError)
