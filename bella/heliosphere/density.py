"""Electron density of corona and solar wind, the plasma frequency it stands for, and where a frequency comes from.

Densities are in cm^-3, distances in solar radii from the centre of the Sun. Emission is at the plasma frequency
(harmonic 1) or at twice it (harmonic 2).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import constants

from bella.exceptions import InputError
from bella.units import AU_RSUN, FloatArray

PLASMA_KHZ_CM32 = float(
    np.sqrt(1e6 * constants.e**2 / (constants.epsilon_0 * constants.m_e)) / (2 * np.pi) / constants.kilo
)
"""Plasma frequency of one electron per cm^3, kHz (8.97866; CODATA)."""

RANGE_LIMITS_RSUN = (1.0, 400.0)
"""Where a frequency is looked for."""
BISECTIONS = 60
CORONA_RSUN = 10.0
"""Models of the corona alone say nothing farther out than this."""


@dataclass(frozen=True)
class DensityModel:
    """Electron density against distance.

    Attributes
    ----------
    source : str
        Author, year, DOI.
    density_cm3 : callable
        Density at a distance in solar radii, cm^-3; falls with distance.
    corona_only : bool
        True where the model tends to a constant and says nothing of the solar wind.
    """

    name: str
    source: str
    density_cm3: Callable[[FloatArray], FloatArray]
    corona_only: bool = False


def _powers(*terms: tuple[float, float]) -> Callable[[FloatArray], FloatArray]:
    """Sum of powers of the distance, each a factor and an exponent."""
    return lambda range_rsun: np.asarray(sum(factor * range_rsun**exponent for factor, exponent in terms))


def _newkirk(range_rsun: FloatArray) -> FloatArray:
    return np.asarray(4.2e4 * 10.0 ** (4.32 / range_rsun))


def _mann(range_rsun: FloatArray) -> FloatArray:
    return np.asarray(8.775e8 * np.exp(9.88 * (1 / range_rsun - 1)))


DENSITY_MODELS = {
    model.name: model
    for model in (
        DensityModel(
            "leblanc",
            "Leblanc, Dulk & Bougeret 1998, Sol. Phys. 183, 165, doi:10.1023/A:1005049730506",
            _powers((3.3e5, -2.0), (4.1e6, -4.0), (8.0e7, -6.0)),
        ),
        DensityModel(
            "saito",
            "Saito, Poland & Munro 1977, Sol. Phys. 55, 121, doi:10.1007/BF00150879, equator",
            _powers((1.36e6, -2.14), (1.68e8, -6.13)),
        ),
        DensityModel(
            "parker",
            "Parker's wind, as coded with Canizares et al. 2024, A&A 684, A182, doi:10.1051/0004-6361/202347747",
            _powers((1.39e6, -2.3), (3e8, -6.0), (4.8e9, -14.0)),
        ),
        DensityModel("newkirk", "Newkirk 1961, ApJ 133, 983, doi:10.1086/147104", _newkirk, corona_only=True),
        DensityModel(
            "mann", "Mann & Klassen 2005, A&A 441, 319, doi:10.1051/0004-6361:20034396", _mann, corona_only=True
        ),
    )
}
"""Models by name, with coefficients as they are commonly cited."""


def plasma_frequency_mhz(density_cm3: FloatArray, harmonic: int = 1) -> FloatArray:
    """Frequency of emission at an electron density.

    Parameters
    ----------
    density_cm3 : numpy.ndarray
        Any shape, cm^-3.
    harmonic : int
        1 or 2.

    Returns
    -------
    numpy.ndarray
        MHz, the shape of `density_cm3`.
    """
    return np.asarray(harmonic * PLASMA_KHZ_CM32 * np.sqrt(density_cm3) / 1e3)


def emission_frequency_mhz(range_rsun: FloatArray, model: DensityModel, harmonic: int = 1) -> FloatArray:
    """Frequency of emission at a distance from the Sun.

    Parameters
    ----------
    range_rsun : numpy.ndarray
        Solar radii, any shape.
    harmonic : int
        1 or 2.

    Returns
    -------
    numpy.ndarray
        MHz, the shape of `range_rsun`.
    """
    return plasma_frequency_mhz(model.density_cm3(np.asarray(range_rsun, dtype=np.float64)), harmonic)


def emission_range_rsun(frequency_mhz: FloatArray, model: DensityModel, harmonic: int = 1) -> FloatArray:
    """Distance from the Sun at which a model emits a frequency.

    Parameters
    ----------
    frequency_mhz : numpy.ndarray
        MHz, any shape.
    harmonic : int
        1 or 2.

    Returns
    -------
    numpy.ndarray
        Solar radii, the shape of `frequency_mhz`.

    Raises
    ------
    InputError
        If the model does not reach a frequency within `RANGE_LIMITS_RSUN`.
    """
    frequency = np.asarray(frequency_mhz, dtype=np.float64)
    low, high = (np.full(frequency.shape, limit) for limit in RANGE_LIMITS_RSUN)
    reached = (frequency <= emission_frequency_mhz(low, model, harmonic)) & (
        frequency >= emission_frequency_mhz(high, model, harmonic)
    )
    if not reached.all():
        raise InputError(
            f"the density model {model.name!r} has no {frequency[~reached].flat[0]:g} MHz between "
            f"{RANGE_LIMITS_RSUN[0]:g} and {RANGE_LIMITS_RSUN[1]:g} solar radii; leave that frequency out"
        )
    for _ in range(BISECTIONS):
        middle = np.sqrt(low * high)
        beyond = emission_frequency_mhz(middle, model, harmonic) < frequency
        low, high = np.where(beyond, low, middle), np.where(beyond, middle, high)
    return np.asarray(np.sqrt(low * high))


def projected_range_rsun(frequency_mhz: FloatArray, density_1au_cm3: float, harmonic: int = 1) -> FloatArray:
    """Distance at which a density measured at 1 au, falling as 1/r^2, emits a frequency.

    Parameters
    ----------
    frequency_mhz : numpy.ndarray
        MHz, any shape.
    density_1au_cm3 : float
        cm^-3.
    harmonic : int
        1 or 2.

    Returns
    -------
    numpy.ndarray
        Solar radii, the shape of `frequency_mhz`.
    """
    at_1au_mhz = plasma_frequency_mhz(np.array(density_1au_cm3), harmonic)
    return np.asarray(AU_RSUN * at_1au_mhz / np.asarray(frequency_mhz, dtype=np.float64))
