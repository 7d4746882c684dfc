"""The spectra of 2020-07-21 by Wind, STEREO-A and PSP, as arrays: a day with a labelled burst and several more."""

from pathlib import Path

import numpy as np
import xarray as xr

from bella.spectra import combine_receivers, validate_spectrum
from bella.spectra.minutes import with_sweeps, with_visits
from bella.spectra.stereo import by_minute


def wind(folder: Path) -> xr.Dataset:
    """Both receivers, ratios of voltages by the minute; without what was interpolated, as the reader has it."""
    rad1, rad2 = (_spectrum(folder, f"windrad{one}", "WIND", "voltage_ratio", 60.0) for one in (1, 2))
    return combine_receivers(with_visits(rad1), with_sweeps(rad2))


def wind_as_archived(folder: Path) -> xr.Dataset:
    """The same with what was interpolated, which these arrays do not flag."""
    return combine_receivers(*(_spectrum(folder, f"windrad{one}", "WIND", "voltage_ratio", 60.0) for one in (1, 2)))


def stereo_a(folder: Path) -> xr.Dataset:
    """The high receiver, dB by the minute."""
    return by_minute(_spectrum(folder, "stereoa", "STEREO-A", "db_over_background", 60.0))


def psp(folder: Path) -> xr.Dataset:
    """Both receivers, power every 56 s."""
    parts = [_spectrum(folder, f"psp{one}", "PSP", "psd_v2_hz", 28.0) for one in ("lfr", "hfr")]
    return combine_receivers(*parts)


def _spectrum(folder: Path, name: str, observatory: str, quantity: str, integration_s: float) -> xr.Dataset:
    with np.load(folder / f"semp/{name}_20200721.npz") as arrays:
        time, mhz, values = (arrays[key] for key in ("time_unix_ms", "freq_mhz", "intensity"))
    values = np.where(values > 0.0, values, np.nan)  # what is not above zero is no data
    spectrum = xr.Dataset(
        {"intensity": (("time", "frequency"), values.T.astype(np.float32))},
        coords={"time": time.astype("datetime64[ms]").astype("datetime64[ns]"), "frequency": mhz.astype(np.float64)},
        attrs={
            "observatory": observatory,
            "receiver": name,
            "quantity": quantity,
            "integration_s": integration_s,
            "source_files": "2020-07-21",
        },
    )
    return validate_spectrum(spectrum, observatory)
