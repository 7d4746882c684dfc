"""The commands ``bella ephemeris`` and ``bella update-ephemeris``: where the spacecraft were, and until when."""

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from bella.exceptions import InputError

if TYPE_CHECKING:
    import numpy as np

    from bella.settings import Settings
    from bella.spacecraft.update import Extended

out, err = Console(), Console(stderr=True)

EPILOG = "Example: bella ephemeris 2012-06-07T19:30 --frame heeq"
UPDATE_EPILOG = "Example: bella update-ephemeris --until 2027-12-31 --bodies STEREO-A,ACE"

HEADINGS = ("observatory", "x R_sun", "y R_sun", "z R_sun", "range R_sun", "lon deg", "lat deg")

Home = Annotated[Path | None, typer.Option(help="Folder that holds the updated ephemeris.", show_default="bella-home")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")]


def ephemeris(
    utc: Annotated[str, typer.Argument(help="Time, UTC, such as 2012-06-07T19:30.")],
    frame: Annotated[str, typer.Option(help="hee, heeq (Stonyhurst), carrington or hci.")] = "hee",
    home: Home = None,
    as_json: AsJson = False,
) -> None:
    """Print where the spacecraft were (solar radii and degrees)."""
    time = instant(utc)
    know_updates(home)
    from bella.spacecraft import fleet

    rows = fleet(time, frame).round(9).to_dict("records")
    if as_json:
        out.print_json(json.dumps([row | {"frame": frame.lower()} for row in rows]))
        return
    table = _table(f"Spacecraft at {utc}, frame {frame.lower()}", *HEADINGS)
    for row in rows:
        table.add_row(*(f"{value + 0.0:.2f}" if isinstance(value, float) else str(value) for value in row.values()))
    out.print(table)


def update_ephemeris(
    until: Annotated[
        str | None, typer.Option(help="Last day wanted, such as 2027-12-31.", show_default="a year from now")
    ] = None,
    bodies: Annotated[
        str | None, typer.Option(help="What to ask for, such as STEREO-A,PSP.", show_default="all")
    ] = None,
    home: Home = None,
    as_json: AsJson = False,
) -> None:
    """Ask JPL Horizons for positions after the end of the packaged table; needs a network."""
    import numpy as np

    last = np.datetime64("now", "ns") + np.timedelta64(365, "D") if until is None else instant(until)
    settings = _settings(home)
    from bella.spacecraft.horizons import HORIZONS_IDS, fetch_orbit, vectors_query
    from bella.spacecraft.update import extend_table

    wanted = list(HORIZONS_IDS) if bodies is None else [name.strip() for name in bodies.split(",")]
    for body in wanted:
        vectors_query(body, last, last)
    with Progress(console=err, transient=True) as bar:
        task = bar.add_task("ask Horizons", total=len(wanted))
        outcomes = extend_table(
            settings.ephemeris_extension,
            wanted,
            last,
            lambda body, start, stop: fetch_orbit(settings.horizons_url, body, start, stop),
            lambda: bar.advance(task),
        )
    _print_outcomes(outcomes, settings.ephemeris_extension, as_json=as_json)


def instant(utc: str) -> "np.datetime64":
    """An instant as a person writes it.

    Parameters
    ----------
    utc : str
        ISO 8601, with or without Z.

    Returns
    -------
    numpy.datetime64
        UTC, ns.

    Raises
    ------
    InputError
        If it is not a time.
    """
    import numpy as np

    try:
        moment = np.datetime64(utc.removesuffix("Z"), "ns")
    except ValueError as error:
        raise InputError(f"{utc!r} is not a time; write UTC as 2012-06-07T19:30") from error
    if np.isnat(moment):
        raise InputError(f"{utc!r} is not a time; write UTC as 2012-06-07T19:30")
    return moment


def know_updates(home: Path | None = None) -> None:
    """Let the ephemeris go on with the table that the home folder holds, if it holds one.

    Parameters
    ----------
    home : Path or None
        The home folder; None for that of the settings.
    """
    from bella.spacecraft import extend_with

    extend_with(_settings(home).ephemeris_extension)


def _settings(home: Path | None) -> "Settings":
    from bella.settings import Settings

    if home is not None:
        os.environ["BELLA_HOME"] = str(home.resolve())
    return Settings()


def _print_outcomes(outcomes: "list[Extended]", path: Path, *, as_json: bool) -> None:
    rows = [
        {
            "body": one.body,
            "known_until": f"{str(one.stop)[:16]}Z",
            "nodes": one.nodes,
            "step_km": None if one.nodes == 0 else round(one.step_km),
            "remark": one.remark,
        }
        for one in outcomes
    ]
    if as_json:
        out.print_json(json.dumps(rows))
        return
    table = _table("Ephemeris", "body", "known until", "new nodes", "step km", "remark")
    for row in rows:
        table.add_row(*("-" if value is None else str(value) for value in row.values()))
    out.print(table)
    if any(one.nodes for one in outcomes):
        out.print(f"Table {path.resolve()}", soft_wrap=True, highlight=False)


def _table(title: str, *columns: str) -> Table:
    table = Table(title=title, title_justify="left", title_style="bold", box=SIMPLE_HEAD, pad_edge=False)
    for name in columns:
        table.add_column(name, justify="left" if name in {"observatory", "body", "remark"} else "right")
    return table
