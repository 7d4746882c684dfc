"""
Localise a burst from your own CSV
==================================

A table needs five columns: which spacecraft, at which frequency, when the burst arrived, the error of that time, and
what was timed (the edge). Positions of known spacecraft come with the package. The :doc:`/tutorial` explains each
column.
"""

from pathlib import Path

import bella

# %%
# Five frequencies of the burst of 2012-06-07, as you would have them in a file of your own
# (:download:`arrivals.csv </examples/arrivals.csv>`).
print(Path("arrivals.csv").read_text()[:300])

# %%
# One line localises it. The result is an object that makes tables with units, sky coordinates and plots.
source = bella.localise("arrivals.csv")
source.to_table()["frequency_mhz", "x_rsun", "y_rsun", "area68_rsun2", "flags"]

# %%
# The positions as :class:`astropy.coordinates.SkyCoord`, here turned to Stonyhurst longitude and distance.
stonyhurst = source.to_skycoord().heliographic_stonyhurst
for frequency, place in zip(source.to_table()["frequency_mhz"], stonyhurst, strict=True):
    print(f"{frequency:.2f}: longitude {place.lon.deg:6.1f} deg, distance {place.radius.to_value('R_sun'):5.1f} R_sun")

# %%
# Filled outlines hold 68 % of the probability at each frequency; ``figure.save("map.pdf")`` keeps the map. The
# positions are those of the *apparent* source: they are not corrected for scattering (:doc:`/reading-a-burst`).
figure = source.plot()
