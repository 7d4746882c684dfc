"""The stable name of a burst."""

import numpy as np
import pandas as pd

from bella.exceptions import InputError


def onset(arrivals: pd.DataFrame) -> np.datetime64:
    """Earliest arrival at the highest frequency: the moment a burst is named after.

    Parameters
    ----------
    arrivals : pandas.DataFrame
        Arrival table; needs ``frequency_mhz`` and ``arrival_utc``.

    Returns
    -------
    numpy.datetime64
        UTC, nanoseconds.

    Raises
    ------
    InputError
        If no row has an arrival time.
    """
    known = arrivals.dropna(subset=["arrival_utc"])
    if known.empty:
        raise InputError(
            "the arrival table holds no arrival time, so the burst cannot be named: add rows with arrival_utc"
        )
    highest = known.loc[known["frequency_mhz"] == known["frequency_mhz"].max(), "arrival_utc"]
    return np.datetime64(highest.min(), "ns")


def burst_id(moment: np.datetime64) -> str:
    """Name of a burst by its onset, such as ``T3-20120607-1929``.

    Parameters
    ----------
    moment : numpy.datetime64
        Onset, UTC; seconds are dropped, not rounded.

    Returns
    -------
    str
        ``T3-YYYYMMDD-HHMM``.

    Raises
    ------
    InputError
        If the onset is NaT.
    """
    if np.isnat(moment):
        raise InputError("a burst without onset has no name: give a UTC time")
    return f"T3-{pd.Timestamp(moment):%Y%m%d-%H%M}"
