"""Scattering of radio waves in the wind: how far out and how late a source appears, by a model with a name.

Waves near the plasma frequency are scattered by density fluctuations until the wind is thin enough to let them go. The
source then appears where they were last scattered, outside the place of emission, and its peak is late (Kontar et al.
2019, ApJ 884, 122, doi:10.3847/1538-4357/ab40bb; Chen et al. 2023, A&A 680, A1, doi:10.1051/0004-6361/202347185). A
localisation that knows nothing of this gives the apparent source: with the model ``none`` that is what results are
called. The other models are simulations for the nominal turbulence of Kontar et al. 2023, ApJ 956, 112,
doi:10.3847/1538-4357/acf6c1. Twice or half that turbulence changes the apparent distance by 10 to 25 per cent, and the
delay by a factor of 2 to 3. The delay is that of the peak; an edge on the rise is delayed by less, so that corrected
emission times are lower limits.
"""

from dataclasses import dataclass
from functools import cache
from importlib.resources import as_file, files

import numpy as np
import pandas as pd

from bella.exceptions import InputError
from bella.units import FloatArray

NONE = "none"
TABLE = "published_scattering.csv"
SOURCE = "Kontar et al. 2023, ApJ 956, 112, doi:10.3847/1538-4357/acf6c1"


@dataclass(frozen=True)
class ScatteringModel:
    """How scattering displaces and delays a source.

    Attributes
    ----------
    name : str
    source : str
        Where its numbers come from; empty for ``none``.
    harmonic : int
        1 or 2, the emission it is for; 0 for ``none``.
    frequency_mhz : ndarray, shape (K,)
        Ascending.
    outward : ndarray, shape (K,)
        Apparent distance from the Sun over that of the emission.
    late_s : ndarray, shape (K,)
        Delay of the peak against free propagation, s.
    """

    name: str
    source: str
    harmonic: int
    frequency_mhz: FloatArray
    outward: FloatArray
    late_s: FloatArray

    @property
    def label(self) -> str:
        """What a result of this model is called."""
        return "apparent source" if self.name == NONE else f"source corrected for scattering ({self.name})"

    def radius_factor(self, frequency_mhz: FloatArray) -> FloatArray:
        """Apparent distance over the distance of the emission.

        Parameters
        ----------
        frequency_mhz : numpy.ndarray
            MHz, any shape.

        Returns
        -------
        numpy.ndarray
            The shape of `frequency_mhz`; 1 for ``none``, NaN where nothing was simulated.
        """
        return self._looked_up(frequency_mhz, self.outward, without=1.0)

    def delay_s(self, frequency_mhz: FloatArray) -> FloatArray:
        """Delay of the peak by scattering.

        Parameters
        ----------
        frequency_mhz : numpy.ndarray
            MHz, any shape.

        Returns
        -------
        numpy.ndarray
            s, the shape of `frequency_mhz`; 0 for ``none``, NaN where nothing was simulated.
        """
        return self._looked_up(frequency_mhz, self.late_s, without=0.0)

    def _looked_up(self, frequency_mhz: FloatArray, values: FloatArray, without: float) -> FloatArray:
        frequency = np.asarray(frequency_mhz, dtype=np.float64)
        if self.name == NONE:
            return np.full(frequency.shape, without)
        # powers of the frequency between the simulated ones
        logs = np.interp(np.log(frequency), np.log(self.frequency_mhz), np.log(values), left=np.nan, right=np.nan)
        return np.asarray(np.exp(logs))


@dataclass(frozen=True)
class CorrectedSource:
    """Where and when a burst was emitted, by a model of scattering.

    Attributes
    ----------
    range_rsun : ndarray, shape (F,)
        Distance of the emission from the Sun, solar radii; NaN where the model says nothing.
    emission_s : ndarray, shape (F,)
        On the time axis of the input.
    label : str
        ``apparent source`` where nothing was corrected.
    source : str
        Where the numbers of the model come from.
    """

    range_rsun: FloatArray
    emission_s: FloatArray
    label: str
    source: str


def scattering_model(name: str) -> ScatteringModel:
    """Model of scattering by its name.

    Parameters
    ----------
    name : str
        One of ``none``, ``kontar-2023-fundamental``, ``kontar-2023-harmonic``.

    Returns
    -------
    ScatteringModel

    Raises
    ------
    InputError
        If there is no such model.
    """
    models = _models()
    if name not in models:
        raise InputError(f"scattering model {name!r} is not known: use one of {', '.join(models)}")
    return models[name]


@cache
def _models() -> dict[str, ScatteringModel]:
    with as_file(files("bella.tracks") / TABLE) as path:
        table = pd.read_csv(path, comment="#").sort_values("frequency_mhz")
    nothing = np.empty(0)
    models = [ScatteringModel(NONE, "", 0, nothing, nothing, nothing)]
    for harmonic, name in ((1, "kontar-2023-fundamental"), (2, "kontar-2023-harmonic")):
        rows = table[table["harmonic"] == harmonic]
        frequency, late = (rows[column].to_numpy(dtype=np.float64) for column in ("frequency_mhz", "delay_s"))
        outward = (rows["apparent_rsun"] / rows["emission_rsun"]).to_numpy(dtype=np.float64)
        models.append(ScatteringModel(name, SOURCE, harmonic, frequency, outward, late))
    return {model.name: model for model in models}


def corrected_source(
    range_rsun: FloatArray, emission_s: FloatArray, frequency_mhz: FloatArray, model: ScatteringModel
) -> CorrectedSource:
    """Distance and time of the emission behind apparent ones.

    Parameters
    ----------
    range_rsun, emission_s, frequency_mhz : numpy.ndarray, shape (F,)
        Apparent distance from the Sun, emission time of the localisation, and frequency.
    model : ScatteringModel

    Returns
    -------
    CorrectedSource

    Raises
    ------
    InputError
        If the shapes differ.

    Notes
    -----
    The longitude stays: simulated sources move along the field as well as outward (Clarkson et al. 2025, Sci. Rep. 15,
    doi:10.1038/s41598-025-95270-w), by an angle that depends on where the spacecraft are.
    """
    if not np.shape(range_rsun) == np.shape(emission_s) == np.shape(frequency_mhz):
        raise InputError("distances, times and frequencies differ in shape: give one of each for every frequency")
    return CorrectedSource(
        np.asarray(range_rsun / model.radius_factor(frequency_mhz)),
        np.asarray(emission_s - model.delay_s(frequency_mhz)),
        model.label,
        model.source,
    )
