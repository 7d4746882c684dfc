"""Posterior of a track: longitude on a grid around the circle, everything else Gaussian about its best value there.

At each longitude phi0 the other parameters are fitted by Gauss-Newton, and the integral over them is that of Laplace.
So the posterior of the longitude is a table on the circle, and a second track comes out by itself. Draws from the table
and its Gaussians are weighted by the exact density.

The directional delay cannot be measured with a track, only propagated: the arrival times would seem to measure it, by
what they miss of the smooth curves of the model. So the posterior is the mean of those for single delays, each with the
weight that the delay has before the data.
"""

from collections.abc import Generator, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.special import logsumexp

from bella.tracks.likelihood import Likelihood
from bella.tracks.model import Track
from bella.units import FloatArray

COARSE = 48
"""Longitudes of the first grid: 7.5 degrees apart."""

STARTS = (0.0, -1.5, 1.5)
"""Distances that Gauss-Newton begins with, in standard deviations of their prior."""

KEPT = 14.0
"""Longitudes within so many nats of the best are looked at more closely: the others have less than 1e-5 in all."""

HOPEFUL = 60.0
"""Nats below the best after the first iterations, within which a longitude is fitted to the end."""

GAIN = 0.1
"""Nats by which a node has to become better for its neighbours to be tried from there."""

SHARE = 0.35
"""Spacing of the last grid over the standard deviation of the longitude."""

FINEST_RAD = np.radians(0.02)
FIRST_ITERATIONS, NEAR_ITERATIONS, ITERATIONS, SMALL = 8, 3, 40, 1e-2
LARGEST_STEP = 2.0
KAPPA_NODES, KAPPA_SHARES = (-2.0, -1.2, 0.0, 1.2, 2.0), (0.05, 0.25, 0.4, 0.25, 0.05)
"""Delays that are propagated, in standard deviations, and their probabilities: a Gaussian, a little flatter, so that
an interval of 68 % reaches delays of 0 to 0.23 half widths of the rise, and one of 95 % those of 0.3."""

LEAST_OF_A_DELAY = 10.0
"""Effective draws of one delay below which its draws count alike: the Gaussians are then the better answer."""

WIDER = 1.15
"""Draws are taken from Gaussians so much wider than those of Laplace, so that weights stay bounded in the wings."""


@dataclass(frozen=True)
class Nodes:
    """Best parameters at longitudes.

    Attributes
    ----------
    log_density : ndarray, shape (B,)
        At the best parameters.
    """

    phi0_rad: FloatArray
    z: FloatArray
    log_density: FloatArray
    hessian: FloatArray

    @property
    def log_evidence(self) -> FloatArray:
        """Integral over z, per longitude, shape (B,)."""
        return np.asarray(self.log_density - 0.5 * np.linalg.slogdet(self.hessian)[1])

    def take(self, some: np.ndarray) -> "Nodes":
        """Some of the nodes."""
        return Nodes(self.phi0_rad[some], self.z[some], self.log_density[some], self.hessian[some])

    def z_at(self, phi0_rad: FloatArray) -> FloatArray:
        """Best parameters between the nodes, on straight lines, shape (..., P)."""
        after = np.searchsorted(self.phi0_rad, phi0_rad) % self.phi0_rad.size
        ahead = _wrapped(self.phi0_rad[after] - phi0_rad) % (2 * np.pi)
        share = ahead / (_wrapped(self.phi0_rad[after] - self.phi0_rad[after - 1]) % (2 * np.pi))
        return np.asarray(self.z[after] + share[:, None] * (self.z[after - 1] - self.z[after]))

    def and_also(self, other: "Nodes") -> "Nodes":
        """Both, by longitude."""
        joined = Nodes(*(np.concatenate([getattr(one, each.name) for one in (self, other)]) for each in fields(Nodes)))
        return joined.take(np.argsort(joined.phi0_rad))


@dataclass(frozen=True)
class Draws:
    """Weighted draws of a track.

    Attributes
    ----------
    weight : ndarray, shape (M,)
        They add up to one.
    """

    phi0_rad: FloatArray
    z: FloatArray
    weight: FloatArray
    log_evidence: float

    @property
    def effective(self) -> float:
        """Effective number of draws."""
        return float(1 / (self.weight**2).sum())


def climb(likelihood: Likelihood, phi0_rad: FloatArray, z: FloatArray, iterations: int = ITERATIONS) -> Nodes:
    """Best parameters at given longitudes, by Gauss-Newton with Levenberg's damping, all at once.

    Parameters
    ----------
    phi0_rad : ndarray, shape (B,)
    z : ndarray, shape (B, P)
        Where to begin.
    """
    z, damping = z.copy(), np.full(len(z), 1e-3)
    identity = np.eye(z.shape[1])
    residual_s = likelihood.residual_s(phi0_rad, z)
    density = likelihood.log_density_of(residual_s, phi0_rad, z)
    hessian = np.empty((*z.shape, z.shape[1]))
    active = np.arange(len(z))
    fresh = np.ones(len(z), dtype=bool)
    gradient = np.empty_like(z)
    for _ in range(iterations):
        new = active[fresh[active]]
        if new.size:
            hessian[new], gradient[new] = likelihood.normal_equations(residual_s[new], phi0_rad[new], z[new])
        damped = (
            hessian[active]
            + damping[active, None, None] * identity * np.diagonal(hessian[active], axis1=1, axis2=2)[:, None, :]
        )
        step = np.linalg.solve(damped, gradient[active][..., None])[..., 0]
        step = np.clip(step, -LARGEST_STEP, LARGEST_STEP)
        tried = z[active] + step
        left_s = likelihood.residual_s(phi0_rad[active], tried)
        found = likelihood.log_density_of(left_s, phi0_rad[active], tried)
        better = found >= density[active] - 1e-9
        won = active[better]
        z[won], density[won], residual_s[won] = tried[better], found[better], left_s[better]
        damping[active] = np.where(better, damping[active] / 5, damping[active] * 6)
        fresh[active] = better
        small = (np.abs(step) * np.sqrt(np.diagonal(hessian[active], axis1=1, axis2=2))).max(axis=1) < SMALL
        active = active[~((better & small) | (damping[active] > 1e8))]
        if not active.size:
            break
    return Nodes(phi0_rad, z, density, hessian)


def around_the_circle(likelihood: Likelihood, near: Nodes | None = None) -> Nodes:
    """Nodes on the circle, close together where the posterior is.

    Parameters
    ----------
    near : Nodes, optional
        Of a density that is not far from this one, to begin with; without it the search begins at `STARTS`.

    Returns
    -------
    Nodes
        By longitude, from -180 degrees.
    """
    return _together(likelihood, [_search(likelihood.track, near)])[0]


@dataclass(frozen=True)
class _Climb:
    """Where a search asks for the best parameters; arguments of :func:`climb`."""

    phi0_rad: FloatArray
    z: FloatArray
    iterations: int = ITERATIONS


Search = Generator[_Climb, Nodes, Nodes]
"""Asks for climbs one after the other, and ends with the nodes on the circle."""


def _together(likelihood: Likelihood, searches: Sequence[Search]) -> list[Nodes]:
    """Nodes of several searches: what all of them ask for is climbed at once, which costs little more than for one."""
    done: dict[int, Nodes] = {}
    asked = {number: next(search) for number, search in enumerate(searches)}
    while asked:
        limit = max(one.iterations for one in asked.values())
        now = {number: one for number, one in asked.items() if one.iterations == limit}
        phi0, z = (np.concatenate([getattr(one, name) for one in now.values()]) for name in ("phi0_rad", "z"))
        found, first = climb(likelihood, phi0, z, limit), 0
        for number, one in now.items():
            part = found.take(np.arange(first, first + len(one.z)))
            first += len(one.z)
            try:
                asked[number] = searches[number].send(part)
            except StopIteration as end:
                done[number] = end.value
                del asked[number]
    return [done[number] for number in range(len(searches))]


def _search(track: Track, near: Nodes | None) -> Search:
    """Nodes around the circle: first far apart, then closer and closer where the posterior is."""
    phi0 = -np.pi + 2 * np.pi * np.arange(COARSE) / COARSE
    if near is None:
        begin = np.zeros((len(STARTS), COARSE, track.size))
        begin[:, :, track.winds + 1] = np.array(STARTS)[:, None]
        found = yield _Climb(np.tile(phi0, len(STARTS)), begin.reshape(-1, track.size), FIRST_ITERATIONS)
        nodes = _best(found)
    else:
        nodes = yield _Climb(phi0, near.z_at(phi0), NEAR_ITERATIONS)
    yield from _fit_from_neighbours(nodes, (0, 1, -1) if near is None else (0,))
    spacing = 2 * np.pi / COARSE
    while True:
        evidence = nodes.log_evidence
        likely = evidence > evidence.max() - KEPT
        sd = _spread(nodes.phi0_rad, evidence)
        if spacing <= max(SHARE * sd, FINEST_RAD):
            return nodes
        spacing /= 3
        more = np.unique(np.round(_wrapped(nodes.phi0_rad[likely, None] + spacing * np.array([-1, 1])), 9))
        more = more[np.abs(_wrapped(more[:, None] - nodes.phi0_rad)).min(axis=1) > 0.5 * spacing]
        nodes = nodes.and_also((yield _Climb(more, nodes.z_at(more))))


def _fit_from_neighbours(nodes: Nodes, beside: tuple[int, ...]) -> Generator[_Climb, Nodes, None]:
    """Fit the hopeful nodes to the end, and on from those that became better, until no neighbour gains."""
    changed = np.flatnonzero(nodes.log_evidence > nodes.log_evidence.max() - HOPEFUL)
    while changed.size:
        target = np.concatenate([(changed + side) % COARSE for side in beside])
        found = yield _Climb(nodes.phi0_rad[target], nodes.z[np.tile(changed, len(beside))])
        hopeful = found.log_evidence > nodes.log_evidence.max() - HOPEFUL
        better = np.flatnonzero(hopeful & (found.log_evidence > nodes.log_evidence[target] + GAIN))
        better = better[np.argsort(found.log_evidence[better])]  # of two for one node the better is written last
        for each in fields(Nodes):
            getattr(nodes, each.name)[target[better]] = getattr(found, each.name)[better]
        changed, beside = np.unique(target[better]), (1, -1)


def _best(found: Nodes) -> Nodes:
    """Of the nodes from each of `STARTS`, one after the other, those with the largest evidence at each longitude."""
    which = found.log_evidence.reshape(len(STARTS), COARSE).argmax(axis=0)
    return found.take(which * COARSE + np.arange(COARSE))


def _wrapped(angle_rad: FloatArray) -> FloatArray:
    return np.asarray((angle_rad + np.pi) % (2 * np.pi) - np.pi)


def cells(phi0_rad: FloatArray) -> FloatArray:
    """Width of the cell of each node on the circle, halfway to its neighbours, radians, shape (B,)."""
    after = np.diff(phi0_rad, append=phi0_rad[0] + 2 * np.pi)
    return np.asarray(0.5 * (after + np.roll(after, 1)))


def _spread(phi0_rad: FloatArray, log_evidence: FloatArray) -> float:
    """Standard deviation about the best longitude of what lies within 60 degrees of it, radians."""
    away = _wrapped(phi0_rad - phi0_rad[np.argmax(log_evidence)])
    share = cells(phi0_rad) * np.exp(log_evidence - log_evidence.max()) * (np.abs(away) < np.pi / 3)
    share = share / share.sum()
    return float(np.sqrt(share @ away**2))


def sample(likelihood: Likelihood, nodes: Nodes, number: int, rng: np.random.Generator) -> Draws:
    """Draws of a track, weighted by their exact density."""
    width = cells(nodes.phi0_rad)
    log_share = np.log(width) + nodes.log_evidence
    log_share -= logsumexp(log_share)
    chosen = _systematic(np.exp(log_share), number, rng)
    after = np.diff(nodes.phi0_rad, append=nodes.phi0_rad[0] + 2 * np.pi)
    before = np.roll(after, 1)
    side = rng.uniform(-0.5, 0.5, number)
    inside = np.where(side > 0, after[chosen] * side, before[chosen] * side)
    # a cell reaches halfway to its neighbour on each side: its density is uniform on each half
    log_cell = log_share[chosen] - np.log(np.where(side > 0, after[chosen], before[chosen]))
    beside = np.where(side > 0, (chosen + 1) % len(width), chosen - 1)
    mean = nodes.z[chosen] + np.abs(side)[:, None] * (nodes.z[beside] - nodes.z[chosen])
    root = WIDER * np.linalg.inv(np.linalg.cholesky(nodes.hessian)).transpose(0, 2, 1)
    normal = rng.standard_normal(mean.shape)
    z = mean + np.einsum("mpq,mq->mp", root[chosen], normal)
    log_root = np.linalg.slogdet(root)[1][chosen]
    log_gauss = -0.5 * (normal**2).sum(axis=1) - log_root - 0.5 * z.shape[1] * np.log(2 * np.pi)
    phi0 = _wrapped(nodes.phi0_rad[chosen] + inside)
    prior = -np.log(2 * np.pi) - 0.5 * z.shape[1] * np.log(2 * np.pi)
    log_weight = likelihood.log_density(phi0, z) + prior - log_cell - log_gauss
    log_weight = np.where(np.isfinite(log_weight), log_weight, -np.inf)
    total = float(logsumexp(log_weight))
    return Draws(phi0, z, np.exp(log_weight - total), total - float(np.log(number)))


def propagated(likelihood: Likelihood, nodes: Nodes, number: int, rng: np.random.Generator) -> tuple[Nodes, Draws]:
    """Posterior with the directional delay as it is before the data.

    Parameters
    ----------
    nodes : Nodes
        Of all delays together.
    number : int
        Of the draws.

    Returns
    -------
    tuple of Nodes, Draws
        Of the nodes only longitude and evidence mean anything.
    """
    track = likelihood.track
    delay, place = track.model.delay, track.winds
    if not delay.kappa_sd > 0:
        return nodes, sample(likelihood, nodes, number, rng)
    held = replace(likelihood, track=replace(track, holds_delay=True))
    each = _together(held, [_search(held.track, _with_delay(nodes, place, one)) for one in KAPPA_NODES])
    drawn = []
    for turn, (one, around) in enumerate(zip(KAPPA_NODES, each, strict=True)):
        fixed = replace(track.model, delay=replace(delay, kappa=delay.kappa + one * delay.kappa_sd, kappa_sd=0.0))
        part = replace(likelihood, track=replace(track, model=fixed))
        around.z[:, place] = 0.0
        share = (turn + 1) * number // len(KAPPA_NODES) - turn * number // len(KAPPA_NODES)
        some = sample(part, around, share, rng)
        if some.effective < LEAST_OF_A_DELAY:
            some = replace(some, weight=np.full(share, 1 / share))
        some.z[:, place] = one
        drawn.append(replace(some, weight=some.weight * KAPPA_SHARES[turn]))
    draws = Draws(
        np.concatenate([one.phi0_rad for one in drawn]),
        np.concatenate([one.z for one in drawn]),
        np.concatenate([one.weight for one in drawn]),
        float(logsumexp([one.log_evidence for one in drawn], b=KAPPA_SHARES)),
    )
    return _mean_of(each), draws


def _with_delay(nodes: Nodes, place: int, value: float) -> Nodes:
    """Nodes moved to where their Gaussians have one delay, which is then no parameter any more."""
    column = np.linalg.inv(nodes.hessian)[:, :, place]
    moved = column / column[:, [place]] * (value - nodes.z[:, [place]])
    z = nodes.z + np.clip(moved, -LARGEST_STEP, LARGEST_STEP)
    z[:, place] = value
    return replace(nodes, z=z)


def _mean_of(each: Sequence[Nodes]) -> Nodes:
    """Mean of the posteriors of the longitude for the delays, at all of their longitudes."""
    phi0 = np.unique(np.concatenate([one.phi0_rad for one in each]))
    log = []
    for one in each:
        total = logsumexp(one.log_evidence + np.log(cells(one.phi0_rad)))
        log.append(np.interp(phi0, one.phi0_rad, one.log_evidence - total, period=2 * np.pi))
    mean = logsumexp(log, axis=0, b=np.array(KAPPA_SHARES)[:, None])
    return Nodes(phi0, np.zeros((phi0.size, 1)), np.asarray(mean), np.ones((phi0.size, 1, 1)))


def _systematic(share: FloatArray, number: int, rng: np.random.Generator) -> np.ndarray:
    """Places drawn with given probabilities, each as often as expected to within one."""
    place = (np.arange(number) + rng.uniform()) / number
    return np.minimum(np.searchsorted(np.cumsum(share), place), share.size - 1)


def reweighted(draws: Draws, factor: FloatArray) -> Draws:
    """Draws with their weights multiplied by a factor, shape (M,), such as the prior of a further condition."""
    weight = draws.weight * factor
    total = weight.sum()
    return replace(draws, weight=weight / total, log_evidence=draws.log_evidence + float(np.log(total)))
