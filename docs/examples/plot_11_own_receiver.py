"""
Spectra of your own receiver
============================

A receiver that this package does not read comes in as an :class:`xarray.Dataset` with two axes and a few attributes.
Its position may stand in the dataset, for a spacecraft that the ephemeris does not have.
"""

import numpy as np
import xarray as xr

import bella
from bella.simulation.strata import isolated_burst
from bella.spacecraft import position_hee
from bella.spectra import validate_spectrum
from bella.units import R_SUN_KM

# %%
# Stand-in for your data: an array of flux, times and frequencies of Parker Solar Probe, under another name.
case = isolated_burst("clean", "2021", 17)
raw = case.spectra["PSP"]
flux, times, frequencies = raw["intensity"].to_numpy(), raw["time"].to_numpy(), raw["frequency"].to_numpy()
place_km = position_hee("PSP", case.burst.release_utc, case.burst.release_utc)[0] * R_SUN_KM

# %%
# The dataset: a spacecraft, a receiver, what is measured, and where the spacecraft was.
mine = xr.Dataset(
    {
        "intensity": (("time", "frequency"), flux.astype(np.float32)),
        "position_km": (("time", "axis"), np.tile(place_km, (len(times), 1)), {"frame": "hee"}),
    },
    coords={"time": times, "frequency": frequencies},
    attrs={
        "observatory": "My Spacecraft",
        "receiver": "RX1",
        "quantity": "psd_v2_hz",
        "integration_s": 28.0,
        "source_files": "mine",
    },
)
validate_spectrum(mine, "my spectrum")

# %%
# It is used as any other spectrum is.
print(bella.detect(mine))
others = [case.spectra[name] for name in ("WIND", "STEREO-A", "SOLO")]
arrivals = bella.time_edges([mine, *others], case.around_utc, frequencies=10)
print(arrivals)
figure = arrivals.plot()
