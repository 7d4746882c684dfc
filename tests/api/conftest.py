"""One home folder with bursts in it, shared by the tests that only read."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from fastapi.testclient import TestClient

from api.app import create_app
from bella.catalogue import Catalogue
from bella.plotting.svg import figure as drawn
from bella.settings import Settings
from tests.api.published import publish_event, publish_many, published, settings_of, synthetic_burst
from tests.plotting.synthetic import synthetic_track_fit


@pytest.fixture(scope="session")
def filled(tmp_path_factory: pytest.TempPathFactory) -> Settings:
    """Eight bursts; the first has spectra, both edge definitions, and a superseded version."""
    settings = settings_of(tmp_path_factory.mktemp("home"))
    with Catalogue.open(settings.catalogue_url, create=True) as catalogue:
        first, _ = publish_event(settings, catalogue)
        spectra_path = catalogue.burst(first.burst_id).burst.spectra_path
        published(settings, catalogue, burst=synthetic_burst(spectra_path=spectra_path), inputs_hash="b" * 64)
        publish_many(settings, catalogue, 7)
    return settings


@pytest.fixture
def client(filled: Settings) -> Iterator[TestClient]:
    """Reader of the filled home folder."""
    with TestClient(create_app(filled), raise_server_exceptions=False) as reader:
        yield reader


@pytest.fixture
def empty(tmp_path: Path, empty_file: Path) -> Settings:
    """Home folder whose catalogue holds nothing."""
    settings = settings_of(tmp_path / "home", max_pending_submissions=2, max_submission_bytes=20_000)
    settings.store_root.mkdir(parents=True)
    shutil.copy(empty_file, settings.home / "catalogue.sqlite")
    return settings


@pytest.fixture
def token(empty: Settings) -> str:
    """Token of Ann for the empty home folder."""
    with Catalogue.open(empty.catalogue_url) as catalogue:
        return catalogue.create_token("Ann")[1]


@pytest.fixture
def settings_of_old(tmp_path: Path) -> Settings:
    """Home folder with a solution that was published before there was a joint fit."""
    settings = settings_of(tmp_path / "home")
    fit = synthetic_track_fit("gauss_hermite")
    old = {name: fit[name] for name in ("frame", "rotation_period_d", "two_step", "two_step_other_rotations")}
    with Catalogue.open(settings.catalogue_url, create=True) as catalogue:
        published(settings, catalogue, edge="gauss_hermite", track_fit=old)
    return settings


@pytest.fixture
def settings_with_figures(tmp_path: Path) -> Settings:
    """Home folder with one solution, of which two figures were drawn."""
    settings = settings_of(tmp_path / "home")
    with Catalogue.open(settings.catalogue_url, create=True) as catalogue:
        solution = published(settings, catalogue, edge="gauss_hermite")
    for name in ("wind", "shared-profile"):
        figure = settings.solution_figure(solution.burst_id, solution.solution_id, name)
        figure.parent.mkdir(parents=True, exist_ok=True)
        figure.write_text(drawn(name, (10, 10), f"drawing of {name}"))
    return settings
