"""The command ``bella arrivals``: when each spacecraft heard a burst, channel by channel or along t(f)."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from bella.cli_coverage import write_netcdf
from bella.cli_detect import read_fleet, write_table
from bella.cli_ephemeris import instant, know_updates
from bella.cli_output import write_whole
from bella.exceptions import InputError, NoDataError

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd
    import xarray as xr

    from bella.bursts.timing import TimedBurst

out, err = Console(), Console(stderr=True)

EPILOG = "Example: bella arrivals sta.cdf wind.cdf psp.nc --around 2020-07-21T02:53 --output arrivals.csv"
MOST_FREQUENCIES = 1000


def arrivals(  # noqa: PLR0913, PLR0917 - one argument per option
    spectrum: Annotated[list[Path], typer.Argument(help="Archive files, netCDF or Zarr, of any spacecraft.")],
    around: Annotated[str, typer.Option(help="About when the burst begins at high frequencies, UTC.")],
    output: Annotated[Path, typer.Option(help="CSV to write, as bella localise and bella fit-track read it.")],
    edge: Annotated[str, typer.Option(help="half_rise, half_maximum or gauss_hermite.")] = "half_rise",
    per_channel: Annotated[
        bool, typer.Option("--per-channel", help="Edges of the channels as they are, flagged ones too.")
    ] = False,
    frequencies: Annotated[int, typer.Option(help="So many frequencies that the spacecraft share.")] = 40,
    covariance: Annotated[
        Path | None,
        typer.Option(help="netCDF with the covariance of the times along t(f).", show_default="not written"),
    ] = None,
    figures: Annotated[
        Path | None, typer.Option(help="Folder for spectra with their edges.", show_default="none drawn")
    ] = None,
) -> None:
    """Time a burst in spectra: edges with their errors, and t(f) at frequencies that all spacecraft share."""
    from bella.bursts.edges import METHOD_OF_EDGE

    if edge not in METHOD_OF_EDGE:
        raise InputError(f"--edge {edge}: choose one of {', '.join(METHOD_OF_EDGE)}")
    if not 0 < frequencies <= MOST_FREQUENCIES:
        raise InputError(f"--frequencies {frequencies} is not between 1 and {MOST_FREQUENCIES}")
    for path in filter(None, (output, covariance)):
        if not path.parent.is_dir():
            raise InputError(f"folder {path.parent} does not exist; make it or name another")
    moment = instant(around)
    know_updates()
    spectra = read_fleet(spectrum)
    timed = _timed(spectra, moment, METHOD_OF_EDGE[edge])
    written = _written(timed, METHOD_OF_EDGE[edge], frequencies, per_channel=per_channel)
    if per_channel:
        write_table(written, output)
    else:
        from bella.arrivals import arrivals_csv

        write_whole(output, arrivals_csv(written))
    if covariance is not None:
        from bella.bursts.timing import arrival_covariance, shared_frequencies_mhz

        write_netcdf(arrival_covariance(timed, shared_frequencies_mhz(timed, frequencies)), covariance)
    if figures is not None:
        _draw(figures, spectra, timed, written)
    _say(timed, output)


def _timed(spectra: "dict[str, xr.Dataset]", moment: "np.datetime64", method: str) -> "TimedBurst":
    import pandas as pd

    from bella.bursts.detection import search
    from bella.bursts.timing import burst_edges, candidate_near, timed_burst

    edges = []
    for name, one in spectra.items():
        searched = search(one)
        try:
            edges.append(burst_edges(searched, candidate_near(searched, moment), method))
        except NoDataError as error:
            err.print(f"Left out: {error}", soft_wrap=True, highlight=False)
            continue
        if edges[-1].empty:
            err.print(f"Left out: {name} has no channel in the band of the burst", soft_wrap=True)
    if not edges:
        raise NoDataError(f"no spacecraft shows a burst around {moment}; give another time, or other files")
    return timed_burst(pd.concat(edges, ignore_index=True), spectra)


def _written(timed: "TimedBurst", method: str, number: int, *, per_channel: bool) -> "pd.DataFrame":
    from bella.bursts.timing import arrival_table, shared_frequencies_mhz

    if per_channel:
        return timed.edges
    return arrival_table(timed, shared_frequencies_mhz(timed, number), method)


def _draw(folder: Path, spectra: "dict[str, xr.Dataset]", timed: "TimedBurst", table: "pd.DataFrame") -> None:
    import numpy as np

    from bella.plotting import write_aligned_png, write_light_curves_png
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
    curve = table if timed.evolutions and "offset_sd_s" in table else None
    write_aligned_png(folder / "aligned.png", shown, timed.edges, from_sun_s, curve)
    rows = np.unique(timed.edges.loc[timed.edges["flag"] == "", "frequency_mhz"])
    chosen = rows[np.linspace(0, rows.size - 1, min(5, rows.size)).astype(int)][::-1]
    write_light_curves_png(folder / "light_curves.png", shown, timed.edges, chosen.tolist())


def _say(timed: "TimedBurst", output: Path) -> None:
    table = Table("spacecraft", "edges", "refused", "MHz", "t(f)", box=SIMPLE_HEAD, pad_edge=False)
    for name, rows in timed.edges.groupby("observatory", sort=False):
        good = int((rows["flag"] == "").sum())
        low, high = timed.bands_mhz.get(str(name), (float("nan"), float("nan")))
        curve = timed.evolutions.get(str(name))
        basis = (
            "too few edges"
            if curve is None
            else f"{curve.basis.replace('_', ' ')}, errors x {curve.inflation**0.5:.1f}"
        )
        table.add_row(str(name), str(good), str(len(rows) - good), f"{low:.2f}-{high:.3g}", basis)
    out.print(table)
    out.print(f"Table  {output}", soft_wrap=True, highlight=False)
