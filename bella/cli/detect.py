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

from bella.cli.ephemeris import know_updates
from bella.cli.output import write_whole
from bella.exceptions import BellaError, InputError
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
    spectra, left_out = read_fleet(spectrum)
    table, not_searchable = _detections(spectra)
    write_table(table, output)
    if figures is not None:
        from bella.plotting import write_spectrum_png

        for name, one in spectra.items():
            write_spectrum_png(figures / f"{name}.png", one, table)
    if as_json:
        out.print_json(table.to_json(orient="records", date_format="iso"))
    else:
        out.print(_shown(table, len(spectra) - len(not_searchable)))
        out.print(f"Table  {output}", soft_wrap=True, highlight=False)
    if left_out or not_searchable:
        raise typer.Exit(1)


def read_fleet(paths: list[Path]) -> "tuple[dict[str, xr.Dataset], int]":
    """One spectrum per spacecraft from files; each that cannot be read is reported on the standard error and left out.

    Parameters
    ----------
    paths : list of Path

    Returns
    -------
    spectra : dict of str to xarray.Dataset
        By observatory.
    left_out : int
        How many files were left out.

    Raises
    ------
    InputError
        If no file can be read.
    """
    from bella.spectra import by_observatory, open_spectra

    with Progress(console=err, transient=True) as bar:
        task = bar.add_task("read", total=len(paths))
        found: list[xr.Dataset] = []
        faults: list[BellaError] = []
        for path in paths:
            try:
                found += open_spectra(path)
            except BellaError as error:
                faults.append(error)
            bar.advance(task)
    if faults and not found:
        raise faults[0]
    for fault in faults:
        err.print(f"Left out: {fault}", soft_wrap=True, highlight=False)
    return by_observatory(found), len(faults)


def _detections(spectra: "dict[str, xr.Dataset]") -> "tuple[pd.DataFrame, list[str]]":
    """Detection table, and the spacecraft whose spectra cannot be searched."""
    from bella.bursts.association import associate, association_table, has_position
    from bella.bursts.detection import search

    searched = [search(one) for one in spectra.values()]
    unknown = [one.observatory for one in searched if not has_position(one)]
    if unknown:
        message = f"Not compared, not in the ephemeris at this time: {', '.join(unknown)}"
        err.print(message, soft_wrap=True, highlight=False)
    not_searchable = [one for one in searched if one.not_searchable]
    for one in not_searchable:
        files = ", ".join(str(name) for name in spectra[one.observatory].attrs["source_files"])
        message = f"Not searchable: {one.observatory} ({files}): {one.not_searchable}; give a file of another receiver"
        err.print(message, soft_wrap=True, highlight=False)
    table = association_table(associate(searched), searched)
    return table, [one.observatory for one in not_searchable]


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


def _shown(table: "pd.DataFrame", searched: int) -> Table:
    shown = Table(*SHOWN, box=SIMPLE_HEAD, pad_edge=False, caption_justify="left")
    for row in json.loads(table[table["tier"] != REJECTED].to_json(orient="records", date_format="iso")):
        band = f"{row['f_low_mhz']:.2f}-{row['f_high_mhz']:.3g}"
        verdict = row["reason"].removeprefix("not localisable: ") or row["tier"]
        onset = row["start_utc"][:16].replace("T", " ")
        shown.add_row(onset, row["observatory"], band, f"{row['score']:.0f}", verdict)
    counts = Counter(table["tier"])
    shown.caption = ", ".join(f"{number} {tier}" for tier, number in counts.items()) or (
        "no burst found" if searched else "not searchable"
    )
    return shown
