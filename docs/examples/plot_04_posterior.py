"""
Work with the posterior in xarray
=================================

A position is a probability distribution. ``source.posterior`` is an :class:`xarray.Dataset` with draws, moments and
regions at each frequency, labelled and with units.
"""

import matplotlib.pyplot as plt
import numpy as np

import bella
from bella.bursts import published_arrivals

# %%
# The published arrival times of 2012-06-07 at four frequencies.
source = bella.localise(published_arrivals(np.array([0.2, 0.4, 0.8, 1.6])))
source.posterior["draws"]

# %%
# Draws of x and y give those of distance and longitude, and so any quantile.
draws = source.posterior["draws"]
x, y = draws.sel(parameter="x_rsun"), draws.sel(parameter="y_rsun")
distance, longitude = np.hypot(x, y), np.degrees(np.arctan2(y, x))
for frequency in source.posterior["frequency"].to_numpy():
    low, middle, high = distance.sel(frequency=frequency).quantile([0.16, 0.5, 0.84], "draw").to_numpy()
    print(f"{frequency:4.1f} MHz: {middle:5.1f} solar radii (68 % interval {low:.1f} to {high:.1f})")

# %%
# The probability that the source at 0.2 MHz was farther than half an astronomical unit (107.5 solar radii).
print(float((distance.sel(frequency=0.2) > 107.5).mean()))

# %%
fig, axes = plt.subplots()
for frequency in source.posterior["frequency"].to_numpy():
    axes.plot(x.sel(frequency=frequency)[:600], y.sel(frequency=frequency)[:600], ".", ms=2, label=f"{frequency:g} MHz")
axes.set(xlabel="x, HEE [solar radii], to Earth", ylabel="y, HEE [solar radii], west", aspect="equal")
axes.legend(markerscale=5)
