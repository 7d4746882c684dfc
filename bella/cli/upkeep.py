"""The commands ``bella prune`` and ``bella store verify``: room on the disk, and whether all of it can be read."""

import re
from contextlib import closing
from datetime import timedelta
from typing import Annotated

import typer

from bella.cli.options import AsJson, Home, open_catalogue, settings_of
from bella.cli.output import answer, new_table, print_json, say, show, steps
from bella.exceptions import InputError, StoreError

PRUNE_EPILOG = "Example: bella prune --older-than 180d --dry-run"
UNITS = {"d": "days", "h": "hours", "w": "weeks"}


def prune(
    older_than: Annotated[str, typer.Option(help="How long ago they were superseded, such as 180d, 12h or 26w.")],
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Say what would go, and change nothing.")] = False,
    home: Home = None,
    as_json: AsJson = False,
) -> None:
    """Remove the draws of superseded solutions; arrival times, positions, tracks and seeds stay."""
    from bella.pipeline.housekeeping import prune as remove_draws

    found = remove_draws(settings_of(home), _duration(older_than), dry_run=dry_run)
    if as_json:
        print_json([{"solution_id": one.solution_id, "draws": one.draws} for one in found])
        return
    for one in found:
        say(f"{one.solution_id}: {one.draws} draws per frequency")
    what = "would lose" if dry_run else "lost"
    answer(f"{len(found)} superseded solutions {what} their draws; the next sweep of the store frees their room")


def _duration(text: str) -> timedelta:
    parts = re.fullmatch(r"(\d{1,5})([dhw])", text.strip())
    if parts is None:
        raise InputError(f"--older-than {text!r} is not a duration: write 180d, 12h or 26w")
    return timedelta(**{UNITS[parts[2]]: int(parts[1])})


store_app = typer.Typer(help="Look after the posteriors and spectra on disk.", no_args_is_help=True)


@store_app.callback()
def store() -> None:
    """Look after the posteriors and spectra on disk."""


@store_app.command(epilog="Example: bella store verify")
def verify(home: Home = None, as_json: AsJson = False) -> None:
    """Read every group that the catalogue refers to and compare it with its checksum; exit 1 names what is damaged."""
    from bella.pipeline.housekeeping import damage_of

    settings = settings_of(home)
    with closing(open_catalogue(settings)) as catalogue:
        groups = catalogue.stored_groups()
    damaged = []
    with steps("verify", len(groups)) as advance:
        for group in groups:
            reason = damage_of(group, settings.store_root)
            damaged += [(group, reason)] if reason else []
            advance(1)
    if as_json:
        rows = [{"store_path": one.store_path, "of": one.belongs_to, "reason": reason} for one, reason in damaged]
        print_json({"groups": len(groups), "damaged": rows})
    elif damaged:
        table = new_table("Damaged", "group", "of", "reason", left=("group", "of", "reason"), whole=("group", "of"))
        for one, reason in damaged:
            table.add_row(one.store_path, one.belongs_to, reason)
        show(table)
    if damaged:
        said = ", ".join(one.store_path for one, _ in damaged)
        raise StoreError(f"{len(damaged)} of {len(groups)} groups are damaged: restore {said} from a backup")
    if not as_json:
        answer(f"{len(groups)} groups in {settings.store_root.resolve()} are whole")


@store_app.command(epilog="Example: bella store pack")
def pack(home: Home = None) -> None:
    """Make one file of each posterior and spectrum that an older version has stored as a folder of many."""
    from bella.pipeline.housekeeping import pack as pack_folders

    settings = settings_of(home)
    with closing(open_catalogue(settings)) as catalogue:
        number = len(catalogue.stored_groups())
    with steps("pack", number) as advance:
        packed = pack_folders(settings, advance)
    answer(f"{packed} of {number} groups were folders and are files now; the next sweep of the store frees their room")
