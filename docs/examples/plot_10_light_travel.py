"""
Spectra shifted by the light travel time
========================================

Each spectrum is drawn earlier by the time that light takes from the Sun to that spacecraft. What differences are left
say where the source was: it was nearer to the spacecraft where the burst is early.
"""

import matplotlib.dates as mdates
import matplotlib.pyplot as plt
import numpy as np

from bella.spacecraft import light_time_s
from bella.spectra import event_spectra

when = np.datetime64("2012-06-07T19:30", "ns")
spectra = {name: branch.to_dataset() for name, branch in event_spectra().children.items()}
fig, rows = plt.subplots(len(spectra), 1, sharex=True, sharey=True, figsize=(8, 7), layout="constrained")
for axes, (name, spectrum) in zip(rows, spectra.items(), strict=True):
    light_s = light_time_s(name, when, [0.0, 0.0, 0.0]).item()
    at_sun = spectrum["time"].to_numpy() - np.timedelta64(round(light_s * 1e9), "ns")
    axes.pcolormesh(
        at_sun, spectrum["frequency"], spectrum["intensity"].T, cmap="magma", vmin=0, vmax=1, shading="nearest"
    )
    axes.set(yscale="log", ylabel="frequency [MHz]", title=f"{name}, {light_s:.0f} s earlier")
rows[-1].xaxis.set_major_formatter(mdates.DateFormatter("%H:%M"))
rows[-1].set(xlabel="UTC less the light travel time from the Sun, 2012-06-07")
