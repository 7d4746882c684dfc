r"""Where a source was, from differences of arrival times of a signal that travels at c: closed form, or least squares.

With p0 a reference receiver, q_i = p_i - p0, d_i = c (y_i - y_0), rho = \|s - p0\| and D + 1 receivers,

    2 q_i . (s - p0) = |q_i|^2 - d_i^2 - 2 rho d_i      =>      s = p0 + a + g rho,
    (g.g - 1) rho^2 + 2 a.g rho + a.a + z0^2 = 0,

linear in s given rho, and a quadratic for rho (Badman et al. 2022, ApJ 938:95, doi:10.3847/1538-4357/ac90c2;
Schau & Robinson 1987, IEEE Trans. ASSP-35:1223). A source in the plane z = 0 has only the first two components of a
and g, and z0 is the height of the reference receiver. The other root is an alias when rho <= 0 or rho + d_i < 0: it
solves the squared equations with a distance that would be negative. With more receivers the same, by weighted linear
least squares, is where :mod:`bella.multilateration.tdoa_fit` starts.

As a method of :func:`bella.multilateration.localise` it gives a Gaussian around that position. There is no prior, so
the evidence is not defined, the speed has no posterior, and where the delays leave a second position or a long bend the
Gaussian knows nothing of it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import chdtrc
from scipy.stats import chi2

from bella.arrivals import ArrivalGrid
from bella.exceptions import GeometryError, InputError
from bella.heliosphere.scattering import DirectionalDelay, one_minus_cosine
from bella.multilateration.likelihood import evaluate
from bella.multilateration.posterior import Draws, Moments, Posterior, Recipe
from bella.multilateration.priors import THRESHOLDS, Priors
from bella.multilateration.problems import problems_of
from bella.multilateration.regions import LEVELS, Modes, Region
from bella.multilateration.tdoa_fit import (
    SEARCH_RSUN,
    BoolArray,
    IntArray,
    Timing,
    coarse_start,
    descend,
    emission,
    information,
    inverse,
    is_singular,
    limited_inverse,
    misfit,
    reject_rows,
    timing_of,
)
from bella.units import C_RSUN_S, FloatArray

ON_ONE_LINE = 1e-6
"""Receivers that depart from one line (3D: plane) by less than this part of their spread cannot tell its two sides:
no ephemeris is better."""
ROUNDING = 1e-12
"""A discriminant this far below 0, in parts of its terms, is 0."""
APART_RSUN = 0.1
"""Two answers farther apart than this are two."""

AT_LIGHT_SPEED = Priors(v_sd_c=1e-9)
VERTICES = 73
DELAY_STEPS = 5
"""Positions are found so often, each time with the directional delay of the last: a step changes the next one by a
fifth."""

NO_ROOT = "no root is a source: the delays do not fit these receivers"
ONE_ROOT = "the other root is an alias: one of its distances is not positive"
NEARER = "both roots explain the delays: the one nearer the Sun"


@dataclass(frozen=True)
class Roots:
    """Both solutions of the closed form.

    Attributes
    ----------
    points : ndarray, shape (B, 2, D)
        Solar radii. Where a root is not real, the point of its real part; where it is infinite, that of rho = 0.
    rho : ndarray, shape (B, 2)
        Distance from the reference receiver, solar radii; the larger root first.
    real, positive, ordered : ndarray of bool, shape (B, 2)
        Whether the root is real and finite, has rho > 0, and gives every receiver a distance that is not negative,
        so that the delays have their sign.
    chosen : ndarray of int, shape (B,)
        Which root is the source, 0 or 1; -1 where none is.
    reason : ndarray of str, shape (B,)
        Why: `NO_ROOT`, `ONE_ROOT` or `NEARER`.
    """

    points: FloatArray
    rho: FloatArray
    real: BoolArray
    positive: BoolArray
    ordered: BoolArray
    chosen: IntArray
    reason: npt.NDArray[np.str_]

    @property
    def valid(self) -> BoolArray:
        """Which roots are possible sources, shape (B, 2)."""
        return self.real & self.positive & self.ordered

    @property
    def two_roots(self) -> BoolArray:
        """Where both are, shape (B,)."""
        return np.asarray(self.valid.all(axis=1))


@dataclass(frozen=True)
class TdoaSolution:
    """Position and emission time of a batch of sources; every number is finite.

    Attributes
    ----------
    position : ndarray, shape (B, D)
        Solar radii.
    covariance : ndarray, shape (B, D, D)
        Square solar radii. Linear in the timing errors: it knows of no second root and no bend. Where `inconsistent`
        or `singular` it is limited by the search region.
    emission_s, emission_sd_s : ndarray, shape (B,)
        On the clock of the arrival times, s.
    misfit : ndarray, shape (B,)
        Chi-squared at `position`.
    two_roots : ndarray of bool, shape (B,)
        Another position explains the arrival times as well.
    inconsistent : ndarray of bool, shape (B,)
        No position explains the arrival times: with D + 1 receivers there is no root, with more the misfit is
        improbable. The position is that of least misfit within the search region.
    singular : ndarray of bool, shape (B,)
        The arrival times do not fix the position to first order.
    """

    position: FloatArray
    covariance: FloatArray
    emission_s: FloatArray
    emission_sd_s: FloatArray
    misfit: FloatArray
    two_roots: BoolArray
    inconsistent: BoolArray
    singular: BoolArray


def solve(
    receivers: FloatArray,
    arrival_s: FloatArray,
    sigma_s: FloatArray,
    dimensions: int,
    correlation: FloatArray | None = None,
) -> TdoaSolution:
    """Locate a batch of sources: closed form for D + 1 receivers, least squares for more or where it has no root.

    Parameters
    ----------
    receivers : ndarray, shape (B, n, 3)
        Solar radii.
    arrival_s : ndarray, shape (B, n)
        Arrival times, s; NaN marks a receiver that did not hear it.
    sigma_s : ndarray, shape (B, n)
        Standard deviations, s.
    dimensions : int
        2: the source is in the plane z = 0; 3: anywhere.
    correlation : ndarray, shape (B, n, n), optional
        Of the errors; not read where a receiver is missing.

    Raises
    ------
    InputError
        If shapes do not agree, or names the row (from 0) that fewer than D + 1 of them received or that is not usable.
    GeometryError
        If the receivers of a row lie on one line (3D: in one plane), or its numbers are beyond all use.
    """
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        timing = timing_of(receivers, arrival_s, sigma_s, dimensions, correlation)
        _check_spread(timing, dimensions)
        return _checked(_solved(timing, dimensions))


def _check_spread(timing: Timing, dimensions: int) -> None:
    """Refuse receivers whose mirror image in a line or plane is themselves: every source then has a twin."""
    present = timing.present[..., None]
    within = timing.receivers[..., :dimensions]
    centre = within.sum(axis=1, keepdims=True) / present.sum(axis=1, keepdims=True)
    spread = np.linalg.svd(np.where(present, within - centre, 0.0), compute_uv=False)
    shape = "on one line" if dimensions == 2 else "in one plane"
    reason = f"has receivers {shape}, which cannot tell its two sides; use the method posterior"
    reject_rows(np.less_equal(spread[:, -1], ON_ONE_LINE * spread[:, 0]), reason, GeometryError)


def both_roots(timing: Timing, reference: IntArray, dimensions: int) -> Roots:
    """Solve the module's equations; by weighted linear least squares where there are more than D + 1 receivers."""
    row = np.arange(len(reference))
    p0 = timing.receivers[row, reference]
    d = C_RSUN_S * (timing.delay_s - timing.delay_s[row, reference][:, None])
    q = timing.receivers - p0[:, None, :]
    height = -p0[:, dimensions:]
    known = 0.5 * ((q**2).sum(axis=2) - d**2) - np.einsum("bnk,bk->bn", q[..., dimensions:], height)
    weight = np.sqrt(timing.positive_share)
    solver = np.linalg.pinv(weight[..., None] * q[..., :dimensions])
    a = (solver @ (weight * known)[..., None])[..., 0]
    g = -(solver @ (weight * d)[..., None])[..., 0]
    rho, real = _quadratic((g * g).sum(axis=1) - 1, (a * g).sum(axis=1), (a * a).sum(axis=1) + (height**2).sum(axis=1))
    within_reach = np.where(np.isfinite(rho), rho, 0.0)
    points = (p0[:, :dimensions] + a)[:, None, :] + g[:, None, :] * within_reach[..., None]
    distance = rho[..., None] + np.where(timing.present, d, 0.0)[:, None, :]
    return _chosen(points, rho, real, np.asarray((distance >= 0).all(axis=2)))


def _quadratic(A: FloatArray, B: FloatArray, C: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Roots of A x^2 + 2 B x + C, larger first, and which are real and finite; else the real part is given."""
    discriminant = B**2 - A * C
    real = discriminant >= -ROUNDING * (B**2 + np.abs(A * C))
    # adding numbers of one sign, and the product of the roots for the other: no cancellation where A is near 0
    far = -(B + np.copysign(np.sqrt(np.maximum(discriminant, 0)), B))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        roots = np.sort(np.where(real, [far / A, C / far], -B / A), axis=0)[::-1].T
    return roots, real[:, None] & np.isfinite(roots)


def _chosen(points: FloatArray, rho: FloatArray, real: BoolArray, ordered: BoolArray) -> Roots:
    positive = rho > 0
    valid = real & positive & ordered
    radius = np.where(valid, np.linalg.norm(points, axis=2), np.inf)
    count = valid.sum(axis=1)
    return Roots(
        points,
        rho,
        real,
        positive,
        ordered,
        chosen=np.where(count > 0, radius.argmin(axis=1), -1),
        reason=np.array([NO_ROOT, ONE_ROOT, NEARER])[count],
    )


def _solved(timing: Timing, dimensions: int) -> TdoaSolution:
    # the spacecraft that received it first: a reference that does not depend on the order in which they are listed
    first = np.where(timing.present, timing.delay_s, np.inf).argmin(axis=1)
    roots = both_roots(timing, first, dimensions)
    exact = timing.present.sum(axis=1) == dimensions + 1
    settled = exact & (roots.chosen >= 0)
    position = roots.points[np.arange(len(first)), roots.chosen]
    two_roots = settled & roots.two_roots
    rest = np.flatnonzero(~settled)
    position[rest], two_roots[rest] = _searched(timing.take(rest), roots.points[rest])
    value = misfit(timing, position)
    inconsistent = np.asarray(np.where(exact, ~settled, _improbable(timing, value)))
    return _with_errors(timing, position, value, two_roots, inconsistent)


def _searched(timing: Timing, guesses: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Position of least misfit, and whether there is another that is not improbable."""
    starts = [coarse_start(timing, guesses.shape[2]), guesses[:, 0], guesses[:, 1]]
    ends = np.stack([descend(timing, start) for start in starts])
    values = np.stack([misfit(timing, end) for end in ends])
    best = ends[values.argmin(axis=0), np.arange(len(guesses))]
    apart = np.linalg.norm(ends - best, axis=2) > APART_RSUN
    return best, (apart & ~_improbable(timing, values)).any(axis=0)


def _improbable(timing: Timing, value: FloatArray) -> BoolArray:
    return np.asarray(chdtrc(timing.present.sum(axis=1) - 1, value) < 1 / THRESHOLDS.inconsistent_once_in)


def _with_errors(
    timing: Timing, position: FloatArray, value: FloatArray, two_roots: BoolArray, inconsistent: BoolArray
) -> TdoaSolution:
    normal = information(timing, position)
    singular = is_singular(normal)
    limited = singular | inconsistent
    covariance = np.empty_like(normal)
    covariance[~limited] = inverse(normal[~limited])
    covariance[limited] = limited_inverse(normal[limited], SEARCH_RSUN)
    emitted = emission(timing, position, covariance)
    return TdoaSolution(position, covariance, emitted.time_s, emitted.sd_s, value, two_roots, inconsistent, singular)


def _checked(solution: TdoaSolution) -> TdoaSolution:
    numbers = (solution.position, solution.covariance, solution.emission_s, solution.emission_sd_s, solution.misfit)
    lost = [~np.isfinite(values).all(axis=tuple(range(1, values.ndim))) for values in numbers]
    reject_rows(
        np.any(lost, axis=0),
        "has numbers beyond what can be computed; check its times, positions and sigma_s",
        GeometryError,
    )
    return solution


def tdoa_posterior(grid: ArrivalGrid, recipe: Recipe, advance: Callable[[int], None]) -> Posterior:
    """Localise each frequency by time differences of arrival.

    Parameters
    ----------
    grid : ArrivalGrid
        With the timing errors to use.
    advance : callable
        Told how many frequencies are done since the last call.

    Returns
    -------
    Posterior
        Its evidence is NaN: without a prior there is none.

    Raises
    ------
    GeometryError
        If the receivers lie on a line (a source in space: in a plane).
    InputError
        If there are too few receivers, or the preset allows bad arrival times.
    """
    if recipe.preset.noise.bad_probability:
        raise InputError(f"preset {recipe.preset.name!r} allows bad arrival times; use it with the method posterior")
    try:
        solved = _with_delay(grid, recipe)
    except InputError as error:
        raise type(error)(f"method tdoa, frequencies as rows from 0: {error}") from error
    advance(grid.frequency_mhz.size)
    return Posterior(
        draws=_draws(grid, solved, recipe),
        moments=_moments(grid, solved, recipe.preset.delay),
        regions=[_region(*one) for one in zip(solved.position, solved.covariance, strict=True)],
        remarks=[_remarks(*one) for one in zip(solved.two_roots, solved.inconsistent, strict=True)],
    )


def _with_delay(grid: ArrivalGrid, recipe: Recipe) -> TdoaSolution:
    """Positions, with the directional delay of the last ones taken off and its uncertainty added to the noise."""
    delay, late = recipe.preset.delay, np.zeros_like(grid.arrival_s)
    for _ in range(DELAY_STEPS if delay.is_free else 1):
        covariance = grid.covariances_s2() + delay.kappa_sd**2 * late[:, :, None] * late[:, None, :]
        sigma_s = np.sqrt(np.einsum("fii->fi", covariance))
        arrival_s = grid.arrival_s - grid.delay_s - delay.kappa * late
        correlation = covariance / (sigma_s[:, :, None] * sigma_s[:, None, :])
        solved = solve(grid.receiver_rsun, arrival_s, sigma_s, recipe.dimensions, correlation)
        source = np.pad(solved.position, ((0, 0), (0, 3 - recipe.dimensions)))
        late = np.nan_to_num(grid.rise_s * one_minus_cosine(source[:, None], grid.receiver_rsun))
    return solved


def _remarks(two_roots: bool, inconsistent: bool) -> str:
    raised = {"two_roots": two_roots, "no_exact_root": inconsistent}
    return ";".join(name for name in raised if raised[name])


def _moments(grid: ArrivalGrid, solved: TdoaSolution, delay: DirectionalDelay) -> Moments:
    none = np.zeros(len(solved.position))
    return Moments(
        mean=solved.position,
        covariance=solved.covariance,
        emission_s=solved.emission_s,
        emission_sd_s=solved.emission_sd_s,
        v_over_c=none + 1,
        v_over_c_sd=none,
        log_evidence=none * np.nan,
        above_c=none,
        prior_pull=np.zeros_like(solved.position),
        bad_probability=np.zeros_like(grid.arrival_s),
        kappa=none + delay.kappa,
        kappa_sd=none + delay.kappa_sd,
    )


def _draws(grid: ArrivalGrid, solved: TdoaSolution, recipe: Recipe) -> Draws:
    """Positions from the Gaussian, emission times from their exact density given the position."""
    rng = np.random.default_rng(recipe.seed)
    count, dimensions = solved.position.shape
    root = np.linalg.cholesky(solved.covariance)
    z = rng.standard_normal((count, recipe.draws, dimensions))
    position = solved.position[:, None] + np.einsum("bij,bnj->bni", root, z)
    problems = problems_of(grid, AT_LIGHT_SPEED, dimensions, delay=recipe.preset.delay).spread()
    local = evaluate(problems, np.moveaxis(position, -1, 0))
    kappa = local.kappa[0] + local.kappa_sd[0] * rng.standard_normal(local.kappa[0].shape)
    late = problems.mean_arrival_s[0] - AT_LIGHT_SPEED.slowness_mean * local.mean_distance[0]
    late = late - kappa * local.mean_delay_s[0]
    jitter = rng.standard_normal(late.shape) / np.sqrt(problems.total_weight[0])
    return Draws(position, late + jitter, np.ones(late.shape), kappa, np.full(count, float(recipe.draws)))


def _region(mean: FloatArray, covariance: FloatArray) -> Region:
    """Ellipses and ellipsoids of a Gaussian."""
    dimensions = len(mean)
    squared = [float(chi2.ppf(level, dimensions)) for level in LEVELS]
    seen = [float(chi2.ppf(level, 2)) for level in LEVELS]
    plane = covariance[:2, :2]
    volume = 4 / 3 * np.pi * np.sqrt(np.linalg.det(covariance)) if dimensions == 3 else np.nan
    return Region(
        area_rsun2=tuple(np.pi * one * float(np.sqrt(np.linalg.det(plane))) for one in seen),
        volume_rsun3=tuple(float(volume) * one**1.5 for one in squared),
        log_threshold=tuple(-0.5 * one for one in squared),
        outlines=tuple(_ellipse(mean[:2], plane, one) for one in seen),
        mode_rsun=mean,
        modes=Modes(mean[None], np.ones(1)),
    )


def _ellipse(centre: FloatArray, covariance: FloatArray, squared: float) -> FloatArray:
    angle = np.linspace(0, 2 * np.pi, VERTICES)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    return np.asarray(centre + np.sqrt(squared) * (np.linalg.cholesky(covariance) @ circle).T)
