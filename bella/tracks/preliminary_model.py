"""Arrival times at two spacecraft as a source on a Parker spiral gives them, and all solutions on the circle.

The longitude at 1 solar radius is uniform before the data. At each of 120 longitudes the other nine parameters, which
all have Gaussian priors, are found from several starts at once by Gauss-Newton steps, and integrated out by Laplace's
approximation. The release time, and a smooth departure of the beam from its law, are in the covariance.
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.interpolate import BSpline

from bella.arrivals import ArrivalGrid
from bella.heliosphere import DENSITY_MODELS, SIDEREAL_ROTATION_D, angular_speed_rad_s, emission_range_rsun
from bella.heliosphere.parker import SPIRAL_ORIGIN_RSUN
from bella.heliosphere.scattering import LITERATURE_DELAY
from bella.units import C_RSUN_S, R_SUN_KM, FloatArray

# What is assumed of a burst.
REFERENCE_WIND_KM_S, SLOWNESS_SD = 400.0, 0.3
"""1 / v of the wind is (1 +- 0.3) / 400 km/s, the spread of winds near the ecliptic; as in the joint fit."""
BEAM_C, LN_BEAM_SD = 0.15, 0.5
"""Speed of the beam at 1 solar radius: within a factor of 1.6 of 0.15 c, the exciters of Krupar et al. 2015
(A&A 580, A137, doi:10.1051/0004-6361/201425308)."""
SLOWING, SLOWING_SD = 0.15, 0.2
"""Exponent d of the speed r^-d: between a constant beam and the 0.3 of Azzollini & Kontar 2025 (arXiv:2504.18312)."""
DEPARTURE, DEPARTURE_LN_F = 0.05, 0.5
"""A smooth departure from the beam law: this share of the time since the release, with this length in ln f."""
TRAVEL_AT_055_MHZ_S = 60.0
"""Scale of the time that a beam takes to where it emits 0.55 MHz; it goes with 1 / f."""
LEVEL_FACTOR, SLOPE_SD = 2.0, 0.25
"""Densities of a day are within a factor in distance of two of a model's (one standard deviation), and the distance may
fall with another power of the frequency."""
WIGGLE, WIGGLE_LN_F = 0.07, 0.8
"""What else distance does along frequency: smooth, 7 % with this length in ln f."""
COEFFICIENTS, DEGREE = 5, 3
"""Of the cubic spline of ln r over ln f: enough to follow every density model to 1 %."""

# What is assumed of the arrival times where the table does not say it.
SHAPE_OF_RISE = 0.2
"""Error of the edges that is smooth along frequency, in half widths of the rise: 2012-06-07 and 2020-07-21 leave 0.15
to 0.22 of their own rise where light curves differ between spacecraft."""
OFFSET_SD_S = 3.0
"""Offset that all edges of a spacecraft share: half-rise edges at 60 s and at 38 s differ by 1 to 6 s."""
FLAT_S2, LEAST_S2 = 1e8, 0.1
"""Variance of the release time, which is flat, and what is added to that of each edge: none is better than 0.3 s."""
TOO_FAR_SD, MOST_LEFT_OUT = 4.0, 0.1
"""Edges that miss what all others predict by more than this many of its errors are left out, the worst first, but at
most a tenth of them."""

# How the circle is searched.
NODES = 120
STARTS_LN_RANGE = (-1.6, -0.7, 0.0, 0.7, 1.6)
"""Distances from a fifth of to five times the prior's mean; beams are taken faster where sources are farther."""
ITERATIONS, LONGEST_STEP, CONVERGED = 40, 1.5, 2e-3
"""Steps at most, their largest component, and the one that counts as none, all in prior standard deviations."""
SAME_MODE_SD = 1.0
"""Solutions nearer to one another than this, in posterior standard deviations, are one."""
TRAVEL_NODES = 8
MOST_CHANNELS = 60
"""Channels of a spacecraft beyond this number are averaged: neighbours share their errors anyway."""

LEVEL_MHZ = 0.5
"""Where the level of the distance is stated; powers of the frequency turn about it."""


@dataclass(frozen=True)
class Rows:
    """Arrival times as a list, one row per spacecraft and channel, with the inverse root of their covariance."""

    frequency_mhz: FloatArray
    receiver_rsun: FloatArray
    arrival_s: FloatArray
    rise_s: FloatArray
    covariance_s2: FloatArray
    whitener: FloatArray


@dataclass(frozen=True)
class RangePrior:
    """Gaussian prior of the spline of ln r: knots in ln f, mean and root of the covariance of its coefficients."""

    knots: FloatArray
    mean: FloatArray
    root: FloatArray

    def basis(self, frequency_mhz: FloatArray) -> FloatArray:
        """Value of each spline at frequencies within the knots, shape (N, coefficients)."""
        inside = np.clip(np.log(frequency_mhz), self.knots[0], self.knots[-1])
        return np.asarray(BSpline.design_matrix(inside, self.knots, DEGREE).toarray())


@dataclass(frozen=True)
class Modes:
    """Solutions on the circle: longitude, parameters, weight, covariance and misfit of each."""

    phi0_rad: FloatArray
    z: FloatArray
    log_weight: FloatArray
    covariance: FloatArray
    chi2: FloatArray


def range_prior(low_mhz: float, high_mhz: float) -> RangePrior:
    """Prior of the distance against frequency, from the density models of the solar wind.

    Mean and covariance of: any of the models, fundamental or harmonic with equal weight; times a factor of two; times
    a power of the frequency; times a smooth factor.
    """
    low, high = np.log([low_mhz, high_mhz])
    inner = np.linspace(low, high, COEFFICIENTS - DEGREE + 1)[1:-1]
    prior = RangePrior(np.r_[[low] * (DEGREE + 1), inner, [high] * (DEGREE + 1)], np.zeros(0), np.zeros((0, 0)))
    log_f = np.linspace(low, high, 60)
    to_coefficients = np.linalg.pinv(prior.basis(np.exp(log_f)))
    winds = [model for model in DENSITY_MODELS.values() if not model.corona_only]
    curves = np.array([np.log(emission_range_rsun(np.exp(log_f), model, n)) for model in winds for n in (1, 2)])
    slope = log_f - np.log(LEVEL_MHZ)
    wiggle = WIGGLE**2 * np.exp(-0.5 * (np.subtract.outer(log_f, log_f) / WIGGLE_LN_F) ** 2)
    spread = np.cov(curves.T, bias=True) + np.log(LEVEL_FACTOR) ** 2 + SLOPE_SD**2 * np.outer(slope, slope) + wiggle
    covariance = to_coefficients @ spread @ to_coefficients.T + 1e-8 * np.eye(COEFFICIENTS)
    return replace(prior, mean=to_coefficients @ curves.mean(axis=0), root=np.linalg.cholesky(covariance))


class ArrivalModel:
    """Arrival times of a burst for any parameters, and their derivatives.

    The parameters z are standard normal before the data: five of the spline of ln r, then 400 km/s over the wind, the
    directional delay, ln of the speed of the beam, and its slowing.
    """

    def __init__(self, rows: Rows, prior: RangePrior) -> None:
        self.rows, self.prior = rows, prior
        self.basis = prior.basis(rows.frequency_mhz)
        self.by_z = self.basis @ prior.root
        self.mean = self.basis @ prior.mean
        self.winding = angular_speed_rad_s(SIDEREAL_ROTATION_D) * R_SUN_KM / REFERENCE_WIND_KM_S
        self.node, self.node_weight = np.polynomial.legendre.leggauss(TRAVEL_NODES)

    def winding_rad_rsun(self, z: FloatArray) -> FloatArray:
        """Turn of the spiral per solar radius, shape (P, 1)."""
        return np.asarray(self.winding * np.maximum(1 + SLOWNESS_SD * z[:, 5:6], 0.05))

    def delay_s(self, phi0_rad: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Arrival time after the release, shape (P, N), and its derivative by z, shape (9, P, N)."""
        log_range = self.mean + z[:, :5] @ self.by_z.T
        r, winding = np.exp(log_range), self.winding_rad_rsun(z)
        kappa = LITERATURE_DELAY.kappa + LITERATURE_DELAY.kappa_sd * z[:, 6:7]
        travel, by_range, by_winding, by_slowing = self._travel_s(log_range, winding, z)
        phi = phi0_rad[:, None] - winding * (r - SPIRAL_ORIGIN_RSUN)
        cosine, sine = np.cos(phi), np.sin(phi)
        x, y, height = (self.rows.receiver_rsun[:, axis] for axis in range(3))
        up, west = x * cosine + y * sine, y * cosine - x * sine
        distance = np.sqrt((r - up) ** 2 + west**2 + height**2)
        radial, across = (r - up) / distance, -west / distance
        # Light, and the delay kappa rise (1 - cos) with cos = -radial, along r and along the longitude.
        rise = kappa * self.rows.rise_s
        along_r = radial / C_RSUN_S + rise * (1 - radial**2) / distance
        along_phi = r * across / C_RSUN_S + rise * (across - radial * across * r / distance)
        by_log_range = by_range + r * (along_r - winding * along_phi)
        derivative = np.empty((9, *r.shape))
        derivative[:5] = by_log_range * self.by_z.T[:, None, :]
        derivative[5] = self.winding * SLOWNESS_SD * (by_winding - (r - SPIRAL_ORIGIN_RSUN) * along_phi)
        derivative[6] = LITERATURE_DELAY.kappa_sd * self.rows.rise_s * (1 + radial)
        derivative[7] = -LN_BEAM_SD * travel
        derivative[8] = SLOWING_SD * by_slowing
        return travel + distance / C_RSUN_S + rise * (1 + radial), derivative

    def _travel_s(
        self, log_range: FloatArray, winding: FloatArray, z: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Travel of a beam of speed v r^-d along the spiral, and its derivatives by ln r, winding and d."""
        slowing = SLOWING + SLOWING_SD * z[:, 8:9]
        speed = BEAM_C * C_RSUN_S * np.exp(LN_BEAM_SD * z[:, 7:8])
        travel, by_winding, by_slowing = (np.zeros_like(log_range) for _ in range(3))
        for node, weight in zip(0.5 * (1 + self.node), self.node_weight, strict=True):
            at = node * log_range
            r = np.exp(at)
            path = np.sqrt(1 + (winding * r) ** 2)
            time = weight * np.exp((1 + slowing) * at)
            travel += time * path
            by_winding += time * winding * r**2 / path
            by_slowing += time * path * at
        end = np.exp(log_range)
        scale = 0.5 * log_range / speed
        by_range = end ** (1 + slowing) * np.sqrt(1 + (winding * end) ** 2) / speed
        return scale * travel, by_range, scale * by_winding, scale * by_slowing

    def misfit(self, phi0_rad: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Standardised residuals, shape (P, N), and their derivative by z with the sign of the model, (P, 9, N)."""
        delay, derivative = self.delay_s(phi0_rad, z)
        white = self.rows.whitener.T
        residual = (self.rows.arrival_s - delay) @ white
        return residual, np.moveaxis(
            (derivative.reshape(-1, derivative.shape[-1]) @ white).reshape(derivative.shape), 0, 1
        )


def _climb(model: ArrivalModel, phi0_rad: FloatArray, z: FloatArray) -> Modes:
    """Damped Gauss-Newton from all starts at once, and Laplace's weight of what each arrives at."""
    z = z.copy()
    damping, moving = np.full(len(z), 1e-3), np.arange(len(z))
    residual, derivative = model.misfit(phi0_rad, z)
    cost = (residual**2).sum(axis=1) + (z**2).sum(axis=1)
    unit = np.eye(z.shape[1])
    for _ in range(ITERATIONS):
        here = derivative[moving]
        curvature = here @ np.swapaxes(here, 1, 2) + unit
        pull = (here @ residual[moving][..., None])[..., 0] - z[moving]
        diagonal = np.einsum("pii->pi", curvature)
        step = np.linalg.solve(curvature + (damping[moving, None] * diagonal)[..., None] * unit, pull[..., None])[
            ..., 0
        ]
        largest = np.abs(step).max(axis=1, keepdims=True)
        step *= np.minimum(1.0, LONGEST_STEP / np.maximum(largest, 1e-12))
        tried = z[moving] + step
        new_residual, new_derivative = model.misfit(phi0_rad[moving], tried)
        new_cost = (new_residual**2).sum(axis=1) + (tried**2).sum(axis=1)
        better = new_cost <= cost[moving]
        taken = moving[better]
        z[taken], cost[taken] = tried[better], new_cost[better]
        residual[taken], derivative[taken] = new_residual[better], new_derivative[better]
        damping[moving] = np.clip(damping[moving] * np.where(better, 0.2, 8.0), 1e-6, 1e6)
        moving = moving[np.abs(step).max(axis=1) > CONVERGED]
        if moving.size == 0:
            break
    curvature = derivative @ np.swapaxes(derivative, 1, 2) + unit
    log_weight = -0.5 * cost - 0.5 * np.linalg.slogdet(curvature)[1]
    covariance = np.asarray(np.linalg.inv(curvature), dtype=np.float64)
    return Modes(phi0_rad, z, log_weight, covariance, (residual**2).sum(axis=1))


def rows_of(grid: ArrivalGrid) -> Rows:
    """Rows of a table with its noise, and with what this module assumes where the table does not say it."""
    if grid.measured_s2 is None:
        shape = grid.shape_sd_s if grid.shape_sd_s.any() else SHAPE_OF_RISE * np.asarray(grid.rise_s)
        offset = grid.offset_sd_s if grid.offset_sd_s.any() else np.asarray(OFFSET_SD_S)
        grid = replace(grid, shape_sd_s=shape, offset_sd_s=offset)
    received = np.isfinite(grid.arrival_s)
    row, column = np.nonzero(received)
    frequency = grid.frequency_mhz[row]
    average = _average(column, grid.sigma_s[received])
    departure = DEPARTURE * TRAVEL_AT_055_MHZ_S * 0.55 / frequency
    apart = np.subtract.outer(*2 * [np.log(frequency)]) / DEPARTURE_LN_F
    covariance = grid.covariance_s2() + np.outer(departure, departure) * np.exp(-0.5 * apart**2)
    covariance[np.diag_indices_from(covariance)] += LEAST_S2
    arrival = (grid.arrival_s - grid.delay_s)[received]
    covariance = average @ covariance @ average.T
    return Rows(
        np.exp(average @ np.log(frequency)),
        average @ grid.receiver_rsun[received],
        average @ (arrival - np.median(arrival)),
        average @ np.asarray(grid.rise_s)[received],
        covariance,
        _whitener(covariance),
    )


def _average(column: npt.NDArray[np.intp], sigma_s: FloatArray) -> FloatArray:
    """Matrix that averages neighbouring channels of a spacecraft where it has too many, shape (rows, N)."""
    group = np.zeros(column.size, dtype=np.intp)
    for one in np.unique(column):
        of_one = np.flatnonzero(column == one)
        number = min(of_one.size, MOST_CHANNELS)
        group[of_one] = group.max() + 1 + np.arange(of_one.size) * number // of_one.size
    weight = np.where(group == np.unique(group)[:, None], 1 / sigma_s**2, 0.0)
    return np.asarray(weight / weight.sum(axis=1, keepdims=True))


def _whitener(covariance_s2: FloatArray) -> FloatArray:
    """Inverse root of a covariance to which a flat release time is added."""
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance_s2 + FLAT_S2)))


def chosen(rows: Rows, keep: npt.NDArray[np.bool_], widening: float = 1.0) -> Rows:
    """Some of the rows, with the covariance times a factor."""
    covariance = widening * rows.covariance_s2[np.ix_(keep, keep)]
    per_row = ("frequency_mhz", "receiver_rsun", "arrival_s", "rise_s")
    kept = {name: getattr(rows, name)[keep] for name in per_row}
    return Rows(**kept, covariance_s2=covariance, whitener=_whitener(covariance))


def belonging(model: ArrivalModel, modes: Modes) -> npt.NDArray[np.bool_]:
    """Which rows all others predict within `TOO_FAR_SD`, about the best solution."""
    best = np.array([modes.log_weight.argmax()])
    delay, derivative = model.delay_s(modes.phi0_rad[best], modes.z[best])
    free = derivative[:, 0]
    expected = delay[0] - modes.z[best][0] @ free
    covariance = model.rows.covariance_s2 + FLAT_S2 + free.T @ free
    keep = np.ones(expected.size, dtype=bool)
    while (~keep).sum() < MOST_LEFT_OUT * keep.size:
        inverse = np.linalg.inv(covariance[np.ix_(keep, keep)])
        away = np.abs(inverse @ (model.rows.arrival_s - expected)[keep]) / np.sqrt(np.diag(inverse))
        if away.max() <= TOO_FAR_SD:
            break
        keep[np.flatnonzero(keep)[away.argmax()]] = False
    return keep


def search(model: ArrivalModel) -> Modes:
    """All separate solutions at all longitudes of the circle."""
    node = np.radians(np.arange(NODES) * 360.0 / NODES - 180.0)
    shift = np.linalg.solve(model.prior.root, np.outer(np.ones(COEFFICIENTS), STARTS_LN_RANGE)).T
    start = np.concatenate([shift, np.zeros((len(shift), 4))], axis=1)
    start[:, 7] = 0.5 * np.array(STARTS_LN_RANGE) / LN_BEAM_SD
    number = len(start)
    found = _climb(model, np.repeat(node, number), np.tile(start, (NODES, 1)))
    keep = np.ones(len(found.z), dtype=bool)
    by_node = found.log_weight.reshape(NODES, number)
    for place in range(NODES):
        order = place * number + np.argsort(-by_node[place])
        for rank, one in enumerate(order):
            apart = found.z[order[:rank]] - found.z[one]
            inverse = np.linalg.inv(found.covariance[order[:rank]])
            near = np.einsum("mi,mij,mj->m", apart, inverse, apart) < SAME_MODE_SD**2
            keep[one] = not (near & keep[order[:rank]]).any()
    return Modes(*(getattr(found, name)[keep] for name in ("phi0_rad", "z", "log_weight", "covariance", "chi2")))
