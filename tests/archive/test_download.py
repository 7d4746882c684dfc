"""One file into the mirror, whatever happens on the way."""

import hashlib
import os
import random
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from bella.archive import Manners, versions
from bella.archive.download import complaint, download
from bella.archive.sources import open_source
from bella.exceptions import InputError, UnreachableError
from tests.archive.server import (
    DAY,
    H1,
    Clock,
    Handler,
    Server,
    body,
    cdf,
    cut_after,
    path_of,
    reset,
    status,
    visible,
    visit,
    whole_without_length,
)
from tests.waiting import PATIENCE_S, until

PATH = path_of(H1)
FOLDER = f"{H1.folders(DAY)[0]}/"
WHOLE = len(cdf())


def sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


@pytest.fixture
def stocked(server: Server) -> Server:
    server.put(PATH, cdf())
    return server


def hidden(mirror: Path) -> set[str]:
    return {path.name.removeprefix(f".{Path(PATH).name}") for path in mirror.rglob(".*")}


def test_a_cut_file_is_resumed_and_only_the_rest_is_sent(stocked: Server, clock: Clock, mirror: Path) -> None:
    stocked.faults[PATH] = [cut_after(30_000)]
    file = visit(stocked, clock).fetch(H1, DAY, mirror).files[0]
    assert file.sha256 == sha256(cdf())
    assert file.path.read_bytes() == cdf()
    assert stocked.sent[PATH] == WHOLE
    assert stocked.asked_for(PATH)[1]["Range"] == "bytes=30000-"
    assert hidden(mirror) == {".json"}


def test_the_next_run_resumes_too(stocked: Server, clock: Clock, mirror: Path) -> None:
    stocked.faults[PATH] = [cut_after(30_000)]
    with pytest.raises(UnreachableError, match="broke off"):
        visit(stocked, clock, attempts=1).fetch(H1, DAY, mirror)
    assert visible(mirror) == []
    assert hidden(mirror) == {".part", ".part.validator"}
    assert visit(stocked, clock).fetch(H1, DAY, mirror).state == "fetched"
    assert stocked.sent[PATH] == WHOLE


def test_what_changed_since_the_cut_is_not_put_together(stocked: Server, clock: Clock, mirror: Path) -> None:
    stocked.faults[PATH] = [cut_after(30_000)]
    with pytest.raises(UnreachableError):
        visit(stocked, clock, attempts=1).fetch(H1, DAY, mirror)
    stocked.put(PATH, cdf(1))
    visit(stocked, clock).fetch(H1, DAY, mirror)
    assert (mirror / PATH).read_bytes() == cdf(1)


@pytest.mark.parametrize("lacks", ["has_validators", "has_ranges"])
def test_without_ranges_or_validators_it_begins_anew(stocked: Server, clock: Clock, mirror: Path, lacks: str) -> None:
    setattr(stocked, lacks, False)
    stocked.faults[PATH] = [cut_after(30_000)]
    visit(stocked, clock).fetch(H1, DAY, mirror)
    assert (mirror / PATH).read_bytes() == cdf()
    assert stocked.sent[PATH] == WHOLE + 30_000


def another_part(handler: Handler) -> None:
    handler.answer(206, cdf()[10:], Content_Range=f"bytes 10-{WHOLE - 1}/{WHOLE}")


@pytest.mark.parametrize("second", [another_part, status(416)], ids=["another part", "no such part"])
def test_a_wrong_rest_is_thrown_away(stocked: Server, clock: Clock, mirror: Path, second) -> None:
    stocked.faults[PATH] = [cut_after(30_000), second]
    visit(stocked, clock).fetch(H1, DAY, mirror)
    assert (mirror / PATH).read_bytes() == cdf()


WRONG = {
    "html": (b"<!DOCTYPE html>\n<html><body>Please log in</body></html>", "an HTML page"),
    "zeros": (bytes(5000), "not a CDF file"),
    "empty": (b"", "not a CDF file"),
    "gzip": (b"\x1f\x8b" + cdf(), "not a CDF file"),
    "cut at its source": (cdf()[:-100], f"cut after {WHOLE - 100} bytes"),
    "head alone": (cdf()[:16], "cut after 16 bytes"),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_not_the_file_never_gets_its_name(stocked: Server, clock: Clock, mirror: Path, name: str) -> None:
    content, reason = WRONG[name]
    stocked.faults[PATH] = [body(content)] * 4
    with pytest.raises(UnreachableError, match=reason):
        visit(stocked, clock).fetch(H1, DAY, mirror)
    assert visible(mirror) == []
    assert hidden(mirror) == set()
    assert visit(stocked, clock).fetch(H1, DAY, mirror).state == "fetched"


@pytest.mark.parametrize("name", WRONG)
def test_what_is_not_the_file_does_not_touch_the_old_one(
    stocked: Server, clock: Clock, mirror: Path, name: str
) -> None:
    visit(stocked, clock).fetch(H1, DAY, mirror)
    stocked.faults[PATH] = [body(WRONG[name][0])] * 4
    with pytest.raises(UnreachableError):
        visit(stocked, clock).fetch(H1, DAY, mirror)
    assert (mirror / PATH).read_bytes() == cdf()
    assert len(versions(mirror / PATH)) == 1


def test_real_archive_files_are_whole(reference_files: Path) -> None:
    files = sorted(reference_files.rglob("*.cdf"))
    assert len(files) >= 3
    assert {complaint(path, "x.cdf") for path in files} == {""}


def test_real_archive_file_that_was_cut_is_noticed(reference_files: Path, tmp_path: Path) -> None:
    for number, path in enumerate(sorted(reference_files.rglob("*.cdf"))):
        cut = tmp_path / f"{number}.cdf"
        cut.write_bytes(path.read_bytes()[:-1])
        assert complaint(cut, "x.cdf").startswith("cut after")


def test_files_of_other_forms_are_taken(tmp_path: Path) -> None:
    path = tmp_path / "x.cdf"
    for content in (cdf(compressed=6), b"\xcd\xf2\x60\x02\x00\x00\xff\xff" + bytes(900)):
        path.write_bytes(content)
        assert complaint(path, "x.cdf") == ""
    path.write_bytes(cdf(compressed=6)[:-1])
    assert complaint(path, "x.cdf").startswith("cut after")


def test_a_reset_connection_is_tried_again(stocked: Server, clock: Clock, mirror: Path) -> None:
    stocked.faults[PATH] = [reset, reset]
    assert visit(stocked, clock).fetch(H1, DAY, mirror).files[0].sha256 == sha256(cdf())


def test_a_file_of_unknown_length_is_checked_by_its_content(stocked: Server, clock: Clock, mirror: Path) -> None:
    stocked.faults[PATH] = [whole_without_length(cdf()[:-9]), whole_without_length(cdf())]
    visit(stocked, clock).fetch(H1, DAY, mirror)
    assert (mirror / PATH).read_bytes() == cdf()
    assert len(stocked.asked_for(PATH)) == 2


def test_date_alone_tells_of_a_change(stocked: Server, clock: Clock, mirror: Path) -> None:
    old, new = "Sun, 09 Sep 2001 01:46:40 GMT", "Mon, 10 Sep 2001 01:46:40 GMT"
    dates = [(cdf(), old), (cdf(1), old), (cdf(1), new)]
    stocked.faults[PATH] = [body(content, Last_Modified=when) for content, when in dates]
    states = [visit(stocked, clock).fetch(H1, DAY, mirror).state for _ in dates]
    assert states == ["fetched", "unchanged", "replaced"]
    assert stocked.asked_for(PATH)[1]["If-Modified-Since"] == old


def test_checksum_of_a_real_archive_file_is_heeded(reference_files: Path, tmp_path: Path) -> None:
    (real,) = reference_files.rglob("wi_wa_rad1_l3_df_20200711_v01.cdf")
    content = bytearray(real.read_bytes())
    content[len(content) // 2] ^= 1
    (tmp_path / "x.cdf").write_bytes(content)
    assert complaint(tmp_path / "x.cdf", "x.cdf") == "damaged: its checksum does not fit"


@pytest.mark.parametrize("has_validators", [True, False])
def test_what_is_there_is_not_sent_again(stocked: Server, clock: Clock, mirror: Path, has_validators: bool) -> None:
    stocked.has_validators = has_validators
    states = [visit(stocked, clock).fetch(H1, DAY, mirror).state for _ in range(3)]
    assert states == ["fetched", "unchanged", "unchanged"]
    assert len(versions(mirror / PATH)) == 1
    if has_validators:
        assert stocked.sent[PATH] == WHOLE


@pytest.mark.parametrize("has_validators", [True, False])
def test_a_file_that_changed_under_its_name_is_fetched_again(
    stocked: Server, clock: Clock, mirror: Path, has_validators: bool
) -> None:
    # without validators a change shows in the length alone
    stocked.has_validators = has_validators
    visit(stocked, clock).fetch(H1, DAY, mirror)
    changed = cdf(1) if has_validators else cdf(1) + bytes(8)
    stocked.put(PATH, changed)
    file = visit(stocked, clock).fetch(H1, DAY, mirror).files[0]
    assert (file.state, file.sha256, file.supersedes) == ("replaced", sha256(changed), sha256(cdf()))
    assert [version.sha256 for version in versions(mirror / PATH)] == [sha256(cdf()), sha256(changed)]
    assert visit(stocked, clock).fetch(H1, DAY, mirror).state == "unchanged"


def test_the_same_content_under_another_tag_is_no_change(stocked: Server, clock: Clock, mirror: Path) -> None:
    visit(stocked, clock).fetch(H1, DAY, mirror)
    stocked.faults[PATH] = [body(cdf(), ETag='"moved"')]
    assert visit(stocked, clock).fetch(H1, DAY, mirror).state == "unchanged"
    (version,) = versions(mirror / PATH)
    assert version.etag == '"moved"'


def test_a_damaged_file_is_repaired_and_told_of(stocked: Server, clock: Clock, mirror: Path) -> None:
    visit(stocked, clock).fetch(H1, DAY, mirror)
    damaged = bytes(WHOLE)
    (mirror / PATH).write_bytes(damaged)
    file = visit(stocked, clock).fetch(H1, DAY, mirror).files[0]
    assert (file.sha256, file.supersedes) == (sha256(cdf()), sha256(damaged))
    assert (mirror / PATH).read_bytes() == cdf()


@pytest.mark.parametrize("seed", range(12))
def test_many_faults_in_a_row_never_show_and_never_last(stocked: Server, clock: Clock, mirror: Path, seed: int) -> None:
    chance = random.Random(seed)
    for _ in range(4):
        stocked.put(PATH, cdf(chance.randrange(3)))
        faults = [cut_after(chance.randrange(WHOLE)), status(500), status(416), body(b"<html>"), another_part]
        stocked.faults[PATH] = chance.choices(faults, k=chance.randrange(8))
        with suppress(UnreachableError):
            visit(stocked, clock).fetch(H1, DAY, mirror)
        for name in visible(mirror):
            assert (mirror / name).read_bytes() in {cdf(0), cdf(1), cdf(2)}
    stocked.faults.clear()
    file = visit(stocked, clock).fetch(H1, DAY, mirror).files[0]
    assert file.path.read_bytes() == stocked.files[PATH]
    assert versions(file.path)[-1].sha256 == file.sha256 == sha256(stocked.files[PATH])


class KilledError(BaseException):
    """What no code may catch."""


STEPS = [(Path, "write_bytes"), (Path, "write_text"), (Path, "replace"), (Path, "unlink"), (os, "fsync")]


def die_in(step: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """End the run before the step of that number that changes the disk, or in its middle if it writes."""
    left = [step]

    def dying(original: Callable[..., Any]) -> Callable[..., Any]:
        def wrapped(*arguments: Any, **named: Any) -> Any:
            left[0] -= 1
            if left[0] < 0:
                if original.__name__.startswith("write_"):
                    path, content = arguments
                    original(path, content[: len(content) // 2], **named)
                raise KilledError
            return original(*arguments, **named)

        return wrapped

    for owner, name in STEPS:
        monkeypatch.setattr(owner, name, dying(getattr(owner, name)))


@pytest.mark.parametrize("is_old_there", [False, True])
def test_a_run_that_dies_in_any_step_is_made_good_by_the_next(
    stocked: Server, clock: Clock, mirror: Path, is_old_there: bool
) -> None:
    died = 0
    for step in range(20):
        here = mirror / str(step)
        old = [cdf()] * is_old_there
        for content in [*old, cdf(1)]:
            stocked.put(PATH, content)
            with pytest.MonkeyPatch.context() as patch, suppress(KilledError):
                if content == cdf(1):
                    die_in(step, patch)
                visit(stocked, clock).fetch(H1, DAY, here)
                died -= content == cdf(1)
        died += 1
        assert [(here / name).read_bytes() in {*old, cdf(1)} for name in visible(here)] in ([], [True])
        file = visit(stocked, clock).fetch(H1, DAY, here).files[0]
        assert file.path.read_bytes() == cdf(1)
        assert [version.sha256 for version in versions(file.path)] == [sha256(one) for one in [*old, cdf(1)]]
    assert died == 8


def test_a_change_that_a_dead_run_did_not_tell_of_is_told_by_the_next(
    stocked: Server, clock: Clock, mirror: Path
) -> None:
    visit(stocked, clock).fetch(H1, DAY, mirror)
    stocked.put(PATH, cdf(1))
    (mirror / PATH).write_bytes(cdf(1))
    file = visit(stocked, clock).fetch(H1, DAY, mirror).files[0]
    assert (file.state, file.supersedes) == ("replaced", sha256(cdf()))


@pytest.mark.parametrize("record", ["", "{", "[1]", '[{"sha": 1}]'])
def test_a_lost_or_damaged_record_costs_a_download_no_more(
    stocked: Server, clock: Clock, mirror: Path, record: str
) -> None:
    visit(stocked, clock).fetch(H1, DAY, mirror)
    path = (mirror / PATH).with_name(f".{Path(PATH).name}.json")
    path.write_text(record)
    assert visit(stocked, clock).fetch(H1, DAY, mirror).state == "fetched"
    assert [version.sha256 for version in versions(mirror / PATH)] == [sha256(cdf())]


def test_a_file_that_vanished_after_the_listing_is_not_no_data(stocked: Server, clock: Clock, mirror: Path) -> None:
    stocked.faults[PATH] = [status(404)]
    with pytest.raises(UnreachableError, match="listed by the archive but not there"):
        visit(stocked, clock).fetch(H1, DAY, mirror)


def test_names_that_lead_elsewhere_are_not_followed(stocked: Server, clock: Clock, mirror: Path) -> None:
    name = Path(PATH).name.replace("v01", "v09")
    links = "".join(f'<a href="{start}{name}">x</a>' for start in ("..%2f..%2f", "%5c..%5c", "/etc/", "x%00"))
    stocked.faults[FOLDER] = [body(f"<html>Index of {links}</html>".encode())]
    with pytest.raises(UnreachableError, match="not there"):
        visit(stocked, clock).fetch(H1, DAY, mirror)
    assert {path for path, _ in stocked.asked} == {FOLDER, PATH.replace("v01", "v09")}


@pytest.mark.parametrize("path", ["../x.cdf", "/x.cdf", "pub/../../x.cdf"])
def test_nothing_is_written_outside_the_mirror(stocked: Server, mirror: Path, path: str) -> None:
    with pytest.raises(InputError, match="leads out of the mirror"):
        download(open_source(stocked.url, 5.0), Manners(), path, mirror)
    assert stocked.asked == []
    assert not mirror.exists()


def test_a_full_disk_is_said_to_be_one(
    stocked: Server, clock: Clock, mirror: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(InputError, match="No space left on device"):
        visit(stocked, clock).fetch(H1, DAY, mirror)
    assert visible(mirror) == []


FETCH = """
import sys
from datetime import date
from pathlib import Path
from bella.archive import find_datasets, open_archive
archive, (dataset,) = open_archive(sys.argv[1], interval_s=0.01), find_datasets(["WI_H1_WAV"])
day = archive.fetch(dataset, date(2012, 6, 7), Path(sys.argv[2]))
print(day.state, day.files[0].sha256)
"""


def start(server: Server, mirror: Path) -> "subprocess.Popen[str]":
    command = [sys.executable, "-c", FETCH, server.url, str(mirror)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env={**os.environ, "no_proxy": "127.0.0.1"})


def test_a_killed_process_leaves_nothing_that_looks_like_data(stocked: Server, clock: Clock, mirror: Path) -> None:
    def stall(handler: Handler) -> None:
        handler.send_response(200)
        handler.send_header("Content-Length", str(WHOLE))
        handler.send_header("ETag", f'"{hashlib.md5(cdf()).hexdigest()}"')
        handler.end_headers()
        handler.wfile.write(cdf()[:40_000])
        handler.wfile.flush()
        handler.connection.settimeout(PATIENCE_S)
        handler.rfile.read(1)  # until the process is gone

    stocked.faults[PATH] = [stall]
    process = start(stocked, mirror)
    part = (mirror / PATH).with_name(f".{Path(PATH).name}.part")
    until(lambda: part.exists() and part.stat().st_size)
    process.send_signal(signal.SIGKILL)
    process.communicate(timeout=PATIENCE_S)
    assert visible(mirror) == []
    came = part.stat().st_size
    assert 0 < came <= 40_000
    assert visit(stocked, clock).fetch(H1, DAY, mirror).state == "fetched"
    assert (mirror / PATH).read_bytes() == cdf()
    assert stocked.sent[PATH] == WHOLE - came


def test_two_processes_end_with_one_good_file(stocked: Server, mirror: Path) -> None:
    both, under_way, most = threading.Barrier(2, timeout=PATIENCE_S), set[Handler](), [0]

    def list_for_both(handler: Handler) -> None:
        both.wait()
        handler.send_listing(FOLDER)

    def slow(handler: Handler) -> None:
        under_way.add(handler)
        most[0] = max(most[0], len(under_way))
        time.sleep(0.3)  # long enough for the other to come in, were it let
        handler.send_file(PATH, stocked.files[PATH])
        under_way.remove(handler)

    stocked.faults[FOLDER] = [list_for_both] * 2
    stocked.faults[PATH] = [slow] * 2
    processes = [start(stocked, mirror) for _ in range(2)]
    printed = sorted(process.communicate(timeout=PATIENCE_S)[0].split() for process in processes)
    assert printed == [["fetched", sha256(cdf())], ["unchanged", sha256(cdf())]]
    assert (mirror / PATH).read_bytes() == cdf()
    assert hidden(mirror) == {".json"}
    assert len(versions(mirror / PATH)) == 1
    assert stocked.sent[PATH] == WHOLE
    assert most == [1]
