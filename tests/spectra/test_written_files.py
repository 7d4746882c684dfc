"""Readers on files written to the layouts of the archives, for products of which no archive file is at hand."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from bella.exceptions import InputError
from bella.simulation import archive_files
from bella.spectra import find_product, open_spectra, sample_times
from tests.spectra import written

SECOND = np.timedelta64(10**9, "ns")
START = np.datetime64("2020-07-11T00:00:11", "ns")
RANDOM = np.random.default_rng(20200711)


def values(records: int, channels: int, scale: float = 1.0) -> np.ndarray:
    return (RANDOM.uniform(0.5, 2.0, (records, channels)) * scale).astype(np.float32)


def minutes(day: str, number: int = 1440) -> np.ndarray:
    return np.datetime64(day, "ns") + np.arange(number) * 60 * SECOND + 30 * SECOND


def only(path: Path) -> xr.Dataset:
    (spectrum,) = open_spectra(path)
    return spectrum


def test_wind_h1_flags_interpolated_channels_and_has_no_zeros(tmp_path: Path) -> None:
    sizes = {"RAD1": 256, "RAD2": 256, "TNR": 96}
    ratio = {name: values(1440, size) for name, size in sizes.items()}
    ratio["RAD1"][7] = np.nan
    measured = {name: np.arange(size) % 8 == 0 for name, size in sizes.items()}

    rad1, _, _ = open_spectra(
        archive_files.write_wind_h1(tmp_path / "wi_h1_wav_20120607_v01.cdf", minutes("2012-06-07"), ratio, measured)
    )

    np.testing.assert_array_equal(rad1["intensity"], ratio["RAD1"])
    np.testing.assert_array_equal(rad1["interpolated"], ~measured["RAD1"])
    np.testing.assert_array_equal(rad1["time"], minutes("2012-06-07"))


def test_wind_l2_drops_columns_without_data_and_is_no_civil_day(tmp_path: Path) -> None:
    utc = START + np.arange(300) * np.timedelta64(16_300, "ms")
    frequency_hz = np.geomspace(20e3, 1040e3, 32)[::-1]
    density = values(300, 32, 1e-15)
    density[5, 3] = np.nan

    spectrum = only(
        archive_files.write_wind_l2(tmp_path / "wi_l2_wav_rad1_20200711_v01.cdf", utc, frequency_hz, density)
    )

    assert (spectrum.attrs["receiver"], spectrum.attrs["quantity"]) == ("RAD1", "psd_v2_hz")
    np.testing.assert_array_equal(spectrum["time"], utc)
    np.testing.assert_allclose(spectrum["frequency"], frequency_hz[::-1] * 1e-6, rtol=1e-6)
    np.testing.assert_array_equal(spectrum["intensity"], density[:, ::-1])
    assert spectrum.attrs["integration_s"] == pytest.approx(16.3 / 32, rel=1e-3)


def test_wind_k0_is_decibel_over_background(tmp_path: Path) -> None:
    utc = START + np.arange(480) * 180 * SECOND
    decibel = values(480, 76, 10.0)

    spectrum = only(archive_files.write_wind_k0(tmp_path / "wi_k0_wav_20200711_v01.cdf", utc, decibel))

    np.testing.assert_array_equal(spectrum["intensity"], decibel)
    np.testing.assert_allclose(spectrum["frequency"][[0, -1]], [0.004, 13.8], rtol=1e-6)
    np.testing.assert_array_equal(spectrum["time"], utc)


@pytest.mark.parametrize(
    ("unit", "quantity", "factor"), [(2, "psd_v2_hz", 1.0), (3, "psd_v2_hz", 1e-12), (4, "flux_w_m2_hz", 1e-22)]
)
def test_wind_60s_binary_is_converted_by_its_unit_code(tmp_path: Path, unit: int, quantity: str, factor: float) -> None:
    khz, mean = np.geomspace(20, 1040, 32), values(100, 32)
    path = tmp_path / "wi_wa_rad1_l2_60s_20120607_v01.dat"

    spectrum = only(written.write_wind_60s(path, minutes("2012-06-07", 100), khz, mean, unit))

    assert spectrum.attrs["quantity"] == quantity
    np.testing.assert_allclose(spectrum["intensity"], mean * factor, rtol=1e-6)
    np.testing.assert_allclose(spectrum["frequency"], khz * 1e-3, rtol=1e-6)
    np.testing.assert_array_equal(spectrum["time"], minutes("2012-06-07", 100))
    np.testing.assert_allclose(spectrum.attrs["position_gse_re"], [200.0, -30.0, 5.0])


def test_telemetry_volts_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "wi_wa_rad1_l2_60s_20120607_v01.dat"
    written.write_wind_60s(path, minutes("2012-06-07", 3), np.array([20.0, 24.0]), values(3, 2), unit=1)

    with pytest.raises(InputError, match=r"units \[1\]"):
        open_spectra(path)


@pytest.mark.parametrize(
    ("name", "receiver", "last_mhz"), [("wind_waves_rad1_20120607.R1", "RAD1", 1.04), ("20120607.R2", "RAD2", 13.825)]
)
def test_wind_idl_save_set_has_agreed_frequencies(tmp_path: Path, name: str, receiver: str, last_mhz: float) -> None:
    ratio, background = values(1440, 256), np.where(np.arange(256) % 8 == 0, 0.4, 0.0)
    ratio[3] = np.nan

    spectrum = only(written.write_wind_idl(tmp_path / name, ratio, background))

    assert spectrum.attrs["receiver"] == receiver
    assert spectrum["frequency"][-1] == pytest.approx(last_mhz)
    np.testing.assert_array_equal(spectrum["intensity"], ratio)
    np.testing.assert_array_equal(spectrum["interpolated"], background == 0.0)
    np.testing.assert_array_equal(spectrum["time"], minutes("2012-06-07"))


def test_stereo_level_2_picks_one_channel_where_bands_overlap(tmp_path: Path) -> None:
    decibel = {"ahead": values(1440, 367, 20.0), "behind": np.full((1440, 367), np.nan)}
    decibel["ahead"][9] = np.nan
    path = tmp_path / "stereo_level2_swaves_20150101_v02.cdf"

    ahead = only(archive_files.write_stereo_level2(path, minutes("2015-01-01"), decibel))

    kept = np.delete(np.arange(367), 48)  # the HFR's 125 kHz, among three channels of the LFR
    np.testing.assert_array_equal(ahead["intensity"], decibel["ahead"][:, kept])
    assert ahead["frequency"].sel(frequency=0.125, method="nearest") != pytest.approx(0.125, abs=1e-4)


def test_stereo_level_2_may_lack_a_spacecraft(tmp_path: Path) -> None:
    path = tmp_path / "stereo_level2_swaves_20160101_v02.cdf"
    archive_files.write_stereo_level2(path, minutes("2016-01-01"), {"ahead": values(1440, 367)})
    assert only(path).attrs["observatory"] == "STEREO-A"

    archive_files.write_stereo_level2(path, minutes("2016-01-01"), {"ahead": np.full((1440, 367), np.nan)})
    with pytest.raises(InputError, match="no data of either spacecraft"):
        open_spectra(path)


@pytest.mark.parametrize(
    ("name", "observatory", "receiver"), [("sta_l3_wav_hfr", "STEREO-A", "HFR"), ("stb_l3_wav_lfr", "STEREO-B", "LFR")]
)
def test_stereo_l3_reads_the_unit_of_frequency(tmp_path: Path, name: str, observatory: str, receiver: str) -> None:
    utc = START + np.arange(200) * np.timedelta64(38_820, "ms")
    frequency_hz, flux = np.linspace(125e3, 16.025e6, 319), values(200, 319, 1e-19)
    flux[4, 5], flux[6] = -1e-21, np.nan

    angles = np.broadcast_to(np.linspace(0, 90, 319), flux.shape)
    path = tmp_path / f"{name}_20200711_v01.cdf"

    beside = archive_files.Beside({"WAVE_AZIMUTH_HEE": angles})
    spectrum = only(archive_files.write_stereo_l3(path, utc, frequency_hz, flux, beside))

    assert (spectrum.attrs["observatory"], spectrum.attrs["receiver"]) == (observatory, receiver)
    np.testing.assert_array_equal(spectrum["intensity"], flux)
    np.testing.assert_allclose(spectrum["frequency"], frequency_hz * 1e-6, rtol=1e-6)
    np.testing.assert_array_equal(spectrum["time"], utc)
    np.testing.assert_allclose(spectrum["wave_azimuth_hee_deg"][0], np.linspace(0, 90, 319), rtol=1e-6)
    assert np.isnan(spectrum["wave_colatitude_hee_deg"]).all()


@pytest.mark.parametrize("name", ["swaves_average_20120607_a_lfr.dat", "stereo-a_swaves_lfr_average_20120607_v01.txt"])
def test_stereo_text_labels_become_centres_and_columns_may_touch(tmp_path: Path, name: str) -> None:
    khz, background = np.geomspace(2.6, 153.4, 48), np.linspace(6.0, 120.0, 48)
    decibel = np.round(values(1440, 48, 20.0).astype(np.float64), 3)
    decibel[11] = np.nan
    decibel[12, 1:3] = 1234.567

    spectrum = only(written.write_stereo_text(tmp_path / name, khz, background, decibel))

    assert spectrum.attrs["observatory"] == "STEREO-A"
    np.testing.assert_allclose(spectrum["intensity"], decibel, atol=1e-3)
    np.testing.assert_array_equal(spectrum["time"], minutes("2012-06-07"))
    np.testing.assert_allclose(spectrum["frequency"], khz * 1e-3, atol=6e-5)


@pytest.mark.parametrize("band", ["lfr", "hfr"])
def test_psp_l2_sums_the_dipoles(tmp_path: Path, band: str) -> None:
    utc = START + np.cumsum(RANDOM.choice([6990, 55_920], 150)).astype("timedelta64[ms]")
    frequency_hz, first, second = np.geomspace(10.5e3, 1.69e6, 64), values(150, 64, 1e-15), values(150, 64, 1e-15)
    first[3, 4] = np.nan
    path = tmp_path / f"psp_fld_l2_rfs_{band}_20200711_v03.cdf"

    spectrum = only(archive_files.write_psp_l2(path, utc, frequency_hz, {"ch0_V1V2": first, "ch1_V3V4": second}))

    np.testing.assert_allclose(spectrum["intensity"], first + second, rtol=1e-6)
    np.testing.assert_array_equal(spectrum["time"], utc)
    assert spectrum.attrs["dipoles"] == "V1V2+V3V4"
    assert spectrum.attrs["receiver"] == band.upper()


def test_psp_l2_with_one_dipole_says_so(tmp_path: Path) -> None:
    utc = START + np.arange(20) * 56 * SECOND
    path = tmp_path / "psp_fld_l2_rfs_lfr_20200711_v03.cdf"
    archive_files.write_psp_l2(path, utc, np.geomspace(10.5e3, 1.69e6, 64), {"ch1_V3V4": values(20, 64, 1e-15)})

    spectrum = only(path)
    assert spectrum.attrs["dipoles"] == "V3V4"
    # the square of what a record averages over is the mean of all that it may be, from none to the step of 56 s
    assert spectrum.attrs["integration_s"] ** 2 == pytest.approx(np.mean(np.linspace(0, 56, 1001) ** 2), rel=1e-3)


def test_psp_l2_doubles_what_one_dipole_read_alone(tmp_path: Path) -> None:
    utc, first = START + np.arange(20) * 56 * SECOND, values(20, 64, 1e-15)
    frequency_hz = np.geomspace(10.5e3, 1.69e6, 64)
    path = tmp_path / "psp_fld_l2_rfs_lfr_20200711_v03.cdf"
    second = np.full((20, 64), np.nan)
    second[::2] = 1e-15
    archive_files.write_psp_l2(path, utc, frequency_hz, {"ch0_V1V2": first, "ch1_V3V4": second})

    spectrum = only(path)

    expected = np.where((np.arange(20) % 2 == 0)[:, None], first + 1e-15, 2 * first)
    np.testing.assert_allclose(spectrum["intensity"], expected, rtol=1e-6)


def test_wind_l2_reads_lists_of_channels_that_change(tmp_path: Path) -> None:
    utc = START + np.arange(4) * 16 * SECOND
    frequency_hz = np.array([[100e3, 200e3], [100e3, 200e3], [200e3, 300e3], [200e3, 300e3]])
    path = tmp_path / "wi_l2_wav_rad2_20200711_v01.cdf"
    variables: list[archive_files.Variable] = [
        ("Epoch", archive_files.TT2000, archive_files.tt2000(utc), True, {}),
        ("FREQUENCY", archive_files.REAL4, frequency_hz.astype(np.float32), True, {}),
        ("PSD_V2_Z", archive_files.REAL4, np.arange(1.0, 9.0, dtype=np.float32).reshape(4, 2), True, {}),
    ]

    spectrum = only(archive_files.write_cdf(path, path.stem, variables))

    gap = np.nan
    np.testing.assert_allclose(spectrum["frequency"], [0.1, 0.2, 0.3])
    np.testing.assert_array_equal(spectrum["intensity"], [[1, 2, gap], [3, 4, gap], [gap, 5, 6], [gap, 7, 8]])


def test_psp_l3_reads_flux_on_the_axes_it_depends_on(tmp_path: Path) -> None:
    utc, flux = START + np.arange(90) * 7 * SECOND, values(90, 64, 1e-19)
    path = tmp_path / "psp_fld_l3_rfs_hfr_20200711_v02.cdf"

    spectrum = only(written.write_psp_l3(path, utc, np.geomspace(1.275e6, 19.17e6, 64), flux))

    assert spectrum.attrs["quantity"] == "flux_w_m2_hz"
    np.testing.assert_array_equal(spectrum["intensity"], flux)
    np.testing.assert_array_equal(spectrum["time"], utc)


def test_solo_l2_hfr_gives_every_sample_its_time(tmp_path: Path) -> None:
    khz, sweeps = np.array([1975.0, 425.0, 625.0, 3525.0, 10_025.0]), 40
    utc = START + np.arange(5 * sweeps) * np.timedelta64(700, "ms")
    utc = utc + np.repeat(np.arange(sweeps), 5) * 10 * SECOND
    sweep, density = np.repeat(np.arange(sweeps) % 7 + 65_530, 5), values(5 * sweeps, 1, 1e-14)[:, 0]
    density[8] = np.nan
    path = tmp_path / "solo_L2_rpw-hfr-surv_20200711_V01.cdf"

    spectrum = only(written.write_solo_l2_hfr(path, utc, np.tile(khz, sweeps), sweep, density))

    order = np.argsort(khz)
    assert spectrum.sizes == {"time": sweeps, "frequency": 5}
    np.testing.assert_allclose(spectrum["frequency"], khz[order] * 1e-3)
    np.testing.assert_array_equal(spectrum["intensity"], density.reshape(sweeps, 5)[:, order])
    known = spectrum["intensity"].notnull().to_numpy()
    np.testing.assert_array_equal(sample_times(spectrum).to_numpy()[known], utc.reshape(sweeps, 5)[:, order][known])


def test_solo_l2_tnr_makes_one_record_of_four_bands(tmp_path: Path) -> None:
    sweeps = 30
    utc = START + np.arange(4 * sweeps) * np.timedelta64(2500, "ms")
    density = values(4 * sweeps, 32, 1e-14)
    path = tmp_path / "solo_L2_rpw-tnr-surv_20200711_V01.cdf"
    sweep, band = np.repeat(np.arange(sweeps), 4), np.tile(np.arange(4), sweeps)

    spectrum = only(written.write_solo_l2_tnr(path, utc, sweep, band, density))

    np.testing.assert_array_equal(spectrum["intensity"], density.reshape(sweeps, 128))
    np.testing.assert_array_equal(sample_times(spectrum)[:, ::32], utc.reshape(sweeps, 4))
    np.testing.assert_allclose(spectrum["frequency"][[0, -1]], [0.003992, 0.978636], rtol=1e-3)


def test_solo_l3_adds_the_offset_of_the_channel(tmp_path: Path) -> None:
    utc, khz, flux = START + np.arange(60) * 17 * SECOND, np.linspace(425.0, 16_325.0, 50), values(60, 50, 1e-20)
    elapsed_s = np.broadcast_to(np.linspace(0.0, 16.0, 50)[::-1], flux.shape)
    interpolated = np.zeros(flux.shape, dtype=bool)
    interpolated[:, 7], interpolated[3, 9] = True, True
    path = tmp_path / "solo_L3_rpw-hfr-surv-flux_20200711_V01.cdf"

    spectrum = only(archive_files.write_solo_l3(path, archive_files.Sweeps(utc, elapsed_s), khz, flux, interpolated))

    np.testing.assert_array_equal(spectrum["interpolated"], np.arange(50) == 7)
    assert np.isnan(spectrum["intensity"][3, 9])
    assert int(spectrum["intensity"].isnull().sum()) == 1
    np.testing.assert_array_equal(spectrum["time"], utc + 8 * SECOND)
    offset_s = (sample_times(spectrum).to_numpy() - utc[:, None]) / SECOND
    np.testing.assert_allclose(offset_s, elapsed_s, atol=2e-6)


@pytest.mark.parametrize(
    "store",
    [
        lambda s, path: s.to_netcdf(path, engine="h5netcdf"),
        lambda s, path: s.assign_attrs(source_files="a.cdf").to_netcdf(path, engine="scipy"),
        lambda s, path: s.to_zarr(path, zarr_format=3),
        lambda s, path: s.to_zarr(path, zarr_format=2),
    ],
)
def test_the_documented_form_of_any_instrument_is_read(tmp_path: Path, store: Callable[..., object]) -> None:
    utc = START + np.arange(20) * 56 * SECOND
    path = tmp_path / "psp_fld_l2_rfs_lfr_20200711_v03.cdf"
    archive_files.write_psp_l2(path, utc, np.geomspace(10.5e3, 1.69e6, 64), {"ch1_V3V4": values(20, 64, 1e-15)})
    spectrum = only(path).assign_attrs(observatory="JUICE")
    store(spectrum, tmp_path / "mine")

    again = only(tmp_path / "mine")

    xr.testing.assert_equal(again, spectrum)
    assert again.attrs["observatory"] == "JUICE"
    assert again["intensity"].dtype == np.float32


@pytest.mark.parametrize(
    ("name", "product", "receiver"),
    [
        ("wi_h1_wav_20100117_v01.cdf", "Wind/WAVES H1", ""),
        ("WIN_RAD1_60S_20120607.B3E", "Wind/WAVES 60 s", "rad1"),
        ("solo_l3_rpw-tnr-surv-flux_20211009_v01.cdf", "Solar Orbiter RPW L3 flux", "tnr"),
        ("solo_L3_rpw-hfr-flux_20200711_V01.cdf", "Solar Orbiter RPW L3 flux", "hfr"),
        ("stb_l3_wav_lfr_20130101_v01.cdf", "STEREO/WAVES L3", "b_lfr"),
    ],
)
def test_products_are_known_by_name(name: str, product: str, receiver: str) -> None:
    found = find_product(name)

    assert found is not None
    assert (found[0].name, found[1]) == (product, receiver)


def test_a_binary_of_another_receiver_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "wi_wa_rad2_l2_60s_20120607_v01.dat"
    written.write_wind_60s(path, minutes("2012-06-07")[:9], np.geomspace(20, 1000, 32), np.ones((9, 32)), 2)

    with pytest.raises(InputError, match=r"named after RAD2, but holds 0.02 to 1 MHz"):
        open_spectra(path)


def test_a_binary_that_ends_within_a_record_says_so(tmp_path: Path) -> None:
    path = tmp_path / "wi_wa_rad1_l2_60s_20120607_v01.dat"
    written.write_wind_60s(path, minutes("2012-06-07")[:9], np.geomspace(20, 1000, 32), np.ones((9, 32)), 2)
    content = path.read_bytes()
    for size in (1, 30, 200):
        path.write_bytes(content[:-size])
        with pytest.raises(InputError, match=r"it ends within a record"):
            open_spectra(path)


def test_a_list_of_the_lower_receiver_under_the_name_of_the_upper_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "swaves_average_20120607_a_hfr.dat"
    written.write_stereo_text(path, np.geomspace(2.6, 153.4, 48), np.ones(48), np.ones((1440, 48)))

    with pytest.raises(InputError, match=r"reaches 153\.4, which in no unit is near the 16 MHz"):
        open_spectra(path)


def test_a_save_set_whose_name_has_two_receivers_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "wind_waves_rad2_20120607.R1"
    written.write_wind_idl(path, np.ones((1440, 256)), np.ones(256))

    with pytest.raises(InputError, match="no known product"):
        open_spectra(path)
