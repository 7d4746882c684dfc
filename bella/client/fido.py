"""SunPy's Fido and a running service: importing this module is enough.

>>> import bella.client.fido
>>> from sunpy.net import Fido, attrs as a
>>> found = Fido.search(a.Time("2012-06-01", "2012-07-01"), a.bella.Catalogue("bursts"))  # doctest: +SKIP

A search needs the attribute ``a.bella.Catalogue``, which no other client answers to. The service is that of
``a.bella.Service``, or of the environment variable BELLA_SERVICE_URL, or on this machine. ``Fido.fetch`` downloads the
localisation table of each burst (ECSV).
"""

import os
from pathlib import Path
from typing import Any

from astropy.table import QTable
from sunpy.net import attrs as a
from sunpy.net.base_client import BaseClient, QueryResponseTable

from bella.client.attrs import Catalogue, Service
from bella.client.client import API, Client
from bella.exceptions import InputError

SERVICE_VARIABLE = "BELLA_SERVICE_URL"
SERVICE_HERE = "http://127.0.0.1:8000"
CATALOGUES = {
    "bursts": "Type III bursts with longitude, distances and wind",
    "tracks": "Parker spiral of each burst",
    "detections": "Bursts as each spacecraft received them",
}


class BELLAClient(BaseClient):  # type: ignore[misc]
    """Bursts, tracks and detections of a service."""

    @property
    def info_url(self) -> str:
        """Address of the service that is asked where none is named."""
        return os.environ.get(SERVICE_VARIABLE, SERVICE_HERE)

    def search(self, *query: Any, **_: Any) -> QueryResponseTable:
        """Rows of one catalogue in a time range, with the address of the file of each burst.

        Raises
        ------
        InputError
            If the catalogue is not known.
        UnreachableError
            If the service does not answer.
        """
        asked = {type(one): one for one in query}
        catalogue, time = asked[Catalogue].value, asked[a.Time]
        if catalogue not in CATALOGUES:
            raise InputError(f"catalogue {catalogue!r} is not known; choose one of {', '.join(CATALOGUES)}")
        url = asked[Service].value if Service in asked else self.info_url
        found: QTable = getattr(Client(url), catalogue)(time.start, time.end)
        base = f"{url.rstrip('/')}/{API}/bursts"
        found["url"] = [f"{base}/{one}/track?format=ecsv" if one else "" for one in found["burst_id"]]
        response = QueryResponseTable(found, client=self)
        response.hide_keys = ["url"]
        return response

    def fetch(self, query_results: QueryResponseTable, *, path: str | Path, downloader: Any, **_: Any) -> None:
        """Let the downloader of SunPy fetch the localisation table of each burst, once each."""
        for burst_id, url in dict(zip(query_results["burst_id"], query_results["url"], strict=True)).items():
            if url:
                downloader.enqueue_file(str(url), filename=str(path).format(file=f"{burst_id}.ecsv"), max_splits=1)

    @classmethod
    def _can_handle_query(cls, *query: Any) -> bool:
        return bool(cls.check_attr_types_in_query(query, {a.Time, Catalogue}, {Service}))

    @classmethod
    def _attrs_module(cls) -> tuple[str, str]:
        return "bella", "bella.client.attrs"

    @classmethod
    def register_values(cls) -> dict[type, list[tuple[str, str]]]:
        """Values of the attribute, for completion and help."""
        return {Catalogue: list(CATALOGUES.items())}
