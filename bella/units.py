"""Canonical units, and their conversion at the public edge.

Inside the package arrays are bare and carry their unit in the name (``range_rsun``, ``arrival_s``, ``frequency_mhz``).
Public functions of the physics take :class:`astropy.units.Quantity` and convert with :func:`bare`.
"""

from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
from astropy import units as u

FloatArray = npt.NDArray[np.float64]
Angle = TypeVar("Angle", float, FloatArray)

R_SUN_KM = 695_700.0
"""Nominal solar radius, km (IAU 2015 Resolution B3, Prsa et al. 2016, doi:10.3847/0004-6256/152/2/41)."""

AU_KM = 149_597_870.7
"""Astronomical unit, km (IAU 2012 Resolution B2)."""

C_KM_S = 299_792.458
"""Speed of light in vacuum, km/s (exact, SI)."""

AU_RSUN = AU_KM / R_SUN_KM
"""Astronomical unit, solar radii (215.03)."""

C_RSUN_S = C_KM_S / R_SUN_KM
"""Speed of light, solar radii per second (0.43092)."""

DAY_S = 86_400.0
"""Length of a day, s."""

RSUN = u.def_unit("Rsun", R_SUN_KM * u.km)
"""Solar radius as a unit: ``3 * RSUN``."""


def bare(value: u.Quantity, unit: Any) -> FloatArray:
    """Values of a quantity in a canonical unit.

    Parameters
    ----------
    value : astropy.units.Quantity
        Any shape.
    unit : astropy.units.Unit
        The unit to convert to.

    Returns
    -------
    numpy.ndarray
        Float64, the shape of `value`.

    Raises
    ------
    astropy.units.UnitConversionError
        If `value` is not of that physical kind.
    """
    return np.asarray(u.Quantity(value).to_value(unit), dtype=np.float64)


def within_half_turn_deg(angle_deg: Angle) -> Angle:
    """The same angle above -180 and up to 180 degrees.

    Parameters
    ----------
    angle_deg : float or numpy.ndarray
        Degrees, any shape.

    Returns
    -------
    float or numpy.ndarray
        Of that shape.
    """
    return 180.0 - (180.0 - angle_deg) % 360.0
