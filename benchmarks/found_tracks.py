"""Bursts of laws that no fit knows, from spectra to tracks: how often the intervals hold the truth, stratum by stratum.

Run with ``python -m benchmarks.found_tracks [--bursts 20] [--strata clean slowing] [--fleets 2012 2021] [--first 0]``.
Bursts are those of :func:`bella.simulation.strata.isolated_burst` with seeds for judging: choose nothing by them. What
is run is what the commands run: search, edges, arrival table with its covariance, positions, track.
"""

import argparse
import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from rich.console import Console
from rich.progress import track as progress
from rich.table import Table
from scipy import stats

from bella.bursts.detection import search
from bella.bursts.timing import (
    arrival_frame,
    arrivals_at,
    burst_spectrum,
    candidate_near,
    shared_frequencies_mhz,
    time_burst,
)
from bella.exceptions import BellaError
from bella.multilateration import localise
from bella.records import Interval, Parameter
from bella.simulation.burst import arrival_s, source_position_rsun
from bella.simulation.strata import FLEETS, STRATA, SimulatedCase, isolated_burst, judging_seed
from bella.tracks import TrackRecipe, fit_table
from bella.units import FloatArray

FREQUENCIES = 20
LEVELS = (0.68, 0.95)
FAR_SIGMA = 3.0
Row = tuple[str, ...]


@dataclass(frozen=True)
class Judged:
    """One burst against its truth.

    Attributes
    ----------
    edge : str
        Definition of the edge that its times have.
    difference_s, pull : ndarray
        Errors of the differences of arrival times between spacecraft, s and in their stated errors.
    away : ndarray
        Mahalanobis distance squared of each true position.
    inside : dict of str to (bool, bool)
        Whether the 68 % and 95 % intervals of longitude, wind and beam speed hold the truth.
    longitude_error_deg : float
        Of the median, from 0 to 180.
    flags : tuple of str
    """

    edge: str
    difference_s: FloatArray
    pull: FloatArray
    away: FloatArray
    inside: dict[str, tuple[bool, bool]]
    longitude_error_deg: float
    flags: tuple[str, ...]


def judged(case: SimulatedCase) -> Judged:
    """Run a case through everything.

    Raises
    ------
    BellaError
        If no answer is given.
    """
    searched = [search(one) for one in case.spectra.values()]
    timed = time_burst([burst_spectrum(one, candidate_near(one, case.around_utc)) for one in searched])
    rows = arrivals_at(timed, shared_frequencies_mhz(timed, FREQUENCIES))
    table, covariance_s2 = arrival_frame(timed, rows), rows.covariance_s2()
    released_s = (case.burst.release_utc - timed.reference_utc) / np.timedelta64(1, "s")
    truth_s = np.zeros(len(table))
    for name in set(rows.observatory):
        its = rows.observatory == name
        truth_s[its] = released_s + arrival_s(case.burst, rows.frequency_mhz[its], str(name))
    error_s = rows.arrival_s - truth_s
    one, other = np.nonzero(np.triu(rows.frequency_mhz[:, None] == rows.frequency_mhz, 1))
    sd_s = np.sqrt(covariance_s2[one, one] + covariance_s2[other, other] - 2.0 * covariance_s2[one, other])
    difference_s = error_s[one] - error_s[other]
    away = np.empty(0)
    if len(case.spectra) > 2:
        solved = localise(table, draws=10)
        off = np.stack([solved[name].to_numpy() for name in ("x_rsun", "y_rsun")], axis=1)
        off -= source_position_rsun(case.burst, solved["frequency"].to_numpy())[:, :2]
        names = ("cov_xx_rsun2", "cov_xy_rsun2", "cov_xy_rsun2", "cov_yy_rsun2")
        spread = np.stack([solved[name].to_numpy() for name in names], axis=1).reshape(-1, 2, 2)
        away = np.einsum("fi,fij,fj->f", off, np.linalg.inv(spread), off)
    joint = fit_table(table, TrackRecipe(covariance_s2=covariance_s2)).joint
    speed_c = case.mean_beam_speed_c(rows.frequency_mhz)
    inside = {
        "longitude": (_in_region(joint.phi0_68, case.burst.phi0_deg), _in_region(joint.phi0_95, case.burst.phi0_deg)),
        "wind": _in_intervals(joint.v_sw_km_s, case.burst.v_sw_km_s),
        "beam": _in_intervals(joint.beam_speed_c, speed_c),
    }
    median = np.nan if joint.phi0_deg.q50 is None else joint.phi0_deg.q50
    error_deg = abs((median - case.burst.phi0_deg + 180.0) % 360.0 - 180.0)
    return Judged(timed.edge, difference_s, difference_s / sd_s, away, inside, error_deg, joint.flags)


def _in_region(parts: tuple[Interval, ...], longitude_deg: float) -> bool:
    return any((longitude_deg - one.low) % 360.0 <= one.high - one.low for one in parts)


def _in_intervals(stated: Parameter, truth: float) -> tuple[bool, bool]:
    pairs = (stated.q16, stated.q84), (stated.q2_5, stated.q97_5)
    first, second = (low is not None and high is not None and low <= truth <= high for low, high in pairs)
    return first, second


def share(hits: int, number: int) -> str:
    """Share with its 95 % Wilson interval."""
    if not number:
        return "-"
    low, high = stats.binomtest(hits, number).proportion_ci(0.95, method="wilson")
    return f"{hits / number:.2f} ({low:.2f}-{high:.2f})"


def row(stratum: str, fleet: str, found: list[Judged], asked: int) -> Iterator[str]:
    """Columns of one stratum and fleet."""
    yield stratum
    yield fleet
    yield f"{len(found)} of {asked}"
    if not found:
        return
    off, pull, away = (
        np.concatenate([getattr(one, name) for one in found]) for name in ("difference_s", "pull", "away")
    )
    yield f"{np.median(off):+.1f}, {1.48 * np.median(np.abs(off - np.median(off))):.1f}"
    yield f"{np.sqrt(np.mean(pull**2)):.2f}"
    limits = stats.chi2.ppf(LEVELS, 2)
    yield ", ".join(f"{np.mean(away < limit):.2f}" for limit in limits) if away.size else "-"
    far = sum(bool(one.away.size and np.median(one.away) > FAR_SIGMA**2) for one in found)
    yield f"{far}"
    for name in ("longitude", "wind", "beam"):
        inside = np.array([one.inside[name] for one in found])
        yield f"{share(int(inside[:, 0].sum()), len(found))}, {inside[:, 1].mean():.2f}"
    yield f"{np.nanmedian([one.longitude_error_deg for one in found]):.1f}"
    yield f"{sum('poor_fit' in one.flags for one in found)}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="Isolated bursts of all strata, from spectra to tracks.")
    parser.add_argument("--bursts", type=int, default=20, help="of each stratum and fleet")
    parser.add_argument("--first", type=int, default=0, help="number of the first burst")
    parser.add_argument(
        "--strata", nargs="+", choices=list(STRATA), default=["clean", "slowing", "directional", "pairs"]
    )
    parser.add_argument("--fleets", nargs="+", choices=list(FLEETS), default=["2012", "2021"])
    asked = parser.parse_args()
    table = Table(title="Truth inside the stated intervals, 68 % (Wilson 95 %) and 95 %")
    names = ("stratum", "fleet", "bursts", "differences s: bias, MAD", "pull", "positions 68, 95", "far", "longitude")
    for name in (*names, "wind", "beam", "longitude error deg", "poor fit"):
        table.add_column(name)
    console = Console(width=190)
    for stratum, fleet in itertools.product(asked.strata, asked.fleets):
        found = []
        for number in progress(range(asked.first, asked.first + asked.bursts), f"{stratum} {fleet}", console=console):
            try:
                found.append(judged(isolated_burst(stratum, fleet, judging_seed(number))))
            except (BellaError, np.linalg.LinAlgError) as error:
                console.print(f"{stratum} {fleet} {number}: {error}", soft_wrap=True)
        table.add_row(*row(stratum, fleet, found, asked.bursts))
    console.print(table)


if __name__ == "__main__":
    main()
