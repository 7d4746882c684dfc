"""
Two spacecraft give a preliminary answer
========================================

Two spacecraft measure one difference of arrival times. Every source then has a mirror image. What is known of beams and
of the solar wind makes one side more probable, and the answer is a list of intervals of the longitude.
"""

import matplotlib.pyplot as plt
import numpy as np

import bella
from bella.spectra import event_spectra

both = [event_spectra()[name].to_dataset() for name in ("WIND", "STEREO-B")]
arrivals = bella.time_edges(both, "2012-06-07T19:25", edge="half_rise", frequencies=20)
track = bella.fit_track(arrivals)
for part in track.record.phi0_68:
    print(f"{part.low:.0f} to {part.high:.0f} deg with a probability of {part.probability:.2f}")
print(track.record.flags)

# %%
# The probability of each degree. Three spacecraft say 26 degrees (68 % interval 21 to 31).
probability = np.array(track.record.phi0_probability)
degrees = np.arange(-180, 180) + 0.5
fig, axes = plt.subplots()
axes.fill_between(degrees, probability)
axes.axvline(26, color="C1", label="three spacecraft")
axes.set(xlabel="longitude of the footpoint, HEE [deg]", ylabel="probability per degree", xlim=(-180, 180))
axes.legend()
