"""
How well does a fleet localise a burst?
=======================================

Before an event is chosen, a map says how well the spacecraft of that day localise a source anywhere in the ecliptic.
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import LogNorm

from bella.multilateration import PRESETS, uncertainty_map
from bella.spacecraft import fleet

# %%
# The spacecraft of one day, with positions in HEE.
spacecraft = fleet(np.datetime64("2022-06-01T12:00", "ns"))
print(spacecraft[["observatory", "range_rsun", "longitude_deg"]].to_string(index=False))

# %%
# Timing errors of 20 s everywhere, and the standard deviation in the worst direction.
positions = {row.observatory: np.array([row.x_rsun, row.y_rsun, row.z_rsun]) for row in spacecraft.itertuples()}
uncertainty = uncertainty_map(positions, dict.fromkeys(positions, 20.0), PRESETS["default"].priors, size=150)
fig, axes = plt.subplots()
sd = uncertainty["sd_largest_rsun"]
mesh = axes.pcolormesh(sd["x"], sd["y"], sd, norm=LogNorm(), cmap="viridis_r")
fig.colorbar(mesh, label="standard deviation in the worst direction [solar radii]")
for name, (x, y, _) in positions.items():
    axes.plot(x, y, "k^")
    axes.annotate(name, (x, y), textcoords="offset points", xytext=(5, 5))
axes.plot(0, 0, "o", color="gold", markersize=10)
axes.set(xlabel="x, HEE [solar radii], to Earth", ylabel="y, HEE [solar radii], west", aspect="equal")
