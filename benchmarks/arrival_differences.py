"""How well differences of arrival times between two spacecraft are timed, and how well their errors are stated.

Run with ``python -m benchmarks.arrival_differences [--seeds 6] [--first 0] [--strata clean ...]``. Bursts are those of
:func:`bella.simulation.strata.isolated_burst` with seeds for judging: choose nothing by them. Channels and the table of
common frequencies are judged from 0.3 to 2 MHz, where the burst stands out by a factor of ten.
"""

import argparse
import itertools
from typing import NamedTuple

import numpy as np
from rich.console import Console
from rich.progress import track as progress
from rich.table import Table

from bella.bursts.noise import Timed, noise_columns
from bella.bursts.timing import arrivals_of, time_spectra
from bella.simulation.strata import SimulatedCase, isolated_burst, judging_seed
from bella.units import FloatArray

BAND_MHZ = (0.3, 2.0)
CONTRAST = 10.0
FAR_OFF_S = 30.0
STRATA, FLEETS = ("clean", "slowing", "directional", "widths"), ("2021", "encounter")


class Differences(NamedTuple):
    """Errors of the differences between two spacecraft of one burst, and their stated errors, s."""

    pair: str
    off_s: FloatArray
    sd_s: FloatArray


def differences(case: SimulatedCase, rows: Timed) -> list[Differences]:
    """The first less the second of every pair of spacecraft, at the frequencies of the one with fewer in the band."""
    columns = noise_columns(rows)
    terms = [columns[name] ** 2 for name in ("sigma_s", "shape_sd_s", "offset_sd_s", "delay_sd_s")]
    variance = np.sum(terms, axis=0)
    curves = {}
    for name in sorted(set(rows.observatory.astype(str))):
        own = np.flatnonzero(rows.observatory == name)
        own = own[np.argsort(rows.frequency_mhz[own])]
        frequency = rows.frequency_mhz[own]
        truth = case.truth(name, frequency)
        strong = (truth["peak_over_background"].to_numpy() >= CONTRAST) & (frequency >= BAND_MHZ[0])
        strong &= frequency <= BAND_MHZ[1]
        off_s = rows.arrival_s[own] - truth["arrival_s"].to_numpy()
        curves[name] = (np.log(frequency[strong]), off_s[strong], variance[own][strong])
    found = []
    for one, other in itertools.combinations(curves, 2):
        few, many = sorted((curves[one], curves[other]), key=lambda curve: curve[0].size)
        inside = (few[0] >= many[0].min(initial=np.inf)) & (few[0] <= many[0].max(initial=-np.inf))
        if inside.any():
            at = few[0][inside]
            off_s = few[1][inside] - np.interp(at, many[0], many[1])
            off_s = off_s if few is curves[one] else -off_s
            variance_s2 = few[2][inside] + np.interp(at, many[0], many[2])
            found.append(Differences(f"{one}, {other}", off_s, np.sqrt(variance_s2)))
    return found


def row(found: list[Differences]) -> list[str]:
    """One row of the table."""
    off_s, sd_s = (np.concatenate([getattr(one, name) for one in found]) for name in ("off_s", "sd_s"))
    return [
        str(off_s.size),
        f"{off_s.mean():+.1f}",
        f"{np.sqrt((off_s**2).mean()):.1f}",
        f"{np.median(np.abs(off_s)):.1f}",
        f"{np.sqrt(((off_s / sd_s) ** 2).mean()):.2f}",
        f"{(np.abs(off_s) > FAR_OFF_S).mean():.3f}",
    ]


def main() -> None:
    """Print the table, by stratum and by pair."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=6, help="bursts of each stratum and fleet")
    parser.add_argument("--first", type=int, default=0, help="number of the first seed")
    parser.add_argument("--strata", nargs="+", default=STRATA)
    parser.add_argument("--fleets", nargs="+", default=FLEETS)
    asked = parser.parse_args()
    shown = Table("stratum", "of", "differences", "bias, s", "rms, s", "median, s", "pull", "beyond 30 s")
    pairs: dict[tuple[str, str], list[Differences]] = {}
    for stratum in asked.strata:
        found: dict[str, list[Differences]] = {"channels": [], "tables": []}
        cases = list(itertools.product(asked.fleets, range(asked.first, asked.first + asked.seeds)))
        for fleet, number in progress(cases, stratum, console=Console(stderr=True)):
            case = isolated_burst(stratum, fleet, judging_seed(number))
            timed, _ = time_spectra(case.spectra.values(), case.around_utc)
            for kind, rows in (("channels", timed.noise), ("tables", arrivals_of(timed))):
                some = differences(case, rows)
                found[kind] += some
                for one in some:
                    pairs.setdefault((one.pair, kind), []).append(one)
        for kind, some in found.items():
            shown.add_row(stratum, kind, *row(some))
    shown.add_section()
    for (pair, kind), some in sorted(pairs.items()):
        shown.add_row(pair, kind, *row(some))
    Console(width=130).print(shown)


if __name__ == "__main__":
    main()
