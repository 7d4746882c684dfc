"""Coverage of the spiral fitted in two steps, as published, beside that of the joint fit, on the same bursts.

Run with ``python -m benchmarks.two_step``. The bursts are those of :mod:`benchmarks.joint`. As published: a curve t(f)
through the channels of each spacecraft, read at 200 frequencies, each localised, and a line through the positions whose
errors are those of a fit to independent points (Canizares et al. 2024).
"""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from rich.console import Console

from bella.arrivals import ArrivalGrid
from bella.bursts.event import fit_time_evolution
from bella.heliosphere import SIDEREAL_ROTATION_D
from bella.multilateration import localise
from bella.tracks import fit_joint, joint_json, piecewise_fit, track_fit
from benchmarks.joint import (
    BURSTS,
    CHECKED,
    FREQUENCY_MHZ,
    STRETCH,
    Row,
    Truth,
    fixed,
    from_the_prior,
    gaussian,
    heard,
    share_inside,
    table,
)

READ_AT_MHZ = np.geomspace(FREQUENCY_MHZ[0], FREQUENCY_MHZ[-1], 200)


LONGEST_S = 5 * 3600.0
"""Bursts of the prior that last longer are left out: an arrival table would not take them."""


NOTHING = dict.fromkeys(("mean", "sd", "q2_5", "q16", "q50", "q84", "q97_5"))
"""Of a burst that a method gives no spiral for; its interval holds nothing."""


def placeable(rng: np.random.Generator) -> Truth:
    """A burst of the prior, of those that an arrival table takes."""
    while True:
        truth = from_the_prior(rng)
        if np.ptp(truth.arrival_s) < LONGEST_S:
            return truth


class Fitted(NamedTuple):
    """Ends of the intervals of one parameter, and its middle."""

    truth: float
    middle: float
    sd: float
    ends: tuple[float, float, float, float]


def arrivals(grid: ArrivalGrid, frequency_mhz: np.ndarray, arrival_s: np.ndarray) -> pd.DataFrame:
    """Arrival table of times that stand for those of a grid."""
    parts = []
    for column, name in enumerate(grid.observatories):
        utc = grid.reference_utc + np.rint(arrival_s[:, column] * 1e9).astype("timedelta64[ns]")
        place = dict(zip(("x_rsun", "y_rsun", "z_rsun"), grid.receiver_rsun[0, column], strict=True))
        parts.append(
            pd.DataFrame({"frequency_mhz": frequency_mhz, "arrival_utc": utc, "observatory": name}).assign(**place)
        )
        parts[-1] = parts[-1].assign(sigma_s=grid.sigma_s[0, column], edge="gauss_hermite")
    return pd.concat(parts, ignore_index=True)


def as_published(grid: ArrivalGrid) -> dict[str, Any]:
    """A line through 200 positions on smooth curves."""
    times = [
        fit_time_evolution(grid.frequency_mhz, grid.arrival_s[:, column], grid.sigma_s[:, column]).arrival_s(
            READ_AT_MHZ
        )
        for column in range(len(grid.observatories))
    ]
    posterior = localise(arrivals(grid, READ_AT_MHZ, np.stack(times, axis=1)), draws=1)
    return dict(track_fit(posterior, rotation_period_d=SIDEREAL_ROTATION_D)["two_step"])


def of_channels(grid: ArrivalGrid) -> dict[str, Any]:
    """The same line through the positions of the channels themselves, each with noise of its own."""
    posterior = localise(arrivals(grid, grid.frequency_mhz, grid.arrival_s), draws=1)
    return dict(track_fit(posterior, rotation_period_d=SIDEREAL_ROTATION_D)["two_step"])


def in_both(grid: ArrivalGrid) -> dict[str, Any]:
    """The positions of the channels with errors in both directions."""
    posterior = localise(arrivals(grid, grid.frequency_mhz, grid.arrival_s), draws=1)
    return dict(piecewise_fit(posterior, most_knots=0, rotation_period_d=SIDEREAL_ROTATION_D)["weighted"])


def jointly(grid: ArrivalGrid) -> dict[str, Any]:
    """One fit to all arrival times."""
    return joint_json(fit_joint(grid, common_sd_s=0.0))


FITS: dict[str, Callable[[ArrivalGrid], dict[str, Any]]] = {
    "two steps, as published": as_published,
    "two steps, channels as they are": of_channels,
    "two steps, errors in both": in_both,
    "joint": jointly,
}


def rows(draw: Callable[[np.random.Generator], Truth], label: str, stretch: float, bursts: int) -> Iterator[Row]:
    """Coverage of every fit."""
    for name, fit in FITS.items():
        rng = np.random.default_rng(20120607)
        found: dict[str, list[Fitted]] = {parameter: [] for parameter in CHECKED}
        for _ in range(bursts):
            truth = draw(rng)
            said = fit(heard(truth, gaussian(rng), stretch))
            for parameter in CHECKED:
                found[parameter].append(_fitted(parameter, truth, said.get(parameter, NOTHING)))
        for parameter, fits in found.items():
            yield (label if parameter == CHECKED[0] else "", name, parameter, *_columns(fits))


def _fitted(parameter: str, truth: Truth, said: dict[str, Any]) -> Fitted:
    numbers = {key: np.nan if value is None else float(value) for key, value in said.items()}
    middle, right = numbers.get("q50", numbers["mean"]), float(getattr(truth, parameter))
    if parameter == "phi0_deg":
        right = middle + (right - middle + 180) % 360 - 180
    low, high, lowest, highest = (numbers[q] for q in ("q16", "q84", "q2_5", "q97_5"))
    return Fitted(right, middle, numbers["sd"], (low, high, lowest, highest))


def _columns(fits: list[Fitted]) -> Iterator[str]:
    truth, middle, sd = (np.array([one[i] for one in fits], dtype=float) for i in range(3))
    low, high, lowest, highest = np.array([one.ends for one in fits]).T
    yield f"{np.nanmedian(middle - truth):+.1f}"
    yield f"{1.4826 * np.nanmedian(np.abs(middle - truth)):.1f}"
    yield f"{np.nanmedian(sd):.1f}"
    yield share_inside((low < truth) & (truth < high))
    yield share_inside((lowest < truth) & (truth < highest))


def main() -> None:
    """Print coverage of all fits."""
    console = Console(width=150)
    columns = ("bursts", "fit", "parameter", "bias", "scatter", "stated", "in 68 %", "in 95 %")
    for label, stretch in STRETCH.items():
        for kind, draw in (("30 deg, 400 km/s", fixed), ("from the prior", placeable)):
            console.print(table(f"{kind}, {label}", columns, list(rows(draw, kind, stretch, BURSTS))))


if __name__ == "__main__":
    main()
