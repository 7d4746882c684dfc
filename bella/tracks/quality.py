"""How well a track explains the arrival times of a burst: misfit, outliers, clocks, and the errors that it asks for."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtrc, logsumexp

from bella.arrivals import SHAPE_LENGTH_LN_F, ArrivalGrid, error_scale_s
from bella.records import Parameter
from bella.tracks.likelihood import Likelihood, evidence_of
from bella.tracks.posterior import Nodes, around_the_circle, cells, climb
from bella.units import FloatArray

PLAIN_SHAPE, COMPONENTS = 0.02, 2.5
"""With a smooth error of 0.02 of the rise, chi2 per degree of freedom is above 2.5 for a third of the bursts whose
spacecraft hear different components, and for 3 % of the others (23 and 94 simulated bursts)."""

WIDTHS_DIFFER = 0.07
"""The same where the table states errors of the delay above this share of the rise, as for light curves whose widths
differ by a third: so do those of a half of such bursts, and of none of the others (23 and 94 simulated bursts)."""

DOUBT_SHARE, DOUBT_OFFSET_S = 0.45, 60.0
"""Errors of edges that are not those of one source: smooth, as a share of the rise, as the largest that is tried, and
of each spacecraft, such as bursts a minute apart, or a wrong time scale (69 s), have. A clock that is off has the
second alone."""

ADDED_SHARES, CHANNEL_PART = (0.01, 0.02, 0.035, 0.05, 0.1, 0.15, 0.2, 0.3, 0.45), 1 / 3
"""Smooth errors, as shares of the half width of the rise, that are tried where a table states none or the track misses
its times; each comes with an error of the channels a third as large (0.32 and 0.10 for the burst of 2012-06-07)."""

ADDED_SCALE = 0.05
"""Mean of the exponential prior of that share: it takes a nat of evidence to add 0.05."""

ADDED_P = 0.01
"""The misfit below which smooth errors are tried though the table states some."""

EDGES_DIFFER = 0.15
"""Edges of isolated bursts of eight families differ by less than this share of the rise."""

SHARED_BAND = 0.6
"""Share of the band, in ln f, in which three spacecraft have to be timed for the track to have a check."""

BLIND_RECEIVERS, SHARED_GAP = 3, 0.15
"""Fewer receivers show no error; a spacecraft is timed within this of its channels, in ln f."""

ENOUGH_LESS = 2.0
"""Nats below the best at which no larger errors are tried."""

CLOCK_SIGMAS, LEAST_PRECISION = 3.0, 1e-8
"""An offset of a clock this many standard deviations from zero is named; one known to worse than 10 000 s is none."""

MISFIT_P = 1e-4
"""Two-sided: chi2 is larger, or smaller, once in 10 000 times."""

LARGE_ERRORS = 0.02
"""Chi2 per degree of freedom below which errors are called too large: tables of times between channels, which are on
smooth curves, have 0.02 to 0.4 in simulation, and 1 for the real burst of 2012-06-07; with 30 s it has 0.007."""

OUTLIER_SIGMAS, MOST_OUTLIERS = 6.0, 0.1
"""An arrival time so many standard deviations from what all others predict is left out, up to this share of them."""


@dataclass(frozen=True)
class Quality:
    """How well the best track explains the arrival times, with their errors as stated.

    Attributes
    ----------
    plain_chi2 : float
        Per degree of freedom, with a smooth error of no more than `PLAIN_SHAPE` of the rise.
    offsets : dict of str to Parameter
        Timing offset of each observatory, s, were it free.
    added : float
        Smooth error that the track asks for beyond what the table states, over the half width of the rise.
    dropped : int
        Arrival times that were left out.
    shared_band : float
        Share of the band, in ln f, in which three or more spacecraft were timed.
    width_share : float
        Median of the errors of the delay that the table states, over the half width of the rise.
    """

    chi2: float
    freedom: float
    misfit_p: float
    plain_chi2: float
    offsets: dict[str, Parameter]
    shared_band: float
    width_share: float = 0.0
    added: float = 0.0
    dropped: int = 0

    @property
    def clocks(self) -> list[str]:
        """Observatories whose offset is more than three of its standard deviations."""
        return [name for name, one in self.offsets.items() if abs(one.mean or 0.0) > CLOCK_SIGMAS * (one.sd or np.inf)]

    @property
    def flags(self) -> dict[str, bool]:
        """Flags that the misfit of the times raises, or not."""
        return {
            "poor_fit": self.misfit_p < MISFIT_P,
            "errors_too_large": self.misfit_p > 1 - MISFIT_P and self.chi2 < LARGE_ERRORS * self.freedom,
            "components_differ": self.plain_chi2 > COMPONENTS or self.width_share > WIDTHS_DIFFER,
            "edges_differ": self.added >= EDGES_DIFFER,
            "clock_offset": bool(self.clocks),
            "two_spacecraft": self.shared_band < SHARED_BAND,
            "arrivals_down_weighted": self.dropped > 0,
        }


def has_shape(grid: ArrivalGrid) -> bool:
    """Whether a table says anything of errors that are smooth along frequency."""
    return grid.measured_s2 is not None or bool(grid.shape_sd_s.any())


def shared_band(grid: ArrivalGrid) -> float:
    """Share of the band, in ln f, in which three or more spacecraft were timed."""
    log = np.log(grid.frequency_mhz)
    step = np.linspace(log[0], log[-1], 200)
    timed = np.zeros(step.size)
    for times in grid.arrival_s.T:
        own = log[np.isfinite(times)]
        if own.size:
            timed += np.abs(step[:, None] - own).min(axis=1) < SHARED_GAP
    return float((timed >= BLIND_RECEIVERS).mean())


def with_shape(
    likelihood: Likelihood, nodes: Nodes, quality: Quality, *, stated: bool
) -> tuple[Likelihood, Nodes, float]:
    """The same with the smooth error of highest evidence added, where the table states none or is contradicted."""
    if stated and quality.misfit_p > ADDED_P:
        return likelihood, nodes, 0.0
    best = (_evidence(nodes), likelihood, nodes, 0.0)
    size_s2 = _shape_s2(likelihood)
    for share in ADDED_SHARES:
        wider = replace(likelihood.seen, noise_s2=likelihood.seen.noise_s2 + share**2 * size_s2)
        tried = Likelihood(likelihood.track, wider)
        found = around_the_circle(tried)
        score = _evidence(found) - share / ADDED_SCALE
        if score > best[0]:
            best = (score, tried, found, share)
        elif score < best[0] - ENOUGH_LESS:
            break
    return best[1:]


def _shape_s2(likelihood: Likelihood) -> FloatArray:
    """Covariance of a smooth error of one rise in the middle of the burst, with its part in each channel."""
    rows, column = likelihood.seen.rows, likelihood.seen.observatory
    apart = np.subtract.outer(*2 * [np.log(rows.frequency_mhz)])
    smooth = np.where(column[:, None] == column, np.exp(-0.5 * (apart / SHAPE_LENGTH_LN_F) ** 2), 0.0)
    scale_s = error_scale_s(rows.rise_s)
    return np.asarray(np.outer(scale_s, scale_s) * (smooth + CHANNEL_PART**2 * np.eye(column.size)))


def doubted(likelihood: Likelihood) -> Likelihood:
    """The same with the errors of edges that are not those of one source."""
    column = likelihood.seen.observatory
    apart_s2 = DOUBT_OFFSET_S**2 * (column[:, None] == column)
    noise_s2 = likelihood.seen.noise_s2 + DOUBT_SHARE**2 * _shape_s2(likelihood) + apart_s2
    return replace(likelihood, seen=replace(likelihood.seen, noise_s2=noise_s2))


def without_clocks(likelihood: Likelihood, nodes: Nodes) -> tuple[Likelihood, Nodes]:
    """The same with the clocks free that are off by more than three standard deviations, the worst first."""
    names, freed = likelihood.seen.observatories, list[str]()
    while len(freed) < len(names):
        offsets = _offsets(likelihood, nodes)
        away = {name: abs(one.mean or 0.0) / (one.sd or np.inf) for name, one in offsets.items() if name not in freed}
        if not away or max(away.values()) <= CLOCK_SIGMAS:
            break
        worst = max(away, key=lambda name: away[name])
        freed.append(worst)
        late = (likelihood.seen.observatory == names.index(worst)).astype(np.float64)
        noise_s2 = likelihood.seen.noise_s2 + DOUBT_OFFSET_S**2 * np.outer(late, late)
        likelihood = replace(likelihood, seen=replace(likelihood.seen, noise_s2=noise_s2))
        nodes = around_the_circle(likelihood)
    return likelihood, nodes


def _offsets(likelihood: Likelihood, nodes: Nodes) -> dict[str, Parameter]:
    """Timing offset of each observatory, s, were it free."""
    residual_s, left = projected(likelihood, nodes)
    offsets = {}
    for column, name in enumerate(likelihood.seen.observatories):
        member = (likelihood.seen.observatory == column).astype(np.float64)
        precision = float(member @ left @ member)
        if precision > LEAST_PRECISION:
            mean = float(member @ likelihood.weight @ residual_s) / precision
            offsets[name] = Parameter(mean=mean, sd=precision**-0.5)
    return offsets


def _evidence(nodes: Nodes) -> float:
    return float(logsumexp(nodes.log_evidence + np.log(cells(nodes.phi0_rad))))


def without_outliers(likelihood: Likelihood) -> tuple[Likelihood, Nodes, int]:
    """Nodes without the arrival times that all others contradict, dropped one at a time, the worst first."""
    nodes = around_the_circle(likelihood)
    most, dropped = int(MOST_OUTLIERS * likelihood.seen.size), 0
    while dropped < most:
        away = np.abs(_left_out(likelihood, nodes))
        worst = int(away.argmax())
        if away[worst] < OUTLIER_SIGMAS:
            break
        likelihood = Likelihood(likelihood.track, likelihood.seen.without(worst))
        best = nodes.take(np.array([nodes.log_evidence.argmax()]))
        nodes = climb(likelihood, best.phi0_rad, best.z)
        dropped += 1
    return likelihood, around_the_circle(likelihood) if dropped else nodes, dropped


def _left_out(likelihood: Likelihood, nodes: Nodes) -> FloatArray:
    """Arrival times less what all others predict, in standard deviations, shape (N,)."""
    residual_s, left = projected(likelihood, nodes)
    return np.asarray((likelihood.weight @ residual_s) / np.sqrt(np.diag(left)))


def projected(likelihood: Likelihood, nodes: Nodes) -> tuple[FloatArray, FloatArray]:
    """Residuals of the best track, and the inverse covariance with all of its parameters integrated out."""
    best = int(nodes.log_evidence.argmax())
    phi0, z = nodes.phi0_rad[[best]], nodes.z[[best]]
    residual_s = likelihood.residual_s(phi0, z)
    design = likelihood.track.slopes_s(phi0, z, likelihood.seen.rows)[0]
    weighed = design @ likelihood.weight
    prior = np.diag([1.0] * z.shape[1] + [0.0])
    return residual_s[0], likelihood.weight - weighed.T @ np.linalg.solve(weighed @ design.T + prior, weighed)


def quality_of(likelihood: Likelihood, nodes: Nodes, grid: ArrivalGrid) -> Quality:
    """How well the best of some nodes explains the arrival times."""
    residual_s, left = projected(likelihood, nodes)
    chi2 = float(residual_s @ likelihood.weight @ residual_s)
    freedom = max(float(np.einsum("ij,ji->", left, likelihood.seen.noise_s2)), 1.0)
    offsets = _offsets(likelihood, nodes)
    plain = _plain_chi2(likelihood, nodes, grid)
    assert grid.rise_s is not None  # noqa: S101 - the grid fills it in
    width_share = float(np.nanmedian(np.where(np.isfinite(grid.arrival_s), grid.delay_sd_s / grid.rise_s, np.nan)))
    return Quality(chi2, freedom, float(chdtrc(freedom, chi2)), plain, offsets, shared_band(grid), width_share)


def _plain_chi2(likelihood: Likelihood, nodes: Nodes, grid: ArrivalGrid) -> float:
    """Chi-squared per degree of freedom, was the shape of light curves the same at all spacecraft."""
    if grid.measured_s2 is not None:
        return 0.0
    assert grid.rise_s is not None  # noqa: S101 - the grid fills it in
    plain = Likelihood(
        likelihood.track,
        evidence_of(
            replace(grid, shape_sd_s=np.minimum(grid.shape_sd_s, PLAIN_SHAPE * grid.rise_s), delay_sd_s=np.zeros(()))
        ),
    )
    if plain.seen.size != likelihood.seen.size:
        keep = np.isin(plain.seen.arrival_s, likelihood.seen.arrival_s)
        plain = Likelihood(plain.track, replace(likelihood.seen, noise_s2=plain.seen.noise_s2[np.ix_(keep, keep)]))
    best = nodes.take(np.array([nodes.log_evidence.argmax()]))
    around = best.phi0_rad + np.radians(np.arange(-20.0, 21.0, 4.0))
    found = climb(plain, around, np.repeat(best.z, around.size, axis=0))
    residual_s, left = projected(plain, found)
    freedom = max(float(np.einsum("ij,ji->", left, plain.seen.noise_s2)), 1.0)
    return float(residual_s @ plain.weight @ residual_s) / freedom
