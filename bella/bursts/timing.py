"""From the spectra of one burst to its arrival times with one noise model: channels, and common frequencies.

Every channel is looked at in a window of its own around the onset that the search has found there, so that other bursts
of the day have no say. Four definitions of the edge:

``shared_profile``: from the profile that all spacecraft share (:mod:`bella.bursts.shared_profile`); ``half_rise`` takes
its place where there are fewer than three spacecraft, or it does not converge. ``half_rise``: from the rising flank
of each channel alone (:mod:`bella.bursts.flank`). ``half_maximum``: by a straight line between two samples.
``gauss_hermite``: the edge of Canizares et al. 2024 (both :mod:`bella.bursts.edges`).
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr

from bella.arrivals import SHAPE_LENGTH, check_arrivals
from bella.bursts.detection import Candidate, Searched, candidate_at, onset_records, search
from bella.bursts.edges import Edge, gauss_hermite_edge, half_maximum_edge, spacing_s
from bella.bursts.flank import SampleAveraging, flank_edges
from bella.bursts.light_curves import LightCurves, RiseOfBurst, decay_s, own_rise
from bella.bursts.matched_filter import BEAM_SPEEDS_C, FREQUENCY_MHZ, STEP_S, THRESHOLDS
from bella.bursts.noise import (
    OFFSET_S,
    SHAPE_LENGTH_LN_F,
    Timed,
    at_frequencies,
    estimate_noise,
    noise_columns,
    outliers,
    spread_channels,
)
from bella.bursts.shared_profile import Collapsed, fit_profile
from bella.exceptions import InputError, NoDataError
from bella.heliosphere.scattering import rise_s
from bella.spectra import integration_times_s, power_above_background, sample_times
from bella.spectra.assembly import cadence_s
from bella.units import FloatArray

SHARED, HALF_RISE = "shared_profile", "half_rise"
EDGES = (SHARED, HALF_RISE, "half_maximum", "gauss_hermite")
"""Definitions of the edge, as the arrival table names them; the first is the default."""

BEFORE_S, BEFORE_RISES = 300.0, 5.0
"""A window begins so long, and so many half widths of the rise, before the onset of its channel."""

AFTER_S, AFTER_DECAYS, AFTER_RISES = 240.0, 2.0, 3.0
AROUND_S = 900.0
"""How far from the time given a burst may begin."""

LOWEST_MHZ, HIGHEST_MHZ = 0.15, 2.0
"""Band in which sources are localised, as in Canizares et al. 2024, A&A 684, A182, doi:10.1051/0004-6361/202347747."""

PROFILE_MHZ = (0.1, 3.0)
"""Channels that share a profile: it changes slowly with ln f, and no source is localised above."""

FREQUENCIES = 40
MOST_ROWS = 120
"""Of a table of channels: 40 of each of three spacecraft."""

FEWEST_EDGES = 8
NARROWEST = 1.5
"""Frequencies that spacecraft share have to span this ratio for a track."""

BAND_MARGIN = 1.15
"""Channels so far beyond those that the search saw are looked at too, and all up to `HIGHEST_MHZ`."""

OUTLIER = "outlier"
DRIFT_STEPS = 8
"""Frequencies at which the arrival times of a spacecraft have to follow one another."""

Window = tuple[np.datetime64, np.datetime64]


@dataclass(frozen=True)
class TimedBurst:
    """A burst with the edges of every spacecraft.

    Attributes
    ----------
    edges : DataFrame
        One row per channel: observatory, frequency_mhz, arrival_utc (NaT without an edge), sigma_s, edge, flag,
        shape_sd_s, offset_sd_s, delay_sd_s, rise_s.
    edge : str
        Definition of the edge, which may not be the one that was asked for.
    noise : Timed
        The channels with an edge, seconds after `reference_utc`, and their noise.
    collapsed : tuple of Collapsed
        Light curves on the time axis of the shared profile; empty for other edges.
    """

    edges: pd.DataFrame
    edge: str
    noise: Timed
    reference_utc: np.datetime64
    collapsed: tuple[Collapsed, ...] = ()

    @property
    def bands_mhz(self) -> dict[str, tuple[float, float]]:
        """Lowest and highest frequency with an edge, of the spacecraft with enough edges."""
        bands = {}
        for name in dict.fromkeys(self.noise.observatory):
            frequency = self.noise.frequency_mhz[self.noise.observatory == name]
            if frequency.size >= FEWEST_EDGES:
                bands[str(name)] = (float(frequency.min()), float(frequency.max()))
        return bands


def candidate_near(searched: Searched, around_utc: np.datetime64) -> Candidate:
    """What the search shows nearest to a time: the strongest within a quarter of an hour.

    Parameters
    ----------
    around_utc : numpy.datetime64
        About the onset at high frequencies, UTC.

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


def burst_spectrum(searched: Searched, one: Candidate) -> xr.Dataset:
    """The spectrum of a burst at one spacecraft, without what does not belong to it.

    Returns
    -------
    xarray.Dataset
        Channels in the band of the burst; samples outside the window of their channel are NaN.

    Raises
    ------
    NoDataError
        If the spectrum has no channel in that band, or no record in the window.
    """
    low, high = FREQUENCY_MHZ[np.flatnonzero(one.hit)[[0, -1]]]
    part = searched.over.sel(frequency=slice(low / BAND_MARGIN, max(high, HIGHEST_MHZ) * BAND_MARGIN))
    if part.sizes["frequency"] == 0:
        raise NoDataError(f"{searched.observatory} has no channel from {low:.3g} to {high:.3g} MHz")
    frequency, start = part["frequency"].to_numpy(), searched.grid.start
    onset_s = np.interp(np.log(frequency), np.log(FREQUENCY_MHZ), onset_records(one) * STEP_S)
    begin_s = onset_s - BEFORE_S - BEFORE_RISES * rise_s(frequency)
    end_s = onset_s + AFTER_S + AFTER_DECAYS * decay_s(frequency) + AFTER_RISES * rise_s(frequency)
    record_s = (part["time"].to_numpy() - start) / np.timedelta64(1, "s")
    near = (record_s >= begin_s.min()) & (record_s <= end_s.max())
    kept, record_s = part.isel(time=np.flatnonzero(near)), record_s[near]
    if kept.sizes["time"] == 0:
        raise NoDataError(f"{part.attrs['observatory']} has no record around {start}: name the file of that day")
    inside = (record_s[:, None] >= begin_s) & (record_s[:, None] <= end_s)
    return kept.assign(intensity=kept["intensity"].where(xr.DataArray(inside, dims=("time", "frequency"))))


def spectrum_edges(spectrum: xr.Dataset, edge: str = HALF_RISE, window_utc: Window | None = None) -> pd.DataFrame:
    """Edge of every channel of a dynamic spectrum, each light curve on its own.

    Parameters
    ----------
    spectrum : xarray.Dataset
        Dynamic spectrum that holds one burst, background taken away or in decibels over it.
    edge : {"half_rise", "half_maximum", "gauss_hermite"}
    window_utc : tuple of numpy.datetime64, optional
        First and last record to look at, where the spectrum holds more than the burst.

    Returns
    -------
    pandas.DataFrame
        One row per channel, ascending in frequency: observatory, frequency_mhz, arrival_utc (NaT without an edge),
        sigma_s, edge, flag. Channels marked as interpolated are left out.

    Raises
    ------
    InputError
        If the edge is not known, or there is no record in the window.
    """
    if edge not in EDGES[1:]:
        raise InputError(f"{edge!r} is not an edge of one light curve: choose one of {', '.join(EDGES[1:])}")
    measured = _measured(spectrum, window_utc)
    start = measured["time"].to_numpy()[0].astype("datetime64[ns]")
    light = light_curves(measured, start)
    timed, flags = _alone([light], edge)
    sigma_s = np.hypot(timed.channel_sd_s, _sample_time_sd_s(measured))
    return _edge_frame(replace(timed, channel_sd_s=sigma_s), flags, edge, start)


def light_curves(spectrum: xr.Dataset, start: np.datetime64) -> LightCurves:
    """Light curves of a dynamic spectrum, in power.

    Parameters
    ----------
    spectrum : xarray.Dataset
        Background taken away or in decibels over it.
    start : numpy.datetime64
        Zero of their times.
    """
    time_s = (sample_times(spectrum).to_numpy() - start) / np.timedelta64(1, "s")
    apart = spectrum["visits_apart_s"].to_numpy() if "visits_apart_s" in spectrum else np.zeros(time_s.shape)
    return LightCurves(
        observatory=str(spectrum.attrs["observatory"]),
        frequency_mhz=spectrum["frequency"].to_numpy().astype(np.float64),
        time_s=time_s,
        power=power_above_background(spectrum).to_numpy(),
        background=0.0 if spectrum.attrs["quantity"] == "relative_flux" else 1.0,
        cadence_s=cadence_s(spectrum["time"].to_numpy()) if spectrum.sizes["time"] > 1 else 1.0,
        integration_s=integration_times_s(spectrum),
        apart_s=np.broadcast_to(np.nan_to_num(apart.astype(np.float64)), time_s.shape),
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


def _light_curve_edges(light: LightCurves, edge: str, rises: RiseOfBurst) -> list[Edge]:
    if edge == HALF_RISE:
        averaging = SampleAveraging(light.integration_s, light.apart_s)
        return flank_edges(light.time_s, light.power, light.cadence_s, light.frequency_mhz, averaging, rises=rises)
    curves = zip(light.time_s.T, light.power.T, strict=True)
    if edge == "half_maximum":
        return [
            half_maximum_edge(times, column, spacing_s(times[np.isfinite(column)], light.cadence_s))
            for times, column in curves
        ]
    return [gauss_hermite_edge(times, column) for times, column in curves]


def _edge_frame(timed: Timed, flags: npt.NDArray[np.object_], edge: str, start: np.datetime64) -> pd.DataFrame:
    """One row per channel; NaT without an arrival time."""
    return pd.DataFrame(
        {
            "observatory": timed.observatory,
            "frequency_mhz": timed.frequency_mhz,
            "arrival_utc": start + pd.to_timedelta(np.rint(timed.arrival_s * 1e9), unit="ns").to_numpy(),
            "sigma_s": timed.channel_sd_s,
            "edge": edge,
            "flag": flags,
        }
    )


def time_burst(parts: Sequence[xr.Dataset], edge: str = SHARED) -> TimedBurst:
    """Arrival times of a burst at all its spacecraft, and their noise.

    Parameters
    ----------
    parts : sequence of xarray.Dataset
        As of :func:`burst_spectrum`, one for each spacecraft.
    edge : str
        One of `EDGES`.

    Returns
    -------
    TimedBurst
        With edge "half_rise" where no profile is shared.

    Raises
    ------
    InputError
        If the edge is not known.
    NoDataError
        If no channel has an edge.
    """
    if edge not in EDGES:
        raise InputError(f"{edge!r} is not a definition of the edge: choose one of {', '.join(EDGES)}")
    measured = [_measured(part, None) for part in parts]
    measured = [part for part in measured if part.sizes["frequency"]]
    if not measured:
        raise NoDataError("no spacecraft has a channel in the band of the burst: give other files")
    if edge == SHARED:
        inside = [part.sel(frequency=slice(*PROFILE_MHZ)) for part in measured]
        try:
            return _profile_timed([part for part in inside if part.sizes["frequency"]])
        except NoDataError:
            edge = HALF_RISE
    reference = _reference(measured)
    timed, flags = _alone([light_curves(part, reference) for part in measured], edge)
    return _with_noise(_with_clock(timed, measured), flags, edge, reference, ())


def time_spectra(
    spectra: Iterable[xr.Dataset], around_utc: np.datetime64, edge: str = SHARED
) -> tuple[TimedBurst, list[str]]:
    """Find the burst around an instant in each spectrum, and time it.

    Parameters
    ----------
    spectra : iterable of xarray.Dataset
        Dynamic spectra, one of each spacecraft.
    around_utc : numpy.datetime64
        About when it begins at high frequencies.
    edge : str
        One of `EDGES`.

    Returns
    -------
    left_out : list of str
        Why some spacecraft were left out, one line each.

    Raises
    ------
    NoDataError
        If none shows a burst there.
    """
    parts, left_out = [], []
    for one in spectra:
        searched = search(one)
        try:
            parts.append(burst_spectrum(searched, candidate_near(searched, around_utc)))
        except NoDataError as error:
            left_out.append(str(error))
    if not parts:
        when = np.datetime_as_string(around_utc, "s")
        raise NoDataError(f"no spacecraft shows a burst around {when}; give another time, or other spectra")
    return time_burst(parts, edge), left_out


def _reference(parts: Sequence[xr.Dataset]) -> np.datetime64:
    earliest: np.datetime64 = min(part["time"].to_numpy()[0].astype("datetime64[s]") for part in parts)
    return np.datetime64(str(earliest), "ns")


def _profile_timed(parts: Sequence[xr.Dataset]) -> TimedBurst:
    reference = _reference(parts)
    fit = fit_profile([light_curves(part, reference) for part in parts])
    timed = Timed(
        *(fit.observatory, fit.frequency_mhz, fit.arrival_s, fit.rise_s, fit.independent_sd_s, fit.shared_s),
        *(np.zeros(fit.arrival_s.size),) * 2,
    )
    return _with_noise(_with_clock(timed, parts), fit.flag, SHARED, reference, fit.collapsed)


def _with_clock(timed: Timed, parts: Sequence[xr.Dataset]) -> Timed:
    """The same with how well clocks and the times of samples are known.

    Errors of the latter are smooth along frequency: channels near one another are visited in the same order.
    """
    return replace(
        timed,
        shape_sd_s=np.concatenate([_sample_time_sd_s(part) for part in parts]),
        offset_s=np.concatenate([np.full(part.sizes["frequency"], _offset_s(part)) for part in parts]),
    )


def _alone(lights: Sequence[LightCurves], edge: str) -> tuple[Timed, npt.NDArray[np.object_]]:
    """Edges of each light curve on its own."""
    rises = own_rise(lights)
    found = [one for light in lights for one in _light_curve_edges(light, edge, rises)]
    frequency = np.concatenate([light.frequency_mhz for light in lights])
    names = np.concatenate([np.full(light.frequency_mhz.size, light.observatory, dtype=object) for light in lights])
    timed = Timed(
        observatory=names,
        frequency_mhz=frequency,
        arrival_s=np.array([one.arrival_s for one in found], dtype=np.float64),
        rise_s=rises.rise_s(frequency),
        channel_sd_s=np.array([one.sigma_s for one in found], dtype=np.float64),
        shared_s=np.zeros((frequency.size, 0)),
        offset_s=np.zeros(frequency.size),
        shape_sd_s=np.zeros(frequency.size),
    )
    return timed, np.array([one.flag for one in found], dtype=object)


def _with_noise(
    timed: Timed, flags: npt.NDArray[np.object_], edge: str, reference: np.datetime64, collapsed: tuple[Collapsed, ...]
) -> TimedBurst:
    good = np.flatnonzero((flags == "") & np.isfinite(timed.arrival_s))
    if not good.size:
        raise NoDataError("no channel of any spacecraft has an edge: try another time, or see the flags")
    wrong = outliers(timed.take(good))
    flags = flags.copy()
    flags[good[wrong]] = OUTLIER
    kept = estimate_noise(timed.take(good[~wrong]))
    noise = pd.DataFrame({"arrival_s": kept.arrival_s, **noise_columns(kept)}, index=good[~wrong])
    noise = noise.reindex(range(flags.size))
    edges = _edge_frame(replace(timed, arrival_s=noise.pop("arrival_s").to_numpy()), flags, edge, reference)
    edges = edges.assign(**{str(name): values for name, values in noise.items()})
    return TimedBurst(edges, edge, kept, reference, collapsed)


def _offset_s(spectrum: xr.Dataset) -> float:
    return math.hypot(OFFSET_S, float(spectrum.attrs.get("time_uncertainty_s", 0.0)))


def shared_frequencies_mhz(timed: TimedBurst, number: int = FREQUENCIES) -> FloatArray:
    """Frequencies at which at least three spacecraft, or all there are, have arrival times.

    Returns
    -------
    numpy.ndarray, shape (number,)
        MHz, evenly spaced in ln f between `LOWEST_MHZ` and `HIGHEST_MHZ`; empty where they share too narrow a band.
    """
    bands = list(timed.bands_mhz.values())
    needed = min(THRESHOLDS.spacecraft, len(bands))
    if not needed:
        return np.empty(0)
    low = max(sorted(band[0] for band in bands)[needed - 1], LOWEST_MHZ)
    high = min(sorted((band[1] for band in bands), reverse=True)[needed - 1], HIGHEST_MHZ)
    return np.geomspace(low, high, number) if high >= NARROWEST * low else np.empty(0)


def arrivals_at(timed: TimedBurst, frequency_mhz: FloatArray) -> Timed:
    """Arrival times at common frequencies, of the spacecraft with enough edges.

    Parameters
    ----------
    frequency_mhz : numpy.ndarray, shape (F,)
        A spacecraft has rows for those within its own band.

    Raises
    ------
    InputError
        If there is no frequency, or no spacecraft with enough edges.
    """
    enough = np.isin(timed.noise.observatory.astype(str), list(timed.bands_mhz))
    if not enough.any() or not np.size(frequency_mhz):
        why = "no spacecraft has enough edges in common frequencies"
        raise InputError(f"{why}: widen the band or the time, or take channels (--per-channel)")
    return at_frequencies(timed.noise.take(np.flatnonzero(enough)), np.asarray(frequency_mhz, dtype=np.float64))


def arrivals_of(timed: TimedBurst, number: int = FREQUENCIES) -> Timed:
    """Arrival times at frequencies that the spacecraft share; of one spacecraft with few edges those of its channels.

    Parameters
    ----------
    number : int
        Of frequencies.

    Raises
    ------
    NoDataError
        If there is one spacecraft and none of its channels has an edge without a flag.
    """
    shared_mhz = shared_frequencies_mhz(timed, number)
    names = list(dict.fromkeys(timed.edges["observatory"]))
    if len(names) > 1 or (timed.bands_mhz and shared_mhz.size):
        return arrivals_at(timed, shared_mhz)
    if not timed.noise.frequency_mhz.size:
        raise NoDataError(f"no channel of {names[0]} has an edge without a flag: give another time, or another edge")
    return timed.noise


def channels_in_band(timed: TimedBurst, most: int = MOST_ROWS) -> Timed:
    """Channels in the band in which sources are localised, evenly spread in ln f.

    Parameters
    ----------
    most : int
        Rows there may be; each spacecraft keeps an equal share of them.

    Raises
    ------
    InputError
        If no channel is there.
    """
    enough = np.isin(timed.noise.observatory.astype(str), list(timed.bands_mhz))
    inside = enough & (timed.noise.frequency_mhz >= LOWEST_MHZ) & (timed.noise.frequency_mhz <= HIGHEST_MHZ)
    if not inside.any():
        raise InputError("no spacecraft has enough edges for a table of channels: widen the band or the time")
    band = timed.noise.take(np.flatnonzero(inside))
    return band.take(spread_channels(band, most // len(set(band.observatory))))


def arrival_frame(timed: TimedBurst, rows: Timed) -> pd.DataFrame:
    """Arrival table of arrival times.

    Parameters
    ----------
    rows : Timed
        Of it, as :func:`arrivals_at` or :func:`channels_in_band` return them.

    Returns
    -------
    pandas.DataFrame
        As :func:`bella.arrivals.check_arrivals` returns it; its covariance is ``rows.covariance_s2()``.
    """
    frame = pd.DataFrame(
        {
            "observatory": rows.observatory,
            "frequency_mhz": rows.frequency_mhz,
            "arrival_utc": timed.reference_utc + np.rint(rows.arrival_s * 1e9).astype("timedelta64[ns]"),
            "edge": timed.edge,
            **noise_columns(rows),
        }
    )
    frame.attrs[SHAPE_LENGTH] = SHAPE_LENGTH_LN_F
    return check_arrivals(frame, source="edges of the channels", received_by=1)


def arrival_table(timed: TimedBurst, frequency_mhz: FloatArray) -> pd.DataFrame:
    """Arrival table at common frequencies: :func:`arrival_frame` of :func:`arrivals_at`."""
    return arrival_frame(timed, arrivals_at(timed, frequency_mhz))


def channel_arrivals(timed: TimedBurst, most: int = MOST_ROWS) -> pd.DataFrame:
    """Arrival table of the channels themselves: :func:`arrival_frame` of :func:`channels_in_band`."""
    return arrival_frame(timed, channels_in_band(timed, most))


def why_not_timed(timed: TimedBurst, needed: Sequence[str]) -> str:
    """Why the edges of a burst do not place it; empty if they do.

    Parameters
    ----------
    needed : sequence of str
        Spacecraft that were to be timed.
    """
    bands = timed.bands_mhz
    if len(bands) < min(THRESHOLDS.spacecraft, len(needed)):
        without = [name for name in needed if name not in bands]
        return f"not localisable: fewer than {FEWEST_EDGES} good edges at {', '.join(without)}"
    frequency_mhz = shared_frequencies_mhz(timed, DRIFT_STEPS)
    if not frequency_mhz.size:
        return f"not localisable: edges share no band from {LOWEST_MHZ:g} to {HIGHEST_MHZ:g} MHz"
    along = arrivals_at(timed, frequency_mhz)
    for name in bands:
        if not (np.diff(along.arrival_s[along.observatory == name]) < 0).all():
            return f"not localisable: edges at {name} do not drift downwards"
    return ""
