"""Half-maximum edges of light curves.

The edge of a channel is where the rising flank that leads to its maximum crosses half of the maximum *power*, by linear
interpolation between the two samples around the crossing. Amplitudes (Wind) are squared first: half of an amplitude is
a quarter of the power, which the built-in burst reached 5 s (2 MHz) to 80 s (0.2 MHz) earlier.

How sure: the error of a sample near the crossing, carried over by the slope of the flank, and the error of drawing a
straight line between samples, added in quadrature. The second is ``cadence / sqrt(12)`` when the flank falls between
two samples, and shrinks in proportion to the number of samples on it. Simulated bursts scatter by as much at 3 MHz and
by a half to a quarter of it from 1 MHz down, so this errs on the wide side.
"""

import math
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from bella.spectra import relative_power, sample_times
from bella.units import FloatArray

LEVEL = 0.5
"""Fraction of the maximum power at which a flank is timed."""

FLUX_SCATTER = 0.05
"""Typical fractional scatter of a sample of Wind and STEREO one-minute spectra, beside the noise before the burst."""

QUIET_SAMPLES = 4
"""From so few samples before the flank on, their scatter is taken as the noise."""

GAP_CADENCES = 1.5
"""Samples around the crossing that lie further apart than this many records leave the flank unknown."""

NO_SAMPLES, NO_SIGNAL, NO_FLANK, NO_DECAY, GAP = "no_samples", "no_signal", "no_flank", "no_decay", "gap_in_flank"
"""Why a channel has no edge."""


class Edge(NamedTuple):
    """Where a light curve rises."""

    arrival_s: float
    """Seconds on the time axis of the light curve; NaN without an edge."""
    sigma_s: float
    """Standard deviation, s; NaN without an edge."""
    flag: str
    """Empty, or why there is no edge."""


def _none(reason: str) -> Edge:
    return Edge(math.nan, math.nan, reason)


def half_maximum_edge(time_s: FloatArray, power: FloatArray, cadence_s: float) -> Edge:
    """Time at which the flank that leads to the maximum crosses half of it.

    The last sample below half maximum before the peak and the one after it are the two around the crossing, so an
    earlier spike of noise or precursor burst is passed over.

    Parameters
    ----------
    time_s : numpy.ndarray
        Times of the samples, ascending, s, shape (N,).
    power : numpy.ndarray
        Power above background in any unit, shape (N,); NaN where there are no data.
    cadence_s : float
        Time between records, s.

    Returns
    -------
    Edge
        With a reason and NaN when there is no edge: ``no_samples`` (fewer than three), ``no_signal`` (nothing above
        zero), ``no_flank`` (above half maximum from the first sample on), ``no_decay`` (highest at the last sample, so
        the maximum is unknown), ``gap_in_flank``.
    """
    known = np.isfinite(power)
    time_s, power = time_s[known], power[known]
    if power.size < 3:
        return _none(NO_SAMPLES)
    peak = int(power.argmax())
    half = LEVEL * power[peak]
    if not half > 0.0:
        return _none(NO_SIGNAL)
    below = np.flatnonzero(power[:peak] < half)
    if below.size == 0:
        return _none(NO_FLANK)
    if peak == power.size - 1:
        return _none(NO_DECAY)
    return _crossing(time_s, power, cadence_s, int(below[-1]))


def _crossing(time_s: FloatArray, power: FloatArray, cadence_s: float, last_below: int) -> Edge:
    interval_s = time_s[last_below + 1] - time_s[last_below]
    if interval_s > GAP_CADENCES * cadence_s:
        return _none(GAP)
    maximum = power.max()
    slope = (power[last_below + 1] - power[last_below]) / interval_s
    arrival_s = time_s[last_below] + (LEVEL * maximum - power[last_below]) / slope
    sample_error = math.hypot(quiet_noise(power[: last_below + 1], maximum), FLUX_SCATTER * LEVEL * maximum)
    samples_on_flank = max(1.0, maximum / slope / cadence_s)
    line_error_s = cadence_s / math.sqrt(12.0) / samples_on_flank
    return Edge(float(arrival_s), math.hypot(sample_error / slope, line_error_s), "")


def quiet_noise(power: FloatArray, maximum: float) -> float:
    """Scatter of the samples below a quarter of the maximum.

    Parameters
    ----------
    power : numpy.ndarray, shape (N,)
        In any unit.
    maximum : float
        In the same unit.

    Returns
    -------
    float
        Standard deviation in that unit, by the median absolute deviation; 0 where too few samples are quiet.
    """
    quiet = power[power < 0.25 * maximum]
    if quiet.size < QUIET_SAMPLES:
        return 0.0
    return 1.4826 * float(np.median(np.abs(quiet - np.median(quiet))))


def spectrum_edges(spectrum: xr.Dataset) -> pd.DataFrame:
    """Half-maximum edge of every channel of a dynamic spectrum.

    Parameters
    ----------
    spectrum : xarray.Dataset
        Dynamic spectrum that holds one burst, background taken away.

    Returns
    -------
    pandas.DataFrame
        One row per channel, ascending in frequency: observatory, frequency_mhz, arrival_utc (NaT without an edge),
        sigma_s, edge ("half_maximum"), flag. Channels marked as interpolated are left out.
    """
    measured = spectrum
    if "interpolated" in spectrum:
        measured = spectrum.isel(frequency=np.flatnonzero(spectrum["interpolated"].to_numpy() == 0))
    start = measured["time"].to_numpy()[0].astype("datetime64[ns]")
    time_s = (sample_times(measured).to_numpy() - start) / np.timedelta64(1, "s")
    cadence_s = float(np.median(np.diff(measured["time"].to_numpy())) / np.timedelta64(1, "s"))
    light_curves = zip(time_s.T, relative_power(measured).to_numpy().T, strict=True)
    edges = [half_maximum_edge(times, power, cadence_s) for times, power in light_curves]
    arrival_s = np.array([edge.arrival_s for edge in edges], dtype=np.float64)
    delay = pd.to_timedelta(np.rint(arrival_s * 1e9), unit="ns").to_numpy()
    return pd.DataFrame(
        {
            "observatory": str(measured.attrs["observatory"]),
            "frequency_mhz": measured["frequency"].to_numpy(),
            "arrival_utc": start + delay,
            "sigma_s": [edge.sigma_s for edge in edges],
            "edge": "half_maximum",
            "flag": [edge.flag for edge in edges],
        }
    )
