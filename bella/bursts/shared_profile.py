"""Arrival times of a burst timed against itself: one rising profile that all spacecraft share.

Only differences of arrival times matter, and no law of the light curve is known. So all channels of a burst are fitted
together: each light curve is the same profile, shifted by its arrival time, stretched by a width, scaled, lifted by
its background, and averaged over the integration of each sample as its receiver does. The logarithm of the profile is
concave, so that it has one maximum whatever its parameters, and varies slowly with ln f. The widths follow a smooth
curve in ln f that all spacecraft share, with a factor and a tilt of each spacecraft. After the maximum the logarithm
falls faster or slower at each: decays need not differ as rises do.

The edge is half of the maximum of the fitted profile. Errors of the shape are shared by all channels: they are in the
covariance, and most of them cancel in differences.

The fit is Gauss-Newton with Levenberg's damping; time, height and background of each channel are eliminated from the
normal equations (Schur complement).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pandas as pd

from bella.bursts.light_curves import (
    FEWEST_SPACECRAFT,
    Craft,
    LightCurves,
    Start,
    first_guess,
    fitted_samples,
    own_rise,
)
from bella.exceptions import NoDataError
from bella.units import FloatArray

LEVEL = 0.5
"""Of the maximum of the profile at which a burst arrives."""

KNOTS = np.array([-5, -3.2, -2.2, -1.5, -0.9, -0.4, 0.1, 0.6, 1.1, 1.7, 2.5, 3.6, 5.2, 7.5, 11.0])
"""Where the curvature of the log profile is free, in widths after its half-rise."""

GRID = np.arange(-10.0, 13.0, 0.1)
"""Widths after the half-rise at which a profile is tabulated; linear between, which is good to 0.002 of its maximum."""

SLOPE, SLOPE_SD = np.log(1.3), 0.4
"""Logarithm of the slope of the log profile at its pivot: 1.39 of a Gaussian whose half width is 1."""

CURVATURE = np.log(np.maximum(1.3 * np.exp(-np.maximum(KNOTS - 0.8, 0.0) / 0.5), 0.01))
"""Of the log profile before the fit: that of a Gaussian rise, then of an exponential decay."""

CURVATURE_SD, CURVATURE_STEP_SD = 1.0, 0.5
"""Of its logarithm at each knot, and of its change over a width."""

BEND_SD, BEND_STEP_SD, SLOPE_BEND_SD = 0.2, 0.15, 0.1
"""Change of curvature and slope with ln f: profiles of neighbouring frequencies are alike."""

WIDTH_SD = np.array([0.5, 0.3, 0.1])
"""Of ln width about the rise of the burst: level, slope and bend in ln f. Published slopes are -0.77 to -1.05."""

CRAFT_SD, CRAFT_TILT_SD = 0.15, 0.09
"""Of ln width of a spacecraft and its change with ln f: light curves of 2012-06-07 differ by 28 and 23 %."""

FALL_SD, FALL_TILT_SD = 0.3, 0.12
"""Of the logarithm of how fast light curves of a spacecraft fall, and of its change with ln f: -0.25, 0.18
and 0.09 on 2012-06-07, -0.03 to 0.03 on 2020-07-21. Without it, decays that differ by a third move edges by 2 s."""

COMMON_FALL_SD = 0.03
"""Of its mean over the spacecraft, which the profile has too."""

SHAPE_ERROR, LARGEST_SHAPE_ERROR = 0.004, 0.12
"""Share of the maximum by which light curves depart from the profile; raised to what a spacecraft's residuals show."""

DECAY_ERROR = 0.2
"""The same after the maximum: the decay is scattered light, and another burst may stand in it."""

LEAST_DECAY_ERROR, LARGEST_DECAY_ERROR = 0.03, 0.5

LOST = 4
"""Samples of a channel that time, height, background and its share of the profile use up."""

LEAST_EXCESS = 0.2
"""Where residuals are smaller than the noise that was assumed, so is the noise, down to this share."""

JITTER_RISES = 0.02
"""Error of the time of each sample in rise times: the foot of a burst is high over the noise and would rule alone."""

OUTLIER_SD = 4.0
"""Residuals beyond so many standard deviations count linearly (Huber)."""

FAR_RISES, FAR_CADENCES, FAR_TRIALS, NEAR_TRIALS = 2.0, 0.7, np.linspace(-1, 1, 40), np.linspace(-4, 4, 25)
"""Arrival times on trial: up to so many rise times and cadences away, and in errors of the fit."""

LEAST_HEIGHT = 0.05
"""Of the burst over the highest sample."""

RELOCATED = (2, 4)
"""Rounds before which channels are moved to the best of their arrival times on trial."""

ROUNDS, STEPS, LAST_STEPS = 9, 5, 80
"""Weights of the samples are renewed before each round; so many steps in each, and in the last."""

CONVERGED = 1.0
"""The fit has converged when a step of the last round lowers chi2 by less."""

STEP = float(GRID[1] - GRID[0])


@dataclass(frozen=True)
class ProfileEdges:
    """Arrival times of the channels of a burst.

    Attributes
    ----------
    frequency_mhz, arrival_s, rise_s : ndarray, shape (N,)
        NaN without an arrival time; `rise_s` is the time from half of the maximum to the maximum.
    flag : ndarray of str, shape (N,)
        Why there is none; empty where there is.
    independent_sd_s : ndarray, shape (N,)
        Error of each channel on its own.
    shared_s : ndarray, shape (N, G)
        Errors of the profile and the widths: their covariance is ``shared_s @ shared_s.T``.
    profiles : tuple of CollapsedCurves
        For a figure.
    width_factor : dict of str to float
        How much wider the light curves of a spacecraft are.
    """

    observatory: npt.NDArray[np.object_]
    frequency_mhz: FloatArray
    arrival_s: FloatArray
    rise_s: FloatArray
    flag: npt.NDArray[np.object_]
    independent_sd_s: FloatArray
    shared_s: FloatArray
    collapsed: "tuple[Collapsed, ...]" = ()
    width_factor: dict[str, float] | None = None


@dataclass(frozen=True)
class Collapsed:
    """Light curves of one spacecraft on the time axis of the profile.

    Attributes
    ----------
    widths, height, fitted : ndarray, shape (C, M)
        Time after the half-rise in widths, power over the height of the burst, and that of the fit; NaN where empty.
    """

    observatory: str
    frequency_mhz: FloatArray
    widths: FloatArray
    height: FloatArray
    fitted: FloatArray


def collapsed_samples(collapsed: Sequence[Collapsed]) -> pd.DataFrame:
    """Samples of collapsed light curves as a table, as :func:`bella.plotting.write_collapsed_png` takes it.

    Returns
    -------
    pandas.DataFrame
        Columns observatory, frequency_mhz, widths, height, fitted.
    """
    parts = []
    for one in collapsed:
        row, column = np.nonzero(np.isfinite(one.widths))
        columns = {name: getattr(one, name)[row, column] for name in ("widths", "height", "fitted")}
        parts.append(pd.DataFrame({"observatory": one.observatory, "frequency_mhz": one.frequency_mhz[row], **columns}))
    return pd.concat(parts, ignore_index=True)


def _hats() -> FloatArray:
    """Twice integrated hat functions of the knots on the grid, zero with zero slope at the half-rise, shape (U, K)."""
    fine = np.arange(GRID[0], GRID[-1] + 1e-9, 0.01)
    hats = np.stack([np.interp(fine, KNOTS, one, left=0.0, right=0.0) for one in np.eye(KNOTS.size)], axis=-1)
    origin = int(np.argmin(np.abs(fine)))
    for _ in range(2):
        steps = 0.5 * (hats[1:] + hats[:-1]) * np.diff(fine)[:, None]
        hats = np.concatenate([np.zeros((1, KNOTS.size)), np.cumsum(steps, axis=0)])
        hats = hats - hats[origin]
    return np.stack([np.interp(GRID, fine, one) for one in hats.T], axis=-1)


HATS = _hats()


def fit_profile(lights: Sequence[LightCurves]) -> ProfileEdges:
    """Arrival times of a burst from the profile that all its light curves share.

    Parameters
    ----------
    lights : sequence of LightCurves
        One for each spacecraft.

    Returns
    -------
    ProfileEdges
        All channels, spacecraft by spacecraft.

    Raises
    ------
    NoDataError
        If there are fewer than three spacecraft with four channels, or the fit does not converge.
    """
    rises = own_rise(lights)
    starts = [first_guess(light, rises) for light in lights]
    craft: list[Craft] = []
    for light, start in zip(lights, starts, strict=True):
        one = fitted_samples(light, start, len(craft))
        if one is not None:
            craft.append(one)
    if len(craft) < FEWEST_SPACECRAFT or len(craft) < len(lights):
        raise NoDataError("no shared profile: it needs three spacecraft with four good channels each")
    return _Fit(craft).solve(starts)


class _Fit:
    """Normal equations of all channels of a burst.

    Globals, in this order: ln width (3); of each spacecraft ln width (S), its tilt (S), ln of how fast it falls (S),
    its tilt (S); ln slope at the pivot and its change with ln f (2), ln curvature at the knots (K), its change (K).
    """

    def __init__(self, craft: Sequence[Craft]) -> None:
        self.craft = craft
        for one in craft:
            one.shape_error, one.decay_error = SHAPE_ERROR, DECAY_ERROR
        self.middle = float(np.mean(np.concatenate([np.log(one.frequency_mhz) for one in craft])))
        number, knots = len(craft), KNOTS.size
        self.fall_at = 3 + 2 * number
        self.slope_at = self.fall_at + 2 * number
        self.value = np.zeros(self.slope_at + 2 + 2 * knots)
        self.value[self.slope_at] = SLOPE
        self.value[self.slope_at + 2 : self.slope_at + 2 + knots] = CURVATURE
        self.expected = self.value.copy()
        self.prior = np.zeros((self.value.size, self.value.size))
        sd = np.concatenate(
            [
                WIDTH_SD,
                *(np.full(number, sd) for sd in (CRAFT_SD, CRAFT_TILT_SD, FALL_SD, FALL_TILT_SD)),
                [SLOPE_SD, SLOPE_BEND_SD],
            ]
        )
        self.prior[np.arange(sd.size), np.arange(sd.size)] = sd**-2.0
        for first in (self.fall_at, self.fall_at + number):  # what all fall by is in the profile
            self.prior[first : first + number, first : first + number] += COMMON_FALL_SD**-2
        step = np.diff(np.eye(knots), axis=0) / np.sqrt(np.diff(KNOTS))[:, None]
        for first, alone, change in (
            (sd.size, CURVATURE_SD, CURVATURE_STEP_SD),
            (sd.size + knots, BEND_SD, BEND_STEP_SD),
        ):
            block = slice(first, first + knots)
            self.prior[block, block] = np.eye(knots) / alone**2 + step.T @ step / change**2

    def _across(self, one: Craft) -> FloatArray:
        return np.asarray(np.log(one.frequency_mhz) - self.middle)

    def _width_terms(self, one: Craft) -> FloatArray:
        """Derivatives of ln width of the channels with respect to the globals, shape (C, G)."""
        x, number = self._across(one), len(self.craft)
        terms = np.zeros((x.size, self.value.size))
        terms[:, :3] = np.stack([np.ones_like(x), x, x**2], axis=-1)
        terms[:, 3 + one.index] = 1.0
        terms[:, 3 + number + one.index] = x
        return terms

    def _log_profile(self, one: Craft, value: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Log of the profile on the grid, (C, U), and its derivatives by slope, curvatures and fall, (C, U, 2 + K)."""
        x, knots = self._across(one)[:, None], KNOTS.size
        slope = np.exp(value[self.slope_at] + x * value[self.slope_at + 1])
        curvature = np.exp(value[-2 * knots : -knots] + x * value[-knots:])
        log = np.log(0.5) + slope * GRID - curvature @ HATS.T
        by = np.empty((*log.shape, 2 + knots))
        by[:, :, 0] = slope * GRID
        np.multiply(HATS, -curvature[:, None, :], out=by[:, :, 1:-1])
        row, top = np.arange(len(log)), log.argmax(axis=1)
        past = np.arange(GRID.size) > top[:, None]
        fall = np.exp(value[self.fall_at + one.index] + x * value[self.fall_at + len(self.craft) + one.index])
        peak, at_peak = log[row, top][:, None], by[row, top][:, None]
        by[:, :, -1] = np.where(past, fall * (log - peak), 0.0)
        by[:, :, :-1] = np.where(
            past[:, :, None], at_peak[:, :, :-1] + fall[:, :, None] * (by - at_peak)[:, :, :-1], by[:, :, :-1]
        )
        return np.where(past, peak + fall * (log - peak), log), by

    def model(self, one: Craft, value: FloatArray) -> FloatArray:
        """Mean of the profile over each sample, shape (C, M)."""
        profile = np.exp(np.minimum(self._log_profile(one, value)[0], 50.0))[:, :, None]
        return self._means(one, value, profile)[0][:, :, 0]

    def linear(self, one: Craft, value: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Mean of the profile over each sample, and derivatives by time, ln width and shape.

        Shapes (C, M), (C, M), (C, M), (C, M, 2 + K).
        """
        log, by = self._log_profile(one, value)
        profile = np.exp(np.minimum(log, 50.0))
        table = np.concatenate([profile[:, :, None], profile[:, :, None] * by], axis=2)
        means, by_time, by_width = self._means(one, value, table)
        return means[:, :, 0], by_time, by_width, means[:, :, 1:]

    def _means(self, one: Craft, value: FloatArray, table: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Means of tables over each sample, (C, M, T), and derivatives of the first by time and ln width."""
        whole = np.zeros_like(table)
        np.cumsum(0.5 * STEP * (table[:, 1:] + table[:, :-1]), axis=1, out=whole[:, 1:])
        width = np.exp(one.log_width + self._width_terms(one) @ value)[:, None]
        centre = (one.time_s - one.arrival_s[:, None]) / width
        half = 0.5 * one.integration_s[:, None] / width
        if not one.apart_s.any():
            return _window(table, whole, (centre - half, centre + half), width)
        off = 0.5 * one.apart_s / width
        visits = [_window(table, whole, (centre + side - half, centre + side + half), width) for side in (-off, off)]
        first, second = visits
        return 0.5 * (first[0] + second[0]), 0.5 * (first[1] + second[1]), 0.5 * (first[2] + second[2])

    def weigh(self, scaled: bool) -> None:
        """Renew the weights of the samples from the present fit."""
        for one in self.craft:
            mean, by_time, _, _ = self.linear(one, self.value)
            height = np.maximum(one.height, 0.1)[:, None]
            fit = np.maximum(height * mean, 0.0)
            receiver = one.scatter**2 * (fit**2 + 2 * fit * one.background[:, None])
            top = np.argmax(np.where(one.known, mean, -1.0), axis=1)
            width = np.exp(one.log_width + self._width_terms(one) @ self.value)[:, None]
            past = one.time_s - np.take_along_axis(one.time_s, top[:, None], axis=1)
            late = one.known & (past > 0.5 * width + 0.5 * one.spacing_s[:, None])
            jitter = JITTER_RISES * width * height * by_time
            variance = one.noise[:, None] ** 2 + receiver + jitter**2
            residual = one.power - one.base[:, None] - one.height[:, None] * mean
            if scaled:
                one.shape_error = _shape_error(
                    one, residual**2, variance, np.where(late, np.inf, np.broadcast_to(height**2, late.shape))
                )
                one.decay_error = _decay_error((residual / height)[late])
            variance = variance + (np.where(late, one.decay_error, one.shape_error) * height) ** 2
            variance = variance * one.excess
            one.variance = variance
            away = np.abs(residual) / np.sqrt(variance)
            one.weight = np.where(one.known, np.minimum(1.0, OUTLIER_SD / np.maximum(away, 1e-9)) / variance, 0.0)

    def posterior(self, one: Craft, near_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Arrival times on trial and the logarithm of their posterior with the present profile, shape (C, T) each.

        Height and background are integrated out; the prior of the height is one over itself: a flat one would prefer
        that a single sample has caught the foot of a burst without bound. `near_s` are the errors to refine by.
        """
        width = np.exp(one.log_width + self._width_terms(one) @ self.value)[:, None]
        far = (FAR_RISES * width + FAR_CADENCES * one.spacing_s[:, None]) * FAR_TRIALS
        trial = np.sort(np.hstack([far, np.minimum(near_s[:, None], width) * NEAR_TRIALS]), axis=1)
        profile = np.exp(np.minimum(self._log_profile(one, self.value)[0], 50.0))[:, :, None]
        kept, log = one.arrival_s, np.empty(trial.shape)
        weight = np.where(one.known, 1.0 / one.variance, 0.0)
        total = weight.sum(axis=1)
        power = one.power - (weight * one.power).sum(axis=1, keepdims=True) / total[:, None]
        for column, change in enumerate(trial.T):
            one.arrival_s = kept + change
            mean = self._means(one, self.value, profile)[0][:, :, 0]
            mean = mean - (weight * mean).sum(axis=1, keepdims=True) / total[:, None]
            square, product = (weight * mean**2).sum(axis=1), (weight * mean * power).sum(axis=1)
            height = product / np.maximum(square, 1e-12)
            residual = (power - height[:, None] * mean) ** 2 / one.variance
            huber = np.where(residual > OUTLIER_SD**2, 2 * OUTLIER_SD * np.sqrt(residual) - OUTLIER_SD**2, residual)
            chi2 = np.where(one.known, huber, 0.0).sum(axis=1)
            chi2 = chi2 + ((one.arrival_s - one.start_s) / one.start_sd_s) ** 2
            shape = -0.5 * np.log(np.maximum(square, 1e-12)) - np.log(np.maximum(height, 1e-6))
            log[:, column] = np.where(height > LEAST_HEIGHT, -0.5 * chi2 + shape, -np.inf)
        one.arrival_s = kept
        return kept[:, None] + trial, log

    def relocate(self) -> None:
        """Move each channel to the best of its arrival times on trial: sparse samples allow several."""
        for one in self.craft:
            trial, log = self.posterior(one, 0.1 * one.start_sd_s)
            best = log.argmax(axis=1)
            row = np.arange(best.size)
            present = log[row, np.abs(trial - one.arrival_s[:, None]).argmin(axis=1)]
            one.arrival_s = np.where(log[row, best] > present + 1.0, trial[row, best], one.arrival_s)

    def chi2(self, value: FloatArray) -> float:
        """Of the samples with their present weights, and the priors."""
        departure = value - self.expected
        total = float(departure @ self.prior @ departure)
        for one in self.craft:
            residual = one.power - one.base[:, None] - one.height[:, None] * self.model(one, value)
            total += float((one.weight * residual**2).sum())
            total += float((((one.arrival_s - one.start_s) / one.start_sd_s) ** 2).sum())
        return total

    def blocks(self) -> tuple[FloatArray, FloatArray, list[tuple[FloatArray, FloatArray, FloatArray]]]:
        """Normal matrix and gradient of the globals, and of each spacecraft the blocks of its channels."""
        matrix, gradient, parts = self.prior.copy(), self.prior @ (self.expected - self.value), []
        for one in self.craft:
            mean, by_time, by_width, by_shape = self.linear(one, self.value)
            height, x = one.height[:, None], self._across(one)[:, None, None]
            local = np.stack([height * by_time, mean, np.ones_like(mean)], axis=-1)
            shape = height[:, :, None] * by_shape
            everywhere = (height * by_width)[:, :, None] * self._width_terms(one)[:, None, :]
            knots = KNOTS.size
            everywhere[:, :, self.slope_at] += shape[:, :, 0]
            everywhere[:, :, self.slope_at + 1] += shape[:, :, 0] * x[:, :, 0]
            everywhere[:, :, -2 * knots : -knots] += shape[:, :, 1:-1]
            everywhere[:, :, -knots:] += shape[:, :, 1:-1] * x
            everywhere[:, :, self.fall_at + one.index] += shape[:, :, -1]
            everywhere[:, :, self.fall_at + len(self.craft) + one.index] += shape[:, :, -1] * x[:, :, 0]
            residual = one.power - one.base[:, None] - height * mean
            weighted = local * one.weight[:, :, None]
            square = weighted.transpose(0, 2, 1) @ local
            square[:, 0, 0] += one.start_sd_s**-2.0
            square[:, 1, 1] += 1e-4
            square[:, 2, 2] += 1e-4
            mixed = weighted.transpose(0, 2, 1) @ everywhere
            pull = (weighted * residual[:, :, None]).sum(axis=1)
            pull[:, 0] += (one.start_s - one.arrival_s) / one.start_sd_s**2
            flat = (everywhere * one.weight[:, :, None]).reshape(-1, self.value.size)
            matrix += flat.T @ everywhere.reshape(-1, self.value.size)
            gradient += flat.T @ residual.reshape(-1)
            parts.append((square, mixed, pull))
        return matrix, gradient, parts

    def step(self, damping: float) -> tuple[FloatArray, list[FloatArray]]:
        """Change of the globals and of time, height and background of the channels."""
        matrix, gradient, parts = self.cached
        schur = matrix + damping * np.diag(np.diag(matrix))
        right = gradient.copy()
        solved = []
        for square, mixed, pull in parts:
            damped = square + damping * square * np.eye(3)
            inverse = np.linalg.inv(damped)
            by_global, alone = inverse @ mixed, (inverse @ pull[:, :, None])[:, :, 0]
            schur -= (mixed.transpose(0, 2, 1) @ by_global).sum(axis=0)
            right -= (mixed.transpose(0, 2, 1) @ alone[:, :, None]).sum(axis=0)[:, 0]
            solved.append((by_global, alone))
        change = np.linalg.solve(schur, right)
        return np.asarray(change, dtype=np.float64), [alone - by_global @ change for by_global, alone in solved]

    def descend(self, steps: int) -> float:
        """Levenberg steps with the present weights; returns by how much the last one lowered chi2."""
        damping, present = 1e-3, self.chi2(self.value)
        gained = np.inf
        for _ in range(steps):
            self.cached = self.blocks()
            for _ in range(6):
                change, local = self.step(damping)
                before = self.value, [(one.arrival_s, one.height, one.base) for one in self.craft]
                self.value = self.value + np.clip(change, -1.0, 1.0)
                for one, delta in zip(self.craft, local, strict=True):
                    most = 0.8 * np.exp(one.log_width) + 0.15 * one.start_sd_s
                    one.arrival_s = one.arrival_s + np.clip(delta[:, 0], -most, most)
                    one.height = np.clip(one.height + delta[:, 1], 0.05, 30.0)
                    one.base = one.base + delta[:, 2]
                tried = self.chi2(self.value)
                if np.isfinite(tried) and tried <= present:
                    gained, present, damping = present - tried, tried, max(damping / 5, 1e-6)
                    break
                self.value = before[0]
                for one, (arrival, height, base) in zip(self.craft, before[1], strict=True):
                    one.arrival_s, one.height, one.base = arrival, height, base
                damping *= 8
            else:
                return 0.0
            if gained < 0.1 * CONVERGED:
                return gained
        return gained

    def solve(self, starts: Sequence[Start]) -> ProfileEdges:
        """Fit, and the edges with their errors."""
        for turn in range(ROUNDS):
            self.weigh(scaled=turn >= 2)
            if turn in RELOCATED:
                self.relocate()
            gained = self.descend(STEPS if turn < ROUNDS - 1 else LAST_STEPS)
        if not gained < CONVERGED:
            raise NoDataError(f"no shared profile: the fit does not converge (chi2 still falls by {gained:.2g})")
        return self._edges(starts)

    def _edges(self, starts: Sequence[Start]) -> ProfileEdges:
        self.cached = self.blocks()
        matrix, _, parts = self.cached
        schur = matrix.copy()
        for square, mixed, _ in parts:
            schur -= (mixed.transpose(0, 2, 1) @ np.linalg.solve(square, mixed)).sum(axis=0)
        root = np.linalg.inv(np.linalg.cholesky(schur)).T  # root @ root.T is the covariance of the globals
        columns: dict[str, list[npt.NDArray[np.generic]]] = {
            name: [] for name in ("observatory", "frequency", "arrival", "rise", "flag", "alone", "shared")
        }
        collapsed = []
        for one, start, (square, mixed, *_) in zip(self.craft, starts, parts, strict=True):
            light = one.light
            inverse = np.linalg.inv(square)
            level, rise, by_level = self._level(one)
            shared = (by_level - (inverse @ mixed)[:, 0]) @ root
            number = light.frequency_mhz.size
            arrival, rises, alone = (np.full(number, np.nan) for _ in range(3))
            every = np.full((number, root.shape[1]), np.nan)
            trial, log = self.posterior(one, np.sqrt(inverse[:, 0, 0]))
            possible = np.isfinite(log).any(axis=1)
            mean, sd = one.arrival_s.copy(), np.sqrt(inverse[:, 0, 0])
            mean[possible], sd[possible] = _moments(trial[possible], log[possible])
            arrival[one.rows], rises[one.rows] = mean + level, rise
            alone[one.rows], every[one.rows] = sd, shared
            columns["observatory"].append(np.full(number, light.observatory, dtype=object))
            for name, values in (
                ("frequency", light.frequency_mhz),
                ("arrival", arrival),
                ("rise", rises),
                ("flag", start.flag),
                ("alone", alone),
                ("shared", every),
            ):
                columns[name].append(values)
            collapsed.append(self._collapsed(one, level))
        joined = {name: np.concatenate(values) for name, values in columns.items()}
        factors = {
            one.light.observatory: float(np.exp(self.value[3 + one.index] - self.value[3 : 3 + len(self.craft)].mean()))
            for one in self.craft
        }
        return ProfileEdges(
            joined["observatory"],
            joined["frequency"],
            joined["arrival"],
            joined["rise"],
            joined["flag"],
            joined["alone"],
            joined["shared"],
            tuple(collapsed),
            factors,
        )

    def _level(self, one: Craft) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Time from the pivot to the level, from there to the maximum, and derivatives of the former by the globals."""
        log, by = self._log_profile(one, self.value)
        terms = self._width_terms(one)
        width = np.exp(one.log_width + terms @ self.value)
        row = np.arange(width.size)
        top = log.argmax(axis=1)
        wanted = log[row, top] + np.log(LEVEL)
        rising = (log >= wanted[:, None]).argmax(axis=1)
        share = (wanted - log[row, rising - 1]) / (log[row, rising] - log[row, rising - 1])
        at = GRID[rising - 1] + STEP * share
        slope = (log[row, rising] - log[row, rising - 1]) / STEP
        here = by[row, rising - 1] + share[:, None] * (by[row, rising] - by[row, rising - 1])
        moved = (by[row, top] - here) / slope[:, None]
        x, knots = self._across(one)[:, None], KNOTS.size
        derivative = at[:, None] * terms
        derivative[:, self.slope_at : self.slope_at + 2] += np.hstack([moved[:, :1], moved[:, :1] * x])
        derivative[:, -2 * knots :] += np.hstack([moved[:, 1:-1], moved[:, 1:-1] * x])
        return at * width, (GRID[top] - at) * width, derivative * width[:, None]

    def _collapsed(self, one: Craft, level_s: FloatArray) -> Collapsed:
        top = np.exp(self._log_profile(one, self.value)[0].max(axis=1))[:, None]
        mean = self.model(one, self.value) / top
        width = np.exp(one.log_width + self._width_terms(one) @ self.value)[:, None]
        widths = (one.time_s - one.arrival_s[:, None] - level_s[:, None]) / width
        height = (one.power - one.base[:, None]) / one.height[:, None] / top
        shown = (np.where(one.known, values, np.nan) for values in (widths, height, mean))
        return Collapsed(one.light.observatory, one.frequency_mhz, *shown)


def _moments(at: FloatArray, log: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean and standard deviation along the second axis of a density whose logarithm is known at points."""
    density = np.exp(log - log.max(axis=1, keepdims=True))
    share = density * _spacing(at)
    share /= share.sum(axis=1, keepdims=True)
    mean = (share * at).sum(axis=1)
    return mean, np.sqrt((share * (at - mean[:, None]) ** 2).sum(axis=1))


def _spacing(at: FloatArray) -> FloatArray:
    """Length that belongs to each point along the second axis."""
    steps = np.diff(at, axis=1)
    return np.asarray(0.5 * (np.pad(steps, ((0, 0), (1, 0))) + np.pad(steps, ((0, 0), (0, 1)))))


def _window(
    table: FloatArray, whole: FloatArray, window: tuple[FloatArray, FloatArray], width: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Means of tables over a window, and derivatives of that of the first by time and ln width."""
    low, high = window
    (below, at_low), (above, at_high) = (_integral(table, whole, end) for end in window)
    span = high - low
    means = (above - below) / span[:, :, None]
    by_time = -(at_high - at_low) / (span * width)
    return means, by_time, means[:, :, 0] - (high * at_high - low * at_low) / span


def _integral(table: FloatArray, whole: FloatArray, at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Running integrals of all tables at points, shape (C, M, T), and the value of the first table there, (C, M)."""
    inside = np.clip(at, GRID[0], GRID[-1])
    place = np.clip(((inside - GRID[0]) / STEP).astype(np.intp), 0, GRID.size - 2)
    share = ((inside - GRID[0]) / STEP - place)[:, :, None]
    row = np.arange(len(table))[:, None]
    low, high = table[row, place], table[row, place + 1]
    integral = whole[row, place] + STEP * share * (low + 0.5 * share * (high - low))
    value = low + share * (high - low)
    return integral + value * (at - inside)[:, :, None], value[:, :, 0]


def _shape_error(one: Craft, square: FloatArray, fixed: FloatArray, height2: FloatArray) -> float:
    """Share of the maximum that makes the median reduced chi2 of the channels of a spacecraft 1; sets its `excess`."""
    free = np.maximum((one.known & np.isfinite(height2)).sum(axis=1) - LOST, 1)
    free = free * (1.0 - 2.0 / (9.0 * free)) ** 3  # median of chi2 (Wilson & Hilferty 1931)
    for error in np.geomspace(SHAPE_ERROR, LARGEST_SHAPE_ERROR, 24):
        away = np.where(one.known, np.minimum(square / (fixed + error**2 * height2), OUTLIER_SD**2), 0.0)
        reduced = float(np.median(away.sum(axis=1) / free))
        if error == SHAPE_ERROR:
            one.excess = float(np.clip(reduced, LEAST_EXCESS, 1.0))
        if reduced <= 1.0:
            return float(error)
    return LARGEST_SHAPE_ERROR


def _decay_error(relative: FloatArray) -> float:
    if relative.size < 10:
        return DECAY_ERROR
    return float(np.clip(1.4826 * np.median(np.abs(relative)), LEAST_DECAY_ERROR, LARGEST_DECAY_ERROR))
