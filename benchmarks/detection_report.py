"""What docs/detection.md says about the search and the comparison of spacecraft: counts of every simulated day.

``python -m benchmarks.detection_report docs 80 2001`` writes ``detection.csv`` and ``association.csv`` into a folder,
and prints the tables that follow from them.
"""

import csv
import sys
from collections.abc import Iterable, Iterator
from dataclasses import asdict, fields
from datetime import date, timedelta
from pathlib import Path

import numpy as np
import xarray as xr

from bella.bursts.association import associate
from bella.bursts.detection import search
from bella.simulation.archive_days import sky_of
from bella.simulation.sky import Sky
from benchmarks import association
from benchmarks.detection import FIRST_DAY, FLEET, Score, add_day, mirrored, spectrum_of, truths

SEED, DAYS = 2001, 80
"""Constants of the search were chosen on seeds below 2000."""

Counts = dict[str, str]


def counts_of(day: date, seed: int) -> tuple[list[Counts], Counts]:
    """Counts of a day: one row for each spacecraft, and that of the fleet."""
    skies = [sky_of(other, seed) for other in (day - timedelta(days=1), day, day + timedelta(days=1))]
    spectra = {name: spectrum_of(name, day, skies, seed) for name in FLEET}
    rows = [
        {"day": day.isoformat(), "observatory": name} | _score(spectrum, skies, name, day)
        for name, spectrum in spectra.items()
    ]
    tally = association.Tally()
    association.add_day(tally, skies[1], associate([search(one) for one in spectra.values()]))
    counts = {"storm_bursts": len(skies[1].storm)} | asdict(tally)
    return rows, {"day": day.isoformat()} | {key: str(value) for key, value in counts.items()}


def _score(spectrum: xr.Dataset, skies: list[Sky], name: str, day: date) -> Counts:
    score = Score()
    add_day(score, spectrum, truths(skies[1], name), np.datetime64(day, "ns"))
    score.mirrored = sum(not one.reason for one in search(mirrored(spectrum)).found)
    onsets = " ".join(f"{one:.0f}" for one in score.onset_s)
    return {key: str(value) for key, value in asdict(score).items()} | {"onset_s": onsets}


def totals(rows: Iterable[Counts]) -> dict[str, Score]:
    """Scores by spacecraft, and of all."""
    scores = {name: Score() for name in (*FLEET, "all")}
    for row in rows:
        for score in (scores[row["observatory"]], scores["all"]):
            for one in fields(Score):
                value = list(map(float, row[one.name].split())) if one.name == "onset_s" else int(row[one.name])
                setattr(score, one.name, getattr(score, one.name) + value)
    return scores


def total(rows: Iterable[Counts]) -> association.Tally:
    """Tally of all days."""
    tally = association.Tally()
    for row in rows:
        for one in fields(association.Tally):
            setattr(tally, one.name, getattr(tally, one.name) + int(row[one.name]))
    return tally


def detection_lines(rows: Iterable[Counts]) -> Iterator[str]:
    """Lines of the table of spacecraft, in Markdown."""
    for name, score in totals(rows).items():
        isolated = score.isolated_found + score.isolated_missed
        recall, precision = score.found / (score.found + score.missed), score.found / (score.found + score.false)
        cells = (
            name,
            f"{score.found + score.missed}",
            f"{recall:.2f}",
            f"{score.isolated_found} of {isolated} ({score.isolated_found / isolated:.3f})",
            f"{precision:.2f}",
            f"{2 * recall * precision / (recall + precision):.2f}",
            f"{score.false / score.days:.2f}",
            f"{score.mirrored / score.days:.2f}",
            f"{np.quantile(np.abs(score.onset_s), 0.68):.0f}",
        )
        yield f"| {' | '.join(cells)} |"


def association_lines(rows: Iterable[Counts]) -> Iterator[str]:
    """Lines of the table of the fleet, in Markdown."""
    tally = total(rows)
    yield f"| bursts called localisable | {tally.groups} |"
    yield f"| three of their spacecraft or more received one and the same burst | {tally.right / tally.groups:.3f} |"
    yield f"| detections in them that are of that burst | {tally.pure / tally.members:.3f} |"
    yield f"| isolated and broad at three spacecraft, and localisable | {tally.placed} of {tally.could} |"


def mirrored_a_day(rows: Iterable[Counts], fleet: Iterable[Counts]) -> tuple[float, float]:
    """Bursts found backwards in a spacecraft-day without a storm, and in one with a storm."""
    stormy = {row["day"]: row["storm_bursts"] != "0" for row in fleet}
    days = {kind: [int(row["mirrored"]) for row in rows if stormy[row["day"]] == kind] for kind in (False, True)}
    return float(np.mean(days[False])), float(np.mean(days[True]))


def read(path: Path) -> list[Counts]:
    """Rows of a file of counts."""
    with path.open(newline="", encoding="utf-8") as lines:
        return list(csv.DictReader(lines))


def write(path: Path, rows: list[Counts]) -> None:
    """Write rows of counts."""
    with path.open("w", newline="", encoding="utf-8") as lines:
        writer = csv.DictWriter(lines, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def main(folder: Path, days: int = DAYS, seed: int = SEED) -> None:
    """Count, write, print."""
    spacecraft: list[Counts] = []
    fleet: list[Counts] = []
    for number in range(days):
        rows, row = counts_of(FIRST_DAY + timedelta(days=number), seed)
        spacecraft += rows
        fleet.append(row)
    write(folder / "detection.csv", spacecraft)
    write(folder / "association.csv", fleet)
    print(*detection_lines(spacecraft), *association_lines(fleet), sep="\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]), *map(int, sys.argv[2:]))
