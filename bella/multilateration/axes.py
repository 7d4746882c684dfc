"""Axes of the cells of a posterior: turned so that one lies across it, and bent as its ridge bends, or spread as a fan.

Two receivers with good clocks and a third with a poor one hold a source to a long narrow part of a hyperbola. Straight
cells would have to be as short as they are narrow. Bent ones need not: a place is displaced across the ridge by h(s),
where s is its coordinate along it. Since the displacement depends on s alone, areas stay what they are.

From a receiver near the Sun, and from the Sun where there is a directional delay, directions are known better than
distances: the posterior is a fan, narrow at its apex and a hundred times wider far out. Cells that are as fine
everywhere as they must be at the apex would be far too many. Those of a fan grow with the distance: a place with the
coordinates (q, t) lies at q cosh(t/a) across and a sinh(t/a) ahead of the apex, so that the cells of a lattice are as
large as it says within a of the apex, and from there on in proportion to the distance. All this is smooth, and the
midpoint rule stays as accurate as it is on straight axes.
"""

from dataclasses import dataclass, replace

import numpy as np

from bella.multilateration.likelihood import density, mixed, slope_and_information
from bella.multilateration.problems import IntArray, Problems, of_problem
from bella.units import FloatArray

TRIED_DIRECTIONS, TRIED_RSUN = 8, (20.0, 70.0, 150.0)
"""Places from which the top of the posterior is looked for: directions, and distances from the Sun."""
LEAST_INFORMATION = 1e-9
"""Of the whole on a position, for its worst direction: where errors are so small, rounding would make it singular."""
STEPS_TO_TOP, SHARES_OF_STEP = 4, (0.0, 0.1, 0.3, 1.0)
"""Gauss-Newton steps towards the top, and the shares of each that are tried: enough for the direction there."""
LONG = 4.0
"""A posterior so many times longer than wide is followed along its ridge."""
NODES, NODES_APART, STEPS_TO_RIDGE = 5, 1.0, 2
"""Places of the ridge on either side of the top, their distance in standard deviations along it, and the Newton steps
that lead to each from where the one before points."""
STEEPEST = 1.0
"""The ridge is followed to where it has turned by 45 degrees; from there on the axis is straight."""
APEX_RSUN = 30.0
"""Distance a from the apex of a fan from which on its cells grow. Of 3, 10, 30 and 100 solar radii it needs the fewest
cells in most bursts with a spacecraft near the Sun, and at most twice as many as the best in the others."""
NO_FAN_RSUN = 1e12
"""The same where axes are straight or bent: a fan without an end."""


@dataclass(frozen=True)
class Axes:
    """Axes of the lattices of B problems.

    Attributes
    ----------
    turn : ndarray, shape (2, B)
        Cosine and sine of the angle from the x axis to the first axis, across the posterior. The second one lies along
        it, and in space the third one along z.
    curve : ndarray, shape (4, S, B), or None
        Coefficients of h, a cubic polynomial in each of S parts, solar radii; None where all axes are straight.
    start, step : ndarray, shape (B,)
        Coordinate along the second axis at which the second part begins, and length of a part, solar radii.
    fan : ndarray, shape (3, B), or None
        How far across and ahead the apex of a fan is from the Sun, and a, solar radii; None where there is no fan.
    """

    turn: FloatArray
    curve: FloatArray | None
    start: FloatArray
    step: FloatArray
    fan: FloatArray | None = None

    @classmethod
    def straight(cls, turn: FloatArray) -> "Axes":
        """Axes without a bend; `turn` has the shape (2, B)."""
        return cls(turn, None, np.zeros(turn.shape[1]), np.ones(turn.shape[1]))

    @classmethod
    def fanned(cls, apex_rsun: FloatArray, towards_rsun: FloatArray) -> "Axes":
        """Axes of fans from an apex towards some place, shape (2, B) both, solar radii."""
        ahead = towards_rsun - apex_rsun
        ahead = ahead / np.hypot(*ahead)
        turn = np.stack([ahead[1], -ahead[0]])
        apex = [(turn * apex_rsun).sum(axis=0), (ahead * apex_rsun).sum(axis=0)]
        return replace(cls.straight(turn), fan=np.stack([*apex, np.full(turn.shape[1], APEX_RSUN)]))

    def with_fans(self, which: IntArray, fans: "Axes") -> "Axes":
        """These axes with those of some problems replaced by fans."""
        turn, curve = self.turn.copy(), None if self.curve is None else self.curve.copy()
        fan = np.zeros((3, self.step.size)) + np.array([[0.0], [0.0], [NO_FAN_RSUN]])
        turn[:, which], fan[:, which] = fans.turn, fans.fan
        if curve is not None:
            curve[..., which] = 0.0
        return replace(self, turn=turn, curve=curve, fan=fan)

    def one(self, problem: int) -> "Axes":
        """Those of one problem."""
        some = slice(problem, problem + 1)
        curve, fan = (None if values is None else values[..., some] for values in (self.curve, self.fan))
        return Axes(self.turn[:, some], curve, self.start[some], self.step[some], fan)

    def place(self, along: FloatArray, owner: slice | IntArray) -> FloatArray:
        """Positions of coordinates along the axes of some problems, shape (D, *S) both, solar radii."""
        return self.turned_back(self.shaped(along, owner)[0], owner)

    def shaped(self, along: FloatArray, owner: slice | IntArray) -> tuple[FloatArray, FloatArray | None]:
        """The same before they are turned, in the frame of :meth:`Problems.turned`, and how their second axis leans.

        That is the step along the first axis that goes with one along the second; None where both are straight.
        """
        if self.curve is None and self.fan is None:
            return along, None
        (across, ahead), lean = along[:2], None
        if self.curve is not None:
            aside, lean = self.bend(ahead, owner)
            across = across + aside
        if self.fan is not None:
            apex_across, apex_ahead, scale = of_problem(self.fan, owner)
            wider = np.cosh(ahead / scale)
            turned = across / scale * np.tanh(ahead / scale)
            lean = turned if lean is None else turned + lean
            across, ahead = apex_across + across * wider, apex_ahead + scale * np.sinh(ahead / scale)
        return np.stack([across, ahead, *along[2:]]), lean

    def turned_back(self, points: FloatArray, owner: slice | IntArray) -> FloatArray:
        """Positions of points in the turned frames of some problems, shape (D, *S) both, solar radii."""
        (cosine, sine), (across, ahead) = of_problem(self.turn, owner), points[:2]
        return np.stack([cosine * across - sine * ahead, sine * across + cosine * ahead, *points[2:]])

    def log_area(self, along: FloatArray, owner: slice | IntArray) -> FloatArray:
        """Logarithm of the area that a unit of coordinates covers there, shape S; 0 but in fans."""
        if self.fan is None:
            return np.zeros(along.shape[1:])
        return np.asarray(2 * np.log(np.cosh(along[1] / of_problem(self.fan[2], owner))))

    def bend(self, ahead: FloatArray, owner: slice | IntArray) -> tuple[FloatArray, FloatArray]:
        """H and its slope at coordinates along the second axis, solar radii; for axes with a bend only."""
        assert self.curve is not None  # noqa: S101 - the caller has looked
        parts = self.curve.shape[1]
        problem = np.arange(self.step.size)[owner] if isinstance(owner, slice) else owner
        step = of_problem(self.step, owner)
        s = (ahead - of_problem(self.start, owner)) / step
        part = np.fmin(np.fmax(np.floor(s) + 1, 0), parts - 1).astype(np.intp)  # outlines are parted by NaN
        s = s - np.maximum(part - 1, 0)
        place = part * self.step.size + problem
        h0, h1, h2, h3 = (one.take(place) for one in self.curve.reshape(4, -1))
        return h0 + s * (h1 + s * (h2 + s * h3)), (h1 + s * (2 * h2 + s * 3 * h3)) / step

    def bulge(self, half_side: FloatArray) -> FloatArray:
        """Farthest that h is from a straight line over half a cell along the second axis, shape (B,), solar radii."""
        if self.curve is None:
            return np.zeros_like(half_side)
        h1, h2, h3 = self.curve[1:]
        steepest = (np.abs(h1) + 2 * np.abs(h2) + 3 * np.abs(h3)).max(axis=0) / self.step
        curvature = (2 * np.abs(h2) + 6 * np.abs(h3)).max(axis=0) / self.step**2
        return np.asarray(np.minimum(0.5 * curvature * half_side, 2 * steepest) * half_side)

    def within(self, points: FloatArray, reach: FloatArray, owner: IntArray) -> tuple[FloatArray, FloatArray]:
        """Lowest and highest coordinates of fans within a distance (M,) of points (2, M), shape (2, M) each."""
        assert self.fan is not None  # noqa: S101 - the caller has made it
        apex_across, apex_ahead, scale = self.fan.take(owner, axis=1)
        cosine, sine = self.turn.take(owner, axis=1)
        across = cosine * points[0] + sine * points[1] - apex_across
        ahead = cosine * points[1] - sine * points[0] - apex_ahead
        low, high = (scale * np.arcsinh((ahead + way * reach) / scale) for way in (-1, 1))
        nearest = np.cosh(np.where(low * high > 0, np.minimum(np.abs(low), np.abs(high)), 0.0) / scale)
        farthest = np.cosh(np.maximum(np.abs(low), np.abs(high)) / scale)
        least, most = across - reach, across + reach
        return (
            np.stack([np.minimum(least / nearest, least / farthest), low]),
            np.stack([np.maximum(most / nearest, most / farthest), high]),
        )

    def spread(self, along: FloatArray, half_sides: FloatArray, owner: slice | IntArray) -> FloatArray:
        """How far cells of some half sides reach along the axes at their centres, shape (D, M), solar radii."""
        if self.fan is None:
            return half_sides
        scale = of_problem(self.fan[2], owner)
        widest = np.cosh((np.abs(along[1]) + half_sides[1]) / scale)
        turned = np.abs(along[0]) * (np.cosh(half_sides[1] / scale) - 1) / np.cosh(along[1] / scale)
        return np.stack([half_sides[0] * widest + turned, half_sides[1] * widest])

    def limits(self, reach_rsun: float, dimensions: int) -> tuple[FloatArray, FloatArray]:
        """Lowest and highest coordinates along the axes of places within a distance of the Sun, shape (D, B) each."""
        low = np.full((dimensions, self.step.size), -reach_rsun)
        high = -low
        if self.curve is not None:
            ahead = np.repeat(np.linspace(-reach_rsun, reach_rsun, 65)[:, None], self.step.size, axis=1)
            across = np.sqrt(reach_rsun**2 - ahead**2)
            aside = self.bend(ahead, slice(None))[0]
            low[0], high[0] = -(across + aside).max(axis=0), (across - aside).max(axis=0)
        return low, high


def axes_of(problems: Problems) -> tuple[Axes, FloatArray]:
    """Axes along which each posterior needs few cells, and a place near the top of each, shape (D, B), solar radii.

    Gauss-Newton steps from the best of some places lead to its top. They need not succeed: with poor axes cells are
    more, not worse.
    """
    top, information = _top(problems)
    angle = 0.5 * np.arctan2(2 * information[0, 1], information[0, 0] - information[1, 1])
    turn = np.stack([np.cos(angle), np.sin(angle)])
    return Axes.straight(turn) if problems.dimensions == 3 else _bent(problems, turn, top, information), top


def _top(problems: Problems) -> tuple[FloatArray, FloatArray]:
    """Place (D, B) near the top of each posterior, and the information (D, D, B) near there."""
    angle = np.linspace(0, 2 * np.pi, TRIED_DIRECTIONS, endpoint=False)
    places = np.multiply.outer([np.cos(angle), np.sin(angle)], TRIED_RSUN).reshape(2, -1)
    tried = np.zeros((problems.dimensions, problems.count, places.shape[1]))
    tried[:2] = places[:, None]
    spread, rows = problems.spread(), np.arange(problems.count)
    for _ in range(STEPS_TO_TOP):
        top = tried[:, rows, mixed(density(spread, tried)).argmax(axis=1)]
        slope, information = (values[..., 0, :] for values in slope_and_information(problems, top))
        least = problems.priors.tau_rsun**-2.0 + LEAST_INFORMATION * np.einsum("iib->b", information)
        precision = np.moveaxis(information, -1, 0) + least[:, None, None] * np.eye(problems.dimensions)
        step = np.linalg.solve(precision, slope.T[..., None])[..., 0].T
        tried = top[..., None] + step[..., None] * np.array(SHARES_OF_STEP)
    return top, information


def _bent(problems: Problems, turn: FloatArray, top: FloatArray, information: FloatArray) -> Axes:
    """Axes that follow the ridge of each long posterior."""
    across, ahead = turn, np.stack([-turn[1], turn[0]])
    sharp, dull = (np.einsum("ib,ijb,jb->b", axis, information, axis) for axis in (across, ahead))
    dull = np.maximum(dull, 0.0) + problems.priors.tau_rsun**-2.0
    is_long = (sharp > LONG**2 * dull) & np.isfinite(sharp)
    if not is_long.any():
        return Axes.straight(turn)
    step = NODES_APART * dull**-0.5
    middle, origin = (np.einsum("ib,ib->b", axis, top) for axis in (ahead, across))
    h, lean = np.zeros((2, 2 * NODES + 1, problems.count))
    for way in (1, -1):
        now, leaning = origin, np.zeros_like(origin)
        for node in range(NODES + 1):
            now = now + (way * step * leaning if node else 0.0)
            place = middle + way * node * step
            for _ in range(STEPS_TO_RIDGE):
                slope, seen = slope_and_information(problems, across * now + ahead * place)
                sharpness = np.einsum("ib,ijb,jb->b", across, seen[:, :, 0], across) + problems.priors.tau_rsun**-2.0
                moved = np.einsum("ib,ib->b", across, slope[:, 0]) / sharpness
                now = now + np.clip(moved, -0.5 * step, 0.5 * step)
            leaning = np.clip(-np.einsum("ib,ijb,jb->b", across, seen[:, :, 0], ahead) / sharpness, -STEEPEST, STEEPEST)
            h[NODES + way * node], lean[NODES + way * node] = now, leaning
    curve = _cubics(h - origin, lean * step)
    is_long &= np.isfinite(curve).all(axis=(0, 1))
    return Axes(
        turn, np.where(is_long, curve, 0.0), np.where(is_long, middle - NODES * step, 0.0), np.where(is_long, step, 1.0)
    )


def _cubics(h: FloatArray, rise: FloatArray) -> FloatArray:
    """Coefficients (4, S, B) of the curve through nodes with a slope, shape (S, B); straight beyond both ends."""
    over, first, last = h[1:] - h[:-1], rise[:-1], rise[1:]
    parts = np.stack([h[:-1], first, 3 * over - 2 * first - last, first + last - 2 * over])
    ends = np.zeros((4, 2, h.shape[1]))
    ends[0], ends[1] = h[[0, -1]], rise[[0, -1]]
    return np.concatenate([ends[:, :1], parts, ends[:, 1:]], axis=1)
