"""The burst of 2012-06-07 that comes with the package, with both definitions of its edge.

*gauss_hermite*: the published curves t(f), which mark the flank one sigma of a Gauss-Hermite profile before the peak.
*half_maximum*: edges of the digitised spectra at half of the maximum power.
Any edge of :data:`bella.bursts.timing.EDGES`: what any burst goes through that is found in spectra.

The first two tell when the burst reached Wind, STEREO-A and STEREO-B at 200 frequencies; how sure they are is measured
by the scatter of single channels about the curve, and is the same at all frequencies of a spacecraft.
"""

from functools import lru_cache
from importlib import resources
from typing import NamedTuple

import numpy as np
import pandas as pd

from bella.arrivals import check_arrivals
from bella.bursts.detection import search
from bella.bursts.timing import (
    EDGES,
    SHARED,
    TimedBurst,
    arrival_table,
    burst_spectrum,
    candidate_near,
    shared_frequencies_mhz,
    spectrum_edges,
    time_burst,
)
from bella.exceptions import InputError
from bella.spectra import event_spectra
from bella.units import FloatArray

PUBLISHED_TRACK = {
    "model": "the paper",
    "doi": "10.1051/0004-6361/202347747",
    "phi0_deg": {"mean": 30.0, "sd": 2.0},
    "v_sw_km_s": {"mean": 400.0, "sd": 20.0},
    "rotation_period_d": 24.47,
}
"""Spiral of the paper (Canizares et al. 2024), with the rotation period that its figures use."""

REFERENCE_UTC = np.datetime64("2012-06-07T19:20:00", "ns")
"""Zero of the times in the resource files."""

MAD_TO_SD = 1.4826


class BuiltInEvent(NamedTuple):
    """What the catalogue says about the built-in burst."""

    name: str
    burst_id: str
    start_utc: np.datetime64
    """Onset at the highest frequency."""
    stop_utc: np.datetime64
    low_mhz: float
    high_mhz: float
    observatories: tuple[str, ...]


EVENT = BuiltInEvent(
    name="2012-06-07",
    burst_id="T3-20120607-1929",
    start_utc=np.datetime64("2012-06-07T19:29:03", "ns"),
    stop_utc=np.datetime64("2012-06-07T20:00:00", "ns"),
    low_mhz=0.15,
    high_mhz=2.0,
    observatories=("WIND", "STEREO-A", "STEREO-B"),
)

FREQUENCIES_MHZ = np.geomspace(EVENT.low_mhz, EVENT.high_mhz, 200)


class TimeEvolution(NamedTuple):
    """Arrival time as a function of frequency, a2 / f^2 + a1 / f + a0 of Canizares et al. 2024.

    It misses simulated beams by 2 s rms (11 s at most) between 0.2 and 10 MHz.
    """

    coefficients: FloatArray
    """a2, a1, a0 in seconds on some axis and powers of MHz, shape (3,)."""
    covariance: FloatArray
    """Of the coefficients, shape (3, 3); NaN where unknown."""

    def arrival_s(self, frequency_mhz: FloatArray) -> FloatArray:
        """Arrival times at frequencies in MHz; s on the axis of the coefficients, same shape."""
        return np.asarray(_terms(frequency_mhz) @ self.coefficients, dtype=np.float64)

    def covariance_s2(self, frequency_mhz: FloatArray) -> FloatArray:
        """Covariance of the arrival times, s^2, shape (F, F): they come from one curve, so all are correlated."""
        terms = _terms(frequency_mhz)
        return np.asarray(terms @ self.covariance @ terms.T)


def _terms(frequency_mhz: FloatArray) -> FloatArray:
    frequency = np.asarray(frequency_mhz, dtype=np.float64)
    return np.stack([frequency**-2.0, 1 / frequency, np.ones_like(frequency)], axis=-1)


def fit_time_evolution(frequency_mhz: FloatArray, arrival_s: FloatArray, sigma_s: FloatArray) -> TimeEvolution:
    """Weighted least-squares fit of t(f).

    Parameters
    ----------
    frequency_mhz, arrival_s, sigma_s : numpy.ndarray, shape (N,)
        MHz; s; standard deviation, s. Rows with NaN are left out.

    Returns
    -------
    TimeEvolution
        With the covariance that the given sigmas imply, not rescaled by the residuals.

    Raises
    ------
    InputError
        If fewer than three different frequencies remain, or a sigma is not above zero.
    """
    known = np.isfinite(frequency_mhz) & np.isfinite(arrival_s) & np.isfinite(sigma_s)
    number = np.unique(frequency_mhz[known]).size
    if number < 3:
        raise InputError(f"t(f) needs edges at three frequencies, not {number}: widen the frequency range")
    if not (sigma_s[known] > 0.0).all():
        raise InputError("a timing sigma is not above zero: give the standard deviation of every arrival in seconds")
    orthonormal, triangle = np.linalg.qr(_terms(frequency_mhz[known]) / sigma_s[known, None])
    inverse = np.linalg.inv(triangle)
    return TimeEvolution(inverse @ (orthonormal.T @ (arrival_s[known] / sigma_s[known])), inverse @ inverse.T)


def _resource(name: str) -> pd.DataFrame:
    with resources.as_file(resources.files("bella.bursts") / name) as path:
        return pd.read_csv(path, comment="#")


def _frequencies(frequencies_mhz: FloatArray | None) -> FloatArray:
    if frequencies_mhz is None:
        return FREQUENCIES_MHZ
    asked = np.atleast_1d(np.asarray(frequencies_mhz, dtype=np.float64))
    outside = ~((asked >= EVENT.low_mhz) & (asked <= EVENT.high_mhz))
    if outside.any():
        raise InputError(
            f"the arrival times of {EVENT.name} are known from {EVENT.low_mhz:g} to {EVENT.high_mhz:g} MHz, "
            f"not at {asked[outside][0]:g} MHz: choose frequencies inside"
        )
    return asked


def _arrivals(
    observatory: str, frequency_mhz: FloatArray, evolution: TimeEvolution, sigma_s: float, edge: str
) -> pd.DataFrame:
    arrival_ns = np.rint(evolution.arrival_s(frequency_mhz) * 1e9).astype("timedelta64[ns]")
    return pd.DataFrame(
        {
            "observatory": observatory,
            "frequency_mhz": frequency_mhz,
            "arrival_utc": REFERENCE_UTC + arrival_ns,
            "sigma_s": sigma_s,
            "edge": edge,
            "flag": "",
        }
    )


def published_evolution() -> dict[str, TimeEvolution]:
    """Published t(f) of each spacecraft, seconds after ``REFERENCE_UTC``.

    Returns
    -------
    dict of str to TimeEvolution
        By observatory; their covariance was not published and is NaN.
    """
    rows = _resource("published_time_evolution.csv").set_index("observatory")[["a2_s_mhz2", "a1_s_mhz", "a0_s"]]
    unknown = np.full((3, 3), np.nan)
    return {str(name): TimeEvolution(row.to_numpy(dtype=np.float64), unknown) for name, row in rows.iterrows()}


def published_rise_times() -> pd.DataFrame:
    """Rise times per channel as marked for STEREO-A and STEREO-B in the published figure.

    Returns
    -------
    pandas.DataFrame
        Columns observatory, frequency_mhz, arrival_utc; read off the figure with a standard deviation of 4 s.
    """
    rows = _resource("published_rise_times.csv")
    rise_ns = np.rint(rows["rise_s"].to_numpy() * 1e9).astype("timedelta64[ns]")
    return rows[["observatory", "frequency_mhz"]].assign(arrival_utc=REFERENCE_UTC + rise_ns)


def published_sigma_s() -> dict[str, float]:
    """Timing error of the published curves, by spacecraft.

    STEREO: root mean square of the marked rise times about the curve, over its valid range. It holds the error of a
    single channel, what the form of the curve cannot follow, and 4 s from reading the figure. Wind's markers overlap
    and cannot be read: it gets the larger of the two, since its records are longer (60 s against 39 s).

    Returns
    -------
    dict of str to float
        Seconds.
    """
    curves = published_evolution()
    marks = published_rise_times()
    marks = marks[marks["frequency_mhz"].between(EVENT.low_mhz, EVENT.high_mhz)]
    sigma_s = {}
    for name, rows in marks.groupby("observatory"):
        marked_s = (rows["arrival_utc"].to_numpy() - REFERENCE_UTC) / np.timedelta64(1, "s")
        residual_s = marked_s - curves[str(name)].arrival_s(rows["frequency_mhz"].to_numpy())
        sigma_s[str(name)] = float(np.sqrt(np.mean(residual_s**2)))
    return {"WIND": max(sigma_s.values()), **sigma_s}


def published_arrivals(frequencies_mhz: FloatArray | None = None) -> pd.DataFrame:
    """Arrival table of the published curves t(f).

    Parameters
    ----------
    frequencies_mhz : numpy.ndarray, optional
        MHz within 0.15 to 2; 200 log-spaced ones when not given.

    Returns
    -------
    pandas.DataFrame
        As :func:`bella.arrivals.check_arrivals` returns it, edge "gauss_hermite".

    Raises
    ------
    InputError
        If a frequency is outside the valid range.

    Notes
    -----
    Canizares et al. 2024, A&A 684, A182, doi:10.1051/0004-6361/202347747.
    """
    asked, sigma_s = _frequencies(frequencies_mhz), published_sigma_s()
    curves = published_evolution().items()
    tables = [_arrivals(name, asked, curve, sigma_s[name], "gauss_hermite") for name, curve in curves]
    return check_arrivals(pd.concat(tables, ignore_index=True))


def half_maximum_edges() -> pd.DataFrame:
    """Half-maximum edge of every channel of the digitised spectra, for drawing on them and for the fit of t(f).

    Returns
    -------
    pandas.DataFrame
        Columns observatory, frequency_mhz (0.15 to 2 MHz), arrival_utc (NaT without an edge), sigma_s, edge, flag.
    """
    spectra = event_spectra()
    edges = pd.concat(
        [spectrum_edges(spectra[name].to_dataset(), "half_maximum") for name in EVENT.observatories], ignore_index=True
    )
    return edges[edges["frequency_mhz"].between(EVENT.low_mhz, EVENT.high_mhz)].reset_index(drop=True)


def half_maximum_evolution() -> dict[str, tuple[TimeEvolution, float]]:
    """Fitted t(f) of the half-maximum edges of each spacecraft, and how far its channels scatter about it.

    Returns
    -------
    dict of str to (TimeEvolution, float)
        By observatory; seconds after ``REFERENCE_UTC``. The scatter is 1.4826 times the median absolute residual, with
        the 3 s of the time axis of the digitised figure added in quadrature.
    """
    edges, spectra = half_maximum_edges(), event_spectra()
    fits = {}
    for name in EVENT.observatories:
        rows = edges[(edges["observatory"] == name) & (edges["flag"] == "")]
        frequency_mhz = rows["frequency_mhz"].to_numpy()
        arrival_s = (rows["arrival_utc"].to_numpy() - REFERENCE_UTC) / np.timedelta64(1, "s")
        curve = fit_time_evolution(frequency_mhz, arrival_s, rows["sigma_s"].to_numpy())
        scatter_s = MAD_TO_SD * np.median(np.abs(arrival_s - curve.arrival_s(frequency_mhz)))
        fits[name] = (curve, float(np.hypot(scatter_s, spectra[name].attrs["time_uncertainty_s"])))
    return fits


def half_maximum_arrivals(frequencies_mhz: FloatArray | None = None) -> pd.DataFrame:
    """Arrival table of the half-maximum edges, by way of t(f) of each spacecraft.

    Parameters
    ----------
    frequencies_mhz : numpy.ndarray, optional
        MHz within 0.15 to 2; 200 log-spaced ones when not given.

    Returns
    -------
    pandas.DataFrame
        As :func:`bella.arrivals.check_arrivals` returns it, edge "half_maximum".

    Raises
    ------
    InputError
        If a frequency is outside the range.
    """
    asked = _frequencies(frequencies_mhz)
    fits = half_maximum_evolution().items()
    tables = [_arrivals(name, asked, curve, sigma_s, "half_maximum") for name, (curve, sigma_s) in fits]
    return check_arrivals(pd.concat(tables, ignore_index=True))


@lru_cache(maxsize=len(EDGES))
def timed_event(edge: str = SHARED) -> TimedBurst:
    """The burst timed as any burst is that is found in spectra.

    Parameters
    ----------
    edge : str
        One of :data:`bella.bursts.timing.EDGES`.
    """
    parts = []
    for name in EVENT.observatories:
        searched = search(event_spectra()[name].to_dataset())
        parts.append(burst_spectrum(searched, candidate_near(searched, EVENT.start_utc)))
    return time_burst(parts, edge)


def event_arrivals(edge: str = SHARED) -> pd.DataFrame:
    """Arrival table at frequencies where all three spacecraft have channels.

    Parameters
    ----------
    edge : str
        One of :data:`bella.bursts.timing.EDGES`.

    Returns
    -------
    pandas.DataFrame
        As :func:`bella.arrivals.check_arrivals` returns it; ``offset_sd_s`` holds the 3 s by which the time axis of the
        digitised figure is known.
    """
    timed = timed_event(edge)
    return arrival_table(timed, shared_frequencies_mhz(timed))
