"""Faults that files of archives have, one of each kind: read rightly, or refused in words that help."""

import gzip
import struct
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from bella.bursts.detection import search
from bella.exceptions import InputError
from bella.simulation import archive_files as af
from bella.spectra import by_observatory, join_days, open_spectra, quirks, sample_times, user_days, validate_spectrum
from bella.spectra.assembly import Origin, assemble, merged_channels, shared_channels
from tests.spectra import written

SECOND = np.timedelta64(10**9, "ns")
START = np.datetime64("2020-07-11T00:00:11", "ns")
UTC = START + np.arange(60) * 38 * SECOND
RANDOM = np.random.default_rng(20200711)
STA = "sta_l3_wav_hfr_20200711_v01.cdf"
L2 = "wi_l2_wav_rad1_20200711_v01.cdf"
HZ = np.linspace(125e3, 16.025e6, 40)
FLUX = RANDOM.uniform(1e-20, 3e-20, (60, 40)).astype(np.float32)


def only(path: Path) -> xr.Dataset:
    (spectrum,) = open_spectra(path)
    return validate_spectrum(spectrum, path.name)


def stereo(path: Path, *more: af.Variable, flux: np.ndarray = FLUX, utc: np.ndarray = UTC) -> Path:
    """STEREO L3 with further variables."""
    return af.write_cdf(
        path,
        path.stem,
        [
            ("Epoch", af.TT2000, af.tt2000(utc), True, {}),
            ("FREQUENCY", af.REAL4, HZ.astype(np.float32), False, {"UNITS": "Hz"}),
            ("PSD_FLUX", af.REAL4, af.filled(flux), True, {"UNITS": "W/m^2/Hz"}),
            *more,
        ],
    )


# times


@pytest.mark.parametrize("off", [2, -2, 4000, -3000])
@pytest.mark.parametrize("kind", [af.TT2000, af.EPOCH])
def test_times_far_from_the_day_of_the_name_are_refused(tmp_path: Path, off: int, kind: int) -> None:
    utc = UTC + np.timedelta64(off, "D")
    epoch = af.tt2000(utc) if kind == af.TT2000 else af.cdf_epoch(utc)
    variables: list[af.Variable] = [
        ("Epoch", kind, epoch, True, {}),
        ("FREQUENCY", af.REAL4, HZ.astype(np.float32), False, {"UNITS": "Hz"}),
        ("PSD_FLUX", af.REAL4, FLUX, True, {}),
    ]
    path = af.write_cdf(tmp_path / STA, "st_l3", variables)

    with pytest.raises(InputError, match=STA):
        open_spectra(path)


def test_a_time_before_the_space_age_is_no_gap(tmp_path: Path) -> None:
    epoch = af.cdf_epoch(UTC)
    epoch[7] -= 136 * 365.25 * 86_400_000.0
    variables: list[af.Variable] = [
        ("Epoch", af.EPOCH, epoch, True, {}),
        ("FREQUENCY", af.REAL4, HZ.astype(np.float32), False, {"UNITS": "Hz"}),
        ("PSD_FLUX", af.REAL4, FLUX, True, {}),
    ]

    with pytest.raises(InputError, match="its clock is wrong"):
        open_spectra(af.write_cdf(tmp_path / STA, STA, variables))


@pytest.mark.parametrize(("fill", "left"), [(-1e31, 59), (0.0, 59), (3.15569519999999e14, 59)])
def test_fill_values_of_an_epoch_are_no_times(tmp_path: Path, fill: float, left: int) -> None:
    epoch = af.cdf_epoch(UTC)
    epoch[7] = fill
    variables: list[af.Variable] = [
        ("Epoch", af.EPOCH, epoch, True, {}),
        ("FREQUENCY", af.REAL4, HZ.astype(np.float32), False, {"UNITS": "Hz"}),
        ("PSD_FLUX", af.REAL4, FLUX, True, {}),
    ]

    assert only(af.write_cdf(tmp_path / STA, STA, variables)).sizes["time"] == left


def binary(path: Path, utc: np.ndarray) -> bytearray:
    written.write_wind_60s(path, UTC[:1] - np.timedelta64(3000, "D"), np.geomspace(20, 1000, 32), np.ones((1, 32)), 2)
    one = path.read_bytes()
    content = bytearray()
    for time in utc:
        record = bytearray(one)
        seconds = int((time - np.datetime64("1950-01-01")) / SECOND)
        struct.pack_into(">i", record, 14, (seconds + 2**31) % 2**32 - 2**31)
        struct.pack_into(">6h", record, 18, *time.astype("M8[s]").item().timetuple()[:6])
        content += record
    return content


@pytest.mark.parametrize("day", ["1996-03-01", "2018-01-18", "2018-01-19", "2018-01-20", "2020-07-11", "2031-02-03"])
def test_the_clock_of_the_binary_wraps_and_its_calendar_does_not(tmp_path: Path, day: str) -> None:
    utc = np.datetime64(day + "T00:00:30", "ns") + np.arange(600) * 60 * SECOND
    path = tmp_path / f"wi_wa_rad1_l2_60s_{day.replace('-', '')}_v01.dat"
    path.write_bytes(binary(path, utc))

    np.testing.assert_array_equal(only(path)["time"].to_numpy(), utc)


def test_a_calendar_that_no_other_clock_has_is_refused(tmp_path: Path) -> None:
    utc = np.datetime64("2012-06-07T00:00:30", "ns") + np.arange(20) * 60 * SECOND
    path = tmp_path / "wi_wa_rad1_l2_60s_20120607_v01.dat"
    content = binary(path, utc)
    record = len(content) // 20
    struct.pack_into(">h", content, 5 * record + 24, 7)  # its hour
    path.write_bytes(content)

    with pytest.raises(InputError, match="record 6 has the date 2012-06-07T07:05:30"):
        open_spectra(path)


def test_a_leap_second_of_the_calendar_is_the_next_second(tmp_path: Path) -> None:
    utc = np.datetime64("2012-06-30T23:55:00", "ns") + np.arange(6) * 60 * SECOND
    path = tmp_path / "wi_wa_rad1_l2_60s_20120630_v01.dat"
    content = binary(path, utc)
    struct.pack_into(">6h", content, 5 * (len(content) // 6) + 18, 2012, 6, 30, 23, 59, 60)
    path.write_bytes(content)

    np.testing.assert_array_equal(only(path)["time"].to_numpy(), utc)


def test_a_record_whose_clock_jumped_is_left_out() -> None:
    time = UTC.copy()
    time[20] += 5 * 3600 * SECOND

    spectrum = assemble(Origin("WIND", "RAD1", "psd_v2_hz", "x.cdf"), time, HZ * 1e-6, FLUX)

    np.testing.assert_array_equal(spectrum["time"].to_numpy(), np.delete(UTC, 20))


def test_a_gap_is_no_jump() -> None:
    time = UTC.copy()
    time[20:] += 5 * 3600 * SECOND

    assert assemble(Origin("WIND", "RAD1", "psd_v2_hz", "x"), time, HZ * 1e-6, FLUX).sizes["time"] == 60


@pytest.mark.parametrize("name", [STA, L2])
def test_reversed_records_are_sorted_before_the_cadence_is_taken(tmp_path: Path, name: str) -> None:
    paths = []
    for order, folder in ((slice(None), "a"), (slice(None, None, -1), "b")):
        (tmp_path / folder).mkdir()
        utc, flux = UTC[order], FLUX[order]
        write = af.write_stereo_l3 if name == STA else af.write_wind_l2
        paths.append(write(tmp_path / folder / name, utc, HZ, flux))

    forward, backward = map(only, paths)

    assert forward.identical(backward)


# samples


def offsets(shape: tuple[int, ...]) -> np.ndarray:
    """Up the band in 34.5 s, in the shape that a file may have."""
    ramp = np.linspace(0.0, 34.5, 40)
    if shape[-1] != 40:
        ramp = ramp[:, None]
    return np.array(np.broadcast_to(ramp, shape), dtype=np.float32)


@pytest.mark.parametrize("shape", [(60, 40), (60, 40, 3), (60, 3, 40), (40,), (40, 3)])
@pytest.mark.parametrize("name", ["TIMING", "ELAPSED_TIME_SINCE_EPOCH", "Timing"])
def test_sample_times_are_found_by_name_in_any_shape(tmp_path: Path, shape: tuple[int, ...], name: str) -> None:
    varies = shape[0] == 60
    path = stereo(tmp_path / STA, (name, af.REAL4, offsets(shape), varies, {"UNITS": "s"}))

    spectrum = only(path)

    late_s = (sample_times(spectrum).to_numpy() - UTC[:, None]) / SECOND
    np.testing.assert_allclose(late_s, np.broadcast_to(np.linspace(0, 34.5, 40), (60, 40)), atol=1e-5)
    np.testing.assert_allclose((spectrum["time"].to_numpy() - UTC) / SECOND, 17.25, atol=1e-5)
    assert spectrum.attrs["integration_s"] == pytest.approx(34.5 / 39, rel=1e-4)


@pytest.mark.parametrize(("unit", "per_s"), [("ms", 1e3), ("s", 1.0), ("sec", 1.0)])
def test_sample_times_have_units(tmp_path: Path, unit: str, per_s: float) -> None:
    timing = ("TIMING", af.REAL4, offsets((60, 40)) * np.float32(per_s), True, {"UNITS": unit})

    late = sample_times(only(stereo(tmp_path / STA, timing))).to_numpy()[:, -1] - UTC

    np.testing.assert_allclose(late / SECOND, 34.5, atol=1e-4)


def test_interpolated_samples_are_no_data(tmp_path: Path) -> None:
    flag = (RANDOM.random((60, 40)) < 0.3).astype(np.uint8)
    flag[:, 5] = 1
    spectrum = only(stereo(tmp_path / STA, ("INTERPOL_FLAG", af.UINT1, flag, True, {})))

    expected = (flag == 1) & (np.arange(40) != 5)
    np.testing.assert_array_equal(np.isnan(spectrum["intensity"]), expected)
    np.testing.assert_array_equal(spectrum["interpolated"], np.arange(40) == 5)


def test_one_flag_for_each_record(tmp_path: Path) -> None:
    flag = (np.arange(60) % 7 == 0).astype(np.uint8)
    path = tmp_path / "solo_L3_rpw-hfr-surv-flux_20200711_V01.cdf"
    elapsed = np.broadcast_to(np.linspace(0.0, 16.0, 321), (60, 321))
    flux = RANDOM.uniform(1e-20, 2e-20, (60, 321))
    af.write_solo_l3(path, af.Sweeps(UTC, elapsed), np.linspace(375, 16375, 321), flux, flag)

    spectrum = only(path)

    assert spectrum.sizes["frequency"] == 321
    np.testing.assert_array_equal(np.isnan(spectrum["intensity"]).all("frequency"), flag == 1)


def test_flux_at_1_au_stands_beside_the_flux(tmp_path: Path) -> None:
    sfu = np.linspace(1.0, 2.0, 2400, dtype=np.float32).reshape(60, 40, 1)
    spectrum = only(stereo(tmp_path / STA, ("PSD_SFU", af.REAL4, sfu, True, {"UNITS": "sfu"})))

    np.testing.assert_allclose(spectrum["flux_sfu_1au"], sfu[..., 0])


@pytest.mark.parametrize("name", ["TIMING", "INTERPOL_FLAG", "PSD_SFU", "SC_POS_HEE", "WAVE_AZIMUTH_HEE"])
@pytest.mark.parametrize("shape", [(60, 7), (60, 2, 2), (11,)])
def test_an_optional_variable_never_refuses_a_spectrum(tmp_path: Path, name: str, shape: tuple[int, ...]) -> None:
    path = stereo(tmp_path / STA, (name, af.REAL4, np.ones(shape, dtype=np.float32), len(shape) > 1, {"UNITS": "s"}))

    spectrum = only(path)

    np.testing.assert_array_equal(spectrum["intensity"], FLUX)
    assert name == "SC_POS_HEE" or name in spectrum.attrs["left_out"].split(";")


# which variable


@pytest.mark.parametrize(("good", "chosen"), [("SP", "SP"), ("Z", "Z"), ("S", "S")])
@pytest.mark.parametrize("share", [0.5, 1.0])
def test_an_antenna_is_chosen_by_its_data(tmp_path: Path, good: str, chosen: str, share: float) -> None:
    """Those that are not good are fill in half of the day, or all of it."""
    variables: list[af.Variable] = [
        ("Epoch", af.TT2000, af.tt2000(UTC), True, {}),
        ("FREQUENCY", af.REAL4, HZ.astype(np.float32), False, {"UNITS": "Hz"}),
    ]
    for number, name in enumerate(("S", "SP", "Z")):
        values = (FLUX * (number + 1)).astype(np.float64)
        if name != good:
            values[: int(60 * share)] = np.nan
        variables.append((f"PSD_V2_{name}", af.REAL4, af.filled(values), True, {}))

    spectrum = only(af.write_cdf(tmp_path / L2, L2, variables))

    assert spectrum.attrs["antenna"] == f"PSD_V2_{chosen}"
    assert np.isfinite(spectrum["intensity"]).all()


def test_tnr_has_one_antenna(tmp_path: Path) -> None:
    path = tmp_path / "wi_l2_wav_tnr_20200711_v01.cdf"
    variables: list[af.Variable] = [
        ("Epoch", af.TT2000, af.tt2000(UTC), True, {}),
        ("FREQUENCY", af.REAL4, (HZ / 50).astype(np.float32), False, {"UNITS": "Hz"}),
        ("PSD_V2", af.REAL4, FLUX, True, {}),
    ]

    np.testing.assert_array_equal(only(af.write_cdf(path, path.stem, variables))["intensity"], FLUX)


@pytest.mark.parametrize("frame", ["RTN", "SRF"])
def test_wave_angles_keep_their_frame(tmp_path: Path, frame: str) -> None:
    path = tmp_path / "wi_wa_rad1_l3_df_20200711_v02.cdf"
    times = START + np.arange(64 * 9) * 2860 * np.timedelta64(10**6, "ns")
    khz = np.tile(np.repeat(np.array([100, 300, 500, 700], dtype=np.float32), 16), 9)
    angle = np.linspace(0, 90, times.size, dtype=np.float32)
    variables: list[af.Variable] = [
        ("Epoch", af.TT2000, af.tt2000(times), True, {}),
        ("SWEEP", 4, np.repeat(np.arange(9), 64), True, {}),
        ("FREQUENCY", af.REAL4, khz, True, {"UNITS": "kHz"}),
        ("STOKES_I", af.REAL4, np.full(times.size, 1e-19, dtype=np.float32), True, {}),
        (f"WAVE_COLATITUDE_{frame}", af.REAL4, angle, True, {}),
        (f"WAVE_AZIMUTH_{frame}", af.REAL4, angle, True, {}),
    ]

    spectrum = only(af.write_cdf(path, path.stem, variables))

    assert f"wave_azimuth_{frame.lower()}_deg" in spectrum
    assert not {"wave_azimuth_rtn_deg", "wave_azimuth_srf_deg"} - {f"wave_azimuth_{frame.lower()}_deg"} & set(spectrum)


# axes


@pytest.mark.parametrize("shift_ns", [0, 1, 5_000_000, -3_000_000_000])
def test_dipoles_that_tick_apart_are_summed(tmp_path: Path, shift_ns: int) -> None:
    path = psp(tmp_path, UTC, UTC + np.timedelta64(shift_ns, "ns"), FLUX, 3 * FLUX)

    np.testing.assert_allclose(only(path)["intensity"], 4 * FLUX, rtol=1e-6)


@pytest.mark.parametrize("first_of_second", [40, 0])
def test_dipoles_are_joined_as_a_union(tmp_path: Path, first_of_second: int) -> None:
    part = slice(first_of_second, None) if first_of_second else slice(0, 30)

    spectrum = only(psp(tmp_path, UTC, UTC[part], FLUX, FLUX[part]))

    assert spectrum.sizes["time"] == 60
    np.testing.assert_allclose(spectrum["intensity"], 2 * FLUX, rtol=1e-6)


def psp(folder: Path, utc: np.ndarray, other_utc: np.ndarray, first: np.ndarray, second: np.ndarray) -> Path:
    path, variables = folder / "psp_fld_l2_rfs_hfr_20200711_v03.cdf", []
    for number, (dipole, time, values) in enumerate((("ch0_V1V2", utc, first), ("ch1_V3V4", other_utc, second))):
        suffix = f"hfr_auto_averages_{dipole}"
        moved_hz = np.broadcast_to(HZ * (1.0 + 1e-5 * number), values.shape)
        variables += [
            (f"epoch_{suffix}", af.TT2000, af.tt2000(time), True, {}),
            (f"frequency_{suffix}", af.REAL8, moved_hz, True, {"UNITS": "Hz"}),
            (f"psp_fld_l2_rfs_{suffix}", af.REAL4, values.astype(np.float32), True, {}),
        ]
    return af.write_cdf(path, path.stem, variables)


def test_frequencies_that_move_a_little_are_one_axis() -> None:
    mhz = HZ * 1e-6
    moved = np.where((np.arange(60) % 2 == 0)[:, None], mhz, mhz * (1 + 1e-4))

    channels, values = shared_channels(moved, FLUX, "x.cdf")

    np.testing.assert_allclose(channels, mhz * (1 + 0.5e-4), rtol=1e-9)
    np.testing.assert_array_equal(values, FLUX)


def test_other_channels_stay_others() -> None:
    channels, column = merged_channels(np.array([1.0, 1.05, 1.00001, 2.0]), 1e-3)

    np.testing.assert_allclose(channels, [1.000005, 1.05, 2.0])
    np.testing.assert_array_equal(column, [0, 1, 0, 2])


@pytest.mark.parametrize("first_is_fill", [True, False])
def test_of_twins_that_with_data_stays(tmp_path: Path, first_is_fill: bool) -> None:
    time = np.insert(UTC, 20, UTC[20])
    flux = np.insert(FLUX, 20, FLUX[20], axis=0)
    flux[20 if first_is_fill else 21] = np.nan

    spectrum = only(af.write_stereo_l3(tmp_path / STA, time, HZ, flux))

    np.testing.assert_array_equal(spectrum["intensity"], FLUX)


def test_of_twins_in_two_files_that_with_data_stays() -> None:
    origin = Origin("WIND", "RAD1", "psd_v2_hz", "x.cdf")
    empty = FLUX.copy()
    empty[50:] = np.nan
    first, second = assemble(origin, UTC, HZ * 1e-6, empty), assemble(origin, UTC[40:], HZ * 1e-6, FLUX[40:])

    np.testing.assert_array_equal(join_days([first, second])["intensity"], FLUX)


# containers


@pytest.mark.parametrize("pack", [lambda content: content, gzip.compress])
def test_key_parameters_every_three_minutes_are_searched(tmp_path: Path, pack: object) -> None:
    utc = np.datetime64("2020-07-11T00:01:30", "ns") + np.arange(480) * 180 * SECOND
    decibel = RANDOM.normal(0.0, 0.3, (480, 76))
    path = af.write_wind_k0(tmp_path / "wi_k0_wav_20200711_v01.cdf", utc, decibel)
    packed = path if pack is not gzip.compress else path.with_suffix(".cdf.gz")
    packed.write_bytes(pack(path.read_bytes()))  # type: ignore[operator]

    searched = search(only(packed))

    assert searched.not_searchable == ""
    assert np.isfinite(searched.match.score).any()
    assert searched.match.revisit == pytest.approx(3.0)


def test_more_samples_than_two_million_are_read(tmp_path: Path) -> None:
    sweeps, khz = 40_500, np.linspace(425.0, 16_325.0, 50)
    utc = np.datetime64("2020-07-11T00:00:00", "ns") + (np.arange(sweeps * 50) * 42_000_000).astype("timedelta64[ns]")
    path = tmp_path / "solo_L2_rpw-hfr-surv_20200711_V01.cdf"
    written.write_solo_l2_hfr(
        path, utc, np.tile(khz, sweeps), np.repeat(np.arange(sweeps), 50), np.full(utc.size, 1e-15)
    )

    assert dict(only(path).sizes) == {"time": sweeps, "frequency": 50}


# what cannot be searched


@pytest.mark.parametrize(
    ("mhz", "step_s", "records", "reason"),
    [
        (np.linspace(20.0, 92.0, 60), 60, 600, "0 of the 6 search channels"),
        (np.geomspace(0.004, 0.5, 60), 60, 600, "0 of the 6 search channels"),
        (np.geomspace(0.1, 14.0, 60), 900, 90, "records are 900 s apart"),
        (np.geomspace(0.1, 14.0, 60), 60, 5, "lasts 5 minutes"),
    ],
)
def test_what_cannot_be_searched_says_why(mhz: np.ndarray, step_s: int, records: int, reason: str) -> None:
    time = np.datetime64("2020-07-11", "ns") + np.arange(records) * step_s * SECOND
    values = RANDOM.gamma(50, 1e-17, (records, 60)).astype(np.float32)

    searched = search(assemble(Origin("WIND", "X", "psd_v2_hz", "x.nc"), time, mhz, values))

    assert reason in searched.not_searchable
    assert not searched.found


# quirks, origin, users


def test_spectra_carry_the_quirks_of_their_day(tmp_path: Path) -> None:
    elapsed = np.broadcast_to(np.linspace(0.0, 16.0, 50), (60, 50))
    carried = {}
    for day in ("2022-12-19", "2022-12-20", "2024-01-21", "2024-01-22"):
        path = tmp_path / f"solo_L3_rpw-hfr-surv-flux_{day.replace('-', '')}_V01.cdf"
        sweeps = af.Sweeps(np.datetime64(day, "ns") + np.arange(60) * 38 * SECOND, elapsed)
        af.write_solo_l3(path, sweeps, np.linspace(425, 16325, 50), elapsed + 1.0, elapsed * 0)
        carried[day] = "solo_hfr_five_then_fifty" in only(path).attrs.get("quirks", "").split(";")

    assert list(carried.values()) == [False, True, True, False]
    assert all(one.effect and one.handling and one.source for one in quirks())


def test_a_simulated_file_says_so_through_all_that_is_made_of_it(tmp_path: Path) -> None:
    spectrum = only(af.write_stereo_l3(tmp_path / STA, UTC, HZ, FLUX))
    measured = spectrum.assign_attrs(origin="archive").assign_coords(time=spectrum["time"] + np.timedelta64(1, "D"))

    assert spectrum.attrs["origin"] == "simulated"
    assert join_days([measured, spectrum]).attrs["origin"] == "simulated"
    assert by_observatory([measured])["STEREO-A"].attrs["origin"] == "archive"


def user_file(path: Path, observatory: str, days: int = 1, **more: object) -> Path:
    time = np.datetime64("2012-06-07T00:00:30", "ns") + np.arange(1440 * days) * 60 * SECOND
    mhz = np.geomspace(0.2, 10.0, 8)
    spectrum = xr.Dataset(
        {"intensity": (("time", "frequency"), np.ones((time.size, 8), dtype=np.float32)), **more},
        coords={"time": time, "frequency": mhz},
        attrs={"observatory": observatory, "receiver": "X", "quantity": "psd_v2_hz"},
    )
    spectrum.to_netcdf(path, engine="h5netcdf")
    return path


def test_a_folder_of_users_is_read_by_day(tmp_path: Path) -> None:
    user_file(tmp_path / "mine.nc", "Stereo Ahead", days=2)
    where = xr.DataArray([1e8, 2e7, 0.0], dims="axis", attrs={"frame": "hee"})
    user_file(tmp_path / "mars.nc", "Mars Express", position_km=where)
    user_file(tmp_path / "ulysses.nc", "Ulysses")
    (tmp_path / "broken.nc").write_bytes(b"broken")
    (tmp_path / "README.md").write_text("what this is")

    folder = user_days(tmp_path)
    first, second = (folder.read(day) for day in folder.days)

    assert [day.isoformat() for day in folder.days] == ["2012-06-07", "2012-06-08"]
    assert set(first.spectra) == {"STEREO-A", "Mars Express", "Ulysses"}
    assert all(one.attrs["origin"] == "user" for one in first.spectra.values())
    assert first.spectra["STEREO-A"].attrs["source_files"] == ["mine.nc"]
    assert first.positions["STEREO-A"].source == "ephemeris"
    np.testing.assert_allclose(first.positions["Mars Express"].position_rsun * 695_700, [1e8, 2e7, 0.0], rtol=1e-3)
    assert "Ulysses" not in first.positions
    assert "position_km" in first.left_out[0]
    assert [one.split(":")[0] for one in folder.left_out] == ["left out"]
    assert list(second.spectra) == ["STEREO-A"]


def test_a_typing_error_in_a_name_is_answered_with_the_name(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="did you mean STEREO-A"):
        open_spectra(user_file(tmp_path / "x.nc", "STERO-A"))
