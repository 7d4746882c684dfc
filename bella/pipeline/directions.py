"""Wave directions of a burst, in the form that a fit takes."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import pandas as pd
import structlog
import xarray as xr

from bella.exceptions import BellaError
from bella.records import MeasuredWind
from bella.spectra import power_above_background
from bella.tracks import WindPrior, measured_wind
from bella.tracks.directions import DirectionTerms, direction_terms, wave_directions
from bella.tracks.scattering import apparent_over_true
from bella.tracks.triangulation import FLOOR_DEG

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
        As :func:`bella.tracks.directions` returns it; of no rows where no spectrum carries directions.
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


def known_wind(wind: Mapping[str, Any], band_mhz: tuple[float, float]) -> WindPrior | None:
    """Prior of the apparent spiral from a wind measured in situ.

    Parameters
    ----------
    wind : mapping
        Companion of that name; its ``measured`` is the wind of the true spiral, fundamental and harmonic.
    band_mhz : tuple of float
        Lowest and highest frequency of the burst.

    Returns
    -------
    WindPrior or None
        None where nothing was measured.
    """
    measured = [MeasuredWind(**one) for one in wind.get("measured", {}).values()]
    if not measured:
        return None
    speed, sd = np.mean([one.to(one.range_rsun[-1]) for one in measured], axis=0)
    return measured_wind(float(speed), float(sd), *apparent_over_true(band_mhz))
