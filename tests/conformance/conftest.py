"""Real servers on the loopback, with bursts and detections behind one of them."""

from collections.abc import Iterator
from dataclasses import replace
from datetime import timedelta

import pytest

from bella.catalogue import Catalogue, Detection, ObservedDay, ReceiverDay, SearchedDay, SolutionTimes
from bella.records import DayAnswer
from bella.settings import Settings
from tests.api.published import ONSET, publish_event, publish_many, served, settings_of
from tests.linked_events.published import link_flare
from tests.plotting.synthetic import BURST_ID

HEARD = Detection(
    observatory="WIND",
    start_utc=ONSET,
    peak_utc=ONSET + timedelta(minutes=2),
    end_utc=ONSET + timedelta(minutes=20),
    f_low_mhz=0.2,
    f_high_mhz=8.0,
    score=9.5,
    drift=0.2,
    peak_db=12.5,
    channels=40,
    isolated=True,
    tier="localisable",
    reason="",
    burst_id=BURST_ID,
    flux_sfu_1au=3.2e5,
)


@pytest.fixture(scope="session")
def filled(tmp_path_factory: pytest.TempPathFactory) -> Settings:
    """Three bursts, and detections of which two have the same onset."""
    settings = settings_of(tmp_path_factory.mktemp("home"))
    later = {"start_utc": ONSET + timedelta(minutes=7), "tier": "rejected", "reason": "no drift, 3 channels"}
    found = [HEARD, replace(HEARD, observatory="STEREO-A"), replace(HEARD, burst_id="", **later)]
    with Catalogue.open(settings.catalogue_url, create=True) as catalogue:
        first, second = publish_event(settings, catalogue)
        publish_many(settings, catalogue, 2)
        catalogue.record_day(SearchedDay(ONSET.date(), "h", "0.1", ("WIND", "STEREO-A")), found)
        silent = SearchedDay(ONSET.date() + timedelta(days=1), "h", "0.1", (), DayAnswer.ARCHIVE_SILENT, "no answer")
        catalogue.record_unsearched(silent)
        wind = ReceiverDay(observatory="WIND", fraction=(0.5,) * 24)
        observed = ObservedDay(day=ONSET.date(), distances_rsun=(), longitudes_deg=(), receivers=(wind,), maps=())
        catalogue.operation.record_observed(observed, "h")
        link_flare(catalogue, BURST_ID, ONSET)
        hour = timedelta(hours=1)
        published_utc = ONSET + 90 * hour
        times = SolutionTimes(ONSET + hour, published_utc - 3 * hour, published_utc - 2 * hour, None, published_utc)
        catalogue.operation.record_times(first.solution_id, times)
        catalogue.operation.record_times(second.solution_id, replace(times, published_utc=published_utc + hour))
    return settings


@pytest.fixture(scope="session")
def address(filled: Settings) -> Iterator[str]:
    """Address of the server."""
    with served(filled) as base:
        yield base


@pytest.fixture(scope="session")
def empty_address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Address of a server whose catalogue has nothing yet."""
    settings = settings_of(tmp_path_factory.mktemp("empty"))
    Catalogue.open(settings.catalogue_url, create=True).close()
    with served(settings) as base:
        yield base
