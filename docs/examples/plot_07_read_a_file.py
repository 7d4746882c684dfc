"""
Read a file of an archive and plot its spectrum
===============================================

``open_spectra`` reads every product of :doc:`/spectra`. The product is recognised from the name and the content of the
file. Here the file is simulated, in the layout of the archive; a downloaded one is read in the same way.
"""

from datetime import date
from pathlib import Path
from tempfile import mkdtemp

import matplotlib.pyplot as plt

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
# Two receivers side by side, in decibels over the background.
wind = over_background(combine_receivers(rad1, rad2))
fig, axes = plt.subplots(figsize=(9, 4))
part = wind["intensity"].sel(time=slice("2021-11-21T00", "2021-11-21T08"))
mesh = axes.pcolormesh(part["time"], part["frequency"], part.T, vmin=0, vmax=15, cmap="magma", shading="nearest")
fig.colorbar(mesh, label="dB over background")
axes.set(yscale="log", xlabel="UTC, 2021-11-21", ylabel="frequency [MHz]")
