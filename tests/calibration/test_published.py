"""The page that is published is of this table of strata, and all of it passes."""

from pathlib import Path

import pytest

from bella.calibration import STRATA, calibration_page, failing, parse_verdicts
from bella.calibration.verdict import Verdict

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture(scope="module")
def published() -> list[Verdict]:
    return parse_verdicts((DOCS / "calibration.csv").read_text(encoding="utf-8"))


def test_every_stratum_is_published_as_it_is_declared(published: list[Verdict]) -> None:
    assert [(one.stratum, one.model, one.receivers, one.sigma_s) for one in published] == [
        (stratum.name, stratum.model, stratum.receivers, stratum.sigma_s) for stratum in STRATA
    ]
    assert min(one.sources for one in published) >= 500


def test_every_declared_stratum_passes(published: list[Verdict]) -> None:
    assert failing(published) == []


def test_page_is_that_of_the_table(published: list[Verdict]) -> None:
    page = calibration_page(published, table="calibration.csv", figure="calibration.png")
    assert (DOCS / "calibration.md").read_text(encoding="utf-8") == page
    assert (DOCS / "calibration.png").stat().st_size < 200_000
