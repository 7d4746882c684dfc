"""
Read a file of an archive and plot its spectrum
===============================================

``open_spectra`` reads every product of :doc:`/spectra`. The product is recognised from the name and the content of the
file. Here the file is simulated, in the layout of the archive; a downloaded one is read in the same way.
"""

from datetime import date
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
import xarray as xr

from bella.plotting import Figure, SpectraView, spectra_caption, spectra_figure
from bella.simulation.archive_days import simulate_days
from bella.spectra import combine_receivers, open_spectra, over_background

folder = Path(mkdtemp()) / "archive"
simulate_days(folder, [date(2021, 11, 21)], 7, ["WI_H1_WAV"], lambda _=1: None)
file = next(folder.rglob("*.cdf"))
print(file.name)

# %%
# One spectrum for each receiver. Times are UTC, frequencies MHz, and samples without data are NaN. Channels and samples
# that the archive interpolated are marked or NaN, and the known quirks are named.
rad1, rad2, *_ = open_spectra(file)
print(rad1.attrs["quirks"])
print(f"{float(rad1['interpolated'].mean()):.0%} of the channels of RAD1 are interpolated")
rad1

# %%
# Two receivers side by side, in decibels over the background: the first eight hours, in seconds since 1970.
wind = over_background(combine_receivers(rad1, rad2))
begin_s = np.datetime64("2021-11-21", "s").astype(float)
look = SpectraView(span_s=(begin_s, begin_s + 8 * 3600.0), band_mhz=(0.02, 13.0))
figure = Figure(spectra_figure(xr.DataTree.from_dict({"WIND": wind}), {}, look), spectra_caption("spacecraft"))
