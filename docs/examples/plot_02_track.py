"""
Fit a Parker spiral to all frequencies
======================================

One source moves outward along one Parker spiral. ``fit_track`` fits longitude, solar wind and beam to the arrival times
of all frequencies together, with the errors that the frequencies share.
"""

import matplotlib.pyplot as plt

import bella
from bella.spectra import event_spectra

# %%
# Arrival times from the spectra of 2012-06-07 that come with the package.
arrivals = bella.time_edges(event_spectra(), "2012-06-07T19:25", frequencies=25)
times = arrivals.plot()

# %%
# The fit, its numbers with 68 % intervals, and what a reader should know before using them.
track = bella.fit_track(arrivals, draws=1000)
print(track)
print(track.record.flags)
track.to_table()["phi0_deg", "phi0_low_deg", "phi0_high_deg", "v_sw_km_s", "v_sw_low_km_s", "v_sw_high_km_s"]

# %%
# The source at each frequency on that spiral, and the wedges that hold 68 and 95 % of the spirals.
figure = track.plot()

# %%
# ``v_sw_not_constrained`` says that the wind was *not measured*: its interval is about as wide as that of the prior.
# The contraction says the same as a number (posterior width over prior width, 1 means "no information").
for name in ("phi0_deg", "v_sw_km_s"):
    print(f"{name:10s} contraction {getattr(track.record, name).contraction:.2f}")

# %%
# Longitude and wind depend on each other: a slower wind winds the spiral up more.
draws = track.posterior["joint_draws"]
fig, axes = plt.subplots()
axes.plot(draws.sel(joint_parameter="phi0_deg"), draws.sel(joint_parameter="v_sw_km_s"), ".", markersize=2)
axes.set(xlabel="longitude of the footpoint, HEE [deg]", ylabel="solar wind [km/s]", ylim=(0, 1500))
