"""STEREO/WAVES 1-minute averages as text."""

from pathlib import Path

import numpy as np
import xarray as xr

from bella.exceptions import InputError
from bella.spectra.assembly import Origin, assemble
from bella.spectra.bounded import reading
from bella.spectra.stereo import BY_LETTER, by_minute
from bella.spectra.wind_files import date_of

LARGEST_FILE = 64 << 20
MINUTE_WIDTH, VALUE_WIDTH = 4, 8
LOWEST_DB = -2.0
"""Nothing measured lies so far below the background: on a whole real day the lowest is -1.1 dB."""


def read_text(path: Path, receiver: str) -> tuple[xr.Dataset, ...]:
    """LFR or HFR of one spacecraft at 1 minute, dB over background.

    Not yet run on an archive file: written to the published description of the product. The file labels minutes by
    their start: half a minute is added, so that times are those of the CDF of the same data. Columns are of fixed width
    and may touch. A minute without data is minus the background, or far below zero.

    Parameters
    ----------
    path : pathlib.Path
        The file; its name states the day.
    receiver : str
        Letter of the spacecraft and receiver, such as "a_hfr".

    Returns
    -------
    tuple of xarray.Dataset
        One dynamic spectrum, quantity ``db_over_background``.

    Raises
    ------
    InputError
        If the file is damaged, of another product, or has no date in its name.
    """
    letter, band = receiver.split("_")
    midnight = date_of(path.name)
    with reading(str(path), "a table of STEREO/WAVES averages"):
        if path.stat().st_size > LARGEST_FILE:
            raise InputError(f"{path.name} is too large for one day of this product")
        first, second, *lines = path.read_text(encoding="ascii").splitlines()
        frequency_mhz = np.array(first.split(), dtype=np.float64) * 1e-3
        background = np.array(second.split(), dtype=np.float64)
        if background.size != frequency_mhz.size:
            raise ValueError(f"{frequency_mhz.size} frequencies, but {background.size} backgrounds")
        minute, decibel = _columns([line for line in lines if line.strip()], frequency_mhz.size)
    decibel[(np.abs(decibel + background) < 0.002) | (decibel < LOWEST_DB)] = np.nan
    time = midnight + (minute * 60 + 30) * np.timedelta64(10**9, "ns")
    origin = Origin(BY_LETTER[letter], band.upper(), "db_over_background", path.name)
    return (by_minute(assemble(origin, time, frequency_mhz, decibel)),)


def _columns(lines: list[str], channels: int) -> tuple[np.ndarray, np.ndarray]:
    """Minutes, shape (records,), and values, shape (records, channels)."""
    if not lines:
        raise ValueError("it has no lines of values")
    width = MINUTE_WIDTH + channels * VALUE_WIDTH
    short = next(
        (line for line in lines if len(line.rstrip()) > width or len(line.rstrip()) <= width - VALUE_WIDTH), ""
    )
    if short:
        raise ValueError(f"a line of {len(short)} characters for {channels} channels, not {width}")
    minute = np.array([int(line[:MINUTE_WIDTH]) for line in lines])
    if ((minute < 0) | (minute >= 1440)).any():
        raise ValueError("a minute outside the day")
    starts = range(MINUTE_WIDTH, width, VALUE_WIDTH)
    values = [[line[start : start + VALUE_WIDTH] for start in starts] for line in lines]
    return minute, np.array(values, dtype=np.float64)
