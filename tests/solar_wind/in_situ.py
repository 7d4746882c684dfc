"""Speeds measured in the weeks around the published burst."""

from pathlib import Path

import numpy as np
import pandas as pd

from bella.solar_wind import hourly_speeds

AROUND = np.datetime64("2012-06-07T19:30", "ns")
FLEET = ("WIND", "STEREO-A", "STEREO-B")
TABLE = "hourly_speed_2012-05_2012-07.csv"


def lists_of(folder: Path, reference_files: Path) -> dict[str, pd.Series]:
    """Published hourly speeds, written as the lists they come in and read back."""
    frame = pd.read_csv(reference_files / "insitu" / TABLE, parse_dates=["time_utc"])
    speeds = {}
    for name, column in zip(FLEET, ("L1_km_s", "STEREO-A_km_s", "STEREO-B_km_s"), strict=True):
        path = folder / f"{name}.lst"
        rows = zip(frame["time_utc"], frame[column].fillna(9999), strict=True)
        path.write_text("".join(f"{t.year} {t.day_of_year} {t.hour} {v:.0f}\n" for t, v in rows))
        speeds[name] = hourly_speeds(path)
    return speeds
