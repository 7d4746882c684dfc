"""
Compare presets with the paper
==============================

Cañizares et al. (2024) found 30 ± 2 degrees and 400 ± 20 km/s for the burst of 2012-06-07. Their assumptions are the
preset ``bella-2024``: an error of 30 s for every receiver and a Gaussian prior of the position.
"""

import matplotlib.pyplot as plt
import numpy as np

import bella
from bella.bursts import published_arrivals

arrivals = published_arrivals(np.geomspace(0.15, 2.0, 20))
presets = ("default", "bella-2024", "robust")
sources = {name: bella.localise(arrivals, preset=name) for name in presets}

# %%
# Distances barely depend on the preset, their errors do: ``robust`` allows for a bad arrival time, and three times
# cannot tell which one that is.
fig, axes = plt.subplots()
for name, source in sources.items():
    table = source.to_table()
    distance = np.hypot(table["x_rsun"], table["y_rsun"]).value
    radius = np.sqrt(table["area68_rsun2"].value / np.pi)
    axes.errorbar(table["frequency_mhz"].value, distance, yerr=radius, fmt=".-", capsize=2, label=name)
axes.set(xscale="log", yscale="log", xlabel="frequency [MHz]", ylabel="distance of the apparent source [solar radii]")
axes.legend()

# %%
# The longitude of the footpoint, from all times together.
for name in ("default", "bella-2024"):
    track = bella.fit_track(arrivals, preset=name, draws=500)
    phi0 = track.record.phi0_deg
    print(f"{name:10s} {phi0.q50:.1f} deg (68 % interval {phi0.q16:.1f} to {phi0.q84:.1f}), {track.record.flags}")
