"""The archive, asked over HTTP: what is there, what is not yet, and what could not be asked."""

import json
import socket
import threading
from datetime import date, timedelta
from pathlib import Path

import pytest

from bella.archive import fetch_days, open_archive, versions
from bella.exceptions import InputError, UnreachableError
from tests.archive.server import (
    DAY,
    H1,
    L2,
    L3,
    STEREO,
    Clock,
    Server,
    body,
    cdf,
    cut_after,
    dribble,
    path_of,
    silent,
    status,
    visible,
    visit,
    whole_without_length,
)

ONE = timedelta(days=1)
MAINTENANCE = b"<!DOCTYPE html><html><body>Down for maintenance, <a href='/contact'>ask</a></body></html>"


def test_newest_version_is_found(server: Server, clock: Clock) -> None:
    for version in ("02", "10", "9"):
        server.put(path_of(STEREO, version=version), cdf())
    server.put(path_of(STEREO, DAY + ONE, "11"), cdf())
    server.put(path_of(STEREO, version="12") + ".sha256", b"no data file")
    found = visit(server, clock).find(STEREO, DAY)
    assert found.paths == (path_of(STEREO, version="10"),)
    assert found.complete


def test_a_newer_version_is_fetched_beside_the_older_one(server: Server, clock: Clock, mirror: Path) -> None:
    old = server.put(path_of(STEREO), cdf())
    visit(server, clock).fetch(STEREO, DAY, mirror)
    new = server.put(path_of(STEREO, version="02"), cdf(1))
    outcome = visit(server, clock).fetch(STEREO, DAY, mirror)
    assert outcome.state == "fetched"
    assert [file.path for file in outcome.files] == [mirror / new]
    assert visible(mirror) == [old, new]


def test_both_spellings_of_a_folder_count(server: Server, clock: Clock) -> None:
    server.put(path_of(L3, spelling=0), cdf())
    newer = server.put(path_of(L3, version="02", spelling=1), cdf())
    assert visit(server, clock).find(L3, DAY).paths == (newer,)
    del server.files[newer]
    assert visit(server, clock).find(L3, DAY).paths == (path_of(L3),)


def test_upper_case_names_are_the_same_files(server: Server, clock: Clock) -> None:
    path = path_of(H1, version="03").replace("_v03", "_V03").replace("wi_h1", "WI_H1")
    server.put(path, cdf())
    assert visit(server, clock).find(H1, DAY).paths == (path,)


def test_a_day_that_is_not_a_file_takes_its_neighbours(server: Server, clock: Clock, mirror: Path) -> None:
    last = date(2012, 12, 31)
    paths = [server.put(path_of(L2, day), cdf()) for day in (last, last - ONE)]
    part = visit(server, clock).fetch(L2, last, mirror)
    assert not part.complete
    assert [file.path for file in part.files] == [mirror / path for path in paths]
    paths.append(server.put(path_of(L2, last + ONE), cdf(1)))
    whole = visit(server, clock).fetch(L2, last, mirror)
    assert whole.complete
    assert whole.state == "fetched"
    assert {file.path for file in whole.files} == {mirror / path for path in paths}


def test_a_run_lists_a_folder_once_and_asks_for_a_file_once(server: Server, clock: Clock, mirror: Path) -> None:
    days = [DAY + number * ONE for number in range(3)]
    for day in days:
        server.put(path_of(L2, day), cdf())
    assert [one.state for one in fetch_days(visit(server, clock), [L2], days, mirror)] == ["fetched"] * 3
    assert len(server.asked) == 4


def test_no_file_yet_is_an_answer_with_the_day_it_is_due(server: Server, clock: Clock, mirror: Path) -> None:
    server.put(path_of(STEREO, DAY - ONE), cdf())
    outcome = visit(server, clock).fetch(STEREO, DAY, mirror)
    assert (outcome.state, outcome.due, outcome.files) == ("no_file_yet", date(2012, 6, 10), ())


def test_a_year_that_has_not_begun_in_the_archive_is_no_file_yet(server: Server, clock: Clock, mirror: Path) -> None:
    server.put(path_of(STEREO, date(2012, 12, 31)), cdf())
    assert visit(server, clock).fetch(STEREO, date(2013, 1, 1), mirror).state == "no_file_yet"


def test_an_archive_without_the_data_set_is_not_no_data(server: Server, clock: Clock) -> None:
    server.put(path_of(STEREO), cdf())
    with pytest.raises(UnreachableError, match="has no folder pub/data/wind"):
        visit(server, clock).find(H1, DAY)


def test_days_outside_the_data_set_are_not_asked_for(server: Server, clock: Clock, mirror: Path) -> None:
    outcome = visit(server, clock).fetch(H1, date(2022, 1, 1), mirror)
    assert (outcome.state, outcome.due) == ("not_covered", None)
    assert server.asked == []


@pytest.mark.parametrize("code", [429, 500, 503])
def test_an_error_that_passes_is_overcome(server: Server, clock: Clock, mirror: Path, code: int) -> None:
    path = server.put(path_of(H1), cdf())
    server.faults[f"{H1.folders(DAY)[0]}/"] = [status(code), status(code)]
    server.faults[path] = [status(code)]
    assert visit(server, clock).fetch(H1, DAY, mirror).state == "fetched"
    assert (mirror / path).read_bytes() == cdf()


def test_the_archive_says_how_long_to_wait(server: Server, clock: Clock) -> None:
    server.put(path_of(H1), cdf())
    server.faults[f"{H1.folders(DAY)[0]}/"] = [status(503, Retry_After="17"), status(503, Retry_After="86400")]
    assert visit(server, clock).find(H1, DAY).paths
    assert clock.waits == [17.0, 60.0]


def always_down(server: Server, fault_of_file: bool) -> str:
    path = server.put(path_of(H1), cdf())
    subject = path if fault_of_file else f"{H1.folders(DAY)[0]}/"
    server.faults[subject] = [status(500)] * 99
    return subject


@pytest.mark.parametrize("fault_of_file", [True, False])
def test_an_archive_that_is_down_is_not_no_data(
    server: Server, clock: Clock, mirror: Path, fault_of_file: bool
) -> None:
    subject = always_down(server, fault_of_file)
    with pytest.raises(UnreachableError, match="500") as caught:
        visit(server, clock).fetch(H1, DAY, mirror)
    assert caught.value.retriable
    assert len(server.asked_for(subject)) == 4
    assert visible(mirror) == []
    server.faults.clear()
    assert visit(server, clock).fetch(H1, DAY, mirror).state == "fetched"


def test_a_run_does_not_hammer_an_archive_that_is_down(server: Server, clock: Clock, mirror: Path) -> None:
    days = [DAY + number * ONE for number in range(50)]
    for day in days:
        server.faults[server.put(path_of(STEREO, day), cdf())] = [status(500)] * 9
    outcomes = list(fetch_days(visit(server, clock, budget=8), [STEREO], days, mirror))
    assert {one.state for one in outcomes} == {"unreachable"}
    assert len(server.asked) == 1 + 9
    assert "not asked again in this run" in outcomes[-1].message


def test_errors_that_waiting_does_not_cure_are_not_repeated(server: Server, clock: Clock) -> None:
    folder = f"{H1.folders(DAY)[0]}/"
    server.faults[folder] = [status(403)] * 9
    with pytest.raises(UnreachableError, match="403"):
        visit(server, clock).find(H1, DAY)
    assert len(server.asked_for(folder)) == 1


def test_one_archive_down_does_not_stop_the_others(server: Server, clock: Clock, mirror: Path) -> None:
    always_down(server, fault_of_file=False)
    server.put(path_of(STEREO), cdf())
    outcomes = list(fetch_days(visit(server, clock), [H1, STEREO], [DAY], mirror))
    assert [one.state for one in outcomes] == ["unreachable", "fetched"]


@pytest.mark.parametrize("page", [MAINTENANCE, b"", b"<html>Index of /pub"], ids=["notice", "empty", "cut"])
def test_a_page_that_lists_nothing_is_not_no_data(server: Server, clock: Clock, page: bytes) -> None:
    length = {"Content_Length": str(len(page) + 30)} if page.startswith(b"<html>Index") else {}
    server.faults[f"{STEREO.folders(DAY)[0]}/"] = [body(page, **length)] * 4
    with pytest.raises(UnreachableError, match=r"not the listing|broke off"):
        visit(server, clock).find(STEREO, DAY)


def test_an_archive_that_says_nothing_is_given_up(server: Server, clock: Clock) -> None:
    released = threading.Event()
    server.faults[f"{H1.folders(DAY)[0]}/"] = [silent(released)] * 2
    with pytest.raises(UnreachableError, match="timed out"):
        visit(server, clock, timeout_s=0.1, attempts=2).find(H1, DAY)
    released.set()


def test_an_archive_that_dribbles_is_given_up(
    server: Server, clock: Clock, mirror: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bella.archive.sources.LONGEST_REQUEST_S", 0.5)
    path = server.put(path_of(H1), cdf())
    server.faults[path] = [dribble]
    assert visit(server, clock).fetch(H1, DAY, mirror).state == "fetched"
    assert len(server.asked_for(path)) == 2
    assert (mirror / path).read_bytes() == cdf()


def test_nobody_listens(clock: Clock) -> None:
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        url = f"http://127.0.0.1:{unused.getsockname()[1]}"
        with pytest.raises(UnreachableError, match="refused"):
            visit(url, clock).find(H1, DAY)
    assert clock.waits == [1.0, 2.0, 4.0]


def test_requests_are_spaced(server: Server, clock: Clock, mirror: Path) -> None:
    days = [DAY + number * ONE for number in range(4)]
    for day in days:
        server.put(path_of(H1, day), cdf())
    list(fetch_days(visit(server, clock, interval_s=1.5), [H1], days, mirror))
    assert len(server.asked) == 5
    assert clock.now == pytest.approx(4 * 1.5)


@pytest.mark.parametrize(
    "root",
    [
        "ftp://127.0.0.1",
        "",
        "/nowhere/at/all",
        "http://",
        "http://me:secret@127.0.0.1",
        "http://x:y",
        "http://[::1",
        "\0",
    ],
)
def test_what_is_no_archive_is_refused(root: str) -> None:
    with pytest.raises(InputError, match="neither an http"):
        open_archive(root)


def test_a_folder_is_an_archive_too(tmp_path: Path, mirror: Path) -> None:
    path = tmp_path / "archive" / path_of(H1)
    path.parent.mkdir(parents=True)
    path.write_bytes(cdf())

    def outcome(day: date = DAY) -> str:
        return open_archive(str(tmp_path / "archive")).fetch(H1, day, mirror).state

    assert [outcome(), outcome(), outcome(DAY + ONE)] == ["fetched", "unchanged", "no_file_yet"]
    path.write_bytes(cdf(1))
    assert outcome() == "replaced"
    assert (mirror / path_of(H1)).read_bytes() == cdf(1)
    assert open_archive(str(mirror)).find(H1, DAY).paths == (path_of(H1),)


def test_a_folder_without_the_data_set_is_not_no_data(tmp_path: Path) -> None:
    with pytest.raises(UnreachableError, match="has no folder"):
        open_archive(str(tmp_path)).find(H1, DAY)


def test_a_mirror_that_cannot_be_written_is_named(server: Server, clock: Clock, tmp_path: Path) -> None:
    server.put(path_of(H1), cdf())
    (tmp_path / "mirror").write_text("a file")
    with pytest.raises(InputError, match="cannot be written"):
        visit(server, clock).fetch(H1, DAY, tmp_path / "mirror")


def test_the_record_says_what_was_fetched(server: Server, clock: Clock, mirror: Path) -> None:
    path = server.put(path_of(H1), cdf())
    file = visit(server, clock).fetch(H1, DAY, mirror).files[0]
    (version,) = versions(mirror / path)
    assert (version.sha256, version.size_bytes) == (file.sha256, len(cdf()))
    assert json.loads((mirror / path).with_name(f".{Path(path).name}.json").read_text())[0]["etag"] == version.etag


def test_a_listing_of_unknown_length_must_come_to_its_end(server: Server, clock: Clock) -> None:
    path = server.put(path_of(H1), cdf())
    page = f'<html><title>Index of x</title><a href="{Path(path).name}">x</a>'.encode()
    pages = [whole_without_length(page[:40]), whole_without_length(page + b"</html>")]
    server.faults[f"{H1.folders(DAY)[0]}/"] = pages
    assert visit(server, clock).find(H1, DAY).paths == (path,)


def test_a_folder_that_cannot_be_read_is_not_no_data(
    tmp_path: Path, mirror: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / path_of(H1)
    path.mkdir(parents=True)
    with pytest.raises(UnreachableError, match="cannot be read: Is a directory"):
        open_archive(str(tmp_path)).fetch(H1, DAY, mirror)
    path.rmdir()
    path.symlink_to(tmp_path / "nothing")
    with pytest.raises(UnreachableError, match="listed by the archive but not there"):
        open_archive(str(tmp_path)).fetch(H1, DAY, mirror)

    def broken(_: object) -> list[str]:
        raise OSError(5, "Input/output error")

    monkeypatch.setattr("os.listdir", broken)
    with pytest.raises(UnreachableError, match="Input/output error"):
        open_archive(str(tmp_path)).find(H1, DAY)


def test_cut_listing_then_whole_one(server: Server, clock: Clock) -> None:
    server.put(path_of(H1), cdf())
    server.faults[f"{H1.folders(DAY)[0]}/"] = [body(b"<html>Index of", Content_Length="9999")]
    assert visit(server, clock).find(H1, DAY).paths == (path_of(H1),)


def test_cut_file_is_not_seen(server: Server, clock: Clock, mirror: Path) -> None:
    server.faults[server.put(path_of(H1), cdf())] = [cut_after(1000)]
    with pytest.raises(UnreachableError, match=f"{len(cdf()) - 1000} bytes are missing"):
        visit(server, clock, attempts=1).fetch(H1, DAY, mirror)
    assert visible(mirror) == []
