"""One file of the archive into the mirror: resumed, checked, renamed, and recorded with its checksum.

Beside ``name`` in the mirror are hidden files: ``.name.json`` lists every version that was ever seen under this name,
``.name.part`` is what has come of one that is not yet complete, and ``.name.part.validator`` says of which.
"""

import fcntl
import hashlib
import json
import os
import struct
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import BinaryIO, Literal

from bella.archive.manners import Manners, TryAgainError
from bella.archive.sources import PIECE_BYTES, FolderSource, Reply, Source
from bella.exceptions import InputError, UnreachableError

MAGIC = (b"\xcd\xf3\x00\x01", b"\xcd\xf2\x60\x02", b"\x00\x00\xff\xff")
COMPRESSED = b"\xcc\xcc\x00\x01"
HEAD_BYTES = 512
ASKED_AGAIN_AFTER = timedelta(days=1)
"""A file of the mirror is not asked for again sooner than this after the last time."""

HAS_MD5 = 0b1100

MirrorState = Literal["fetched", "unchanged", "replaced"]


@dataclass(frozen=True)
class FileVersion:
    """One content that the archive gave under a name.

    Attributes
    ----------
    sha256 : str
        Of the content, hexadecimal.
    size_bytes : int
        Length of the content.
    etag, last_modified : str
        What the archive said of it; empty where it said nothing.
    fetched_utc : str
        When it came, ISO 8601.
    seen_utc : str
        When the archive was first found to list it, ISO 8601; empty where that was not noted.
    """

    sha256: str
    size_bytes: int
    etag: str = ""
    last_modified: str = ""
    fetched_utc: str = ""
    seen_utc: str = ""

    def is_still(self, reply: Reply) -> bool:
        """Whether a reply is about this content, as far as its headers tell."""
        headers = reply.headers
        if reply.status == 304:
            return True
        if self.etag and "etag" in headers:
            return self.etag == headers["etag"]
        if self.last_modified and self.last_modified != headers.get("last-modified", self.last_modified):
            return False
        return reply.status == 200 and headers.get("content-length") == str(self.size_bytes)


@dataclass(frozen=True)
class MirrorFile:
    """A whole file in the mirror.

    Attributes
    ----------
    sha256 : str
        Of its content.
    size_bytes : int
        Length of its content.
    state : str
        ``fetched``: it is new; ``unchanged``: it was there; ``replaced``: the archive has changed it.
    supersedes : str or None
        sha256 of what it replaced.
    """

    path: Path
    sha256: str
    size_bytes: int
    state: MirrorState
    supersedes: str | None = None


@dataclass(frozen=True)
class Times:
    """When a file is asked for, and when the archive was first found to list it."""

    now: datetime
    seen: datetime


def download(  # noqa: PLR0913, PLR0917 - what, from where, to where, and what is noted of it
    source: Source, manners: Manners, path: str, mirror: Path, times: Times | None = None, question: str = ""
) -> MirrorFile:
    """Bring a file of the mirror to what the archive has.

    Parameters
    ----------
    manners : Manners
        Pace and patience.
    path : str
        Path below the root of the archive; it is the same below the mirror.
    mirror : pathlib.Path
        Folder of the mirror, made if need be.
    times : Times, optional
        What the record is given; the time of day of this machine when left out.
    question : str, optional
        What the archive is asked for where that is not the path.

    Returns
    -------
    MirrorFile
        The file, whole and checked. Until then what was there before stays in its place.

    Raises
    ------
    UnreachableError
        If the archive did not give the file, or gave something else; what has come is kept for the next attempt.
    InputError
        If the mirror cannot be written, or the path leads out of it.
    """
    target = mirror / path
    if isinstance(source, FolderSource) and target.is_file() and (source.root / path).resolve() == target.resolve():
        # the mirror is its own archive: nothing is written, and it may be read-only
        return MirrorFile(target, _sha256(target), target.stat().st_size, "unchanged")
    times = times or Times(datetime.now(UTC), datetime.now(UTC))
    if not target.resolve().is_relative_to(mirror.resolve()):
        raise InputError(f"{path} leads out of the mirror {mirror}; correct the archive")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with _alone(target.parent):
            return manners.persist(lambda: _attempt(source, question or path, target, times))
    except OSError as error:
        reason = error.strerror or error
        raise InputError(
            f"mirror {target.parent} cannot be written ({reason}); make room or name another --home"
        ) from error


def versions(target: Path) -> list[FileVersion]:
    """Every content that a file of the mirror has had.

    Returns
    -------
    list of FileVersion
        The oldest first; empty where nothing is recorded.
    """
    try:
        return [FileVersion(**entry) for entry in json.loads(_beside(target, "json").read_text(encoding="utf-8"))]
    except FileNotFoundError:
        return []
    except (ValueError, TypeError):
        # a damaged record costs another download, no more
        return []


def is_due_again(target: Path, now: datetime) -> bool:
    """Whether the archive should be asked again for a file that is in the mirror.

    Files are replaced under their names mostly when they are young: a file is asked for again when the time since it
    was fetched has doubled, and not within a day.

    Returns
    -------
    bool
        True where the file, or its record, is not there; and where the file is not as long as it was when it came: it
        is then set aside.
    """
    recorded = versions(target)
    if not target.is_file() or not recorded or not recorded[-1].fetched_utc:
        return True
    if target.stat().st_size != recorded[-1].size_bytes:
        set_aside(target, f"it has {target.stat().st_size} bytes, and had {recorded[-1].size_bytes} when it came")
        return True
    asked = datetime.fromtimestamp(_beside(target, "json").stat().st_mtime, UTC)
    return now - asked >= max(asked - datetime.fromisoformat(recorded[-1].fetched_utc), ASKED_AGAIN_AFTER)


@dataclass(frozen=True)
class Received:
    """When the last of several files was first listed by its archive, and when it was in the mirror, where known."""

    seen_utc: datetime | None = None
    fetched_utc: datetime | None = None


def received(paths: Iterable[Path]) -> Received:
    """When files of the mirror came.

    Returns
    -------
    Received
        Of the last of them, as far as their records say.
    """
    newest = [found[-1] for found in map(versions, paths) if found]
    seen = [datetime.fromisoformat(one.seen_utc) for one in newest if one.seen_utc]
    fetched = [datetime.fromisoformat(one.fetched_utc) for one in newest if one.fetched_utc]
    return Received(max(seen, default=None), max(fetched, default=None))


def set_aside(target: Path, reason: str) -> None:
    """Take a file that cannot be read out of the mirror; it is asked for again in the next round.

    The file is kept, hidden, as ``.name.damaged`` with the reason beside it; an older one is replaced.

    Parameters
    ----------
    reason : str
        What is wrong with it.

    Raises
    ------
    InputError
        If the mirror cannot be written.
    """
    try:
        _beside(target, "damaged.txt").write_text(f"{reason}\n", encoding="utf-8")
        _beside(target, "json").unlink(missing_ok=True)
        target.replace(_beside(target, "damaged"))
    except OSError as error:
        raise InputError(f"{target} cannot be set aside ({error.strerror}); make the mirror writable") from error


@dataclass(frozen=True)
class Partial:
    """What has come of a file that is not complete."""

    path: Path
    validator: Path

    @property
    def headers(self) -> dict[str, str]:
        """Request headers that ask for the rest if this is still the same file; empty where there is nothing yet."""
        validator = self.validator.read_text(encoding="utf-8") if self.validator.exists() else ""
        return {"Range": f"bytes={self._size}-", "If-Range": validator} if self._size and validator else {}

    def receive(self, reply: Reply) -> None:
        """Write the body of a reply, 206 behind what is there and 200 in its place, and see it to the disk."""
        if reply.status == 206:
            self._check_start(reply.headers.get("content-range", ""))
        else:
            # emptied first, named after: a crash between the two leaves nothing to resume
            self.path.write_bytes(b"")
            self.validator.write_text(_strong_validator(reply.headers), encoding="utf-8")
        with self.path.open("ab") as stream:
            for piece in iter(lambda: reply.read(PIECE_BYTES), b""):
                stream.write(piece)
            stream.flush()
            os.fsync(stream.fileno())

    def discard(self) -> None:
        """Forget what has come."""
        self.path.unlink(missing_ok=True)
        self.validator.unlink(missing_ok=True)

    @property
    def _size(self) -> int:
        return self.path.stat().st_size if self.path.exists() else 0

    def _check_start(self, content_range: str) -> None:
        if not self._size or not content_range.startswith(f"bytes {self._size}-"):
            self.discard()
            raise TryAgainError(f"the archive sent another part ({content_range or 'not said which'}) than asked for")


def _attempt(source: Source, path: str, target: Path, times: Times) -> MirrorFile:
    partial = Partial(_beside(target, "part"), _beside(target, "part.validator"))
    before = _sha256(target) if target.exists() else None
    recorded = versions(target)
    known = recorded[-1] if recorded and recorded[-1].sha256 == before else None
    with source.ask(path, partial.headers or _conditions(known)) as reply:
        if reply.status in {404, 410}:
            raise UnreachableError(f"{path} is listed by the archive but not there; try again later")
        if reply.status == 416:
            partial.discard()
            raise TryAgainError(f"{path} has become shorter in the archive")
        if known and known.is_still(reply):
            partial.discard()
            os.utime(_beside(target, "json"), (times.now.timestamp(),) * 2)
            return MirrorFile(target, known.sha256, known.size_bytes, "unchanged")
        partial.receive(reply)
        headers = reply.headers
    wrong = complaint(partial.path, target.name)
    if wrong:
        partial.discard()
        raise TryAgainError(f"what the archive gave as {path} is {wrong}")
    return _place(partial, target, before, recorded, headers, times)


def _place(  # noqa: PLR0913, PLR0917 - one step of a download with all that it knows
    partial: Partial,
    target: Path,
    before: str | None,
    recorded: list[FileVersion],
    headers: Mapping[str, str],
    times: Times,
) -> MirrorFile:
    """Rename a checked file to its name and add it to the record of what was there."""
    about = (headers.get("etag", ""), headers.get("last-modified", ""), _iso(times.now), _iso(times.seen))
    new = FileVersion(_sha256(partial.path), partial.path.stat().st_size, *about)
    if before and before not in {new.sha256, *(version.sha256 for version in recorded)}:
        recorded = [*recorded, FileVersion(before, target.stat().st_size)]
    partial.path.replace(target)
    # the same content under another tag is the same version
    kept = recorded[:-1] if recorded and recorded[-1].sha256 == new.sha256 else recorded
    _write_record(target, [*kept, new], times.now)
    partial.discard()
    # a run that died after the rename has not told of the change: the record, not the file, says what was known
    previous = before if before != new.sha256 else recorded[-1].sha256 if recorded else None
    if previous == new.sha256:
        return MirrorFile(target, new.sha256, new.size_bytes, "unchanged")
    return MirrorFile(target, new.sha256, new.size_bytes, "replaced" if previous else "fetched", previous)


def _iso(moment: datetime) -> str:
    return f"{moment.astimezone(UTC):%Y-%m-%dT%H:%M:%SZ}"


def _write_record(target: Path, recorded: list[FileVersion], now: datetime) -> None:
    record, staged = _beside(target, "json"), _beside(target, "json.new")
    staged.write_text(json.dumps([asdict(version) for version in recorded], indent=1), encoding="utf-8")
    os.utime(staged, (now.timestamp(), now.timestamp()))
    staged.replace(record)


def _conditions(known: FileVersion | None) -> dict[str, str]:
    """Request headers with which the archive need not send what is there already."""
    if known is None:
        return {}
    if known.etag:
        return {"If-None-Match": known.etag}
    return {"If-Modified-Since": known.last_modified} if known.last_modified else {}


def _strong_validator(headers: Mapping[str, str]) -> str:
    etag = headers.get("etag", "")
    return etag if etag and not etag.startswith("W/") else headers.get("last-modified", "")


def _beside(target: Path, suffix: str) -> Path:
    return target.with_name(f".{target.name}.{suffix}")


def _sha256(path: Path) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Let one process at a time write into a folder; the lock ends with the process, however that ends."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def complaint(path: Path, name: str) -> str:
    """What is wrong with a file that came from an archive.

    Parameters
    ----------
    path : pathlib.Path
        File to look at.
    name : str
        Name that it has in the archive: ``.cdf`` should be CDF, ``.json`` JSON, everything else is text.

    Returns
    -------
    str
        Empty if nothing is wrong, as far as magic numbers, the length that the file states of itself and, where it has
        one, its checksum can tell.
    """
    with path.open("rb") as stream:
        head = stream.read(HEAD_BYTES)
        if name.lower().endswith(".json"):
            return _no_text(head) or _no_json(path)
        if not name.lower().endswith(".cdf"):
            return _no_text(head)
        if not head.startswith(MAGIC):
            return "an HTML page" if _is_html(head) else "not a CDF file"
        if not head.startswith(MAGIC[0]):
            return ""  # version 2, in use until 2005, does not say how long it is in the same place
        return _wrong_length(stream, head, path.stat().st_size)


def _is_html(head: bytes) -> bool:
    return b"<html" in head.lower() or b"<!doctype" in head.lower()


def _no_text(head: bytes) -> str:
    if not head.strip():
        return "empty"
    return "an HTML page" if _is_html(head) else "not text" if b"\0" in head else ""


def _no_json(path: Path) -> str:
    try:
        json.loads(path.read_bytes())
    except (ValueError, RecursionError):
        return "not JSON, or only a part of it"
    return ""


def _wrong_length(stream: BinaryIO, head: bytes, size: int) -> str:
    """Check version 3: its first record (CDR) has the offset of the second (GDR) at byte 20 and flags at byte 40.

    The second has the length of the file at its byte 36, not counting an MD5 checksum behind it (CDF Internal Format
    Description, version 3, sections 2.2 and 2.3; agrees with real files of three producers). In a file that is
    compressed as a whole, the second record (CPR) is the last, and has its own length at its byte 0.
    """
    is_compressed = head[4:8] == COMPRESSED
    has_md5 = not is_compressed and len(head) > 43 and head[43] & HAS_MD5 == HAS_MD5
    second = _integer(head[20:28])
    stream.seek(min(max(second, 0), size))
    record = stream.read(44)
    length = second + _integer(record[:8]) if is_compressed else _integer(record[36:44])
    if not 0 < second < length <= size - 16 * has_md5:
        return f"cut after {size} bytes"
    stream.seek(0)
    is_damaged = has_md5 and hashlib.md5(stream.read(length), usedforsecurity=False).digest() != stream.read(16)
    return "damaged: its checksum does not fit" if is_damaged else ""


def _integer(raw: bytes) -> int:
    """Signed 8 bytes, big-endian; -1 where they are not all there."""
    return int(struct.unpack(">q", raw)[0]) if len(raw) == 8 else -1
