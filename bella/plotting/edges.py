"""The figures of one burst that was timed: spectra on the clock of the Sun, light curves, and the shared profile."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from bella.bursts.shared_profile import collapsed_samples
from bella.bursts.timing import TimedBurst
from bella.plotting.collapsed import write_collapsed_png
from bella.plotting.export import Caption, write_figure
from bella.plotting.light_curves import write_light_curves_png
from bella.plotting.spectra import SpectraView, spectra_caption, spectra_figure
from bella.spacecraft import light_time_s
from bella.spectra import over_background

MOST_CHANNELS = 5


def write_edge_figures(
    folder: Path, spectra: Mapping[str, xr.Dataset], timed: TimedBurst, arrivals: pd.DataFrame | None
) -> None:
    """Write ``aligned.svg``, ``light_curves.png`` and, where there is a shared profile, ``shared_profile.png``.

    Parameters
    ----------
    folder : Path
        Is made when it does not exist.
    spectra : mapping of str to xarray.Dataset
        By observatory.
    timed : TimedBurst
    arrivals : pandas.DataFrame or None
        Arrival table to draw beside the edges of the channels.
    """
    names = list(dict.fromkeys(timed.edges["observatory"]))
    shown = {
        name: one if one.attrs["quantity"] == "relative_flux" else over_background(one)
        for name, one in spectra.items()
        if name in names
    }
    utc = np.array([timed.reference_utc])
    from_sun_s = {name: float(light_time_s(name, utc, np.zeros(3))[0]) for name in names}
    edges = timed.edges[timed.edges["flag"] == ""]
    drawn = {str(edge): rows for edge, rows in edges.groupby("edge", sort=False)}
    if arrivals is not None:
        drawn["arrival table"] = arrivals
    earlier = {name: -one for name, one in from_sun_s.items()}
    aligned = spectra_figure(xr.DataTree.from_dict(shown), drawn, SpectraView(clock="sun", shift_s=earlier))
    write_figure(folder / "aligned.svg", aligned, Caption(spectra_caption("sun")))
    if timed.collapsed:
        write_collapsed_png(folder / "shared_profile.png", collapsed_samples(timed.collapsed))
    rows = np.unique(timed.edges.loc[timed.edges["flag"] == "", "frequency_mhz"])
    chosen = rows[np.linspace(0, rows.size - 1, min(MOST_CHANNELS, rows.size)).astype(int)][::-1]
    write_light_curves_png(folder / "light_curves.png", shown, timed.edges, chosen.tolist())
