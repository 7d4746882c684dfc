"""The command ``bella detect``: bursts in spectra, one row per burst and spacecraft."""

import json
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from bella.cli_ephemeris import know_updates
from bella.cli_output import write_whole
from bella.exceptions import InputError
from bella.flags import REJECTED

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

out, err = Console(), Console(stderr=True)

EPILOG = (
    "Example: bella detect wi_h1_wav_20100117_v01.cdf stereo_level2_swaves_20100117_v01.cdf --output detections.csv"
)
SHOWN = ("onset UTC", "spacecraft", "MHz", "score", "localisable, or why not")


def detect(
    spectrum: Annotated[list[Path], typer.Argument(help="Archive files, netCDF or Zarr, of any spacecraft.")],
    output: Annotated[Path, typer.Option(help="CSV of detections to write.")],
    figures: Annotated[
        Path | None, typer.Option(help="Folder for a figure of each spacecraft's day.", show_default="none drawn")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False,
) -> None:
    """Find Type III bursts, tell which spacecraft heard the same one, and whether it can be placed."""
    if not output.parent.is_dir():
        raise InputError(f"folder {output.parent} does not exist; make it or name another --output")
    know_updates()
    spectra = read_fleet(spectrum)
    table = _detections(spectra)
    write_table(table, output)
    if figures is not None:
        from bella.plotting import write_spectrum_png

        for name, one in spectra.items():
            write_spectrum_png(figures / f"{name}.png", one, table)
    if as_json:
        out.print_json(table.to_json(orient="records", date_format="iso"))
        return
    out.print(_shown(table))
    out.print(f"Table  {output}", soft_wrap=True, highlight=False)


def read_fleet(paths: list[Path]) -> "dict[str, xr.Dataset]":
    """One spectrum per spacecraft from files.

    Parameters
    ----------
    paths : list of Path

    Returns
    -------
    dict of str to xarray.Dataset
        By observatory.

    Raises
    ------
    InputError
        If a file cannot be read.
    """
    from bella.spectra import by_observatory, open_spectra

    with Progress(console=err, transient=True) as bar:
        task = bar.add_task("read", total=len(paths))
        found: list[xr.Dataset] = []
        for path in paths:
            found += open_spectra(path)
            bar.advance(task)
    return by_observatory(found)


def _detections(spectra: "dict[str, xr.Dataset]") -> "pd.DataFrame":
    from bella.bursts.association import associate, association_table, has_position
    from bella.bursts.detection import search

    searched = [search(one) for one in spectra.values()]
    unknown = [one.observatory for one in searched if not has_position(one)]
    if unknown:
        message = f"Not compared, not in the ephemeris at this time: {', '.join(unknown)}"
        err.print(message, soft_wrap=True, highlight=False)
    return association_table(associate(searched), searched)


def write_table(table: "pd.DataFrame", path: Path) -> None:
    """Write a table as CSV, whole or not at all; times as ISO with Z.

    Parameters
    ----------
    table : pandas.DataFrame
    path : Path
        In a folder that exists.

    Raises
    ------
    InputError
        If it cannot be written.
    """
    stamped = table.copy()
    for column in stamped.select_dtypes("datetime64[ns]"):
        stamped[column] = stamped[column].dt.strftime("%Y-%m-%dT%H:%M:%S.%fZ")
    write_whole(path, stamped.to_csv(index=False))


def _shown(table: "pd.DataFrame") -> Table:
    shown = Table(*SHOWN, box=SIMPLE_HEAD, pad_edge=False, caption_justify="left")
    for row in json.loads(table[table["tier"] != REJECTED].to_json(orient="records", date_format="iso")):
        band = f"{row['f_low_mhz']:.2f}-{row['f_high_mhz']:.3g}"
        verdict = row["reason"].removeprefix("not localisable: ") or row["tier"]
        onset = row["start_utc"][:16].replace("T", " ")
        shown.add_row(onset, row["observatory"], band, f"{row['score']:.0f}", verdict)
    counts = Counter(table["tier"])
    shown.caption = ", ".join(f"{number} {tier}" for tier, number in counts.items()) or "no burst found"
    return shown
