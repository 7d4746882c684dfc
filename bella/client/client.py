"""Client of a running service: catalogues as astropy tables, posteriors as xarray datasets.

>>> from bella.client import Client
>>> service = Client("http://127.0.0.1:8000")  # doctest: +SKIP
>>> bursts = service.bursts(start="2012-06-01", stop="2012-07-01")  # doctest: +SKIP
>>> posterior = service.posterior(bursts["burst_id"][0])  # doctest: +SKIP
"""

import json
from http import HTTPStatus
from http.client import HTTPException
from typing import Any, TypeAlias
from urllib.error import HTTPError
from urllib.parse import quote, urlencode
from urllib.request import Request, urlopen

import xarray as xr
from astropy.table import MaskedColumn, QTable, vstack
from astropy.time import Time

from bella.exceptions import BellaError, InputError, NoDataError, UnreachableError

API = "api/v1"
TIMEOUT_S = 60.0
PAGE_ROWS = 1000

Instant: TypeAlias = str | Time


class Client:
    """A service at one address.

    Parameters
    ----------
    url : str
        Such as ``http://127.0.0.1:8000``, with the prefix of a proxy where there is one.
    timeout_s : float
        How long an answer may take to begin.

    Raises
    ------
    InputError
        If the address is not one of HTTP.
    """

    def __init__(self, url: str, timeout_s: float = TIMEOUT_S) -> None:
        if not url.startswith(("http://", "https://")):
            raise InputError(f"{url!r} is not the address of a service; write http://127.0.0.1:8000")
        self.url = url.rstrip("/")
        self.timeout_s = timeout_s

    def __repr__(self) -> str:
        return f"Client({self.url!r})"

    def bursts(self, start: Instant | None = None, stop: Instant | None = None, **filters: Any) -> QTable:
        """Bursts that begin in [start, stop), each with what its preferred solution says.

        Parameters
        ----------
        start, stop : str or Time, optional
            UTC.
        **filters
            Further query parameters of ``/api/v1/bursts``, such as ``observatory=["WIND", "PSP"]``.

        Returns
        -------
        astropy.table.QTable
            All pages, by onset unless `sort` says otherwise; no row where there is no such burst.

        Raises
        ------
        UnreachableError
            If the service does not answer.
        InputError
            If it refuses the question.
        """
        return self._pages("bursts", start, stop, filters)

    def tracks(self, start: Instant | None = None, stop: Instant | None = None, **filters: Any) -> QTable:
        """Parker spiral of each burst that begins in [start, stop); see `bursts`."""
        return self._pages("tracks", start, stop, filters)

    def localisations(self, start: Instant | None = None, stop: Instant | None = None, **filters: Any) -> QTable:
        """Sources at each frequency of the bursts that begin in [start, stop); see `bursts`."""
        return self._pages("localisations", start, stop, filters)

    def detections(self, start: Instant, stop: Instant, observatory: str | None = None, **filters: Any) -> QTable:
        """Bursts as each spacecraft received them, with their onset in [start, stop); see `bursts`."""
        return self._pages("detections", start, stop, {"observatory": observatory, **filters})

    def events(self, start: Instant | None = None, stop: Instant | None = None, **filters: Any) -> QTable:
        """Events that others published and that start in [start, stop): a row for each event and burst near it.

        See `bursts`; filters are those of ``/api/v1/events``, such as ``kind="flare", linked=True``.
        """
        return self._pages("events", start, stop, {"sort": None, **filters})

    def track(self, burst_id: str, **choice: Any) -> QTable:
        """Localisation table of one burst: of its preferred solution, or of the edge, method or version chosen."""
        return self._table(f"bursts/{quote(burst_id, safe='')}/track", choice)

    def arrivals(self, burst_id: str, **choice: Any) -> QTable:
        """Arrival times that a solution of a burst was made from; :func:`bella.localise` takes this table."""
        return self._table(f"bursts/{quote(burst_id, safe='')}/arrivals", choice)

    def burst(self, burst_id: str) -> dict[str, Any]:
        """Everything about one burst, as the service says it in JSON."""
        return self._json(f"bursts/{quote(burst_id, safe='')}", {})

    def posterior(self, burst_id: str, **choice: Any) -> xr.Dataset:
        """Posterior of one burst with all its draws, read over HTTP as they are used.

        Parameters
        ----------
        burst_id : str
        **choice
            `edge`, `method`, `preset`, `version`; without them the preferred solution.

        Returns
        -------
        xarray.Dataset
        """
        said = self._json(f"bursts/{quote(burst_id, safe='')}/posterior", choice)
        path = said["zarr_url"].partition(f"/{API}/")[2]  # the service may not know its address behind a proxy
        try:
            posterior: xr.Dataset = xr.open_zarr(f"{self.url}/{API}/{path}", consolidated=None)
        except ImportError as error:
            raise InputError(f"a posterior over HTTP needs fsspec and aiohttp ({error}): pip install them") from error
        return posterior

    def _pages(self, path: str, start: Instant | None, stop: Instant | None, filters: dict[str, Any]) -> QTable:
        query = {"limit": PAGE_ROWS, "sort": "start", **filters, "start": _utc(start), "stop": _utc(stop)}
        pages = [self._table(path, query)]
        while "next" in pages[-1].meta:
            cursor = str(pages[-1].meta["next"]).partition("cursor=")[2].partition("&")[0]
            pages.append(self._table(path, {**query, "cursor": cursor}))
        whole = vstack(pages, metadata_conflicts="silent") if len(pages) > 1 else pages[0]
        for name in ("next", "truncated"):
            whole.meta.pop(name, None)
        return whole

    def _table(self, path: str, query: dict[str, Any]) -> QTable:
        reply = self._read(path, {**query, "format": "ecsv"})
        try:
            table = QTable.read(reply.decode().split("\n"), format="ascii.ecsv")
        except ValueError as error:  # those of astropy.io.ascii and of text are among them
            raise self._not_understood() from error
        for name in table.colnames:  # an empty text is written as a missing one
            if isinstance(table[name], MaskedColumn) and table[name].dtype.kind == "U":
                table[name] = table[name].filled("")
        return table

    def _json(self, path: str, query: dict[str, Any]) -> dict[str, Any]:
        try:
            found = json.loads(self._read(path, query))
        except ValueError as error:
            raise self._not_understood() from error
        if not isinstance(found, dict):
            raise self._not_understood()
        return found

    def _not_understood(self) -> InputError:
        return InputError(f"{self.url} does not answer as a service of this kind: check the address")

    def _read(self, path: str, query: dict[str, Any]) -> bytes:
        known = {name: value for name, value in query.items() if value is not None}
        address = f"{self.url}/{API}/{path}?{urlencode(known, doseq=True)}"
        try:
            # the scheme is checked where the client is made
            with urlopen(Request(address), timeout=self.timeout_s) as reply:  # noqa: S310
                return bytes(reply.read())
        except HTTPError as error:
            raise _refused(self.url, error) from None
        except (OSError, HTTPException) as error:
            reason = getattr(error, "reason", error)
            message = f"{self.url} does not answer ({reason}): check the address, or try again later"
            raise UnreachableError(message) from None


def _refused(url: str, error: HTTPError) -> BellaError:
    """Error of this package for a reply that is one, in the words of the service."""
    try:
        detail = str(json.loads(error.read())["detail"])
    except (ValueError, KeyError, TypeError):
        detail = f"{url} answered {error.code}: is it a service of this kind?"
    if error.code == HTTPStatus.NOT_FOUND:
        return NoDataError(detail)
    if error.code in {HTTPStatus.SERVICE_UNAVAILABLE, HTTPStatus.BAD_GATEWAY, HTTPStatus.GATEWAY_TIMEOUT}:
        return UnreachableError(detail)
    return InputError(detail) if error.code < HTTPStatus.INTERNAL_SERVER_ERROR else BellaError(detail)


def _utc(instant: Instant | None) -> str | None:
    return f"{instant.utc.isot}Z" if isinstance(instant, Time) else instant
