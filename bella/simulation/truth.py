"""What was simulated, in a form that can be written beside it as JSON."""

from collections.abc import Sequence
from dataclasses import asdict
from datetime import date
from typing import Any

import numpy as np

from bella.simulation.burst import SimulatedBurst, arrival_s, contrast_at, source_range_rsun
from bella.simulation.sky import Conditions, Sky

TRUTH_FREQUENCIES = 24
"""So many frequencies of every burst have their true arrival times, evenly spaced in ln f."""


def day_truth(sky: Sky, observatories: Sequence[str]) -> dict[str, Any]:
    """What was to be heard on a day.

    Parameters
    ----------
    sky : Sky
    observatories : sequence of str
        Whose arrival times are wanted; the ephemeris knows them on that day.

    Returns
    -------
    dict
        ``day``, ``bursts`` (parameters, and for each spacecraft peak over background and half-rise time at
        ``frequency_mhz``), ``storm_bursts``, and ``conditions`` by spacecraft: nuisances, gaps, gain.
    """
    return {
        "day": sky.day.isoformat(),
        "bursts": [burst_truth(burst, observatories) for burst in sky.bursts],
        "storm_bursts": [{"release_utc": _stamp(one.release_utc), "phi0_deg": one.phi0_deg} for one in sky.storm],
        "conditions": {name: _conditions(sky.day, sky.conditions[name]) for name in observatories},
    }


def burst_truth(burst: SimulatedBurst, observatories: Sequence[str]) -> dict[str, Any]:
    """Parameters of a burst, and when and how bright each spacecraft hears it.

    Parameters
    ----------
    burst : SimulatedBurst
    observatories : sequence of str

    Returns
    -------
    dict
    """
    # a hair inside the band, whose ends rounding may leave outside
    ends = (burst.f_low_mhz * (1 + 1e-9), burst.f_high_mhz * (1 - 1e-9))
    frequency_mhz = np.geomspace(*ends, TRUTH_FREQUENCIES)
    parameters = {name: value for name, value in asdict(burst).items() if name != "release_utc"}
    if not np.isfinite(burst.directivity):
        parameters["directivity"] = None  # JSON has no infinity
    return {
        "release_utc": _stamp(burst.release_utc),
        **parameters,
        "frequency_mhz": frequency_mhz.tolist(),
        "source_range_rsun": source_range_rsun(burst, frequency_mhz).tolist(),
        "heard": {name: _heard(burst, frequency_mhz, name) for name in observatories},
    }


def _heard(burst: SimulatedBurst, frequency_mhz: np.ndarray, observatory: str) -> dict[str, Any]:
    after_s = arrival_s(burst, frequency_mhz, observatory)
    utc = burst.release_utc + np.rint(after_s * 1e9).astype("timedelta64[ns]")
    return {
        "peak_over_background": contrast_at(burst, frequency_mhz, observatory).tolist(),
        "half_rise_utc": [_stamp(moment) for moment in utc],
    }


def _conditions(day: date, conditions: Conditions) -> dict[str, Any]:
    return {
        "nuisances": [
            {
                "kind": one.kind,
                "start_utc": _after(day, one.start_s),
                "stop_utc": _after(day, one.stop_s),
                "low_mhz": float(one.band_mhz[0]),
                "high_mhz": float(one.band_mhz[1]),
            }
            for one in conditions.nuisances
        ],
        "gaps_utc": [[_after(day, float(end)) for end in gap] for gap in conditions.gaps_s],
        "gain": asdict(conditions.gain),
    }


def _after(day: date, seconds: float) -> str:
    return _stamp(np.datetime64(day, "ns") + np.timedelta64(int(seconds * 1e9), "ns"))


def _stamp(moment: np.datetime64) -> str:
    return f"{np.datetime_as_string(moment.astype('datetime64[ns]'), unit='ms')}Z"
