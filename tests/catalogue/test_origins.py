"""Simulated and test data are in no query and no count unless they are asked for."""

from dataclasses import replace

import pytest

from bella.catalogue import BurstQuery, Catalogue, DaySummary, DetectionQuery
from bella.records import REAL_ORIGINS, Origin, burst_name, origins_beside
from tests.catalogue.examples import burst, publication
from tests.catalogue.test_detections import DAY, START, STOP, received

SIMULATED, TEST = frozenset({Origin.SIMULATED}), frozenset({Origin.TEST})


def test_bursts_of_tests_are_listed_only_when_asked_for(catalogue: Catalogue) -> None:
    for origin in Origin:
        catalogue.publish(publication(of=burst(f"{origin.name}-1", origin=origin)))
    page = catalogue.bursts()
    assert {one.burst.origin for one in page.bursts} == set(REAL_ORIGINS)
    assert page.total == len(REAL_ORIGINS)
    (only,) = catalogue.bursts(BurstQuery(origins=SIMULATED)).bursts
    assert only.burst.origin is Origin.SIMULATED
    assert only.solutions[0].origin is Origin.SIMULATED
    assert catalogue.bursts(BurstQuery(origins=frozenset(Origin))).total == len(Origin)


def test_a_day_is_kept_once_for_each_origin(catalogue: Catalogue) -> None:
    simulated = replace(DAY, origin=Origin.SIMULATED, observatories=("SOLO",))
    catalogue.record_day(DAY, [received(3), received(7)])
    catalogue.record_day(simulated, [received(5)])
    assert catalogue.searched_day(DAY.day) == DAY
    assert catalogue.searched_day(DAY.day, (Origin.SIMULATED,)) == simulated
    assert catalogue.searched_day(DAY.day, (Origin.TEST,)) is None
    assert [one.start_utc.hour for one in catalogue.detections(DetectionQuery(START, STOP)).detections] == [3, 7]
    (only,) = catalogue.detections(DetectionQuery(START, STOP, origins=SIMULATED)).detections
    assert (only.start_utc.hour, only.origin) == (5, Origin.SIMULATED)
    assert [one.origin for one in catalogue.detections_of(DAY.day, SIMULATED)] == [Origin.SIMULATED]
    assert len(catalogue.detections_of(DAY.day)) == 2
    catalogue.record_day(simulated, [])
    assert len(catalogue.detections(DetectionQuery(START, STOP)).detections) == 2
    assert catalogue.detections(DetectionQuery(START, STOP, origins=SIMULATED)).detections == ()


def test_days_count_what_is_of_their_origin(catalogue: Catalogue) -> None:
    simulated = replace(DAY, origin=Origin.SIMULATED)
    catalogue.record_day(DAY, [received(3)])
    catalogue.record_day(simulated, [received(3), received(5), received(7)])
    real, drawn = DaySummary(DAY, 1, 0, 1, 0, 1), DaySummary(simulated, 3, 0, 3, 0, 3)
    assert catalogue.days().days == (real,)
    assert catalogue.days(origins=SIMULATED).days == (drawn,)
    page = catalogue.days(limit=1, origins=frozenset(Origin))
    assert page.days == (real, drawn)
    assert (page.total, page.next_last) == (1, None)
    assert catalogue.days(origins=TEST).total == 0


def test_days_beside_are_of_the_same_origins(catalogue: Catalogue) -> None:
    catalogue.record_day(DAY, [])
    catalogue.record_day(replace(DAY, day=DAY.day.replace(day=25), origin=Origin.TEST), [])
    catalogue.record_day(replace(DAY, day=DAY.day.replace(day=28)), [])
    assert catalogue.days_beside(DAY.day) == (None, DAY.day.replace(day=28))
    assert catalogue.days_beside(DAY.day, TEST) == (None, DAY.day.replace(day=25))


@pytest.mark.parametrize("origin", Origin)
def test_ids_of_one_origin_are_never_those_of_another(origin: Origin) -> None:
    name = burst_name("T3-20211120-0312", origin)
    assert name.endswith("20211120-0312")
    assert (name == "T3-20211120-0312") == (origin in {Origin.ARCHIVE, Origin.EVENT, Origin.SUBMISSION})
    assert origin in origins_beside(origin)
    assert Origin.ARCHIVE not in origins_beside(origin) or origin in {Origin.ARCHIVE, Origin.EVENT}
