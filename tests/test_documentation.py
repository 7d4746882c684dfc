"""Documents that can fail: what they list is what the code has."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import bella
from api.app import create_app
from bella.answer import BEST_HALF_WIDTH_DEG, GOOD_HALF_WIDTH_DEG, GRADES, MISFIT_TAIL
from bella.arrivals import NUISANCE, RISE
from bella.catalogue.records import EDGE_ORDER, METHOD_ORDER, PRESET_ORDER
from bella.flags import (
    COMPANION_FLAGS,
    EDGE_FLAGS,
    HARMLESS_FLAGS,
    LOCALISATION_FLAGS,
    SERIOUS_FLAGS,
    TRACK_FLAGS,
)
from bella.heliosphere.scattering import LITERATURE_DELAY
from bella.multilateration import METHODS, PRESETS
from bella.settings import Settings
from bella.spectra import PRODUCTS
from bella.tracks import model
from tests.service_processes.compose import ROOT, VARIABLE, composed, services

DOCUMENTS = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md"), *(ROOT / "docs").glob("[rt]*/*.md")])
OPERATIONS = ROOT / "docs" / "operations.md"
LINES_OF_A_SCREEN = 50


def rows(path: Path) -> dict[str, list[str]]:
    """Rows of the tables of a document whose first cell is a name in code type, by that name."""
    found = re.findall(r"^\| `(\w+)` \| (.*) \|$", path.read_text(encoding="utf-8"), flags=re.MULTILINE)
    assert len({name for name, _ in found}) == len(found)
    return {name: cells.split(" | ") for name, cells in found}


def named(prefix: str) -> dict[str, list[str]]:
    return {name: cells for name, cells in rows(OPERATIONS).items() if name.startswith(prefix)}


def test_every_setting_stands_in_the_table_of_the_operator() -> None:
    of_compose = {match["name"] for match in VARIABLE.finditer((ROOT / "docker-compose.yml").read_text())}
    assert set(named("BELLA_")) == {f"BELLA_{name.upper()}" for name in Settings.model_fields} | of_compose


@pytest.mark.parametrize("name", Settings.model_fields)
def test_table_of_the_operator_has_default_and_meaning_of_a_setting(name: str) -> None:
    field = Settings.model_fields[name]
    default, meaning = named("BELLA_")[f"BELLA_{name.upper()}"]
    assert default == ("none" if field.default is None else f"`{field.default}`")
    first_words = " ".join(str(field.description).split()[:4]).rstrip(".;,")
    assert meaning.startswith(first_words)


def test_every_service_and_volume_is_described() -> None:
    described = rows(OPERATIONS)
    assert set(services()) <= set(described)
    for volume in composed()["volumes"]:
        assert any(f"`{volume}`" in cells[-1] for cells in described.values()), volume


def test_every_flag_is_explained_in_the_room_it_belongs_to() -> None:
    page = (ROOT / "docs" / "quality-flags.md").read_text(encoding="utf-8")
    rooms = re.split(r"^## Edge|^## Track fit|^## Beside", page, flags=re.MULTILINE)
    for flags, text in zip((LOCALISATION_FLAGS, EDGE_FLAGS, TRACK_FLAGS, COMPANION_FLAGS), rooms, strict=True):
        assert set(re.findall(r"^\| `(\w+)` \|", text, flags=re.MULTILINE)) == set(flags)


def test_grades_and_the_flags_that_decide_them_are_described() -> None:
    page = (ROOT / "docs" / "quality-flags.md").read_text(encoding="utf-8").split("## Flags")[0]
    assert re.findall(r"^\| ([A-D]) \|", page, flags=re.MULTILINE) == list(GRADES)
    harmless, serious = page[page.index("Harmless are") :].split("serious are")
    assert set(re.findall(r"`(\w+)`", harmless)) == HARMLESS_FLAGS
    assert set(re.findall(r"`(\w+)`", serious.split(".")[0])) == SERIOUS_FLAGS
    assert f"at most {BEST_HALF_WIDTH_DEG:g}°" in page
    assert f"at most {GOOD_HALF_WIDTH_DEG:g}°" in page
    assert f"between {MISFIT_TAIL:g} and {1 - MISFIT_TAIL:g}" in page


def test_priors_of_the_track_are_those_of_the_model() -> None:
    page = (ROOT / "docs" / "tracks.md").read_text(encoding="utf-8")
    table = page[: page.index("**It assumes no density law")]
    flat_s = ", ".join(f"{sd:g}" for sd in model.EMISSION_FLAT_S[:-1])
    for words in (
        f"{model.WIND_KM_S:g} km/s over v is 1 ± {model.SLOWNESS_SD:g}",
        f"v from {model.WIND_KM_S / model.FASTEST:.0f} to {model.WIND_KM_S / model.SLOWEST:g} km/s",
        f"{model.LEVEL_RSUN:g} R☉ at {model.LEVEL_MHZ:g} MHz within a factor of {np.exp(model.LEVEL_SD):.0f}",
        f"is {model.SLOPE:g} ± {model.SLOPE_SD:g}",
        f"departs from a power law by {model.BEND_SD:g}, correlated over {model.BEND_LENGTH:g} in ln f",
        f"with {flat_s} and {model.EMISSION_FLAT_S[-1]:g} s",
        f"departure of {model.EMISSION_SMOOTH_S:g} s ({model.LEVEL_MHZ:g} MHz / f)",
        f"kappa {LITERATURE_DELAY.kappa:g} ± {LITERATURE_DELAY.kappa_sd:.2f}",
    ):
        assert words in table, words
    beams = f"({model.BEAM_SPEED_C:g} c, ln v ± {model.BEAM_LN_SD:g}) or one that slows as r^-d "
    assert f"{beams}(d = {model.SLOWING:g} ± {model.SLOWING_SD:g})" in " ".join(page.split())


def test_rule_of_the_preferred_edge_is_described_in_its_order() -> None:
    page = (ROOT / "docs" / "quality-flags.md").read_text(encoding="utf-8")
    rule = re.sub(r"\s+", " ", page[page.index("- The rule") : page.index("- A newer version")])
    assert f"edge {', '.join(f'`{edge}`' for edge in EDGE_ORDER)}, then others" in rule
    assert f"method `{METHOD_ORDER[0]}`; preset `{PRESET_ORDER[0]}`;" in rule


def test_every_method_preset_and_nuisance_is_described() -> None:
    text = (ROOT / "docs" / "localisation.md").read_text(encoding="utf-8")
    cells = re.findall(r"^\| ((?:`[\w-]+`(?:, )?)+) \|", text, flags=re.MULTILINE)
    named = {name for cell in cells for name in re.findall(r"`([\w-]+)`", cell)}
    assert named == {*METHODS, *PRESETS, *NUISANCE, RISE}


def test_every_route_stands_in_the_page_about_the_api() -> None:
    described = re.findall(r"^\| `(/[^`]+)` \| (.+) \|$", (ROOT / "docs" / "api.md").read_text(), flags=re.MULTILINE)
    routes = create_app(Settings()).openapi()["paths"]
    assert {route for route, _ in described} == set(routes)
    for route, text in described:
        if "post" in routes[route]:
            assert "`POST`" in text


def test_every_product_stands_in_the_page_about_spectra() -> None:
    page = (ROOT / "docs" / "spectra.md").read_text(encoding="utf-8")
    for product in PRODUCTS:
        verified = "yes" if product.verified else "no"
        assert f"| {product.name} | `{product.naming}` | {product.cadence} | {product.quantity} | {verified} |" in page


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_lead_somewhere(document: Path) -> None:
    links = re.findall(r"\]\(([^)#]+)[^)]*\)", document.read_text(encoding="utf-8"))
    local = [link for link in links if "://" not in link]
    assert [link for link in local if not (document.parent / link).exists()] == []


def test_changelog_has_this_version() -> None:
    versions = re.findall(r"^## \[(.+?)\]", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), flags=re.MULTILINE)
    assert versions[0] == "Unreleased"
    assert bella.__version__ in versions


def test_citation_names_this_version_and_the_paper() -> None:
    citation: dict[str, Any] = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["version"] == bella.__version__
    paper = citation["preferred-citation"]
    assert paper["doi"] == "10.1051/0004-6361/202347747"
    family = [author["family-names"] for author in paper["authors"]]
    assert family == ["Cañizares", "Badman", "Maloney", "Owens", "Weigt", "Carley", "Gallagher"]


def test_contributing_fits_a_screen() -> None:
    assert len((ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8").splitlines()) <= LINES_OF_A_SCREEN
