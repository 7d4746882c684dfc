"""The command ``bella simulate``: days of synthetic files under the names and in the folders of the archive."""

import json
from datetime import timedelta
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from bella.cli.ephemeris import know_updates
from bella.cli.fetch import day_option
from bella.cli.output import steps, write_whole
from bella.exceptions import InputError

out = Console()

EPILOG = "Example: bella simulate archive --days 2 --seed 7 --from 2021-11-20"
MOST_DAYS = 366


def simulate(  # noqa: PLR0913, PLR0917 - one argument per option
    folder: Annotated[Path, typer.Argument(help="Root of the archive to write; new, empty, or simulated before.")],
    days: Annotated[int, typer.Option(help="How many days.")] = 1,
    seed: Annotated[int, typer.Option(help="Same seed and date, same day.")] = 1,
    first: Annotated[str, typer.Option("--from", help="First day, UTC.")] = "2021-11-20",
    dataset: Annotated[
        list[str] | None,
        typer.Option(help="Data set such as STEREO_LEVEL2_SWAVES; may be given again.", show_default="all there are"),
    ] = None,
    truth: Annotated[
        Path | None, typer.Option(help="JSON with what was simulated.", show_default="FOLDER/truth.json")
    ] = None,
) -> None:
    """Write synthetic days: bursts of known beams, and what is none, as every receiver of the fleet records them."""
    if not 0 < days <= MOST_DAYS:
        raise InputError(f"--days {days} is not between 1 and {MOST_DAYS}; simulate more in parts")
    if seed < 0:
        raise InputError(f"--seed {seed} is below 0; name a number from 0 on")
    if truth is not None and not truth.parent.is_dir():
        raise InputError(f"folder {truth.parent} does not exist; make it or name another --truth")
    start = day_option(first, "--from")
    know_updates()
    from bella.simulation.archive_days import simulate_days

    wanted = [start + timedelta(days=number) for number in range(days)]
    with steps("days", days) as advance:
        simulated = simulate_days(folder, wanted, seed, dataset or (), advance)
    written = folder / "truth.json" if truth is None else truth
    write_whole(written, json.dumps(simulated, indent=1))
    bursts = sum(len(day["bursts"]) for day in simulated["days"])
    files = sum(len(day["files"]) for day in simulated["days"])
    for line in (f"Archive {folder}, {files} files", f"Truth   {written}, {bursts} bursts"):
        out.print(line, soft_wrap=True, highlight=False)
