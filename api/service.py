"""What one application holds: its settings, its catalogue (opened when first asked for), and the open posteriors."""

import math
import time
from datetime import datetime
from functools import lru_cache, partial
from threading import Lock
from typing import Annotated

import xarray as xr
from cachetools import LRUCache
from fastapi import Depends, Request
from starlette.concurrency import run_in_threadpool

from api.links import linked
from api.schemas import BurstReply
from bella.catalogue import Burst, BurstSummary, Catalogue, Solution
from bella.exceptions import BellaError, NoDataError
from bella.pipeline.page_figures import FirstLook, first_look_path, kept_first_look
from bella.settings import Settings
from bella.store import open_group, open_tree

POSTERIORS_KEPT = 64
SPECTRA_KEPT = 4
TEXTS_BYTES = 64_000_000
"""Of the JSON of bursts in lists that is kept."""


class Service:
    """Catalogue and store of one application.

    The catalogue is opened at the first request that needs it, so that the service starts, and can say what is wrong,
    while the database is away. Groups of the store never change: what was opened stays open.
    """

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.opened: Catalogue | None = None
        """The catalogue, once it was asked for."""
        self._opening = Lock()
        self.streams = 0
        """Streams of alerts that are open."""
        self._looking = Lock()
        self._newest_alert, self._looked_s = 0, -math.inf
        self._writing = Lock()
        self._texts = LRUCache[tuple[str, str, datetime | None], str](TEXTS_BYTES, getsizeof=len)
        self._posterior = lru_cache(POSTERIORS_KEPT)(partial(open_group, settings.store_root))
        self._spectra = lru_cache(SPECTRA_KEPT)(partial(open_tree, settings.store_root))

    def catalogue(self) -> Catalogue:
        """Catalogue, opened on first use.

        Raises
        ------
        StoreError
            If there is none yet, or it is damaged or of another version.
        UnreachableError
            If the database does not answer.
        """
        with self._opening:
            if self.opened is None:
                self.opened = Catalogue.open(self.settings.catalogue_url)
            return self.opened

    def state(self) -> str | None:
        """State of the catalogue, see `Catalogue.state`; None where it cannot be asked."""
        try:
            return self.catalogue().state()
        except BellaError:
            return None

    def burst_text(self, summary: BurstSummary) -> str:
        """JSON of a burst as it stands in lists: kept until something of it changes, one for each prefix of links."""
        key = (linked(""), summary.burst.burst_id, summary.burst.updated_utc)
        with self._writing:
            text: str | None = self._texts.get(key)
        if text is None:
            text = BurstReply.of(summary).model_dump_json()
            with self._writing:
                self._texts[key] = text
        return text

    def newest_alert(self, age_s: float) -> int:
        """Sequence number of the newest alert, looked up unless it was within so many seconds."""
        with self._looking:
            if time.monotonic() - self._looked_s >= age_s:
                self._newest_alert, self._looked_s = self.catalogue().last_alert(), time.monotonic()
            return self._newest_alert

    def posterior(self, solution: Solution) -> xr.Dataset:
        """Posterior of a solution.

        Raises
        ------
        StoreError
            If it is missing or damaged.
        """
        return self._posterior(solution.store_path)

    def first_look(self, burst: Burst, solution: Solution) -> FirstLook | None:
        """What was drawn of an answer when it was published; None where that is not kept, or no longer what it was."""
        return kept_first_look(first_look_path(burst, solution, self.settings))

    def spectra(self, burst_id: str, store_path: str | None) -> xr.DataTree:
        """Spectra of a burst, one child per observatory.

        Raises
        ------
        NoDataError
            If none were kept.
        """
        if store_path is None:
            raise NoDataError(f"no spectra are kept for {burst_id}: it was localised from an arrival table")
        return self._spectra(store_path)


async def _service_here(request: Request) -> Service:  # not in a thread: a hop there takes longer
    return _service(request)


def _service(request: Request) -> Service:
    service: Service = request.app.state.service
    return service


async def _catalogue(request: Request) -> Catalogue:
    service = _service(request)
    return service.opened if service.opened is not None else await run_in_threadpool(service.catalogue)


ServiceHere = Annotated[Service, Depends(_service_here)]
CatalogueHere = Annotated[Catalogue, Depends(_catalogue)]
