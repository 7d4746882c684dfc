"""Time and memory of reading a spacecraft-day, written to the layouts of the archives."""

import tempfile
import tracemalloc
from datetime import date
from pathlib import Path

import numpy as np

from bella.simulation import archive_files
from bella.simulation.archive_days import simulate_days
from bella.spectra import open_spectra
from benchmarks.localisation import Row, seconds

RECORDS, CHANNELS = 2200, 319
SIMULATED = date(2021, 11, 20)
DAY = np.datetime64("2012-06-07T00:00:30", "ns")


def one_minute_day(folder: Path) -> Path:
    """Two spacecraft, a day of minutes each."""
    values = np.random.default_rng(1).gamma(2.0, 1.0, (1440, 367)).astype(np.float32)
    path = folder / "stereo_level2_swaves_20120607_v01.cdf"
    utc = DAY + np.arange(1440) * np.timedelta64(60, "s")
    return archive_files.write_stereo_level2(path, utc, {"ahead": values, "behind": values})


def native_day(folder: Path) -> Path:
    """One receiver with its wave angles at native cadence; noise, which does not compress."""
    random = np.random.default_rng(2)
    flux = random.gamma(2.0, 1e-20, (RECORDS, CHANNELS)).astype(np.float32)
    angles = {name: random.uniform(0.0, 180.0, flux.shape) for name in archive_files.WAVE_ANGLES}
    beside = archive_files.Beside(angles, np.cumsum(random.normal(0.0, 1e3, (RECORDS, 3)), axis=0) + 1.4e8)
    utc = DAY + np.arange(RECORDS) * np.timedelta64(38_820, "ms")
    path = folder / "sta_l3_wav_hfr_20120607_v01.cdf"
    return archive_files.write_stereo_l3(path, utc, np.linspace(125e3, 16.025e6, CHANNELS), flux, beside)


def peak_bytes(path: Path) -> int:
    """Most memory that reading a file takes at any moment, bytes."""
    tracemalloc.start()
    open_spectra(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak


def held_bytes(path: Path) -> int:
    """Size of the arrays read from a file, bytes."""
    return sum(spectrum.nbytes for spectrum in open_spectra(path))


def rows() -> list[Row]:
    """All rows of reading."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        minutes, native = one_minute_day(folder), native_day(folder)
        minutes_s = seconds(lambda: open_spectra(minutes)) / 2
        native_s = seconds(lambda: open_spectra(native))
        simulated_s = seconds(lambda: simulate_days(folder / "archive", [SIMULATED], 1))
        peak, size, held = peak_bytes(native), native.stat().st_size, held_bytes(native)
    return [
        ("read a spacecraft-day of minutes", f"{minutes_s * 1e3:.0f} ms", "300 ms"),
        (f"read a day at native cadence, {RECORDS} x {CHANNELS}, five variables", f"{native_s:.2f} s", "2 s"),
        ("its peak memory, over the size of the file", f"{peak / size:.1f}", "3"),
        ("its peak memory, over the arrays returned", f"{peak / held:.1f}", ""),
        ("simulate a day of four spacecraft, ten files", f"{simulated_s:.1f} s", "10 s"),
    ]
