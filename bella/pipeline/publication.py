"""From a posterior to a visible solution: stage, verify, rename, one commit.

A crash between any two of these leaves nothing that a reader can see. What it leaves on disk is swept by a later run.
"""

import hashlib
import json
import uuid
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

import bella
from bella.arrivals import POSITION, arrivals_csv
from bella.catalogue import Burst, Catalogue, Lease, Localisation, Publication, Series, Solution, SourceFile
from bella.exceptions import NoDataError, StoreError
from bella.formats import localisation_records
from bella.multilateration import PRESETS
from bella.pipeline.tracks import TRACK_RECIPE, Timing
from bella.settings import Settings
from bella.store import SUFFIX, content_sha256, place_group, rounded_draws, stage_group, verify_group

PLACES = 1
"""Decimals of the positions of receivers, R_sun, that make another solution: errors of arrival times are larger.
With two decimals, files of the next day, which move the first edge of a burst a little, made a new version."""


def inputs_hash(timing: Timing, around: tuple[SourceFile, ...], series: Series, settings: Settings) -> str:
    """Checksum of everything a solution depends on but the code.

    Where arrival times were measured, the files of the burst count in place of them: files of the days beside it change
    the quiet level by a little, and make no new version of a burst that they do not reach.

    Parameters
    ----------
    timing : Timing
        Arrival tables with the positions of the receivers, and wave directions.
    around : tuple of SourceFile
        Wind and regions, which the track is compared with.

    Returns
    -------
    str
        Hexadecimal SHA-256.
    """
    choices = {
        "series": asdict(series),
        "preset": asdict(PRESETS[series.preset]),
        "draws": settings.draws,
        "seed": settings.seed,
        "track": TRACK_RECIPE,
        "around": sorted(source.sha256 for source in around),
    }
    text = json.dumps(choices, sort_keys=True)
    if timing.sources:
        receivers = timing.arrivals.drop_duplicates("observatory")[["observatory", *POSITION]].round(PLACES)
        sums = sorted(source.sha256 for source in timing.sources)
        text += receivers.sort_values("observatory").to_csv(index=False) + "\n".join(sums)
        return hashlib.sha256(text.encode()).hexdigest()
    text += arrivals_csv(timing.arrivals)
    if timing.channels is not None:
        text += arrivals_csv(timing.channels)
    if timing.directions is not None and len(timing.directions):
        text += timing.directions.to_csv(index=False)
    return hashlib.sha256(text.encode()).hexdigest()


def store_group(group: xr.Dataset | xr.DataTree, settings: Settings, name: str) -> tuple[str, str]:
    """Write a group, read it back, and give it a name that nothing has had before.

    Parameters
    ----------
    name : str
        Path below the store, without ending.

    Returns
    -------
    store_path, sha256 : str
    """
    staged = stage_group(group, settings.store_root)
    sha256 = verify_group(staged, group)
    unique = f"{name}-{sha256[:8]}-{uuid.uuid4().hex[:8]}{SUFFIX}"
    return place_group(staged, settings.store_root, unique), sha256


def store_spectra(spectra: xr.DataTree, burst: Burst, catalogue: Catalogue, settings: Settings) -> str:
    """Keep the spectra of a burst, unless the same ones are kept already.

    Returns
    -------
    str
        Store path.
    """
    kept = _kept_spectra(burst, catalogue)
    is_same = kept is not None and f"spectra-{content_sha256(spectra)[:8]}-" in kept
    if kept is not None and is_same and (settings.store_root / kept).is_file():
        return kept
    return store_group(spectra, settings, f"{burst.burst_id}/spectra")[0]


def _kept_spectra(burst: Burst, catalogue: Catalogue) -> str | None:
    try:
        return catalogue.burst(burst.burst_id).burst.spectra_path
    except NoDataError:
        return None


@dataclass(frozen=True)
class Draft:
    """A solution before it is visible.

    Attributes
    ----------
    checksum : str
        As :func:`inputs_hash` returns it.
    track : dict
        Ready for JSON.
    """

    burst: Burst
    series: Series
    checksum: str
    posterior: xr.Dataset
    track: dict[str, Any]
    sources: tuple[SourceFile, ...]


def publish(draft: Draft, catalogue: Catalogue, settings: Settings, lease: Lease | None = None) -> Solution:
    """Make a solution visible.

    Parameters
    ----------
    lease : Lease, optional
        Right to work on the burst.

    Returns
    -------
    Solution
        The new version; or the one that another run published meanwhile from the same inputs.

    Raises
    ------
    BusyError
        If another run took the burst over.
    StoreError
        If a file of the solution is not in the store any more, or cannot be written.
    """
    series, posterior = draft.series, draft.posterior
    name = f"{draft.burst.burst_id}/{series.edge}-{series.method}-{series.preset}-{series.dimensions}d"
    store_path, sha256 = store_group(rounded_draws(posterior), settings, name)
    paths = [path for path in (store_path, draft.burst.spectra_path) if path is not None]

    def _check() -> None:
        gone = [path for path in paths if not (settings.store_root / path).is_file()]
        if gone:
            raise StoreError(f"{gone[0]} has left the store while its solution was computed: run again")

    return catalogue.publish(
        Publication(
            burst=draft.burst,
            series=series,
            inputs_hash=draft.checksum,
            code_version=bella.__version__,
            flags=solution_flags(posterior, draft.track),
            store_path=store_path,
            store_sha256=sha256,
            reference_utc=pd.Timestamp(posterior.attrs["reference_time"]).to_pydatetime(),
            localisations=_localisations(posterior),
            track_fit=draft.track,
            sources=draft.sources,
        ),
        lease,
        _check,
    )


def _localisations(posterior: xr.Dataset) -> tuple[Localisation, ...]:
    """Rows of a posterior; none where it is one of a longitude, without positions."""
    if "x_rsun" not in posterior:
        return ()
    return tuple(Localisation(**record) for record in localisation_records(posterior))  # type: ignore[arg-type]


def solution_flags(posterior: xr.Dataset, track: dict[str, Any]) -> tuple[str, ...]:
    """Flags raised on any frequency of a solution or on its track fits, in alphabetical order."""
    said = np.unique(posterior["flags"].to_numpy()) if "flags" in posterior else ()
    raised = {flag for flags in said for flag in str(flags).split(";") if flag}
    of_fits = {flag for fit in ("joint", "two_step") for flag in track.get(fit, {}).get("flags", ())}
    return tuple(sorted(raised | of_fits))
