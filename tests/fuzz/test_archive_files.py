"""Random damage to archive files: whatever happens to the bytes, a file is read or refused, and soon.

``BELLA_MUTATIONS`` is the number of damaged files to try; without it the test takes a few seconds. A damaged netCDF 4
file takes a third of a second, as a process is started for it, and the few on which the HDF5 library hangs take five.
"""

import os
import resource
import time
from pathlib import Path

import numpy as np

from bella.simulation import archive_files
from bella.spectra import open_spectra
from tests.fuzz.damage import attempt, damaged_copies
from tests.spectra import written

REAL = (
    "semp/wi_h1_wav_20100117_v01.cdf",
    "semp/stereo_level2_swaves_20100117_v01.cdf",
    "l7aler/wi_wa_rad1_l3_df_20200711_v01.cdf",
)
UTC = np.datetime64("2020-07-11T00:00:11", "ns") + np.arange(60) * np.timedelta64(16_300, "ms")
BUDGET_S, SECONDS, GROWTH_KIB = 5.0, 10.0, 600 << 10
"""SECONDS are of the processor: what hangs takes for ever, what is refused takes milliseconds."""


def written_files(folder: Path) -> list[Path]:
    """One small file of every kind that can be written."""
    day = np.datetime64("2012-06-07T00:00:30", "ns") + np.arange(1440) * np.timedelta64(60, "s")
    ones = np.ones((60, 64), dtype=np.float32)
    return [
        archive_files.write_wind_l2(
            folder / "wi_l2_wav_rad1_20200711_v01.cdf", UTC, np.geomspace(20e3, 1e6, 32), ones[:, :32]
        ),
        archive_files.write_psp_l2(
            folder / "psp_fld_l2_rfs_lfr_20200711_v03.cdf",
            UTC,
            np.geomspace(1e4, 1e6, 64),
            {"ch0_V1V2": ones, "ch1_V3V4": ones},
        ),
        written.write_solo_l2_hfr(
            folder / "solo_L2_rpw-hfr-surv_20200711_V01.cdf",
            UTC,
            np.tile(np.linspace(425, 16e3, 20), 3),
            np.repeat([1, 2, 3], 20),
            ones[:, 0],
        ),
        archive_files.write_solo_l3(
            folder / "solo_L3_rpw-hfr-surv-flux_20200711_V01.cdf",
            archive_files.Sweeps(UTC, ones),
            np.linspace(425, 16e3, 64),
            ones,
            ones * 0,
        ),
        written.write_wind_60s(
            folder / "wi_wa_rad1_l2_60s_20120607_v01.dat", day[:60], np.geomspace(20, 1e3, 32), ones[:, :32], 2
        ),
        written.write_wind_idl(folder / "wind_waves_rad1_20120607.R1", np.ones((1440, 256)), np.ones(256)),
        written.write_stereo_text(
            folder / "swaves_average_20120607_a_lfr.dat", np.geomspace(2.6, 153, 48), np.ones(48), ones[:, :48]
        ),
    ]


def general_files(folder: Path) -> list[Path]:
    """The same dynamic spectrum in every container that any instrument may use."""
    (spectrum,) = open_spectra(
        archive_files.write_wind_l2(
            folder / "wi_l2_wav_rad2_20200711_v01.cdf", UTC, np.geomspace(2e6, 13e6, 32), np.ones((60, 32))
        )
    )
    spectrum = spectrum.assign_attrs(source_files="wi_l2_wav_rad2_20200711_v01.cdf")
    packed = {"intensity": {"zlib": True, "chunksizes": (30, 32)}}
    spectrum.to_netcdf(folder / "netcdf4.nc", engine="h5netcdf", encoding=packed)
    spectrum.to_netcdf(folder / "netcdf3.nc", engine="scipy")
    spectrum.to_zarr(folder / "store.zarr", zarr_format=3)
    return [folder / name for name in ("netcdf4.nc", "netcdf3.nc", "store.zarr")]


def test_random_damage_is_read_or_refused(tmp_path: Path, reference_files: Path) -> None:
    wanted = int(os.environ.get("BELLA_MUTATIONS", "0"))
    files = [*(reference_files / name for name in REAL), *written_files(tmp_path), *general_files(tmp_path)]
    random = np.random.default_rng(20100117)
    (tmp_path / "damaged").mkdir()
    sources = [damaged_copies(path, tmp_path / "damaged", random) for path in files]
    before_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    end, tried, slowest_s = time.monotonic() + BUDGET_S, 0, 0.0
    while tried < wanted if wanted else tried < len(sources) or time.monotonic() < end:
        slowest_s = max(slowest_s, attempt(next(sources[tried % len(sources)])).seconds)
        tried += 1

    assert slowest_s < SECONDS
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kib < GROWTH_KIB
