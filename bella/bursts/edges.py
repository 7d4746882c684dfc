"""Edges of all channels of a dynamic spectrum, by any of three definitions.

``half_rise``: from the rising flank alone, good to a fraction of the cadence (:mod:`bella.bursts.flank`); refused where
the half-maximum contradicts it. ``half_maximum``: by a straight line between two samples
(:mod:`bella.bursts.half_maximum`). ``gauss_hermite``: the edge of Canizares et al. 2024
(:mod:`bella.bursts.gauss_hermite`).
"""

import numpy as np
import pandas as pd
import xarray as xr

from bella.bursts.edge import Edge
from bella.bursts.flank import SampleAveraging, flank_edges
from bella.bursts.gauss_hermite import gauss_hermite_edge
from bella.bursts.half_maximum import half_maximum_edge, spacing_s
from bella.exceptions import InputError
from bella.spectra import integration_times_s, power_above_background, sample_times
from bella.units import FloatArray

EDGE_OF_METHOD = {"flank": "half_rise", "half_maximum": "half_maximum", "gauss_hermite": "gauss_hermite"}
"""Which edge each method finds, as the arrival table names it."""

METHOD_OF_EDGE = {edge: method for method, edge in EDGE_OF_METHOD.items()}

Window = tuple[np.datetime64, np.datetime64]


def spectrum_edges(spectrum: xr.Dataset, method: str = "flank", window_utc: Window | None = None) -> pd.DataFrame:
    """Edge of every channel of a dynamic spectrum.

    Parameters
    ----------
    spectrum : xarray.Dataset
        Dynamic spectrum that holds one burst, background taken away or in decibels over it.
    method : {"flank", "half_maximum", "gauss_hermite"}
    window_utc : tuple of numpy.datetime64, optional
        First and last record to look at, where the spectrum holds more than the burst.

    Returns
    -------
    pandas.DataFrame
        One row per channel, ascending in frequency: observatory, frequency_mhz, arrival_utc (NaT without an edge),
        sigma_s, edge (a value of ``EDGE_OF_METHOD``), flag. Channels marked as interpolated are left out. How well the
        times of the samples are known (``sample_time_sd_s``) is in sigma_s.

    Raises
    ------
    InputError
        If the method is not known, or there is no record in the window.
    """
    if method not in EDGE_OF_METHOD:
        raise InputError(f"{method!r} is not a way to find edges: choose one of {', '.join(EDGE_OF_METHOD)}")
    measured = _measured(spectrum, window_utc)
    start = measured["time"].to_numpy()[0].astype("datetime64[ns]")
    time_s = (sample_times(measured).to_numpy() - start) / np.timedelta64(1, "s")
    edges = _edges(method, time_s, measured)
    arrival_s = np.array([edge.arrival_s for edge in edges], dtype=np.float64)
    sigma_s = np.hypot([edge.sigma_s for edge in edges], _sample_time_sd_s(measured))
    delay = pd.to_timedelta(np.rint(arrival_s * 1e9), unit="ns").to_numpy()
    return pd.DataFrame(
        {
            "observatory": str(measured.attrs["observatory"]),
            "frequency_mhz": measured["frequency"].to_numpy(),
            "arrival_utc": start + delay,
            "sigma_s": sigma_s,
            "edge": EDGE_OF_METHOD[method],
            "flag": [edge.flag for edge in edges],
        }
    )


def _measured(spectrum: xr.Dataset, window_utc: Window | None) -> xr.Dataset:
    """Records in the window, of channels that were measured."""
    measured = spectrum if window_utc is None else spectrum.sel(time=slice(*window_utc))
    if measured.sizes["time"] == 0:
        raise InputError(f"no record between {window_utc}: choose a window inside the spectrum")
    if "interpolated" in measured:
        return measured.isel(frequency=np.flatnonzero(measured["interpolated"].to_numpy() == 0))
    return measured


def _sample_time_sd_s(spectrum: xr.Dataset) -> FloatArray:
    """How well the times of the samples of each channel are known, shape (channels,); 0 where nothing is said."""
    if "sample_time_sd_s" not in spectrum:
        return np.zeros(spectrum.sizes["frequency"])
    return np.nan_to_num(spectrum["sample_time_sd_s"].to_numpy().astype(np.float64))


def _visits_apart_s(spectrum: xr.Dataset) -> FloatArray | float:
    """Time between the two visits that a sample is the mean of, shape (time, channels); 0 where there was one."""
    if "visits_apart_s" not in spectrum:
        return 0.0
    return np.nan_to_num(spectrum["visits_apart_s"].to_numpy().astype(np.float64))


def _edges(method: str, time_s: FloatArray, spectrum: xr.Dataset) -> list[Edge]:
    power, frequency_mhz = power_above_background(spectrum).to_numpy(), spectrum["frequency"].to_numpy()
    records = spectrum["time"].to_numpy()
    cadence_s = float(np.median(np.diff(records)) / np.timedelta64(1, "s")) if records.size > 1 else 1.0
    if method == "flank":
        averaging = SampleAveraging(integration_times_s(spectrum), _visits_apart_s(spectrum))
        return flank_edges(time_s, power, cadence_s, frequency_mhz, averaging)
    light_curves = zip(time_s.T, power.T, strict=True)
    if method == "half_maximum":
        return [
            half_maximum_edge(times, column, spacing_s(times[np.isfinite(column)], cadence_s))
            for times, column in light_curves
        ]
    return [gauss_hermite_edge(times, column) for times, column in light_curves]
