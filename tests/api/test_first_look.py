"""What is drawn of an answer when it is published: the same as drawn anew, never older, and of no other view."""

import shutil
from dataclasses import replace
from datetime import timedelta
from pathlib import Path

import pytest
from fastapi.testclient import TestClient

from api.app import create_app
from bella.catalogue import Catalogue
from bella.pipeline import page_figures
from bella.pipeline.page_figures import (
    AnswerData,
    FirstLook,
    PosteriorSummary,
    first_look,
    first_look_path,
    keep_first_look,
    kept_first_look,
)
from bella.settings import Settings
from bella.store import open_group, open_tree
from tests.api.published import publish_event, published, settings_of, synthetic_burst
from tests.plotting.synthetic import BURST_ID, synthetic_track_fit

BURST, PAGE = f"/api/v1/bursts/{BURST_ID}", f"/bursts/{BURST_ID}"
FIGURES = tuple(f"{BURST}/figures/{name}.svg" for name in ("constellation", "spectra", "evolution", "residuals"))
SVG = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9" class="figure"><title>kept</title></svg>'
FALSE = FirstLook(
    figures=dict.fromkeys(("constellation", "spectra", "evolution", "residuals"), SVG),
    channels_mhz=[0.25, 0.5],
    posterior=PosteriorSummary(draws=7, units={}, summary={}, attributes={}),
)


@pytest.fixture
def home(tmp_path: Path) -> Settings:
    """Home with a burst of two answers and its spectra, of which nothing was drawn."""
    settings = settings_of(tmp_path / "home")
    with Catalogue.open(settings.catalogue_url, create=True) as catalogue:
        publish_event(settings, catalogue)
    return settings


def preferred_path(settings: Settings) -> Path:
    with Catalogue.open(settings.catalogue_url) as catalogue:
        found = catalogue.burst(BURST_ID)
    assert found.preferred is not None
    return first_look_path(found.burst, found.preferred, settings)


def draw(settings: Settings) -> Path:
    """Draw the preferred answer as a run does."""
    with Catalogue.open(settings.catalogue_url) as catalogue:
        found = catalogue.burst(BURST_ID)
        assert found.preferred is not None
        assert found.burst.spectra_path is not None
        group = open_group(settings.store_root, found.preferred.store_path)
        answer = AnswerData(found.preferred, group, catalogue.track_fit(found.preferred.solution_id))
    path = first_look_path(found.burst, found.preferred, settings)
    keep_first_look(path, first_look(found.burst, answer, open_tree(settings.store_root, found.burst.spectra_path)))
    return path


def replies(settings: Settings, *addresses: str) -> list[str]:
    with TestClient(create_app(settings)) as reader:
        return [reader.get(one).text for one in addresses]


def test_what_was_drawn_is_the_same_as_drawn_anew_and_needs_no_store(home: Settings) -> None:
    addresses = (PAGE, f"{BURST}/posterior", *FIGURES)
    anew = replies(home, *addresses)
    assert all("<svg" in one for one in (anew[0], *anew[2:-1]))
    assert anew[-1].startswith('{"type":"about:blank"'), "no residuals are kept"
    draw(home)
    shutil.rmtree(home.store_root)
    home.store_root.mkdir()
    assert replies(home, *addresses) == anew


def test_another_view_is_drawn_anew(home: Settings) -> None:
    keep_first_look(preferred_path(home), FALSE)
    first, figure, evolution, same = replies(home, PAGE, FIGURES[0], FIGURES[2], f"{PAGE}?edge=half_maximum")
    assert first.count(SVG) == same.count(SVG) == 4
    assert "<title>kept</title>" in figure
    assert "<title>kept</title>" in evolution
    views = ("view=fleet", "frame=carrington", "frequency=0.5", "clock=earth", "all=true", "f=0.2,1.0")
    for one in replies(home, *(f"{PAGE}?{view}" for view in views)):
        assert one.count(SVG) == 2, "evolution and residuals are the same"
    other, posterior = replies(home, f"{PAGE}?edge=gauss_hermite", f"{BURST}/posterior?edge=gauss_hermite")
    assert SVG not in other
    assert '"draws":7' not in posterior


def test_what_was_drawn_of_something_else_is_not_shown(home: Settings, monkeypatch: pytest.MonkeyPatch) -> None:
    with Catalogue.open(home.catalogue_url) as catalogue:
        found = catalogue.burst(BURST_ID)
        burst, solution = found.burst, found.solutions[0]
        path = first_look_path(burst, solution, home)
        changed = (
            (replace(burst, spectra_path="another.zarr"), solution),
            (replace(burst, start_utc=burst.start_utc + timedelta(seconds=1)), solution),
            (replace(burst, observatories=burst.observatories[:2]), solution),
            (burst, replace(solution, store_sha256="0" * 64)),
            (burst, found.solutions[1]),
        )
        paths = {path, *(first_look_path(*one, home) for one in changed)}
        monkeypatch.setattr(page_figures, "__version__", "0.0.0")
        assert len(paths | {first_look_path(burst, solution, home)}) == len(changed) + 2
        keep_first_look(path, FALSE)
        published(home, catalogue, burst=synthetic_burst(spectra_path=burst.spectra_path), inputs_hash="b" * 64)
    assert "<title>kept</title>" not in "".join(replies(home, PAGE, FIGURES[0]))


def test_what_is_damaged_is_drawn_anew(home: Settings) -> None:
    (anew,) = replies(home, PAGE)
    path = draw(home)
    whole = path.read_bytes()
    for content in (b"", whole[:100], b"\0" + whole[1:], whole[:-1]):
        path.write_bytes(content)
        assert kept_first_look(path) is None
        assert replies(home, PAGE) == [anew]


def test_what_is_drawn_again_takes_the_place_of_what_was(home: Settings) -> None:
    path = draw(home)
    other = path.with_name(path.name.replace("half_maximum", "half_rise"))
    older = path.with_name(f"{path.stem.rpartition('-')[0]}-0123456789abcdef{path.suffix}")
    version = path.with_name(path.name.replace(".v1-", ".v12-"))
    for one in (older, version, other):
        one.write_bytes(b"")
    draw(home)
    assert (path.is_file(), older.exists(), version.exists(), other.exists()) == (True, False, False, True)


def test_a_figure_has_another_tag_when_methods_were_added_beside_its_track(empty: Settings) -> None:
    with Catalogue.open(empty.catalogue_url) as catalogue, TestClient(create_app(empty)) as reader:
        fit = synthetic_track_fit("half_maximum") | {"companions_pending": True}
        solution = published(empty, catalogue, track_fit=fit)
        before = reader.get(FIGURES[2]).headers["etag"]
        assert reader.get(FIGURES[2], headers={"If-None-Match": before}).status_code == 304
        catalogue.add_companions(solution.solution_id, {})
        assert reader.get(FIGURES[2], headers={"If-None-Match": before}).status_code == 200
