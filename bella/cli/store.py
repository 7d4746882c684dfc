"""The command ``bella store verify``: whether what was published can still be read."""

import json
from contextlib import closing

import typer
from rich.console import Console

from bella.cli.catalogue import AsJson, Home, new_table, open_catalogue, say, settings_of
from bella.cli.output import steps
from bella.exceptions import StoreError

out = Console()

store_app = typer.Typer(help="Look after the posteriors and spectra on disk.", no_args_is_help=True)


@store_app.callback()
def store() -> None:
    """Look after the posteriors and spectra on disk."""


@store_app.command(epilog="Example: bella store verify")
def verify(home: Home = None, as_json: AsJson = False) -> None:
    """Read every group that the catalogue refers to and compare it with its checksum; exit 1 names what is damaged."""
    from bella.pipeline.verify import damage_of

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
        out.print_json(json.dumps({"groups": len(groups), "damaged": rows}))
    elif damaged:
        table = new_table("Damaged", "group", "of", "reason")
        for one, reason in damaged:
            table.add_row(one.store_path, one.belongs_to, reason)
        out.print(table)
    if damaged:
        said = ", ".join(one.store_path for one, _ in damaged)
        raise StoreError(f"{len(damaged)} of {len(groups)} groups are damaged: restore {said} from a backup")
    if not as_json:
        say(f"{len(groups)} groups in {settings.store_root.resolve()} are whole")
