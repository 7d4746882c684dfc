"""Where an archive is: behind HTTP, or in a folder; both give the same replies.

HTTP itself is httpx; what an answer means is decided here, because "there is no such file" and "the archive is silent"
must stay apart: sunpy's Scraper answers 404, 500, 503 and a maintenance page alike, with an empty list.
"""

import os
import re
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass, field
from html.parser import HTMLParser
from pathlib import Path
from typing import BinaryIO, Protocol
from urllib.parse import quote, unquote, urlsplit

import httpx

from bella.archive.manners import TryAgainError
from bella.exceptions import InputError, UnreachableError

ANSWERS = frozenset({304, 404, 410, 416})
RETRIABLE = frozenset({408, 425, 429, 500, 502, 503, 504})
USER_AGENT = "bella-service (solar radio bursts)"
PIECE_BYTES = 1 << 16
LONGEST_REQUEST_S = 600.0


@dataclass(frozen=True)
class Reply:
    """An answer of the archive whose body is still to be read.

    Attributes
    ----------
    status : int
        As in HTTP: 200 whole file, 206 the rest of it, 304 not modified, 404 or 410 not there, 416 no such rest.
    headers : mapping of str to str
        Header fields, names in lower case.
    read : callable
        Next piece of the body, at most so many bytes, empty at its end; raises TryAgainError where it breaks off.
    """

    status: int
    headers: Mapping[str, str]
    read: Callable[[int], bytes]


class Source(Protocol):
    """An archive: paths below its root in, what is there out."""

    def names(self, folder: str) -> frozenset[str] | None:
        """Names in a folder; None where the archive says that it is not there. Raises UnreachableError."""

    def ask(self, path: str, headers: Mapping[str, str]) -> AbstractContextManager[Reply]:
        """Ask for a file, with HTTP request headers. Raises UnreachableError."""


@dataclass(frozen=True)
class HttpSource:
    """An archive behind HTTP whose folders are listed as HTML pages.

    Attributes
    ----------
    root : str
        URL without a slash at its end.
    timeout_s : float
        Longest silence, s.
    """

    root: str
    timeout_s: float
    _client: httpx.Client = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """One connection, which is kept: an archive is asked one thing at a time."""
        limits = httpx.Limits(max_connections=1, max_keepalive_connections=1)
        # identity: the length of a body is then that of the file
        headers = {"User-Agent": USER_AGENT, "Accept-Encoding": "identity"}
        client = httpx.Client(timeout=self.timeout_s, limits=limits, headers=headers, follow_redirects=True)
        object.__setattr__(self, "_client", client)

    def names(self, folder: str) -> frozenset[str] | None:
        """Names in a folder.

        Parameters
        ----------
        folder : str
            Path below the root.

        Returns
        -------
        frozenset of str or None
            Names of files and folders; None where the archive says that there is no such folder.

        Raises
        ------
        UnreachableError
            If the archive did not answer, or with something that is not the listing of a folder.
        """
        with self.ask(f"{folder}/", {}) as reply:
            if reply.status != 200:
                return None
            page = b"".join(iter(lambda: reply.read(PIECE_BYTES), b""))
            # without a length a page that was cut looks like a whole one
            is_whole = bool({"content-length", "transfer-encoding"} & set(reply.headers)) or b"</html>" in page.lower()
        if not is_whole:
            raise TryAgainError(f"{self.root}/{folder}/ broke off")
        return _linked_names(page, f"{self.root}/{folder}/")

    @contextmanager
    def ask(self, path: str, headers: Mapping[str, str]) -> Iterator[Reply]:
        """Ask for a file.

        Parameters
        ----------
        path : str
            Path below the root, with a query where there is one.
        headers : mapping of str to str
            Request headers.

        Yields
        ------
        Reply
            Status 200, 206, 304, 404, 410 or 416.

        Raises
        ------
        UnreachableError
            If the archive did not answer, or with an error; :class:`TryAgainError` where it may soon do better.
        """
        path, mark, query = path.partition("?")
        url = f"{self.root}/{quote(path)}{mark}{query}"
        response = self._opened(url, headers)
        try:
            fields = {name.lower(): value for name, value in response.headers.items()}
            yield Reply(response.status_code, fields, _reader(response, url, fields.get("content-length")))
        finally:
            response.close()

    def _opened(self, url: str, headers: Mapping[str, str]) -> httpx.Response:
        try:
            response = self._client.send(self._client.build_request("GET", url, headers=dict(headers)), stream=True)
        except (httpx.HTTPError, httpx.InvalidURL) as error:
            raise TryAgainError(f"{url} did not answer: {error}") from error
        if response.status_code in {200, 206, *ANSWERS}:
            return response
        response.close()
        said = f"{url} answered {response.status_code} {response.reason_phrase}"
        if response.status_code in RETRIABLE:
            raise TryAgainError(said, _asked_wait_s(response))
        raise UnreachableError(f"{said}; is the archive right?")


@dataclass(frozen=True)
class FolderSource:
    """An archive in a folder of this machine, with the same folders in it.

    Attributes
    ----------
    root : pathlib.Path
        The folder.
    """

    root: Path

    def names(self, folder: str) -> frozenset[str] | None:
        """Names in a folder, None where it is not there; raises UnreachableError where it cannot be read."""
        try:
            return frozenset(os.listdir(self.root / folder))  # noqa: PTH208 - names are wanted, not paths
        except (FileNotFoundError, NotADirectoryError):
            return None
        except OSError as error:
            raise UnreachableError(f"{self.root / folder} cannot be read: {error.strerror}") from error

    @contextmanager
    def ask(self, path: str, headers: Mapping[str, str]) -> Iterator[Reply]:
        """Ask for a file, see :meth:`HttpSource.ask`; status 200, 304 or 404, ranges are not known."""
        try:
            stream = (self.root / path).open("rb")
        except FileNotFoundError:
            yield Reply(404, {}, lambda _: b"")
            return
        except OSError as error:
            raise UnreachableError(f"{self.root / path} cannot be read: {error.strerror}") from error
        with stream:
            about = os.fstat(stream.fileno())
            fields = {"etag": f'"{about.st_mtime_ns:x}-{about.st_size:x}"', "content-length": str(about.st_size)}
            status = 304 if headers.get("If-None-Match") == fields["etag"] else 200
            yield Reply(status, fields, _folder_reader(stream, self.root / path))


def open_source(root: str, timeout_s: float) -> Source:
    """Archive at a URL or in a folder; nothing is asked yet.

    Parameters
    ----------
    root : str
        ``http://`` or ``https://`` URL, or the path of a folder that holds ``pub/data/...``.
    timeout_s : float
        Longest silence of an archive behind HTTP, s.

    Raises
    ------
    InputError
        If it is neither.
    """
    with suppress(ValueError):  # of a port that is no number, or a path with a null in it
        parts = urlsplit(root)
        if parts.scheme in {"http", "https"} and parts.hostname and "@" not in parts.netloc and parts.port != 0:
            return HttpSource(root.rstrip("/"), timeout_s)
        if root and Path(root).is_dir():
            return FolderSource(Path(root))
    raise InputError(f"archive {root!r} is neither an http(s) URL nor a folder that exists; correct --archive")


def _reader(response: httpx.Response, url: str, length: str | None) -> Callable[[int], bytes]:
    """Read so that a body that ends early, stalls or dribbles is an error."""
    left = int(length) if length and length.isdecimal() else None
    end = time.monotonic() + LONGEST_REQUEST_S
    pieces = response.iter_raw()

    def _read(_size: int) -> bytes:
        nonlocal left
        reason = ""
        try:
            piece = next(pieces, b"")
        except httpx.HTTPError as error:
            piece, reason = b"", f": {error}"
        if left is not None:
            left -= len(piece)
        if reason or time.monotonic() > end or (not piece and left):
            missing = f", {left} bytes are missing" if left else ""
            raise TryAgainError(f"{url} broke off{missing}{reason}")
        return piece

    return _read


def _folder_reader(stream: BinaryIO, path: Path) -> Callable[[int], bytes]:
    def _read(size: int) -> bytes:
        try:
            return stream.read(size)
        except OSError as error:
            raise UnreachableError(f"{path} cannot be read: {error.strerror}") from error

    return _read


def _asked_wait_s(response: httpx.Response) -> float:
    wait = response.headers.get("Retry-After", "")
    return float(wait) if wait.isdecimal() else 0.0


class _Links(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.names: set[str] = set()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Keep the last part of what a link leads to."""
        target = dict(attrs).get("href") if tag == "a" else None
        if target:
            self.names.add(unquote(urlsplit(target).path).rstrip("/").rpartition("/")[2])


def _linked_names(page: bytes, url: str) -> frozenset[str]:
    """Names on a page, if it lists a folder: a notice of maintenance comes with status 200 too."""
    text = page.decode("utf-8", errors="replace")
    links = _Links()
    links.feed(text)
    is_titled = re.search(r"index of|directory listing", text, flags=re.IGNORECASE)
    if not is_titled and not any(re.fullmatch(r"\d{4}|.*\.cdf", name, flags=re.IGNORECASE) for name in links.names):
        raise TryAgainError(f"{url} answered with a page that is not the listing of a folder")
    return frozenset(links.names - {""})
