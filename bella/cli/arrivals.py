"""The command ``bella arrivals``: when each spacecraft heard a burst, channel by channel or along t(f)."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from bella.cli.detect import read_fleet, write_table
from bella.cli.ephemeris import instant, know_updates
from bella.cli.output import write_whole
from bella.exceptions import InputError, NoDataError

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd
    import xarray as xr

    from bella.bursts.noise import Timed
    from bella.bursts.timing import TimedBurst

out, err = Console(), Console(stderr=True)

EPILOG = "Example: bella arrivals sta.cdf wind.cdf psp.nc --around 2020-07-21T02:53 --output arrivals.csv"
MOST_FREQUENCIES = 1000


def arrivals(  # noqa: PLR0913, PLR0917 - one argument per option
    spectrum: Annotated[list[Path], typer.Argument(help="Archive files, netCDF or Zarr, of any spacecraft.")],
    around: Annotated[str, typer.Option(help="About when the burst begins at high frequencies, UTC.")],
    output: Annotated[Path, typer.Option(help="CSV to write, as bella localise and bella fit-track read it.")],
    edge: Annotated[
        str, typer.Option(help="shared_profile, half_rise, half_maximum or gauss_hermite.")
    ] = "shared_profile",
    per_channel: Annotated[
        bool, typer.Option("--per-channel", help="Edges of the channels as they are, flagged ones too.")
    ] = False,
    frequencies: Annotated[int, typer.Option(help="So many frequencies that the spacecraft share.")] = 40,
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
) -> None:
    """Time a burst in spectra: arrival times with their errors, at frequencies that all spacecraft share."""
    _check(edge, frequencies, [path for path in (output, covariance) if path])
    moment = instant(around)
    know_updates()
    spectra, left_out = read_fleet(spectrum)
    timed = _timed(spectra, moment, edge)
    rows, table = _rows(timed, spectra, frequencies, per_channel=per_channel)
    if per_channel:
        write_table(timed.edges, output)
    else:
        from bella.arrivals import arrivals_csv

        write_whole(output, arrivals_csv(table))
    if covariance is not None:
        from bella.arrivals import write_covariance

        write_covariance(rows.covariance_s2(), covariance)
    if figures is not None:
        _draw(figures, spectra, timed, None if per_channel else table)
    _say(timed, edge, output)
    if left_out or set(spectra) - set(timed.edges["observatory"]):
        raise typer.Exit(1)


def _check(edge: str, frequencies: int, written: list[Path]) -> None:
    """Refuse options that cannot be, before any file is read."""
    from bella.bursts.timing import EDGES

    if edge not in EDGES:
        raise InputError(f"--edge {edge}: choose one of {', '.join(EDGES)}")
    if not 0 < frequencies <= MOST_FREQUENCIES:
        raise InputError(f"--frequencies {frequencies} is not between 1 and {MOST_FREQUENCIES}")
    for path in written:
        if not path.parent.is_dir():
            raise InputError(f"folder {path.parent} does not exist; make it or name another")


def _timed(spectra: "dict[str, xr.Dataset]", moment: "np.datetime64", edge: str) -> "TimedBurst":
    from bella.bursts.detection import search
    from bella.bursts.timing import burst_spectrum, candidate_near, time_burst

    parts = []
    for one in spectra.values():
        searched = search(one)
        try:
            parts.append(burst_spectrum(searched, candidate_near(searched, moment)))
        except NoDataError as error:
            err.print(f"Left out: {error}", soft_wrap=True, highlight=False)
    if not parts:
        raise NoDataError(f"no spacecraft shows a burst around {moment}; give another time, or other files")
    return time_burst(parts, edge)


def _rows(
    timed: "TimedBurst", spectra: "dict[str, xr.Dataset]", number: int, *, per_channel: bool
) -> "tuple[Timed, pd.DataFrame]":
    """Arrival times and their table; of one spacecraft with few edges the channels themselves."""
    from bella.bursts.timing import arrival_frame, arrivals_at, shared_frequencies_mhz

    if per_channel:
        return timed.noise, timed.edges
    shared_mhz = shared_frequencies_mhz(timed, number)
    names = list(dict.fromkeys(timed.edges["observatory"]))
    if len(names) == 1 and not (timed.bands_mhz and shared_mhz.size):
        if not timed.noise.frequency_mhz.size:
            raise NoDataError(f"no channel of {names[0]} has an edge without a flag; see them with --per-channel")
        rows = timed.noise
    else:
        rows = arrivals_at(timed, shared_mhz)
    return rows, _placed(arrival_frame(timed, rows), spectra, timed.reference_utc)


def _placed(table: "pd.DataFrame", spectra: "dict[str, xr.Dataset]", utc: "np.datetime64") -> "pd.DataFrame":
    """The table with the positions that come with the spectra, where they agree with the ephemeris or it has none."""
    from bella.spectra import receiver_position

    columns = ["x_rsun", "y_rsun", "z_rsun"]
    for name in dict.fromkeys(table["observatory"]):
        try:
            there = receiver_position(spectra[name], utc)
        except NoDataError as error:
            err.print(f"Without a position: {error}", soft_wrap=True, highlight=False)
            continue
        if there.flag:
            err.print(
                f"{name}: the position in its file is {there.difference_km:.0f} km from the ephemeris, which is taken",
                soft_wrap=True,
                highlight=False,
            )
        if there.source == "file":
            for column, value in zip(columns, there.position_rsun, strict=True):
                table.loc[table["observatory"] == name, column] = value
    return table


def _draw(folder: Path, spectra: "dict[str, xr.Dataset]", timed: "TimedBurst", table: "pd.DataFrame | None") -> None:
    import numpy as np

    from bella.plotting import write_aligned_png, write_collapsed_png, write_light_curves_png
    from bella.spacecraft import light_time_s
    from bella.spectra import over_background

    names = list(dict.fromkeys(timed.edges["observatory"]))
    shown = {
        name: one if one.attrs["quantity"] == "relative_flux" else over_background(one)
        for name, one in spectra.items()
        if name in names
    }
    utc = np.array([timed.reference_utc])
    from_sun_s = {name: float(light_time_s(name, utc, np.zeros(3))[0]) for name in names}
    write_aligned_png(folder / "aligned.png", shown, timed.edges, from_sun_s, table)
    if timed.collapsed:
        from bella.bursts.shared_profile import collapsed_samples

        write_collapsed_png(folder / "shared_profile.png", collapsed_samples(timed.collapsed))
    rows = np.unique(timed.edges.loc[timed.edges["flag"] == "", "frequency_mhz"])
    chosen = rows[np.linspace(0, rows.size - 1, min(5, rows.size)).astype(int)][::-1]
    write_light_curves_png(folder / "light_curves.png", shown, timed.edges, chosen.tolist())


def _say(timed: "TimedBurst", asked: str, output: Path) -> None:
    table = Table("spacecraft", "edges", "refused", "MHz", box=SIMPLE_HEAD, pad_edge=False)
    for name, rows in timed.edges.groupby("observatory", sort=False):
        good = rows["flag"] == ""
        frequency = rows.loc[good, "frequency_mhz"]
        band = f"{frequency.min():.2f}-{frequency.max():.3g}" if good.any() else "none"
        table.add_row(str(name), str(int(good.sum())), str(int((~good).sum())), band)
    out.print(table)
    if timed.edge != asked:
        out.print(f"Edge {timed.edge}: a shared profile needs three spacecraft with enough channels, and a fit")
    noise = timed.noise
    out.print(
        f"Errors beyond those of the samples, in rise times: {noise.shape_share:.3f} smooth along frequency, "
        f"{noise.channel_share:.3f} of each channel",
        soft_wrap=True,
        highlight=False,
    )
    out.print(f"Table  {output}", soft_wrap=True, highlight=False)
