"""Scattering of radio waves in the wind: how far out and how late a source appears, and what that makes of a track.

Waves near the plasma frequency are scattered by density fluctuations until the wind is thin enough to let them go. The
source then appears where they were last scattered, outside the place of emission, and its peak is late (Kontar et al.
2019, ApJ 884, 122, doi:10.3847/1538-4357/ab40bb; Chen et al. 2023, A&A 680, A1, doi:10.1051/0004-6361/202347185).
Positions and fits are those of the apparent source. What is corrected here follows simulations for the nominal
turbulence of Kontar et al. 2023, once for the fundamental and once for the harmonic, as it is not known which was
received. The delay is that of the peak; an edge on the rise is delayed by less.

The sign of scattering is a density excess: a frequency stands for a density, a distance for the density of a model
there, and their ratio is 1 where source and model agree.
"""

import math
from dataclasses import dataclass
from functools import cache
from importlib.resources import as_file, files
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from bella.arrivals import evenly_spread
from bella.exceptions import InputError
from bella.flags import APPARENT_SOURCE
from bella.heliosphere import DENSITY_MODELS, DensityModel, angular_speed_rad_s
from bella.heliosphere.density import CORONA_RSUN, PLASMA_KHZ_CM32
from bella.heliosphere.parker import SPIRAL_ORIGIN_RSUN
from bella.heliosphere.polar import planar_positions, polar_covariance
from bella.records import finite
from bella.tracks.fit import TrackFit, summary
from bella.units import R_SUN_KM, FloatArray, within_half_turn_deg

HARMONICS = {"fundamental": 1, "harmonic": 2}
TABLE = "published_scattering.csv"
SOURCE = "Kontar et al. 2023, ApJ 956, 112, doi:10.3847/1538-4357/acf6c1"
NOT_IN_ERRORS = (
    "half or twice the nominal turbulence: apparent distances differ by 10 to 25 per cent, delays by a factor of 2 to 3"
)
DIRECTION_KEPT = "the source is moved outward only, its longitude stays"

TURBULENCE_SD = 0.17
"""Relative error of the apparent distance from turbulence that is known within a factor of 2: the middle of the 10 to
25 per cent by which the simulations of Kontar et al. 2023 then differ."""

HARMONIC_SHARE = 0.5
"""Probability that the harmonic was received: not known, so as likely as the fundamental."""

PAPER_BAND_MHZ = (0.15, 2.0)
"""Band of the published localisations (Canizares et al. 2024, doi:10.1051/0004-6361/202347747)."""

REFERENCE = DENSITY_MODELS["leblanc"]
"""Density model that the excess refers to (Leblanc et al. 1998, doi:10.1023/A:1005049730506)."""

SHOWN_FREQUENCIES, FEWEST_FREQUENCIES = 5, 3
"""Frequencies of the companions, and fewest through which a corrected spiral is drawn."""


@dataclass(frozen=True)
class ScatteringModel:
    """Simulated sources at some frequencies; between them everything is a power of the frequency.

    Attributes
    ----------
    frequency_mhz : ndarray, shape (K,)
        Ascending.
    emission_rsun, apparent_rsun : ndarray, shape (K,)
        Distance from the Sun of the emission, and of the apparent source.
    late_s : ndarray, shape (K,)
        Delay of the peak against free propagation.
    """

    name: str
    frequency_mhz: FloatArray
    emission_rsun: FloatArray
    apparent_rsun: FloatArray
    late_s: FloatArray

    def radius_factor(self, frequency_mhz: FloatArray) -> FloatArray:
        """Apparent distance over the distance of the emission; NaN where nothing was simulated."""
        return self._between(frequency_mhz, self.apparent_rsun / self.emission_rsun)

    def delay_s(self, frequency_mhz: FloatArray) -> FloatArray:
        """Delay of the peak by scattering; NaN where nothing was simulated."""
        return self._between(frequency_mhz, self.late_s)

    def wind_ratio(self, band_mhz: tuple[float, float]) -> float:
        """Speed of the wind on the apparent spiral of the simulated sources over that on the true one.

        Parameters
        ----------
        band_mhz : (float, float)
            Lowest and highest frequency; the part of it that was simulated counts.

        Returns
        -------
        float
            Slope of the apparent on the true distance, as both have the same longitude. NaN for a band beyond.
        """
        low, high = np.clip(band_mhz, self.frequency_mhz[0], self.frequency_mhz[-1])
        if not low < high:
            return math.nan
        frequency_mhz = np.geomspace(low, high, self.frequency_mhz.size)
        true = self._between(frequency_mhz, self.emission_rsun)
        return float(_line(true, self._between(frequency_mhz, self.apparent_rsun))[0])

    def _between(self, frequency_mhz: FloatArray, values: FloatArray) -> FloatArray:
        at, known = np.log(np.asarray(frequency_mhz, dtype=np.float64)), np.log(self.frequency_mhz)
        return np.asarray(np.exp(np.interp(at, known, np.log(values), left=np.nan, right=np.nan)))


@cache
def scattering_models() -> dict[str, ScatteringModel]:
    """Simulated scattering of the ``fundamental`` and of the ``harmonic``."""
    with as_file(files("bella.tracks") / TABLE) as path:
        table = pd.read_csv(path, comment="#").sort_values("frequency_mhz")
    columns = ("frequency_mhz", "emission_rsun", "apparent_rsun", "delay_s")
    return {
        word: ScatteringModel(
            f"kontar-2023-{word}", *table.loc[table["harmonic"] == harmonic, columns].to_numpy(dtype=np.float64).T
        )
        for word, harmonic in HARMONICS.items()
    }


def apparent_over_true(band_mhz: tuple[float, float] = PAPER_BAND_MHZ) -> tuple[float, float]:
    """Speed of the wind on the apparent spiral of a burst over that of the wind that carries its field.

    Parameters
    ----------
    band_mhz : (float, float)
        Lowest and highest frequency of the burst.

    Returns
    -------
    tuple of float
        Mean and standard deviation, over fundamental and harmonic and over turbulence within a factor of 2.

    Raises
    ------
    InputError
        If nothing was simulated in the band.

    Notes
    -----
    For sources that are moved outward only. Moved along the field (Clarkson et al. 2025, Sci. Rep. 15,
    doi:10.1038/s41598-025-95270-w) they would stay on the true spiral, and the ratio be 1.
    """
    ratio = np.array([model.wind_ratio(band_mhz) for model in scattering_models().values()])
    if not np.isfinite(ratio).all():
        raise InputError(f"no scattering was simulated from {band_mhz[0]:g} to {band_mhz[1]:g} MHz: leave it out")
    share = np.array([1 - HARMONIC_SHARE, HARMONIC_SHARE])
    mean = float(share @ ratio)
    variance = float(share @ ((1 + TURBULENCE_SD**2) * ratio**2)) - mean**2
    return mean, math.sqrt(variance)


def density_excess(
    frequency_mhz: FloatArray, range_rsun: FloatArray, harmonic: int, model: DensityModel = REFERENCE
) -> FloatArray:
    """Density that frequencies stand for over that of a model at their sources.

    Parameters
    ----------
    frequency_mhz, range_rsun : numpy.ndarray
        Frequencies, and distances of their sources from the Sun; one shape.
    harmonic : int
        1 where a wave has the plasma frequency, 2 where it has twice that.

    Returns
    -------
    numpy.ndarray
        That shape; NaN at or below the surface of the Sun, and beyond the corona for models of it.

    Raises
    ------
    InputError
        If the shapes differ.
    """
    frequency, distance = np.asarray(frequency_mhz, dtype=np.float64), np.asarray(range_rsun, dtype=np.float64)
    if frequency.shape != distance.shape:
        raise InputError("frequencies and distances differ in shape: give a distance for every frequency")
    farthest = CORONA_RSUN if model.corona_only else np.inf
    known = (distance > 1.0) & (distance <= farthest)
    expected = np.where(known, model.density_cm3(np.where(known, distance, 2.0)), np.nan)
    return np.asarray((frequency * 1e3 / (harmonic * PLASMA_KHZ_CM32)) ** 2 / expected)


def density_companion(posterior: xr.Dataset) -> dict[str, Any]:
    """How much denser than a model the wind would be, if the sources were where they appear, at a few frequencies.

    Parameters
    ----------
    posterior : xarray.Dataset
        A solution of :func:`bella.multilateration.localise`.

    Returns
    -------
    dict
        Ready for JSON: model and rows with frequency, distance and its error, and the ratio of densities, for
        fundamental and harmonic; None where the model gives no density.
    """
    frequency, distance, sd = _apparent(posterior)
    rows: list[dict[str, Any]] = [
        {"frequency_mhz": f, "range_rsun": finite(r), "range_sd_rsun": finite(s)}
        for f, r, s in zip(frequency.tolist(), distance, sd, strict=True)
    ]
    for word, harmonic in HARMONICS.items():
        for row, excess in zip(rows, _excess(frequency, distance, sd, harmonic), strict=True):
            row[word] = excess
    return {"model": f"density of frequency over that of {REFERENCE.name} at the source", "rows": rows, "flags": []}


def _apparent(posterior: xr.Dataset) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A few frequencies of a solution, the distances of their sources, and the errors of these."""
    frequency = posterior["frequency"].to_numpy().astype(np.float64)
    if not frequency.size:
        raise InputError("there are no positions: localise a burst first")
    some = evenly_spread(frequency, SHOWN_FREQUENCIES)
    place, covariance = polar_covariance(*planar_positions(posterior.isel(frequency=some)))
    return frequency[some], place[:, 0], np.sqrt(covariance[:, 0, 0])


def _excess(
    frequency_mhz: FloatArray, range_rsun: FloatArray, sd_rsun: FloatArray, harmonic: int
) -> list[dict[str, float | None]]:
    """Density excess at each frequency; its quantiles are those of the distance, as it grows with that."""
    at = {"mean": 0.0, "q16": -1.0, "q50": 0.0, "q84": 1.0}
    columns = {name: density_excess(frequency_mhz, range_rsun + step * sd_rsun, harmonic) for name, step in at.items()}
    return [{name: finite(one[row]) for name, one in columns.items()} for row in range(frequency_mhz.size)]


def scattering_companion(posterior: xr.Dataset, fit: TrackFit) -> dict[str, Any]:
    """Sources behind the apparent ones at the frequencies of the density excess, and the spiral through them.

    Parameters
    ----------
    posterior : xarray.Dataset
        A solution of :func:`bella.multilateration.localise`.
    fit : TrackFit
        Of the same burst; may be without draws.

    Returns
    -------
    dict
        Ready for JSON: ``rows`` with frequency, apparent distance and for fundamental and harmonic the corrected
        distance with its error, the delay of the peak and the density excess that is left; None where nothing was
        simulated. ``joint`` holds longitude and wind of the corrected spiral by harmonic, empty without draws.
    """
    frequency, distance, sd = _apparent(posterior)
    known = np.isfinite(distance)
    frequency, distance, sd = frequency[known], distance[known], sd[known]
    rows: list[dict[str, Any]] = [
        {"frequency_mhz": f, "apparent_rsun": r, "apparent_sd_rsun": finite(s)}
        for f, r, s in zip(frequency.tolist(), distance.tolist(), sd, strict=True)
    ]
    for word, model in scattering_models().items():
        factor, late_s = model.radius_factor(frequency), model.delay_s(frequency)
        left = _excess(frequency, distance / factor, sd / factor, HARMONICS[word])
        for place, row in enumerate(rows):
            row[word] = {
                "range_rsun": finite(distance[place] / factor[place]),
                "range_sd_rsun": finite(sd[place] / factor[place]),
                "delay_s": finite(late_s[place]),
                "excess": left[place],
            }
    spirals = {word: corrected_spiral(fit, model, frequency) for word, model in scattering_models().items()}
    return {
        "model": ", ".join(model.name for model in scattering_models().values()),
        "source": SOURCE,
        "apparent": APPARENT_SOURCE,
        "assumed": DIRECTION_KEPT,
        "not_in_errors": NOT_IN_ERRORS,
        "rows": rows,
        "joint": {word: spiral for word, spiral in spirals.items() if spiral},
        "flags": [],
    }


def corrected_spiral(fit: TrackFit, model: ScatteringModel, frequency_mhz: FloatArray) -> dict[str, Any]:
    """Longitude and wind of the spirals of a fit when every source is moved inward to where it was emitted.

    Parameters
    ----------
    frequency_mhz : numpy.ndarray, shape (F,)
        Where the spirals are corrected; frequencies that were not simulated are left out.

    Returns
    -------
    dict
        ``phi0_deg`` and ``v_sw_km_s`` with mean, sd and quantiles; empty without draws, or with fewer than three
        frequencies.

    Notes
    -----
    By the angle that the spiral has turned at the apparent distance r it has turned at the corrected one, r / k, so the
    wind is slower by about k.
    """
    known = frequency_mhz[np.isfinite(model.radius_factor(frequency_mhz))]
    if not fit.draws or known.size < FEWEST_FREQUENCIES:
        return {}
    apparent = fit.track.range_rsun(fit.z, fit.track.basis(known))
    longitude = np.degrees(fit.track.longitude_rad(np.radians(fit.draws["phi0_deg"]), fit.z, apparent))
    slope, phi0_deg = _line(apparent / model.radius_factor(known) - SPIRAL_ORIGIN_RSUN, longitude)
    period_d = fit.track.model.rotation_period_d
    v_sw_km_s = -np.degrees(angular_speed_rad_s(period_d)) * R_SUN_KM / slope
    middle = float(np.median(phi0_deg))
    phi0_deg += within_half_turn_deg(middle) - middle
    alike = np.full(slope.size, 1 / slope.size)
    return {
        "phi0_deg": summary(phi0_deg, alike, None).model_dump(),
        "v_sw_km_s": summary(v_sw_km_s, alike, None).model_dump(),
        "rotation_period_d": period_d,
    }


def _line(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Slope, and value at x = 0, of the regression of y on x along the last axis."""
    middle = x.mean(axis=-1, keepdims=True)
    slope = ((x - middle) * y).sum(axis=-1) / ((x - middle) ** 2).sum(axis=-1)
    return slope, y.mean(axis=-1) - slope * middle[..., 0]
