"""The command ``bella formats``: which files of spectra can be read, and the known quirks of the instruments."""

import json
from dataclasses import asdict
from typing import Annotated, Any

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

out = Console()

EPILOG = "Example: bella formats --quirks --json"
COLUMNS = ("name", "mission", "naming", "cadence", "quantity", "verified")


def formats(
    known_quirks: Annotated[
        bool, typer.Option("--quirks", help="List the known quirks of instruments and products instead.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False,
) -> None:
    """List the archive products whose files can be read."""
    from bella.spectra import PRODUCTS, quirks

    if known_quirks:
        rows = [one.model_dump(mode="json") for one in quirks()]
    else:
        rows = [{name: asdict(product)[name] for name in COLUMNS} for product in PRODUCTS]
    if as_json:
        out.print_json(json.dumps(rows))
        return
    out.print(_quirks_table(rows) if known_quirks else _table(rows))


def _table(rows: list[dict[str, Any]]) -> Table:
    table = Table(title="Files that can be read", title_justify="left", title_style="bold", box=SIMPLE_HEAD)
    table.caption = "verified: read from the archive itself; the others from files written to its description"
    table.caption_justify = "left"
    table.add_column("file", no_wrap=True)
    table.add_column("cadence", no_wrap=True)
    table.add_column("verified")
    for mission in dict.fromkeys(row["mission"] for row in rows):
        table.add_row(f"[bold]{mission}[/bold]" if mission != "any" else "[bold]Any other instrument[/bold]")
        for row in (row for row in rows if row["mission"] == mission):
            table.add_row(row["naming"], row["cadence"], "yes" if row["verified"] else "no")
    return table


def _quirks_table(rows: list[dict[str, Any]]) -> Table:
    table = Table(title="Known quirks", title_justify="left", title_style="bold", box=SIMPLE_HEAD, show_lines=True)
    for heading in ("instrument", "days", "effect", "what the readers do"):
        table.add_column(heading)
    table.caption, table.caption_justify = f"{len(rows)} quirks; sources: bella formats --quirks --json", "left"
    for row in rows:
        instrument = " ".join([row["observatory"], *row["receivers"]])
        days = f"{row['first']} to {row['last'] or 'now'}"
        table.add_row(f"{instrument}\n{row['name']}", days, row["effect"], row["handling"])
    return table
