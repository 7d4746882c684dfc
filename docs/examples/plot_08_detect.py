"""
Find bursts in spectra
======================

``bella.detect`` searches the spectra of each spacecraft, and decides which detections are of the same burst.
"""

from collections import Counter
from datetime import date
from pathlib import Path
from tempfile import mkdtemp

import bella
from bella.simulation.archive_days import simulate_days

# %%
# A simulated day of Wind and STEREO-A, with bursts, storms, interference and gaps.
folder = Path(mkdtemp()) / "archive"
truth = simulate_days(folder, [date(2021, 11, 21)], 7, ["WI_H1_WAV", "STEREO_LEVEL2_SWAVES"], lambda _=1: None)
found = bella.detect(sorted(folder.rglob("*.cdf")))
print(found)
print(len(truth["days"][0]["bursts"]), "bursts were simulated; some are weak, or seen by one spacecraft only")

# %%
# What each detection is good for. ``localisable`` bursts are isolated and were seen by three spacecraft; ``catalogued``
# ones are bursts that cannot be localised; ``rejected`` ones are no Type III bursts. The last two have their reason.
print(Counter(found.frame["tier"]))
found.to_table()["observatory", "start_utc", "f_low_mhz", "f_high_mhz", "tier", "reason"][:8]

# %%
figure = found.plot()
