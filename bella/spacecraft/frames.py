"""From the ecliptic of J2000 to Heliocentric Earth Ecliptic (HEE)."""

import numpy as np

from bella.exceptions import InputError
from bella.units import FloatArray

J2000 = np.datetime64("2000-01-01T12:00:00", "ns")
JULIAN_CENTURY_S = 36_525.0 * 86_400.0
ARCSEC = np.pi / 648_000.0


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
    Inclination and node of the moving ecliptic, linear and quadratic terms: Capitaine, Wallace & Chapront 2003,
    A&A 412, 567, doi:10.1051/0004-6361:20031539.
    """
    centuries = (utc - J2000) / np.timedelta64(1, "s") / JULIAN_CENTURY_S
    inclination = (46.998973 * centuries - 0.0334926 * centuries**2) * ARCSEC
    node = (629_546.7936 - 867.95758 * centuries + 0.157992 * centuries**2) * ARCSEC
    sine = np.sin(inclination)
    return np.array([np.sin(node) * sine, -np.cos(node) * sine, np.cos(inclination)])


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
    distance = np.linalg.norm(earth)
    if not distance > 0.0:
        raise InputError("HEE needs the position of Earth: give a vector from the Sun that is longer than zero")
    x = earth / distance
    pole = ecliptic_pole(utc)
    z = pole - (pole @ x) * x
    z = z / np.linalg.norm(z)
    return np.stack([x, np.cross(z, x), z])
