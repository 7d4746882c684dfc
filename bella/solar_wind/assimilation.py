"""Solar wind of one rotation from speeds measured in situ, with a correlated model error: one posterior for all uses.

The logarithm of the speed at a place is that of a steady wind, which follows from its speeds at an inner boundary in
equal bins of Carrington longitude, plus a model error: streams evolve, the acceleration is uncertain, and structures
of hours are not modelled. Boundary and model error are Gaussian before the data, so the speeds at any places and times
have a joint Gaussian posterior. The cost is that of weak-constraint variational assimilation (strong constraint: Lang
& Owens 2019, Space Weather 17, 59, doi:10.1029/2018SW001857), minimised by Gauss-Newton.

The numbers below are measured. Correlation lengths and the ratio of the sizes: largest probability of the speeds of a
spacecraft given the two others, hourly speeds at L1, STEREO-A and STEREO-B in 11 rotations of 2011-07 to 2014-05,
without 2012-03 to 2012-08. Common size: rms of z of 1 when one spacecraft is left out, in the rotations around
2012-05-11, 2012-07-05 and 2012-07-17. The result is judged on other rotations, see docs/wind-validation.md.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
import pandas as pd

from bella.exceptions import NoDataError
from bella.heliosphere import SIDEREAL_ROTATION_D, SYNODIC_ROTATION_D, angular_speed_rad_s
from bella.solar_wind.steady import (
    ACCELERATION_SCALE_RSUN,
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
from bella.spacecraft import hee_to, polar, position
from bella.units import R_SUN_KM, FloatArray, within_half_turn_deg

CLIMATE_KM_S, CLIMATE_SD, CLIMATE_LENGTH_DEG = 340.0, 0.17, 24.0
"""Steady part at the inner boundary: median, relative standard deviation, correlation length. Measured, see above."""

EVOLUTION_SD, EVOLUTION_LENGTH_DEG, EVOLUTION_D = 0.20, 24.0, 3.7
"""Evolution of the streams: relative size, correlation length in longitude and time at the source. Measured."""

SMALL_SCALE_SD = 0.06
"""Independent relative error of each mean of about 5 h. Measured, see above."""

ACCELERATION_SD = 0.07
"""Relative error of the change of speed with distance: half of the gain that the model assumes (Riley & Lionello 2011).

An assumption: speeds near 1 au alone cannot measure it. Its correlation length is the scale of the acceleration.
"""

MAPPING_KM_S = 400.0
"""Speed by which a place is assigned its source longitude and release time in the covariance of the model error."""

BINS = 128
ITERATIONS, FULL_STEPS, RELAXATION = 10, 2, 0.7
"""Gauss-Newton steps, and the factor on those after the first two: full steps swing about the solution.

In the rotations around 2012-06-07 and 2012-07-05 the last step is below 2 km/s and changes the cost by less than 0.1.
"""

STEP = 0.003
"""Relative step of the numerical derivatives."""

SMALLEST_VARIANCE = 1e-8
"""Added to the variance of the boundary: a Gaussian that is cut off at half a turn is singular to rounding."""

HALF_ROTATION = np.timedelta64(round(0.5 * SYNODIC_ROTATION_D * 86_400), "s")
"""Speeds this long before and after a time are used: one rotation as a spacecraft sees it."""

FEWEST = 24
"""Fewest binned speeds: five days of one spacecraft."""

MAP_STEP = 6
"""Rows of the steady wind per row of a map, which is drawn and need not be finer than 6 solar radii."""


@dataclass(frozen=True)
class Places:
    """Places and times at which the speed of the wind is measured or wanted.

    Attributes
    ----------
    range_rsun, longitude_deg : ndarray, shape (N,)
        Solar radii, and Carrington longitude at `utc`, degrees.
    """

    range_rsun: FloatArray
    longitude_deg: FloatArray
    utc: npt.NDArray[np.datetime64]

    @classmethod
    def of_hee(cls, point_rsun: FloatArray, utc: np.datetime64) -> "Places":
        """Places from HEE positions of shape (N, 3), solar radii, at one time."""
        range_rsun, longitude_deg, _ = polar(hee_to("carrington", point_rsun, utc))
        return cls(range_rsun, longitude_deg, np.full(range_rsun.size, utc))

    def source(self, rotation_period_d: float, epoch_utc: np.datetime64) -> tuple[FloatArray, FloatArray]:
        """Carrington longitude, degrees, and time after an epoch, days, of the parcels at the inner boundary."""
        travel_s = (self.range_rsun - INNER_RSUN) * R_SUN_KM / MAPPING_KM_S
        turned_deg = np.degrees(angular_speed_rad_s(rotation_period_d)) * travel_s
        elapsed_d = (self.utc - epoch_utc) / np.timedelta64(1, "s") / 86_400.0
        return self.longitude_deg + turned_deg, elapsed_d - travel_s / 86_400.0


@dataclass(frozen=True)
class Speeds:
    """Joint posterior of speeds: log-normal, with the covariance of the logarithms.

    Attributes
    ----------
    ln_km_s : ndarray, shape (N,)
        Mean of the logarithm of the speed; NaN at places outside the wind.
    covariance : ndarray, shape (N, N)
        Of the logarithms, that is of relative errors; NaN likewise.
    """

    ln_km_s: FloatArray
    covariance: FloatArray

    @property
    def mean_km_s(self) -> FloatArray:
        """Mean speeds, shape (N,)."""
        return np.asarray(np.exp(self.ln_km_s + 0.5 * np.diag(self.covariance)))

    @property
    def sd_km_s(self) -> FloatArray:
        """Standard deviations of the speeds, shape (N,)."""
        return np.asarray(self.mean_km_s * np.sqrt(np.expm1(np.diag(self.covariance))))


@dataclass(frozen=True)
class LeftOut:
    """Test of the wind at one spacecraft whose own speeds were left out.

    Attributes
    ----------
    climate_rmse_km_s, rmse_km_s : float
        Root mean square difference from the measured speeds, of the climate alone and of the wind of the others.
    z_rms : float
        Root mean square of that difference over its stated standard deviation: 1 where the errors are right.
    """

    climate_rmse_km_s: float
    rmse_km_s: float
    z_rms: float


@dataclass(frozen=True)
class WindAssimilation:
    """Solar wind of one rotation with its errors.

    Attributes
    ----------
    wind : SteadyWind
        Most probable steady part; :meth:`speeds` and :meth:`map_at` add the model error.
    left_out : dict of str to LeftOut
        By spacecraft.
    rotation_period_d : float
        Sidereal, days.
    around_utc : numpy.datetime64
        Middle of the rotation.
    """

    wind: SteadyWind
    left_out: dict[str, LeftOut]
    rotation_period_d: float
    around_utc: np.datetime64
    _linear: "_Linear" = field(repr=False)
    _measured: Places = field(repr=False)
    _weights: FloatArray = field(repr=False)
    _precision: FloatArray = field(repr=False)

    def speeds(self, places: Places) -> Speeds:
        """Speeds at places, as means over some hours, with all errors and their correlation."""
        inside = (places.range_rsun >= INNER_RSUN - 1e-6) & (places.range_rsun <= OUTER_RSUN)
        wanted = Places(places.range_rsun[inside], places.longitude_deg[inside], places.utc[inside])
        mean, sensitivity = self._linear.at(wanted)
        cross = self._linear.covariance(wanted, sensitivity, self._measured, self._linear.sensitivity)
        prior = self._linear.covariance(wanted, sensitivity, wanted, sensitivity)
        prior += SMALL_SCALE_SD**2 * np.eye(len(mean))
        logarithm, covariance = np.full(inside.size, np.nan), np.full((inside.size, inside.size), np.nan)
        logarithm[inside] = mean + cross @ self._weights
        covariance[np.ix_(inside, inside)] = prior - cross @ self._precision @ cross.T
        return Speeds(logarithm, covariance)

    def map_at(self, utc: np.datetime64) -> SteadyWind:
        """Median speed everywhere at one time, by the Carrington longitudes of that time."""
        range_rsun, longitude_deg = self.wind.range_rsun[::MAP_STEP], self.wind.longitude_deg
        distance, longitude = (one.ravel() for one in np.meshgrid(range_rsun, longitude_deg, indexing="ij"))
        places = Places(distance, longitude, np.full(distance.size, utc))
        mean, sensitivity = self._linear.at(places)
        cross = self._linear.covariance(places, sensitivity, self._measured, self._linear.sensitivity)
        speed = np.exp(mean + cross @ self._weights).reshape(range_rsun.size, longitude_deg.size)
        return SteadyWind(range_rsun, longitude_deg, speed)

    def boundary(self) -> Speeds:
        """Speeds at the inner boundary in the middle of the rotation, by Carrington longitude."""
        longitude = self.wind.longitude_deg
        inner = np.full(longitude.size, INNER_RSUN)
        return self.speeds(Places(inner, longitude, np.full(longitude.size, self.around_utc)))


def assimilate_wind(
    speeds: Mapping[str, pd.Series], around_utc: np.datetime64, rotation_period_d: float = SIDEREAL_ROTATION_D
) -> WindAssimilation:
    """Solar wind from hourly speeds of spacecraft over one rotation around a time.

    Parameters
    ----------
    speeds : mapping of str to pandas.Series
        By observatory, km/s by UTC, as :func:`bella.solar_wind.hourly_speeds` reads them.
    around_utc : numpy.datetime64
        Middle of the rotation.
    rotation_period_d : float
        Sidereal, days.

    Raises
    ------
    NoDataError
        If there are too few speeds in that rotation, or the ephemeris lacks a spacecraft.
    """
    binned = [_binned(name, series, around_utc) for name, series in speeds.items()]
    seen = pd.concat(binned, ignore_index=True) if binned else pd.DataFrame({"speed_km_s": []})
    if len(seen) < FEWEST:
        raise NoDataError(f"{len(seen)} speeds in the rotation around {around_utc}: at least {FEWEST} are needed")
    utc = seen["utc"].to_numpy().astype("datetime64[ns]")
    measured = Places(seen["range_rsun"].to_numpy(), seen["longitude_deg"].to_numpy(), utc)
    observed = np.log(seen["speed_km_s"].to_numpy())
    boundary = np.full(BINS, np.log(CLIMATE_KM_S))
    for iteration in range(ITERATIONS):
        linear = _linearised(boundary, measured, around_utc, rotation_period_d)
        total = linear.total_covariance()
        weights = np.linalg.solve(total, observed - linear.mean)
        step = np.log(CLIMATE_KM_S) + _climate() @ linear.sensitivity.T @ weights - boundary
        boundary = boundary + step * (1.0 if iteration < FULL_STEPS else RELAXATION)
        boundary = np.clip(boundary, np.log(SLOWEST_KM_S), np.log(FASTEST_KM_S))
    return WindAssimilation(
        wind=steady_wind(np.exp(boundary), rotation_period_d=rotation_period_d),
        left_out=_left_out(seen["observatory"].to_numpy(), observed, linear.mean, total),
        rotation_period_d=rotation_period_d,
        around_utc=around_utc,
        _linear=linear,
        _measured=measured,
        _weights=weights,
        _precision=np.asarray(np.linalg.inv(total), dtype=np.float64),
    )


@dataclass(frozen=True)
class _Linear:
    """The steady wind as a linear function of the logarithms of the boundary speeds, and all covariances before data.

    `cube` holds the speeds of winds at the point of expansion and with one boundary speed changed each; `offset` is the
    climate less the point of expansion; `mean` and `sensitivity` are those at the measured places.
    """

    grid_rsun: FloatArray
    cube: FloatArray
    offset: FloatArray
    epoch_utc: np.datetime64
    rotation_period_d: float
    measured: Places
    mean: FloatArray = field(default_factory=lambda: np.empty(0))
    sensitivity: FloatArray = field(default_factory=lambda: np.empty((0, BINS)))

    def at(self, places: Places) -> tuple[FloatArray, FloatArray]:
        """Mean of the logarithm of the speed before the data, (N,), and its derivatives by the boundary, (N, L)."""
        ln = np.log(interpolated(self.cube, self.grid_rsun, places.range_rsun, places.longitude_deg))
        sensitivity = (ln[:, 1:] - ln[:, :1]) / STEP
        return ln[:, 0] + sensitivity @ self.offset, sensitivity

    def covariance(self, one: Places, of_one: FloatArray, other: Places, of_other: FloatArray) -> FloatArray:
        """Covariance before the data of the logarithms of the speeds at two sets of places, without small scales."""
        (source, release), (source_2, release_2) = (
            places.source(self.rotation_period_d, self.epoch_utc) for places in (one, other)
        )
        apart_deg = within_half_turn_deg(source[:, None] - source_2)
        apart_d = np.abs(release[:, None] - release_2)
        apart_rsun = one.range_rsun[:, None] - other.range_rsun
        evolution = EVOLUTION_SD**2 * np.exp(-0.5 * (apart_deg / EVOLUTION_LENGTH_DEG) ** 2 - apart_d / EVOLUTION_D)
        acceleration = ACCELERATION_SD**2 * np.exp(-0.5 * (apart_rsun / ACCELERATION_SCALE_RSUN) ** 2)
        return np.asarray(of_one @ _climate() @ of_other.T + evolution + acceleration)

    def total_covariance(self) -> FloatArray:
        """Covariance before the data of the logarithms of the measured speeds."""
        total = self.covariance(self.measured, self.sensitivity, self.measured, self.sensitivity)
        return total + SMALL_SCALE_SD**2 * np.eye(len(self.mean))


def _linearised(boundary: FloatArray, measured: Places, epoch_utc: np.datetime64, rotation_period_d: float) -> _Linear:
    beside = np.column_stack([boundary, boundary[:, None] + STEP * np.eye(BINS)])
    grid, cube = marched(np.exp(beside), INNER_RSUN, OUTER_RSUN, rotation_period_d)
    offset = np.log(CLIMATE_KM_S) - boundary
    empty = _Linear(grid, cube, offset, epoch_utc, rotation_period_d, measured)
    return _Linear(grid, cube, offset, epoch_utc, rotation_period_d, measured, *empty.at(measured))


def _climate() -> FloatArray:
    """Covariance of the logarithms of the boundary speeds before the data, shape (L, L)."""
    longitude = boundary_longitudes_deg(BINS)
    apart = within_half_turn_deg(longitude[:, None] - longitude)
    covariance = CLIMATE_SD**2 * np.exp(-0.5 * (apart / CLIMATE_LENGTH_DEG) ** 2)
    return np.asarray(covariance + SMALLEST_VARIANCE * np.eye(BINS))


def _left_out(
    observatory: npt.NDArray[np.object_], observed: FloatArray, mean: FloatArray, total: FloatArray
) -> dict[str, LeftOut]:
    """Each spacecraft predicted from the others, with the sensitivities of the fit to all."""
    found = {}
    for name in dict.fromkeys(observatory):
        out = observatory == name
        gain = np.linalg.solve(total[np.ix_(~out, ~out)], total[np.ix_(~out, out)]).T
        predicted = Speeds(
            mean[out] + gain @ (observed - mean)[~out],
            total[np.ix_(out, out)] - gain @ total[np.ix_(~out, out)],
        )
        climate = Speeds(mean[out], total[np.ix_(out, out)])
        speed = np.exp(observed[out])
        off, off_climate = speed - predicted.mean_km_s, speed - climate.mean_km_s
        rms = [float(np.sqrt(np.mean(one**2))) for one in (off_climate, off, off / predicted.sd_km_s)]
        found[str(name)] = LeftOut(*rms)
    return found


def _binned(name: str, series: pd.Series, around_utc: np.datetime64) -> pd.DataFrame:
    """Mean speed of a spacecraft in each of `BINS` equal parts of a rotation, with its place and time."""
    half = HALF_ROTATION
    utc = series.index.to_numpy().astype("datetime64[ns]")
    inside = (utc >= around_utc - half) & (utc < around_utc + half) & np.isfinite(series.to_numpy())
    columns = ["observatory", "range_rsun", "longitude_deg", "utc", "speed_km_s"]
    if not inside.any():
        return pd.DataFrame(columns=columns)
    utc, speed = utc[inside], series.to_numpy(dtype=np.float64)[inside]
    part = ((utc - (around_utc - half)) / (2 * half) * BINS).astype(int)
    seconds = (utc - utc[0]) / np.timedelta64(1, "s")
    means = pd.DataFrame({"part": part, "s": seconds, "speed_km_s": speed}).groupby("part").mean()
    middle = utc[0] + np.rint(means["s"].to_numpy() * 1e9).astype("timedelta64[ns]")
    range_rsun, longitude_deg, _ = polar(position(name, middle, "carrington"))
    rows = (name, range_rsun, longitude_deg % 360.0, middle, means["speed_km_s"].to_numpy())
    frame = pd.DataFrame(dict(zip(columns, rows, strict=True)))
    return frame[frame["range_rsun"].between(INNER_RSUN, OUTER_RSUN)]
