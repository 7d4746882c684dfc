"""Observability of days that were searched before it had an origin is that of the archive."""

from contextlib import closing
from datetime import date

from bella.catalogue import ObservedDay
from bella.catalogue.catalogue import Catalogue
from bella.catalogue.engine import connect, parse_url
from bella.records import Origin
from tests.migrations.test_revisions import migrate


def test_days_of_the_archive_are_kept_both_ways(database_url: str) -> None:
    days = [
        ObservedDay(day=date(2021, 2, one), distances_rsun=(20.0,), longitudes_deg=(0.0,), receivers=(), maps=())
        for one in (1, 2)
    ]
    with closing(Catalogue.open(database_url, create=True)) as catalogue:
        catalogue.operation.record_observed(days[0], "hash")
        catalogue.operation.record_observed(days[0], "hash", Origin.SIMULATED)
        catalogue.operation.record_observed(days[1], "hash", Origin.SIMULATED)
    engine = connect(parse_url(database_url))
    migrate(engine, "0010")
    migrate(engine, "0011")
    engine.dispose()
    with closing(Catalogue.open(database_url)) as catalogue:
        assert catalogue.operation.observed_between(date(2021, 1, 1), date(2021, 3, 1)) == (days[0],)
        assert catalogue.operation.observed(days[0].day, tuple(Origin)) == days[0]
