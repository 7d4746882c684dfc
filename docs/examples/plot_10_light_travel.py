"""
Spectra shifted by the light travel time
========================================

Each spectrum is drawn earlier by the time that light takes from the Sun to that spacecraft. What differences are left
say where the source was: it was nearer to the spacecraft where the burst is early.
"""

import numpy as np

from bella.plotting import Figure, SpectraView, spectra_caption, spectra_figure
from bella.spacecraft import light_time_s
from bella.spectra import event_spectra

when = np.datetime64("2012-06-07T19:30", "ns")
spectra = event_spectra()
light_s = {name: light_time_s(name, when, [0.0, 0.0, 0.0]).item() for name in spectra.children}
for name, seconds in light_s.items():
    print(f"{name}: {seconds:.0f} s earlier")

# %%
# Half an hour, given as seconds since 1970. ``figure.save("spectra.pdf")`` keeps what is drawn.
begin_s = np.datetime64("2012-06-07T19:15", "s").astype(float)
shifts_s = {name: -seconds for name, seconds in light_s.items()}
look = SpectraView("sun", shifts_s, span_s=(begin_s, begin_s + 1800.0), band_mhz=(0.12, 2.0))
figure = Figure(spectra_figure(spectra, {}, look), spectra_caption("sun"))
