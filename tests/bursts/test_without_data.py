"""A file whose every value is missing cannot be searched, whichever product it is of, and is never "no burst"."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from bella.bursts.association import detect_in_fleet
from bella.simulation import archive_files as af
from bella.spectra import fleet_pieces, open_spectra
from tests.spectra import written

UTC = np.datetime64("2020-07-11T00:00:30", "ns") + np.arange(480) * np.timedelta64(180, "s")
HZ = np.linspace(425e3, 16e6, 64)
NONE = np.full((UTC.size, HZ.size), np.nan, dtype=np.float32)
RECEIVERS = {"RAD1": 256, "RAD2": 256, "TNR": 96}


def empty_h1(path: Path) -> Path:
    ratio = {name: np.full((UTC.size, size), np.nan, dtype=np.float32) for name, size in RECEIVERS.items()}
    return af.write_wind_h1(path, UTC, ratio, {name: np.ones(size, dtype=bool) for name, size in RECEIVERS.items()})


def empty_netcdf(path: Path) -> Path:
    xr.Dataset(
        {"intensity": (("time", "frequency"), NONE)},
        coords={"time": UTC, "frequency": HZ / 1e6},
        attrs={"observatory": "MEX", "receiver": "MARSIS", "quantity": "flux_w_m2_hz"},
    ).to_netcdf(path, engine="h5netcdf")
    return path


WRITERS: dict[str, Callable[[Path], Path]] = {
    "wi_k0_wav_20200711_v01.cdf": lambda path: af.write_wind_k0(path, UTC, np.full((UTC.size, 76), np.nan)),
    "wi_h1_wav_20200711_v01.cdf": empty_h1,
    "wi_l2_wav_rad2_20200711_v01.cdf": lambda path: af.write_wind_l2(path, UTC, HZ * 0.8, NONE),
    "sta_l3_wav_hfr_20200711_v01.cdf": lambda path: af.write_stereo_l3(path, UTC, HZ, NONE),
    "psp_fld_l2_rfs_hfr_20200711_v03.cdf": lambda path: af.write_psp_l2(
        path, UTC, HZ * 1.2, {"ch0_V1V2": NONE, "ch1_V3V4": NONE}
    ),
    "psp_fld_l3_rfs_hfr_20200711_v01.cdf": lambda path: written.write_psp_l3(path, UTC, HZ * 1.2, NONE),
    "solo_L3_rpw-hfr-surv-flux_20200711_V01.cdf": lambda path: af.write_solo_l3(
        path, af.Sweeps(UTC, np.ones_like(NONE)), HZ / 1e3, NONE, np.zeros_like(NONE)
    ),
    "mex.nc": empty_netcdf,
}


@pytest.mark.parametrize("name", WRITERS)
def test_a_file_of_missing_values_is_not_searchable(tmp_path: Path, name: str) -> None:
    pieces, unfit = fleet_pieces(open_spectra(WRITERS[name](tmp_path / name)))

    found = detect_in_fleet(pieces)

    assert unfit == ()
    assert (found.searched, len(found.table)) == (0, 0)
    (reason,) = found.not_searchable
    assert f"({name}): it holds no data, every value is missing; give a file of another receiver" in reason


def test_a_dipole_of_missing_values_stands_aside_for_the_other(tmp_path: Path) -> None:
    power = np.ones_like(NONE)
    dipoles = {"ch0_V1V2": NONE, "ch1_V3V4": power}

    (read,) = open_spectra(af.write_psp_l2(tmp_path / "psp_fld_l2_rfs_hfr_20200711_v03.cdf", UTC, HZ * 1.2, dipoles))

    assert read.attrs["dipoles"] == "V3V4"
    assert np.isfinite(read["intensity"]).all()
