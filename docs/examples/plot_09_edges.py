"""
Start time of a burst at each frequency
=======================================

``bella.time_edges`` gives the time of the edge, with its error, at each frequency and spacecraft. Here the spectra are
simulated, so that the true times are known.
"""

import matplotlib.pyplot as plt
import numpy as np

import bella
from bella.simulation.strata import isolated_burst

# %%
# A simulated burst at Wind, STEREO-A, Parker Solar Probe and Solar Orbiter.
case = isolated_burst("clean", "2021", 17)
arrivals = bella.time_edges(case.spectra.values(), case.around_utc, frequencies=12)
arrivals.to_table()["observatory", "frequency_mhz", "arrival_utc", "sigma_s"][:6]

# %%
# Only differences between spacecraft count. Error of the difference to Wind, against the error that was stated.
frame = arrivals.frame
seconds = (frame["arrival_utc"] - np.datetime64(case.burst.release_utc)).dt.total_seconds()
truth = np.concatenate(
    [
        case.truth(name, rows["frequency_mhz"].to_numpy())["arrival_s"]
        for name, rows in frame.groupby("observatory", sort=False)
    ]
)
frame = frame.assign(error_s=seconds - truth)
fig, axes = plt.subplots()
wind = frame[frame["observatory"] == "WIND"].set_index("frequency_mhz")
for name, rows in frame.groupby("observatory"):
    if name != "WIND":
        pair = rows.set_index("frequency_mhz").join(wind.add_suffix("_wind"), how="inner")
        stated = np.hypot(pair["sigma_s"], pair["sigma_s_wind"])
        axes.errorbar(pair.index, pair["error_s"] - pair["error_s_wind"], yerr=stated, fmt="o", capsize=2, label=name)
axes.axhline(0, color="0.5")
axes.set(xscale="log", xlabel="frequency [MHz]", ylabel="error of the difference to Wind [s]")
axes.legend()
