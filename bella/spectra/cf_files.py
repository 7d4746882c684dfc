"""Dynamic spectra of any instrument: netCDF and Zarr, and those of the built-in event.

Files are opened only once it is known that they can be read and how large they are.
"""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from bella.containers import INFLATED_BYTES, MHZ, check_hdf5, reading, zarr_groups
from bella.exceptions import InputError, require_extra
from bella.records import Origin
from bella.spacecraft import observatory_name
from bella.spectra.assembly import ascending, cadence_s, dates_in, shared_channels
from bella.spectra.beside import FLAGS, LONGEST_SWEEP_S, SECONDS, SFU, flag_words, interpolated_where
from bella.spectra.dynamic_spectrum import (
    ATTRIBUTES,
    OPTIONAL_DIMENSIONS,
    POSITION,
    QUANTITIES,
    in_unit,
    unit_of_another,
    validate_spectrum,
    without_fill,
    without_intensity,
)
from bella.spectra.positions import KILOMETRES

FORM = ("time", "frequency")
OTHER_NAMES = {
    **dict.fromkeys(("times", "epoch", "utc", "datetime", "time_(utc)", "time_utc"), "time"),
    **dict.fromkeys(("frequencies", "freq", "freqs", "frequency_mhz", "frequency_(mhz)", "channel"), "frequency"),
}
HIGHEST_MHZ = 1000.0
"""Frequencies above are in another unit, where they state none or kHz: a reader of Mars Express calls its hertz so."""

LOWEST_MHZ, IMPOSSIBLE_MHZ = 1e-3, 1e6
"""The highest channel of no receiver is below the one or above the other."""

FIRST, LAST = np.datetime64("1950-01-01", "ns"), np.datetime64("2060-01-01", "ns")
DAY = np.timedelta64(1, "D")
OTHER_CLOCK = re.compile(r"(TAI|TT|TDT|TDB|TCB|TCG|ET|GPS)\b", re.IGNORECASE)
"""Scales of time that are not UTC, as attributes state them."""

SCALE_OF_TIME = {"scale", "time_scale", "timescale", "time_system", "timesys", "time_standard"}
WORST_ROUNDING = 0.1
"""Times are stored too coarsely where they are rounded to this share of the step between records."""

NO_POSITION_KM = 1e15
NAMED = "bella_named"
"""Attribute of a flag: its name in the file, which may say that it is of what was not interpolated."""

LEAP_SECOND = re.compile(r"^(.{10}.\d\d:\d\d:)60")
"""Of text; datetime64 has none, so it is the first of the next day."""

EVENT = "event_2012-06-07.nc"


def open_cf(path: Path, engine: str) -> tuple[xr.Dataset, ...]:
    """Every dynamic spectrum of a netCDF file or Zarr store.

    Parameters
    ----------
    path : pathlib.Path
        File or store.
    engine : str
        h5netcdf, scipy or zarr.

    Returns
    -------
    tuple of xarray.Dataset
        In memory, one for each group that has a variable ``intensity``.

    Raises
    ------
    InputError
        If it is damaged, too large, or holds no dynamic spectrum.
    """
    with reading(str(path), "netCDF or Zarr"):
        if engine == "h5netcdf":
            check_hdf5(path)
        elif engine == "zarr":
            require_extra("zarr")
        with _decoding_times(path), _groups(path, engine) as groups:
            chosen = {
                name: group for name, group in groups.items() if "intensity" in {_plain(one) for one in group.variables}
            }
            if not chosen:
                raise InputError(f"{path} is not a dynamic spectrum: {without_intensity(next(iter(groups.values())))}")
            if _claimed_bytes(list(chosen.values())) > INFLATED_BYTES:
                raise InputError(f"{path} holds more than {INFLATED_BYTES >> 20} MiB: divide it into days")
            return tuple(as_spectrum(group, f"{path}{name}", path.name) for name, group in chosen.items())


@contextmanager
def _decoding_times(path: Path) -> Iterator[None]:
    """Say what to do about times that are not in UTC."""
    try:
        yield
    except ValueError as error:
        found = re.search(r"decode time units '(.*?)' with [\"']?(.*?calendar(?: '\w+')?)", str(error))
        if found is None:
            raise
        raise InputError(
            f"{path}: its times are in {found[1]!r} of {found[2]}: write UTC, such as seconds since 1970-01-01 in the "
            "standard calendar"
        ) from error


@contextmanager
def _groups(path: Path, engine: str) -> Iterator[dict[str, xr.Dataset]]:
    """Groups by their path, the root as an empty one; nothing is loaded yet."""
    if engine == "scipy":  # netCDF 3 has no groups
        with xr.open_dataset(path, engine="scipy") as only:
            yield {"": only}
        return
    if engine == "zarr":
        yield zarr_groups(path)
        return
    with xr.open_datatree(path, engine=engine) as tree:
        yield {node.path.rstrip("/"): node.to_dataset(inherit=False) for node in tree.subtree}


def _claimed_bytes(groups: Sequence[xr.Dataset]) -> int:
    """What all groups take together, or the largest chunk of any of their variables if that takes more."""
    variables = [variable for group in groups for variable in group.variables.values()]
    return max(sum(group.nbytes for group in groups), *(_chunk_bytes(variable) for variable in variables))


def _chunk_bytes(variable: xr.Variable) -> int:
    stored = [variable.encoding.get(name) for name in ("chunks", "shards", "chunksizes")]
    return int(variable.dtype.itemsize) * max(math.prod(int(size) for size in sizes or ()) for sizes in stored)


def as_spectrum(stored: xr.Dataset | xr.DataArray, source: str, file_name: str = "") -> xr.Dataset:
    """A dynamic spectrum from a dataset that means one: ordered, in our names and units, with what can be filled in.

    Names of variables may differ in case and blanks; axes may be transposed, descending, repeated or of other names;
    times may be text, with an offset from UTC; frequencies may be in any unit that they
    state, and others in every record.

    Parameters
    ----------
    stored : xarray.Dataset or xarray.DataArray
        In memory or not; an array is the intensity.
    source : str
        Where it comes from, named in errors.
    file_name : str
        Name of its file, which may state days.

    Returns
    -------
    xarray.Dataset

    Raises
    ------
    InputError
        If it is no dynamic spectrum; the message says what to change.
    """
    if isinstance(stored, xr.DataArray):
        stored = stored.to_dataset(name="intensity").assign_attrs(stored.attrs)
    named = _in_our_names(stored.load())
    _check_clock(named, source)
    spectrum = _with_axes(_on_one_list(named, source))
    given = spectrum.attrs
    if not isinstance(given.get("observatory", ""), str):
        raise InputError(
            f"{source}: attribute 'observatory' is {given['observatory']!r}: give the name of one spacecraft"
        )
    if str(given.get("observatory", "")).strip():
        try:
            given["observatory"] = observatory_name(str(given["observatory"]))
        except InputError as error:
            raise InputError(f"{source}: {error}") from error
        if set(given["observatory"]) & set("/\\\0\n\t"):
            raise InputError(f"{source}: attribute 'observatory' is {given['observatory']!r}: give a plain name")
    given.setdefault("source_files", [file_name or source])
    given.setdefault("origin", Origin.USER.value)
    if given["origin"] not in set(Origin):
        raise InputError(f"{source}: attribute 'origin' is {given['origin']!r}: use user, or leave it out")
    has_axes = all(axis in spectrum.variables and spectrum[axis].dims == (axis,) for axis in FORM)
    if has_axes and "intensity" in spectrum.variables:
        spectrum = _in_our_units(spectrum, source)
        _check_age(spectrum["time"].to_numpy(), source, file_name)
        spectrum = _ordered(spectrum)
    time: npt.NDArray[Any] = spectrum["time"].to_numpy().ravel() if "time" in spectrum.variables else np.empty(0)
    # what has no times is refused for that, and not for what follows from them
    spectrum.attrs.setdefault("integration_s", cadence_s(time) if time.dtype.kind == "M" else 1.0)
    return validate_spectrum(_with_flags(spectrum), source)


def _plain(name: object) -> str:
    return re.sub(r"[\s_-]+", "_", str(name).strip().lower())


def _in_our_names(stored: xr.Dataset) -> xr.Dataset:
    """Variables, dimensions and attributes by the names of the form."""
    ours = {**{name: name for name in (*FORM, "intensity", *OPTIONAL_DIMENSIONS, "axis")}, **OTHER_NAMES}
    renamed: dict[Any, str] = {}
    for name in (*stored.variables, *stored.dims):
        wanted = ours.get(_plain(name)) or ("interpolated" if FLAGS.search(str(name).upper()) else None)
        is_free = wanted not in {*stored.variables, *stored.dims, *renamed.values()}
        if wanted and is_free and name not in renamed:
            renamed[name] = wanted
    spectrum = stored.rename(renamed)
    for name in (name for name, ours in renamed.items() if ours == "interpolated" and ours in spectrum.variables):
        spectrum["interpolated"].attrs[NAMED] = str(name)
    spectrum.attrs = {
        (_plain(name) if _plain(name) in (*ATTRIBUTES, "origin", "power_exponent") else name): _single(value)
        for name, value in stored.attrs.items()
    }
    for variable in spectrum.variables.values():
        for name in [one for one in variable.attrs if _plain(one) in {"unit", "units"}]:
            variable.attrs.setdefault("units", _single(variable.attrs[name]))
    if "quantity" in spectrum.attrs:
        spectrum.attrs["quantity"] = _plain(spectrum.attrs["quantity"])
    return spectrum


def _check_clock(spectrum: xr.Dataset, source: str) -> None:
    """Refuse times that are not in UTC, or that rounding has merged."""
    if "time" not in spectrum.variables:
        return
    time = spectrum["time"]
    for name, value in (*spectrum.attrs.items(), *time.attrs.items()):
        if _plain(name) in SCALE_OF_TIME and OTHER_CLOCK.match(str(value).strip()):
            raise InputError(f"{source}: its times are in {str(value).strip()}: convert them to UTC, and say so")
    if time.dtype.kind != "M" or np.dtype(time.encoding.get("dtype", "f8")) != np.float32 or time.size < 2:
        return
    ends = np.array([time.to_numpy().min(), time.to_numpy().max()])
    how = {name: time.encoding[name] for name in ("units", "calendar") if name in time.encoding}
    stored = xr.conventions.encode_cf_variable(xr.Variable("time", ends, encoding={**how, "dtype": "f8"})).values
    if not np.isfinite(stored).all() or stored[0] == stored[1]:
        return
    unit_s = float((ends[1] - ends[0]) / np.timedelta64(1, "s")) / (stored[1] - stored[0])
    rounded_s = float(np.spacing(np.float32(np.abs(stored).max()))) * unit_s
    if rounded_s > WORST_ROUNDING * cadence_s(time.to_numpy().ravel()):
        raise InputError(f"{source}: its times are float32 and so rounded to {rounded_s:.3g} s: store them as float64")


def _single(value: Any) -> Any:
    """An attribute as text or number, where it is bytes or an array of one."""
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    return _single(value.item()) if isinstance(value, np.ndarray | np.generic) and np.size(value) == 1 else value


def _on_one_list(spectrum: xr.Dataset, source: str) -> xr.Dataset:
    """With one list of frequencies, where every record has its own."""
    stated = spectrum.variables.get("frequency")
    if stated is None or stated.ndim != 2 or "time" not in stated.dims:
        return spectrum
    stated = stated.transpose("time", ...)
    on_list: dict[Any, Any] = {}
    for name, variable in spectrum.data_vars.items():
        if set(variable.dims) == set(stated.dims):
            values = variable.transpose(*stated.dims).to_numpy()
            values = values if values.dtype.kind in "fM" else values.astype(np.float32)
            frequency, values = shared_channels(stated.to_numpy(), values, source)
            on_list |= {name: (FORM, values, variable.attrs), "frequency": ("frequency", frequency, stated.attrs)}
    return spectrum.drop_dims([stated.dims[1]]).assign(on_list).set_coords("frequency") if on_list else spectrum


def _with_axes(spectrum: xr.Dataset) -> xr.Dataset:
    """With time and frequency as axes, in that order, and none of length 1 beside them."""
    for axis in ("time", "frequency"):
        if axis in spectrum.variables and spectrum[axis].ndim == 1:
            (along,) = spectrum[axis].dims
            spectrum = spectrum.set_coords(axis)
            if along != axis and axis not in spectrum.dims:
                spectrum = spectrum.swap_dims({along: axis})
    if "intensity" not in spectrum.variables:
        return spectrum
    surplus = [dim for dim in spectrum["intensity"].dims if dim not in FORM and spectrum.sizes[dim] == 1]
    spectrum = spectrum.squeeze(surplus, drop=True)
    expected = {"intensity": ("time", "frequency"), **OPTIONAL_DIMENSIONS}
    turned = {
        name: spectrum[name].transpose(*dims)
        for name, dims in expected.items()
        if name in spectrum.variables and spectrum[name].dims != dims and set(spectrum[name].dims) == set(dims)
    }
    return spectrum.assign(turned)


def _in_our_units(spectrum: xr.Dataset, source: str) -> xr.Dataset:
    """Times in UTC, frequencies in MHz, intensity as float32 without fill values, positions in km."""
    time, frequency = spectrum["time"], spectrum["frequency"]
    if time.dtype.kind in "OSUT":
        times = [_instant(one, source) for one in time.to_numpy().ravel()]
        spectrum = spectrum.assign_coords(time=(time.dims, np.array(times, dtype="datetime64[ns]").reshape(time.shape)))
    elif time.dtype.kind == "M":
        spectrum = spectrum.assign_coords(time=time.astype("datetime64[ns]"))
    if frequency.dtype.kind in "iuf":
        spectrum = spectrum.assign_coords(frequency=_in_mhz(frequency, source))
    if spectrum["intensity"].dtype.kind in "iuf":
        spectrum = spectrum.assign(intensity=_intensity(spectrum, source))
    if "flux_sfu_1au" in spectrum and spectrum["flux_sfu_1au"].dtype.kind in "iuf":
        spectrum = spectrum.assign(flux_sfu_1au=_in(SFU, spectrum["flux_sfu_1au"], source))
    return _with_position(_with_sample_times(spectrum, source))


def _in_mhz(frequency: xr.DataArray, source: str) -> xr.Variable:
    """Frequencies in MHz, NaN for those that are not above zero."""
    unit = re.sub(r"[^a-z]", "", str(frequency.attrs.get("units", "")).lower())
    if unit not in MHZ and unit:
        raise InputError(f"{source}: coordinate 'frequency' is in {frequency.attrs['units']!r}: convert it to MHz")
    mhz = frequency.to_numpy().astype(np.float64) * MHZ.get(unit, 1.0)
    highest = HIGHEST_MHZ if MHZ.get(unit) == MHZ["khz"] else IMPOSSIBLE_MHZ
    if unit and not LOWEST_MHZ <= np.nanmax(mhz, initial=0.0) <= highest:
        raise InputError(
            f"{source}: coordinate 'frequency' reaches {np.nanmax(mhz, initial=0.0):g} MHz by its unit "
            f"{frequency.attrs['units']!r}: correct the unit"
        )
    if not unit and np.nanmax(mhz, initial=0.0) > HIGHEST_MHZ:
        raise InputError(
            f"{source}: coordinate 'frequency' reaches {np.nanmax(mhz):g} and has no unit: give it the attribute "
            "units, Hz, kHz or MHz"
        )
    mhz = np.where(mhz > 0.0, mhz, np.nan)
    return xr.Variable(frequency.dims, mhz, {**frequency.attrs, "units": "MHz"})


def _in(units: Mapping[str, float], stated: xr.DataArray, source: str) -> xr.DataArray:
    """Values of a variable in the unit that its name says, from the one that it states, if any."""
    unit = str(stated.attrs.get("units", "")).lower().strip()
    if unit and unit not in units:
        raise InputError(f"{source}: {stated.name} is in {unit!r}: convert it to the unit of its name")
    if units.get(unit, 1.0) == 1.0:
        return stated
    named = next(name for name, factor in units.items() if factor == 1.0)
    return (stated * units[unit]).assign_attrs({**stated.attrs, "units": named})


def _intensity(spectrum: xr.Dataset, source: str) -> xr.DataArray:
    """Intensity in the unit of its quantity, NaN for what is outside its range or a fill value."""
    values = spectrum["intensity"]
    intensity = values.to_numpy().astype(np.float32)
    lowest, highest = _valid(values.attrs)
    intensity[(intensity < lowest) | (intensity > highest) | ~np.isfinite(intensity)] = np.nan
    unit, quantity = str(values.attrs.get("units", "")), str(spectrum.attrs.get("quantity", ""))
    if quantity in QUANTITIES and unit_of_another(unit, quantity):
        raise InputError(f"{source}: intensity is in {unit!r}, which is no {quantity}: correct its unit or 'quantity'")
    intensity = without_fill(intensity, quantity)
    in_unit(intensity, unit, quantity)
    return values.copy(data=intensity)


def _valid(attributes: Mapping[Any, Any]) -> tuple[float, float]:
    """What a variable says of its range."""
    stated = attributes.get("valid_range", (attributes.get("valid_min", -np.inf), attributes.get("valid_max", np.inf)))
    try:
        lowest, highest = (float(one) for one in stated)
    except (TypeError, ValueError):
        return -np.inf, np.inf
    return lowest, highest


def _instant(value: Any, source: str) -> np.datetime64:
    """A time that is text, or of a calendar that counts as UTC does."""
    text = value.decode("ascii", "replace") if isinstance(value, bytes) else str(value)
    if getattr(value, "calendar", "standard") not in {"standard", "gregorian", "proleptic_gregorian"}:
        raise InputError(f"{source}: coordinate 'time' is in the calendar {value.calendar!r}: convert it to UTC")
    plain, is_leap = LEAP_SECOND.subn(r"\g<1>59", text.strip())
    try:
        moment = datetime.fromisoformat(plain) + timedelta(seconds=is_leap)
    except ValueError as error:
        raise InputError(
            f"{source}: coordinate 'time' holds {text!r}, which is no time: write UTC as 2012-06-07T19:30:00"
        ) from error
    utc = moment.astimezone(UTC).replace(tzinfo=None) if moment.tzinfo else moment
    return np.datetime64(utc, "ns") if 1700 < utc.year < 2250 else np.datetime64("NaT")


def _check_age(time: npt.NDArray[Any], source: str, file_name: str) -> None:
    """Hold times against the space age, and against the days in the name of the file."""
    known = time[~np.isnat(time)] if time.dtype.kind == "M" else time[:0]
    if not known.size:
        return
    first, last = known.min(), known.max()
    days = dates_in(file_name)
    is_far = days and not any(first - DAY < day + DAY and day - DAY <= last for day in days)
    if first < FIRST or last >= LAST or is_far:
        expected = f"is named after {str(days[0])[:10]}, but " if is_far else ""
        raise InputError(
            f"{source} {expected}holds times from {np.datetime_as_string(first, 's')} to "
            f"{np.datetime_as_string(last, 's')}: correct its times or its name"
        )


def _with_sample_times(spectrum: xr.Dataset, source: str) -> xr.Dataset:
    """With the time of the record for samples that have none; one far from it is no time of it."""
    late_s = None
    if "sample_offset_s" in spectrum and spectrum["sample_offset_s"].dtype.kind == "m":
        spectrum = spectrum.assign(sample_offset_s=spectrum["sample_offset_s"] / np.timedelta64(1, "s"))
    if "sample_time" in spectrum and spectrum["sample_time"].dtype.kind == "M":
        filled = spectrum["sample_time"].astype("datetime64[ns]").fillna(spectrum["time"])
        spectrum = spectrum.assign(sample_time=filled.transpose(*spectrum["sample_time"].dims))
        late_s = (spectrum["sample_time"] - spectrum["time"]) / np.timedelta64(1, "s")
    elif "sample_offset_s" in spectrum and spectrum["sample_offset_s"].dtype.kind in "iuf":
        late_s = _in(SECONDS, spectrum["sample_offset_s"], source).fillna(0.0)
        spectrum = spectrum.assign(sample_offset_s=late_s)
        if "time" in late_s.dims and set(late_s.dims) <= set(FORM):
            late = (late_s * 1e9).round().astype("timedelta64[ns]").broadcast_like(spectrum["intensity"])
            sample_time = (spectrum["time"] + late).transpose(*FORM)
            spectrum = spectrum.drop_vars("sample_offset_s").assign(sample_time=sample_time)
    if late_s is not None and late_s.size and float(np.abs(late_s).max()) > LONGEST_SWEEP_S:
        raise InputError(
            f"{source}: samples are up to {float(np.abs(late_s).max()):.0f} s from the time of their record: give "
            "the times of samples in UTC, or offsets in seconds"
        )
    return spectrum


def _with_position(spectrum: xr.Dataset) -> xr.Dataset:
    """With the position in km, at each record; of what is stated once, the same at each."""
    if POSITION not in spectrum or spectrum[POSITION].dtype.kind not in "iuf":
        return spectrum
    stated = spectrum[POSITION]
    others = [dim for dim in stated.dims if dim not in {"time", "axis"}]
    if len(others) == 1 and stated.sizes[others[0]] == 3 and "axis" not in spectrum.dims:
        stated = stated.rename({others[0]: "axis"}).transpose(..., "axis")
    if stated.dims == ("axis",) and "time" in spectrum.sizes:
        stated = stated.expand_dims(time=spectrum.sizes["time"]).transpose("time", "axis")
    factor = KILOMETRES.get(str(stated.attrs.get("units", "km")).lower().strip(), 0.0)
    if not factor:  # the check of the form says so
        return spectrum.assign({POSITION: stated.copy()})
    frame = str(stated.attrs.get("frame", "")).strip().lower()
    attributes = {**stated.attrs, "units": "km"} | ({"frame": frame} if frame else {})
    position_km = stated.to_numpy().astype(np.float64) * factor
    position_km[~(np.abs(position_km) < NO_POSITION_KM)] = np.nan
    return spectrum.assign({POSITION: (stated.dims, position_km, attributes)})


def _ordered(spectrum: xr.Dataset) -> xr.Dataset:
    """Records and channels ascending, once each, without those that have no time or frequency."""
    if spectrum["intensity"].dims != FORM or spectrum["time"].dtype.kind != "M":
        return spectrum
    if spectrum["intensity"].dtype.kind != "f" or spectrum["frequency"].dtype.kind != "f":
        return spectrum
    for number, axis in enumerate(FORM):
        values = spectrum["intensity"].to_numpy()
        count = np.count_nonzero(np.isfinite(values), axis=1 - number)
        along = spectrum[axis].to_numpy()
        order = ascending(along, lambda count=count: count)  # type: ignore[misc]
        if order.size != along.size or (np.diff(order) != 1).any():
            spectrum = spectrum.isel({axis: order})
    return spectrum


def _with_flags(spectrum: xr.Dataset) -> xr.Dataset:
    """Without samples that were not measured, where they are flagged by record or sample."""
    if "interpolated" not in spectrum or spectrum["interpolated"].dtype.kind not in "biuf":
        return spectrum
    flag = spectrum["interpolated"]
    named = str(flag.attrs.get(NAMED, "interpolated"))
    stated = (np.atleast_1d(flag.attrs.get(name, "")) for name in ("flag_values", "flag_meanings"))
    values, meanings = (" ".join(map(str, one)) for one in stated)
    described = " ".join(str(flag.attrs.get(one, "")) for one in ("long_name", "description", "comment"))
    found = interpolated_where(flag.to_numpy().astype(np.float64), named, flag_words(described, values, meanings))
    if found is None:  # values that were interpolated, no flags
        return spectrum.drop_vars("interpolated")
    flagged = flag.copy(data=found).drop_attrs()
    if flagged.dims == ("frequency",) or not set(flagged.dims) <= set(FORM):
        return spectrum.assign(interpolated=flagged)
    whole = flagged.broadcast_like(spectrum["intensity"]).transpose(*FORM)
    never = whole.all("time")
    return spectrum.assign(intensity=spectrum["intensity"].where(~whole | never), interpolated=never)


def event_spectra() -> xr.DataTree:
    """Spectra of the built-in event of 2012-06-07, as seen by Wind, STEREO-A and STEREO-B, read off a published figure.

    The figure belongs to the public notebook TDOA_OpenSource.ipynb (STBadman/Radio-Public,
    doi:10.5281/zenodo.10107890). Its colour map can be inverted exactly, so the values are good to 1/255 and the times
    to 3 s. Each channel is divided by its maximum between 19:25 and 20:30 UT. What Wind shows is a ratio of voltages,
    what STEREO shows a flux (the attribute ``power_exponent`` says so): only the square of Wind's values decays as fast
    as what STEREO shows.

    Returns
    -------
    xarray.DataTree
        Children "WIND", "STEREO-A" and "STEREO-B", each a dynamic spectrum in memory, quantity ``relative_flux``.
    """
    with (
        resources.as_file(resources.files("bella.spectra") / EVENT) as path,
        xr.open_datatree(path, engine="h5netcdf") as stored,
    ):
        children = {name: child.to_dataset().load() for name, child in stored.children.items()}
        root = stored.to_dataset().load()
    spectra = {name: _spectrum(child, f"{EVENT}/{name}") for name, child in children.items()}
    return xr.DataTree.from_dict({"/": root, **spectra})


def _spectrum(stored: xr.Dataset, source: str) -> xr.Dataset:
    stored.attrs["origin"] = Origin.EVENT.value
    return validate_spectrum(stored.assign(intensity=stored["intensity"].astype(np.float32, keep_attrs=True)), source)
