"""Housekeeping of a running service: what is removed, what is published, and what waits for its files."""

import time
from contextlib import closing
from pathlib import Path

import pytest

from bella.bursts import EVENT
from bella.catalogue import Catalogue
from bella.exceptions import NotPlacedError
from bella.pipeline.burst import BurstOutcome
from bella.pipeline.run import Run, keep_house
from bella.pipeline.workers import Workers
from bella.settings import Settings
from bella.store.layout import age_s
from tests.catalogue.examples import burst, publication
from tests.waiting import until


@pytest.fixture
def run(tmp_path: Path) -> Run:
    settings = Settings(home=tmp_path, database_url=None, events=tmp_path / "events", lease_s=0.2)
    return Run(settings, "housekeeping", Workers(1, settings))


def publish_event(run: Run, *, is_pending: bool = False) -> None:
    with closing(Catalogue.open(run.settings.catalogue_url, create=True)) as catalogue:
        track = {"frame": "HEE", "two_step": {}, "companions_pending": is_pending}
        catalogue.publish(publication(of=burst(EVENT.burst_id), track_fit=track))


def test_a_house_in_order_is_swept_and_nothing_is_published(run: Run) -> None:
    publish_event(run)
    left = run.settings.store_root / "T3-1" / "half_rise.zarr.zip"
    left.parent.mkdir(parents=True)
    left.touch()
    until(lambda: age_s(left, time.time()) > run.settings.lease_s)
    assert keep_house(run) == ["T3-1/half_rise.zarr.zip"]
    assert keep_house(run) == []
    with closing(Catalogue.open(run.settings.catalogue_url)) as catalogue:
        assert len(catalogue.versions(EVENT.burst_id)) == 1


def test_lists_of_events_are_read_once_their_folder_is_there(run: Run) -> None:
    publish_event(run)
    keep_house(run)  # the fetcher has not made the folder yet
    folder = run.settings.events
    assert folder is not None
    folder.mkdir()
    (folder / "20120607events.txt").write_text("no list\n")
    keep_house(run)
    with closing(Catalogue.open(run.settings.catalogue_url)) as catalogue:
        assert [one.name for one in catalogue.events.lists()] == ["20120607events.txt"]


@pytest.mark.parametrize("is_begun", [False, True])
def test_the_built_in_event_is_published_until_nothing_of_it_is_to_follow(
    run: Run, monkeypatch: pytest.MonkeyPatch, *, is_begun: bool
) -> None:
    """What localises it takes half a minute, and is tested with the command."""
    if is_begun:
        publish_event(run, is_pending=True)
    monkeypatch.setattr("bella.pipeline.run.process_subject", lambda name, _: BurstOutcome(name, reason="too noisy"))
    with pytest.raises(NotPlacedError, match="too noisy"):
        keep_house(run)


def test_a_burst_that_was_not_localised_has_published_nothing() -> None:
    with pytest.raises(NotPlacedError, match="two spacecraft only"):
        BurstOutcome("T3-1", reason="two spacecraft only").published()
    assert BurstOutcome("T3-1").published() == ()
