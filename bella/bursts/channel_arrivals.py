"""Arrival table from the edges of the channels themselves, whose errors are independent of one another.

Read at forty frequencies, a curve t(f) gives forty times that share the errors of its three or five terms.
"""

import numpy as np
import pandas as pd

from bella.arrivals import check_arrivals
from bella.bursts.time_evolution import SIGMA_FLOOR, TimeEvolution
from bella.bursts.timing import HIGHEST_MHZ, LOWEST_MHZ, TimedBurst
from bella.bursts.widths import rise_half_width_s
from bella.units import FloatArray

MOST_ROWS = 120
"""Of one table: 40 channels of each of three spacecraft."""

OUTLIER_SD = 4.0
"""An edge so many errors away from t(f) of its spacecraft is not one of the burst."""

MEDIAN_TO_SD = 1.4826
"""Standard deviation of a Gaussian over the median of its absolute values."""


def channel_arrivals(timed: TimedBurst, most: int = MOST_ROWS) -> pd.DataFrame:
    """Arrival table with the edges of the channels in the band in which sources are placed.

    Parameters
    ----------
    timed : TimedBurst
    most : int
        Rows there may be; each spacecraft keeps an equal share of them, evenly spread in logarithm of frequency.

    Returns
    -------
    pandas.DataFrame
        As :func:`bella.arrivals.check_arrivals` returns it, without the outliers; ``sigma_s`` is that of the edge, but
        at least a tenth of the half width of the rise, and larger where the edges of a spacecraft scatter by more about
        its t(f), as those of a burst of several parts do; ``offset_sd_s`` what all channels of the spacecraft share.

    Raises
    ------
    InputError
        If fewer than three spacecraft have an edge there.
    """
    known = timed.edges[(timed.edges["flag"] == "") & timed.edges["arrival_utc"].notna()]
    band = known[known["frequency_mhz"].between(LOWEST_MHZ, HIGHEST_MHZ)]
    share = most // max(len(timed.evolutions), 1)
    parts = [band.head(0)]
    for name, curve in timed.evolutions.items():
        rows = _trusted(band[band["observatory"] == name], curve, timed.reference_utc)
        parts.append(_spread(rows, share).assign(offset_sd_s=timed.offsets_s[name]))
    return check_arrivals(pd.concat(parts, ignore_index=True), source="edges of the channels")


def _trusted(rows: pd.DataFrame, curve: TimeEvolution, reference_utc: np.datetime64) -> pd.DataFrame:
    """Edges that are not far from the curve, with errors that are not too small."""
    frequency_mhz = rows["frequency_mhz"].to_numpy(dtype=np.float64)
    floor_s = SIGMA_FLOOR * np.array([rise_half_width_s(one) for one in frequency_mhz])
    sigma_s: FloatArray = np.maximum(rows["sigma_s"].to_numpy(dtype=np.float64), floor_s)
    arrival_s = (rows["arrival_utc"].to_numpy() - reference_utc) / np.timedelta64(1, "s")
    away = np.abs(arrival_s - curve.arrival_s(frequency_mhz)) / sigma_s
    scatter = max(1.0, MEDIAN_TO_SD * float(np.median(away))) if away.size else 1.0
    return rows.assign(sigma_s=scatter * sigma_s)[away <= OUTLIER_SD * scatter]


def _spread(rows: pd.DataFrame, most: int) -> pd.DataFrame:
    """Rows evenly spread in logarithm of frequency, of which there are no more than a number."""
    if len(rows) <= most:
        return rows
    log = np.log(rows["frequency_mhz"].to_numpy(dtype=np.float64))
    wanted = np.linspace(log.min(), log.max(), most)
    return rows.iloc[np.unique(np.abs(log[:, None] - wanted).argmin(axis=0))]
