"""Solar wind and solar regions around a burst, read from the folders of the settings, for the flow."""

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import date, datetime
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from bella.answer import no_track
from bella.catalogue import SourceFile
from bella.exceptions import InputError, NoDataError
from bella.plotting import WindScene, wind_map_figure
from bella.settings import Settings
from bella.solar_wind import (
    HALF_ROTATION,
    OLDEST_REGIONS,
    InSitu,
    Regions,
    TrackSpiral,
    UsedFile,
    WindAssimilation,
    assimilate_wind,
    footpoint_companion,
    line_of_track,
    measured_wind,
    region_files,
    region_sha256,
    regions_around,
    speed_at_sources,
    speeds_around,
    wind_companion,
)
from bella.spacecraft import coverage, position_hee
from bella.tracks import TrackFit
from bella.units import FloatArray

HALF_DAY = np.timedelta64(12, "h")
LINE_RSUN = (1.0, 215.0)


@dataclass(frozen=True)
class Surroundings:
    """Speeds in situ and solar regions around a burst.

    Attributes
    ----------
    utc : numpy.datetime64
        Of the burst.
    """

    utc: np.datetime64
    in_situ: InSitu
    regions: Regions

    @cached_property
    def wind(self) -> WindAssimilation:
        """Wind of the rotation around the burst, assimilated when first asked for.

        Raises
        ------
        NoDataError
            If no speed, or too few, were measured.
        """
        if self.in_situ.reason:
            raise NoDataError(self.in_situ.reason)
        return assimilate_wind(self.in_situ.speeds, self.utc)

    def sources(self) -> tuple[SourceFile, ...]:
        """What a solution depends on of them, as inputs of it."""
        day = pd.Timestamp(self.utc).date()
        used = (*self.in_situ.used, *self.regions.used)
        return tuple(SourceFile(file.kind, day, "1", file.sha256, "done", file.name) for file in used)


def surroundings_of(start_utc: datetime, settings: Settings) -> Surroundings:
    """Read the speeds and regions of a burst from the folders of the settings.

    Parameters
    ----------
    start_utc : datetime.datetime
        Of the burst, with its zone.

    Returns
    -------
    Surroundings
        Each part is empty with a reason where there is nothing.
    """
    utc = pd.Timestamp(start_utc).tz_convert("UTC").tz_localize(None).to_datetime64().astype("datetime64[ns]")
    return Surroundings(utc, speeds_around(settings.in_situ, utc), regions_around(settings.regions, utc))


def day_digest(day: date, settings: Settings) -> str:
    """Checksum of what the bursts of a day may depend on in these folders.

    Returns
    -------
    str
        Empty where there is nothing for that day.
    """
    noon = np.datetime64(day, "ns") + HALF_DAY
    used: Iterable[UsedFile] = speeds_around(settings.in_situ, noon, HALF_ROTATION + HALF_DAY).used
    parts = [file.sha256 for file in used]
    if settings.regions is not None:
        near = region_files(settings.regions, noon, OLDEST_REGIONS + HALF_DAY)
        parts += [_sha256(path) for files in near.values() for path, _ in files]
    return hashlib.sha256("\n".join(sorted(parts)).encode()).hexdigest() if parts else ""


def _sha256(path: Path) -> str:
    try:
        return region_sha256(path)
    except (InputError, OSError) as error:  # read again, and left out with its reason, when a burst asks for it
        return f"{path.name}: {error}"


def footpoint_of(fit: TrackFit, observatories: Iterable[str], around: Surroundings) -> dict[str, Any]:
    """Footpoint of a joint fit, with connections by the measured wind, and the regions near it.

    Returns
    -------
    dict
        As :func:`bella.solar_wind.footpoint_companion` returns it.

    Raises
    ------
    NoDataError
        If nothing was fitted.
    """
    if not fit.draws:
        raise NoDataError(f"{no_track(fit.record.flags)}: add frequencies")
    phi0, utc = fit.draws["phi0_deg"], fit.reference_utc
    return footpoint_companion(phi0, utc, observatories, around.in_situ.at(utc), around.regions)


def wind_of(
    posterior: xr.Dataset, joint: Mapping[str, Any], scattering: Mapping[str, Any], around: Surroundings
) -> dict[str, Any]:
    """Wind around a burst, along its apparent track, and along the field line of its true sources.

    Parameters
    ----------
    posterior : xarray.Dataset
        A solution of :func:`bella.multilateration.localise`.
    joint, scattering : mapping
        Joint fit, and the companion with the spirals corrected for scattering, as they are stored.

    Returns
    -------
    dict
        As :func:`bella.solar_wind.wind_companion` returns it, with ``measured``: for fundamental and harmonic a
        :class:`bella.records.MeasuredWind`.

    Raises
    ------
    NoDataError
        If no speed, or too few, were measured.
    """
    found = around.wind
    corrected = corrected_spirals(posterior, scattering)
    measured = {word: measured_wind(found, spiral).model_dump(mode="json") for word, spiral in corrected.items()}
    return wind_companion(found, around.in_situ, fitted_spiral(posterior, joint)) | {"measured": measured}


def corrected_spirals(posterior: xr.Dataset, scattering: Mapping[str, Any]) -> dict[str, TrackSpiral]:
    """Spirals of the true sources, by the harmonic of the emission.

    Parameters
    ----------
    scattering : mapping
        Companion of that name, as it is stored.

    Returns
    -------
    dict of str to TrackSpiral
        Empty where nothing could be corrected.
    """
    found = {}
    for word, spiral in scattering.get("joint", {}).items():
        distance = np.array([row[word]["range_rsun"] for row in scattering["rows"]], dtype=np.float64)
        phi0, speed, period_d = spiral["phi0_deg"], float(spiral["v_sw_km_s"]["mean"]), spiral["rotation_period_d"]
        known, utc = distance[np.isfinite(distance)], _reference(posterior)
        found[word] = TrackSpiral(float(phi0["mean"]), speed, float(period_d), known, utc, float(phi0["sd"]))
    return found


def fitted_spiral(posterior: xr.Dataset, joint: Mapping[str, Any]) -> TrackSpiral | None:
    """Spiral of a joint fit.

    Parameters
    ----------
    joint : mapping
        As it is stored.

    Returns
    -------
    TrackSpiral or None
        None where nothing was fitted.
    """
    phi0, speed = (joint.get(name) or {} for name in ("phi0_deg", "v_sw_km_s"))
    if phi0.get("mean") is None or speed.get("mean") is None:
        return None
    distance = np.linalg.norm(_sources_rsun(posterior), axis=1)
    period = float(joint["rotation_period_d"])
    return TrackSpiral(float(phi0["mean"]), float(speed["mean"]), period, distance, _reference(posterior))


def _reference(posterior: xr.Dataset) -> np.datetime64:
    """Epoch of the axes of a solution, UTC."""
    return np.datetime64(str(posterior.attrs["reference_time"]).removesuffix("Z"), "ns")


def _sources_rsun(posterior: xr.Dataset) -> FloatArray:
    """Positions of a solution, shape (F, 3)."""
    zeros = np.zeros(posterior.sizes["frequency"])
    parts = [posterior[name].to_numpy() if name in posterior else zeros for name in ("x_rsun", "y_rsun", "z_rsun")]
    return np.stack(parts, axis=1).astype(np.float64)


def has_wind(track: Mapping[str, Any]) -> bool:
    """Whether the wind stands beside the track of a solution.

    Parameters
    ----------
    track : mapping
        As it is stored.
    """
    return "boundary" in track.get("companions", {}).get("wind", {})


def wind_drawn(posterior: xr.Dataset, track: Mapping[str, Any], around: Surroundings) -> str:
    """Figure of the wind around a burst with its track in it, SVG.

    Parameters
    ----------
    track : mapping
        As it is stored.

    Raises
    ------
    NoDataError
        If no speed, or too few, were measured.
    """
    found, spiral = around.wind, fitted_spiral(posterior, track.get("joint", {}))
    utc, sources = _reference(posterior), _sources_rsun(posterior)
    line, drawn = None, np.empty((0, 3))
    if spiral is not None:
        drawn = spiral.at(np.linspace(*LINE_RSUN, 200))
        if "phi0_deg" in track["companions"]["wind"]["field_line"]:
            line = line_of_track(found, spiral)
    known = [name for name in found.left_out if coverage(name).start <= utc <= coverage(name).stop]
    receivers = {name: position_hee(name, [utc], utc)[0] for name in known}
    along = speed_at_sources(found, sources, utc)
    scene = WindScene(utc, sources, line, receivers, drawn, along.mean_km_s, along.sd_km_s)
    return wind_map_figure(found.map_at(utc), scene)
