"""STEREO/WAVES: 1-minute averages of both spacecraft (level 2, text), and native cadence with directions (L3)."""

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from bella.containers import ANOTHER, CdfFile, in_mhz, reading
from bella.exceptions import InputError
from bella.spectra.assembly import Origin, assemble, date_of, shared_channels
from bella.spectra.beside import Beside, epoch_of, longest_dwell_s, read_records, timed
from bella.spectra.combination import combine_receivers
from bella.spectra.minutes import mean_time_sd_s

SPACECRAFT = {"ahead": "STEREO-A", "behind": "STEREO-B"}
BY_LETTER = {"a": "STEREO-A", "b": "STEREO-B"}
DIRECTIONS = {
    f"wave_{angle}_{frame}_deg": f"WAVE_{angle}_{frame}".upper()
    for frame in ("hee", "rtn")
    for angle in ("colatitude", "azimuth")
} | {"source_size_deg": "SOURCE_SIZE"}
HIGHEST_MHZ = {"lfr": 0.16, "hfr": 16.0}
SWEEP_S = 38.05
"""Duration of a sweep, s (Canizares et al. 2024, A&A 684, A182, doi:10.1051/0004-6361/202347747)."""

MINUTE_AVERAGES_S = 30.0
"""What a minute averages over, as far as edges are concerned, s: between one sweep, which is a snapshot in a channel,
and two, 38 s apart. Edges of simulated minutes are least biased so; taken for means of a minute they are late."""

LARGEST_TEXT = 64 << 20
MINUTE_WIDTH, VALUE_WIDTH = 4, 8
REMARKS = "#;!"
LOWEST_DB = -2.0
"""Nothing measured lies so far below the background: on a whole real day the lowest is -1.1 dB."""


def read_level2(cdf: CdfFile, receiver: str = "") -> tuple[xr.Dataset, ...]:
    """STEREO-A and STEREO-B of a day at 1 minute, dB over background.

    Run on the archive file of 2010-01-17. A minute without data is stored as minus the background, and becomes NaN.
    A minute averages one or two sweeps, which may lie anywhere in it: ``sample_time_sd_s``.
    The bands of LFR and HFR overlap at 125 to 153 kHz, where the LFR's channels are kept, as they are denser.

    Parameters
    ----------
    receiver : str
        Not used.

    Returns
    -------
    tuple of xarray.Dataset
        Quantity ``db_over_background``, shape (1440, 366) each; a spacecraft without any data is left out.

    Raises
    ------
    InputError
        If the file is not of this product, or holds no data at all.
    """
    del receiver
    time, frequency_mhz = cdf.utc(epoch_of(cdf)), cdf.frequency_mhz("frequency", "kHz", HIGHEST_MHZ["hfr"])
    spectra = tuple(
        _level2_spacecraft(cdf, name, time, frequency_mhz)
        for name in SPACECRAFT
        if cdf.has_records(f"avg_intens_{name}")
    )
    seen = tuple(one for one in spectra if np.isfinite(one["intensity"]).any())
    if not seen:
        raise InputError(f"{cdf.name} holds no data of either spacecraft; leave it out")
    return seen


def _level2_spacecraft(
    cdf: CdfFile, name: str, time: npt.NDArray[np.datetime64], frequency_mhz: np.ndarray
) -> xr.Dataset:
    decibel = cdf.numbers(f"avg_intens_{name}", 2)
    beside = Beside(cdf, decibel.shape, f"avg_intens_{name}", tuple(SPACECRAFT))
    stored = f"background_{name}"
    decibel[_without_data(decibel, beside.matrix(stored) if cdf.has_records(stored) else None)] = np.nan
    beside.clear(decibel)
    offset_s = beside.offset_s(time)
    extra = {}
    if offset_s is not None:
        time, extra["sample_time"] = timed(time, offset_s)
    frequency_mhz, decibel = shared_channels(frequency_mhz, decibel, cdf.name)
    if np.count_nonzero(np.diff(frequency_mhz) < 0.0) > 0.5 * frequency_mhz.size:
        frequency_mhz, decibel = frequency_mhz[::-1], decibel[:, ::-1]
        extra = {one: values[:, ::-1] for one, values in extra.items()}
    falls = np.flatnonzero(np.diff(frequency_mhz) < 0.0)
    bands = [slice(None, falls[0] + 1), slice(falls[0] + 1, None)] if falls.size else [slice(None)]
    receivers = ["LFR", "HFR"] if falls.size else ["LFR+HFR"]
    parts = [
        assemble(
            Origin(SPACECRAFT[name], receiver, "db_over_background", cdf.name),
            time,
            frequency_mhz[band],
            decibel[:, band],
            {one: values[:, band] for one, values in extra.items()},
        )
        for receiver, band in zip(receivers, bands, strict=True)
    ]
    whole = beside.noted(combine_receivers(*parts) if len(parts) == 2 else parts[0])
    return whole if extra else by_minute(whole)


def by_minute(spectrum: xr.Dataset) -> xr.Dataset:
    """With what averages of a minute are, and how well their times are known.

    Parameters
    ----------
    spectrum : xarray.Dataset
        1-minute averages of STEREO/WAVES.

    Returns
    -------
    xarray.Dataset
        With ``sample_time_sd_s``, 5.7 s; ``integration_s`` is 30 s.
    """
    sd_s = np.full(spectrum.sizes["frequency"], mean_time_sd_s(SWEEP_S))
    known = spectrum.assign(sample_time_sd_s=("frequency", sd_s))
    return known.assign_attrs(integration_s=MINUTE_AVERAGES_S)


def _without_data(decibel: npt.NDArray[Any], background: npt.NDArray[Any] | None) -> npt.NDArray[np.bool_]:
    """Minutes without data: minus the background, or where that is not known, far below it."""
    if background is None:
        return np.asarray(decibel < LOWEST_DB)
    background += decibel
    return np.asarray(background == 0.0)


def read_l3(cdf: CdfFile, receiver: str) -> tuple[xr.Dataset, ...]:
    """LFR or HFR of one spacecraft at native cadence, flux density with the direction it came from.

    Not yet run on an archive file: written to the published description of the product. The background is subtracted
    already, so that flux may be negative where there is none. The unit of frequency is read from the file, as manual
    and files do not agree on it. Where the file has TIMING, every sample has its own time. The HFR steps through its
    channels (Bougeret et al. 2008, Space Sci. Rev. 136, 487, doi:10.1007/s11214-007-9298-8), so that a sample takes no
    longer than the sweep over their number.

    Parameters
    ----------
    receiver : str
        Letter of the spacecraft and receiver, such as "a_hfr".

    Returns
    -------
    tuple of xarray.Dataset
        One dynamic spectrum, quantity ``flux_w_m2_hz``, with wave angles (time, frequency) and what
        :func:`bella.spectra.beside.read_records` finds.

    Raises
    ------
    InputError
        If the file is not of this product.
    """
    letter, band = receiver.split("_")
    flux, frequency_mhz = cdf.numbers("PSD_FLUX", 2), cdf.frequency_mhz("FREQUENCY", "Hz", HIGHEST_MHZ[band])
    time = cdf.utc(epoch_of(cdf, "PSD_FLUX"))
    longest_s = longest_dwell_s(time, frequency_mhz.shape[-1]) if band == "hfr" else np.inf
    origin = Origin(BY_LETTER[letter], band.upper(), "flux_w_m2_hz", cdf.name, longest_s)
    directions = {name: stored for name, stored in DIRECTIONS.items() if cdf.has_records(stored)}
    return (read_records(cdf, origin, "PSD_FLUX", time, frequency_mhz, flux, extra=directions),)


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
        if path.stat().st_size > LARGEST_TEXT:
            raise InputError(f"{path.name} is too large for one day of this product; {ANOTHER}")
        lines = path.read_text(encoding="utf-8-sig", errors="replace").splitlines()
        first, second, *lines = [line for line in lines if line.strip() and line.lstrip()[0] not in REMARKS]
        stated_khz = np.array(first.split(), dtype=np.float64)
        frequency_mhz = in_mhz(stated_khz, "khz", HIGHEST_MHZ[band], f"{path.name}: its frequency")
        background = np.array(second.split(), dtype=np.float64)
        if background.size != frequency_mhz.size:
            raise ValueError(f"{frequency_mhz.size} frequencies, but {background.size} backgrounds")
        minute, decibel = _columns(lines, frequency_mhz.size)
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
    # what did not fit into its column was written as stars
    cells = [[line[start : start + VALUE_WIDTH].replace("*", "") for start in starts] for line in lines]
    return minute, np.array([[cell if cell.strip() else "nan" for cell in row] for row in cells], dtype=np.float64)
