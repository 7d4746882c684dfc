"""Where the spacecraft was, as the files of its spectra say themselves: kept with the spectrum, and asked of it.

Files state positions at their own instants and in frames of their own; they are kept in the frame they came in, at the
records of the spectrum, and turned to HEE only when asked for.
"""

import re
from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr
from scipy.interpolate import make_interp_spline

from bella.containers import CdfFile, TimeArray
from bella.exceptions import InputError, NoDataError
from bella.spacecraft import BODIES, OBSERVATORIES, coverage, hee_from, position
from bella.spacecraft.ephemeris import WIND_SYSTEMATIC_RSUN
from bella.spectra.beside import epoch_of
from bella.spectra.dynamic_spectrum import GEOCENTRIC, POSITION
from bella.units import AU_KM, R_SUN_KM, FloatArray

REACH_S = 1800.0
"""How far from a stated position one is taken from it; between positions an hour apart a line is good to 150 km at
0.28 au."""

EARTH_RADIUS_KM = 6378.137

TOLERANCE_KM = 50_000.0
"""How far apart file and ephemeris may be: 0.17 s of light. Predicted and reconstructed trajectories differ by less."""

WIND_TOLERANCE_KM = 3.0 * WIND_SYSTEMATIC_RSUN * R_SUN_KM
"""Of Wind, whose orbit about L1 the ephemeris does not have."""

DISAGREEMENT_FLAG = "position_disagrees"

POSITIONS = re.compile(r"(?:^|_)(?:SC_?|SPACECRAFT_?)?POS(?:ITION)?_(HEEQ|HEE|HCI|GSE)$")
"""Names in the files, upper case."""

KILOMETRES = {
    **dict.fromkeys(("", "km", "kilometer", "kilometers", "kilometre", "kilometres"), 1.0),
    **dict.fromkeys(("m", "meter", "meters", "metre", "metres"), 1e-3),
    **dict.fromkeys(("au", "astronomical unit", "astronomical units"), AU_KM),
    **dict.fromkeys(("rsun", "r_sun", "rs", "solar radii", "solrad"), R_SUN_KM),
}


class ReceiverPosition(NamedTuple):
    """Where a receiver was."""

    position_rsun: FloatArray
    """Shape (3,), solar radii, HEE."""
    source: Literal["file", "ephemeris"]
    difference_km: float
    """Between file and ephemeris; NaN where one of them has no position."""
    flag: str
    """``position_disagrees`` where they differ by more than the tolerance, and the ephemeris is taken; else empty."""


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


def with_stated_positions(cdf: CdfFile, spectrum: xr.Dataset) -> xr.Dataset:
    """A spectrum with where the spacecraft was, if the file says so: at times of its own, at each record, or once.

    Parameters
    ----------
    cdf : CdfFile
        The open file, of one spacecraft.
    spectrum : xarray.Dataset
        What was read from it.

    Returns
    -------
    xarray.Dataset
        With ``position_km`` in the first of HEE, HEEQ, HCI and GSE that the file has; what does not fit is named in
        ``left_out``.
    """
    frames = ("HEE", "HEEQ", "HCI", "GSE")
    named = {name: found[1] for name in cdf.variables if (found := POSITIONS.search(name.strip().upper()))}
    left_out = [one for one in str(spectrum.attrs.get("left_out", "")).split(";") if one]
    for name in sorted(named, key=lambda one: (frames.index(named[one]), one)):
        if not cdf.has_records(name):
            continue
        try:
            placed = _placed(cdf, spectrum, name, named[name].lower())
        except InputError:
            placed = None
        if placed is not None:
            return placed
        left_out.append(name)
    return spectrum.assign_attrs(left_out=";".join(left_out)) if left_out else spectrum


def _placed(cdf: CdfFile, spectrum: xr.Dataset, name: str, frame: str) -> xr.Dataset | None:
    factor = KILOMETRES.get(cdf.attribute("UNITS", name).lower().strip("[]() "))
    if factor is None:
        return None
    stated_km = np.atleast_2d(cdf.numbers(name).astype(np.float64)) * factor
    if stated_km.ndim != 2 or stated_km.shape[1] != 3 or not np.isfinite(stated_km).all(axis=1).any():
        return None
    if not cdf.varies(name):
        time = spectrum["time"].to_numpy()
        stated_km = np.repeat(stated_km[:1], time.size, axis=0)
    else:
        time = cdf.utc(epoch_of(cdf, name))
        if len(stated_km) != time.size:
            return None
    placed = with_positions(spectrum, time, stated_km, frame)
    return placed if POSITION in placed else None


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


def receiver_position(spectrum: xr.Dataset, utc: np.datetime64) -> ReceiverPosition:
    """Where the receiver of a spectrum was: as its file says unless the ephemeris contradicts, else as that says.

    Parameters
    ----------
    spectrum : xarray.Dataset
        Dynamic spectrum.
    utc : numpy.datetime64
        The instant, and the epoch of the frame.

    Returns
    -------
    ReceiverPosition

    Raises
    ------
    NoDataError
        If neither file nor ephemeris has a position then.
    """
    instant = np.asarray([utc], dtype="datetime64[ns]")
    name = str(spectrum.attrs["observatory"])
    known = position(name, instant, "hee")[0] if _in_ephemeris(name, instant[0]) else None
    stated = _stated_rsun(spectrum, instant)
    if stated is None and known is None:
        raise NoDataError(
            f"no position of {name} is known at {np.datetime_as_string(instant[0], 's')}{_stated_when(spectrum)}: give "
            "its spectrum the variable 'position_km', or name a spacecraft of 'bella ephemeris'"
        )
    if stated is None or known is None:
        there = known if stated is None else stated
        return ReceiverPosition(np.asarray(there), "ephemeris" if stated is None else "file", float("nan"), "")
    difference_km = float(np.linalg.norm(stated - known)) * R_SUN_KM
    if difference_km > (WIND_TOLERANCE_KM if name == "WIND" else TOLERANCE_KM):
        return ReceiverPosition(np.asarray(known), "ephemeris", difference_km, DISAGREEMENT_FLAG)
    return ReceiverPosition(stated, "file", difference_km, "")


def fill_in_positions(
    arrivals: pd.DataFrame, spectra: Mapping[str, xr.Dataset], utc: np.datetime64
) -> tuple[pd.DataFrame, list[str]]:
    """Arrival table with the positions that come with the spectra: where ephemeris has none, or does not contradict.

    Parameters
    ----------
    arrivals : pandas.DataFrame
        Arrival table.
    spectra : mapping of str to xarray.Dataset
        By observatory.
    utc : numpy.datetime64
        The instant, and the epoch of the frame.

    Returns
    -------
    table : pandas.DataFrame
    remarks : list of str
        On spacecraft without a position, and on those whose file contradicts the ephemeris.
    """
    table, remarks = arrivals.copy(), []
    for name in dict.fromkeys(table["observatory"]):
        try:
            there = receiver_position(spectra[name], utc)
        except NoDataError as error:
            remarks.append(f"Without a position: {error}")
            continue
        if there.flag:
            remarks.append(
                f"{name}: the position in its file is {there.difference_km:.0f} km from the ephemeris, which is used"
            )
        if there.source == "file":
            rows = table["observatory"] == name
            table.loc[rows, ["x_rsun", "y_rsun", "z_rsun"]] = there.position_rsun
    return table, remarks


def _stated_when(spectrum: xr.Dataset) -> str:
    """Of which times a spectrum states positions, in words; empty where it states none."""
    if POSITION not in spectrum:
        return ""
    known = spectrum["time"].to_numpy()[np.isfinite(spectrum[POSITION].to_numpy()).all(axis=1)]
    if not known.size:
        return ""
    first, last = (np.datetime_as_string(one, "s") for one in (known[0], known[-1]))
    return f" (its file states positions from {first} to {last}, which count for half an hour more)"


def _stated_rsun(spectrum: xr.Dataset, instant: TimeArray) -> FloatArray | None:
    if POSITION not in spectrum:
        return None
    stated = spectrum[POSITION]
    placed_km = positions_at(instant, spectrum["time"].to_numpy(), stated.to_numpy())
    if not np.isfinite(placed_km).all():
        return None
    return np.asarray(_in_hee(placed_km / R_SUN_KM, str(stated.attrs["frame"]).lower(), instant[0])[0])


def positions_at(time: TimeArray, known: TimeArray, position_km: FloatArray) -> FloatArray:
    """Positions on straight lines between known ones; of a single one, that one.

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
    if not instants.size:
        return np.full((time.size, 3), np.nan)
    if instants.size == 1:  # it stands still for as long as it counts
        is_near = np.abs(_seconds(time, instants[0])) <= REACH_S
        return np.where(is_near[:, None], np.asarray(position_km[usable[first]], dtype=np.float64), np.nan)
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
