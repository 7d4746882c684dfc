"""Inputs of a day are the newest whole files of the mirror: an outage, or a 404, takes none of them away."""

from collections.abc import Callable, Iterator
from datetime import date, timedelta
from pathlib import Path

import pytest

from bella.archive import Archive
from bella.exceptions import StoreError
from bella.pipeline.day_files import DayFiles, Mirror, answers_of, check_content, fetch_range
from bella.settings import Settings
from tests.archive.server import DAY, H1, L3, STEREO, Clock, Server, cdf, path_of, status, visit

NEXT = DAY + timedelta(days=1)


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[Server]:
    monkeypatch.setenv("no_proxy", "127.0.0.1")
    with Server() as running:
        yield running


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    return Settings(home=tmp_path / "home", in_situ=None, regions=None)


Fetch = Callable[[], tuple[str, ...]]


@pytest.fixture
def fetch(server: Server, settings: Settings, monkeypatch: pytest.MonkeyPatch) -> Fetch:
    """Ask the archive for the day, with waits that take no time."""

    def opened(url: str, **_: float) -> Archive:
        return visit(url, Clock())

    monkeypatch.setattr("bella.pipeline.day_files.open_archive", opened)
    return lambda: fetch_range([DAY], server.url, settings)


def inputs(settings: Settings, day: date = DAY) -> DayFiles:
    return Mirror(settings).day(day)


def names(files: DayFiles) -> list[str]:
    return [path.name for path in files.paths]


def test_an_outage_or_a_404_removes_no_input(server: Server, settings: Settings, fetch: Fetch) -> None:
    server.files = {path_of(H1): cdf(1), path_of(STEREO): cdf(2)}
    assert not any(H1.key in one for one in fetch())
    before = inputs(settings)
    assert len(before.paths) == 2

    for path in (path_of(STEREO), *(f"{folder}/" for folder in STEREO.folders(DAY))):
        server.faults[path] = [status(503)] * 100
    assert any(STEREO.key in one for one in fetch())
    assert inputs(settings) == before

    server.faults.clear()
    del server.files[path_of(STEREO)]
    fetch()
    assert inputs(settings) == before, "the archive lists it no more"

    server.files = {}
    fetch()
    assert inputs(settings) == before, "the archive has nothing at all"


def test_the_newest_whole_version_is_read(server: Server, settings: Settings, fetch: Fetch) -> None:
    server.files = {path_of(STEREO): cdf(1)}
    fetch()
    first = inputs(settings)
    server.files[path_of(STEREO, version="02")] = cdf(2)
    fetch()
    second = inputs(settings)
    assert [source.version for source in second.sources] == ["2"]
    assert second.inputs_hash != first.inputs_hash

    second.paths[0].write_bytes(second.paths[0].read_bytes()[:5000])
    assert inputs(settings) == first, "a file that is cut is passed over"


def test_a_file_put_there_by_hand_counts_where_it_is_whole(settings: Settings) -> None:
    path = settings.mirror_root / path_of(H1)
    path.parent.mkdir(parents=True)
    path.write_bytes(cdf(1))
    assert names(inputs(settings)) == [path.name]
    path.write_bytes(b"<html>not found</html>")
    assert names(inputs(settings)) == []


def test_neighbours_belong_to_a_day_that_has_a_file_itself(server: Server, settings: Settings, fetch: Fetch) -> None:
    server.files = {path_of(H1, NEXT): cdf(1)}
    fetch()
    assert inputs(settings).paths == ()
    server.files[path_of(STEREO)] = cdf(2)
    fetch()
    assert len(inputs(settings).paths) == 2


def test_no_data_and_a_silent_archive_are_told_apart(server: Server, settings: Settings, fetch: Fetch) -> None:
    server.files = {path_of(H1, NEXT): cdf(1)}
    assert H1.key in inputs(settings).silent, "an archive that was never asked has not answered"
    assert fetch() == ()
    assert inputs(settings).silent == ()
    assert answers_of(DAY, settings.mirror_root)[H1.key] == "no_file_yet"

    for folder in H1.folders(DAY):
        server.faults[f"{folder}/"] = [status(503)] * 100
    assert [one.partition(":")[0] for one in fetch()] == [H1.key]
    assert inputs(settings).silent == (H1.key,)
    assert inputs(settings, NEXT).silent == (), "its file is in the mirror"


def test_an_archive_without_any_folder_has_not_answered(server: Server, settings: Settings, fetch: Fetch) -> None:
    assert fetch() == ()
    assert {H1.key, STEREO.key, L3.key} <= set(inputs(settings).silent)


def test_a_damaged_note_of_answers_is_no_answer(server: Server, settings: Settings, fetch: Fetch) -> None:
    server.files = {path_of(H1, NEXT): cdf(1)}
    fetch()
    (settings.mirror_root / ".answers" / f"{DAY}.json").write_text("{")
    assert answers_of(DAY, settings.mirror_root) == {}


def test_a_mirror_that_cannot_be_used_is_the_disk_not_the_day(server: Server, settings: Settings, fetch: Fetch) -> None:
    server.files = {path_of(H1): cdf(1)}
    fetch()
    files = inputs(settings)
    assert check_content(files.paths[0], files.sources[0]) == ""
    files.paths[0].write_bytes(cdf(3))
    assert "checksum" in check_content(files.paths[0], files.sources[0])
    files.paths[0].unlink()
    with pytest.raises(StoreError, match="check the disk"):
        check_content(files.paths[0], files.sources[0])

    folder = files.paths[0].parent
    files.paths[0].with_name(f".{files.paths[0].name}.json").unlink()
    folder.rmdir()
    folder.write_text("a file in the place of a folder")
    with pytest.raises(StoreError, match="cannot be read"):
        inputs(settings)
    with pytest.raises(StoreError, match="cannot be written"):
        fetch()
