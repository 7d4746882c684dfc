"""Preliminary tracks of simulated bursts at two spacecraft: how often their regions hold the truth.

Run with ``python -m benchmarks.preliminary``. Wind at 0.99 au and STEREO-A at 0.96 au, 10 to 178 degrees apart. Nothing
here is shared with the fit: densities that are no power law or have a bend, one beam in three that slows down, delays
that grow with the viewing angle, errors of edges that are smooth along frequency, offsets of the spacecraft.
"""

import argparse
import itertools
import time
from dataclasses import dataclass

import numpy as np
import pandas as pd
from rich.console import Console
from rich.table import Table
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import CubicSpline
from scipy.stats import binomtest

from bella.arrivals import ArrivalGrid, arrival_grid, check_arrivals
from bella.records import JointTrack
from bella.tracks.preliminary import level_of, preliminary_track, region_size_deg, why_not_published
from bella.units import FloatArray

LIGHT_RSUN_S, ROTATION_RAD_S, KM_RSUN = 0.4309, 2.8653e-6, 6.957e5
LIGHT_KM_S, PLASMA_MHZ = 299_792.0, 8.98e-3
EPOCH = np.datetime64("2026-07-09T12:00:00", "ns")
SEPARATIONS_DEG = (10.0, 20.0, 30.0, 64.0, 90.0, 120.0, 178.0)
BURSTS, JUDGING_SEED = 60, 770_000
DENSITIES = ("newkirk", "mann", "steep power", "bend")
COLUMNS = (
    "apart, deg",
    "in 68 %",
    "in 95 %",
    "68 %, deg (10-90 %)",
    "95 %, deg",
    "one part",
    "right side (stated)",
    "r(0.5 MHz) in 68 %, error",
    "published",
    "in 68 % of these",
)
NEAR_RSUN, FAR_RSUN = 1.2, 400.0


@dataclass(frozen=True)
class Truth:
    """A burst as it was: longitude at 1 solar radius, and distance and longitude at 0.5 MHz."""

    phi0_deg: float
    range_rsun: float
    longitude_deg: float
    density: str


def density_cm3(name: str, range_rsun: FloatArray) -> FloatArray:
    """Electron density of four laws that the fit does not know; coronal laws continue as a wind."""
    if name == "newkirk":
        return np.asarray(4.2e4 * 10 ** (4.32 / range_rsun) / (1 + (range_rsun / 4.0) ** 2))
    if name == "mann":
        return np.asarray(8.775e8 * np.exp(9.88 * (1 / range_rsun - 1)) / (1 + (range_rsun / 3.0) ** 2))
    if name == "steep power":
        return np.asarray(4e6 * range_rsun**-2.55)
    return np.asarray(5e5 * range_rsun**-2.0 / (1 + (range_rsun / 60.0) ** 4) ** 0.15 + 2e7 * range_rsun**-5.0)


def simulated(seed: int, separation_deg: float) -> tuple[Truth, ArrivalGrid]:
    """Arrival times of one burst at two spacecraft, each at its own channels.

    Parameters
    ----------
    seed : int
    separation_deg : float

    Returns
    -------
    Truth, ArrivalGrid
    """
    rng = np.random.default_rng([seed, round(separation_deg)])
    name = str(rng.choice(DENSITIES))
    phi0, wind = rng.uniform(-np.pi, np.pi), np.exp(rng.normal(np.log(420.0), 0.22))
    turn = ROTATION_RAD_S * KM_RSUN / wind
    r = np.geomspace(NEAR_RSUN, FAR_RSUN, 3000)
    emitted_mhz = rng.integers(1, 3) * PLASMA_MHZ * np.sqrt(density_cm3(name, r / np.exp(rng.normal(0.0, 0.35))))
    slows = rng.random() < 1 / 3
    speed = rng.uniform(0.08, 0.3) * LIGHT_RSUN_S / (1 + slows * r / rng.uniform(60.0, 200.0))
    travel = cumulative_trapezoid(np.sqrt(1 + (turn * r) ** 2) / speed, r, initial=0.0)
    rise_at_1_mhz, kappa, smooth = rng.uniform(25.0, 40.0), rng.uniform(0.1, 0.3), rng.uniform(0.1, 0.2)
    west = float(rng.choice([-1.0, 1.0]))
    where = {"WIND": (213.0, 0.0, 0.5), "STEREO-A": (206.0, west * np.radians(separation_deg), -0.3)}
    tables = []
    for craft, (distance, longitude, north) in where.items():
        low, high = rng.uniform(0.13, 0.25), rng.uniform(1.5, 2.8)
        frequency = np.sort(np.exp(rng.uniform(np.log(low), np.log(high), rng.integers(22, 40))))
        source_r = np.interp(-frequency, -emitted_mhz, r)
        angle = phi0 - turn * (source_r - 1.0)
        source = source_r[:, None] * np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
        receiver = np.array([distance * np.cos(longitude), distance * np.sin(longitude), north])
        sight = receiver - source
        length = np.sqrt((sight**2).sum(axis=1))
        cosine = (source * sight).sum(axis=1) / (source_r * length)
        rise = rise_at_1_mhz / frequency
        knots = np.arange(np.log(0.02) - rng.random(), np.log(20.0), rng.uniform(0.6, 1.2))
        wave = CubicSpline(knots, rng.normal(size=knots.size))(np.log(frequency))
        sigma = rng.uniform(2.0, 4.0)
        arrival = np.interp(source_r, r, travel) + length / LIGHT_RSUN_S + kappa * rise * (1 - cosine)
        arrival += smooth * rise * wave + rng.normal(0.0, 3.0) + sigma * rng.normal(size=frequency.size)
        place = dict(zip(("x_rsun", "y_rsun", "z_rsun"), receiver, strict=True))
        utc = EPOCH + np.rint(arrival * 1e9).astype("timedelta64[ns]")
        named = {"observatory": craft, "frequency_mhz": frequency, "arrival_utc": utc, "sigma_s": sigma}
        tables.append(pd.DataFrame(named | {"edge": "half_rise"} | place))
    table = check_arrivals(pd.concat(tables, ignore_index=True), received_by=2)
    at = float(np.interp(-0.5, -emitted_mhz, r))
    truth = Truth(float(np.degrees(phi0)), at, float(np.degrees(phi0 - turn * (at - 1.0))), name)
    return truth, arrival_grid(table, received_by=1)


def right_side(truth: Truth, track: JointTrack) -> bool:
    """Whether the source was on the side that the track holds for the likelier."""
    if track.side is None:
        raise ValueError("the track names no side")
    return bool(np.cos(np.radians(truth.longitude_deg - track.side.middle_deg)) > 0)


def held(levels: FloatArray, level: float) -> str:
    """Share of bursts inside a region, with its 95 % Wilson interval."""
    found = binomtest(int((levels <= level).sum()), levels.size)
    low, high = found.proportion_ci(method="wilson")
    return f"{found.statistic:.2f} ({low:.2f}-{high:.2f})"


@dataclass(frozen=True)
class Judged:
    """What became of one burst."""

    level: float
    size68_deg: float
    size95_deg: float
    parts: int
    right: bool
    stated: float
    range_held: bool
    range_off: float
    published: bool


def judged(seed: int, separation_deg: float) -> Judged:
    """Fit one burst and hold it against its truth."""
    truth, grid = simulated(seed, separation_deg)
    track = preliminary_track(grid)
    at = next(one for one in track.profile if one.frequency_mhz == 0.5).range_rsun
    low, middle, high = np.log(np.array([at.q16, at.q50, at.q84], dtype=float) / truth.range_rsun)
    return Judged(
        level_of(track, truth.phi0_deg),
        region_size_deg(track.phi0_68),
        region_size_deg(track.phi0_95),
        len(track.phi0_68),
        right_side(truth, track),
        track.side.probability if track.side else np.nan,
        bool(low <= 0 <= high),
        abs(middle),
        why_not_published(track) is None,
    )


def row(separation_deg: float, bursts: list[Judged]) -> tuple[str, ...]:
    """One row of the table: a separation of the two spacecraft."""
    column = {name: np.array([getattr(one, name) for one in bursts]) for name in Judged.__dataclass_fields__}
    size68, published = column["size68_deg"], column["published"]
    return (
        f"{separation_deg:.0f}",
        held(column["level"], 0.68),
        held(column["level"], 0.95),
        f"{np.median(size68):.0f} ({np.quantile(size68, 0.1):.0f}-{np.quantile(size68, 0.9):.0f})",
        f"{np.median(column['size95_deg']):.0f}",
        f"{(column['parts'] == 1).mean():.2f}",
        f"{column['right'].mean():.2f} ({column['stated'].mean():.2f})",
        f"{column['range_held'].mean():.2f}, {100 * np.median(column['range_off']):.0f} %",
        f"{published.mean():.2f}",
        held(column["level"][published], 0.68) if published.any() else "-",
    )


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bursts", type=int, default=BURSTS)
    parser.add_argument("--seed", type=int, default=JUDGING_SEED)
    parser.add_argument("--separation", type=float, nargs="*", default=SEPARATIONS_DEG)
    asked = parser.parse_args()
    table, sides = Table(title=f"{asked.bursts} bursts each"), Table(title="Side")
    for name in COLUMNS:
        table.add_column(name)
    began, every = time.process_time(), []
    for separation in asked.separation:
        bursts = [judged(asked.seed + number, separation) for number in range(asked.bursts)]
        table.add_row(*row(separation, bursts))
        every += bursts
    for name in ("stated", "bursts", "mean stated", "right"):
        sides.add_column(name)
    for low, high in itertools.pairwise((0.5, 0.6, 0.7, 0.8, 0.9, 1.0)):
        some = [one for one in every if low <= one.stated < high or one.stated == high == 1.0]
        if some:
            stated = np.mean([one.stated for one in some])
            right = held(np.array([0.0 if one.right else 1.0 for one in some]), 0.5)
            sides.add_row(f"{low:.1f}-{high:.1f}", f"{len(some)}", f"{stated:.2f}", right)
    console = Console(width=180)
    console.print(table, sides)
    console.print(f"{(time.process_time() - began) / len(every):.2f} s CPU a burst")


if __name__ == "__main__":
    main()
