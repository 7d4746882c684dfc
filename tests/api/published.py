"""A home folder with synthetic bursts in it, published as the flow publishes: store first, then one commit."""

import socket
import threading
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import uvicorn
import xarray as xr

from api.app import create_app
from api.serve import PhrasedProtocol
from bella.catalogue import Burst, Catalogue, Localisation, Publication, Series, Solution, SourceFile
from bella.formats import localisation_records
from bella.settings import Settings
from bella.store import place_group, stage_group, verify_group
from tests.plotting.synthetic import (
    BURST_ID,
    FREQUENCIES_MHZ,
    REFERENCE,
    synthetic_posterior,
    synthetic_spectra,
    synthetic_track_fit,
)

EDGES = ("half_maximum", "gauss_hermite")
ONSET = datetime(2012, 6, 7, 19, 29, 15, tzinfo=UTC)
CHANNELS = FREQUENCIES_MHZ[::5]


def settings_of(home: Path, **more: Any) -> Settings:
    """Settings of a home folder, whatever the environment says."""
    return Settings(home=home, database_url=None, **more)


def placed(settings: Settings, group: xr.Dataset | xr.DataTree, name: str) -> tuple[str, str]:
    """Store path and checksum of a group that was put into the store."""
    staged = stage_group(group, settings.store_root)
    sha256 = verify_group(staged, group)
    return place_group(staged, settings.store_root, name), sha256


def published(
    settings: Settings,
    catalogue: Catalogue,
    *,
    burst: Burst | None = None,
    edge: str = "half_maximum",
    preset: str = "bella-2024",
    inputs_hash: str = "a" * 64,
    flags: tuple[str, ...] = ("speed_not_constrained",),
    frequencies: np.ndarray = CHANNELS,
    track_fit: dict[str, Any] | None = None,
) -> Solution:
    """Publish one synthetic solution."""
    burst = burst or synthetic_burst()
    posterior = synthetic_posterior(edge, frequencies=frequencies).assign_attrs(burst_id=burst.burst_id)
    path, sha256 = placed(settings, posterior, f"{burst.burst_id}/{edge}-{uuid.uuid4().hex[:8]}.zarr.zip")
    rows = tuple(Localisation(**record) for record in localisation_records(posterior))  # type: ignore[arg-type]
    return catalogue.publish(
        Publication(
            burst=burst,
            series=Series(edge, "posterior", preset, 2),
            inputs_hash=inputs_hash,
            code_version="0.1.0",
            flags=flags,
            store_path=path,
            store_sha256=sha256,
            reference_utc=datetime.fromisoformat(REFERENCE),
            localisations=rows,
            track_fit=track_fit or synthetic_track_fit(edge),
            sources=(SourceFile("synthetic", ONSET.date(), "1", inputs_hash, "done", "synthetic"),),
        )
    )


def synthetic_burst(*, burst_id: str = BURST_ID, start: datetime = ONSET, spectra_path: str | None = None) -> Burst:
    """Record of the synthetic burst."""
    names = ("WIND", "STEREO-A", "STEREO-B")
    return Burst(burst_id, start, start + timedelta(minutes=30), 0.15, 2.0, names, spectra_path)


def publish_event(settings: Settings, catalogue: Catalogue, frequencies: np.ndarray = CHANNELS) -> list[Solution]:
    """Publish the synthetic burst with its spectra and both definitions of the edge."""
    spectra_path, _ = placed(settings, synthetic_spectra(), f"{BURST_ID}/spectra-{uuid.uuid4().hex[:8]}.zarr.zip")
    burst = synthetic_burst(spectra_path=spectra_path)
    return [published(settings, catalogue, burst=burst, edge=edge, frequencies=frequencies) for edge in EDGES]


def publish_many(settings: Settings, catalogue: Catalogue, count: int) -> None:
    """Publish bursts of the days after the event, every second one with one more flag."""
    for day in range(1, count + 1):
        start = ONSET + timedelta(days=day)
        burst = replace(synthetic_burst(), burst_id=f"T3-{start:%Y%m%d-%H%M}", start_utc=start, end_utc=start)
        flags = ("speed_not_constrained", "multimodal") if day % 2 else ("speed_not_constrained",)
        published(settings, catalogue, burst=burst, flags=flags, frequencies=CHANNELS[:3])


@contextmanager
def served(settings: Settings) -> Iterator[str]:
    """Address of a real server on the loopback."""
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        config = uvicorn.Config(create_app(settings), log_level="warning", lifespan="off", http=PhrasedProtocol)
        server = uvicorn.Server(config)
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]}, daemon=True)
        thread.start()
        while not server.started and thread.is_alive():
            time.sleep(0.02)
        try:
            yield f"http://127.0.0.1:{listener.getsockname()[1]}"
        finally:
            server.should_exit = True
            thread.join(timeout=10)
