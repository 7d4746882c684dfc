"""From the spectra of one burst to its arrival times: edges of all channels, t(f) of each spacecraft, common table.

Every channel is looked at in a window of its own around the onset that the search has found there, so that other bursts
of the day have no say. A curve t(f) through the edges gives times at frequencies that all spacecraft share.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
import xarray as xr

from bella.arrivals import check_arrivals
from bella.bursts.association import FEWEST_SPACECRAFT
from bella.bursts.detection import Candidate, Searched, candidate_at, onset_records
from bella.bursts.edges import EDGE_OF_METHOD, spectrum_edges
from bella.bursts.matched_filter import BEAM_SPEEDS_C
from bella.bursts.search_grid import FREQUENCY_MHZ, STEP_S
from bella.bursts.time_evolution import TimeEvolution, best_time_evolution, common_offset_s
from bella.bursts.widths import decay_s, rise_half_width_s
from bella.exceptions import InputError, NoDataError
from bella.spectra.assembly import cadence_s
from bella.units import FloatArray

BEFORE_S, BEFORE_RISES = 240.0, 6.0
"""A window begins so long, and so many half widths of the rise, before the onset of its channel."""

AFTER_S, AFTER_DECAYS, AFTER_RISES = 240.0, 2.0, 4.0
AROUND_S = 900.0
"""How far from the time given a burst may begin."""

LOWEST_MHZ, HIGHEST_MHZ = 0.15, 2.0
"""Band in which sources are placed, as in Canizares et al. 2024, A&A 684, A182, doi:10.1051/0004-6361/202347747."""

FREQUENCIES = 40
FEWEST_EDGES = 8
NARROWEST = 1.5
"""Frequencies that spacecraft share have to span this ratio for a track."""

BAND_MARGIN = 1.15
"""Channels so far beyond those that the search saw are looked at too, and all up to `HIGHEST_MHZ`."""


@dataclass(frozen=True)
class TimedBurst:
    """A burst with the edges of every spacecraft.

    Attributes
    ----------
    edges : DataFrame
        One row per channel: observatory, frequency_mhz, arrival_utc, sigma_s, edge, flag.
    evolutions : dict of str to TimeEvolution
        t(f) of each spacecraft with enough edges, seconds after `reference_utc`.
    reference_utc : numpy.datetime64
    offsets_s : dict of str to float
        Standard deviation of the timing offset that the channels of a spacecraft share, s.
    bands_mhz : dict of str to (float, float)
        Lowest and highest frequency with an edge.
    """

    edges: pd.DataFrame
    evolutions: dict[str, TimeEvolution]
    reference_utc: np.datetime64
    offsets_s: dict[str, float]
    bands_mhz: dict[str, tuple[float, float]]


def candidate_near(searched: Searched, around_utc: np.datetime64) -> Candidate:
    """What the search shows nearest to a time: the strongest within a quarter of an hour.

    Parameters
    ----------
    searched : Searched
    around_utc : numpy.datetime64
        About the onset at high frequencies, UTC.

    Returns
    -------
    Candidate

    Raises
    ------
    NoDataError
        If no channel shows a rise there.
    """
    match = searched.match
    record = (around_utc - searched.grid.start) / np.timedelta64(1, "s") / STEP_S
    first, last = (int(record + side * AROUND_S / STEP_S) for side in (-1, 1))
    near = match.score[: len(BEAM_SPEEDS_C), max(0, first) : max(0, last + 1)].max(axis=0)
    if not near.size or not near.max() > 0:
        raise NoDataError(
            f"{searched.observatory} shows no rise within {AROUND_S / 60:g} min of {around_utc}: give another time"
        )
    return candidate_at(match, max(0, first) + int(near.argmax()))


def burst_edges(searched: Searched, one: Candidate, method: str = "flank") -> pd.DataFrame:
    """Edges of a burst in the channels of one spacecraft.

    Parameters
    ----------
    searched : Searched
    one : Candidate
        The burst.
    method : str
        As of :func:`bella.bursts.edges.spectrum_edges`.

    Returns
    -------
    pandas.DataFrame
        As :func:`bella.bursts.edges.spectrum_edges` returns it, for the channels in the band of the burst.

    Raises
    ------
    NoDataError
        If the spectrum has no channel in that band.
    """
    low, high = FREQUENCY_MHZ[np.flatnonzero(one.hit)[[0, -1]]]
    part = searched.over.sel(frequency=slice(low / BAND_MARGIN, max(high, HIGHEST_MHZ) * BAND_MARGIN))
    if part.sizes["frequency"] == 0:
        raise NoDataError(f"{searched.observatory} has no channel from {low:.3g} to {high:.3g} MHz")
    onset_s = _onsets_s(searched, one, part["frequency"].to_numpy())
    return spectrum_edges(_windowed(part, onset_s), method)


def _onsets_s(searched: Searched, one: Candidate, frequency_mhz: FloatArray) -> tuple[np.datetime64, FloatArray]:
    """Onset in every channel: a time, and seconds after it."""
    seconds = np.interp(np.log(frequency_mhz), np.log(FREQUENCY_MHZ), onset_records(one) * STEP_S)
    return searched.grid.start, seconds


def _windowed(part: xr.Dataset, onset: tuple[np.datetime64, FloatArray]) -> xr.Dataset:
    """Records from the first window to the last, samples outside that of their channel taken away."""
    start, onset_s = onset
    rise = np.array([rise_half_width_s(float(one)) for one in part["frequency"]])
    decay = np.array([decay_s(float(one)) for one in part["frequency"]])
    begin_s = onset_s - BEFORE_S - BEFORE_RISES * rise
    end_s = onset_s + AFTER_S + AFTER_DECAYS * decay + AFTER_RISES * rise
    record_s = (part["time"].to_numpy() - start) / np.timedelta64(1, "s")
    kept = part.isel(time=np.flatnonzero((record_s >= begin_s.min()) & (record_s <= end_s.max())))
    if kept.sizes["time"] == 0:
        raise NoDataError(f"{part.attrs['observatory']} has no record around {start}: name the file of that day")
    record_s = (kept["time"].to_numpy() - start) / np.timedelta64(1, "s")
    inside = (record_s[:, None] >= begin_s) & (record_s[:, None] <= end_s)
    return kept.assign(intensity=kept["intensity"].where(xr.DataArray(inside, dims=("time", "frequency"))))


def timed_burst(edges: pd.DataFrame, spectra: Mapping[str, xr.Dataset]) -> TimedBurst:
    """Fit t(f) of every spacecraft through its edges.

    Parameters
    ----------
    edges : pandas.DataFrame
        Edges of all spacecraft.
    spectra : mapping of str to xarray.Dataset
        What they were read from, for the cadence of each.

    Returns
    -------
    TimedBurst
        A spacecraft with fewer good edges than `FEWEST_EDGES` has no evolution.

    Raises
    ------
    NoDataError
        If no channel has an edge.
    """
    good = edges[(edges["flag"] == "") & edges["arrival_utc"].notna()]
    if good.empty:
        raise NoDataError("no channel of any spacecraft has an edge: try another time, or see the flags")
    reference = np.datetime64(good["arrival_utc"].min(), "ns")
    evolutions, offsets, bands = {}, {}, {}
    for name, rows in good.groupby("observatory", sort=False):
        frequency_mhz = rows["frequency_mhz"].to_numpy(dtype=np.float64)
        bands[str(name)] = (float(frequency_mhz.min()), float(frequency_mhz.max()))
        offsets[str(name)] = _offset_s(spectra[str(name)], min(bands[str(name)][1], HIGHEST_MHZ))
        if len(rows) >= FEWEST_EDGES:
            arrival_s = (rows["arrival_utc"].to_numpy() - reference) / np.timedelta64(1, "s")
            evolutions[str(name)] = best_time_evolution(frequency_mhz, arrival_s, rows["sigma_s"].to_numpy())
    return TimedBurst(edges, evolutions, reference, offsets, bands)


def _offset_s(spectrum: xr.Dataset, highest_mhz: float) -> float:
    cadence = cadence_s(spectrum["time"].to_numpy())
    shared = float(common_offset_s(np.array([highest_mhz]), cadence, float(spectrum.attrs["integration_s"]))[0])
    return math.hypot(shared, float(spectrum.attrs.get("time_uncertainty_s", 0.0)), _records_sd_s(spectrum))


def _records_sd_s(spectrum: xr.Dataset) -> float:
    """How well the times of records are known that most channels share; s."""
    if "sample_time_sd_s" not in spectrum:
        return 0.0
    return float(np.nan_to_num(np.nanmedian(spectrum["sample_time_sd_s"].to_numpy())))


def shared_frequencies_mhz(timed: TimedBurst, number: int = FREQUENCIES) -> FloatArray:
    """Frequencies at which at least three spacecraft, or all there are, have a t(f).

    Parameters
    ----------
    timed : TimedBurst
    number : int

    Returns
    -------
    numpy.ndarray, shape (number,)
        MHz, evenly spaced in ln f between `LOWEST_MHZ` and `HIGHEST_MHZ`; empty where they share too narrow a band.
    """
    bands = [timed.bands_mhz[name] for name in timed.evolutions]
    needed = min(FEWEST_SPACECRAFT, len(bands))
    if not needed:
        return np.empty(0)
    low = max(sorted(band[0] for band in bands)[needed - 1], LOWEST_MHZ)
    high = min(sorted((band[1] for band in bands), reverse=True)[needed - 1], HIGHEST_MHZ)
    return np.geomspace(low, high, number) if high >= NARROWEST * low else np.empty(0)


def arrival_table(timed: TimedBurst, frequency_mhz: FloatArray, method: str = "flank") -> pd.DataFrame:
    """Arrival table from t(f) of each spacecraft.

    Parameters
    ----------
    timed : TimedBurst
    frequency_mhz : numpy.ndarray, shape (F,)
        A spacecraft has rows for those within its own band.
    method : str
        How the edges were found.

    Returns
    -------
    pandas.DataFrame
        As :func:`bella.arrivals.check_arrivals` returns it; ``sigma_s`` is that of the curve, ``offset_sd_s`` what all
        channels of the spacecraft share.

    Raises
    ------
    InputError
        If there is no frequency, or no curve.
    """
    parts = []
    for name, curve in timed.evolutions.items():
        low, high = timed.bands_mhz[name]
        asked = frequency_mhz[(frequency_mhz >= low * (1 - 1e-9)) & (frequency_mhz <= high * (1 + 1e-9))]
        delay = np.rint(curve.arrival_s(asked) * 1e9).astype("timedelta64[ns]")
        columns = {
            "observatory": name,
            "frequency_mhz": asked,
            "arrival_utc": timed.reference_utc + delay,
            "sigma_s": np.sqrt(np.diag(curve.covariance_s2(asked))),
            "edge": EDGE_OF_METHOD[method],
            "offset_sd_s": timed.offsets_s[name],
        }
        parts.append(pd.DataFrame(columns))
    if not parts or not sum(len(part) for part in parts):
        raise InputError("no spacecraft has enough edges in common frequencies for a table: widen the band or the time")
    return check_arrivals(pd.concat(parts, ignore_index=True))


def arrival_covariance(timed: TimedBurst, frequency_mhz: FloatArray) -> xr.Dataset:
    """Covariance of the arrival times of each spacecraft that come from one curve, with what its channels share.

    Parameters
    ----------
    timed : TimedBurst
    frequency_mhz : numpy.ndarray, shape (F,)

    Returns
    -------
    xarray.Dataset
        ``covariance_s2(observatory, frequency, frequency_other)``, s^2.
    """
    names = list(timed.evolutions)
    stacked = [timed.evolutions[name].covariance_s2(frequency_mhz) + timed.offsets_s[name] ** 2 for name in names]
    dims = ("observatory", "frequency", "frequency_other")
    coords = {"observatory": names, "frequency": frequency_mhz, "frequency_other": frequency_mhz}
    return xr.Dataset({"covariance_s2": (dims, np.array(stacked), {"units": "s2"})}, coords=coords)


def why_not_timed(timed: TimedBurst, needed: Sequence[str]) -> str:
    """Why the edges of a burst do not place it; empty if they do.

    Parameters
    ----------
    timed : TimedBurst
    needed : sequence of str
        Spacecraft that were to be timed.

    Returns
    -------
    str
    """
    if len(timed.evolutions) < FEWEST_SPACECRAFT:
        without = [name for name in needed if name not in timed.evolutions]
        return f"not localisable: fewer than {FEWEST_EDGES} good edges at {', '.join(without)}"
    frequency_mhz = shared_frequencies_mhz(timed)
    if not frequency_mhz.size:
        return f"not localisable: edges share no band from {LOWEST_MHZ:g} to {HIGHEST_MHZ:g} MHz"
    for name, curve in timed.evolutions.items():
        if not (np.diff(curve.arrival_s(frequency_mhz)) < 0).all():
            return f"not localisable: edges at {name} do not drift downwards"
    return ""
