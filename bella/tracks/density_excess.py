"""How much denser the wind would be than the models have it, if the sources were where they appear.

A frequency stands for a density, a position for what a model says of the density there; their ratio is 1 where source
and model agree. Ratios of several are what scattering makes of a track (:mod:`bella.tracks.scattering`).
"""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from bella.exceptions import InputError
from bella.heliosphere import DENSITY_MODELS, DensityModel
from bella.heliosphere.density import CORONA_RSUN, PLASMA_KHZ_CM32
from bella.units import FloatArray

HARMONICS = (1, 2)


def inferred_density_cm3(frequency_mhz: FloatArray, harmonic: int) -> FloatArray:
    """Electron density that emits a frequency at the plasma frequency or at twice it.

    Parameters
    ----------
    frequency_mhz : numpy.ndarray
        MHz, any shape.
    harmonic : int
        1 or 2.

    Returns
    -------
    numpy.ndarray
        cm^-3, the shape of `frequency_mhz`.
    """
    return np.asarray((np.asarray(frequency_mhz, dtype=np.float64) * 1e3 / (harmonic * PLASMA_KHZ_CM32)) ** 2)


def density_excess(
    frequency_mhz: FloatArray,
    range_rsun: FloatArray,
    range_sd_rsun: FloatArray | None = None,
    models: Mapping[str, DensityModel] = DENSITY_MODELS,
) -> pd.DataFrame:
    """Density that the frequencies stand for over that of each model at the sources, fundamental and harmonic.

    Parameters
    ----------
    frequency_mhz, range_rsun : numpy.ndarray, shape (F,)
        Frequencies, and distances of their sources from the Sun.
    range_sd_rsun : numpy.ndarray, shape (F,), optional
        Errors of the distances; 0 without.
    models : mapping of str to DensityModel

    Returns
    -------
    pandas.DataFrame
        A row for each frequency, model and harmonic: ``frequency_mhz, range_rsun, model, harmonic, inferred_cm3,
        model_cm3, excess, excess_low, excess_high``, the last two one error of the distance inward and outward. NaN
        at or below the surface of the Sun, and beyond the corona for models of it.

    Raises
    ------
    InputError
        If the shapes differ.
    """
    frequency, distance = np.asarray(frequency_mhz, dtype=np.float64), np.asarray(range_rsun, dtype=np.float64)
    sd = np.zeros(distance.shape) if range_sd_rsun is None else np.asarray(range_sd_rsun, dtype=np.float64)
    if frequency.ndim != 1 or not frequency.shape == distance.shape == sd.shape:
        raise InputError("frequencies, distances and errors differ in shape: give one of each for every frequency")
    parts = []
    for model in models.values():
        there, inward, outward = (_model_density(model, distance + step * sd) for step in (0.0, -1.0, 1.0))
        for harmonic in HARMONICS:
            inferred = inferred_density_cm3(frequency, harmonic)
            columns = {"frequency_mhz": frequency, "range_rsun": distance, "model": model.name, "harmonic": harmonic}
            columns |= {"inferred_cm3": inferred, "model_cm3": there, "excess": inferred / there}
            parts.append(pd.DataFrame(columns | {"excess_low": inferred / inward, "excess_high": inferred / outward}))
    return pd.concat(parts, ignore_index=True)


def _model_density(model: DensityModel, range_rsun: FloatArray) -> FloatArray:
    farthest = CORONA_RSUN if model.corona_only else np.inf
    known = (range_rsun > 1.0) & (range_rsun <= farthest)
    return np.where(known, model.density_cm3(np.where(known, range_rsun, 2.0)), np.nan)
