"""Simulated spectra to search: a day as a spacecraft records it, and what was in it."""

from collections.abc import Sequence
from datetime import date

import numpy as np
import pandas as pd
import xarray as xr

from bella.bursts.detection import detect_bursts
from bella.simulation.burst import SimulatedBurst
from bella.simulation.nuisances import Nuisance
from bella.simulation.sky import Conditions, Gain, Sky
from benchmarks.detection import FLEET, spectrum_of

DAY = date(2021, 2, 10)
IN_LINE = date(2021, 11, 20)
"""Wind, STEREO-A and Solar Orbiter are nearly on one line."""

STEADY = Gain()
GAPS = tuple[tuple[float, float], ...]


def burst_at(hour: float, day: date = DAY, **parameters: float) -> SimulatedBurst:
    """A bright broad burst that every spacecraft hears."""
    release = np.datetime64(day, "ns") + np.timedelta64(round(hour * 3600), "s")
    bright: dict[str, float] = {"f_low_mhz": 0.2, "f_high_mhz": 12.0, "contrast": 100.0, "taper": 0.3}
    return SimulatedBurst(release, **(bright | parameters))


def sky(
    bursts: Sequence[SimulatedBurst] = (),
    nuisances: tuple[Nuisance, ...] = (),
    gaps_s: GAPS = (),
    gain: Gain = STEADY,
    storm: Sequence[SimulatedBurst] = (),
) -> Sky:
    """A day on which all spacecraft have the same trouble."""
    day = bursts[0].release_utc.astype("datetime64[D]").item() if bursts else DAY
    return Sky(day, tuple(bursts), tuple(storm), dict.fromkeys(FLEET, Conditions(nuisances, gaps_s, gain)))


def recorded(observatory: str, what: Sky, day: date | None = None) -> xr.Dataset:
    """Spectrum of a spacecraft-day, by default that of the sky."""
    return spectrum_of(observatory, day or what.day, [what], 1)


def accepted(spectrum: xr.Dataset) -> pd.DataFrame:
    """Detections that are bursts."""
    table = detect_bursts(spectrum)
    return table[table["tier"] != "rejected"].reset_index(drop=True)


def starts(table: pd.DataFrame) -> list[str]:
    """Onsets to the minute, in order."""
    return sorted(table["start_utc"].dt.strftime("%H:%M"))
