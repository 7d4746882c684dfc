"""Positions of Earth and of the spacecraft, in HEE and solar radii.

The table that comes with the package holds few nodes; a cubic spline through them meets the positions it was made from
within 25 km (0.1 ms of light). Those positions are 3 h apart: between them, near the perihelia of Parker Solar Probe,
a cubic is good to about 200 km.
"""

from functools import cache
from importlib import resources
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr
from scipy.interpolate import CubicSpline

from bella.exceptions import InputError, NoDataError
from bella.spacecraft.frames import hee_axes
from bella.units import R_SUN_KM, FloatArray

FRAME = "HEE"
BODIES = ("EARTH", "ACE", "STEREO-A", "STEREO-B", "PSP", "SOLO")
"""What the table has nodes for."""

OBSERVATORIES = ("WIND", "STEREO-A", "STEREO-B", "PSP", "SOLO")
"""Spacecraft with radio receivers whose position is known here."""

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


@cache
def _trajectories() -> dict[str, _Trajectory]:
    with (
        resources.as_file(resources.files("bella.spacecraft") / "ephemeris.nc") as path,
        xr.open_dataset(path, engine="h5netcdf", decode_times=False) as table,
    ):
        stops = np.cumsum(table["node_count"].to_numpy())
        slices = [slice(stop - count, stop) for stop, count in zip(stops, table["node_count"].to_numpy(), strict=True)]
        time_ns, position_km = table["time"].to_numpy() * MS_NS, table["position"].to_numpy().astype(np.float64)
        names = [str(name) for name in table["body"].to_numpy()]
    return {name: _trajectory(time_ns[part], position_km[part]) for name, part in zip(names, slices, strict=True)}


def _trajectory(time_ns: npt.NDArray[np.int64], position_km: FloatArray) -> _Trajectory:
    start, stop = REFERENCE + time_ns[[0, -1]].astype("timedelta64[ns]")
    return _Trajectory(Coverage(start, stop), CubicSpline(time_ns / DAY_NS, position_km))


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
    return _trajectories()[_body(observatory)].coverage


def _ecliptic_km(observatory: str, utc: Instants) -> FloatArray:
    trajectory = _trajectories()[_body(observatory)]
    start, stop = trajectory.coverage
    outside = ~((utc >= start) & (utc <= stop))
    if outside.any():
        moment, first, last = (np.datetime_as_string(t, unit="s") for t in (utc[outside][0], start, stop))
        raise NoDataError(
            f"the ephemeris has {observatory} from {first}Z to {last}Z, not at {moment}Z: "
            "give its HEE position in columns x_rsun, y_rsun, z_rsun"
        )
    scale = WIND_FRACTION_OF_EARTH if observatory == "WIND" else 1.0
    return scale * np.asarray(trajectory.spline_km((utc - REFERENCE).astype(np.int64) / DAY_NS), dtype=np.float64)


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


def _covers(observatory: str, moment: np.datetime64) -> bool:
    start, stop = coverage(observatory)
    return bool(start <= moment <= stop)


def fleet(utc: np.datetime64) -> pd.DataFrame:
    """Positions of all observatories the ephemeris has at one instant.

    Parameters
    ----------
    utc : numpy.datetime64
        The instant, UTC; also the epoch of the frame.

    Returns
    -------
    pandas.DataFrame
        Columns observatory, x_rsun, y_rsun, z_rsun, range_rsun, longitude_deg (HEE, in (-180, 180]), latitude_deg.

    Raises
    ------
    NoDataError
        If the ephemeris has no position of Earth then.
    """
    moment = _instants(utc)[0]
    present = [name for name in OBSERVATORIES if name == "WIND" or _covers(name, moment)]
    x, y, z = np.concatenate([position_hee(name, moment, moment) for name in present]).T
    range_rsun = np.sqrt(x**2 + y**2 + z**2)
    longitude_deg, latitude_deg = np.degrees(np.arctan2(y, x)), np.degrees(np.arcsin(z / range_rsun))
    columns = {"x_rsun": x, "y_rsun": y, "z_rsun": z, "range_rsun": range_rsun}
    return pd.DataFrame(
        {"observatory": present, **columns, "longitude_deg": longitude_deg, "latitude_deg": latitude_deg}
    )
