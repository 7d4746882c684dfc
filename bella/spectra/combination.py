"""Joining spectra of one spacecraft: receivers side by side, days one after the other."""

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from bella.exceptions import BellaError, InputError
from bella.records import Origin
from bella.spectra.assembly import cadence_s, nearest_records
from bella.spectra.dynamic_spectrum import POSITION, integration_times_s, label, sample_times, validate_spectrum
from bella.spectra.positions import join_positions

INTEGRATION = "channel_integration_s"

EPOCH = np.datetime64("1970-01-01", "ns")
LONGEST_GAP, LONGEST_PIECE = np.timedelta64(1, "D"), np.timedelta64(28, "D")
"""A search has minutes, with or without records: it is cut at longer gaps, and never of more than four weeks."""

LEFT_OUT = {("WIND", "TNR")}
"""Receivers that look at the plasma around the spacecraft, below the band of bursts far from it."""

LEAST_REAL = (Origin.SIMULATED, Origin.TEST, Origin.USER, Origin.SUBMISSION, Origin.EVENT, Origin.ARCHIVE)
"""What is made of several counts as the first of these that any of them is."""


def combine_receivers(first: xr.Dataset, second: xr.Dataset) -> xr.Dataset:
    """Spectra of two receivers of one spacecraft as one, without inventing a sample.

    Channels: where the bands overlap, the receiver with more measured channels there keeps them and the other's are
    dropped; with as many, the upper receiver keeps them. Records: the receiver with more of them gives the time axis.
    A record of the other joins the nearest one within half the median step, each at most one; what finds none becomes
    a record of its own. Samples keep their times: unless both have the same time axis and none of their own, the
    result has ``sample_time``. Positions of the spacecraft are kept, and so are integration times: where the receivers
    differ, in ``channel_integration_s``.

    Parameters
    ----------
    first, second : xarray.Dataset
        Dynamic spectra of one observatory and quantity, in any order.

    Returns
    -------
    xarray.Dataset
        A dynamic spectrum with the channels of both.

    Raises
    ------
    InputError
        If they are of different observatories or quantities.
    """
    _same(first, second, ("observatory", "quantity"))
    both = sorted(_stated(first, second), key=lambda one: (float(one["frequency"][0]), float(one["frequency"][-1])))
    low, high = _part_bands(*(one.drop_vars(POSITION, errors="ignore") for one in both))
    if low.sizes["time"] == high.sizes["time"] and (low["time"].to_numpy() == high["time"].to_numpy()).all():
        parts = _with_same_variables([low, high])
    else:
        parts = _with_same_variables(_on_one_axis(low, high))
    joined = xr.concat(parts, "frequency", join="exact", combine_attrs="drop")
    if not joined.indexes["frequency"].is_monotonic_increasing:
        joined = joined.sortby("frequency")
    return _finish(joined, both, f"{low.attrs['receiver']}+{high.attrs['receiver']}")


def join_days(spectra: Sequence[xr.Dataset]) -> xr.Dataset:
    """Spectra of one receiver that follow one another as one: files that end before or after midnight, or overlap.

    A record that two files hold is kept once: that with most data, of equal ones that of the file given first. Channels
    that a file lacks are NaN there.
    What is relative to the background of a day (``voltage_ratio``, ``db_over_background``) stays relative to that of
    its own day, and may step at midnight. Positions of the spacecraft are kept.

    Parameters
    ----------
    spectra : sequence of xarray.Dataset
        Dynamic spectra of one observatory, receiver and quantity, in any order.

    Returns
    -------
    xarray.Dataset
        A dynamic spectrum.

    Raises
    ------
    InputError
        If there are none, or of different observatories, receivers or quantities.
    """
    if not spectra:
        raise InputError("there are no spectra to join: name at least one file")
    for other in spectra[1:]:
        _same(spectra[0], other, ("observatory", "receiver", "quantity"))
    flags = _interpolated(spectra)
    parts = _with_same_variables([one.drop_vars(["interpolated", POSITION], errors="ignore") for one in spectra])
    if "sample_offset_s" in parts[0] and not all(_equal_offsets(parts[0], part) for part in parts[1:]):
        parts = [part.assign(sample_time=sample_times(part)).drop_vars("sample_offset_s") for part in parts]
    joined = xr.concat(
        parts, "time", join="outer", data_vars="minimal", coords="minimal", compat="override", combine_attrs="drop"
    )
    joined = joined.isel(time=_fullest_records(joined)).assign(flags)
    if "sample_time" in joined:
        joined = joined.assign(sample_time=joined["sample_time"].fillna(joined["time"]))
    return _finish(joined, list(spectra), str(spectra[0].attrs["receiver"]))


def by_observatory(spectra: Iterable[xr.Dataset]) -> dict[str, xr.Dataset]:
    """Join days and combine receivers of every spacecraft.

    Where there are several products of a spacecraft (of different quantities, which cannot be combined), the one of the
    finest cadence is taken; of equal ones, that with more channels.

    Parameters
    ----------
    spectra : iterable of xarray.Dataset
        Dynamic spectra of any spacecraft, receivers and days.

    Returns
    -------
    dict of str to xarray.Dataset
        By observatory, in the order in which they come first.

    Raises
    ------
    InputError
        If there are none.
    """
    products: dict[tuple[str, str], dict[str, list[xr.Dataset]]] = {}
    for spectrum in spectra:
        name, receiver = str(spectrum.attrs["observatory"]), str(spectrum.attrs["receiver"])
        if (name, receiver) not in LEFT_OUT:
            receivers = products.setdefault((name, str(spectrum.attrs["quantity"])), {})
            receivers.setdefault(receiver, []).append(spectrum)
    if not products:
        raise InputError("there are no spectra of radio bursts: name files of at least one receiver")
    combined = [
        (
            name,
            reduce(combine_receivers, [join_days(days) if len(days) > 1 else days[0] for days in receivers.values()]),
        )
        for (name, _), receivers in products.items()
    ]
    best: dict[str, xr.Dataset] = {}
    for name, spectrum in combined:
        if name not in best or _rank(spectrum) < _rank(best[name]):
            best[name] = spectrum
    return best


def by_observatory_of_what_fits(spectra: Sequence[xr.Dataset]) -> tuple[dict[str, xr.Dataset], tuple[str, ...]]:
    """As :func:`by_observatory`, without the spectra that cannot be joined with those before them.

    Parameters
    ----------
    spectra : sequence of xarray.Dataset
        Dynamic spectra of any spacecraft, receivers and days.

    Returns
    -------
    spectra : dict of str to xarray.Dataset
        By observatory; empty where none is left.
    left_out : tuple of str
        Files that are left out, each with its reason.
    """
    joined: dict[str, xr.Dataset] = {}
    left_out = []
    wanted = [one for one in spectra if (one.attrs["observatory"], one.attrs["receiver"]) not in LEFT_OUT]
    for name in dict.fromkeys(str(one.attrs["observatory"]) for one in wanted):
        own = [one for one in wanted if one.attrs["observatory"] == name]
        try:
            joined |= by_observatory(own)
        except BellaError:
            kept: list[xr.Dataset] = []
            for one in own:
                try:
                    joined |= by_observatory([*kept, one])
                    kept.append(one)
                except BellaError as error:
                    left_out.append(f"{_files(one)}: {error}")
    return joined, tuple(left_out)


@dataclass(frozen=True)
class FleetPiece:
    """Spectra of a fleet that belong together in time."""

    spectra: dict[str, xr.Dataset]
    """By observatory, days joined and receivers combined."""

    @property
    def first(self) -> np.datetime64:
        """Of all records."""
        return np.datetime64(min(one["time"].to_numpy()[0] for one in self.spectra.values()))

    @property
    def last(self) -> np.datetime64:
        """Of all records."""
        return np.datetime64(max(one["time"].to_numpy()[-1] for one in self.spectra.values()))

    def apart_s(self, utc: np.datetime64) -> float:
        """How far an instant is from its records, s; 0 between them."""
        return float(max(self.first - utc, utc - self.last, np.timedelta64(0, "s")) / np.timedelta64(1, "s"))


def fleet_pieces(spectra: Sequence[xr.Dataset]) -> tuple[list[FleetPiece], tuple[str, ...]]:
    """As :func:`by_observatory_of_what_fits`, cut where no spacecraft has a record for more than a day.

    Files years apart thus take no more memory than their records; each piece has the product that is best in it.
    Nothing is longer than `LONGEST_PIECE`: what goes on is cut at midnight.

    Parameters
    ----------
    spectra : sequence of xarray.Dataset
        Dynamic spectra of any spacecraft, receivers and days.

    Returns
    -------
    pieces : list of FleetPiece
        In order of time.
    left_out : tuple of str
        Files that cannot be joined, and single records far from all others, each with its reason.

    Raises
    ------
    InputError
        If there are no spectra of radio bursts.
    """
    wanted = [one for one in spectra if (one.attrs["observatory"], one.attrs["receiver"]) not in LEFT_OUT]
    if not wanted:
        raise InputError("there are no spectra of radio bursts: name files of at least one receiver")
    parts = sorted((part for one in wanted for part in _cut(one)), key=lambda one: one["time"].to_numpy()[0])
    pieces, left_out = [], []
    for group in _groups_of(parts):
        alone = [one for one in group if one.sizes["time"] < 2]
        left_out += [f"{_files(one)}: a single record of {str(one['time'].to_numpy()[0])[:19]}" for one in alone]
        joined, unfit = by_observatory_of_what_fits([one for one in group if one.sizes["time"] > 1])
        left_out += unfit
        if joined:
            pieces.append(FleetPiece(joined))
    if not pieces:
        raise InputError(f"nothing is left to search: {left_out[0]}, far from all others")
    return pieces, tuple(dict.fromkeys(left_out))


def _cut(spectrum: xr.Dataset) -> list[xr.Dataset]:
    """Parts of a spectrum between its long gaps, and from one turn of `LONGEST_PIECE` to the next."""
    time = spectrum["time"].to_numpy()
    turn = (time - EPOCH) // LONGEST_PIECE
    starts = np.flatnonzero((np.diff(time) > LONGEST_GAP) | (np.diff(turn) > 0)) + 1
    if not starts.size:
        return [spectrum]
    return [spectrum.isel(time=slice(*ends)) for ends in itertools.pairwise([0, *starts.tolist(), time.size])]


def _groups_of(parts: Sequence[xr.Dataset]) -> list[list[xr.Dataset]]:
    """Parts, in order of time, that no long gap and no turn of `LONGEST_PIECE` divides."""
    groups: list[list[xr.Dataset]] = []
    end, turn = EPOCH, -1
    for part in parts:
        first, last = part["time"].to_numpy()[[0, -1]]
        its_turn = int((first - EPOCH) // LONGEST_PIECE)
        if not groups or first - end > LONGEST_GAP or its_turn != turn:
            groups.append([])
            end = last
        groups[-1].append(part)
        end, turn = max(end, last), its_turn
    return groups


def _files(spectrum: xr.Dataset) -> str:
    return ", ".join(str(name) for name in np.atleast_1d(spectrum.attrs["source_files"]))


def _rank(spectrum: xr.Dataset) -> tuple[float, int]:
    return round(cadence_s(spectrum["time"].to_numpy()), 1), -spectrum.sizes["frequency"]


def _fullest_records(joined: xr.Dataset) -> npt.NDArray[np.intp]:
    """Indices of records in order of time; of those at one instant that with most data, of equal ones the first."""
    time = joined["time"].to_numpy()
    if np.unique(time).size == time.size:
        return np.argsort(time, kind="stable")
    count = np.isfinite(joined["intensity"].transpose("time", "frequency").to_numpy()).sum(axis=1)
    order = np.lexsort((-count, time))
    return np.asarray(order[np.concatenate([[True], np.diff(time[order]) > np.timedelta64(0)])], dtype=np.intp)


def _same(first: xr.Dataset, second: xr.Dataset, names: tuple[str, ...]) -> None:
    for name in names:
        if first.attrs[name] != second.attrs[name]:
            raise InputError(f"spectra of {name} {first.attrs[name]} and {second.attrs[name]} cannot be joined")


def _stated(*parts: xr.Dataset) -> list[xr.Dataset]:
    """With the integration time of every channel, where it is not one for all."""
    times_s = {float(one.attrs["integration_s"]) for one in parts}
    if len(times_s) == 1 and not any(INTEGRATION in one for one in parts):
        return list(parts)
    return [one.assign({INTEGRATION: ("frequency", integration_times_s(one))}) for one in parts]


def _part_bands(low: xr.Dataset, high: xr.Dataset) -> tuple[xr.Dataset, xr.Dataset]:
    """The two without the channels that one of them loses to the other in the overlap."""
    begin, end = float(high["frequency"][0]), float(low["frequency"][-1])
    if _measured(low, begin, end) > _measured(high, begin, end):
        return low, _without(high, float(low["frequency"][0]), end)
    return _without(low, begin, float(high["frequency"][-1])), high


def _without(spectrum: xr.Dataset, begin_mhz: float, end_mhz: float) -> xr.Dataset:
    """Channels outside a band; nothing is copied if they are on one side of it."""
    channels = spectrum["frequency"].to_numpy()
    kept = np.flatnonzero((channels < begin_mhz) | (channels > end_mhz))
    if kept.size and kept[-1] - kept[0] + 1 == kept.size:
        return spectrum.isel(frequency=slice(int(kept[0]), int(kept[-1]) + 1))
    return spectrum.isel(frequency=kept)


def _measured(spectrum: xr.Dataset, begin_mhz: float, end_mhz: float) -> int:
    inside = (spectrum["frequency"] >= begin_mhz) & (spectrum["frequency"] <= end_mhz)
    if "interpolated" in spectrum:
        inside = inside & ~spectrum["interpolated"].astype(bool)
    return int(inside.sum())


def _on_one_axis(low: xr.Dataset, high: xr.Dataset) -> list[xr.Dataset]:
    low, high = (
        one.assign(sample_time=sample_times(one)).drop_vars("sample_offset_s", errors="ignore") for one in (low, high)
    )
    leader, follower = (low, high) if low.sizes["time"] >= high.sizes["time"] else (high, low)
    leading = leader["time"].to_numpy()
    partner = nearest_records(leading, follower["time"].to_numpy(), cadence_s(leading) / 2.0)
    alone = follower["time"].to_numpy()[partner < 0]
    axis = np.union1d(leader["time"].to_numpy(), alone)
    leading = leading[np.maximum(partner, 0)]
    moved = follower.assign_coords(time=np.where(partner < 0, follower["time"].to_numpy(), leading))
    parts = [one.reindex(time=axis) for one in (leader, moved)]
    return [one.assign(sample_time=one["sample_time"].fillna(one["time"])) for one in parts]


def _with_same_variables(parts: list[xr.Dataset]) -> list[xr.Dataset]:
    """Give each part the variables of the others, with values that say nothing."""
    if any("sample_time" in part for part in parts):
        parts = [
            part.assign(sample_time=sample_times(part)).drop_vars("sample_offset_s", errors="ignore") for part in parts
        ]
    names = {str(name): part[name].dims for part in parts for name in part.data_vars}
    return [
        part.assign({name: _nothing(part, name, dims) for name, dims in names.items() if name not in part})
        for part in parts
    ]


def _nothing(part: xr.Dataset, name: str, dims: tuple[Any, ...]) -> xr.DataArray:
    known = {"interpolated": False, "sample_offset_s": 0.0, "visits_apart_s": np.uint8(0)}
    neutral = known.get(name, np.float32(np.nan))
    shape = tuple(part.sizes[dim] for dim in dims)
    return xr.DataArray(np.full(shape, neutral), dims=dims, coords={dim: part[dim] for dim in dims})


def _equal_offsets(first: xr.Dataset, second: xr.Dataset) -> bool:
    return bool(first["sample_offset_s"].equals(second["sample_offset_s"]))


def _interpolated(spectra: Sequence[xr.Dataset]) -> dict[str, xr.DataArray]:
    """Channels that no file measured."""
    if not any("interpolated" in one for one in spectra):
        return {}
    flags = [
        one["interpolated"] if "interpolated" in one else _nothing(one, "interpolated", ("frequency",))
        for one in spectra
    ]
    frequency = np.unique(np.concatenate([flag["frequency"].to_numpy() for flag in flags]))
    measured = [~flag.reindex(frequency=frequency, fill_value=True).astype(bool) for flag in flags]
    return {"interpolated": ~xr.concat(measured, "file", join="exact").any("file")}


def _gathered(parts: list[xr.Dataset]) -> dict[str, str]:
    """Origin, quirks and variables left out, of all parts."""
    origins = {str(part.attrs["origin"]) for part in parts if "origin" in part.attrs}
    found = {"origin": next(one.value for one in LEAST_REAL if one in origins)} if origins else {}
    for name in ("quirks", "left_out"):
        held = [one for part in parts for one in str(part.attrs.get(name, "")).split(";") if one]
        if held:
            found[name] = ";".join(dict.fromkeys(held))
    return found


def _finish(joined: xr.Dataset, parts: list[xr.Dataset], receiver: str) -> xr.Dataset:
    sources = [str(name) for part in parts for name in np.atleast_1d(part.attrs["source_files"])]
    joined["intensity"] = joined["intensity"].astype(np.float32, copy=False)
    joined.attrs = {
        **parts[0].attrs,
        **_gathered(parts),
        "receiver": receiver,
        "integration_s": max(float(part.attrs["integration_s"]) for part in parts),
        "source_files": list(dict.fromkeys(sources)),
    }
    placed = join_positions(joined.transpose("time", "frequency"), parts)
    return label(validate_spectrum(placed, ", ".join(sources)))
