"""
How well does a fleet localise a burst?
=======================================

Before an event is chosen, a map says how well the spacecraft of that day localise a source anywhere in the ecliptic.
"""

import numpy as np

from bella.multilateration import PRESETS, uncertainty_map
from bella.plotting import Figure, coverage_caption, coverage_figure
from bella.spacecraft import fleet

# %%
# The spacecraft of one day, with positions in HEE.
spacecraft = fleet(np.datetime64("2022-06-01T12:00", "ns"))
print(spacecraft[["observatory", "range_rsun", "longitude_deg"]].to_string(index=False))

# %%
# Timing errors of 20 s everywhere, and the standard deviation in the worst direction.
positions = {row.observatory: np.array([row.x_rsun, row.y_rsun, row.z_rsun]) for row in spacecraft.itertuples()}
uncertainty = uncertainty_map(positions, dict.fromkeys(positions, 20.0), PRESETS["default"].priors, size=150)
figure = Figure(coverage_figure(uncertainty), coverage_caption(uncertainty))
