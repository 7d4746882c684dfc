"""The commands ``bella ephemeris`` and ``bella update-ephemeris``: where the spacecraft were, and until when."""

from typing import TYPE_CHECKING, Annotated

import typer

from bella.cli.options import AsJson, Home, instant, know_updates, settings_of
from bella.cli.output import answer, new_table, print_json, show, steps, warn

if TYPE_CHECKING:
    from pathlib import Path

    from bella.spacecraft.update import Extended

EPILOG = "Example: bella ephemeris 2012-06-07T19:30 --frame heeq"
UPDATE_EPILOG = "Example: bella update-ephemeris --until 2027-12-31 --bodies STEREO-A,ACE"

HEADINGS = ("observatory", "x R_sun", "y R_sun", "z R_sun", "range R_sun", "lon deg", "lat deg")


def ephemeris(
    utc: Annotated[str, typer.Argument(help="Time, UTC, such as 2012-06-07T19:30.")],
    frame: Annotated[str, typer.Option(help="hee, heeq (Stonyhurst), carrington or hci.")] = "hee",
    home: Home = None,
    as_json: AsJson = False,
) -> None:
    """Print where the spacecraft were (solar radii and degrees)."""
    time = instant(utc)
    know_updates(home)
    from bella.spacecraft import fleet, missing_from_fleet

    rows = fleet(time, frame).round(9).to_dict("records")
    for name, reason in missing_from_fleet(time).items():
        warn(f"{name} is missing: {reason}")
    if as_json:
        print_json([row | {"frame": frame.lower()} for row in rows])
        return
    left = (HEADINGS[0],)
    table = new_table(f"Spacecraft at {utc}, frame {frame.lower()}", *HEADINGS, left=left, whole=left)
    for row in rows:
        table.add_row(*(f"{value + 0.0:.2f}" if isinstance(value, float) else str(value) for value in row.values()))
    show(table)
    answer(f"{len(rows)} spacecraft at {utc}")


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
    settings = settings_of(home)
    from bella.spacecraft.horizons import HORIZONS_IDS, fetch_orbit, vectors_query
    from bella.spacecraft.update import extend_table

    wanted = list(HORIZONS_IDS) if bodies is None else [name.strip() for name in bodies.split(",")]
    for body in wanted:
        vectors_query(body, last, last)
    with steps("ask Horizons", len(wanted), transient=True) as advance:
        outcomes = extend_table(
            settings.ephemeris_extension,
            wanted,
            last,
            lambda body, start, stop: fetch_orbit(settings.horizons_url, body, start, stop),
            lambda: advance(1),
        )
    _print_outcomes(outcomes, settings.ephemeris_extension, as_json=as_json)


def _print_outcomes(outcomes: "list[Extended]", path: "Path", *, as_json: bool) -> None:
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
        print_json(rows)
        return
    left = ("body", "remark")
    table = new_table("Ephemeris", "body", "known until", "new nodes", "step km", "remark", left=left, whole=("body",))
    for row in rows:
        table.add_row(*("-" if value is None else str(value) for value in row.values()))
    show(table)
    nodes = sum(one.nodes for one in outcomes)
    answer(f"{nodes} new positions in {path.resolve()}" if nodes else "Nothing new")
