"""Positions of Earth and of the spacecraft, in solar radii.

The table that comes with the package holds few nodes; a cubic spline through them meets the positions it was made from
within 25 km (0.1 ms of light). Those positions are 3 h apart: between them, near the perihelia of Parker Solar Probe,
a cubic is good to about 200 km.

A second table may go on where the first one ends (:func:`extend_with`). Where both have a body, the first one is used,
so that positions of bursts that are in the catalogue stay as they are.
"""

from functools import cache, lru_cache
from importlib import resources
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr
from scipy.interpolate import CubicSpline

from bella.exceptions import InputError, NoDataError, StoreError
from bella.spacecraft.frames import frame_axes, hee_axes, polar
from bella.units import C_RSUN_S, R_SUN_KM, FloatArray

FRAME = "HEE"
BODIES = ("EARTH", "ACE", "STEREO-A", "STEREO-B", "PSP", "SOLO")
"""What the table has nodes for."""

OBSERVATORIES = ("WIND", "STEREO-A", "STEREO-B", "PSP", "SOLO")
"""Spacecraft with radio receivers whose position is known here."""

ENDED = frozenset({"STEREO-B"})
"""Of them, those that nobody has positions of any more: contact with STEREO-B was lost on 2014-10-01."""

WIND_FRACTION_OF_EARTH = 0.99
"""Wind is put on the line from the Sun to Earth, at this fraction of Earth's distance (L1).

Its own orbit is not in the table. The codes BELLA and SEMP do the same; since 2004 Wind has circled L1 within about
``WIND_SYSTEMATIC_RSUN``, which is 2.3 s of light.
"""

WIND_SYSTEMATIC_RSUN = 1.0
"""How far Wind may be from where it is put, solar radii."""

REFERENCE = np.datetime64("2000-01-01", "ns")
MS_NS = 1_000_000
DAY_NS = 86_400 * 1_000_000_000

Instants = npt.NDArray[np.datetime64]


class Coverage(NamedTuple):
    """First and last instant, UTC, both inclusive."""

    start: np.datetime64
    stop: np.datetime64


class _Trajectory(NamedTuple):
    coverage: Coverage
    spline_km: CubicSpline


_extension: list[Path] = []
"""The table that goes on where the packaged one ends, or nothing."""


def extend_with(path: Path | None) -> None:
    """Take positions after the end of the packaged table from another one, from now on.

    Parameters
    ----------
    path : Path or None
        Table in the form of the packaged one; it may not exist yet. None: the packaged table alone.
    """
    _extension[:] = [] if path is None else [path]


@cache
def _packaged() -> dict[str, _Trajectory]:
    with resources.as_file(resources.files("bella.spacecraft") / "ephemeris.nc") as path:
        return _trajectories(path)


def _continued() -> dict[str, _Trajectory]:
    """Trajectories after the end of the packaged table; read again where the file was replaced."""
    if not _extension or not _extension[0].is_file():
        return {}
    return _as_written(_extension[0], _extension[0].stat().st_mtime_ns)


@lru_cache(1)
def _as_written(path: Path, _changed_ns: int) -> dict[str, _Trajectory]:
    return _trajectories(path)


def _trajectories(path: Path) -> dict[str, _Trajectory]:
    return {name: _trajectory(time_ms * MS_NS, where_km) for name, (time_ms, where_km) in read_nodes(path).items()}


def read_nodes(path: Path) -> dict[str, tuple[npt.NDArray[np.int64], FloatArray]]:
    """Nodes of a table.

    Parameters
    ----------
    path : Path
        netCDF file in the form that :func:`bella.spacecraft.encode.to_dataset` gives.

    Returns
    -------
    dict
        By body: ms after 2000-01-01, shape (N,), and km in the mean ecliptic and equinox of J2000, shape (N, 3).

    Raises
    ------
    StoreError
        If the file is damaged.
    """
    try:
        with xr.open_dataset(path, engine="h5netcdf", decode_times=False) as table:
            stops = np.cumsum(table["node_count"].to_numpy())[:-1]
            time_ms, position_km = table["time"].to_numpy(), table["position"].to_numpy().astype(np.float64)
            names = [str(name) for name in table["body"].to_numpy()]
        return dict(zip(names, zip(np.split(time_ms, stops), np.split(position_km, stops), strict=True), strict=True))
    except (OSError, KeyError, ValueError, RuntimeError) as error:
        reason = " ".join(str(error).split())
        raise StoreError(
            f"ephemeris {path} cannot be read ({reason}): remove it, then bella update-ephemeris"
        ) from error


def _trajectory(time_ns: npt.NDArray[np.int64], position_km: FloatArray) -> _Trajectory:
    start, stop = REFERENCE + time_ns[[0, -1]].astype("timedelta64[ns]")
    return _Trajectory(Coverage(start, stop), CubicSpline(time_ns / DAY_NS, position_km))


def packaged_coverage(body: str) -> Coverage:
    """When the table that comes with the package has a body.

    Parameters
    ----------
    body : str
        One of ``BODIES``.

    Returns
    -------
    Coverage
        First and last instant, UTC.

    Raises
    ------
    InputError
        If the ephemeris does not know the body.
    """
    return _packaged()[_body(body)].coverage


def packaged_km(body: str, utc: Instants) -> FloatArray:
    """Positions of a body from the table that comes with the package.

    Parameters
    ----------
    body : str
        One of ``BODIES``.
    utc : numpy.ndarray of datetime64
        Instants inside its coverage, shape (N,).

    Returns
    -------
    numpy.ndarray
        Shape (N, 3), km, mean ecliptic and equinox of J2000.
    """
    days = (utc - REFERENCE).astype("timedelta64[ns]").astype(np.int64) / DAY_NS
    return np.asarray(_packaged()[body].spline_km(days), dtype=np.float64)


def _body(observatory: str) -> str:
    body = "EARTH" if observatory == "WIND" else observatory
    if body not in BODIES:
        raise InputError(
            f"the ephemeris does not know observatory {observatory!r} (known: {', '.join(OBSERVATORIES)}): "
            "give its HEE position in columns x_rsun, y_rsun, z_rsun"
        )
    return body


def coverage(observatory: str) -> Coverage:
    """When the ephemeris knows the position of an observatory.

    Parameters
    ----------
    observatory : str
        One of ``OBSERVATORIES`` or ``BODIES``.

    Returns
    -------
    Coverage
        First and last instant, UTC.

    Raises
    ------
    InputError
        If the ephemeris does not know the observatory.
    """
    body = _body(observatory)
    start, stop = _packaged()[body].coverage
    more = _continued().get(body)
    return Coverage(start, stop if more is None or more.coverage.start > stop else max(stop, more.coverage.stop))


def _ecliptic_km(observatory: str, utc: Instants) -> FloatArray:
    start, stop = coverage(observatory)
    outside = ~((utc >= start) & (utc <= stop))
    if outside.any():
        moment, first, last = (np.datetime_as_string(t, unit="s") for t in (utc[outside][0], start, stop))
        is_later = bool(utc[outside][0] > stop) and observatory not in ENDED
        advice = "ask for later ones with bella update-ephemeris, or give" if is_later else "give"
        raise NoDataError(
            f"the ephemeris has {observatory} from {first}Z to {last}Z, not at {moment}Z: "
            f"{advice} its HEE position in columns x_rsun, y_rsun, z_rsun"
        )
    scale = WIND_FRACTION_OF_EARTH if observatory == "WIND" else 1.0
    return scale * _spline_km(_body(observatory), utc)


def _spline_km(body: str, utc: Instants) -> FloatArray:
    found = packaged_km(body, utc)
    later = utc > _packaged()[body].coverage.stop
    if later.any():
        found[later] = _continued()[body].spline_km((utc[later] - REFERENCE).astype(np.int64) / DAY_NS)
    return found


def _instants(utc: npt.ArrayLike) -> Instants:
    instants = np.atleast_1d(np.asarray(utc, dtype="datetime64[ns]"))
    if np.isnat(instants).any():
        raise InputError("an instant for the ephemeris is missing (NaT): give UTC times such as 2012-06-07T19:30:00")
    return instants


def position_hee(observatory: str, utc: npt.ArrayLike, epoch: np.datetime64) -> FloatArray:
    """Positions of an observatory at its own times, all in the HEE frame of one epoch.

    HEE turns by a degree a day; over a burst it is held fixed at the epoch, so that positions and light paths are those
    of an inertial frame.

    Parameters
    ----------
    observatory : str
        One of ``OBSERVATORIES`` or ``BODIES``.
    utc : array_like of datetime64
        Instants, UTC, shape (N,) or one instant.
    epoch : numpy.datetime64
        UTC instant whose direction to Earth is the X axis.

    Returns
    -------
    numpy.ndarray
        Shape (N, 3), solar radii.

    Raises
    ------
    InputError
        If the ephemeris does not know the observatory, or an instant is NaT.
    NoDataError
        If an instant is outside the time the ephemeris covers for it, or `epoch` outside that of Earth.
    """
    moment = _instants(epoch)
    axes = hee_axes(_ecliptic_km("EARTH", moment)[0], moment[0])
    return _ecliptic_km(observatory, _instants(utc)) @ axes.T / R_SUN_KM


def position(observatory: str, utc: npt.ArrayLike, frame: str = "hee") -> FloatArray:
    """Positions of an observatory, each in the frame of its own instant.

    Parameters
    ----------
    observatory : str
        One of ``OBSERVATORIES`` or ``BODIES``.
    utc : array_like of datetime64
        Instants, UTC, shape (N,) or one instant.
    frame : str
        One of :data:`bella.spacecraft.frames.FRAMES`.

    Returns
    -------
    numpy.ndarray
        Shape (N, 3), solar radii.

    Raises
    ------
    InputError
        If observatory or frame is not known, or an instant is NaT.
    NoDataError
        If an instant is outside the time the ephemeris covers for the observatory or for Earth.
    """
    instants = _instants(utc)
    found, earth = _ecliptic_km(observatory, instants), _ecliptic_km("EARTH", instants)
    axes = [frame_axes(frame, *pair) for pair in zip(earth, instants, strict=True)]
    turned = np.einsum("nij,nj->ni", np.reshape(axes, (-1, 3, 3)), found)
    return np.asarray(turned / R_SUN_KM, dtype=np.float64)


def light_time_s(observatory: str, utc: npt.ArrayLike, point_rsun: npt.ArrayLike) -> FloatArray:
    """Time that light takes between a point and where an observatory is, along a straight line.

    Parameters
    ----------
    observatory : str
        One of ``OBSERVATORIES`` or ``BODIES``.
    utc : array_like of datetime64
        When the light is received, UTC, shape (N,) or one instant.
    point_rsun : array_like
        Where it comes from: HEE of the first instant, solar radii, shape (3,) or (N, 3).

    Returns
    -------
    numpy.ndarray
        Shape (N,), s.

    Raises
    ------
    InputError
        If the ephemeris does not know the observatory, an instant is NaT, or the point is not three finite numbers.
    NoDataError
        If an instant is outside the time the ephemeris covers for it.
    """
    instants = _instants(utc)
    point = np.asarray(point_rsun, dtype=np.float64)
    if point.shape not in {(3,), (instants.size, 3)} or not np.isfinite(point).all():
        raise InputError("light time needs a point: give its HEE position as x, y, z in solar radii")
    away = position_hee(observatory, instants, instants[0]) - point
    return np.asarray(np.linalg.norm(away, axis=1) / C_RSUN_S, dtype=np.float64)


def _covers(observatory: str, moment: np.datetime64) -> bool:
    start, stop = coverage(observatory)
    return bool(start <= moment <= stop)


def missing_from_fleet(utc: np.datetime64) -> dict[str, str]:
    """Observatories whose positions end before an instant.

    Parameters
    ----------
    utc : numpy.datetime64

    Returns
    -------
    dict of str to str
        Why each is missing, and what to do where something can be done.
    """
    moment = _instants(utc)[0]
    reasons = {}
    for name in OBSERVATORIES:
        stop = coverage(name).stop
        if moment > stop:
            why = "contact was lost then" if name in ENDED else "ask for later ones with bella update-ephemeris"
            reasons[name] = f"its positions end on {np.datetime_as_string(stop, unit='D')}: {why}"
    return reasons


def fleet(utc: np.datetime64, frame: str = "hee") -> pd.DataFrame:
    """Positions of all observatories the ephemeris has at one instant.

    Parameters
    ----------
    utc : numpy.datetime64
        The instant, UTC; also the epoch of the frame.
    frame : str
        One of :data:`bella.spacecraft.frames.FRAMES`.

    Returns
    -------
    pandas.DataFrame
        Columns observatory, x_rsun, y_rsun, z_rsun, range_rsun, longitude_deg, latitude_deg; attribute ``frame``.
        Longitudes are in (-180, 180], those of Carrington in [0, 360).

    Raises
    ------
    InputError
        If there is no such frame, or the instant is NaT.
    NoDataError
        If the ephemeris has no position of Earth then.
    """
    moment = _instants(utc)[0]
    present = [name for name in OBSERVATORIES if name == "WIND" or _covers(name, moment)]
    points = np.concatenate([position(name, moment, frame) for name in present])
    (x, y, z), (range_rsun, longitude_deg, latitude_deg) = points.T, polar(points)
    if frame.lower() == "carrington":
        longitude_deg = longitude_deg % 360.0
    columns = {"x_rsun": x, "y_rsun": y, "z_rsun": z, "range_rsun": range_rsun}
    table = pd.DataFrame(
        {"observatory": present, **columns, "longitude_deg": longitude_deg, "latitude_deg": latitude_deg}
    )
    table.attrs["frame"] = frame.lower()
    return table
