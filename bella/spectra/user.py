"""Spectra that users bring: in a folder, by day, with receivers and positions, and as spectrograms of radiospectra."""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import date, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from bella.containers import MAGIC, is_zarr
from bella.exceptions import InputError, MissingExtraError, NoDataError, require_extra
from bella.records import Origin
from bella.spacecraft import observatory_name
from bella.spectra.assembly import Origin as Measured
from bella.spectra.assembly import assemble
from bella.spectra.combination import by_observatory_of_what_fits
from bella.spectra.positions import ReceiverPosition, receiver_position
from bella.spectra.products import FITS, HDF5, IDL, NETCDF3, PACKERS, find_product, open_spectra

if TYPE_CHECKING:
    from radiospectra.spectrogram import GenericSpectrogram

ENDINGS = (".nc", ".nc4", ".netcdf", ".cdf", ".cdf.gz")
HEADS = (HDF5, NETCDF3, *MAGIC)
"""First bytes of what is read whatever its name ends in."""

DATA_HEADS = (FITS, IDL, *PACKERS, b"\x93NUMPY")
DATA_ENDINGS = (
    *(".fits", ".fit", ".fts", ".h5", ".hdf5", ".hdf", ".he5", ".sav", ".dat", ".bin", ".npy", ".npz", ".mat"),
    *(".gz", ".bz2", ".xz", ".zip", ".tar", ".tgz", ".grb", ".pkl", ".parquet", ".feather", ".r1", ".r2"),
)
PICTURES = (".png", ".jpg", ".jpeg", ".gif", ".ico", ".pdf", ".pyc")
"""First bytes and endings of data that are not read here; endings of what is binary and no data."""

FAULTS_OF_A_FILE = (InputError, NoDataError, MissingExtraError)
"""After which it is left out. Others, as a killed reader, say nothing of the file."""

HOME_MARK = "catalogue.sqlite"
"""A folder with it holds results, and no spectra of anybody's."""

BEFORE, AFTER = np.timedelta64(30, "m"), np.timedelta64(3, "h")
"""How much of the days around it belongs to a day: bursts are alone or not, and go on past midnight."""


@dataclass(frozen=True)
class UserFile:
    """A file of a folder: what it holds, without its values."""

    path: Path
    observatories: tuple[str, ...]
    first: np.datetime64
    last: np.datetime64
    days: frozenset[date]
    """Days with records."""


@dataclass(frozen=True)
class UserDay:
    """A day of a folder."""

    day: date
    spectra: dict[str, xr.Dataset]
    """By observatory, all its receivers together, of origin ``user``; with the ends of the days around it."""
    positions: dict[str, ReceiverPosition]
    """At noon, or the record next to it; :func:`bella.spectra.receiver_position` gives those of other times."""
    files: tuple[Path, ...]
    left_out: tuple[str, ...]
    """One line for each file that cannot be read or joined, and each spacecraft without a position."""


@dataclass(frozen=True)
class UserFolder:
    """What a folder of spectra holds."""

    files: tuple[UserFile, ...]
    left_out: tuple[str, ...]
    """One line for each file that cannot be read, or looks like data and is not looked at."""
    others: tuple[str, ...] = ()
    """Names of files that are not looked at and do not look like data."""

    @property
    def days(self) -> tuple[date, ...]:
        """Days with records, ascending."""
        return tuple(sorted(frozenset[date]().union(*(file.days for file in self.files))))

    def of(self, day: date) -> tuple[UserFile, ...]:
        """Files that hold a day and what of its neighbours belongs to it."""
        first, last = _span(day)
        around = {day + timedelta(days=number) for number in (-1, 0, 1)}
        return tuple(file for file in self.files if file.first < last and file.last >= first and around & file.days)

    def read(self, day: date) -> UserDay:
        """The spectra of a day.

        Raises
        ------
        NoDataError
            If the folder has no record of it.
        """
        begin = np.datetime64(day, "ns")
        first, last = _span(day)
        parts, used, left_out = [], [], []
        for file in self.of(day):
            try:
                found = open_spectra(file.path)
            except FAULTS_OF_A_FILE as error:  # it could be read when the folder was looked through
                left_out.append(f"left out: {error}")
                continue
            for spectrum in found:
                time = spectrum["time"].to_numpy()
                part = spectrum.isel(time=np.flatnonzero((time >= first) & (time < last)))
                if part.sizes["time"] > 1:
                    parts.append(part.assign_attrs(origin=_origin(part)))
                    used.append(file.path)
        if not parts:
            raise NoDataError(f"the folder has no record of {day}")
        end = begin + np.timedelta64(1, "D")
        whole, unfit = by_observatory_of_what_fits(parts)
        left_out += [f"left out: {one}" for one in unfit]
        spectra = {name: one for name, one in whole.items() if _has_records(one, begin, end)}
        positions = {}
        for name, spectrum in spectra.items():
            try:
                positions[name] = receiver_position(spectrum, _near_noon(spectrum, begin))
            except NoDataError as error:
                left_out.append(f"left out of positions: {error}")
        return UserDay(day, spectra, positions, tuple(dict.fromkeys(used)), tuple(left_out))


def _span(day: date) -> tuple[np.datetime64, np.datetime64]:
    """The day with what of its neighbours belongs to it."""
    begin = np.datetime64(day, "ns")
    return begin - BEFORE, begin + np.timedelta64(1, "D") + AFTER


def user_days(folder: Path) -> UserFolder:
    """Look through a folder of spectra of any instrument: netCDF, Zarr, and files of the archives.

    Parameters
    ----------
    folder : pathlib.Path
        One file for each spacecraft and day, or longer; subfolders count.

    Returns
    -------
    UserFolder

    Raises
    ------
    InputError
        If there is no such folder, or nothing in it can be read.
    """
    if not folder.is_dir():
        raise InputError(f"{folder} is no folder: name one with netCDF or Zarr files of dynamic spectra")
    files, left_out, others = [], [], []
    for path in _all_in(folder):
        try:
            if not (_is_candidate(path) or _looks_like_data(path)):
                others.append(path.name)
                continue
            spectra = open_spectra(path)
        except (*FAULTS_OF_A_FILE, OSError) as error:
            left_out.append(f"left out: {error}")
            continue
        times = [one["time"].to_numpy() for one in spectra]
        names = tuple(dict.fromkeys(str(one.attrs["observatory"]) for one in spectra))
        days = frozenset[date]().union(*(_days_of(one) for one in times))
        files.append(UserFile(path, names, min(one[0] for one in times), max(one[-1] for one in times), days))
    if not files:
        reason = left_out[0] if left_out else f"its files do not end in {', '.join(ENDINGS)} or .zarr"
        raise InputError(f"{folder} holds no spectrum that can be read ({reason}): see 'bella formats'")
    return UserFolder(tuple(files), tuple(left_out), tuple(others))


def _all_in(folder: Path, above: frozenset[Path] = frozenset()) -> Iterator[Path]:
    """Zarr stores and files of a folder, hidden ones aside, in order of their names."""
    above |= {folder.resolve()}
    for path in sorted(folder.iterdir()):
        if path.name.startswith("."):
            continue
        if (path / HOME_MARK).is_file():
            continue
        if not path.is_dir() or is_zarr(path) or not os.access(path, os.R_OK | os.X_OK):
            yield path
        elif path.resolve() not in above:  # links may lead in a circle
            yield from _all_in(path, above)


def _is_candidate(path: Path) -> bool:
    """Whether a file is looked at, by its name or its first bytes."""
    is_named = path.name.lower().endswith(ENDINGS) or find_product(path.name) is not None
    return is_named or path.is_dir() or _head(path).startswith(HEADS)


def _looks_like_data(path: Path) -> bool:
    name, head = path.name.lower(), _head(path)
    is_binary = b"\0" in head and not name.endswith(PICTURES)
    return is_binary or name.endswith(DATA_ENDINGS) or head.startswith(DATA_HEADS)


def _head(path: Path) -> bytes:
    with path.open("rb") as stream:
        return stream.read(64)


def _days_of(time: npt.NDArray[np.datetime64]) -> set[date]:
    """Days with records; one at midnight alone is the end of a day."""
    kept = time[:-1] if time.size > 1 and time[-1] == time[-1].astype("M8[D]") else time
    return {one.item() for one in np.unique(kept.astype("M8[D]"))}


def _near_noon(spectrum: xr.Dataset, begin: np.datetime64) -> np.datetime64:
    time = spectrum["time"].to_numpy()
    return np.datetime64(min(max(begin + np.timedelta64(12, "h"), time[0]), time[-1]))


def _has_records(spectrum: xr.Dataset, begin: np.datetime64, end: np.datetime64) -> bool:
    time = spectrum["time"].to_numpy()
    return bool(((time >= begin) & (time < end)).any())


def _origin(spectrum: xr.Dataset) -> str:
    """What users bring is theirs, whichever archive it came from; only what was simulated stays so."""
    kept = {Origin.SIMULATED.value, Origin.TEST.value}
    stated = str(spectrum.attrs.get("origin", ""))
    return stated if stated in kept else Origin.USER.value


def from_radiospectra(
    spectrogram: "GenericSpectrogram", quantity: str, receiver: str = "", observatory: str = ""
) -> xr.Dataset:
    """A dynamic spectrum from a spectrogram of radiospectra, which also reads e-CALLISTO and other files.

    Parameters
    ----------
    spectrogram : radiospectra.spectrogram.GenericSpectrogram
        With its times and frequencies; its data may have either axis first.
    quantity : str
        What its values are, one of ``QUANTITIES``: radiospectra does not state it.
    receiver, observatory : str, optional
        In place of its own ``detector`` and ``observatory``.

    Returns
    -------
    xarray.Dataset
        Of origin ``user``.

    Raises
    ------
    InputError
        If data, times and frequencies do not fit together.
    """
    meta, data = spectrogram.meta, spectrogram.data
    values = np.ma.filled(np.ma.asarray(getattr(data, "value", data)).astype(np.float32), np.nan)
    name = str(observatory or meta["observatory"])
    times = np.asarray(spectrogram.times.utc.to_value("datetime64")).astype("datetime64[ns]")
    frequency_mhz = np.asarray(spectrogram.frequencies.to_value("MHz"), dtype=np.float64)
    if values.shape == (frequency_mhz.size, times.size):
        values = values.T
    measured = Measured(
        observatory_name(name), str(receiver or meta.get("detector") or meta.get("instrument", "")), quantity, name
    )
    sources = [str(meta["filename"])] if meta.get("filename") else []
    return assemble(measured, times, frequency_mhz, values).assign_attrs(
        origin=Origin.USER.value, source_files=sources or [f"spectrogram of {name}"]
    )


def to_radiospectra(spectrum: xr.Dataset) -> "GenericSpectrogram":
    """A spectrogram of radiospectra from a dynamic spectrum; needs the extra ``radiospectra``.

    Parameters
    ----------
    spectrum : xarray.Dataset
        A dynamic spectrum.

    Returns
    -------
    radiospectra.spectrogram.GenericSpectrogram
        Data of shape (frequency, time). Sample times and what else stands beside the intensity have no place in it.

    Raises
    ------
    MissingExtraError
        If radiospectra is not installed.
    """
    require_extra("radiospectra")
    import astropy.units as u  # noqa: PLC0415 - heavy, and few need it
    from astropy.time import Time  # noqa: PLC0415
    from radiospectra.spectrogram import GenericSpectrogram  # noqa: PLC0415
    from sunpy.net import attrs as a  # noqa: PLC0415

    times = Time(spectrum["time"].to_numpy(), scale="utc")
    frequency = spectrum["frequency"].to_numpy() * u.MHz
    meta: dict[str, Any] = {
        "observatory": spectrum.attrs["observatory"],
        "instrument": spectrum.attrs["observatory"],
        "detector": spectrum.attrs["receiver"],
        "start_time": times[0],
        "end_time": times[-1],
        "wavelength": a.Wavelength(frequency[0], frequency[-1]),
        "times": times,
        "freqs": frequency,
        "filename": ", ".join(str(name) for name in np.atleast_1d(spectrum.attrs["source_files"])),
        "quantity": spectrum.attrs["quantity"],
    }
    return GenericSpectrogram(spectrum["intensity"].transpose("frequency", "time").to_numpy(), meta=meta)
