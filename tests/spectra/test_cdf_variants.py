"""The same data as archives may write them: every product, in ways that CDF and ISTP allow, is read alike."""

import gzip
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import cdflib
import numpy as np
import pytest
import xarray as xr
from cdflib.cdfwrite import CDF

from bella.exceptions import InputError
from bella.simulation import archive_files as af
from bella.spectra import open_spectra, sample_times
from tests.spectra import written

SECOND = np.timedelta64(10**9, "ns")
RECORDS, CHANNELS = 120, 24
UTC = np.datetime64("2020-07-11T00:00:30", "ns") + np.arange(RECORDS) * 60 * SECOND
RANDOM = np.random.default_rng(2020)
EPOCHS = (31, 33)
EPOCH16, REAL8 = 32, 45


@dataclass(frozen=True)
class Stored:
    """A variable of a CDF."""

    kind: int
    values: Any
    varies: bool
    attributes: dict[str, Any] = field(default_factory=dict)
    spec: dict[str, Any] = field(default_factory=dict)
    written: list[int] | None = None
    """Records that are stored, of a sparse variable."""


Contents = dict[str, Stored]


def contents_of(path: Path) -> Contents:
    """What a file holds, for writing it anew."""
    file = cdflib.CDF(str(path))
    found = {}
    for name in file.cdf_info().zVariables:
        about = file.varinq(name)
        attributes = {key: np.asarray(value)[()] for key, value in file.varattsget(name).items()}
        attributes = {
            key: value.item() if isinstance(value, np.generic) else value for key, value in attributes.items()
        }
        found[name] = Stored(about.Data_Type, np.asarray(file.varget(name)), bool(about.Rec_Vary), attributes)
    return found


def write(path: Path, contents: Contents, **spec: Any) -> Path:
    path.unlink(missing_ok=True)
    contents, as_pairs = {**contents}, [name for name, one in contents.items() if one.kind == EPOCH16 and not one.spec]
    for name in as_pairs:
        pairs = np.stack([contents[name].values.real, contents[name].values.imag], axis=1)
        contents[name] = replace(contents[name], kind=REAL8, values=pairs, attributes={})
    file = CDF(str(path), cdf_spec={"Compressed": 0, **spec})
    file.write_globalattrs({"Logical_file_id": {0: path.stem}})
    for name, one in contents.items():
        values = np.asarray(one.values)
        shape = values.shape[1:] if one.varies else values.shape
        about = {"Variable": name, "Data_Type": one.kind, "Num_Elements": 1, "Rec_Vary": one.varies, "Compress": 0}
        about |= one.spec or {"Dim_Sizes": list(shape)}
        attributes = dict(one.attributes)
        if one.kind == af.REAL4 and "FILLVAL" in attributes:
            attributes["FILLVAL"] = np.float32(attributes["FILLVAL"])
        data = values if one.written is None else [one.written, values[one.written]]
        file.write_var(about, var_attrs=attributes, var_data=data)
    file.close()
    for name in as_pairs:
        call_epoch16(path, name)
    return path


def call_epoch16(path: Path, name: str) -> None:
    """Make the type of a variable, written as pairs of numbers, CDF_EPOCH16, which cdflib cannot write.

    Places are those of a zVDR (CDF Internal Format Description, 2.6): type, no pad value, no dimensions.
    """
    content = bytearray(path.read_bytes())
    place = content.index(name.encode().ljust(256, b"\0"))
    for offset, value in ((-64, EPOCH16), (-40, 1), (256, 0)):
        struct.pack_into(">i", content, place + offset, value)
    path.write_bytes(content)


def changed(contents: Contents, like: Callable[[str, Stored], bool], how: Callable[[Stored], Stored]) -> Contents:
    return {name: how(one) if like(name, one) else one for name, one in contents.items()}


def is_record(_: str, one: Stored) -> bool:
    return one.varies and len(one.values) == RECORDS


def is_epoch(name: str, one: Stored) -> bool:
    return is_record(name, one) and one.kind in EPOCHS


def is_frequency(name: str, _: Stored) -> bool:
    return "freq" in name.lower() and "epoch" not in name.lower()


def is_intensity(name: str, one: Stored) -> bool:
    return is_record(name, one) and one.values.ndim == 2 and one.kind == af.REAL4 and not is_frequency(name, one)


def ordered(index: Any) -> Callable[[Contents], Contents]:
    return lambda contents: changed(contents, is_record, lambda one: replace(one, values=one.values[index]))


def in_unit(unit: str, per_hz: float) -> Callable[[Contents], Contents]:
    """Frequencies in another unit."""

    def convert(one: Stored) -> Stored:
        in_hz = {"Hz": 1.0, "kHz": 1e3}[one.attributes["UNITS"]] * one.values.astype(np.float64)
        converted = np.where(one.values < -1e30, -1e31, in_hz * per_hz)
        return replace(one, kind=af.REAL8, values=converted, attributes={"UNITS": unit, "FILLVAL": -1e31})

    return lambda contents: changed(contents, is_frequency, convert)


def each_record(factor: np.ndarray) -> Callable[[Contents], Contents]:
    """A list of frequencies of its own for every record."""

    def spread(one: Stored) -> Stored:
        if one.varies:
            return one
        rows = np.where(one.values < -1e30, -1e31, one.values.astype(np.float64) * factor)
        attributes = one.attributes | {"FILLVAL": -1e31}
        return replace(one, kind=af.REAL8, values=np.ascontiguousarray(rows), varies=True, attributes=attributes)

    return lambda contents: changed(contents, is_frequency, spread)


def other_unit_than_stated(contents: Contents) -> Contents:
    other = {"Hz": "kHz", "kHz": "Hz"}
    return changed(
        contents,
        is_frequency,
        lambda one: replace(one, attributes=one.attributes | {"UNITS": other[one.attributes["UNITS"]]}),
    )


def as_cdf_epoch(contents: Contents) -> Contents:
    def convert(one: Stored) -> Stored:
        utc = cdflib.cdfepoch.to_datetime(one.values).astype("datetime64[ns]")
        return replace(one, kind=af.EPOCH, values=af.cdf_epoch(utc), attributes={})

    return changed(contents, is_epoch, convert)


def as_cdf_epoch16(contents: Contents) -> Contents:
    """Seconds and picoseconds, which cdflib reads and writes as complex numbers."""

    def convert(one: Stored) -> Stored:
        utc = cdflib.cdfepoch.to_datetime(one.values).astype("datetime64[ns]")
        second = utc.astype("datetime64[s]")
        seconds = af.cdf_epoch(second.astype("datetime64[ns]")) / 1e3
        picoseconds = (utc - second).astype(np.int64) * 1e3
        return replace(one, kind=EPOCH16, values=seconds + 1j * picoseconds, attributes={"FILLVAL": -1e31 - 1e31j})

    return changed(contents, is_epoch, convert)


def as_cdflib_writes_epoch16(contents: Contents) -> Contents:
    """Two records of each time, one of seconds and one of picoseconds."""
    return {
        name: replace(one, spec={"Dim_Sizes": []}) if one.kind == EPOCH16 else one
        for name, one in as_cdf_epoch16(contents).items()
    }


def renamed_epoch(contents: Contents) -> Contents:
    """The epoch by another name, which only DEPEND_0 states, or nothing does."""
    return {("Time_Tags" if name == "Epoch" else name): one for name, one in contents.items()}


def twins(contents: Contents) -> Contents:
    """A record twice, first without data."""
    index = np.insert(np.arange(RECORDS), 50, 50)
    doubled = changed(contents, is_record, lambda one: replace(one, values=one.values[index]))

    def without_data(one: Stored) -> Stored:
        values = one.values.copy()
        values[50] = -1e31
        return replace(one, values=values)

    return {name: without_data(one) if is_intensity(name, contents[name]) else one for name, one in doubled.items()}


def as_r_variables(contents: Contents) -> Contents:
    """All that has one value or one row of channels for each record; the others stay."""

    def convert(one: Stored) -> Stored:
        if one.values.ndim > 1 and one.values.shape[1] != ROW[0]:
            return one
        return replace(one, spec={"Var_Type": "rVariable", "Dim_Vary": [one.values.ndim > 1]})

    rows = {one.values.shape[1] for name, one in contents.items() if is_intensity(name, one)}
    ROW[0] = max(rows)
    return changed(contents, is_record, convert)


ROW = [0]
SAME: dict[str, Callable[[Contents], Contents]] = {
    "reversed": ordered(slice(None, None, -1)),
    "shuffled": ordered(RANDOM.permutation(RECORDS)),
    "twins": twins,
    "CDF_EPOCH": as_cdf_epoch,
    "CDF_EPOCH16": as_cdf_epoch16,
    "CDF_EPOCH16 of cdflib": as_cdflib_writes_epoch16,
    "epoch renamed": renamed_epoch,
    "lower case": lambda contents: {name.lower(): one for name, one in contents.items()},
    "blanks": lambda contents: {f"{name} ": one for name, one in contents.items()},
    "kHz": in_unit("kHz", 1e-3),
    "Hertz": in_unit("Hertz", 1.0),
    "[MHz]": in_unit("[MHz]", 1e-6),
    "no unit that is known": in_unit("furlong", 1e-3),
    "unit of another": other_unit_than_stated,
    "frequencies of records": each_record(np.ones((RECORDS, 1))),
    "frequencies that move": each_record(1.0 + 1e-5 * (np.arange(RECORDS) % 2 - 0.5)[:, None]),
    "one record of frequencies": lambda contents: changed(
        contents,
        lambda name, one: is_frequency(name, one) and not one.varies,
        lambda one: replace(one, values=one.values[None], varies=True),
    ),
    "float64": lambda contents: changed(
        contents,
        is_intensity,
        lambda one: replace(
            one, kind=af.REAL8, values=one.values.astype(np.float64), attributes=one.attributes | {"FILLVAL": -1e31}
        ),
    ),
    "last axis of one": lambda contents: changed(
        contents, is_intensity, lambda one: replace(one, values=one.values[..., None])
    ),
}


def original(folder: Path, name: str) -> Path:
    """A small file of a product."""
    values = RANDOM.gamma(20.0, 1e-17, (RECORDS, CHANNELS))
    decibel = RANDOM.normal(0.0, 0.5, (RECORDS, 367))
    path = folder / name
    by_name: dict[str, Callable[[], Path]] = {
        "wi_l2": lambda: af.write_wind_l2(path, UTC, np.geomspace(20e3, 1.04e6, CHANNELS), values),
        "wi_k0": lambda: af.write_wind_k0(path, UTC, decibel[:, :76]),
        "sta": lambda: af.write_stereo_l3(path, UTC, np.linspace(125e3, 16e6, CHANNELS), values),
        "stereo": lambda: af.write_stereo_level2(path, UTC, {"ahead": decibel, "behind": decibel + 0.25}),
        "solo": lambda: af.write_solo_l3(
            path, af.Sweeps(UTC, values * 1e15), np.linspace(425, 16e3, CHANNELS), values, values * 0
        ),
        "psp": lambda: af.write_psp_l2(
            path, UTC, np.geomspace(1.3e6, 19e6, CHANNELS), {"ch0_V1V2": values, "ch1_V3V4": 2 * values}
        ),
    }
    return by_name[next(one for one in by_name if name.lower().startswith(one))]()


NAMES = (
    "wi_l2_wav_rad1_20200711_v01.cdf",
    "wi_k0_wav_20200711_v01.cdf",
    "sta_l3_wav_hfr_20200711_v01.cdf",
    "stereo_level2_swaves_20200711_v01.cdf",
    "solo_L3_rpw-hfr-surv-flux_20200711_V01.cdf",
    "psp_fld_l2_rfs_hfr_20200711_v03.cdf",
)


def alike(read: tuple[xr.Dataset, ...], expected: tuple[xr.Dataset, ...]) -> Iterator[tuple[xr.Dataset, xr.Dataset]]:
    assert [one.attrs["observatory"] for one in read] == [one.attrs["observatory"] for one in expected]
    for one, other in zip(read, expected, strict=True):
        late_s = (one["time"].to_numpy() - other["time"].to_numpy()) / SECOND
        np.testing.assert_allclose(late_s, 0.0, atol=1e-3)
        np.testing.assert_allclose(one["frequency"], other["frequency"], rtol=1e-5)
        yield one, other


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("change", SAME.values(), ids=SAME.keys())
def test_ways_to_write_the_same_file(tmp_path: Path, name: str, change: Callable[[Contents], Contents]) -> None:
    path = original(tmp_path, name)
    expected, contents = open_spectra(path), contents_of(path)

    for one, other in alike(open_spectra(write(path, change(contents))), expected):
        np.testing.assert_allclose(one["intensity"], other["intensity"], rtol=1e-5)
        assert one.attrs.get("left_out") == other.attrs.get("left_out")


def packed_by_runs(path: Path) -> None:
    """Compress a whole CDF by runs of zeros, as CDF's own tools do."""
    content = path.read_bytes()
    packed = bytearray()
    place = 8
    while place < len(content):
        run = 0
        while run < 256 and place + run < len(content) and content[place + run] == 0:
            run += 1
        packed += bytes([0, run - 1]) if run else content[place : place + 1]
        place += max(run, 1)
    head = struct.pack(">qiqqi", 32 + len(packed), 10, 40 + len(packed), len(content) - 8, 0)
    parameters = struct.pack(">qiiiii", 28, 11, 1, 0, 1, 0)
    path.write_bytes(b"\xcd\xf3\x00\x01\xcc\xcc\x00\x01" + head + bytes(packed) + parameters)


def packed_with_gzip(path: Path) -> None:
    path.write_bytes(gzip.compress(path.read_bytes()))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("pack", [packed_by_runs, packed_with_gzip])
def test_packed_as_a_whole(tmp_path: Path, name: str, pack: Callable[[Path], None]) -> None:
    path = original(tmp_path, name)
    expected = open_spectra(path)
    write(path, contents_of(path))
    pack(path)

    for one, other in alike(open_spectra(path), expected):
        np.testing.assert_array_equal(one["intensity"], other["intensity"])


@pytest.mark.parametrize("name", NAMES)
def test_r_variables(tmp_path: Path, name: str) -> None:
    path = original(tmp_path, name)
    expected = open_spectra(path)
    contents = as_r_variables(contents_of(path))

    for one, other in alike(open_spectra(write(path, contents, rDim_sizes=[ROW[0]])), expected):
        np.testing.assert_array_equal(one["intensity"], other["intensity"])


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("last", [True, False])
def test_records_that_are_not_stored_are_no_data(tmp_path: Path, name: str, last: bool) -> None:
    """Also the last ones, and every channel of them."""
    path = original(tmp_path, name)
    expected, contents = open_spectra(path), contents_of(path)
    kept = [record for record in range(RECORDS) if record % 7 != 3 and (not last or record < RECORDS - 3)]
    sparse = changed(
        contents,
        lambda name, one: is_intensity(name, one) and not name.startswith("ELAPSED"),
        lambda one: replace(one, spec={"Dim_Sizes": list(one.values.shape[1:]), "Sparse": "pad_sparse"}, written=kept),
    )

    for one, other in alike(open_spectra(write(path, sparse)), expected):
        np.testing.assert_array_equal(np.isnan(one["intensity"]).all("frequency"), ~np.isin(np.arange(RECORDS), kept))
        np.testing.assert_allclose(one["intensity"][kept], other["intensity"][kept], rtol=1e-5)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("days", [366, -366, 1, -3, -49_710])
def test_times_of_another_day_are_refused(tmp_path: Path, name: str, days: int) -> None:
    path = original(tmp_path, name)
    moved = changed(
        as_cdf_epoch(contents_of(path)), is_epoch, lambda one: replace(one, values=one.values + days * 86_400_000.0)
    )

    with pytest.raises(InputError, match=r"clock") as refused:
        open_spectra(write(path, moved))

    assert name in str(refused.value)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("hours", [9, -9])
def test_one_record_whose_clock_jumped_is_left_out(tmp_path: Path, name: str, hours: int) -> None:
    path = original(tmp_path, name)
    (expected, *_), contents = open_spectra(path), as_cdf_epoch(contents_of(path))

    def jump(one: Stored) -> Stored:
        values = one.values.copy()
        values[60] += hours * 3_600_000.0
        return replace(one, values=values)

    read, *_ = open_spectra(write(path, changed(contents, is_epoch, jump)))

    np.testing.assert_allclose((read["time"] - np.delete(expected["time"].to_numpy(), 60)) / SECOND, 0.0, atol=1e-3)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("write_as", [as_cdf_epoch16, as_cdflib_writes_epoch16])
def test_records_with_a_fill_value_of_epoch16_are_left_out(
    tmp_path: Path, name: str, write_as: Callable[[Contents], Contents]
) -> None:
    path = original(tmp_path, name)
    (expected, *_), contents = open_spectra(path), write_as(contents_of(path))

    def filled(one: Stored) -> Stored:
        values = one.values.copy()
        values[60] = -1e31 - 1e31j
        return replace(one, values=values)

    changed_epoch = changed(contents, lambda _, one: one.kind == EPOCH16, filled)
    read, *_ = open_spectra(write(path, changed_epoch))

    np.testing.assert_array_equal(read["time"], np.delete(expected["time"].to_numpy(), 60))


UNSTATED = [("wi_k0", 9999.0), ("wi_k0", 99999.0), *((name[:5], fill) for name in NAMES for fill in (-999.0, -9999.0))]


@pytest.mark.parametrize(("product", "fill"), UNSTATED)
def test_fill_values_that_no_file_states_are_no_data(tmp_path: Path, product: str, fill: float) -> None:
    path = original(tmp_path, next(name for name in NAMES if name.startswith(product)))
    contents = contents_of(path)

    def filled(one: Stored) -> Stored:
        values = one.values.copy()
        values[40:50] = fill
        return replace(one, values=values)

    for one in open_spectra(write(path, changed(contents, is_intensity, filled))):
        np.testing.assert_array_equal(
            np.isnan(one["intensity"]).all("frequency"), (np.arange(RECORDS) >= 40) & (np.arange(RECORDS) < 50)
        )
        assert (np.abs(sample_times(one) - UTC[:, None]) < SECOND).all()  # offsets of samples are filled, too


@pytest.mark.parametrize("name", [NAMES[0], NAMES[2], NAMES[4], NAMES[5]])
@pytest.mark.parametrize(
    ("unit", "factor"), [("uV^2/Hz", 1e-12), ("nV**2 Hz-1", 1e-18), ("sfu", 1e-22), ("[Jy]", 1e-26)]
)
def test_intensity_is_converted_from_the_unit_that_is_stated(
    tmp_path: Path, name: str, unit: str, factor: float
) -> None:
    path = original(tmp_path, name)
    expected, contents = open_spectra(path), contents_of(path)
    is_flux = expected[0].attrs["quantity"] == "flux_w_m2_hz"
    by = factor if is_flux == (unit in {"sfu", "[Jy]"}) else 1.0

    def convert(one: Stored) -> Stored:
        return replace(one, values=one.values / np.float32(by), attributes=one.attributes | {"UNITS": unit})

    contents = changed(contents, lambda key, one: is_intensity(key, one) and not key.startswith("ELAPSED"), convert)
    for one, other in alike(open_spectra(write(path, contents)), expected):
        np.testing.assert_allclose(one["intensity"], other["intensity"], rtol=1e-5)


def test_a_unit_by_which_all_is_below_the_noise_is_not_theirs(tmp_path: Path) -> None:
    path = original(tmp_path, NAMES[2])
    expected, contents = open_spectra(path), contents_of(path)
    contents = changed(contents, is_intensity, lambda one: replace(one, attributes=one.attributes | {"UNITS": "sfu"}))

    for one, other in alike(open_spectra(write(path, contents)), expected):
        np.testing.assert_array_equal(one["intensity"], other["intensity"])


def test_whole_numbers_are_scaled_as_the_file_says(tmp_path: Path) -> None:
    path = original(tmp_path, NAMES[1])
    expected, contents = open_spectra(path), contents_of(path)

    def packed(one: Stored) -> Stored:
        attributes = {"SCALE_FACTOR": 0.01, "ADD_OFFSET": 3.0, "FILLVAL": -32768}
        return replace(one, kind=2, values=np.rint((one.values - 3.0) * 100).astype("i2"), attributes=attributes)

    for one, other in alike(open_spectra(write(path, changed(contents, is_intensity, packed))), expected):
        np.testing.assert_allclose(one["intensity"], other["intensity"], atol=6e-3)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("count", [2, 9])
def test_some_records_whose_clock_jumped_are_left_out(tmp_path: Path, name: str, count: int) -> None:
    path = original(tmp_path, name)
    (expected, *_), contents = open_spectra(path), as_cdf_epoch(contents_of(path))

    def jump(one: Stored) -> Stored:
        values = one.values.copy()
        values[60 : 60 + count] += 9 * 3_600_000.0
        return replace(one, values=values)

    read, *_ = open_spectra(write(path, changed(contents, is_epoch, jump)))

    kept = np.delete(expected["time"].to_numpy(), slice(60, 60 + count))
    np.testing.assert_allclose((read["time"] - kept) / SECOND, 0.0, atol=1e-3)


@pytest.mark.parametrize("name", NAMES)
def test_a_clock_that_stands_still_is_refused(tmp_path: Path, name: str) -> None:
    path = original(tmp_path, name)

    def stand(one: Stored) -> Stored:
        return replace(one, values=np.minimum(one.values, one.values[80]))

    with pytest.raises(InputError, match="its clock stood still"):
        open_spectra(write(path, changed(as_cdf_epoch(contents_of(path)), is_epoch, stand)))


@pytest.mark.parametrize("lowest", [0.0, -1.0, np.nan])
def test_a_channel_without_a_frequency_is_left_out(tmp_path: Path, lowest: float) -> None:
    path = original(tmp_path, NAMES[2])
    (expected,), contents = open_spectra(path), contents_of(path)
    contents["FREQUENCY"].values[0] = lowest

    (read,) = open_spectra(write(path, contents))

    np.testing.assert_array_equal(read["frequency"], expected["frequency"][1:])
    np.testing.assert_array_equal(read["intensity"], expected["intensity"][:, 1:])


def test_logarithms_of_frequencies_are_refused(tmp_path: Path) -> None:
    path = original(tmp_path, NAMES[2])
    logarithms = changed(
        contents_of(path),
        is_frequency,
        lambda one: replace(one, values=np.log10(one.values), attributes={"UNITS": "log10(Hz)"}),
    )

    with pytest.raises(InputError, match="holds logarithms"):
        open_spectra(write(path, logarithms))


def test_gzip_in_parts(tmp_path: Path) -> None:
    path = original(tmp_path, NAMES[2])
    (expected,), content = open_spectra(path), path.read_bytes()
    path.write_bytes(gzip.compress(content[:3000]) + gzip.compress(content[3000:]))

    (read,) = open_spectra(path)

    assert read.identical(expected)


# flags, sample times, positions

FLAG = (RANDOM.random((RECORDS, 400)) < 0.2).astype(np.uint8)
MEANINGS: dict[str, tuple[str, np.ndarray, dict[str, Any]]] = {
    "by name": ("INTERPOL_FLAG", FLAG, {}),
    "another spelling": ("Interpolation_Flag", FLAG, {}),
    "short": ("interp_flag", FLAG, {}),
    "plain": ("interpolated", FLAG, {}),
    "said to be zero": ("INTERPOL_FLAG", 1 - FLAG, {"CATDESC": "Flag: 0 = interpolated, 1 = measured"}),
    "measured is one": ("INTERP_FLAG", 1 - FLAG, {"VAR_NOTES": "1: measured; 0: from neighbouring channels"}),
    "not interpolated": ("NOT_INTERPOLATED", 1 - FLAG, {}),
    "one means not": ("INTERP_FLAG", 1 - FLAG, {"CATDESC": "1 if the sample was not interpolated"}),
    "quality": ("QUALITY_FLAG", np.where(FLAG, 3, 2), {"CATDESC": "Quality: 0 bad, 2 good, 3 interpolated"}),
    "meanings": ("INTERP_FLAG", 1 - FLAG, {"FLAG_VALUES": "0 1", "FLAG_MEANINGS": "interpolated observed"}),
    "fill is unknown": ("INTERPOL_FLAG", np.where(FLAG, 1, 255), {}),
    "stated fill": ("INTERPOL_FLAG", np.where(FLAG, 1, 99), {"FILLVAL": 99}),
}
FLAGGED = {"wi_l2": "PSD_V2_SP", "wi_k0": "E_Average", "sta": "PSD_FLUX", "solo": "PSD_FLUX", "psp": "psp_fld"}


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("of_records", [True, False])
@pytest.mark.parametrize("meaning", MEANINGS.values(), ids=MEANINGS.keys())
def test_flags_are_found_and_understood(
    tmp_path: Path, name: str, of_records: bool, meaning: tuple[str, np.ndarray, dict[str, Any]]
) -> None:
    path = original(tmp_path, name)
    expected, contents = open_spectra(path), contents_of(path)
    columns = next(one.values.shape[1] for key, one in contents.items() if is_intensity(key, one))
    flag, values, attributes = meaning
    contents = {key: one for key, one in contents.items() if key != "INTERPOL_FLAG"}
    stored = values[:, 0] if of_records else values[:, :columns]
    contents[flag] = Stored(af.UINT1, stored.astype(np.uint8), varies=True, attributes=attributes)

    for one, other in alike(open_spectra(write(path, contents)), expected):
        channels = one.sizes["frequency"]
        if of_records:
            np.testing.assert_array_equal(np.isnan(one["intensity"]).all("frequency"), FLAG[:, 0] == 1)
        elif channels == columns:
            np.testing.assert_array_equal(np.isnan(one["intensity"]), FLAG[:, :columns] == 1)
        assert int(np.isnan(one["intensity"]).sum()) > int(np.isnan(other["intensity"]).sum())


TIMINGS = [("TIMING", "s", 1.0, ""), ("Sample_Time_Offset", "ms", 1e3, ""), ("TIMING", "", 1.0, "")]
TIMINGS += [("DT", "us", 1e6, "Time since the start of the sweep")]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("given", TIMINGS)
def test_sample_times_are_found_in_every_product(tmp_path: Path, name: str, given: tuple[str, str, float, str]) -> None:
    timing, unit, per_s, said = given
    path = original(tmp_path, name)
    contents = {key: one for key, one in contents_of(path).items() if not key.startswith("ELAPSED")}
    columns = next(one.values.shape[1] for key, one in contents.items() if is_intensity(key, one))
    ramp = np.broadcast_to(np.arange(columns) * 0.05 * per_s, (RECORDS, columns)).astype(np.float32)
    said_of = {"UNITS": unit} if unit else {}
    contents[timing] = Stored(af.REAL4, ramp, varies=True, attributes=said_of | ({"CATDESC": said} if said else {}))

    for one in open_spectra(write(path, contents)):
        late_s = (one["sample_time"].to_numpy() - UTC[:, None]) / SECOND
        assert late_s.min() == pytest.approx(0.0, abs=1e-3)
        assert np.median(np.diff(late_s, axis=1)) == pytest.approx(0.05, abs=2e-3)
        assert late_s[7].max() == pytest.approx(0.05 * (one.sizes["frequency"] - 1), abs=0.06)


def test_a_flag_of_another_receiver_is_not_taken(tmp_path: Path) -> None:
    path = tmp_path / "wi_h1_wav_20200711_v01.cdf"
    ratio = {name: RANDOM.gamma(20.0, 0.05, (RECORDS, 256)) for name in ("RAD1", "RAD2")}
    af.write_wind_h1(path, UTC, ratio, {name: np.ones(256, dtype=bool) for name in ratio})
    contents = contents_of(path)
    contents["INTERPOL_FLAG_RAD2"] = Stored(af.UINT1, FLAG[:, :256], varies=True)

    rad1, rad2 = open_spectra(write(path, contents))

    assert not np.isnan(rad1["intensity"]).any()
    np.testing.assert_array_equal(np.isnan(rad2["intensity"]), FLAG[:, :256] == 1)


def test_values_that_were_interpolated_are_no_flags(tmp_path: Path) -> None:
    path = original(tmp_path, NAMES[0])
    (expected,), contents = open_spectra(path), contents_of(path)
    contents["PSD_V2_INTERPOLATED"] = replace(contents["PSD_V2_SP"], values=contents["PSD_V2_SP"].values * 1.5)

    (read,) = open_spectra(write(path, contents))

    np.testing.assert_array_equal(read["intensity"], expected["intensity"])


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("stated", ["once", "record", "own times"])
def test_positions_are_found_in_every_product(tmp_path: Path, name: str, stated: str) -> None:
    path = original(tmp_path, name)
    contents = {key: one for key, one in contents_of(path).items() if "POS" not in key}
    where_km = np.array([1.4e8, 2e7, -3e6])
    if stated == "once":
        contents["SC_POS_HEE"] = Stored(af.REAL8, where_km, varies=False, attributes={"UNITS": "km"})
    elif stated == "record":
        epoch = next(key for key, one in contents.items() if is_epoch(key, one))
        values = np.broadcast_to(where_km, (RECORDS, 3)).copy()
        contents["SC_POS_HEE"] = Stored(af.REAL8, values, varies=True, attributes={"UNITS": "km", "DEPEND_0": epoch})
    else:
        contents["Epoch_orbit"] = Stored(af.EPOCH, af.cdf_epoch(UTC[[60]]), varies=True)
        attributes = {"UNITS": "km", "DEPEND_0": "Epoch_orbit"}
        contents["SC_POS_HEE"] = Stored(af.REAL8, where_km[None], varies=True, attributes=attributes)

    spectra = open_spectra(write(path, contents))

    if len(spectra) > 1:  # of two spacecraft, whose it is is not known
        assert "position_km" not in spectra[0]
        return
    known = np.isfinite(spectra[0]["position_km"]).all("axis").to_numpy()
    near = np.abs(spectra[0]["time"].to_numpy() - UTC[60]) <= 1800 * SECOND
    np.testing.assert_array_equal(known, near if stated == "own times" else True)
    np.testing.assert_allclose(spectra[0]["position_km"][known], np.broadcast_to(where_km, (known.sum(), 3)))


def test_solar_orbiter_lists_take_flags_too(tmp_path: Path) -> None:
    path = tmp_path / "solo_L2_rpw-hfr-surv_20200711_V01.cdf"
    khz, count = np.linspace(425.0, 16_325.0, 20), 12
    utc = UTC[0] + np.arange(20 * count) * SECOND // 4
    written.write_solo_l2_hfr(
        path, utc, np.tile(khz, count), np.repeat(np.arange(count), 20), np.ones(utc.size) * 1e-15
    )
    contents = contents_of(path)
    flag = RANDOM.random(utc.size) < 0.2
    contents["INTERP_FLAG"] = Stored(af.UINT1, flag.astype(np.uint8), varies=True)

    (read,) = open_spectra(write(path, contents))

    np.testing.assert_array_equal(np.isnan(read["intensity"]), flag.reshape(count, 20))
