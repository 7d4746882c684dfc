"""Kinds of files that are read, each with a small example and its reader."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from bella.arrivals import read_arrivals, read_covariance, write_covariance
from bella.linked_events import read_event_list
from bella.simulation import archive_files
from bella.solar_wind.in_situ import hourly_speeds
from bella.solar_wind.source_regions import read_active_regions
from tests.conftest import REFERENCE_FILES
from tests.fuzz.damage import read_spectra
from tests.spectra import written

UTC = np.datetime64("2020-07-11T00:00:11", "ns") + np.arange(60) * np.timedelta64(16_300, "ms")
MINUTES = np.datetime64("2012-06-07T00:00:30", "ns") + np.arange(60) * np.timedelta64(60, "s")
ONES = np.ones((60, 64), dtype=np.float32)


@dataclass(frozen=True)
class Kind:
    """How an example of a kind of files is written, under a name in a folder, and read."""

    name: str
    write: Callable[[Path], object]
    read: Callable[[Path], object] = read_spectra

    def example(self, folder: Path) -> Path:
        self.write(folder / self.name)
        return folder / self.name


def real(name: str) -> Callable[[Path], object]:
    """A file of the reference data."""
    return lambda path: path.write_bytes((REFERENCE_FILES / name).read_bytes())


def wind_h1(path: Path) -> Path:
    channels = {"RAD1": 256, "RAD2": 256}
    ratio = {name: np.ones((60, number), dtype=np.float32) for name, number in channels.items()}
    measured = {name: np.ones(number, dtype=bool) for name, number in channels.items()}
    return archive_files.write_wind_h1(path, MINUTES, ratio, measured)


def solo_hfr(path: Path) -> Path:
    return written.write_solo_l2_hfr(
        path, UTC, np.tile(np.linspace(425, 16e3, 20), 3), np.repeat([1, 2, 3], 20), ONES[:, 0]
    )


def solo_tnr(path: Path) -> Path:
    sweep, band = np.repeat(np.arange(15), 4), np.tile([1, 2, 3, 4], 15)
    return written.write_solo_l2_tnr(path, UTC, sweep, band, ONES[:, :32])


def general() -> xr.Dataset:
    """A dynamic spectrum of any instrument."""
    return xr.Dataset(
        {"intensity": (("time", "frequency"), ONES[:, :32])},
        coords={"time": UTC, "frequency": np.geomspace(2.0, 13.0, 32)},
        attrs={"observatory": "WIND", "receiver": "RAD2", "quantity": "psd_v2_hz", "integration_s": 16.3},
    )


def packed(path: Path) -> object:
    encoding = {"intensity": {"zlib": True, "chunksizes": (30, 32)}}
    return general().to_netcdf(path, engine="h5netcdf", encoding=encoding)


ARRIVALS = """# frequency in MHz
observatory,frequency_mhz,arrival_utc,sigma_s,edge,flag
WIND,1.0,2012-06-07T19:30:00.5Z,10.0,half_rise,
STEREO-A,1.0,2012-06-07T19:31:00Z,12.5,half_rise,
STEREO-B,1.0,2012-06-07T19:32:00Z,9,half_rise,
WIND,0.5,2012-06-07T19:35:00Z,20,half_rise,
STEREO-A,0.5,2012-06-07T19:36:00Z,20,half_rise,
STEREO-B,0.5,2012-06-07T19:37:00Z,20,half_rise,
"""
SPEEDS = "".join(f"2012 {100 + hour // 24} {hour % 24} {400 + hour % 50}.\n" for hour in range(72))
FLARES = (
    '[{"begin_time": "2012-06-07T19:10:00Z", "max_time": "2012-06-07T19:25:00Z", "end_time": "2012-06-07T19:40:00Z",'
    ' "max_class": "M1.2", "satellite": 15}]'
)

KINDS = {
    "wind_h1": Kind("wi_h1_wav_20120607_v01.cdf", wind_h1),
    "wind_l2": Kind(
        "wi_l2_wav_rad1_20200711_v01.cdf",
        lambda path: archive_files.write_wind_l2(path, UTC, np.geomspace(20e3, 1e6, 32), ONES[:, :32]),
    ),
    "wind_k0": Kind(
        "wi_k0_wav_20200711_v01.cdf", lambda path: archive_files.write_wind_k0(path, UTC, np.ones((60, 76)))
    ),
    "wind_60s": Kind(
        "wi_wa_rad1_l2_60s_20120607_v01.dat",
        lambda path: written.write_wind_60s(path, MINUTES, np.geomspace(20, 1e3, 32), ONES[:, :32], 2),
    ),
    "wind_idl": Kind(
        "wind_waves_rad1_20120607.R1", lambda path: written.write_wind_idl(path, np.ones((1440, 256)), np.ones(256))
    ),
    "stereo_level2": Kind(
        "stereo_level2_swaves_20120607_v01.cdf",
        lambda path: archive_files.write_stereo_level2(path, MINUTES, {"ahead": np.ones((60, 367))}),
    ),
    "stereo_l3": Kind(
        "sta_l3_wav_hfr_20200711_v01.cdf",
        lambda path: archive_files.write_stereo_l3(path, UTC, np.linspace(125e3, 16e6, 64), ONES),
    ),
    "stereo_text": Kind(
        "swaves_average_20120607_a_lfr.dat",
        lambda path: written.write_stereo_text(path, np.geomspace(2.6, 153, 48), np.ones(48), ONES[:, :48]),
    ),
    "psp_l2": Kind(
        "psp_fld_l2_rfs_lfr_20200711_v03.cdf",
        lambda path: archive_files.write_psp_l2(
            path, UTC, np.geomspace(1e4, 1e6, 64), {"ch0_V1V2": ONES, "ch1_V3V4": ONES}
        ),
    ),
    "psp_l3": Kind(
        "psp_fld_l3_rfs_lfr_20200711_v03.cdf",
        lambda path: written.write_psp_l3(path, UTC, np.geomspace(1e4, 1e6, 64), ONES),
    ),
    "solo_hfr": Kind("solo_L2_rpw-hfr-surv_20200711_V01.cdf", solo_hfr),
    "solo_tnr": Kind("solo_L2_rpw-tnr-surv_20200711_V01.cdf", solo_tnr),
    "solo_l3": Kind(
        "solo_L3_rpw-hfr-surv-flux_20200711_V01.cdf",
        lambda path: archive_files.write_solo_l3(
            path, archive_files.Sweeps(UTC, ONES), np.linspace(425, 16e3, 64), ONES, ONES * 0
        ),
    ),
    "netcdf4": Kind("netcdf4.nc", packed),
    "netcdf3": Kind("netcdf3.nc", lambda path: general().to_netcdf(path, engine="scipy")),
    "zarr2": Kind("two.zarr", lambda path: general().to_zarr(path, zarr_format=2)),
    "zarr3": Kind("three.zarr", lambda path: general().to_zarr(path, zarr_format=3, consolidated=False)),
    "arrivals": Kind("arrivals.csv", lambda path: path.write_text(ARRIVALS), read_arrivals),
    "covariance": Kind(
        "covariance.nc", lambda path: write_covariance(np.eye(6), path), lambda path: read_covariance(path, 6)
    ),
    "speeds": Kind("wind_2012.lst", lambda path: path.write_text(SPEEDS), hourly_speeds),
    "flares": Kind("flares.json", lambda path: path.write_text(FLARES), read_event_list),
    "real_wind_h1": Kind("wi_h1_wav_20100117_v01.cdf", real("semp/wi_h1_wav_20100117_v01.cdf")),
    "real_stereo_level2": Kind(
        "stereo_level2_swaves_20100117_v01.cdf", real("semp/stereo_level2_swaves_20100117_v01.cdf")
    ),
    "real_wind_l3": Kind("wi_wa_rad1_l3_df_20200711_v01.cdf", real("l7aler/wi_wa_rad1_l3_df_20200711_v01.cdf")),
    "real_regions": Kind("20020624SRS.txt", real("../cases/real/srs/20020624SRS.txt"), read_active_regions),
    "real_omni": Kind(
        "omni_coho1hr_merged_mag_plasma_20240901_v01.cdf",
        real("../cases/real/insitu/omni_coho1hr_merged_mag_plasma_20240901_v01.cdf"),
        hourly_speeds,
    ),
}
