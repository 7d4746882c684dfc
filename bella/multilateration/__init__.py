"""Where the source was, from the times at which several spacecraft received it.

:func:`localise` is the door. Behind it, from prior to report: `priors` (what is assumed, and from where on a flag is
raised), `problems` (arrival times and their noise), `likelihood` (emission time, speed and directional delay integrated
out), `speed`, `cells` (space divided), `posterior` (moments, evidence and draws), `regions` (credible regions and
modes), `checks` (clocks, predictions, flags) and `localise` (the labelled result).

Other methods behind the same door: `nuts` (the same model in PyMC, the reference), and `tdoa` with `tdoa_fit` (time
differences). :func:`uncertainty_map` says how well a fleet places a source anywhere.
"""

from bella.multilateration.localise import METHODS, check_choices, localise
from bella.multilateration.priors import PRESETS
from bella.multilateration.uncertainty_map import uncertainty_map

__all__ = ["METHODS", "PRESETS", "check_choices", "localise", "uncertainty_map"]
