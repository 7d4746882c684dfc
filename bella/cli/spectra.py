"""The commands about spectra: ``detect``, ``arrivals``, ``formats`` and ``simulate``."""

import json
from collections import Counter
from dataclasses import asdict
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bella.cli.options import AsJson, check_file, check_output, instant, know_updates
from bella.cli.output import (
    answer,
    frame_rows,
    new_table,
    print_json,
    say,
    show,
    steps,
    warn,
    write_csv,
    write_whole,
)
from bella.exceptions import BellaError, InputError, NoDataError
from bella.flags import REJECTED
from bella.times import parse_day

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd
    import xarray as xr
    from rich.table import Table

    from bella.bursts.noise import Timed
    from bella.bursts.timing import TimedBurst
    from bella.spectra import FleetPiece

DETECT_EPILOG = (
    "Example: bella detect wi_h1_wav_20100117_v01.cdf stereo_level2_swaves_20100117_v01.cdf --output detections.csv"
)
ARRIVALS_EPILOG = "Example: bella arrivals sta.cdf wind.cdf psp.nc --around 2020-07-21T02:53 --output arrivals.csv"
FORMATS_EPILOG = "Example: bella formats --quirks --json"
SIMULATE_EPILOG = "Example: bella simulate archive --days 2 --seed 7 --from 2021-11-20"
MOST_FREQUENCIES, FAR_S = 1000, 3600.0
MOST_SIMULATED_DAYS = 366
PRODUCT_COLUMNS = ("name", "mission", "naming", "cadence", "quantity", "verified")

Spectra = Annotated[list[Path], typer.Argument(help="Archive files, netCDF or Zarr, of any spacecraft.")]


def detect(
    spectrum: Spectra,
    output: Annotated[Path, typer.Option(help="CSV of detections to write.")],
    figures: Annotated[
        Path | None, typer.Option(help="Folder for a figure of each day, SVG.", show_default="none drawn")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Find Type III bursts, which spacecraft detected the same one, and whether it can be localised."""
    check_output(output)
    for path in spectrum:
        check_file(path)
    know_updates()
    from bella.bursts.association import detect_in_fleet

    pieces, left_out = _read_fleet(spectrum)
    found = detect_in_fleet(pieces)
    if found.not_compared:
        warn(f"Not compared, not in the ephemeris at this time: {', '.join(found.not_compared)}")
    for reason in found.not_searchable:
        warn(f"Not searchable: {reason}")
    table = found.table
    write_csv(table, output)
    if figures is not None:
        _draw_spectra(figures, pieces, table)
    if as_json:
        print_json(frame_rows(table))
    else:
        show(_detection_table(table))
        say(f"Table  {output}")
        answer(_detection_counts(table, found.searched))
    if left_out or found.not_searchable:
        raise typer.Exit(1)


def _draw_spectra(folder: Path, pieces: "list[FleetPiece]", table: "pd.DataFrame") -> None:
    """A figure of each day, with all spacecraft."""
    import numpy as np

    from bella.plotting import Caption, day_caption, day_figure, write_figure

    for piece in pieces:
        spectra = list(piece.spectra.values())
        counted = [np.unique(one["time"].to_numpy().astype("datetime64[D]"), return_counts=True) for one in spectra]
        for day in sorted({day.item() for days, records in counted for day in days[records > 1]}):
            write_figure(folder / f"{day}.svg", day_figure(day, spectra, table), Caption(day_caption(day)))


def _read_fleet(paths: list[Path]) -> "tuple[list[FleetPiece], int]":
    """What the files hold, and how many of them are left out, each of which is reported on standard error."""
    from bella.spectra import fleet_pieces, open_spectra

    found: list[xr.Dataset] = []
    faults: list[BellaError] = []
    with steps("read", len(paths), transient=True) as advance:
        for path in paths:
            try:
                found += open_spectra(path)
            except BellaError as error:
                faults.append(error)
            if found:
                advance(1)
    if faults and not found:
        for earlier in faults[:-1]:
            warn(f"Left out: {earlier}")
        raise faults[-1]
    pieces, unfit = fleet_pieces(found)
    for fault in (*faults, *unfit):
        warn(f"Left out: {fault}")
    return pieces, len(faults) + len(unfit)


def _detection_table(table: "pd.DataFrame") -> "Table":
    columns = ("onset UTC", "spacecraft", "MHz", "score", "localisable, or why not")
    left = (columns[0], columns[1], columns[4])
    shown = new_table("", *columns, left=left, whole=columns[:2])
    for row in frame_rows(table[table["tier"] != REJECTED]):
        band = f"{row['f_low_mhz']:.2f}-{row['f_high_mhz']:.3g}"
        verdict = row["reason"].removeprefix("not localisable: ") or row["tier"]
        onset = row["start_utc"][:16].replace("T", " ")
        shown.add_row(onset, row["observatory"], band, f"{row['score']:.0f}", verdict)
    return shown


def _detection_counts(table: "pd.DataFrame", searched: int) -> str:
    counts = Counter(table["tier"])
    if not counts:
        return "no burst found" if searched else "not searchable"
    return "Detections: " + ", ".join(f"{number} {tier}" for tier, number in counts.items())


def arrivals(  # noqa: PLR0913, PLR0917 - one argument per option
    spectrum: Spectra,
    around: Annotated[str, typer.Option(help="About when the burst begins at high frequencies, UTC.")],
    output: Annotated[Path, typer.Option(help="CSV to write, as bella localise and bella fit-track read it.")],
    edge: Annotated[
        str, typer.Option(help="shared_profile, half_rise, half_maximum or gauss_hermite.")
    ] = "shared_profile",
    per_channel: Annotated[
        bool, typer.Option("--per-channel", help="Edges of the channels as they are, flagged ones too.")
    ] = False,
    frequencies: Annotated[int, typer.Option(help="Number of frequencies that the spacecraft share.")] = 40,
    covariance: Annotated[
        Path | None,
        typer.Option(
            help="netCDF with the covariance of all rows of the table (with --per-channel, of those without a flag).",
            show_default="not written",
        ),
    ] = None,
    figures: Annotated[
        Path | None, typer.Option(help="Folder for spectra with their edges.", show_default="none drawn")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Time a burst in spectra: arrival times with their errors, at frequencies that all spacecraft share."""
    _check_arrivals(edge, frequencies, {"--output": output, "--covariance": covariance})
    moment = instant(around)
    for path in spectrum:
        check_file(path)
    know_updates()
    from bella.arrivals import arrivals_csv, write_covariance
    from bella.bursts.timing import arrival_frame, arrivals_of, time_spectra
    from bella.spectra import fill_in_positions

    pieces, left_out = _read_fleet(spectrum)
    spectra = _around(pieces, moment)
    timed, unseen = time_spectra(spectra.values(), moment, edge)
    remarks: list[str] = []
    if per_channel:
        rows, table = timed.noise, timed.edges
        write_csv(table, output)
    else:
        rows = arrivals_of(timed, frequencies)
        table, remarks = fill_in_positions(arrival_frame(timed, rows), spectra, timed.reference_utc)
        write_whole(output, arrivals_csv(table))
    for remark in (*(f"Left out: {reason}" for reason in unseen), *remarks):
        warn(remark)
    if covariance is not None:
        write_covariance(rows.covariance_s2(), covariance)
    _draw_edges(figures, spectra, timed, None if per_channel else table)
    if as_json:
        print_json(_arrivals_account(timed, edge, rows) | {"arrivals": frame_rows(table)})
    else:
        _print_arrivals(timed, edge, len(table), output)
    if left_out or unseen:
        raise typer.Exit(1)


def _around(pieces: "list[FleetPiece]", moment: "np.datetime64") -> "dict[str, xr.Dataset]":
    """Spectra of about a time; those of other times are reported."""
    nearest = min(pieces, key=lambda piece: piece.apart_s(moment))
    if nearest.apart_s(moment) > FAR_S:
        raise NoDataError(
            f"no spacecraft shows a burst around {str(moment)[:19]}: the spectra are of {str(nearest.first)[:19]} to "
            f"{str(nearest.last)[:19]}; give a time of theirs, or other files"
        )
    for piece in pieces:
        if piece is not nearest:
            names = ", ".join(str(name) for one in piece.spectra.values() for name in one.attrs["source_files"])
            warn(f"Not used, of {str(piece.first)[:10]} to {str(piece.last)[:10]}: {names}")
    return nearest.spectra


def _draw_edges(
    folder: Path | None, spectra: "dict[str, xr.Dataset]", timed: "TimedBurst", table: "pd.DataFrame | None"
) -> None:
    if folder is not None:
        from bella.plotting import write_edge_figures

        write_edge_figures(folder, spectra, timed, table)


def _check_arrivals(edge: str, frequencies: int, written: dict[str, Path | None]) -> None:
    """Refuse options that cannot be, before any file is read."""
    from bella.bursts.timing import EDGES

    if edge not in EDGES:
        raise InputError(f"--edge {edge}: choose one of {', '.join(EDGES)}")
    if not 0 < frequencies <= MOST_FREQUENCIES:
        raise InputError(f"--frequencies {frequencies} is not between 1 and {MOST_FREQUENCIES}")
    for option, path in written.items():
        if path is not None:
            check_output(path, option)


def _arrivals_account(timed: "TimedBurst", asked: str, rows: "Timed") -> dict[str, Any]:
    """What was timed: edges of each spacecraft, and their errors in rise times, median."""
    return {
        "edge": timed.edge,
        "edge_asked": asked,
        "reference_utc": f"{timed.reference_utc}Z",
        "rows": rows.frequency_mhz.size,
        "noise_in_rise_times": {"shape": timed.noise.shape_share, "channel": timed.noise.channel_share},
        "spacecraft": [
            {
                "observatory": str(name),
                "edges": int((edges["flag"] == "").sum()),
                "refused": int((edges["flag"] != "").sum()),
                "f_low_mhz": edges.loc[edges["flag"] == "", "frequency_mhz"].min(),
                "f_high_mhz": edges.loc[edges["flag"] == "", "frequency_mhz"].max(),
            }
            for name, edges in timed.edges.groupby("observatory", sort=False)
        ],
    }


def _print_arrivals(timed: "TimedBurst", asked: str, rows: int, output: Path) -> None:
    account = _arrivals_account(timed, asked, timed.noise)
    table = new_table("", "spacecraft", "edges", "refused", "MHz", left=("spacecraft",), whole=("spacecraft",))
    for one in account["spacecraft"]:
        band = f"{one['f_low_mhz']:.2f}-{one['f_high_mhz']:.3g}" if one["edges"] else "none"
        table.add_row(one["observatory"], str(one["edges"]), str(one["refused"]), band)
    show(table)
    if timed.edge != asked:
        say(f"Edge {timed.edge}: a shared profile needs three spacecraft with enough channels, and a fit")
    noise = timed.noise
    say(
        f"Errors as shares of the rise, median: {noise.shape_share:.3f} smooth along frequency, "
        f"{noise.channel_share:.3f} of each channel"
    )
    answer(f"{rows} arrival times of {len(account['spacecraft'])} spacecraft by {timed.edge} in {output}")


def formats(
    known_quirks: Annotated[
        bool, typer.Option("--quirks", help="List the known quirks of instruments and products instead.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """List the archive products whose files can be read."""
    from bella.spectra import PRODUCTS, quirks

    if known_quirks:
        rows = [one.model_dump(mode="json") for one in quirks()]
    else:
        rows = [{name: asdict(product)[name] for name in PRODUCT_COLUMNS} for product in PRODUCTS]
    if as_json:
        print_json(rows)
    elif known_quirks:
        show(_quirks_table(rows))
        answer(f"{len(rows)} quirks; their sources: bella formats --quirks --json")
    else:
        show(_products_table(rows))
        answer(f"{len(rows)} kinds of files can be read, and netCDF or Zarr in the form of docs/spectra.md")


def _products_table(rows: list[dict[str, Any]]) -> "Table":
    columns = ("file", "cadence", "verified")
    table = new_table("Files that can be read", *columns, left=columns, whole=("file",))
    table.caption = "verified: read from the archive itself; the others from files written to its description"
    for mission in dict.fromkeys(row["mission"] for row in rows):
        table.add_row(f"[bold]{mission}[/bold]" if mission != "any" else "[bold]Any other instrument[/bold]")
        for row in (row for row in rows if row["mission"] == mission):
            table.add_row(row["naming"], row["cadence"], "yes" if row["verified"] else "no")
    return table


def _quirks_table(rows: list[dict[str, Any]]) -> "Table":
    columns = ("instrument", "days", "effect", "what the readers do")
    table = new_table("Known quirks", *columns, left=columns)
    table.show_lines = True
    for row in rows:
        instrument = " ".join([row["observatory"], *row["receivers"]])
        days = f"{row['first']} to {row['last'] or 'now'}"
        table.add_row(f"{instrument}\n{row['name']}", days, row["effect"], row["handling"])
    return table


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
    as_json: AsJson = False,
) -> None:
    """Write simulated days as files of every receiver: bursts of known beams, storms, interference and gaps."""
    if not 0 < days <= MOST_SIMULATED_DAYS:
        raise InputError(f"--days {days} is not between 1 and {MOST_SIMULATED_DAYS}; simulate more in parts")
    if seed < 0:
        raise InputError(f"--seed {seed} is below 0; name a number from 0 on")
    written = folder / "truth.json" if truth is None else truth
    if truth is not None:
        check_output(truth, "--truth")
    start = parse_day(first, "--from")
    know_updates()
    from bella.simulation.archive_days import simulate_days

    wanted = [start + timedelta(days=number) for number in range(days)]
    with steps("days", days) as advance:
        simulated = simulate_days(folder, wanted, seed, dataset or (), advance)
    write_whole(written, json.dumps(simulated, indent=1))
    if as_json:
        print_json(simulated)
        return
    bursts = sum(len(day["bursts"]) for day in simulated["days"])
    files = sum(len(day["files"]) for day in simulated["days"])
    say(f"Archive {folder}")
    say(f"Truth   {written}")
    answer(f"{days} days with {bursts} bursts in {files} files: bella run --archive {folder} --from {start}")
