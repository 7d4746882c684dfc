"""The command ``bella prune``: removes the draws of superseded solutions."""

import json
import re
from datetime import timedelta
from typing import Annotated

import typer

from bella.cli.catalogue import AsJson, Home, out, say, settings_of
from bella.exceptions import InputError

EPILOG = "Example: bella prune --older-than 180d --dry-run"
UNITS = {"d": "days", "h": "hours", "w": "weeks"}


def prune(
    older_than: Annotated[str, typer.Option(help="How long ago they were superseded, such as 180d, 12h or 26w.")],
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Say what would go, and change nothing.")] = False,
    home: Home = None,
    as_json: AsJson = False,
) -> None:
    """Remove the draws of superseded solutions; arrival times, positions, tracks and seeds stay."""
    from bella.pipeline.pruning import prune as remove_draws

    found = remove_draws(settings_of(home), _duration(older_than), dry_run=dry_run)
    if as_json:
        out.print_json(json.dumps([{"solution_id": one.solution_id, "draws": one.draws} for one in found]))
        return
    for one in found:
        say(f"{one.solution_id}: {one.draws} draws per frequency")
    what = "would lose" if dry_run else "lost"
    say(f"{len(found)} superseded solutions {what} their draws; the next sweep of the store frees their room")


def _duration(text: str) -> timedelta:
    parts = re.fullmatch(r"(\d{1,5})([dhw])", text.strip())
    if parts is None:
        raise InputError(f"--older-than {text!r} is not a duration: write 180d, 12h or 26w")
    return timedelta(**{UNITS[parts[2]]: int(parts[1])})
