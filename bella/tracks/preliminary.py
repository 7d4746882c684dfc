"""A preliminary track from two spacecraft: where on the circle the spiral of a burst may start, and how sure that is.

Two spacecraft do not place a source. Their arrival times measure, at each frequency, about r cos(longitude - middle
between the two), so that every source has a mirror image; the bend of the spiral, a distance that any density model
would give within a factor of two, and a beam that slows smoothly tell the two apart, or do not. The answer is therefore
the posterior of the longitude at 1 solar radius on the whole circle, as regions of one or several parts, with the
distance and nothing else: no position, no wind, no mean. It is published where :func:`fit_preliminary` finds that it
says something, and refused in plain words where not.

The longitude is uniform before the data. At each of 120 longitudes the other nine parameters are found from several
starts by Gauss-Newton steps and integrated out by Laplace's approximation.
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.interpolate import BSpline, PchipInterpolator
from scipy.special import logsumexp
from scipy.stats import chi2 as chi2_distribution
from scipy.stats import norm

from bella.arrivals import ArrivalGrid
from bella.exceptions import InputError, NotPlacedError
from bella.heliosphere import (
    DENSITY_MODELS,
    SIDEREAL_ROTATION_D,
    angular_speed_rad_s,
    emission_range_rsun,
)
from bella.heliosphere.parker import SPIRAL_ORIGIN_RSUN
from bella.heliosphere.scattering import LITERATURE_DELAY
from bella.records import Interval, JointTrack, Moment, NoiseOfEdges, Parameter, Side, SourceAt
from bella.units import C_RSUN_S, R_SUN_KM, FloatArray, within_half_turn_deg

MODEL_NAME = "preliminary, two spacecraft"

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
FLAT_S2 = 1e8
"""Variance of the release time: flat."""

# How the circle is searched.
NODES, CELLS = 120, 360
STARTS_LN_RANGE = (-1.6, -0.7, 0.0, 0.7, 1.6)
"""Distances from a fifth of to five times the prior's mean; beams are taken faster where sources are farther."""
ITERATIONS, LONGEST_STEP, CONVERGED = 40, 1.5, 2e-3
"""Steps at most, their largest component, and the one that counts as none, all in prior standard deviations."""
SAME_MODE_SD = 1.0
"""Solutions nearer to one another than this, in posterior standard deviations, are one."""
TRAVEL_NODES = 8
MOST_CHANNELS = 60
"""Channels of a spacecraft beyond this number are averaged: neighbours share their errors anyway."""

# What is published.
LEVELS = (0.68, 0.95)
TOO_FAR_SD, MOST_LEFT_OUT = 4.0, 0.1
"""Edges that miss what all others predict by more than this many of its errors are left out, the worst first, but at
most a tenth of them."""
WIDEN_FROM, MOST_WIDENING = 1.2, 1.5
"""Reduced chi2 from which the errors are widened by it, and up to which the answer is published."""
WIDEST_95_DEG = 180.0
LEAST_SEPARATION_DEG = 10.0
"""Below this, regions hold what they say but leave out little of the circle (simulated bursts)."""
LEAST_CHANNELS, LEAST_SPAN = 8, 2.5
"""Channels of each spacecraft, and the ratio of frequencies that both must hear."""
PROFILE_MHZ = (0.2, 0.5, 1.0, 2.0)
SIDE_MHZ = 0.5


@dataclass(frozen=True)
class _Rows:
    """Arrival times as a list, one row per spacecraft and channel, with the inverse root of their covariance."""

    frequency_mhz: FloatArray
    receiver_rsun: FloatArray
    arrival_s: FloatArray
    rise_s: FloatArray
    covariance_s2: FloatArray
    whitener: FloatArray


@dataclass(frozen=True)
class _Prior:
    """Gaussian prior of the spline of ln r: knots in ln f, mean and root of the covariance of its coefficients."""

    knots: FloatArray
    mean: FloatArray
    root: FloatArray

    def basis(self, frequency_mhz: FloatArray) -> FloatArray:
        """Value of each spline at frequencies within the knots, shape (N, coefficients)."""
        inside = np.clip(np.log(frequency_mhz), self.knots[0], self.knots[-1])
        return np.asarray(BSpline.design_matrix(inside, self.knots, DEGREE).toarray())


@dataclass(frozen=True)
class _Modes:
    """Solutions on the circle: longitude, parameters, weight, covariance and misfit of each."""

    phi0_rad: FloatArray
    z: FloatArray
    log_weight: FloatArray
    covariance: FloatArray
    chi2: FloatArray


def range_prior(low_mhz: float, high_mhz: float) -> _Prior:
    """Prior of the distance against frequency, from the density models of the solar wind.

    Mean and covariance of: any of the models, fundamental or harmonic with equal weight; times a factor of two; times
    a power of the frequency; times a smooth factor.

    Parameters
    ----------
    low_mhz, high_mhz : float

    Returns
    -------
    _Prior
    """
    low, high = np.log([low_mhz, high_mhz])
    inner = np.linspace(low, high, COEFFICIENTS - DEGREE + 1)[1:-1]
    prior = _Prior(np.r_[[low] * (DEGREE + 1), inner, [high] * (DEGREE + 1)], np.zeros(0), np.zeros((0, 0)))
    log_f = np.linspace(low, high, 60)
    to_coefficients = np.linalg.pinv(prior.basis(np.exp(log_f)))
    winds = [model for model in DENSITY_MODELS.values() if not model.corona_only]
    curves = np.array([np.log(emission_range_rsun(np.exp(log_f), model, n)) for model in winds for n in (1, 2)])
    slope = log_f - np.log(SIDE_MHZ)
    wiggle = WIGGLE**2 * np.exp(-0.5 * (np.subtract.outer(log_f, log_f) / WIGGLE_LN_F) ** 2)
    spread = np.cov(curves.T, bias=True) + np.log(LEVEL_FACTOR) ** 2 + SLOPE_SD**2 * np.outer(slope, slope) + wiggle
    covariance = to_coefficients @ spread @ to_coefficients.T + 1e-8 * np.eye(COEFFICIENTS)
    return replace(prior, mean=to_coefficients @ curves.mean(axis=0), root=np.linalg.cholesky(covariance))


class _Model:
    """Arrival times of a burst for any parameters, and their derivatives.

    The parameters z are standard normal before the data: five of the spline of ln r, then 400 km/s over the wind, the
    directional delay, ln of the speed of the beam, and its slowing.
    """

    def __init__(self, rows: _Rows, prior: _Prior) -> None:
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


def _climb(model: _Model, phi0_rad: FloatArray, z: FloatArray) -> _Modes:
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
    return _Modes(phi0_rad, z, log_weight, np.linalg.inv(curvature), (residual**2).sum(axis=1))


def _rows(grid: ArrivalGrid) -> _Rows:
    """Rows of a table with its noise, and with what this module assumes where the table does not say it."""
    if grid.measured_s2 is None:
        shape = grid.shape_sd_s if grid.shape_sd_s.any() else SHAPE_OF_RISE * np.asarray(grid.rise_s)
        offset = grid.offset_sd_s if grid.offset_sd_s.any() else np.asarray(OFFSET_SD_S)
        grid = replace(grid, shape_sd_s=shape, offset_sd_s=offset)
    heard = np.isfinite(grid.arrival_s)
    row, column = np.nonzero(heard)
    frequency = grid.frequency_mhz[row]
    average = _average(column, grid.sigma_s[heard])
    departure = DEPARTURE * TRAVEL_AT_055_MHZ_S * 0.55 / frequency
    apart = np.subtract.outer(*2 * [np.log(frequency)]) / DEPARTURE_LN_F
    covariance = grid.covariance_s2() + np.outer(departure, departure) * np.exp(-0.5 * apart**2)
    arrival = (grid.arrival_s - grid.delay_s)[heard]
    covariance = average @ covariance @ average.T
    return _Rows(
        np.exp(average @ np.log(frequency)),
        average @ grid.receiver_rsun[heard],
        average @ (arrival - np.median(arrival)),
        average @ np.asarray(grid.rise_s)[heard],
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


def _chosen(rows: _Rows, keep: npt.NDArray[np.bool_], widening: float = 1.0) -> _Rows:
    """Some of the rows, with the covariance times a factor."""
    covariance = widening * rows.covariance_s2[np.ix_(keep, keep)]
    per_row = ("frequency_mhz", "receiver_rsun", "arrival_s", "rise_s")
    kept = {name: getattr(rows, name)[keep] for name in per_row}
    return _Rows(**kept, covariance_s2=covariance, whitener=_whitener(covariance))


def _belongs(model: _Model, modes: _Modes) -> npt.NDArray[np.bool_]:
    """Which rows all others predict within `TOO_FAR_SD`, about the best solution."""
    best = modes.log_weight.argmax(keepdims=True)
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


def _search(model: _Model) -> _Modes:
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
    return _Modes(*(getattr(found, name)[keep] for name in ("phi0_rad", "z", "log_weight", "covariance", "chi2")))


def _density(modes: _Modes) -> FloatArray:
    """Probability of each of the `CELLS` equal parts of the circle, from -180 deg on."""
    node = np.rint((np.degrees(modes.phi0_rad) + 180) * NODES / 360).astype(int)
    log_p = np.array([logsumexp(modes.log_weight[node == place]) for place in range(NODES)])
    around = np.arange(-2, NODES + 3)
    smooth = PchipInterpolator(around * 360.0 / NODES, log_p[around % NODES])
    fine = smooth((np.arange(CELLS) + 0.5) * 360.0 / CELLS)
    probability = np.exp(fine - fine.max())
    return np.asarray(probability / probability.sum())


def _region(probability: FloatArray, level: float) -> tuple[Interval, ...]:
    """Smallest part of the circle that holds a probability: its pieces, the most probable first."""
    order = np.argsort(-probability, kind="stable")
    inside = np.zeros(CELLS, dtype=bool)
    inside[order[: np.searchsorted(np.cumsum(probability[order]), level) + 1]] = True
    if inside.all():
        return (Interval(low=-180.0, high=180.0, probability=1.0),)
    width = 360.0 / CELLS
    begins = np.flatnonzero(inside & ~np.roll(inside, 1))
    pieces = []
    for begin in begins:
        turned = np.roll(inside, -begin)
        length = int(np.argmin(turned))
        share = float(np.roll(probability, -begin)[:length].sum())
        low = float(begin * width - 180)
        pieces.append(Interval(low=low, high=low + length * width, probability=round(share, 4)))
    return tuple(sorted(pieces, key=lambda piece: -piece.probability))


def region_size_deg(region: tuple[Interval, ...]) -> float:
    """Length of all parts of a region, degrees."""
    return sum(part.high - part.low for part in region)


def _inside(region: tuple[Interval, ...]) -> npt.NDArray[np.bool_]:
    """Which cells of the circle a region covers."""
    centre = (np.arange(CELLS) + 0.5) * 360.0 / CELLS - 180.0
    covered = [((centre - part.low) % 360.0) < part.high - part.low for part in region]
    return np.any(covered, axis=0)


def level_of(track: JointTrack, phi0_deg: float) -> float:
    """Probability level at which a longitude enters the credible region of a preliminary track.

    Of many bursts whose final longitude is known, the levels are uniform between 0 and 1 where preliminary tracks are
    honest.

    Parameters
    ----------
    track : JointTrack
        Of tier "preliminary".
    phi0_deg : float
        Longitude of the final track at 1 solar radius, degrees HEE of the same epoch.

    Returns
    -------
    float
        Small near the most probable longitude; 0.95 on the rim of the 95 % region.

    Raises
    ------
    InputError
        If the track has no probabilities on the circle.
    """
    probability = np.array(track.phi0_probability)
    if probability.size == 0:
        raise InputError("this track has no probabilities on the circle; only preliminary tracks have")
    here = probability[int((phi0_deg + 180.0) % 360.0 * probability.size / 360.0) % probability.size]
    return float(probability[probability > here].sum() + 0.5 * probability[probability == here].sum())


def preliminary_track(grid: ArrivalGrid) -> JointTrack:
    """Posterior of the longitude of a spiral on the whole circle, from two or more spacecraft, whatever it says.

    Parameters
    ----------
    grid : ArrivalGrid
        Channels need not be common to the spacecraft (``arrival_grid(table, heard_by=1)``). Where the table has no
        ``shape_sd_s`` and no ``offset_sd_s``, `SHAPE_OF_RISE` and `OFFSET_SD_S` are taken.

    Returns
    -------
    JointTrack
        Of tier "preliminary": regions of `phi0_deg`, distances in `profile`, the side; all else is empty. Where the
        best solution misses the arrival times, regions are those of errors widened by it (`error_scale`).
    """
    rows = _rows(grid)
    prior = range_prior(float(rows.frequency_mhz.min()), float(rows.frequency_mhz.max()))
    model = _Model(rows, prior)
    modes = _search(model)
    belongs = _belongs(model, modes)
    if not belongs.all():
        model = _Model(_chosen(rows, belongs), prior)
        modes = _search(model)
    best = int(modes.log_weight.argmax())
    freedom = model.rows.arrival_s.size - 2 - (9 - float(np.trace(modes.covariance[best])))
    misfit = float(modes.chi2[best])
    reduced = misfit / freedom
    if reduced > WIDEN_FROM:
        model = _Model(_chosen(model.rows, np.ones(model.rows.arrival_s.size, dtype=bool), reduced), prior)
        modes = _search(model)
    probability = _density(modes)
    return JointTrack(
        tier="preliminary",
        model=MODEL_NAME,
        rotation_period_d=SIDEREAL_ROTATION_D,
        epoch_utc=f"{grid.reference_utc.astype('datetime64[ms]')}Z",
        phi0_deg=Parameter(),
        phi0_68=_region(probability, LEVELS[0]),
        phi0_95=_region(probability, LEVELS[1]),
        phi0_probability=tuple(float(p) for p in np.round(probability, 7)),
        side=_side(model, modes, grid),
        v_sw_km_s=Parameter(),
        beam_speed_c=Parameter(),
        release_utc=Moment(),
        profile=_profile(model, modes),
        noise=_noise(grid, modes),
        chi2=misfit,
        freedom=round(freedom),
        misfit_p=float(chi2_distribution.sf(misfit, freedom)),
        error_scale=float(np.sqrt(reduced)) if reduced > WIDEN_FROM else 1.0,
        times=int(np.isfinite(grid.arrival_s).sum()),
        flags=() if belongs.all() else ("arrivals_down_weighted",),
    )


def _weights(modes: _Modes) -> FloatArray:
    return np.asarray(np.exp(modes.log_weight - logsumexp(modes.log_weight)))


def _quantiles(mean: FloatArray, sd: FloatArray, weight: FloatArray) -> FloatArray:
    """The 2.5, 16, 50, 84 and 97.5 % quantiles of a mixture of Gaussians."""
    at = np.linspace((mean - 5 * sd).min(), (mean + 5 * sd).max(), 800)
    below = norm.cdf((at[:, None] - mean) / sd) @ weight
    return np.interp([0.025, 0.16, 0.5, 0.84, 0.975], below, at)


def _parameter(quantiles: FloatArray, contraction: float) -> Parameter:
    q2_5, q16, q50, q84, q97_5 = (float(value) for value in quantiles)
    return Parameter(q2_5=q2_5, q16=q16, q50=q50, q84=q84, q97_5=q97_5, contraction=contraction)


def _profile(model: _Model, modes: _Modes) -> tuple[SourceAt, ...]:
    """Distance at a few frequencies within those that were heard; the longitude is left empty."""
    heard = model.rows.frequency_mhz
    profile = []
    for frequency in (one for one in PROFILE_MHZ if heard.min() <= one <= heard.max()):
        basis = model.prior.basis(np.array([frequency]))[0]
        by_z = basis @ model.prior.root
        mean = basis @ model.prior.mean + modes.z[:, :5] @ by_z
        sd = np.sqrt(np.einsum("i,mij,j->m", by_z, modes.covariance[:, :5, :5], by_z))
        quantiles = _quantiles(mean, sd, _weights(modes))
        contraction = float((quantiles[3] - quantiles[1]) / (2 * np.linalg.norm(by_z)))
        distance = _parameter(np.exp(quantiles), contraction)
        profile.append(SourceAt(frequency_mhz=frequency, range_rsun=distance, longitude_deg=Parameter()))
    return tuple(profile)


def _noise(grid: ArrivalGrid, modes: _Modes) -> NoiseOfEdges:
    """What was taken for the noise of the edges, in half widths of the rise."""
    assumed = grid.measured_s2 is None and not grid.shape_sd_s.any()
    heard = np.isfinite(grid.arrival_s)
    shape = SHAPE_OF_RISE if assumed else float(np.median((grid.shape_sd_s / np.asarray(grid.rise_s))[heard]))
    scale = LITERATURE_DELAY.kappa_sd
    mean = LITERATURE_DELAY.kappa + scale * modes.z[:, 6]
    quantiles = _quantiles(mean, scale * np.sqrt(modes.covariance[:, 6, 6]), _weights(modes))
    return NoiseOfEdges(
        shape=shape, channel=0.0, kappa=_parameter(quantiles, float((quantiles[3] - quantiles[1]) / (2 * scale)))
    )


def _side(model: _Model, modes: _Modes, grid: ArrivalGrid) -> Side | None:
    """The half circle that more probably has the source at `SIDE_MHZ`; None for more than two spacecraft."""
    if len(grid.observatories) != 2:
        return None
    middle = _middle_rad(grid)
    frequency = np.clip(SIDE_MHZ, model.rows.frequency_mhz.min(), model.rows.frequency_mhz.max())
    basis = model.prior.basis(np.array([frequency]))[0]
    r = np.exp(basis @ model.prior.mean + modes.z[:, :5] @ (basis @ model.prior.root))
    longitude = modes.phi0_rad - model.winding_rad_rsun(modes.z)[:, 0] * (r - SPIRAL_ORIGIN_RSUN)
    towards = float(_weights(modes)[np.cos(longitude - middle) > 0].sum())
    if towards < 0.5:
        return Side(middle_deg=within_half_turn_deg(float(np.degrees(middle)) + 180.0), probability=1 - towards)
    return Side(middle_deg=within_half_turn_deg(float(np.degrees(middle))), probability=towards)


def _directions(grid: ArrivalGrid) -> FloatArray:
    """Unit vectors from the Sun to the spacecraft, in the ecliptic plane, shape (n, 2)."""
    place = np.nanmean(grid.receiver_rsun[..., :2], axis=0)
    return np.asarray(place / np.linalg.norm(place, axis=1, keepdims=True))


def _middle_rad(grid: ArrivalGrid) -> float:
    """Longitude of the middle between two spacecraft: the mirror line of their arrival times."""
    one, other = _directions(grid)
    apart = one - other
    across = np.array([-apart[1], apart[0]])
    across *= 1.0 if across @ (one + other) >= 0 else -1.0
    return float(np.arctan2(across[1], across[0]))


def separation_deg(grid: ArrivalGrid) -> float:
    """Largest angle at the Sun between two of the spacecraft, degrees."""
    unit = _directions(grid)
    return float(np.degrees(np.arccos(np.clip(unit @ unit.T, -1, 1))).max())


def _too_little(grid: ArrivalGrid) -> str | None:
    """Why arrival times are too few to be fitted at all; None if they are not."""
    heard = np.isfinite(grid.arrival_s)
    if len(grid.observatories) < 2:
        return f"only {grid.observatories[0]} has arrival times; a preliminary track needs two spacecraft"
    low = max(grid.frequency_mhz[column].min() for column in heard.T)
    high = min(grid.frequency_mhz[column].max() for column in heard.T)
    shared = (grid.frequency_mhz >= low) & (grid.frequency_mhz <= high)
    fewest = int(heard[shared].sum(axis=0).min()) if shared.any() else 0
    if fewest < LEAST_CHANNELS or high < LEAST_SPAN * low:
        return (
            f"the spacecraft share too few frequencies: {fewest} channels between {low:.3g} and {high:.3g} MHz; "
            f"needed are {LEAST_CHANNELS} of each over a factor of {LEAST_SPAN:g}"
        )
    separation = separation_deg(grid)
    if separation < LEAST_SEPARATION_DEG:
        return (
            f"the spacecraft are {separation:.1f} deg apart as seen from the Sun; below {LEAST_SEPARATION_DEG:g} deg "
            "their arrival times leave most longitudes open"
        )
    return None


def _too_wide(track: JointTrack) -> str | None:
    """Why a track says too little to be published; None if it does not."""
    size = region_size_deg(track.phi0_95)
    if size >= WIDEST_95_DEG:
        return f"the 95 % region of the longitude covers {size:.0f} deg; only less than half of the circle is published"
    if track.error_scale**2 > MOST_WIDENING:
        return (
            f"no source explains the arrival times within their errors: chi2 {track.chi2:.0f} for {track.freedom} "
            "degrees of freedom; the edges of the two spacecraft do not belong together"
        )
    return None


def fit_preliminary(grid: ArrivalGrid, other_edges: ArrivalGrid | None = None) -> JointTrack:
    """Preliminary track of a burst from two spacecraft, where it says enough to be published.

    Parameters
    ----------
    grid : ArrivalGrid
        As :func:`preliminary_track` takes it.
    other_edges : ArrivalGrid, optional
        Arrival times of the same burst by another definition of the edge; their 68 % region must meet the first.

    Returns
    -------
    JointTrack
        Of tier "preliminary"; with the flag `one_edge` where `other_edges` is not given.

    Raises
    ------
    NotPlacedError
        Says in plain words why nothing is published.
    """
    reason = _too_little(grid)
    if reason:
        raise NotPlacedError(reason)
    track = preliminary_track(grid)
    reason = _too_wide(track)
    if reason:
        raise NotPlacedError(reason)
    if other_edges is None or _too_little(other_edges):
        return track.model_copy(update={"flags": (*track.flags, "one_edge")})
    other = preliminary_track(other_edges)
    if not (_inside(track.phi0_68) & _inside(other.phi0_68)).any():
        raise NotPlacedError(
            f"two definitions of the edge, {grid.edge} and {other_edges.edge}, put the burst at longitudes that "
            "exclude one another"
        )
    return track
