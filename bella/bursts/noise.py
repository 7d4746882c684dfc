"""Noise of the arrival times of one burst, and the smooth curve t(f) of each spacecraft.

Beyond the error of each channel and the errors of a shared profile, light curves of spacecraft differ by more than a
profile that all share. That error is smooth along frequency. How large it is shows where the differences between
spacecraft are not as smooth as geometry makes them: it is estimated from each burst, by marginal likelihood, before
any source is placed. One covariance follows from it, for the channels as they are and for any frequencies between.
"""

from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.linalg import cho_factor, cho_solve, cholesky, solve_triangular
from scipy.optimize import nnls

from bella.arrivals import error_scale_s, evenly_spread
from bella.exceptions import NoDataError
from bella.units import FloatArray

BoolArray = npt.NDArray[np.bool_]

SHAPE_SHARES = np.geomspace(0.0005, 0.4, 14)
"""Smooth errors on trial, in rise times of the burst; beforehand all are as likely.

Simulated bursts have 0.002 to 0.006, the real bursts of 2012-06-07 and 2020-07-21 have 0.1.
"""

FIT_FACTORS = np.geomspace(0.7, 12.0, 8)
"""How many times too small the errors of the fit of the light curves may be, on trial.

Simulated bursts of one generator have 1.6, of another 1.05, the two real ones 1.6 to 1.8. An error that is a share of
the rise in its place is less likely by 5 in ln L for each burst of the first, and as likely for the others.
"""

STUDENT_FREEDOM = 4.0
"""Degrees of freedom of the error of a channel: where samples do not resolve a rise, a channel is sometimes wrong by
far more than its neighbours, and one error for all would take that for a smooth error of all spacecraft. With 3 and 6
the stated errors are the same to a tenth.
"""

WEIGHT_STEPS, NOISE_ROUNDS = 4, 3
"""Steps of the errors of single channels, and rounds of these with the errors that all have: with twice as many rounds
the pulls of simulated bursts are the same to 0.02."""

SHAPE_LENGTH_LN_F = 0.2
"""Correlation length of the smooth error in ln f. Of 0.1 to 0.5 the two real events prefer it, by 3 to 16 in ln L."""

BROAD_S = 3e3
"""Standard deviation of the terms of the time of emission, s: free."""

WAVE_SHARE, WAVE_LENGTH = 0.05, 0.35
"""What is left about them, as a share of the time that the burst takes, and its length in ln f: densities wave."""

DIFFERENCE_S, DIFFERENCE_SD_S, DIFFERENCE_LENGTH = 300.0, 5.0, 0.7
"""Differences of spacecraft are smooth in the distance of the source, and so in the time of emission, whatever density
belongs to a frequency: a cubic with coefficients of this size, s, and what is left about it, with its length in halves
of the time that the burst takes."""

CURVE_SD_S = 0.05
"""Independent error of times between channels: a curve is not perfectly smooth."""

ALONG_ERROR, ALONG_LEAST_S = 0.06, 0.3
"""Errors of channels about t(f) for finding outliers, in rise times and s."""

OUTLIER_SD, MOST_OUTLIERS = 4.0, 0.25
"""A channel so far from the curve through all others is an outlier; at most so many are."""

WORST_RISES, WORST_S = 1.2, 10.0
"""A channel with a larger error than so many rise times and seconds is not timed."""

MOST_CHANNELS = 40
"""Of a spacecraft: those of closer channels are not independent, as Wind/WAVES RAD1 on 4 kHz is interpolated."""

MOST_FOR_NOISE = 28
"""The same for estimating the noise: its share is then good to a quarter, in a fifth of the time."""

OFFSET_S = 0.05
"""Timing offset of a spacecraft beside its clock and its sample times: simulated bursts need none, and with three times
as much their stated errors are too large by a third."""

WIDTH_ERROR = 0.2
"""Error of the edge of a spacecraft, in rise times, over the spread of ln width between the spacecraft: light curves
that differ in width differ in asymmetry too, and half of the maximum is then no longer the same moment. By this number
pulls of simulated bursts whose rises and decays differ are 0.7, and regions of bursts of another generator hold."""

LEAST_SIGMA_S = 0.05
"""Independent error that the table gives every time at least."""

PER_CHANNEL = (
    "observatory",
    "frequency_mhz",
    "arrival_s",
    "rise_s",
    "channel_sd_s",
    "shared_s",
    "offset_s",
    "shape_sd_s",
)
WIDEST_HOLE = 2.0
"""Ratio of neighbouring channels with an arrival time up to which times between them are given: over a wider hole the
times of a burst are not as smooth as the process takes them to be.
"""


@dataclass(frozen=True)
class Timed:
    """Arrival times of one burst with their noise.

    Attributes
    ----------
    frequency_mhz, arrival_s, rise_s, channel_sd_s : ndarray, shape (N,)
        The last is the error of each channel on its own.
    shared_s : ndarray, shape (N, G)
        Errors that channels share, of the profile: their covariance is ``shared_s @ shared_s.T``.
    offset_s : ndarray, shape (N,)
        Standard deviation of the offset of the spacecraft.
    shape_sd_s : ndarray, shape (N,)
        Error that is smooth along frequency within a spacecraft.
    width_share : float
        Error that a spacecraft keeps along the whole band, in rise times; not part of :meth:`covariance_s2`.
    correlated_s2 : ndarray, shape (N, N)
        What an interpolation leaves uncertain; empty without one.
    """

    observatory: npt.NDArray[np.object_]
    frequency_mhz: FloatArray
    arrival_s: FloatArray
    rise_s: FloatArray
    channel_sd_s: FloatArray
    shared_s: FloatArray
    offset_s: FloatArray
    shape_sd_s: FloatArray
    width_share: float = 0.0
    correlated_s2: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))

    def take(self, rows: npt.NDArray[np.generic]) -> "Timed":
        """Some of the channels."""
        return replace(self, **{name: getattr(self, name)[rows] for name in PER_CHANNEL})

    @property
    def shape_share(self) -> float:
        """Smooth error in rise times, median."""
        return float(np.median(self.shape_sd_s / self.rise_s))

    @property
    def channel_share(self) -> float:
        """Independent error in rise times, median."""
        return float(np.median(self.channel_sd_s / self.rise_s))

    def covariance_s2(self) -> FloatArray:
        """Full covariance, shape (N, N)."""
        own = _shape(self, self.shape_sd_s) + _of_one(self, np.outer(self.offset_s, self.offset_s))
        between = self.shared_s @ self.shared_s.T + (self.correlated_s2 if self.correlated_s2.size else 0.0)
        return np.asarray(np.diag(self.channel_sd_s**2) + own + between)


def _of_one(timed: Timed, covariance_s2: FloatArray) -> FloatArray:
    """A covariance within each spacecraft, and none between them."""
    return np.where(timed.observatory[:, None] == timed.observatory, covariance_s2, 0.0)


def _shape(timed: Timed, size_s: FloatArray) -> FloatArray:
    """Covariance of an error that is smooth along frequency within each spacecraft."""
    return _of_one(timed, _smooth(timed.frequency_mhz, size_s, SHAPE_LENGTH_LN_F))


def _smooth(frequency_mhz: FloatArray, size_s: FloatArray, length_ln_f: float) -> FloatArray:
    """Covariance of what is smooth along frequency."""
    apart = np.subtract.outer(np.log(frequency_mhz), np.log(frequency_mhz))
    return np.asarray(np.outer(size_s, size_s) * np.exp(-0.5 * (apart / length_ln_f) ** 2))


def _free(terms: list[FloatArray], size_s: float) -> FloatArray:
    basis = np.stack(terms, axis=-1)
    return np.asarray(size_s**2 * basis @ basis.T)


def _beam(frequency_mhz: FloatArray) -> FloatArray:
    """Prior covariance of t(f) of a beam: 1, ln f, f^-1/2, 1/f and 1/f^2, which miss it by 0.2 s rms."""
    x = 1.0 / frequency_mhz
    return _free([np.ones_like(x), np.log(x), np.sqrt(x), x, 0.2 * x**2], BROAD_S)


def _emission(frequency_mhz: FloatArray, span_s: float) -> FloatArray:
    """Prior covariance of the time of emission, for a burst that takes so long."""
    wave = _smooth(frequency_mhz, np.full(frequency_mhz.size, WAVE_SHARE * span_s), WAVE_LENGTH)
    return np.asarray(_beam(frequency_mhz) + wave)


def _curves(timed: Timed, known: int | None = None) -> FloatArray:
    """Prior covariance of t(f): common to all spacecraft, and a difference that is smooth in the time of emission.

    Parameters
    ----------
    known : int, optional
        Rows after so many have no arrival time yet.
    """
    arrival_s, log_f, x = timed.arrival_s[:known], np.log(timed.frequency_mhz), 1.0 / timed.frequency_mhz
    common = _emission(timed.frequency_mhz, float(np.ptp(arrival_s)))
    own = common + _of_one(timed, _free([np.ones_like(x), log_f, x], DIFFERENCE_S))
    noise = (timed.channel_sd_s**2 + (ALONG_ERROR * timed.rise_s) ** 2)[:known] + ALONG_LEAST_S**2
    emitted = common[:, :known] @ np.linalg.solve(own[:known, :known] + np.diag(noise), arrival_s - arrival_s.mean())
    along = 2.0 * (emitted - emitted[:known].min()) / np.ptp(emitted[:known]) - 1.0
    apart = np.subtract.outer(along, along)
    smooth = DIFFERENCE_SD_S**2 * np.exp(-0.5 * (apart / DIFFERENCE_LENGTH) ** 2)
    return common + _of_one(timed, _free([along**power for power in range(4)], DIFFERENCE_S) + smooth)


def width_spread(timed: Timed) -> float:
    """Standard deviation of ln rise between the spacecraft, over the band of the burst.

    Returns
    -------
    float
        0 where all rise alike, or there is one spacecraft.
    """
    names, own = np.unique(timed.observatory.astype(str), return_inverse=True)
    if names.size < 2:
        return 0.0
    x = np.log(timed.frequency_mhz)
    x = (x - x.mean()) / max(float(np.ptp(x)), 1e-9)
    member = np.eye(names.size)[own]
    common = np.stack([x**power for power in range(2, 4)], axis=-1)
    design = np.concatenate([member, member * x[:, None], common], axis=1)
    found = np.linalg.lstsq(design, np.log(timed.rise_s), rcond=None)[0]
    along = np.linspace(x.min(), x.max(), 9)
    lines = found[: names.size, None] + found[names.size : 2 * names.size, None] * along
    return float(np.sqrt(lines.var(axis=0, ddof=1).mean()))


def estimate_noise(timed: Timed) -> Timed:
    """Estimate the smooth and the independent error of the arrival times of a burst.

    Arrival times are a smooth function of frequency that all spacecraft share, and a smoother one for each. The smooth
    error and the factor on the errors of the fit are the means over their posterior. A channel has its own part of
    that factor, by Student's t distribution (expectation and maximisation, Lange et al. 1989, J. Am. Stat. Assoc. 84,
    881, doi:10.1080/01621459.1989.10478852).

    Parameters
    ----------
    timed : Timed
        With the errors of the fit of the light curves, and in `shape_sd_s` those of the times of the samples.

    Returns
    -------
    Timed
        With `channel_sd_s`, `shape_sd_s` and `width_share`.
    """
    timed = replace(timed, channel_sd_s=np.maximum(timed.channel_sd_s, LEAST_SIGMA_S))
    thin = timed.take(spread_channels(timed, MOST_FOR_NOISE))
    errors = max(map(_Misfit.of(thin).settled, STARTS), key=lambda one: one[1])[0]
    widening = _Misfit.of(timed).widening(errors, np.ones(timed.arrival_s.size))
    return replace(
        timed,
        shape_sd_s=np.hypot(timed.shape_sd_s, errors.shape * error_scale_s(timed.rise_s)),
        channel_sd_s=errors.factor * np.sqrt(widening) * timed.channel_sd_s,
        width_share=WIDTH_ERROR * width_spread(timed),
    )


class _Errors(NamedTuple):
    """The errors that all channels have: the smooth one in rise times, and the factor on those of the fit."""

    shape: float
    factor: float


STARTS = (_Errors(0.01, 1.6), _Errors(0.3, 1.6))
"""Where the search begins, in small and large errors: a few channels that are far off count as an error of all from the
second alone, and from the first alone an error of all as one of many channels.
"""


@dataclass(frozen=True)
class _Misfit:
    """Arrival times less their mean, and the covariances that they may have.

    Attributes
    ----------
    away_s : ndarray, shape (N,)
    expected_s2, smooth_s2 : ndarray, shape (N, N)
        Of times that have no error but the shared ones, and of a smooth error of one rise time.
    channel_s2 : ndarray, shape (N,)
        Variance of each channel by the fit of its light curve.
    """

    away_s: FloatArray
    expected_s2: FloatArray
    smooth_s2: FloatArray
    channel_s2: FloatArray

    @classmethod
    def of(cls, timed: Timed) -> "_Misfit":
        known = _shape(timed, timed.shape_sd_s) + _of_one(timed, np.outer(timed.offset_s, timed.offset_s))
        return cls(
            timed.arrival_s - timed.arrival_s.mean(),
            _curves(timed) + timed.shared_s @ timed.shared_s.T + known,
            _shape(timed, error_scale_s(timed.rise_s)),
            timed.channel_sd_s**2,
        )

    def settled(self, errors: _Errors) -> tuple[_Errors, float]:
        """The errors that all have, once those of single channels are known as well, and how likely all are (ln)."""
        widening = np.ones(self.away_s.size)
        for _ in range(NOISE_ROUNDS):
            widening = self.widening(errors, widening)
            errors = self.errors(widening)
        root = cholesky(self._covariance_s2(errors, widening), lower=True, check_finite=False)
        white = solve_triangular(root, self.away_s, lower=True, check_finite=False)
        log_prior = -(0.5 * STUDENT_FREEDOM + 1.0) * np.log(widening) - 0.5 * STUDENT_FREEDOM / widening
        return errors, float(-0.5 * white @ white - np.log(np.diag(root)).sum() + log_prior.sum())

    def errors(self, widening: FloatArray) -> _Errors:
        """The errors that all have, for channels of widened variance."""
        log = np.empty((SHAPE_SHARES.size, FIT_FACTORS.size))
        for i, shape in enumerate(SHAPE_SHARES):
            for j, factor in enumerate(FIT_FACTORS):
                covariance = self._covariance_s2(_Errors(shape, factor), widening)
                root = cholesky(covariance, lower=True, overwrite_a=True, check_finite=False)
                white = solve_triangular(root, self.away_s, lower=True, check_finite=False)
                log[i, j] = -0.5 * white @ white - np.log(np.diag(root)).sum()
        weight = np.exp(log - log.max())
        weight /= weight.sum()
        return _Errors(weight.sum(axis=1) @ SHAPE_SHARES, weight.sum(axis=0) @ FIT_FACTORS)

    def widening(self, errors: _Errors, before: FloatArray) -> FloatArray:
        """What the variance of each channel is multiplied by, shape (N,)."""
        known_s2 = errors.factor**2 * self.channel_s2
        for _ in range(WEIGHT_STEPS):
            variance = before * known_s2
            inverse = np.linalg.inv(self._covariance_s2(errors, before))
            squared_s2 = (variance * (inverse @ self.away_s)) ** 2 + variance - variance**2 * np.diag(inverse)
            before = (STUDENT_FREEDOM + squared_s2 / known_s2) / (STUDENT_FREEDOM + 1.0)
        return before

    def _covariance_s2(self, errors: _Errors, widening: FloatArray) -> FloatArray:
        covariance = self.expected_s2 + errors.shape**2 * self.smooth_s2
        covariance[np.diag_indices_from(covariance)] += errors.factor**2 * widening * self.channel_s2
        return covariance


def spread_channels(timed: Timed, most: int = MOST_CHANNELS) -> npt.NDArray[np.intp]:
    """Channels of each spacecraft that are evenly spread in ln f, no more than a number of each."""
    chosen = []
    for name in dict.fromkeys(timed.observatory):
        rows = np.flatnonzero(timed.observatory == name)
        chosen.append(rows[evenly_spread(timed.frequency_mhz[rows], most)] if rows.size > most else rows)
    return np.concatenate(chosen)


def outliers(timed: Timed) -> BoolArray:
    """Channels that lie far from the curve through the others of their spacecraft, found one at a time.

    Returns
    -------
    ndarray of bool, shape (N,)
        Among them those whose error is too large to be of use.
    """
    wrong = timed.channel_sd_s > WORST_RISES * timed.rise_s + WORST_S
    for name in dict.fromkeys(timed.observatory):
        rows = np.flatnonzero((timed.observatory == name) & ~wrong)
        part = timed.take(rows)
        noise = part.channel_sd_s**2 + (ALONG_ERROR * part.rise_s) ** 2 + ALONG_LEAST_S**2
        kept = np.arange(rows.size)
        inverse = np.linalg.inv(_emission(part.frequency_mhz, float(np.ptp(part.arrival_s))) + np.diag(noise))
        for _ in range(int(MOST_OUTLIERS * rows.size)):
            values = part.arrival_s[kept] - part.arrival_s[kept].mean()
            # leave-one-out residual over its standard deviation (Sundararajan & Keerthi 2001)
            away = np.abs(inverse @ values) / np.sqrt(np.diag(inverse))
            if kept.size < 5 or away.max() <= OUTLIER_SD:
                break
            worst = int(away.argmax())
            wrong[rows[kept[worst]]] = True
            # inverse of the covariance without that channel (Schur complement)
            inverse = inverse - np.outer(inverse[:, worst], inverse[worst]) / inverse[worst, worst]
            inverse = np.delete(np.delete(inverse, worst, axis=0), worst, axis=1)
            kept = np.delete(kept, worst)
    return np.asarray(wrong)


def at_frequencies(timed: Timed, frequency_mhz: FloatArray) -> Timed:
    """Arrival times at frequencies between the channels: one Gaussian process for all spacecraft.

    Parameters
    ----------
    frequency_mhz : ndarray, shape (F,)
        A spacecraft has rows for those within its own band, but for holes wider than `WIDEST_HOLE`.

    Returns
    -------
    Timed
        The noise is that of the channels, carried through the process; `correlated_s2` is what it leaves uncertain.

    Raises
    ------
    NoDataError
        If no spacecraft has a channel near any of the frequencies.
    """
    channels = timed.take(spread_channels(timed))
    rows = _rows_between(channels, frequency_mhz)
    if not rows.frequency_mhz.size:
        raise NoDataError("no spacecraft has edges near the frequencies of the table: widen the band or the time")
    known, both = channels.frequency_mhz.size, _joined([channels, rows])
    # what is smooth within a spacecraft is followed, whether it is true or an error, and stays in `shape_sd_s`
    prior = _curves(both, known) + _shape(both, both.shape_sd_s)
    noisy = prior[:known, :known] + np.diag(channels.channel_sd_s**2)
    weight = cho_solve(cho_factor(noisy), prior[:known, known:]).T
    middle = channels.arrival_s.mean()
    return replace(
        rows,
        arrival_s=middle + weight @ (channels.arrival_s - middle),
        shared_s=weight @ channels.shared_s,
        correlated_s2=prior[known:, known:] - weight @ prior[:known, known:],
    )


def _rows_between(channels: Timed, frequency_mhz: FloatArray) -> Timed:
    """Rows at the frequencies that each spacecraft has channels around, without arrival times."""
    parts = []
    for name in dict.fromkeys(channels.observatory):
        part = channels.take(np.flatnonzero(channels.observatory == name))
        asked = frequency_mhz[_between_neighbours(part.frequency_mhz, frequency_mhz)]
        order = np.argsort(part.frequency_mhz)
        along = {
            values: np.interp(np.log(asked), np.log(part.frequency_mhz[order]), getattr(part, values)[order])
            for values in ("rise_s", "shape_sd_s", "offset_s")
        }
        nearest = part.take(np.zeros(asked.size, dtype=np.intp))
        none = np.full(asked.size, CURVE_SD_S)
        parts.append(replace(nearest, frequency_mhz=asked, channel_sd_s=none, **along))
    return _joined(parts)


def _joined(parts: list[Timed]) -> Timed:
    """The rows of all parts; values of the whole burst are those of the first part."""
    joined: dict[str, Any] = {name: np.concatenate([getattr(one, name) for one in parts]) for name in PER_CHANNEL}
    return replace(parts[0], **joined)


def _between_neighbours(channels_mhz: FloatArray, frequency_mhz: FloatArray) -> npt.NDArray[np.bool_]:
    """Which frequencies lie between channels that are no farther apart than the widest hole."""
    known = np.sort(channels_mhz)
    above = known[np.minimum(np.searchsorted(known, frequency_mhz * (1 - 1e-9)), known.size - 1)]
    below = known[np.maximum(np.searchsorted(known, frequency_mhz * (1 + 1e-9), side="right") - 1, 0)]
    inside = (frequency_mhz >= known[0] * (1 - 1e-9)) & (frequency_mhz <= known[-1] * (1 + 1e-9))
    return np.asarray(inside & (above <= WIDEST_HOLE * below))


def _smooth_shares(timed: Timed, own_s2: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Shares of the variance of interpolated times that are smooth along frequency, and that last along the band.

    From the correlations of the rows of each spacecraft, by least squares, none below zero.
    """
    smooth, lasting = np.zeros(timed.frequency_mhz.size), np.zeros(timed.frequency_mhz.size)
    for name in dict.fromkeys(timed.observatory):
        rows = np.flatnonzero(timed.observatory == name)
        if rows.size < 2:
            continue
        one, other = np.triu_indices(rows.size, 1)
        deviation = np.maximum(np.sqrt(np.diag(own_s2)[rows]), LEAST_SIGMA_S)
        correlation = (own_s2[np.ix_(rows, rows)] / np.outer(deviation, deviation))[one, other]
        near = _smooth(timed.frequency_mhz[rows], np.ones(rows.size), SHAPE_LENGTH_LN_F)[one, other]
        found = nnls(np.stack([near, np.ones(near.size)], axis=1), correlation)[0]
        smooth[rows], lasting[rows] = found / max(found.sum(), 1.0)
    return smooth, lasting


def _own_variance(timed: Timed) -> tuple[FloatArray, FloatArray]:
    """Variance of the errors that rows share, without what is the same for all spacecraft.

    Returns
    -------
    variance_s2 : ndarray, shape (N,)
        Those of two spacecraft add up to the variance of the difference of their times: exactly for two and three
        spacecraft, by least squares for more.
    own_s2 : ndarray, shape (N, N)
        Covariance of the errors less their mean over the spacecraft at each frequency.
    """
    names, log_f = list(dict.fromkeys(timed.observatory)), np.log(timed.frequency_mhz)
    total = timed.shared_s @ timed.shared_s.T + (timed.correlated_s2 if timed.correlated_s2.size else 0.0)
    at = np.zeros((len(names), log_f.size, log_f.size))
    has = np.zeros((len(names), log_f.size), dtype=bool)
    for number, name in enumerate(names):
        rows = np.flatnonzero(timed.observatory == name)
        rows = rows[np.argsort(log_f[rows])]
        has[number] = (log_f >= log_f[rows[0]] - 1e-9) & (log_f <= log_f[rows[-1]] + 1e-9)
        for row in rows:
            at[number, :, row] = np.interp(log_f, log_f[rows], (rows == row).astype(float))
    at *= has[:, :, None]
    own = np.eye(log_f.size) - at.sum(axis=0) / has.sum(axis=0)[:, None]
    between = np.einsum("mij,jk,nik->imn", at, total, at, optimize=True)
    variance = np.diag(total).copy()
    for index, (covariance, present) in enumerate(zip(between, has.T, strict=True)):
        number = int(present.sum())
        if number < 2:
            continue
        some = covariance[np.ix_(present, present)]
        apart = np.add.outer(np.diag(some), np.diag(some)) - 2.0 * some
        every = apart.sum() / (2.0 * (number - 1))
        which = int(np.flatnonzero(present).searchsorted(names.index(timed.observatory[index])))
        variance[index] = every / 2.0 if number == 2 else (apart[which].sum() - every) / (number - 2)
    return np.maximum(variance, 0.0), own @ total @ own.T


def noise_columns(timed: Timed) -> dict[str, FloatArray]:
    """Noise of the arrival times as an arrival table has it.

    Errors that all spacecraft share at a frequency cancel in differences and are left out: the sum of the variances of
    two spacecraft is that of the difference of their times.

    Returns
    -------
    dict of str to ndarray, shape (N,)
        ``sigma_s``, ``shape_sd_s``, ``offset_sd_s``, ``delay_sd_s`` and ``rise_s``.
    """
    variance, own_s2 = _own_variance(timed)
    smooth, lasting = _smooth_shares(timed, own_s2) if timed.correlated_s2.size else (1.0, 0.0)
    shape_s2, offset_s2 = variance * smooth, np.zeros(variance.size)
    for name in dict.fromkeys(timed.observatory):
        rows = np.flatnonzero(timed.observatory == name)
        along = (variance * lasting)[rows]
        offset_s2[rows] = along.mean()
        shape_s2[rows] += np.maximum(along - along.mean(), 0.0)
    alone = timed.channel_sd_s**2 + variance * (1.0 - smooth - lasting)
    return {
        "sigma_s": np.sqrt(np.maximum(alone, LEAST_SIGMA_S**2)),
        "shape_sd_s": np.sqrt(shape_s2 + timed.shape_sd_s**2),
        "offset_sd_s": np.sqrt(offset_s2 + timed.offset_s**2),
        "delay_sd_s": timed.width_share * timed.rise_s,
        "rise_s": timed.rise_s,
    }
