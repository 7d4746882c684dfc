"""The load of the API in short: a small catalogue, every kind of request answered, on a real server."""

import asyncio
from datetime import UTC, datetime
from pathlib import Path

import pytest

from bella.catalogue import BurstQuery, Catalogue
from bella.settings import Settings
from benchmarks import load
from benchmarks.large_catalogue import BURSTS_A_DAY, fill, make_template

LOCALISATIONS = 1000


@pytest.fixture(scope="module")
def template(tmp_path_factory: pytest.TempPathFactory) -> Path:
    home = tmp_path_factory.mktemp("template")
    make_template(home, draws=100)
    return home


@pytest.mark.acceptance
def test_a_large_catalogue_is_one_of_many_bursts(template: Path, tmp_path: Path) -> None:
    settings = Settings(home=tmp_path / "home", database_url=None)
    settings.home.mkdir()
    made = fill(settings, template, LOCALISATIONS)
    assert made.localisations >= LOCALISATIONS
    with Catalogue.open(settings.catalogue_url) as catalogue:
        page = catalogue.bursts(BurstQuery(limit=1000))
        assert page.total == len(made.burst_ids) + 1
        first = catalogue.burst(made.burst_ids[0])
        assert first.burst.start_utc == datetime(2007, 1, 1, 0, 37, 3, tzinfo=UTC)
        assert len({one.preferred.answer.phi0_deg for one in page.bursts if one.preferred}) > len(made.burst_ids) // 2
        (day,) = catalogue.days(made.days[0], made.days[0]).days
        assert day.bursts == day.localised == BURSTS_A_DAY


@pytest.mark.acceptance
def test_every_kind_of_request_is_answered(template: Path, tmp_path: Path) -> None:
    with load.served(tmp_path / "home", template, LOCALISATIONS, postgres=False) as (service, made):
        some = load.kinds(made)
        cpu = load.alone(service, some, 2, 1)
        found = asyncio.run(load.mixed(service, some, 100, 20.0, 1))
    assert (found.lost, found.refused) == (0, 0)
    ((_, mean, _),) = load.report("sqlite", some, cpu, found)
    assert mean.endswith(" ms")
