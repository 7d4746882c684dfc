"""The spectra of 2010-01-17, taken from the arrays of the archive files without any reader."""

from pathlib import Path

import cdflib
import numpy as np
import xarray as xr

from bella.spectra import validate_spectrum

STEREO = "semp/stereo_level2_swaves_20100117_v01.cdf"
WIND = "semp/wi_h1_wav_20100117_v01.cdf"
LOW_RECEIVER = 48


def _times(archive: cdflib.CDF) -> np.ndarray:
    return np.asarray(cdflib.cdfepoch.to_datetime(archive.varget("Epoch")), dtype="datetime64[ns]")


def _spectrum(time: np.ndarray, khz: np.ndarray, intensity: np.ndarray, **attributes: object) -> xr.Dataset:
    spectrum = xr.Dataset(
        {"intensity": (("time", "frequency"), intensity.astype(np.float32))},
        coords={"time": time, "frequency": khz.astype(np.float64) / 1000.0},
        attrs={"integration_s": 60.0, "source_files": "2010-01-17", **attributes},
    )
    return validate_spectrum(spectrum, str(attributes["observatory"]))


def stereo(folder: Path, side: str) -> xr.Dataset:
    """Side ``ahead`` or ``behind``; a missing minute is stored as minus the background."""
    archive = cdflib.CDF(folder / STEREO)
    khz, over, quiet = (archive.varget(name) for name in ("frequency", f"avg_intens_{side}", f"background_{side}"))
    kept = (np.arange(len(khz)) >= LOW_RECEIVER) | (khz < khz[LOW_RECEIVER])
    over = np.where((over < -1e30) | (over == -quiet), np.nan, over)
    return _spectrum(
        _times(archive),
        khz[kept],
        over[:, kept],
        observatory=f"STEREO-{side[0].upper()}",
        receiver="SWAVES",
        quantity="db_over_background",
    )


def wind(folder: Path, receiver: str) -> xr.Dataset:
    """Receiver RAD1 or RAD2; channels whose daily minimum is 0 were not measured."""
    archive = cdflib.CDF(folder / WIND)
    measured = archive.varget(f"Minimum_voltage_{receiver}")[0] > 0.0
    ratio = archive.varget(f"E_VOLTAGE_{receiver}")[:, measured]
    return _spectrum(
        _times(archive),
        archive.varget(f"Frequency_{receiver}")[measured],
        np.where(ratio > 0.0, ratio, np.nan),
        observatory="WIND",
        receiver=receiver,
        quantity="voltage_ratio",
    )
