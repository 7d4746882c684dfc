"""Damaged, cut and mistaken files end in one line that names file and reason, quickly and in little memory."""

import bz2
import gzip
import lzma
import re
import struct
import sys
import zlib
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Literal

import h5py
import numpy as np
import pytest
import xarray as xr

from bella.containers import READER, check_hdf5
from bella.exceptions import InputError
from bella.simulation import archive_files
from bella.spectra import open_spectra
from tests.fuzz.damage import attempt
from tests.spectra import test_cdf_variants as cdf_variants
from tests.spectra import written

UTC = np.datetime64("2020-07-11T00:00:11", "ns") + np.arange(60) * np.timedelta64(16_300, "ms")
WIND_L2 = "wi_l2_wav_rad1_20200711_v01.cdf"
SECONDS, PEAK_BYTES = 10.0, 64 << 20
"""Of the processor: what hangs takes for ever, what is refused takes milliseconds."""


@pytest.fixture
def wind_l2(tmp_path: Path) -> Path:
    return archive_files.write_wind_l2(
        tmp_path / WIND_L2, UTC, np.geomspace(20e3, 1040e3, 32), np.ones((60, 32)) * 1e-15
    )


@pytest.fixture
def deep() -> Iterator[None]:
    """The recursion limit of a process in which PyTensor was imported."""
    limit = sys.getrecursionlimit()
    sys.setrecursionlimit(10_000)
    yield
    sys.setrecursionlimit(limit)


def number(content: bytearray, offset: int) -> int:
    return int(struct.unpack_from(">q", content, offset)[0])


def first_variable(content: bytearray) -> int:
    return number(content, number(content, 20) + 20)


def claim_all_records(content: bytearray) -> None:
    struct.pack_into(">i", content, first_variable(content) + 24, 2**31 - 2)


def claim_one_more_record(content: bytearray) -> None:
    struct.pack_into(">i", content, first_variable(content) + 24, len(UTC))


def claim_a_huge_descriptor(content: bytearray) -> None:
    struct.pack_into(">q", content, first_variable(content), 2**40)


def claim_a_negative_descriptor(content: bytearray) -> None:
    struct.pack_into(">q", content, first_variable(content), -1)


def let_variables_run_in_a_circle(content: bytearray) -> None:
    struct.pack_into(">i", content, number(content, 20) + 60, 2**31 - 1)
    struct.pack_into(">q", content, first_variable(content) + 12, first_variable(content))


def let_the_index_point_at_itself(content: bytearray) -> None:
    index = number(content, first_variable(content) + 28)
    struct.pack_into(">q", content, index + 12, index)


def claim_endless_attributes(content: bytearray) -> None:
    struct.pack_into(">i", content, number(content, 20) + 48, 2**31 - 1)


def claim_dimensions_of_the_file(content: bytearray) -> None:
    struct.pack_into(">i", content, number(content, 20) + 56, 2**31 - 1)


def claim_dimensions_of_a_variable(content: bytearray) -> None:
    struct.pack_into(">i", content, first_variable(content) + 340, 2**31 - 1)


def claim_a_long_pad(content: bytearray) -> None:
    struct.pack_into(">i", content, first_variable(content) + 64, 2**31 - 1)


def point_beyond_the_end(content: bytearray) -> None:
    struct.pack_into(">q", content, number(content, 20) + 20, len(content) + 1000)


@pytest.mark.parametrize(
    "damage",
    [
        claim_all_records,
        claim_one_more_record,
        claim_a_huge_descriptor,
        claim_a_negative_descriptor,
        let_variables_run_in_a_circle,
        let_the_index_point_at_itself,
        claim_endless_attributes,
        claim_dimensions_of_the_file,
        claim_dimensions_of_a_variable,
        claim_a_long_pad,
        point_beyond_the_end,
    ],
)
def test_lies_about_sizes_are_found_out(
    wind_l2: Path, damage: Callable[[bytearray], None], deep: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bella.containers.bounded.LEAST_CPU_S", 1)  # on some of them the library hangs
    content = bytearray(wind_l2.read_bytes())
    damage(content)
    wind_l2.write_bytes(content)

    outcome = attempt(wind_l2, memory=True)

    assert outcome.message.startswith((str(wind_l2), wind_l2.name))
    assert outcome.message.endswith(("download it again", "take another version of the file"))
    assert "\n" not in outcome.message
    assert outcome.seconds < SECONDS
    assert outcome.peak_bytes < PEAK_BYTES


@pytest.mark.parametrize("records", [90_000, 200_000, 8_388_668])
def test_a_flag_that_claims_more_than_the_file_can_hold_is_left_out(tmp_path: Path, records: int) -> None:
    ones = np.ones((60, 64), dtype=np.float32)
    path = archive_files.write_solo_l3(
        tmp_path / "solo_L3_rpw-hfr-surv-flux_20200711_V01.cdf",
        archive_files.Sweeps(UTC, ones),
        np.linspace(425, 16e3, 64),
        ones,
        ones * 0,
    )
    content = bytearray(path.read_bytes())
    descriptor = content.index(b"INTERPOL_FLAG".ljust(256, b"\0")) - 84
    struct.pack_into(">i", content, descriptor + 24, records - 1)
    path.write_bytes(content)

    (read,) = open_spectra(path)

    assert read.attrs["left_out"] == "INTERPOL_FLAG"
    assert attempt(path, memory=True).peak_bytes < PEAK_BYTES


def test_records_that_are_not_stored_are_made_up_to_a_limit(tmp_path: Path) -> None:
    path = cdf_variants.original(tmp_path, "wi_l2")
    contents = cdf_variants.contents_of(path)
    stored = contents["PSD_V2_SP"]
    utc = np.datetime64("2020-07-11", "ns") + np.arange(200_000) * np.timedelta64(400, "ms")
    contents["Epoch"] = replace(contents["Epoch"], values=archive_files.tt2000(utc))
    sparse = {"Dim_Sizes": list(stored.values.shape[1:]), "Sparse": "pad_sparse"}
    contents["PSD_V2_SP"] = replace(stored, spec=sparse, written=[0, 2, 5])
    contents = {name: one for name, one in contents.items() if name in {"Epoch", "FREQUENCY", "PSD_V2_SP"}}
    path = cdf_variants.write(tmp_path / "wi_l2_wav_rad1_20200711_v01.cdf", contents)

    outcome = attempt(path, memory=True)

    assert "but there are 200000 times" in outcome.message
    assert outcome.peak_bytes < PEAK_BYTES


@pytest.mark.parametrize("share", [0.0, 0.001, 0.01, 0.3, 0.7, 0.99])
def test_a_file_cut_short_is_refused(wind_l2: Path, share: float) -> None:
    content = wind_l2.read_bytes()
    wind_l2.write_bytes(content[: int(share * len(content))])

    with pytest.raises(InputError, match=WIND_L2):
        open_spectra(wind_l2)


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        (WIND_L2, b"", "is empty"),
        (WIND_L2, b"<!DOCTYPE html><html>404</html>", "is a web page"),
        (WIND_L2, b"\n<html><body>", "is a web page"),
        (WIND_L2, b"Lorem ipsum dolor", "is named after Wind/WAVES L2, but is not a CDF"),
        ("notes.txt", b"Lorem ipsum dolor", "is of no known product: see 'bella formats'"),
        ("x.nc", b"\x89HDF\r\n\x1a\n" + bytes(200), "cannot be read as netCDF"),
        ("x.nc", b"CDF\x01" + b"\xff" * 200, "cannot be read as netCDF"),
        ("wind_waves_rad1_20120607.R1", b"SR\x00\x04" + bytes(64), "records run in a circle"),
        ("wind_waves_rad1_20120607.R1", b"SR\x00\x04\x00\x00\x00\x02\x7f\xff\xff\xff" + bytes(64), "ends early"),
        ("wind_waves_rad1_20120607.R1", b"no save set", "but is not an IDL save set"),
        ("wi_wa_rad1_l2_60s_20120607_v01.dat", b"\x7f\xff\xff\xff" + bytes(60), "the record at byte 0"),
        ("wi_wa_rad1_l2_60s_20120607_v01.dat", bytes(3), "cannot be read"),
        ("swaves_average_20120607_a_lfr.dat", b"125.0 175.0\n6.0\n", "2 frequencies, but 1 backgrounds"),
        ("swaves_average_20120607_a_lfr.dat", b"125.0\n6.0\n   0   x.xxx\n", "cannot be read"),
        ("swaves_average_20120607_a_lfr.dat", b"125.0\n6.0\n", "has no lines"),
        ("swaves_average_20129907_a_lfr.dat", b"125.0\n6.0\n", "does not say of which day"),
        ("swaves_average_20120607_a_lfr.dat", b"\xff\xfe\x00" * 40, "cannot be read"),
    ],
)
def test_what_is_no_archive_file_is_refused(tmp_path: Path, name: str, content: bytes, reason: str) -> None:
    (tmp_path / name).write_bytes(content)

    with pytest.raises(InputError, match=reason) as refused:
        open_spectra(tmp_path / name)

    assert name in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_file_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no file and no Zarr group"):
        open_spectra(tmp_path / "gone.cdf")


def test_a_missing_variable_is_named(tmp_path: Path) -> None:
    path = archive_files.write_cdf(
        tmp_path / WIND_L2, WIND_L2, [("Epoch", archive_files.TT2000, archive_files.tt2000(UTC), True, {})]
    )

    with pytest.raises(InputError, match=r"has no variable 'FREQUENCY'"):
        open_spectra(path)


@pytest.mark.parametrize(("records", "channels"), [(59, 32), (60, 33)])
def test_shapes_that_do_not_fit_are_refused(tmp_path: Path, records: int, channels: int) -> None:
    path = tmp_path / "sta_l3_wav_hfr_20200711_v01.cdf"
    frequency_hz = np.linspace(125e3, 16e6, 32)
    archive_files.write_stereo_l3(path, UTC, frequency_hz, np.ones((records, channels), dtype=np.float32))

    with pytest.raises(InputError, match=r"shape \(\d+, \d+\), but there are 60 times and 32 frequencies"):
        open_spectra(path)


def test_a_file_of_unknown_identity_under_a_known_name_is_refused(tmp_path: Path) -> None:
    path = tmp_path / WIND_L2
    variables: list[archive_files.Variable] = [("Epoch", archive_files.TT2000, archive_files.tt2000(UTC), True, {})]
    archive_files.write_cdf(path, "ac_h0_mfi_20200711_v01", variables)

    with pytest.raises(InputError, match="it is not Wind/WAVES L2 as its name says"):
        open_spectra(path)


def test_a_whole_compressed_file_is_read(wind_l2: Path) -> None:
    content = wind_l2.read_bytes()
    packed = gzip.compress(content[8:])
    record = struct.pack(">qiqqi", 32 + len(packed), 10, 0, len(content) - 8, 0) + packed
    wind_l2.write_bytes(b"\xcd\xf3\x00\x01\xcc\xcc\x00\x01" + record)

    assert open_spectra(wind_l2)[0].sizes == {"time": 60, "frequency": 32}


@pytest.mark.parametrize("offset", [48, 52, 56, 72, 76])
def test_a_save_set_that_claims_too_much_is_refused(tmp_path: Path, offset: int) -> None:
    path = written.write_wind_idl(tmp_path / "wind_waves_rad1_20120607.R1", np.ones((1440, 256)), np.ones(256))
    content = bytearray(path.read_bytes())
    struct.pack_into(">i", content, offset, 2**30)
    path.write_bytes(content)

    outcome = attempt(path, memory=True)

    assert outcome.message
    assert outcome.peak_bytes < PEAK_BYTES


def test_a_compressed_save_set_is_not_blown_up(tmp_path: Path) -> None:
    packed = zlib.compress(bytes(80 << 20))
    path = tmp_path / "wind_waves_rad1_20120607.R1"
    path.write_bytes(b"SR\x00\x06" + struct.pack(">4I", 2, 20 + len(packed), 0, 0) + packed)

    assert "holds more than" in attempt(path).message


def test_a_file_that_may_not_be_read_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")

    (tmp_path / WIND_L2).write_bytes(b"x")
    monkeypatch.setattr(Path, "open", refuse)

    with pytest.raises(InputError, match=r"cannot be opened .Permission denied.: check who may read it"):
        open_spectra(tmp_path / WIND_L2)


def test_a_file_packed_with_gzip_is_read(wind_l2: Path) -> None:
    packed = wind_l2.with_name(wind_l2.name + ".gz")
    packed.write_bytes(gzip.compress(wind_l2.read_bytes()))

    (read,) = open_spectra(packed)

    assert read.equals(open_spectra(wind_l2)[0].assign_coords())
    packed.write_bytes(gzip.compress(packed.read_bytes()))
    assert open_spectra(packed)[0].equals(read)
    packed.write_bytes(packed.read_bytes()[:-100])
    assert "cannot be read as CDF" in attempt(packed).message


def test_times_that_a_file_claims_take_little_more_memory_than_their_own(wind_l2: Path) -> None:
    content, claimed = bytearray(wind_l2.read_bytes()), 7_000_000
    struct.pack_into(">i", content, first_variable(content) + 24, claimed - 1)
    wind_l2.write_bytes(content)

    refused = attempt(wind_l2, memory=True)

    assert f"{claimed} times" in refused.message
    assert refused.peak_bytes < 3.5 * 8 * claimed


@pytest.mark.parametrize(
    ("name", "pack", "said"),
    [
        ("wi_wa_rad1_l2_60s_20120607_v01.dat.gz", gzip.compress, "is packed with gzip: unpack it with gunzip"),
        ("mine.nc.bz2", bz2.compress, "is packed with bzip2: unpack it with bunzip2"),
        ("mine.nc.xz", lzma.compress, "is packed with xz: unpack it with unxz"),
        ("mine.zarr.zip", lambda content: b"PK\x03\x04" + content, "is packed with zip: unpack it with unzip"),
        ("mine.npz", lambda content: b"PK\x03\x04" + content, "holds arrays of NumPy: write them to netCDF"),
    ],
)
def test_what_is_packed_and_no_cdf_says_how_to_unpack(
    tmp_path: Path, name: str, pack: Callable[[bytes], bytes], said: str
) -> None:
    path = tmp_path / name
    path.write_bytes(pack(b"x" * 100))

    assert f"{path} {said}" in attempt(path).message


def test_the_process_that_reads_is_started_anew_after_a_crash(wind_l2: Path) -> None:
    open_spectra(wind_l2)
    READER.stop()

    assert open_spectra(wind_l2)[0].sizes["time"] == 60


def test_a_cdf_of_another_product_under_the_name_of_a_binary_is_refused(wind_l2: Path) -> None:
    other = wind_l2.rename(wind_l2.with_name("wi_wa_rad1_l2_60s_20120607_v01.dat"))

    with pytest.raises(InputError, match=r"named after Wind/WAVES 60 s, but holds Wind/WAVES L2 rad1"):
        open_spectra(other)


@pytest.fixture
def general(wind_l2: Path) -> xr.Dataset:
    return open_spectra(wind_l2)[0]


def test_a_file_on_which_the_hdf5_library_hangs_is_refused(tmp_path: Path, general: xr.Dataset) -> None:
    path = tmp_path / "hangs.nc"
    general.to_netcdf(path, engine="h5netcdf")
    content = bytearray(path.read_bytes())
    heap = content.index(b"GCOL")
    struct.pack_into("<q", content, heap + 24, -16)  # size of an object, with which the next begins where it does
    path.write_bytes(content)

    with pytest.raises(ValueError, match="hangs or crashes on it"):
        check_hdf5(path, cpu_s=1)


def test_hdf5_that_claims_too_much_is_refused(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "large.nc", "w") as file:
        file.create_dataset("intensity", shape=(10**6, 10**6), chunks=(10, 10), dtype="f4")

    outcome = attempt(tmp_path / "large.nc", memory=True)

    assert "variable 'intensity' claims 4000000000000 bytes" in outcome.message
    assert outcome.peak_bytes < PEAK_BYTES


def test_hdf5_of_large_chunks_is_refused(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "chunks.nc", "w") as file:
        file.create_dataset("intensity", shape=(2, 2), maxshape=(None, None), chunks=(10**4, 10**4), dtype="f4")

    assert "claims 400000000 bytes" in attempt(tmp_path / "chunks.nc").message


@pytest.mark.parametrize("key", ["shape", "chunk_shape"])
def test_zarr_that_claims_too_much_is_refused(tmp_path: Path, general: xr.Dataset, key: str) -> None:
    path = tmp_path / "large.zarr"
    general.to_zarr(path, zarr_format=3, consolidated=False)
    described = path / "intensity" / "zarr.json"
    content = re.sub(rf'"{key}": \[[^]]*\]', f'"{key}": [1000000, 1000000]', described.read_text())
    assert content != described.read_text()
    described.write_text(content)

    outcome = attempt(path, memory=True)

    assert outcome.message.startswith(str(path))
    assert "\n" not in outcome.message
    assert outcome.peak_bytes < PEAK_BYTES


def test_zarr_of_endless_descriptions_is_refused(tmp_path: Path, general: xr.Dataset) -> None:
    path = tmp_path / "wordy.zarr"
    general.assign_attrs(history="x" * (2 << 20)).to_zarr(path, zarr_format=3)

    assert "zarr.json has more than 1 MiB" in attempt(path).message


@pytest.mark.parametrize("engine", ["h5netcdf", "scipy"])
@pytest.mark.parametrize("share", [0.1, 0.6, 0.95])
def test_netcdf_cut_short_is_refused(
    tmp_path: Path, general: xr.Dataset, engine: Literal["h5netcdf", "scipy"], share: float
) -> None:
    path = tmp_path / "cut.nc"
    general.assign_attrs(source_files="a.cdf").to_netcdf(path, engine=engine)
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])

    assert attempt(path).message.startswith(f"{path} cannot be read as netCDF or Zarr")


def test_chunks_that_lie_about_their_length_do_no_harm(tmp_path: Path, general: xr.Dataset) -> None:
    path = tmp_path / "lies.zarr"
    general.to_zarr(path, zarr_format=2, consolidated=False)
    chunk = path / "intensity" / "0.0"
    whole = chunk.read_bytes()
    random, outcomes = np.random.default_rng(1), []
    for unpacked, block, packed in random.choice([0, 1, 2**12, 2**20, 2**27, 2**31 - 1, 2**32 - 1], (60, 3)):
        chunk.write_bytes(whole[:4] + struct.pack("<3I", unpacked, block, packed) + whole[16:])
        outcomes.append(attempt(path))
    chunk.write_bytes(whole)

    assert not any(one.read for one in outcomes)
    assert attempt(path).read


def test_no_store_is_opened_in_this_process(
    tmp_path: Path, general: xr.Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A codec that crashes on a damaged chunk must not take the service with it."""
    path = tmp_path / "mine.zarr"
    general.to_zarr(path, consolidated=False)

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("opened in this process")

    for name in ("open_datatree", "open_dataset", "open_zarr"):
        monkeypatch.setattr(xr, name, refuse)
    monkeypatch.setattr("zarr.open_group", refuse)
    assert open_spectra(path)[0]["intensity"].notnull().any()
