"""The joint fit of bursts as a day finds them: from t(f) at forty frequencies, or from the edges of the channels.

Run with ``python -m benchmarks.found_tracks [--bursts 300]``. Bursts of :func:`bella.simulation.sky.draw_burst`, at the
positions of 2012-06-07, as Wind (records of 60 s), STEREO-A and STEREO-B (snapshots every 38 s) record them.
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import date

import numpy as np
import pandas as pd
from rich.console import Console
from rich.progress import track as progress
from rich.table import Table

from bella.arrivals import ArrivalGrid, arrival_grid, locate_receivers
from bella.bursts.channel_arrivals import channel_arrivals
from bella.bursts.detection import search
from bella.bursts.edges import METHOD_OF_EDGE
from bella.bursts.timing import (
    TimedBurst,
    arrival_table,
    burst_edges,
    candidate_near,
    shared_frequencies_mhz,
    timed_burst,
    why_not_timed,
)
from bella.exceptions import NoDataError
from bella.heliosphere import SIDEREAL_ROTATION_D
from bella.simulation.burst import SimulatedBurst
from bella.simulation.instruments import LIST_MODE_KHZ
from bella.simulation.receiver import Receiver, observe
from bella.simulation.sky import draw_burst
from bella.tracks import JointFit
from bella.tracks.published import joint_track
from bella.units import FloatArray

DAY = date(2012, 6, 7)
WIND_MHZ = np.unique(np.concatenate([LIST_MODE_KHZ * 1e-3, np.arange(1.075, 13.8251, 0.4)]))
STEREO_MHZ = np.arange(0.125, 16.0251, 0.05)
RECORDS_S = {"WIND": (WIND_MHZ, 60.0, 60.0), "STEREO-A": (STEREO_MHZ, 38.05, 1.0), "STEREO-B": (STEREO_MHZ, 38.05, 1.0)}
"""Channels, cadence and integration time."""

BEFORE, LASTS, ONSET = np.timedelta64(90, "m"), np.timedelta64(300, "m"), np.timedelta64(500, "s")
DRAWS = 1000
EDGES = ("half_rise", "half_maximum")
Row = tuple[str, ...]


@dataclass(frozen=True)
class Simulated:
    """A burst and what was timed of it, by the definition of the edge."""

    burst: SimulatedBurst
    timed: dict[str, TimedBurst]


def curve(timed: TimedBurst, edge: str) -> ArrivalGrid:
    """Arrival times from t(f) at forty frequencies."""
    return _grid(arrival_table(timed, shared_frequencies_mhz(timed), METHOD_OF_EDGE[edge]))


def channels(timed: TimedBurst, _edge: str) -> ArrivalGrid:
    """Arrival times of the channels."""
    return _grid(channel_arrivals(timed))


def _grid(table: pd.DataFrame) -> ArrivalGrid:
    return arrival_grid(locate_receivers(table), heard_by=1)


def simulated(seed: int) -> Simulated | None:
    """Draw a burst and time it; None where the search shows nothing near it."""
    rng = np.random.default_rng([20120607, seed])
    noon = np.datetime64(DAY, "ns") + np.timedelta64(int(rng.uniform(6, 18) * 3600), "s")
    burst = replace(draw_burst(DAY, rng), release_utc=noon)
    start = noon - BEFORE + np.timedelta64(int(rng.uniform(0, 60e3)), "ms")
    spectra = {}
    parts: dict[str, list[pd.DataFrame]] = {edge: [] for edge in EDGES}
    try:
        for name, (frequency_mhz, cadence_s, integration_s) in RECORDS_S.items():
            receiver = Receiver(name, name, frequency_mhz, cadence_s, integration_s, np.zeros(frequency_mhz.size))
            searched = search(observe(receiver, [burst], start, start + LASTS, rng))
            spectra[name], one = searched.over, candidate_near(searched, noon + ONSET)
            for edge in EDGES:
                parts[edge].append(burst_edges(searched, one, METHOD_OF_EDGE[edge]))
    except NoDataError:
        return None
    return Simulated(burst, {edge: timed_burst(pd.concat(parts[edge], ignore_index=True), spectra) for edge in EDGES})


def rows(bursts: list[Simulated], edge: str) -> Iterator[Row]:
    """One row for each way to fit the bursts that can be placed by an edge."""
    placed = [one for one in bursts if not why_not_timed(one.timed[edge], list(RECORDS_S))]
    ways = {"t(f), 40 frequencies": (curve, True), "channel edges": (channels, False)}
    for words, (grid_of, from_curve) in ways.items():
        grids = [grid_of(one.timed[edge], edge) for one in placed]
        fits = [
            joint_track(grid, SIDEREAL_ROTATION_D, DRAWS, seed, from_curve=from_curve)[1]
            for seed, grid in enumerate(grids)
        ]
        times = np.median([np.isfinite(grid.arrival_s).sum() for grid in grids])
        kept = [(one.burst, fit) for one, fit in zip(placed, fits, strict=True) if fit.draws]
        poor = sum("poor_fit" in fit.flags for fit in fits)
        yield edge, words, f"{len(kept)} of {len(placed)}", f"{times:.0f}", *_columns(kept), f"{poor}"


def _columns(kept: list[tuple[SimulatedBurst, JointFit]]) -> Iterator[str]:
    for name, digits in (("phi0_deg", 1), ("v_sw_km_s", 0)):
        stated = [fit.summary[name] for _, fit in kept]
        low68, high68, low95, high95, mean, sd = (
            np.array([getattr(one, end) for one in stated]) for end in ("q16", "q84", "q2_5", "q97_5", "mean", "sd")
        )
        truth = _beside(np.array([getattr(burst, name) for burst, _ in kept]), mean, name)
        yield f"{_share(low68, truth, high68):.2f}, {_share(low95, truth, high95):.2f}"
        yield f"{np.median(sd):.{digits}f}"
        yield f"{np.quantile(np.abs(mean - truth), 0.68):.{digits}f}"


def _beside(truth: FloatArray, mean: FloatArray, name: str) -> FloatArray:
    return mean + (truth - mean + 180) % 360 - 180 if name == "phi0_deg" else truth


def _share(low: FloatArray, truth: FloatArray, high: FloatArray) -> float:
    return float(((low <= truth) & (truth <= high)).mean())


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="Joint fit of found bursts: from t(f) or from the channels.")
    parser.add_argument("--bursts", type=int, default=300, help="how many to simulate")
    seeds = range(parser.parse_args().bursts)
    found = [one for seed in progress(seeds, "bursts") if (one := simulated(seed)) is not None]
    table = Table(title="Truth inside the stated intervals; median of the stated errors; error that 68 % stay below")
    names = (
        "edge",
        "fitted from",
        "fits",
        "times",
        "phi0 68, 95",
        "sd",
        "error",
        "v_sw 68, 95",
        "sd",
        "error",
        "poor_fit",
    )
    for name in names:
        table.add_column(name)
    for edge in EDGES:
        for row in rows(found, edge):
            table.add_row(*row)
    Console(width=140).print(table)


if __name__ == "__main__":
    main()
