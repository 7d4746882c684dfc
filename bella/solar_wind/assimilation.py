"""From speeds measured in situ to the speeds near the Sun that explain them, with their errors.

The state is the speed in equal bins of Carrington longitude at an inner boundary; the prior is a climate (a mean, a
spread, and a correlation in longitude); the cost is that of strong-constraint variational assimilation (Lang & Owens
2019, Space Weather 17, 59, doi:10.1029/2018SW001857), minimised here by Gauss-Newton, whose last step holds the
variance of the posterior. The wind is taken as steady in the frame of the Sun for one rotation around the time asked
for; a transient in that rotation is a misfit.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from bella.exceptions import NoDataError
from bella.heliosphere import SIDEREAL_ROTATION_D, SYNODIC_ROTATION_D
from bella.solar_wind.steady import (
    FASTEST_KM_S,
    INNER_RSUN,
    OUTER_RSUN,
    SLOWEST_KM_S,
    SteadyWind,
    boundary_longitudes_deg,
    interpolated,
    marched,
    steady_wind,
)
from bella.spacecraft import position
from bella.units import FloatArray, within_half_turn_deg

PRIOR_KM_S, PRIOR_SD_KM_S, PRIOR_WIDTH_DEG = 350.0, 90.0, 15.0
"""Climate of the wind at the inner boundary: mean, spread, and the width of its Gaussian correlation."""

RELATIVE_ERROR = 0.1
"""Error of an observation, the model's included, as a share of it (Lang & Owens 2019)."""

BINS = 128
ITERATIONS = 8
STEP_KM_S = 1.0
HALF_ROTATION = np.timedelta64(round(0.5 * SYNODIC_ROTATION_D * 86_400), "s")
"""Speeds this long before and after a time are used: as long as the Sun takes to turn once below a spacecraft."""

FEWEST = 24
"""Fewer binned speeds than this say next to nothing about a rotation."""


@dataclass(frozen=True)
class WindAssimilation:
    """Inner boundary that explains speeds in situ.

    Attributes
    ----------
    wind : SteadyWind
        The wind everywhere, of the most probable boundary.
    boundary_km_s, boundary_sd_km_s : ndarray, shape (L,)
        Speed at the inner boundary and the square root of its posterior variance, km/s.
    boundary_covariance_km2_s2 : ndarray, shape (L, L)
    prior_rmse_km_s, rmse_km_s : dict of str to float
        Root mean square misfit of each spacecraft before and after, km/s.
    rotation_period_d : float
        Sidereal, days.
    around_utc : numpy.datetime64
        Middle of the rotation.
    """

    wind: SteadyWind
    boundary_km_s: FloatArray
    boundary_sd_km_s: FloatArray
    boundary_covariance_km2_s2: FloatArray
    prior_rmse_km_s: dict[str, float]
    rmse_km_s: dict[str, float]
    rotation_period_d: float
    around_utc: np.datetime64


def assimilate_wind(
    speeds: Mapping[str, pd.Series], around_utc: np.datetime64, rotation_period_d: float = SIDEREAL_ROTATION_D
) -> WindAssimilation:
    """Speeds at the inner boundary from hourly speeds of spacecraft over one rotation around a time.

    Parameters
    ----------
    speeds : mapping of str to pandas.Series
        By observatory, km/s by UTC, as :func:`bella.solar_wind.hourly_speeds` reads them.
    around_utc : numpy.datetime64
        Middle of the rotation.
    rotation_period_d : float
        Sidereal, days.

    Returns
    -------
    WindAssimilation

    Raises
    ------
    NoDataError
        If there are too few speeds in that rotation, or the ephemeris lacks a spacecraft.
    """
    binned = [_binned(name, series, around_utc) for name, series in speeds.items()]
    seen = pd.concat(binned, ignore_index=True) if binned else pd.DataFrame({"speed_km_s": []})
    if len(seen) < FEWEST:
        raise NoDataError(f"{len(seen)} speeds in the rotation around {around_utc}: at least {FEWEST} are needed")
    prior = np.full(BINS, PRIOR_KM_S)
    boundary, covariance = _gauss_newton(seen, prior, rotation_period_d)
    wind = steady_wind(boundary, rotation_period_d=rotation_period_d)
    return WindAssimilation(
        wind=wind,
        boundary_km_s=boundary,
        boundary_sd_km_s=np.sqrt(np.diag(covariance)),
        boundary_covariance_km2_s2=covariance,
        prior_rmse_km_s=_rmse(seen, steady_wind(prior, rotation_period_d=rotation_period_d)),
        rmse_km_s=_rmse(seen, wind),
        rotation_period_d=rotation_period_d,
        around_utc=around_utc,
    )


def drawn_winds(found: WindAssimilation, draws: int, seed: int) -> list[SteadyWind]:
    """Winds of boundaries drawn from the posterior.

    Parameters
    ----------
    found : WindAssimilation
    draws : int
    seed : int

    Returns
    -------
    list of SteadyWind
        With the rotation period that was assimilated with.
    """
    random = np.random.default_rng(seed)
    drawn = random.multivariate_normal(found.boundary_km_s, found.boundary_covariance_km2_s2, draws, method="cholesky")
    boundaries = np.clip(drawn.T, SLOWEST_KM_S, FASTEST_KM_S)
    range_rsun, speed = marched(boundaries, INNER_RSUN, OUTER_RSUN, found.rotation_period_d)
    return [SteadyWind(range_rsun, found.wind.longitude_deg, speed[:, :, one]) for one in range(draws)]


def _binned(name: str, series: pd.Series, around_utc: np.datetime64) -> pd.DataFrame:
    """Mean speed of a spacecraft in each of as many equal spans of a rotation as there are bins, and where it was."""
    half = HALF_ROTATION
    utc = series.index.to_numpy().astype("datetime64[ns]")
    inside = (utc >= around_utc - half) & (utc < around_utc + half) & np.isfinite(series.to_numpy())
    if not inside.any():
        return pd.DataFrame({"observatory": [], "range_rsun": [], "longitude_deg": [], "speed_km_s": []})
    utc, speed = utc[inside], series.to_numpy(dtype=np.float64)[inside]
    span = ((utc - (around_utc - half)) / (2 * half) * BINS).astype(int)
    seconds = (utc - utc[0]) / np.timedelta64(1, "s")
    means = pd.DataFrame({"span": span, "s": seconds, "speed_km_s": speed}).groupby("span").mean()
    middle = utc[0] + np.rint(means["s"].to_numpy() * 1e9).astype("timedelta64[ns]")
    place = position(name, middle, "carrington")
    frame = pd.DataFrame(
        {
            "observatory": name,
            "range_rsun": np.linalg.norm(place, axis=1),
            "longitude_deg": np.degrees(np.arctan2(place[:, 1], place[:, 0])) % 360.0,
            "speed_km_s": means["speed_km_s"].to_numpy(),
        }
    )
    return frame[frame["range_rsun"].between(INNER_RSUN, OUTER_RSUN)]  # near the Sun there is no wind to compare with


def _predicted(seen: pd.DataFrame, boundaries: FloatArray, rotation_period_d: float) -> FloatArray:
    """Speeds that winds of shape (L, W) bring to the spacecraft, shape (N, W)."""
    grid, speed = marched(boundaries, INNER_RSUN, OUTER_RSUN, rotation_period_d)
    return interpolated(speed, grid, seen["range_rsun"].to_numpy(), seen["longitude_deg"].to_numpy())


def _prior_root() -> FloatArray:
    """Lower triangle L of the prior covariance, L L' = B, km/s."""
    longitude = boundary_longitudes_deg(BINS)
    apart = within_half_turn_deg(longitude[:, None] - longitude)
    covariance = PRIOR_SD_KM_S**2 * np.exp(-0.5 * (apart / PRIOR_WIDTH_DEG) ** 2)
    # a Gaussian cut off at half a turn is singular to rounding
    return np.asarray(np.linalg.cholesky(covariance + 1e-6 * PRIOR_SD_KM_S**2 * np.eye(BINS)), dtype=np.float64)


def _gauss_newton(seen: pd.DataFrame, prior: FloatArray, rotation_period_d: float) -> tuple[FloatArray, FloatArray]:
    """Most probable boundary and its covariance; the unknowns are w = L^-1 (x - x_prior), whose prior is 1."""
    root, observed = _prior_root(), seen["speed_km_s"].to_numpy()
    white: FloatArray = np.zeros(BINS)
    boundary = prior
    for _ in range(ITERATIONS):
        beside = boundary[:, None] + STEP_KM_S * np.eye(BINS)
        speeds = _predicted(seen, np.column_stack([boundary, beside]), rotation_period_d)
        sensitivity = (speeds[:, 1:] - speeds[:, :1]) / STEP_KM_S @ root / (RELATIVE_ERROR * observed)[:, None]
        misfit = (observed - speeds[:, 0]) / (RELATIVE_ERROR * observed) + sensitivity @ white
        precision = np.eye(BINS) + sensitivity.T @ sensitivity
        white = np.asarray(np.linalg.solve(precision, sensitivity.T @ misfit), dtype=np.float64)
        boundary = np.clip(prior + root @ white, SLOWEST_KM_S, FASTEST_KM_S)
    return boundary, np.asarray(root @ np.linalg.solve(precision, root.T), dtype=np.float64)


def _rmse(seen: pd.DataFrame, wind: SteadyWind) -> dict[str, float]:
    """Root mean square misfit by spacecraft, km/s."""
    off = seen["speed_km_s"] - wind.at(seen["range_rsun"].to_numpy(), seen["longitude_deg"].to_numpy())
    return {str(name): float(np.sqrt((part**2).mean())) for name, part in off.groupby(seen["observatory"])}
