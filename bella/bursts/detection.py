"""Type III bursts in the spectrum of one spacecraft.

A candidate is a maximum of the matched filter (:mod:`bella.bursts.matched_filter`). It is a burst if enough channels
above 0.8 MHz see it, where Earth's kilometric radiation and most interference do not reach, and if a drift fits better
than none. What is refused is returned too, with its reason.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr

from bella.bursts.light_curves import decay_s
from bella.bursts.matched_filter import (
    BEAM_SPEEDS_C,
    BEFORE_RECORDS,
    FREQUENCY_MHZ,
    HIGHEST_MHZ,
    STEP_S,
    THRESHOLDS,
    Match,
    SearchGrid,
    channel_match,
    drift_delays_s,
    drift_match,
    over_quiet,
    search_grid,
)
from bella.exceptions import InputError
from bella.flags import CATALOGUED, REJECTED
from bella.units import FloatArray

DETECTION_COLUMNS = {
    "observatory": "object",
    "start_utc": "datetime64[ns]",
    "peak_utc": "datetime64[ns]",
    "end_utc": "datetime64[ns]",
    "f_low_mhz": "float64",
    "f_high_mhz": "float64",
    "score": "float64",
    "drift": "float64",
    "peak_db": "float64",
    "channels": "int64",
    "flux_sfu_1au": "float64",
    "isolated": "bool",
    "tier": "object",
    "reason": "object",
    "burst_id": "object",
}
"""Of a detection table, with their types. ``start_utc`` is the onset at the highest frequency, ``drift`` the beam speed
in units of c that fits best, ``flux_sfu_1au`` the largest flux density at 1 au, NaN where the files do
not state it, ``burst_id`` is empty until spacecraft are compared."""

FEWEST_MINUTES = BEFORE_RECORDS + 2
"""Minutes before a rise that it is compared with, and two of the rise."""

LONGEST_S = 100 * 86_400.0
"""Longest that a spectrum may span, gaps included: 1.2 GB of minutes."""

BAND_EDGE = float(np.sqrt(FREQUENCY_MHZ[1] / FREQUENCY_MHZ[0]))
"""Half a channel of the grid, as a factor."""

NO_SUPPORT, NO_DRIFT, TOO_LONG = "few_channels_above_0.8_mhz", "no_drift", "lasts_too_long"
GROUP, GAP = "group", "gap_in_flank"
NO_DATA = "it holds no data, every value is missing"


class Candidate(NamedTuple):
    """A maximum of the matched filter."""

    record: int
    """Minute of its onset at the highest channel of the grid."""
    drift: int
    """Index of the drift that fits best."""
    score: float
    hit: npt.NDArray[np.bool_]
    """Which channels see it."""
    reason: str
    """Why it is no burst; empty if it is one."""


class Searched(NamedTuple):
    """The spectrum of one spacecraft after the search."""

    over: xr.Dataset
    """Over its background (:func:`bella.bursts.matched_filter.over_quiet`), as its edges are read from."""
    grid: SearchGrid
    match: Match
    found: tuple[Candidate, ...]
    """In order of time."""
    not_searchable: str = ""
    """Why no burst can be found in it whatever the Sun did; empty where one can."""

    @property
    def observatory(self) -> str:
        """Who recorded it."""
        return str(self.over.attrs["observatory"])


def search(spectrum: xr.Dataset) -> Searched:
    """Search the spectrum of one spacecraft.

    Parameters
    ----------
    spectrum : xarray.Dataset
        Dynamic spectrum, best of a whole day with all receivers combined.

    Raises
    ------
    InputError
        If the quantity of the spectrum is not known, or if it spans more time than a search can hold.
    """
    span_s = float(np.ptp(spectrum["time"].to_numpy()) / np.timedelta64(1, "s"))
    if span_s > LONGEST_S:
        raise InputError(
            f"the spectrum of {spectrum.attrs['observatory']} spans {span_s / 86_400:.0f} days, and a search can hold "
            f"{LONGEST_S / 86_400:g}: cut it with bella.spectra.fleet_pieces"
        )
    over = over_quiet(spectrum)
    grid = search_grid(over)
    match = drift_match(channel_match(grid.excess_db, grid.noise_db, grid.revisit), grid.revisit)
    has_data = bool(np.isfinite(spectrum["intensity"].to_numpy()).any())
    reason = why_not_searchable(grid) if has_data else NO_DATA
    found = () if reason else tuple(_lasting_judged(grid, one) for one in candidates(match))
    return Searched(over, grid, match, found, reason)


def why_not_searchable(grid: SearchGrid) -> str:
    """Reason why no burst can be found on a grid, whatever it shows; empty where one can.

    Returns
    -------
    str
        In words, without the name of the spacecraft.
    """
    measured = np.isfinite(grid.noise_db)
    slow = np.broadcast_to(grid.revisit, measured.shape)[~measured]
    above = int(np.count_nonzero(measured & (THRESHOLDS.support_above_mhz < FREQUENCY_MHZ)))
    some = int(np.count_nonzero(measured & (THRESHOLDS.kilometric_below_mhz < FREQUENCY_MHZ)))
    if above >= THRESHOLDS.support_channels or (
        some >= THRESHOLDS.kilometric_channels and np.count_nonzero(measured) >= THRESHOLDS.kilometric_all
    ):
        if len(grid.excess_db) >= FEWEST_MINUTES:
            return ""
        return f"it lasts {len(grid.excess_db)} minutes, and a search needs {FEWEST_MINUTES}"
    is_coarse = slow > THRESHOLDS.longest_revisit_minutes
    if is_coarse.any():
        return f"its records are {60.0 * float(np.median(slow[is_coarse])):.0f} s apart, too coarse"
    return (
        f"it has data in {above} of the {THRESHOLDS.support_channels} search channels that a burst needs between "
        f"{THRESHOLDS.support_above_mhz:g} and {HIGHEST_MHZ:g} MHz"
    )


def detect_bursts(spectrum: xr.Dataset) -> pd.DataFrame:
    """Bursts in the spectrum of one spacecraft.

    Parameters
    ----------
    spectrum : xarray.Dataset
        Dynamic spectrum, best of a whole day with all receivers combined.

    Returns
    -------
    pandas.DataFrame
        `DETECTION_COLUMNS`, one row per candidate in order of time; tier "catalogued", or "rejected" with its reason.
        Empty where nothing is found, or nothing can be: ``attrs["not_searchable"]`` then has the reason.

    Raises
    ------
    InputError
        If the quantity of the spectrum is not known.
    """
    searched = search(spectrum)
    table = detection_table([detection_row(searched, one) for one in searched.found])
    table.attrs["not_searchable"] = searched.not_searchable
    return table


def candidates(match: Match, threshold: float = THRESHOLDS.score) -> list[Candidate]:
    """Maxima of the matched filter above a threshold, in order of time."""
    score = match.score[: len(BEAM_SPEEDS_C)].max(axis=0)
    found: list[int] = []
    for record in np.flatnonzero(score >= threshold):
        around = score[max(0, record - THRESHOLDS.apart_minutes) : record + THRESHOLDS.apart_minutes + 1]
        if score[record] == around.max() and not (found and record - found[-1] <= THRESHOLDS.apart_minutes):
            found.append(int(record))
    return [candidate_at(match, record) for record in found]


def candidate_at(match: Match, record: int) -> Candidate:
    """What the matched filter shows at a minute, judged.

    Parameters
    ----------
    match : Match
        Of which at least one channel sees something at this minute.
    """
    drift = int(match.score[: len(BEAM_SPEEDS_C), record].argmax())
    score, hit = float(match.score[drift, record]), _longest_run(match.hit[drift, record], match.measured)
    reason = _why_none(hit, score, _undrifting(match, record), match.revisit)
    return Candidate(record, drift, score, hit, reason)


def _undrifting(match: Match, record: int) -> tuple[float, float]:
    """Best scores of no drift and of an upward drift around a minute."""
    around = match.score[
        len(BEAM_SPEEDS_C) :, max(0, record - THRESHOLDS.apart_minutes) : record + THRESHOLDS.apart_minutes + 1
    ]
    return float(around[0].max()), float(around[1:].max())


def _why_none(hit: npt.NDArray[np.bool_], score: float, undrifting: tuple[float, float], revisit: float) -> str:
    """Reason why a candidate is no burst; empty if it is one."""
    standing, rising = undrifting
    if np.count_nonzero(hit & (THRESHOLDS.support_above_mhz < FREQUENCY_MHZ)) < THRESHOLDS.support_channels:
        is_above = (
            np.count_nonzero(hit & (THRESHOLDS.kilometric_below_mhz < FREQUENCY_MHZ)) >= THRESHOLDS.kilometric_channels
        )
        is_long = np.count_nonzero(hit) >= THRESHOLDS.kilometric_all
        clear = max(THRESHOLDS.clear_margin - THRESHOLDS.slow_clear_margin * (revisit - 1.0), 1.0)
        return "" if is_above and is_long and score >= clear * max(undrifting) else NO_SUPPORT
    if np.count_nonzero(hit & (THRESHOLDS.wide_below_mhz > FREQUENCY_MHZ)) >= THRESHOLDS.wide_channels:
        blurred = 1.0 + THRESHOLDS.slow_margin * (revisit - 1.0)
        drifts = standing <= THRESHOLDS.fast_margin * blurred * score and rising <= blurred * score
    else:
        drifts = THRESHOLDS.clear_margin * max(undrifting) <= score
    return "" if drifts else NO_DRIFT


def _lasting_judged(grid: SearchGrid, one: Candidate) -> Candidate:
    """The candidate, refused if it lasts too long for its frequencies."""
    band = np.flatnonzero(one.hit)
    if one.reason or band.size >= THRESHOLDS.narrow_channels:
        return one
    is_wide = np.count_nonzero(FREQUENCY_MHZ[band] < THRESHOLDS.wide_below_mhz) >= THRESHOLDS.wide_channels
    onset = onset_records(one)
    shares = [_lasting(grid, int(onset[channel]), int(channel)) for channel in band]
    is_long = np.median(shares) > (THRESHOLDS.longest if is_wide else THRESHOLDS.longest_above)
    return one._replace(reason=TOO_LONG) if is_long else one


def _lasting(grid: SearchGrid, onset: int, channel: int) -> float:
    """How long a channel stays near its peak, in units of the time that a burst takes for that."""
    excess_db, sample_s = grid.excess_db[:, channel], STEP_S * grid.revisit_of(channel)
    peak = _peak(excess_db, onset, channel)
    height = np.nan_to_num(excess_db[peak])
    low = np.flatnonzero(~(excess_db > height - min(0.5 * height, THRESHOLDS.depth_db)))
    place = np.searchsorted(low, peak)
    first = low[place - 1] if place > 0 else -1
    last = low[place] if place < low.size else len(excess_db)
    return float((last - first - 1) * STEP_S / (sample_s + 2 * float(decay_s(FREQUENCY_MHZ[channel]))))


def detection_table(rows: Sequence[dict[str, object]]) -> pd.DataFrame:
    """Detection table of rows.

    Parameters
    ----------
    rows : sequence of dict
        As from :func:`detection_row`.

    Returns
    -------
    pandas.DataFrame
        `DETECTION_COLUMNS` with their types, also where there are no rows.
    """
    return pd.DataFrame(list(rows), columns=list(DETECTION_COLUMNS)).astype(DETECTION_COLUMNS)


def detection_row(searched: Searched, one: Candidate, company: str | None = None) -> dict[str, object]:
    """Measure a candidate on the grid it was found on.

    Parameters
    ----------
    company : str, optional
        What :func:`why_not_alone` says of it, where that is known.

    Returns
    -------
    dict
        Keys are `DETECTION_COLUMNS`.
    """
    grid = searched.grid
    company = why_not_alone(searched, one) if company is None else company
    band, onset = np.flatnonzero(one.hit), onset_records(one)
    peaks = np.array([_peak(grid.excess_db[:, channel], int(onset[channel]), int(channel)) for channel in band])
    heights = grid.excess_db[peaks, band]
    last = int(peaks[0] + float(decay_s(FREQUENCY_MHZ[band[0]])) // STEP_S)
    start, end = _utc(grid, onset[band[-1]]), _utc(grid, min(last + 1, len(grid.excess_db)))
    return {
        "observatory": searched.observatory,
        "start_utc": start,
        "peak_utc": _utc(grid, peaks[int(np.nanargmax(heights))] + 0.5),
        "end_utc": end,
        "f_low_mhz": float(FREQUENCY_MHZ[band[0]]),
        "f_high_mhz": float(FREQUENCY_MHZ[band[-1]]),
        "score": one.score,
        "drift": BEAM_SPEEDS_C[one.drift],
        "peak_db": float(np.nanmax(heights)),
        "channels": int(one.hit.sum()),
        "flux_sfu_1au": _flux_sfu_1au(searched.over, FREQUENCY_MHZ[band[[0, -1]]], start, end),
        "isolated": not company,
        "tier": REJECTED if one.reason else CATALOGUED,
        "reason": one.reason or company,
        "burst_id": "",
    }


def _flux_sfu_1au(over: xr.Dataset, band_mhz: FloatArray, start: pd.Timestamp, end: pd.Timestamp) -> float:
    """Largest flux density at 1 au within a band and a time, sfu; NaN where the files do not state it."""
    if "flux_sfu_1au" not in over:
        return float("nan")
    part = over["flux_sfu_1au"].sel(time=slice(start, end), frequency=slice(*(band_mhz * [1 / BAND_EDGE, BAND_EDGE])))
    return float(part.max()) if part.size and bool(np.isfinite(part).any()) else float("nan")


def onset_records(one: Candidate) -> npt.NDArray[np.intp]:
    """Minute of the onset in every channel of the grid.

    Returns
    -------
    numpy.ndarray, shape (CHANNELS,)
    """
    return np.asarray(one.record + np.rint(drift_delays_s()[one.drift] / STEP_S), dtype=np.intp)


def _utc(grid: SearchGrid, record: float) -> pd.Timestamp:
    return pd.Timestamp(grid.start) + pd.Timedelta(seconds=float(record) * STEP_S)


def _longest_run(hit: npt.NDArray[np.bool_], measured: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """The longest run of channels that see it, across holes of two channels: the others see something else."""
    channels = np.flatnonzero(measured)
    seen = np.flatnonzero(hit[channels])
    runs = np.split(seen, np.flatnonzero(np.diff(seen) > 3) + 1)
    run = np.zeros_like(hit)
    run[channels[max(runs, key=len)]] = True
    return run


def _reach(channel: int) -> int:
    """Minutes from onset to the last in which the maximum may be."""
    return int(np.ceil(3 * float(decay_s(FREQUENCY_MHZ[channel])) / STEP_S)) + 2


def _peak(excess_db: FloatArray, onset: int, channel: int) -> int:
    window = excess_db[onset : onset + _reach(channel)]
    return int(onset + np.nanargmax(np.where(np.isfinite(window), window, -np.inf)))


def why_not_alone(searched: Searched, one: Candidate) -> str:
    """Reason why a candidate is not isolated.

    Returns
    -------
    str
        "group" where others are near it or its light curves have a second peak, "gap_in_flank" where minutes around its
        rise are missing; empty if it is isolated.
    """
    for other in searched.found:
        apart_s = (other.record - one.record) * STEP_S
        near = (
            abs(other.record - one.record) > THRESHOLDS.apart_minutes
            and -THRESHOLDS.before_s < apart_s < THRESHOLDS.after_s
        )
        if near and not other.reason and other.score > THRESHOLDS.weak_share * one.score:
            return GROUP
    grid, band, onset = searched.grid, np.flatnonzero(one.hit), onset_records(one)
    if any(_has_gap(grid, int(onset[channel]), int(channel)) for channel in band[:: max(1, band.size // 8)]):
        return GAP
    twice = [_second_peak(grid, int(onset[channel]), int(channel)) for channel in band]
    # bursts minutes apart are one at low frequencies, where they last longer
    shares = [np.mean(twice), np.mean(twice[len(twice) // 2 :]), np.mean(twice[-(len(twice) // 4 + 1) :])]
    return GROUP if max(shares) > THRESHOLDS.second_peak_share else ""


def _has_gap(grid: SearchGrid, onset: int, channel: int) -> bool:
    """Whether minutes around the rise of a channel are missing, which it has otherwise."""
    around = grid.excess_db[max(0, onset - 5) : onset + 5, channel]
    listening = np.isfinite(grid.excess_db).any(axis=1)
    usual = np.isnan(grid.excess_db[listening, channel]).mean()
    return bool(np.isnan(around).mean() > 0.3 + usual)


def _second_peak(grid: SearchGrid, onset: int, channel: int) -> bool:
    """Whether the light curve of a channel falls and rises again, by more than noise, within the burst."""
    window = grid.excess_db[max(0, onset - 5) : onset + 2 * _reach(channel), channel]
    window = window[np.isfinite(window)]
    over = max(1, round(THRESHOLDS.smoothed_share_of_decay * float(decay_s(FREQUENCY_MHZ[channel])) / STEP_S))
    if window.size < over + 2:
        return False
    window = np.convolve(window, np.full(over, 1.0 / over), mode="valid")
    peak = int(window.argmax())
    least = max(
        min(THRESHOLDS.second_peak_db, THRESHOLDS.second_peak_share_of_height * window[peak]),
        4 * grid.noise_db[channel],
    )
    after, before = window[peak:], window[: peak + 1][::-1]
    return any((side - np.minimum.accumulate(side)).max() > least for side in (after, before))
