"""Time the assimilation of a rotation, and what is taken from its posterior."""

import numpy as np
import pandas as pd

from bella.heliosphere import spiral_position_rsun
from bella.solar_wind import Places, assimilate_wind, field_line_through, steady_wind
from bella.spacecraft import polar, position
from benchmarks.localisation import Row, seconds

FLEET = ("WIND", "STEREO-A", "STEREO-B")
AROUND = np.datetime64("2012-06-07T19:30", "ns")


def simulated_speeds() -> dict[str, pd.Series]:
    """A month of hourly speeds in a wind of two streams."""
    hours = AROUND + np.arange(-24 * 15, 24 * 15) * np.timedelta64(1, "h")
    wind = steady_wind(400 + 100 * np.sin(np.radians(np.arange(128) * 360 / 64)))
    speeds = {}
    for name in FLEET:
        range_rsun, longitude_deg, _ = polar(position(name, hours, "carrington"))
        speeds[name] = pd.Series(wind.at(range_rsun, longitude_deg), index=pd.DatetimeIndex(hours))
    return speeds


def rows() -> list[Row]:
    """All rows of the wind."""
    speeds = simulated_speeds()
    found = assimilate_wind(speeds, AROUND)
    track = spiral_position_rsun(np.linspace(30.0, 150.0, 40), 30.0, 400.0)
    assimilation_s = seconds(lambda: assimilate_wind(speeds, AROUND))
    along_s = seconds(lambda: found.speeds(Places.of_hee(track, AROUND)))
    line_s = seconds(lambda: field_line_through(found, track[20], AROUND))
    return [
        ("assimilate a rotation of three spacecraft", f"{assimilation_s:.2f} s", "5 s"),
        ("wind along a track of 40 sources, with its covariance", f"{1000 * along_s:.0f} ms", ""),
        ("field line through a source, 200 draws", f"{1000 * line_s:.0f} ms", ""),
    ]
