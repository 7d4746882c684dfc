"""netCDF and Zarr as people write them: read as what they mean, or refused in a line that says what to change."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from bella.exceptions import InputError
from bella.spectra import as_spectrum, fleet_pieces, open_spectra, sample_times, user_days

RANDOM = np.random.default_rng(20120607)
SECOND = np.timedelta64(10**9, "ns")
TIME = np.datetime64("2012-06-07T00:00:30", "ns") + np.arange(200) * 60 * SECOND
MHZ = np.geomspace(0.2, 12.0, 8)
DECIBEL = RANDOM.normal(0.0, 1.0, (200, 8)).astype(np.float32)
ISO = [str(one)[:19] for one in TIME]

Change = Callable[[xr.Dataset], xr.Dataset]


def spectrum() -> xr.Dataset:
    return xr.Dataset(
        {"intensity": (("time", "frequency"), DECIBEL.copy())},
        coords={"time": TIME, "frequency": MHZ},
        attrs={"observatory": "STEREO A", "receiver": "X", "quantity": "db_over_background"},
    )


def written(folder: Path, change: Change, name: str = "mine.nc") -> Path:
    change(spectrum()).to_netcdf(folder / name, engine="h5netcdf")
    return folder / name


def raw_times(values: object, **attributes: str) -> Change:
    return lambda one: one.drop_vars("time").assign_coords(time=("time", np.asarray(values), attributes))


def frequencies(values: np.ndarray, unit: str | None) -> Change:
    return lambda one: one.assign_coords(frequency=("frequency", values, {} if unit is None else {"units": unit}))


def intensity(values: np.ndarray, **attributes: object) -> Change:
    return lambda one: one.assign(intensity=(("time", "frequency"), values, attributes))


def with_twin(one: xr.Dataset) -> xr.Dataset:
    """A record twice, first without data."""
    empty = one.isel(time=[20]).copy(deep=True)
    empty["intensity"][:] = np.nan
    return xr.concat([one.isel(time=slice(0, 20)), empty, one.isel(time=slice(20, None))], "time")


def by_record(one: xr.Dataset, khz: np.ndarray) -> xr.Dataset:
    """With frequencies of its own for every record, as readers of maser.data give it."""
    indexed = one.drop_vars("frequency").rename_dims(frequency="freq_index")
    return indexed.assign_coords(frequency=(("time", "freq_index"), khz, {"units": "kHz"}))


def turned(one: xr.Dataset) -> xr.Dataset:
    """With every other record from the highest frequency down."""
    up, down = one.isel(time=slice(0, None, 2)), one.isel(time=slice(1, None, 2), freq_index=slice(None, None, -1))
    return xr.concat([up, down], "time").sortby("time")


SECONDS = (TIME - np.datetime64("2012-06-07")) / SECOND
SAME: dict[str, Change] = {
    "hours": raw_times(SECONDS / 3600.0, units="hours since 2012-06-07"),
    "gregorian": raw_times(SECONDS, units="seconds since 2012-06-07", calendar="gregorian"),
    "offset from UTC": raw_times(SECONDS + 7200.0, units="seconds since 2012-06-07T00:00:00+02:00"),
    "text": raw_times(np.array(ISO, dtype=object)),
    "text in bytes": raw_times(np.array(ISO, dtype="S19")),
    "text with Z": raw_times(np.array([f"{one}Z" for one in ISO], dtype=object)),
    "text with offset": raw_times(
        np.array([f"{one + 2 * 3600 * SECOND}"[:19] + "+02:00" for one in TIME], dtype=object)
    ),
    "Hz": frequencies(MHZ * 1e6, "Hz"),
    "unit": lambda one: one.assign_coords(frequency=("frequency", MHZ * 1e3, {"unit": "kHz"})),
    "UNITS": lambda one: one.assign_coords(frequency=("frequency", MHZ * 1e3, {"UNITS": "kHz"})),
    "seconds of the day in float32": raw_times(SECONDS.astype("f4"), units="seconds since 2012-06-07"),
    "UTC, as it says": raw_times(SECONDS, units="seconds since 2012-06-07", time_scale="UTC"),
    "kilohertz": frequencies(MHZ * 1e3, "kilohertz"),
    "KHZ": frequencies(MHZ * 1e3, "KHZ "),
    "no unit": frequencies(MHZ, None),
    "channel of zero": lambda one: xr.concat(
        [one, one.isel(frequency=[0]).assign_coords(frequency=[0.0])], "frequency"
    ),
    "late first": lambda one: one.isel(time=slice(None, None, -1)),
    "high first": lambda one: one.isel(frequency=slice(None, None, -1)),
    "shuffled": lambda one: one.isel(time=RANDOM.permutation(200)),
    "twins": with_twin,
    "frequency first": lambda one: one.transpose("frequency", "time"),
    "axis of one": lambda one: one.assign(intensity=one["intensity"].expand_dims("polarisation")),
    "Title Case": lambda one: one.rename(time="Time", frequency="Frequency", intensity="Intensity"),
    "UPPER": lambda one: one.rename(time="TIME", frequency="FREQ", intensity="INTENSITY"),
    "blanks": lambda one: one.rename(time="time ", frequency=" frequency", intensity="intensity "),
    "other dimensions": lambda one: one.rename_dims(time="x", frequency="y"),
    "variables": lambda one: one.rename_dims(time="x", frequency="y").reset_coords(),
    "attributes": lambda one: xr.Dataset(one.variables, attrs={k.upper(): v for k, v in one.attrs.items()}),
    "float64": intensity(DECIBEL.astype(np.float64)),
    "frequencies of records": lambda one: by_record(one, np.tile(MHZ * 1e3, (200, 1))),
    "frequencies first": lambda one: by_record(one, np.tile(MHZ * 1e3, (200, 1))).transpose("freq_index", "time"),
    "frequencies that turn": lambda one: turned(by_record(one, np.tile(MHZ * 1e3, (200, 1)))),
}


@pytest.mark.parametrize("change", SAME.values(), ids=SAME.keys())
def test_ways_to_write_the_same_spectrum(tmp_path: Path, change: Change) -> None:
    (read,) = open_spectra(written(tmp_path, change))

    assert read.attrs["observatory"] == "STEREO-A"
    assert read["intensity"].dims == ("time", "frequency")
    np.testing.assert_allclose((read["time"].to_numpy() - TIME) / SECOND, 0.0, atol=1e-6)
    np.testing.assert_allclose(read["frequency"], MHZ, rtol=1e-12)
    np.testing.assert_array_equal(read["intensity"], DECIBEL)


FILLS: list[tuple[float, str | None]] = [(-1e31, "_FillValue"), (-9999.0, "missing_value"), (-500.0, "valid_min")]
FILLS += [(one, None) for one in (-9999.0, -1e31, 9.96921e36, 1e20, np.inf, -np.inf)]


@pytest.mark.parametrize(("fill", "attribute"), FILLS)
def test_fill_values_are_no_data(tmp_path: Path, fill: float, attribute: str | None) -> None:
    values = DECIBEL.copy()
    values[5:9] = fill
    said = {} if attribute is None else {attribute: np.float32(-100.0 if attribute == "valid_min" else fill)}

    (read,) = open_spectra(written(tmp_path, intensity(values, **said)))

    np.testing.assert_array_equal(
        np.isnan(read["intensity"]).all("frequency"), (np.arange(200) >= 5) & (np.arange(200) < 9)
    )
    assert int(np.isnan(read["intensity"]).sum()) == 4 * 8


@pytest.mark.parametrize(("unit", "per_s"), [("", 1.0), ("s", 1.0), ("ms", 1e3)])
def test_offsets_of_samples_have_units(tmp_path: Path, unit: str, per_s: float) -> None:
    late_s = np.linspace(0.0, 7.0, MHZ.size)
    said = {"units": unit} if unit else {}

    (read,) = open_spectra(
        written(tmp_path, lambda one: one.assign(sample_offset_s=("frequency", late_s * per_s, said)))
    )

    np.testing.assert_allclose((sample_times(read)[0] - TIME[0]) / SECOND, late_s, atol=1e-6)


@pytest.mark.parametrize("late", ["timedelta", "sample"])
def test_offsets_of_samples_may_be_timedeltas_and_of_every_sample(tmp_path: Path, late: str) -> None:
    late_s = np.linspace(0.0, 7.0, MHZ.size)
    stored = (late_s * 1e9).astype("timedelta64[ns]") if late == "timedelta" else np.tile(late_s, (200, 1))
    dims = ("frequency",) if late == "timedelta" else ("time", "frequency")

    (read,) = open_spectra(written(tmp_path, lambda one: one.assign(sample_offset_s=(dims, stored))))

    np.testing.assert_allclose((sample_times(read)[9] - TIME[9]) / SECOND, late_s, atol=1e-6)


def test_a_fill_value_among_positions_is_no_position(tmp_path: Path) -> None:
    where = np.tile([0.9, 0.1, 0.0], (200, 1))
    where[7] = -1e31

    (read,) = open_spectra(
        written(tmp_path, lambda one: one.assign(position_km=(("time", "xyz"), where, {"frame": "hee", "units": "au"})))
    )

    assert np.isnan(read["position_km"].to_numpy()).all(axis=1).nonzero()[0].tolist() == [7]
    assert read["position_km"].dims == ("time", "axis")


@pytest.mark.parametrize(("unit", "per_sfu"), [("sfu", 1.0), ("W m-2 Hz-1", 1e-22)])
def test_flux_at_1_au_is_in_solar_flux_units(tmp_path: Path, unit: str, per_sfu: float) -> None:
    flux = (("time", "frequency"), DECIBEL.astype(np.float64) * per_sfu, {"units": unit})

    (read,) = open_spectra(written(tmp_path, lambda one: one.assign(flux_sfu_1au=flux)))

    np.testing.assert_allclose(read["flux_sfu_1au"], DECIBEL, rtol=1e-6)


@pytest.mark.parametrize(
    ("unit", "quantity", "factor"),
    [
        ("sfu", "flux_w_m2_hz", 1e-22),
        ("Jy", "flux_w_m2_hz", 1e-26),
        ("W m^-2 Hz^-1", "flux_w_m2_hz", 1.0),
        ("nV^2/Hz", "psd_v2_hz", 1e-18),
        ("erg / (s cm2 Hz)", "flux_w_m2_hz", 1e-3),
        ("kJy", "flux_w_m2_hz", 1e-23),
        ("sfu", "relative_flux", 1.0),
        ("arbitrary", "flux_w_m2_hz", 1.0),
        ("10**999999999 Jy", "flux_w_m2_hz", 1.0),
    ],
)
def test_intensity_is_converted_from_its_unit(tmp_path: Path, unit: str, quantity: str, factor: float) -> None:
    values = np.geomspace(1e3, 1e5, DECIBEL.size, dtype=np.float32).reshape(DECIBEL.shape)

    (read,) = open_spectra(
        written(tmp_path, lambda one: intensity(values, units=unit)(one).assign_attrs(quantity=quantity))
    )

    np.testing.assert_allclose(read["intensity"], values * factor, rtol=1e-6)


FAR = TIME[:, None] + np.where(np.arange(8) == 3, 10**11, 0).astype("timedelta64[s]")
REFUSED: dict[str, tuple[Change, str]] = {
    "noleap": (raw_times(SECONDS, units="seconds since 2012-06-07", calendar="noleap"), "calendar 'noleap': write UTC"),
    "launch": (raw_times(SECONDS, units="seconds since launch"), "'seconds since launch'"),
    "no time unit": (raw_times(SECONDS), "coordinate 'time' is float64: store UTC"),
    "American": (raw_times(np.array(["06/07/2012"] * 200, dtype=object)), "'06/07/2012', which is no time"),
    "1876": (lambda one: one.assign_coords(time=one["time"] - np.timedelta64(136 * 365, "D")), "correct its times"),
    "metres": (frequencies(300.0 / MHZ, "m"), "is in 'm': convert it to MHz"),
    "kHz without unit": (frequencies(MHZ * 1e3, None), "reaches 12000 and has no unit"),
    "Hz called kHz": (frequencies(MHZ * 1e6, "kHz"), "correct the unit"),
    "values without a name": (lambda one: one.rename(intensity="flux"), "name its values 'intensity' (one of flux)"),
    "MHz called Hz": (frequencies(MHZ, "Hz"), "correct the unit"),
    "path": (lambda one: one.assign_attrs(observatory="../x"), "give a plain name"),
    "two names": (lambda one: one.assign_attrs(observatory=["WIND", "PSP"]), "the name of one spacecraft"),
    "two clocks": (
        lambda one: one.drop_vars("time").assign_coords(time=(("time", "x"), np.stack([TIME, TIME], axis=1))),
        "add the coordinate 'time' along a dimension of that name",
    ),
    "offsets in days": (
        lambda one: one.assign(sample_offset_s=("frequency", MHZ, {"units": "fortnights"})),
        "sample_offset_s is in 'fortnights'",
    ),
    "sample times far away": (
        lambda one: one.assign(sample_time=(("time", "frequency"), FAR)),
        "from the time of their",
    ),
    "au called km": (
        lambda one: one.assign(position_km=("axis", [0.9, 0.1, 0.0], {"frame": "hee"})),
        "correct its unit",
    ),
    "metres called km": (
        lambda one: one.assign(position_km=("axis", [1.5e11, 0.0, 0.0], {"frame": "hee"})),
        "1.5e+11 to 1.5e+11 km from the centre of the Sun",
    ),
    "flux called dB": (
        intensity(DECIBEL, units="W m-2 Hz-1"),
        "intensity is in 'W m-2 Hz-1', which is no db_over_background",
    ),
    "dB called flux": (
        lambda one: intensity(DECIBEL, units="dB")(one).assign_attrs(quantity="flux_w_m2_hz"),
        "intensity is in 'dB', which is no flux_w_m2_hz",
    ),
    "TAI": (raw_times(SECONDS, units="seconds since 2012-06-07", time_scale="tai"), "its times are in tai: convert"),
    "TT": (lambda one: one.assign_attrs(TIMESYS="TT"), "its times are in TT: convert them to UTC"),
    "rounded": (
        raw_times(((TIME - np.datetime64(0, "s")) / SECOND).astype("f4"), units="seconds since 1970-01-01"),
        "rounded to 128 s: store them as float64",
    ),
    "two polarisations": (
        lambda one: one.assign(intensity=xr.concat([one["intensity"]] * 2, "hand").transpose(..., "hand")),
        "has 2 values along 'hand': select one of them",
    ),
    "no quantity": (
        lambda one: intensity(DECIBEL, units="dB")(one).drop_attrs(deep=False).assign_attrs(observatory="WIND"),
        "add the attribute 'receiver'",
    ),
    "unknown quantity": (
        lambda one: intensity(DECIBEL, units="dB")(one).assign_attrs(quantity="dB"),
        "attribute 'quantity' is 'db': use one of",
    ),
    "kelvins": (
        lambda one: intensity(DECIBEL, units="K")(one).assign_attrs(quantity="flux_w_m2_hz"),
        "intensity is in 'K', which is no flux_w_m2_hz",
    ),
    "volts": (
        lambda one: intensity(DECIBEL, units="V / Hz(1/2)")(one).assign_attrs(quantity="psd_v2_hz"),
        "which is no psd_v2_hz",
    ),
    "offsets in ms": (lambda one: one.assign(sample_offset_s=("frequency", MHZ * 1e4)), "offsets in seconds"),
}


@pytest.mark.parametrize(("change", "reason"), REFUSED.values(), ids=REFUSED.keys())
def test_what_cannot_be_meant_is_refused_in_a_line(tmp_path: Path, change: Change, reason: str) -> None:
    with pytest.raises(InputError, match=r"mine\.nc") as refused:
        open_spectra(written(tmp_path, change))

    assert reason in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(("name", "is_read"), [("sta_20120607_to_20120609.nc", True), ("sta_20110607.nc", False)])
def test_times_are_held_against_the_day_of_the_name(tmp_path: Path, name: str, is_read: bool) -> None:
    path = written(tmp_path, lambda one: one, name)
    if is_read:
        assert open_spectra(path)
    else:
        with pytest.raises(InputError, match="named after 2011-06-07"):
            open_spectra(path)


def test_samples_of_changing_frequencies_keep_their_times() -> None:
    late = (np.arange(8) * 100).astype("timedelta64[ms]").astype("timedelta64[ns]")
    one = by_record(spectrum(), np.tile(MHZ * 1e3, (200, 1)))
    one["sample_time"] = (("time", "freq_index"), TIME[:, None] + late)

    read = as_spectrum(turned(one), "x")

    np.testing.assert_array_equal(read["sample_time"].to_numpy() - TIME[:, None], np.tile(late, (200, 1)))
    assert "freq_index" not in read.dims


def test_an_array_is_the_intensity() -> None:
    one = spectrum()

    read = as_spectrum(one["intensity"].rename("anything").assign_attrs(one.attrs), "x")

    np.testing.assert_array_equal(read["intensity"], DECIBEL)


@pytest.mark.parametrize("dims", [("time",), ("time", "frequency"), ("frequency", "time"), ("frequency",)])
@pytest.mark.parametrize("name", ["interpolated", "INTERPOL_FLAG", "Interp Flag"])
def test_flags_of_records_and_samples(tmp_path: Path, name: str, dims: tuple[str, ...]) -> None:
    flag = RANDOM.random([{"time": 200, "frequency": 8}[dim] for dim in dims]) < 0.3

    (read,) = open_spectra(written(tmp_path, lambda one: one.assign({name: (dims, flag.astype("u1"))})))

    if dims == ("frequency",):
        np.testing.assert_array_equal(read["interpolated"], flag)
        return
    expected = flag[:, None] if dims == ("time",) else flag if dims[0] == "time" else flag.T
    np.testing.assert_array_equal(np.isnan(read["intensity"]), np.broadcast_to(expected, (200, 8)))


@pytest.mark.parametrize(
    ("name", "attributes"),
    [
        ("interpol_flag", {"long_name": "1 = measured, 0 = interpolated"}),
        ("interpol_flag", {"flag_values": np.array([0, 1], "u1"), "flag_meanings": "interpolated measured"}),
        ("not_interpolated", {}),
    ],
)
def test_what_a_flag_says_of_its_values_counts(tmp_path: Path, name: str, attributes: dict[str, object]) -> None:
    measured = RANDOM.random((200, 8)) < 0.9
    given = spectrum().assign({name: (("time", "frequency"), measured.astype("u1"), attributes)})

    (read,) = open_spectra(written(tmp_path, lambda _: given))

    np.testing.assert_array_equal(np.isfinite(read["intensity"]), measured)
    assert "bella_named" not in given[name].attrs


def test_a_sample_without_a_time_has_that_of_its_record(tmp_path: Path) -> None:
    times = TIME[:, None] + np.arange(8) * SECOND
    times[7, 3] = np.datetime64("NaT")

    (read,) = open_spectra(written(tmp_path, lambda one: one.assign(sample_time=(("time", "frequency"), times))))

    assert sample_times(read).to_numpy()[7, 3] == TIME[7]


@pytest.mark.parametrize(("unit", "factor"), [("km", 1.0), ("AU", 149_597_870.7), ("m", 1e-3), ("Rsun", 695_700.0)])
def test_positions_may_be_in_other_units_and_stated_once(tmp_path: Path, unit: str, factor: float) -> None:
    where = xr.DataArray(np.array([1.4e8, 2e7, 0.0]) / factor, dims="axis", attrs={"frame": "HEE ", "units": unit})

    (read,) = open_spectra(written(tmp_path, lambda one: one.assign(position_km=where)))

    np.testing.assert_allclose(read["position_km"], np.broadcast_to([1.4e8, 2e7, 0.0], (200, 3)))
    assert read["position_km"].attrs["frame"] == "hee"


# years apart


def later(one: xr.Dataset, days: float) -> xr.Dataset:
    return one.assign_coords(time=one["time"] + np.timedelta64(round(days * 86_400), "s"))


def read_spectrum(folder: Path) -> xr.Dataset:
    (read,) = open_spectra(written(folder, lambda one: one))
    return read


@pytest.mark.parametrize(("apart_days", "pieces"), [(0.5, 1), (0.99, 1), (1.5, 2), (3000, 2)])
def test_a_fleet_is_cut_at_gaps_of_more_than_a_day(tmp_path: Path, apart_days: float, pieces: int) -> None:
    one = read_spectrum(tmp_path)
    other = later(one, apart_days + 199 / 1440)

    for given in ([other, one], [xr.concat([one, other], "time", combine_attrs="override")]):
        found, left_out = fleet_pieces(given)

        assert len(found) == pieces
        assert not left_out
        assert sum(part.spectra["STEREO-A"].sizes["time"] for part in found) == 400


def test_another_spacecraft_may_bridge_a_gap(tmp_path: Path) -> None:
    one = read_spectrum(tmp_path)
    bridge = later(one, 1.0).assign_attrs(observatory="WIND")

    found, _ = fleet_pieces([one, later(one, 2.0), bridge])

    assert [set(part.spectra) for part in found] == [{"STEREO-A", "WIND"}]


def test_a_single_record_far_away_is_left_out_and_named(tmp_path: Path) -> None:
    one = read_spectrum(tmp_path)
    stray = xr.concat([one, later(one.isel(time=[0]), 900)], "time", combine_attrs="override")

    found, left_out = fleet_pieces([stray])

    assert len(found) == 1
    assert left_out == ("mine.nc: a single record of 2014-11-24T00:00:30",)


# folders


def test_a_folder_says_what_it_does_not_read(tmp_path: Path) -> None:
    written(tmp_path, lambda one: one, "spectrum.h5")
    written(tmp_path, lambda one: later(one, 365), "without_ending")
    (tmp_path / "callisto.fit").write_bytes(b"SIMPLE  =                    T")
    (tmp_path / "day.dat").write_bytes(b"\x00\x01" * 40)
    (tmp_path / "unknown").write_bytes(b"\x00\x01" * 40)
    (tmp_path / "README.md").write_text("what this is")
    (tmp_path / "plot.png").write_bytes(b"\x89PNG\r\n\x1a\n\x00\x00")
    (tmp_path / "more").mkdir()
    (tmp_path / "more" / "circle").symlink_to(tmp_path)

    folder = user_days(tmp_path)

    assert [day.isoformat() for day in folder.days] == ["2012-06-07", "2013-06-07"]
    assert sorted(one.split(str(tmp_path) + "/")[1].split()[0] for one in folder.left_out) == [
        "callisto.fit",
        "day.dat",
        "unknown",
    ]
    assert sorted(folder.others) == ["README.md", "plot.png"]


def test_days_without_records_between_two_are_none(tmp_path: Path) -> None:
    written(tmp_path, lambda one: xr.concat([one, later(one, 3000)], "time", combine_attrs="override"))

    folder = user_days(tmp_path)

    assert [day.isoformat() for day in folder.days] == ["2012-06-07", "2020-08-24"]
    assert all(folder.read(day).spectra["STEREO-A"].sizes["time"] == 200 for day in folder.days)


def test_results_in_a_folder_of_spectra_are_not_looked_at(tmp_path: Path) -> None:
    written(tmp_path, lambda one: one)
    home = tmp_path / "bella-home"
    (home / "store").mkdir(parents=True)
    (home / "catalogue.sqlite").write_bytes(b"SQLite format 3\0")
    (home / "store" / "draws.nc").write_bytes(b"CDF\x01 and so on")

    found = user_days(tmp_path)

    assert [one.path.name for one in found.files] == ["mine.nc"]
    assert (found.left_out, found.others) == ((), ())


def test_a_leap_second_is_a_time(tmp_path: Path) -> None:
    text = [f"2012-06-30T23:59:{second}Z" for second in ("58", "59", "60.250")] + ["2012-07-01T00:00:01Z"]
    (read,) = open_spectra(
        written(tmp_path, lambda one: raw_times(np.array(text, dtype=object))(one.isel(time=slice(0, 4))))
    )

    np.testing.assert_allclose(
        (read["time"].to_numpy() - np.datetime64("2012-07-01")) / SECOND, [-2.0, -1.0, 0.25, 1.0]
    )


def test_wind_near_earth_is_a_position() -> None:
    near = spectrum().assign(position_km=("axis", [3e4, 0.0, 0.0], {"frame": "gse"}))

    assert as_spectrum(near, "x")["position_km"].shape == (200, 3)
