"""What was simulated, in a form that can be written beside it as JSON and read back."""

from collections.abc import Sequence
from dataclasses import asdict
from datetime import date
from typing import Any

import numpy as np

from bella.simulation.burst import (
    SimulatedBurst,
    arrival_s,
    contrast_at,
    light_arrival_s,
    mean_beam_speed_c,
    source_position_rsun,
)
from bella.simulation.sky import Conditions, Sky

TRUTH_FREQUENCIES = 24
"""So many frequencies of every burst have their true arrival times, evenly spaced in ln f."""


def day_truth(sky: Sky, observatories: Sequence[str]) -> dict[str, Any]:
    """What was to be received on a day.

    Parameters
    ----------
    observatories : sequence of str
        Whose arrival times are wanted; the ephemeris knows them on that day.

    Returns
    -------
    dict
        ``day``, ``bursts`` (:func:`burst_truth`), ``storm_bursts``, and ``conditions`` by spacecraft: nuisances, gaps,
        gain, and the rest.
    """
    return {
        "day": sky.day.isoformat(),
        "bursts": [burst_truth(burst, observatories) for burst in sky.bursts],
        "storm_bursts": [{"release_utc": _stamp(one.release_utc), "phi0_deg": one.phi0_deg} for one in sky.storm],
        "conditions": {name: _conditions(sky.day, sky.conditions[name]) for name in observatories},
    }


def burst_truth(burst: SimulatedBurst, observatories: Sequence[str]) -> dict[str, Any]:
    """Parameters of a burst, and when and how bright each spacecraft receives it.

    Returns
    -------
    dict
        The parameters, of which :func:`burst_of` makes the burst again; and at ``frequency_mhz`` the position of the
        main component (``position_rsun``, HEE), and for each spacecraft under ``received`` peak over background, time
        of the half-rise of the true light curve, and time at which light alone would have arrived.
    """
    # a hair inside the band, whose ends rounding may leave outside
    ends = (burst.f_low_mhz * (1 + 1e-9), burst.f_high_mhz * (1 - 1e-9))
    frequency_mhz = np.geomspace(*ends, TRUTH_FREQUENCIES)
    position = source_position_rsun(burst, frequency_mhz)
    return {
        **_finite(asdict(burst) | {"release_utc": _stamp(burst.release_utc, "ns")}),
        "mean_beam_speed_c": mean_beam_speed_c(burst, frequency_mhz),
        "frequency_mhz": frequency_mhz.tolist(),
        "source_range_rsun": np.linalg.norm(position, axis=1).tolist(),
        "position_rsun": position.tolist(),
        "received": {name: _received(burst, frequency_mhz, name) for name in observatories},
    }


def _received(burst: SimulatedBurst, frequency_mhz: np.ndarray, observatory: str) -> dict[str, Any]:
    half_rise_s = arrival_s(burst, frequency_mhz, observatory)
    light_s = light_arrival_s(burst, frequency_mhz, observatory)
    return {
        "peak_over_background": contrast_at(burst, frequency_mhz, observatory).tolist(),
        "half_rise_utc": [_later(burst, after_s) for after_s in half_rise_s],
        "light_utc": [_later(burst, after_s) for after_s in light_s],
    }


def _later(burst: SimulatedBurst, after_s: float) -> str:
    return _stamp(burst.release_utc + np.timedelta64(round(after_s * 1e9), "ns"))


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
        "clip": conditions.clip if np.isfinite(conditions.clip) else None,
        "lowest_mhz": conditions.lowest_mhz,
        "fast_from_utc": _after(day, conditions.fast_from_s) if np.isfinite(conditions.fast_from_s) else None,
    }


def _finite(values: dict[str, Any]) -> dict[str, Any]:
    """The same with None for infinity, which JSON does not have."""
    return {
        name: _finite(value) if isinstance(value, dict) else None if value == np.inf else value
        for name, value in values.items()
    }


def _after(day: date, seconds: float) -> str:
    return _stamp(np.datetime64(day, "ns") + np.timedelta64(int(seconds * 1e9), "ns"))


def _stamp(moment: np.datetime64, unit: str = "ms") -> str:
    return f"{moment.astype(f'datetime64[{unit}]')}Z"
