"""Where the source was, from the times at which several receivers heard it.

:func:`localise` is the door. Behind it: `priors` (what is assumed), `likelihood` (emission time and speed integrated
out), `cells`, `moments`, `draws`, `regions` (the exact posterior), `nuts` (the same model in PyMC), `solution` (the
labelled result) and `flags` (what a reader must know).

:func:`uncertainty_map` says how well a fleet places a source anywhere, by `closed_form` and `exact_map`.
"""

from bella.multilateration.localise import METHODS, check_choices, localise
from bella.multilateration.priors import PRESETS
from bella.multilateration.uncertainty_map import uncertainty_map

__all__ = ["METHODS", "PRESETS", "check_choices", "localise", "uncertainty_map"]
