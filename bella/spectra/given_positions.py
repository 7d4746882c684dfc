"""Where the spacecraft was, as the files of its spectra say themselves: kept with the spectrum, and asked of it.

Files state positions at their own instants and in frames of their own; they are kept in the frame they came in, at the
records of the spectrum, and turned to HEE only when asked for.
"""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import xarray as xr
from scipy.interpolate import make_interp_spline

from bella.exceptions import InputError
from bella.spacecraft import BODIES, OBSERVATORIES, coverage, hee_from, position, require_agreement
from bella.spectra.cdf import CdfFile, TimeArray
from bella.spectra.dynamic_spectrum import GEOCENTRIC, POSITION
from bella.units import R_SUN_KM, FloatArray

REACH_S = 1800.0
"""How far from a stated position one is taken from it; between positions an hour apart a line is good to 150 km at
0.28 au."""

KILOMETRES = ("", "km", "kilometer", "kilometers", "kilometre", "kilometres")
EARTH_RADIUS_KM = 6378.137


def read_positions(cdf: CdfFile, spectrum: xr.Dataset, time: TimeArray, variables: Sequence[str]) -> xr.Dataset:
    """Keep the positions of a CDF with the spectrum read from it.

    Parameters
    ----------
    cdf : CdfFile
        The open file.
    spectrum : xarray.Dataset
        Dynamic spectrum.
    time : numpy.ndarray
        datetime64[ns], UTC, of the records of the file.
    variables : sequence of str
        Names to look for, the best first; each ends in its frame, such as ``SC_POS_HEE``.

    Returns
    -------
    xarray.Dataset
        With ``position_km``, from the first variable that holds positions in km; as it was where none does.

    Raises
    ------
    InputError
        If there is not one position for each record.
    """
    for name in variables:
        if not cdf.has_records(name) or cdf.attribute("UNITS", name).lower() not in KILOMETRES:
            continue
        stated_km = cdf.numbers(name, 2).astype(np.float64)
        if stated_km.shape != (time.size, 3):
            raise InputError(f"{cdf.name}: {name} has the shape {stated_km.shape}, not {(time.size, 3)}")
        placed = with_positions(spectrum, time, stated_km, name.rsplit("_", 1)[-1].lower())
        if POSITION in placed:
            return placed
    return spectrum


def with_positions(spectrum: xr.Dataset, time: TimeArray, position_km: FloatArray, frame: str) -> xr.Dataset:
    """A spectrum with where the spacecraft was at its records.

    Parameters
    ----------
    spectrum : xarray.Dataset
        Dynamic spectrum.
    time : numpy.ndarray
        datetime64[ns], UTC, shape (N,): when positions are known; they need not be the records of the spectrum.
    position_km : numpy.ndarray
        Shape (N, 3), km; rows with NaN are left out.
    frame : str
        Their frame, of the instant of each: hee, heeq, carrington, hci or gse (which is centred on Earth).

    Returns
    -------
    xarray.Dataset
        With ``position_km(time, axis)``, NaN where no position is known within half an hour; as it was where none is
        known at all.
    """
    placed_km = positions_at(spectrum["time"].to_numpy(), time, position_km)
    if not np.isfinite(placed_km).any():
        return spectrum
    attributes = {"frame": frame, "units": "km", "long_name": "position of the spacecraft"}
    return spectrum.assign({POSITION: (("time", "axis"), placed_km, attributes)})


def join_positions(joined: xr.Dataset, parts: Sequence[xr.Dataset]) -> xr.Dataset:
    """Give a spectrum the positions of those that it was made of.

    Parameters
    ----------
    joined : xarray.Dataset
        Dynamic spectrum of one spacecraft.
    parts : sequence of xarray.Dataset
        What it was made of. Positions in another frame than that of the first that has any are left out.

    Returns
    -------
    xarray.Dataset
        With ``position_km`` where any part has it.
    """
    placed = [part[POSITION] for part in parts if POSITION in part]
    if not placed:
        return joined
    frame = str(placed[0].attrs["frame"]).lower()
    alike = [one for one in placed if str(one.attrs["frame"]).lower() == frame]
    time = np.concatenate([one["time"].to_numpy() for one in alike])
    return with_positions(joined, time, np.concatenate([one.to_numpy() for one in alike]), frame)


def given_position_hee(
    spectrum: xr.Dataset, utc: np.datetime64, tolerance_km: float | None = None
) -> FloatArray | None:
    """Where the file of a spectrum says that the spacecraft was.

    Parameters
    ----------
    spectrum : xarray.Dataset
        Dynamic spectrum.
    utc : numpy.datetime64
        The instant, and the epoch of the frame.
    tolerance_km : float, optional
        How far from the ephemeris it may be, where that has the spacecraft at that time; default 50 000 km (0.17 s of
        light), for Wind three solar radii.

    Returns
    -------
    numpy.ndarray or None
        Shape (3,), solar radii, HEE of `utc`; None where the spectrum has no position within half an hour.

    Raises
    ------
    InputError
        If it is farther from the ephemeris than the tolerance.
    NoDataError
        If the position is in another frame than HEE and the ephemeris does not have Earth then.
    """
    if POSITION not in spectrum:
        return None
    instant = np.asarray([utc], dtype="datetime64[ns]")
    stated = spectrum[POSITION]
    placed_km = positions_at(instant, spectrum["time"].to_numpy(), stated.to_numpy())
    if not np.isfinite(placed_km).all():
        return None
    placed_rsun = _in_hee(placed_km / R_SUN_KM, str(stated.attrs["frame"]).lower(), instant[0])
    observatory = str(spectrum.attrs["observatory"])
    if _in_ephemeris(observatory, instant[0]):
        require_agreement(observatory, instant, placed_rsun * R_SUN_KM, "hee", tolerance_km)
    return np.asarray(placed_rsun[0])


def positions_at(time: TimeArray, known: TimeArray, position_km: FloatArray) -> FloatArray:
    """Positions on straight lines between known ones.

    Parameters
    ----------
    time : numpy.ndarray
        datetime64[ns], shape (M,).
    known : numpy.ndarray
        datetime64[ns], shape (N,), in any order.
    position_km : numpy.ndarray
        Shape (N, 3), km; of two at one instant the first counts.

    Returns
    -------
    numpy.ndarray
        Shape (M, 3), km; NaN farther than half an hour from what is known.
    """
    usable = np.flatnonzero(np.isfinite(position_km).all(axis=1) & ~np.isnat(known))
    instants, first = np.unique(known[usable], return_index=True)
    if instants.size < 2:
        return np.full((time.size, 3), np.nan)
    known_s, wanted_s = _seconds(instants, instants[0]), _seconds(time, instants[0])
    placed_km = make_interp_spline(known_s, np.asarray(position_km[usable[first]], dtype=np.float64), k=1)(wanted_s)
    after = np.clip(np.searchsorted(known_s, wanted_s), 1, known_s.size - 1)
    away_s = np.minimum(np.abs(wanted_s - known_s[after - 1]), np.abs(known_s[after] - wanted_s))
    placed_km[away_s > REACH_S] = np.nan
    return np.asarray(placed_km, dtype=np.float64)


def _seconds(time: TimeArray, since: np.datetime64) -> npt.NDArray[np.float64]:
    return np.asarray((time - since) / np.timedelta64(1, "s"), dtype=np.float64)


def _in_hee(point_rsun: FloatArray, frame: str, utc: np.datetime64) -> FloatArray:
    """Points of any frame a file may use, in HEE of the same instant.

    GSE has its X axis from Earth to the Sun and its Z axis where HEE has it (Hapgood 1992, Planet. Space Sci. 40, 711,
    doi:10.1016/0032-0633(92)90012-D).
    """
    if frame == GEOCENTRIC:
        return np.asarray(position("EARTH", [utc], "hee") + point_rsun * [-1.0, -1.0, 1.0])
    return point_rsun if frame == "hee" else hee_from(frame, point_rsun, utc)


def _in_ephemeris(observatory: str, utc: np.datetime64) -> bool:
    if observatory not in {*OBSERVATORIES, *BODIES}:
        return False
    return all(coverage(name).start <= utc <= coverage(name).stop for name in (observatory, "EARTH"))
