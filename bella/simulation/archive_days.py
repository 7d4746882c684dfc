"""Days of simulated data sets in a folder that looks like the archive: spectra written under its names."""

import tempfile
from collections.abc import Callable, Iterator, Sequence
from datetime import date, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from bella.archive.datasets import find_datasets
from bella.exceptions import InputError, NoDataError
from bella.simulation.archive_files import (
    H1_KHZ,
    LEVEL2_KHZ,
    Beside,
    Sweeps,
    write_psp_l2,
    write_solo_l3,
    write_stereo_l3,
    write_stereo_level2,
    write_wind_h1,
    write_wind_k0,
    write_wind_l2,
)
from bella.simulation.day import observe_day
from bella.simulation.instruments import WRITABLE, Instrument, instruments
from bella.simulation.receiver import filled_in_frequency
from bella.simulation.sky import Sky, draw_sky
from bella.simulation.truth import day_truth
from bella.spacecraft import OBSERVATORIES, fleet, position
from bella.spectra.dynamic_spectrum import sample_times
from bella.units import R_SUN_KM, FloatArray

DAY = timedelta(days=1)
MARK = ".simulated"
"""File that tells a simulated archive from a mirror of the real one."""

SIDES = {"STEREO-A": "ahead", "STEREO-B": "behind"}
MINUTE = np.timedelta64(60, "s")
HEE_ANGLES = {f"wave_{angle}_hee_deg": f"WAVE_{angle}_HEE".upper() for angle in ("colatitude", "azimuth")}
"""Names in the files by those in a dynamic spectrum."""


def simulate_days(
    root: Path,
    days: Sequence[date],
    seed: int,
    datasets: Sequence[str] = (),
    advance: Callable[[int], None] = lambda _: None,
) -> dict[str, Any]:
    """Write days of simulated files under the names and in the folders of the archive.

    A day depends on the seed and its date only, not on which other days or data sets are written, and bursts go on past
    midnight.

    Parameters
    ----------
    root : pathlib.Path
        Folder that is new, empty, or was simulated before.
    datasets : sequence of str
        Keys of `WRITABLE`; none for all that exist on a day.
    advance : callable
        Told 1 after each day.

    Returns
    -------
    dict
        The truth: ``seed`` and ``days`` (:func:`bella.simulation.truth.day_truth`, and the ``files`` of the day).

    Raises
    ------
    InputError
        If the folder holds anything else, a data set cannot be written, or there is nothing to write for a day.
    """
    wanted = _wanted(datasets)
    _claim(root)
    truth = []
    for day in days:
        truth.append(_simulate(root, day, seed, wanted))
        advance(1)
    return {"seed": seed, "days": truth}


def _wanted(datasets: Sequence[str]) -> tuple[str, ...]:
    keys = [dataset.key for dataset in find_datasets(datasets)] if datasets else list(WRITABLE)
    unknown = [key for key in keys if key not in WRITABLE]
    if unknown:
        raise InputError(f"files of data set {unknown[0]!r} cannot be simulated; choose from {', '.join(WRITABLE)}")
    return tuple(keys)


def _claim(root: Path) -> None:
    if root.exists() and not root.is_dir():
        raise InputError(f"{root} is a file; name a folder")
    if root.is_dir() and any(root.iterdir()) and not (root / MARK).exists():
        raise InputError(f"{root} is not empty and was not simulated; name a new folder, so that no real file is lost")
    try:
        root.mkdir(parents=True, exist_ok=True)
        (root / MARK).touch()
    except OSError as error:
        raise InputError(f"{root} cannot be written ({error.strerror}); name another folder") from error


def _simulate(root: Path, day: date, seed: int, datasets: Sequence[str]) -> dict[str, Any]:
    known = set(fleet(np.datetime64(day, "ns") + np.timedelta64(12, "h"))["observatory"])
    skies = {other: sky_of(other, seed) for other in (day - DAY, day, day + DAY)}
    files = []
    observatories: dict[str, None] = {}
    for key, receivers in _receivers(day, datasets, known):
        rng = np.random.default_rng([seed, day.toordinal(), WRITABLE.index(key) + 1])
        spectra = [observe_day(receiver, tuple(skies.values()), day, rng) for receiver in receivers]
        files.append(str(write_spectra(spectra, key, day, root).relative_to(root)))
        observatories |= dict.fromkeys(receiver.receiver.observatory for receiver in receivers)
    if not files:
        raise InputError(f"no data set asked for has files of {day}; choose other days or data sets")
    return day_truth(skies[day], list(observatories)) | {"files": files}


def sky_of(day: date, seed: int) -> Sky:
    """What is to be received on a day, the same for every call with its date and seed."""
    return draw_sky(day, OBSERVATORIES, np.random.default_rng([seed, day.toordinal()]))


def _receivers(day: date, datasets: Sequence[str], known: set[str]) -> Iterator[tuple[str, list[Instrument]]]:
    for dataset in find_datasets(datasets):
        if dataset.covers(day) and known & set(dataset.observatories):
            receivers = instruments(dataset.key, day)
            yield dataset.key, [one for one in receivers if one.receiver.observatory in known]


def write_spectra(spectra: Sequence[xr.Dataset], dataset: str, day: date, root: Path) -> Path:
    """Write the file of a day of a data set.

    Parameters
    ----------
    spectra : sequence of xarray.Dataset
        Dynamic spectra of every receiver or spacecraft that the file holds, channels and quantity as the data set has
        them.
    dataset : str
        Key of the data set.
    day : datetime.date
        Day that the file is named after.
    root : pathlib.Path
        Root of the archive; folders are made.

    Returns
    -------
    pathlib.Path
        The file, which is there whole or not at all.

    Raises
    ------
    InputError
        If the data set cannot be written, or the spectra are of another quantity or number.
    """
    (known,) = find_datasets([dataset])
    if dataset not in WRITERS:
        raise InputError(f"files of data set {dataset!r} cannot be written; choose from {', '.join(WRITERS)}")
    quantity, write = WRITERS[dataset]
    if not spectra or any(one.attrs["quantity"] != quantity for one in spectra):
        raise InputError(f"data set {dataset} holds {quantity}: convert the spectra to it")
    name = known.name.format(date=f"{day:%Y%m%d}", version="01")
    folder = root / known.folders(day)[0]
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=root, prefix=".writing-") as staging:
        return write(Path(staging) / name, spectra).replace(folder / name)


def _minutes(spectrum: xr.Dataset) -> tuple[np.ndarray, FloatArray]:
    """Centres of all minutes of the day, and intensity with NaN in those that are missing."""
    time = spectrum["time"].to_numpy()
    midnight = time[0].astype("datetime64[D]").astype("datetime64[ns]")
    utc = midnight + np.arange(1440) * MINUTE + MINUTE // 2
    values = np.full((utc.size, spectrum.sizes["frequency"]), np.nan)
    row = (time - midnight) // MINUTE
    inside = (row >= 0) & (row < utc.size)
    values[row[inside]] = spectrum["intensity"].to_numpy()[inside]
    return utc, values


def _wind_h1(path: Path, spectra: Sequence[xr.Dataset]) -> Path:
    ratio = {name: np.full((1440, khz.size), np.nan) for name, khz in H1_KHZ.items()}
    measured: dict[str, npt.NDArray[np.bool_]] = {name: np.ones(khz.size, np.bool_) for name, khz in H1_KHZ.items()}
    for spectrum in spectra:
        receiver = str(spectrum.attrs["receiver"])
        if "interpolated" in spectrum:
            measured[receiver] = ~spectrum["interpolated"].to_numpy().astype(bool)
        utc, ratio[receiver] = _minutes(filled_in_frequency(spectrum) if "interpolated" in spectrum else spectrum)
    return write_wind_h1(path, utc, ratio, measured)


def _wind_l2(path: Path, spectra: Sequence[xr.Dataset]) -> Path:
    (spectrum,) = spectra
    return write_wind_l2(path, spectrum["time"].to_numpy(), _hertz(spectrum), spectrum["intensity"].to_numpy())


def _wind_k0(path: Path, spectra: Sequence[xr.Dataset]) -> Path:
    (spectrum,) = spectra
    return write_wind_k0(path, spectrum["time"].to_numpy(), spectrum["intensity"].to_numpy())


def _hertz(spectrum: xr.Dataset) -> np.ndarray:
    return np.asarray(spectrum["frequency"].to_numpy() * 1e6)


def _level2(path: Path, spectra: Sequence[xr.Dataset]) -> Path:
    decibel = {}
    for spectrum in spectra:
        utc, values = _minutes(spectrum)
        khz = spectrum["frequency"].to_numpy() * 1e3
        # the HFR's channels below the LFR's last one are in the file too, though no spectrum has them
        nearest = np.abs(LEVEL2_KHZ[:, None] - khz[None, :]).argmin(axis=1)
        decibel[SIDES[str(spectrum.attrs["observatory"])]] = values[:, nearest]
    absent = {side: np.full((1440, LEVEL2_KHZ.size), np.nan) for side in SIDES.values() if side not in decibel}
    return write_stereo_level2(path, utc, decibel | absent)


def _stereo_l3(path: Path, spectra: Sequence[xr.Dataset]) -> Path:
    (spectrum,) = spectra
    utc = spectrum["time"].to_numpy()
    known = {name: spectrum[channel].to_numpy() for channel, name in HEE_ANGLES.items() if channel in spectrum}
    beside = Beside(known, _position_km(spectrum, utc, "hee"))
    return write_stereo_l3(path, utc, _hertz(spectrum), spectrum["intensity"].to_numpy(), beside)


def _position_km(spectrum: xr.Dataset, utc: np.ndarray, frame: str) -> FloatArray | None:
    """Where the ephemeris has the spacecraft; None where it does not have it at all of these times."""
    try:
        return position(str(spectrum.attrs["observatory"]), utc, frame) * R_SUN_KM
    except NoDataError:
        return None


def _psp_l2(path: Path, spectra: Sequence[xr.Dataset]) -> Path:
    (spectrum,) = spectra
    half = 0.5 * spectrum["intensity"].to_numpy()
    return write_psp_l2(path, spectrum["time"].to_numpy(), _hertz(spectrum), {"ch0_V1V2": half, "ch1_V3V4": half})


def _solo_l3(path: Path, spectra: Sequence[xr.Dataset]) -> Path:
    (spectrum,) = spectra
    times = sample_times(spectrum).to_numpy()
    start = times.min(axis=1)
    flagged = np.zeros(spectrum.sizes["frequency"], dtype=bool)
    if "interpolated" in spectrum:
        flagged = spectrum["interpolated"].to_numpy().astype(bool)
    return write_solo_l3(
        path,
        Sweeps(start, (times - start[:, None]) / np.timedelta64(1, "s"), _position_km(spectrum, start, "hci")),
        spectrum["frequency"].to_numpy() * 1e3,
        spectrum["intensity"].to_numpy(),
        np.broadcast_to(flagged, times.shape),
    )


Writer = Callable[[Path, Sequence[xr.Dataset]], Path]
WRITERS: dict[str, tuple[str, Writer]] = {
    "WI_H1_WAV": ("voltage_ratio", _wind_h1),
    **{f"WI_L2_WAV_{receiver}": ("psd_v2_hz", _wind_l2) for receiver in ("RAD1", "RAD2")},
    "WI_K0_WAV": ("db_over_background", _wind_k0),
    "STEREO_LEVEL2_SWAVES": ("db_over_background", _level2),
    **{f"ST{side}_L3_WAV_{band}": ("flux_w_m2_hz", _stereo_l3) for side in "AB" for band in ("LFR", "HFR")},
    **{f"PSP_FLD_L2_RFS_{band}": ("psd_v2_hz", _psp_l2) for band in ("LFR", "HFR")},
    **{f"SOLO_L3_RPW-{band}-SURV-FLUX": ("flux_w_m2_hz", _solo_l3) for band in ("HFR", "TNR")},
}
"""Quantity and writer of every data set that can be written."""
