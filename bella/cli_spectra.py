"""The command ``bella formats``: which files of spectra can be read."""

import json
from dataclasses import asdict
from typing import Annotated, Any

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

out = Console()

EPILOG = "Example: bella formats --json"
COLUMNS = ("name", "mission", "naming", "cadence", "quantity", "verified")


def formats(as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False) -> None:
    """List the archive products whose files can be read."""
    from bella.spectra import PRODUCTS

    rows = [{name: asdict(product)[name] for name in COLUMNS} for product in PRODUCTS]
    if as_json:
        out.print_json(json.dumps(rows))
    else:
        out.print(_table(rows))


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
