"""What a burst has beside its arrival times: wave directions and a measured wind, in the form that one fit takes."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import pandas as pd
import structlog
import xarray as xr

from bella.exceptions import BellaError
from bella.spectra import power_above_background
from bella.tracks import WindPrior, measured_wind
from bella.tracks.direction_companions import FLOOR_DEG
from bella.tracks.directions import DirectionTerms, direction_terms
from bella.tracks.wave_directions import wave_directions
from bella.units import FloatArray

log = structlog.get_logger(__name__)

Window = tuple[np.datetime64, np.datetime64]


def burst_directions(spectra: Iterable[xr.Dataset], window: Window, band_mhz: tuple[float, float]) -> pd.DataFrame:
    """Wave directions of a burst from the spectra that carry them.

    Parameters
    ----------
    spectra : iterable of xarray.Dataset
        Over their background.
    window : tuple of numpy.datetime64
        When the burst was heard.
    band_mhz : tuple of float
        Lowest and highest frequency of the burst.

    Returns
    -------
    pandas.DataFrame
        As :func:`bella.tracks.wave_directions` returns it; of no rows where no spectrum carries directions.
    """
    parts = [pd.DataFrame()]
    for spectrum in spectra:
        if not any(str(name).startswith("wave_azimuth") for name in spectrum):
            continue
        linear = spectrum.assign(intensity=power_above_background(spectrum))
        try:
            found = wave_directions(linear.sel(frequency=slice(*band_mhz)), window)
        except BellaError as error:
            log.warning("no wave directions", observatory=spectrum.attrs["observatory"], reason=str(error))
            continue
        if found.attrs["turned"]:
            log.info("wave vectors turned towards their source", observatory=spectrum.attrs["observatory"])
        parts.append(found)
    return pd.concat(parts, ignore_index=True)


def directed(directions: pd.DataFrame | None, arrivals: pd.DataFrame, epoch: np.datetime64) -> DirectionTerms | None:
    """Wave directions as a likelihood takes them.

    Parameters
    ----------
    directions : pandas.DataFrame or None
        As :func:`burst_directions` returns it.
    arrivals : pandas.DataFrame
        Located arrival table, for where the spacecraft were.
    epoch : numpy.datetime64
        Of the HEE axes.

    Returns
    -------
    DirectionTerms or None
        None where there are no directions.
    """
    if directions is None or not len(directions):
        return None
    return direction_terms(directions.assign(x_rsun=np.nan, y_rsun=np.nan, z_rsun=np.nan), arrivals, epoch, FLOOR_DEG)


def known_wind(wind: Mapping[str, Any]) -> WindPrior | None:
    """Speed of the wind along a track as in-situ measurements have it.

    Parameters
    ----------
    wind : mapping
        As :func:`bella.solar_wind.wind_companion.wind_companion` returns it.

    Returns
    -------
    WindPrior or None
        Mean of 1 / v over the distances that are given. Its error is that of the assimilation and, beside it, the rms
        misfit of the spacecraft: what a wind that only turns with the Sun leaves unexplained where it was measured, it
        leaves unexplained at the track. None where nothing is known.
    """
    speeds = [row["v_sw_km_s"] for row in wind.get("along_track", ()) if row["v_sw_km_s"]["mean"]]
    misfits = _numbers(one["rmse_km_s"] for one in wind.get("observatories", ()))
    if not speeds or not misfits.size:
        return None
    mean = float(1.0 / np.mean(1.0 / _numbers(one["mean"] for one in speeds)))
    sd = np.hypot(np.mean(_numbers(one["sd"] for one in speeds)), np.sqrt(np.mean(misfits**2)))
    return measured_wind(mean, float(sd))


def _numbers(values: Iterable[float | None]) -> FloatArray:
    return np.array([value for value in values if value is not None], dtype=np.float64)
