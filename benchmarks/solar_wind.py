"""Time the assimilation of a rotation and the wind through it, and the same march in plain Python loops."""

import math
import time

import numpy as np
import pandas as pd

from bella.solar_wind import InnerBoundary, assimilate_wind, steady_wind, upwind_wind
from bella.solar_wind.steady import ACCELERATION
from bella.solar_wind.upwind import UPWIND_STEP_RSUN, _marched
from bella.spacecraft import position
from bella.units import R_SUN_KM
from benchmarks.localisation import Row, seconds

FLEET = ("WIND", "STEREO-A", "STEREO-B")
AROUND = np.datetime64("2012-06-07T19:30", "ns")
ROTATION_D = 27.27
START = AROUND - np.timedelta64(round(0.5 * ROTATION_D * 86_400), "s")
PLAIN_STEPS, PLAIN_LONGITUDES, CELLS = 20, 16, 141


def simulated_speeds() -> dict[str, pd.Series]:
    """A month of hourly speeds in a wind of two streams."""
    hours = AROUND + np.arange(-24 * 15, 24 * 15) * np.timedelta64(1, "h")
    wind = steady_wind(400 + 100 * np.sin(np.radians(np.arange(128) * 360 / 64)))
    speeds = {}
    for name in FLEET:
        place = position(name, hours, "carrington")
        longitude = np.degrees(np.arctan2(place[:, 1], place[:, 0]))
        values = wind.at(np.linalg.norm(place, axis=1), longitude)
        speeds[name] = pd.Series(values, index=pd.DatetimeIndex(hours))
    return speeds


def plain_march(inflow: list[list[float]], range_rsun: list[float], step_s: float) -> list[list[float]]:
    """The scheme of the upwind wind, cell by cell."""
    ratio = step_s / (UPWIND_STEP_RSUN * R_SUN_KM)
    gain = [1 + ACCELERATION * (1 - math.exp(-(r - 30.0) / 50.0)) for r in range_rsun]
    state = [[speed * g / gain[0] for speed in inflow[0]] for g in gain]
    for boundary in inflow[1:]:
        before = [list(row) for row in state]
        for i in range(1, len(range_rsun)):
            for k in range(len(boundary)):
                here, inner = before[i][k], before[i - 1][k]
                state[i][k] += ratio * (here * (inner - here) + inner**2 * (gain[i] / gain[i - 1] - 1))
        state[0] = list(boundary)
    return state


def cell_step_ratio() -> float:
    """Time of one cell and step in loops over that of the arrays at full size."""
    grid, random = 30.0 + UPWIND_STEP_RSUN * np.arange(CELLS), np.random.default_rng(1)
    wide = random.uniform(300.0, 600.0, (401, 128))
    narrow = wide[: PLAIN_STEPS + 1, :PLAIN_LONGITUDES]
    begin = time.perf_counter()
    plain = plain_march(narrow.tolist(), grid.tolist(), 900.0)
    plain_s = (time.perf_counter() - begin) / (PLAIN_STEPS * PLAIN_LONGITUDES)
    arrays_s = seconds(lambda: _marched(wide, grid, 900.0, 0, 400)) / (400 * 128)
    assert np.allclose(plain, _marched(narrow, grid, 900.0, 0, PLAIN_STEPS)[-1])
    return plain_s / arrays_s


def rows() -> list[Row]:
    """All rows of the wind."""
    speeds = simulated_speeds()
    boundary = InnerBoundary(assimilate_wind(speeds, AROUND).boundary_km_s[None], np.array([AROUND]))
    assimilation_s = seconds(lambda: assimilate_wind(speeds, AROUND))
    march_s = seconds(lambda: upwind_wind(boundary, START, ROTATION_D))
    return [
        ("assimilate a rotation of three spacecraft", f"{assimilation_s:.2f} s", ""),
        (f"upwind wind of {ROTATION_D:g} days, 141 x 128", f"{march_s:.2f} s", ""),
        ("both together", f"{assimilation_s + march_s:.2f} s", "5 s"),
        ("a cell and step in Python loops, over that in arrays", f"{cell_step_ratio():.0f}", ""),
    ]
