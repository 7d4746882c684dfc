"""From the ecliptic of J2000 to the frames positions are published in: HEE, HEEQ, Carrington and HCI.

All are right-handed, with the Sun at the origin. HEE and HEEQ have Earth in their XZ plane and turn by a degree a day;
Carrington turns with the Sun; HCI (heliocentric inertial) does not turn.
"""

from functools import cache

import numpy as np
import numpy.typing as npt

from bella.exceptions import InputError
from bella.units import DAY_S, FloatArray

FRAMES = ("hee", "heeq", "carrington", "hci")
"""Frames by the names that options and columns use."""

J2000 = np.datetime64("2000-01-01T12:00:00", "ns")
JULIAN_CENTURY_S = 36_525.0 * 86_400.0
ARCSEC = np.pi / 648_000.0
TT_MINUS_UTC_S = 68.0
"""Within 2 s from 2006 on; the Sun turns by 0.0003 deg in that time."""

OBLIQUITY_RAD = 84_381.448 * ARCSEC
"""Ecliptic of J2000 against the equator of the ICRF (Lieske et al. 1977; what SPICE and Horizons rotate by)."""

SOLAR_INCLINATION_DEG = 7.25
SOLAR_NODE_DEG = 75.76
CARRINGTON_W0_DEG = 84.176
CARRINGTON_RATE_DEG_D = 14.1844


def ecliptic_pole(utc: np.datetime64) -> FloatArray:
    """North pole of the mean ecliptic of date, in the mean ecliptic and equinox of J2000.

    The plane tilts by 0.47 arcsec a year: 3 arcsec by 2006, 13 arcsec (0.014 solar radii at 1 au) by 2028.

    Parameters
    ----------
    utc : numpy.datetime64
        The date; the 69 s between UTC and TT do not matter here.

    Returns
    -------
    numpy.ndarray
        Unit vector, shape (3,).

    Notes
    -----
    Inclination and node of the moving ecliptic: Capitaine, Wallace & Chapront 2003, A&A 412, 567,
    doi:10.1051/0004-6361:20031539. The quadratic term of the node moves the pole by less than 1e-4 arcsec in a century.
    """
    centuries = (utc - J2000) / np.timedelta64(1, "s") / JULIAN_CENTURY_S
    inclination = (46.998973 * centuries - 0.0334926 * centuries**2) * ARCSEC
    node = (629_546.7936 - 867.95758 * centuries) * ARCSEC
    return _pole(inclination, node)


def _pole(inclination: float, node: float) -> FloatArray:
    """Normal of a plane with this inclination and ascending node, rad."""
    sine = np.sin(inclination)
    return np.array([np.sin(node) * sine, -np.cos(node) * sine, np.cos(inclination)])


def solar_pole() -> FloatArray:
    """Rotation axis of the Sun, in the mean ecliptic and equinox of J2000.

    Returns
    -------
    numpy.ndarray
        Unit vector, shape (3,).

    Notes
    -----
    Inclination 7.25 deg and node 75.76 deg + 1.397 deg per century: Fraenz & Harper 2002, Planet. Space Sci. 50, 217,
    doi:10.1016/S0032-0633(01)00119-2; Thompson 2006, A&A 449, 791, doi:10.1051/0004-6361:20054262. The rate is that of
    the equinox of date from which the node is counted; against the equinox of J2000, used here, the axis stands still.
    """
    return _pole(np.radians(SOLAR_INCLINATION_DEG), np.radians(SOLAR_NODE_DEG))


def hee_axes(earth: FloatArray, utc: np.datetime64) -> FloatArray:
    """Axes of HEE at one date: X to Earth, Z as near to ecliptic north as X allows, Y completes.

    Parameters
    ----------
    earth : numpy.ndarray
        Heliocentric position of Earth in the ecliptic of J2000, shape (3,), any unit.
    utc : numpy.datetime64
        The date of the frame.

    Returns
    -------
    numpy.ndarray
        Shape (3, 3), rows X, Y, Z: ``positions @ axes.T`` takes J2000 ecliptic to HEE.

    Raises
    ------
    InputError
        If `earth` has no length.

    Notes
    -----
    Thompson 2006, A&A 449, 791, doi:10.1051/0004-6361:20054262, section 3.2.
    """
    x = _direction(earth, "HEE")
    pole = ecliptic_pole(utc)
    z = pole - (pole @ x) * x
    z = z / np.linalg.norm(z)
    return np.stack([x, np.cross(z, x), z])


def heeq_axes(earth: FloatArray) -> FloatArray:
    """Axes of HEEQ: Z along the Sun's rotation axis, Earth in the XZ plane on the side of X.

    Longitude in HEEQ is Stonyhurst longitude.

    Parameters
    ----------
    earth : numpy.ndarray
        Heliocentric position of Earth in the ecliptic of J2000, shape (3,), any unit.

    Returns
    -------
    numpy.ndarray
        Shape (3, 3), rows X, Y, Z: ``positions @ axes.T`` takes J2000 ecliptic to HEEQ.

    Raises
    ------
    InputError
        If `earth` has no length.

    Notes
    -----
    Thompson 2006, A&A 449, 791, doi:10.1051/0004-6361:20054262, section 3.2.
    """
    return _about_the_solar_axis(_direction(earth, "HEEQ"))


@cache
def hci_axes() -> FloatArray:
    """Axes of HCI: Z along the Sun's rotation axis, X to the ascending node of its equator on the ecliptic of J2000.

    Returns
    -------
    numpy.ndarray
        Shape (3, 3), rows X, Y, Z: ``positions @ axes.T`` takes J2000 ecliptic to HCI.

    Notes
    -----
    Fraenz & Harper 2002, Planet. Space Sci. 50, 217, doi:10.1016/S0032-0633(01)00119-2, section 3.2.2.
    """
    node = np.radians(SOLAR_NODE_DEG)
    return _about_the_solar_axis(np.array([np.cos(node), np.sin(node), 0.0]))


def carrington_axes(utc: np.datetime64) -> FloatArray:
    """Axes of the Carrington frame: Z along the Sun's rotation axis, X to the prime meridian at this instant.

    Geometric: where the meridian is, not where it is seen. Tables for observers at Earth, such as L0 of the
    Astronomical Almanac, allow for the light time, and so have longitudes that are larger by 0.082 deg.

    Parameters
    ----------
    utc : numpy.datetime64
        The instant.

    Returns
    -------
    numpy.ndarray
        Shape (3, 3), rows X, Y, Z: ``positions @ axes.T`` takes J2000 ecliptic to Carrington.

    Notes
    -----
    Prime meridian 84.176 deg + 14.1844 deg/day from the node of the solar equator on the equator of the ICRF: Archinal
    et al. 2011, Celest. Mech. Dyn. Astron. 109, 101, doi:10.1007/s10569-010-9320-4.
    """
    days = ((utc - J2000) / np.timedelta64(1, "s") + TT_MINUS_UTC_S) / DAY_S
    meridian = np.radians((CARRINGTON_W0_DEG + CARRINGTON_RATE_DEG_D * days) % 360.0)
    celestial_pole = np.array([0.0, np.sin(OBLIQUITY_RAD), np.cos(OBLIQUITY_RAD)])
    from_node = _about_the_solar_axis(np.cross(celestial_pole, solar_pole()))
    return _turned(from_node, meridian)


def _turned(axes: FloatArray, angle: float) -> FloatArray:
    """The same axes, turned eastward about their Z."""
    x = np.cos(angle) * axes[0] + np.sin(angle) * axes[1]
    return np.stack([x, np.cross(axes[2], x), axes[2]])


def _about_the_solar_axis(towards: FloatArray) -> FloatArray:
    """Z along the solar axis, and X as near to a direction as Z allows."""
    z = solar_pole()
    y = np.cross(z, towards)
    y = y / np.linalg.norm(y)
    return np.stack([np.cross(y, z), y, z])


def _direction(earth: FloatArray, frame: str) -> FloatArray:
    distance = np.linalg.norm(earth)
    if not distance > 0.0:
        raise InputError(f"{frame} needs the position of Earth: give a vector from the Sun that is longer than zero")
    return np.asarray(earth / distance, dtype=np.float64)


def frame_axes(frame: str, earth: FloatArray, utc: np.datetime64) -> FloatArray:
    """Axes of a frame by its name.

    Parameters
    ----------
    frame : str
        One of ``FRAMES``; capitals do not matter.
    earth : numpy.ndarray
        Heliocentric position of Earth in the ecliptic of J2000 at `utc`, shape (3,), any unit.
    utc : numpy.datetime64
        The date of the frame.

    Returns
    -------
    numpy.ndarray
        Shape (3, 3), rows X, Y, Z: ``positions @ axes.T`` takes J2000 ecliptic to the frame.

    Raises
    ------
    InputError
        If there is no such frame, or `earth` has no length.
    """
    name = check_frame(frame)
    if name == "hee":
        return hee_axes(earth, utc)
    if name == "heeq":
        return heeq_axes(earth)
    return carrington_axes(utc) if name == "carrington" else hci_axes()


def check_frame(frame: str) -> str:
    """Name of a frame in lower case.

    Parameters
    ----------
    frame : str
        One of ``FRAMES``; capitals do not matter.

    Returns
    -------
    str
        The name as ``FRAMES`` has it.

    Raises
    ------
    InputError
        If there is no such frame.
    """
    if frame.lower() not in FRAMES:
        raise InputError(f"frame {frame!r} is not known: use one of {', '.join(FRAMES)}")
    return frame.lower()


def polar(point_rsun: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Distance, longitude and latitude of points of any frame.

    Parameters
    ----------
    point_rsun : numpy.ndarray, shape (N, 3)

    Returns
    -------
    range_rsun, longitude_deg, latitude_deg : numpy.ndarray, shape (N,)
        Longitude -180 to 180 degrees.
    """
    x, y, z = points_of(point_rsun).T
    in_plane = np.hypot(x, y)
    return np.hypot(in_plane, z), np.degrees(np.arctan2(y, x)), np.degrees(np.arctan2(z, in_plane))


def cartesian(range_rsun: npt.ArrayLike, longitude_deg: npt.ArrayLike, latitude_deg: npt.ArrayLike) -> FloatArray:
    """Points from distance, longitude and latitude: the inverse of :func:`polar`.

    Parameters
    ----------
    range_rsun, longitude_deg, latitude_deg : array_like
        Broadcast to shape (N,).

    Returns
    -------
    numpy.ndarray, shape (N, 3)
    """
    longitude, latitude = np.radians(longitude_deg), np.radians(latitude_deg)
    x, y, z = np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)
    shape = np.broadcast_shapes(np.shape(range_rsun), np.shape(x), np.shape(z))
    unit = np.stack([np.broadcast_to(axis, shape) for axis in (x, y, z)], axis=-1)
    return np.asarray(np.asarray(range_rsun, dtype=np.float64)[..., None] * unit).reshape(-1, 3)


def points_of(point: npt.ArrayLike) -> FloatArray:
    """Points as an array of three coordinates each.

    Returns
    -------
    numpy.ndarray, shape (N, 3)

    Raises
    ------
    InputError
        If they are anything else.
    """
    points = np.asarray(point, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"points of shape {points.shape} are not N x 3: give x, y and z for each")
    return points
