"""The edge of one light curve: when the burst rises, how sure that is, or why nothing is known."""

import math
from typing import NamedTuple

NO_SAMPLES, NO_SIGNAL, NO_FLANK, NO_DECAY, GAP = "no_samples", "no_signal", "no_flank", "no_decay", "gap_in_flank"
SATURATED, EDGES_DISAGREE = "saturated", "edges_disagree"
FIT_FAILED, PEAK_OUTSIDE = "fit_failed", "peak_outside"
"""Why a channel has no edge; what each means stands in :data:`bella.flags.EDGE_FLAGS`."""


class Edge(NamedTuple):
    """Where a light curve rises."""

    arrival_s: float
    """Seconds on the time axis of the light curve; NaN without an edge."""
    sigma_s: float
    """Standard deviation, s; NaN without an edge."""
    flag: str
    """Empty, or why there is no edge."""


def no_edge(reason: str) -> Edge:
    """Edge of a light curve that has none.

    Parameters
    ----------
    reason : str
        A name of :data:`bella.flags.EDGE_FLAGS`.

    Returns
    -------
    Edge
        Time and standard deviation NaN.
    """
    return Edge(math.nan, math.nan, reason)
