"""The track of a burst: one source on a Parker spiral, and what else its arrival times and positions say of it.

:func:`fit_table` is the door. `model`, `likelihood`, `posterior`, `quality` and `fit` are the headline; `preliminary`
is the answer of two spacecraft; the other modules stand beside them.
"""

from bella.tracks.burst import TrackRecipe, fit_table, track_record, with_joint_draws
from bella.tracks.fit import TrackFit, fit_track
from bella.tracks.model import TrackModel, WindPrior, measured_wind

__all__ = [
    "TrackFit",
    "TrackModel",
    "TrackRecipe",
    "WindPrior",
    "fit_table",
    "fit_track",
    "measured_wind",
    "track_record",
    "with_joint_draws",
]
