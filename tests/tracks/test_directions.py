"""Wave directions: read, placed, turned into angles, and taken from a spectrum at the peak of its flux."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from scipy.stats import multivariate_normal

from bella.exceptions import InputError
from bella.spectra import open_spectra
from bella.tracks.directions import DirectionTerms, check_directions, direction_terms, read_directions, wave_directions

SOURCE_RSUN = np.array([40.0, -7.8, 0.0])
EPOCH = np.datetime64("2012-06-07T19:00", "ns")
PLACED = pd.DataFrame({"observatory": ["A", "A"], "x_rsun": [200.0, 210.0], "y_rsun": [0.0, 0.0], "z_rsun": [1.0, 3.0]})
TABLE = pd.DataFrame(
    {"observatory": ["A"], "frequency_mhz": [0.5], "longitude_deg": [-170.0], "latitude_deg": [4.0], "sigma_deg": [3.0]}
)


def test_residual_is_the_angle_over_its_error() -> None:
    """The source of 0.55 MHz is at 40 solar radii; directions turned by known angles, small and large."""
    frequency, source = np.full(4, 0.55), np.tile(SOURCE_RSUN, (4, 1))
    place = np.tile([215.0, 0.0, 0.0], (4, 1))
    sight = source - place
    longitude = np.arctan2(sight[:, 1], sight[:, 0]) + np.radians([0.0, 5.0, 120.0, -5.0])
    towards = np.stack([np.cos(longitude), np.sin(longitude), np.zeros(4)], axis=1)
    residual = DirectionTerms(frequency, place, towards, np.full(4, 2.5)).residual(source[None])[0].reshape(4, 2)
    np.testing.assert_allclose(np.abs(residual[:, 0]), [0.0, 2.0, 48.0, 2.0], atol=1e-6)
    np.testing.assert_allclose(residual[:, 1], 0.0, atol=1e-6)
    assert residual[1, 0] * residual[3, 0] < 0


def test_colatitude_and_azimuth_are_the_same_direction() -> None:
    turned = TABLE.assign(azimuth_deg=190.0, colatitude_deg=86.0).drop(columns=["longitude_deg", "latitude_deg"])
    ours, theirs = (direction_terms(check_directions(one), PLACED, EPOCH) for one in (TABLE, turned))
    np.testing.assert_allclose(ours.towards, theirs.towards, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(ours.towards, axis=1), 1.0)


def test_receivers_are_placed_by_the_row_then_the_arrivals_then_the_ephemeris() -> None:
    rows = pd.concat([TABLE, TABLE, TABLE.assign(observatory="STEREO-A")], ignore_index=True)
    table = check_directions(
        rows.assign(x_rsun=[100.0, np.nan, np.nan], y_rsun=[0.0, np.nan, np.nan], z_rsun=[0.0, np.nan, np.nan])
    )
    place = direction_terms(table, PLACED, EPOCH).receiver_rsun
    np.testing.assert_allclose(place[:2], [[100.0, 0.0, 0.0], [205.0, 0.0, 2.0]])
    assert 200 < np.linalg.norm(place[2]) < 215
    with pytest.raises(InputError, match="add the columns x_rsun"):
        direction_terms(check_directions(TABLE.assign(observatory="nobody")), PLACED, EPOCH)


def test_the_floor_of_one_direction_adds_in_quadrature() -> None:
    source, table = SOURCE_RSUN[None, None], check_directions(TABLE)
    floor = direction_terms(table, PLACED, EPOCH, 4.0)
    wider = direction_terms(table.assign(sigma_deg=5.0), PLACED, EPOCH)
    assert floor.total_deg == pytest.approx([5.0])
    np.testing.assert_allclose(floor.residual(source), wider.residual(source))
    assert floor.log_norm == pytest.approx(wider.log_norm)
    with pytest.raises(InputError, match="give degrees"):
        direction_terms(check_directions(TABLE), PLACED, EPOCH, -1.0)


def test_what_directions_of_a_spacecraft_share_has_the_likelihood_of_their_covariance() -> None:
    """The density of Gaussians whose covariance is written out, of two spacecraft with two and three directions."""
    names, sigma = ["A", "B", "A", "B", "B"], np.array([1.0, 2.0, 3.0, 1.5, 2.5])
    table = check_directions(
        pd.DataFrame(
            {
                "observatory": names,
                "frequency_mhz": np.linspace(0.3, 1.0, 5),
                "longitude_deg": [-174.0, 178.0, 170.0, -170.0, 176.0],
                "latitude_deg": [1.0, -2.0, 3.0, 0.0, 2.0],
                "sigma_deg": sigma,
                "x_rsun": 215.0,
                "y_rsun": [0.0, 40.0, 0.0, 40.0, 40.0],
                "z_rsun": 0.0,
            }
        )
    )
    source = np.tile(SOURCE_RSUN, (1, 5, 1))
    alone, shared = (direction_terms(table, PLACED, EPOCH, floor) for floor in (0.0, 2.0))
    angle = alone.residual(source)[0].reshape(5, 2) * np.radians(sigma)[:, None]
    same = np.array(names)[:, None] == np.array(names)
    covariance = np.radians(1.0) ** 2 * (np.diag(sigma**2) + 2.0**2 * same)
    expected = sum(multivariate_normal(cov=covariance).logpdf(one) for one in angle.T)
    found = shared.log_norm - 0.5 * float((shared.residual(source) ** 2).sum())
    assert found == pytest.approx(expected)


def test_forty_directions_turned_alike_say_no_more_than_the_floor() -> None:
    frequency, source = np.full(40, 0.55), np.tile(SOURCE_RSUN, (40, 1))
    place = np.tile([215.0, 0.0, 0.0], (40, 1))
    longitude = np.arctan2(*(source - place)[:, [1, 0]].T) + np.radians(3.0)
    towards = np.stack([np.cos(longitude), np.sin(longitude), np.zeros(40)], axis=1)
    residual = DirectionTerms(frequency, place, towards, np.full(40, 1.0), 3.0).residual(source[None])
    assert (residual**2).sum() == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"sigma_deg": 0.0}, "row 1, column sigma_deg"),
        ({"sigma_deg": "wide"}, "row 1, column sigma_deg"),
        ({"latitude_deg": 91.0}, "row 1, column latitude_deg"),
        ({"frequency_mhz": np.nan}, "row 1, column frequency_mhz"),
    ],
)
def test_wrong_values_are_named(change: dict[str, object], words: str) -> None:
    with pytest.raises(InputError, match=words):
        check_directions(TABLE.assign(**change))


@pytest.mark.parametrize("column", ["observatory", "sigma_deg", "longitude_deg"])
def test_missing_columns_are_named(column: str) -> None:
    with pytest.raises(InputError, match=f"column {column} is missing"):
        check_directions(TABLE.drop(columns=column))


def test_a_table_of_no_rows_and_a_file_that_is_none_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="has 0 rows"):
        check_directions(TABLE.iloc[:0])
    path = tmp_path / "directions.csv"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="line 1 is not text in UTF-8"):
        read_directions(path)
    path.write_text("# nothing\n")
    with pytest.raises(InputError, match="is not a CSV table"):
        read_directions(path)


def spectrum(
    longitude_deg: float, scatter_deg: float, rng: np.random.Generator, observatory: str = "STEREO-A"
) -> xr.Dataset:
    """A burst of ten minutes in two channels, whose direction is right near the peak and wrong elsewhere."""
    time = EPOCH + np.arange(120) * np.timedelta64(30, "s")
    flux = np.exp(-0.5 * ((np.arange(120) - 60) / 8) ** 2)[:, None] * np.array([1.0, 2.0]) + 1e-4
    azimuth = np.where(flux > 0.4 * flux.max(axis=0), longitude_deg, longitude_deg + 90)
    azimuth = azimuth + scatter_deg * rng.standard_normal(flux.shape)
    colatitude = 88.0 + scatter_deg * rng.standard_normal(flux.shape)
    grid = ("time", "frequency")
    return xr.Dataset(
        {
            "intensity": (grid, flux),
            "wave_azimuth_hee_deg": (grid, azimuth),
            "wave_colatitude_hee_deg": (grid, colatitude),
        },
        {"time": time, "frequency": [0.3, 0.5]},
        {"observatory": observatory},
    )


WINDOW = EPOCH, EPOCH + np.timedelta64(1, "h")


@pytest.mark.parametrize(("observatory", "longitude_deg"), [("STEREO-A", -50.0), ("WIND", 179.5)])
def test_direction_at_the_peak_with_its_scatter(observatory: str, longitude_deg: float) -> None:
    """At that time the Sun is towards -63 degrees for STEREO-A, towards 180 degrees for Wind."""
    table = wave_directions(spectrum(longitude_deg, 2.0, np.random.default_rng(5), observatory), WINDOW)
    assert list(table["frequency_mhz"]) == [0.3, 0.5]
    assert set(table["observatory"]) == {observatory}
    away = (table["longitude_deg"] - longitude_deg + 180) % 360 - 180
    assert (away.abs() < 2.5).all()
    assert ((table["latitude_deg"] - 2.0).abs() < 2.5).all()
    assert table["sigma_deg"].between(1.2, 2.8).all()
    assert (table["samples"] >= 15).all()
    assert not table.attrs["turned"]
    check_directions(table)


def test_scatter_is_that_of_one_of_two_components() -> None:
    stated = [
        float(sigma)
        for seed in range(20)
        for sigma in wave_directions(spectrum(-50.0, 2.0, np.random.default_rng(seed)), WINDOW)["sigma_deg"]
    ]
    assert np.sqrt(np.mean(np.square(stated))) == pytest.approx(2.0, rel=0.08)


def test_a_second_burst_has_no_say() -> None:
    """As high as three quarters of the first, from elsewhere, and apart from it."""
    two = spectrum(-50.0, 1.0, np.random.default_rng(5))
    two["intensity"][95:105] += 0.75 * two["intensity"].max(axis=0).to_numpy()
    two["wave_azimuth_hee_deg"][95:105] = 0.0
    assert ((wave_directions(two, WINDOW)["longitude_deg"] + 50.0).abs() < 1.5).all()


def test_wave_vectors_are_turned_towards_the_source() -> None:
    ours = wave_directions(spectrum(-50.0, 2.0, np.random.default_rng(5)), WINDOW)
    given = spectrum(-50.0, 2.0, np.random.default_rng(5))
    given["wave_azimuth_hee_deg"] += 180.0
    given["wave_colatitude_hee_deg"] = 180.0 - given["wave_colatitude_hee_deg"]
    turned = wave_directions(given, WINDOW)
    assert turned.attrs["turned"]
    pd.testing.assert_frame_equal(turned, ours)


def test_a_channel_without_a_burst_has_no_direction() -> None:
    quiet = spectrum(-50.0, 1.0, np.random.default_rng(5))
    quiet["intensity"][:, 0] += 10.0
    assert list(wave_directions(quiet, WINDOW)["frequency_mhz"]) == [0.5]


def test_directions_of_wind_point_to_the_beam_on_its_way(reference_files: Path) -> None:
    """The archive file of 2020-07-11: near the Sun at 1 MHz, west of it and farther at each lower frequency."""
    (seen,) = open_spectra(reference_files / "l7aler/wi_wa_rad1_l3_df_20200711_v01.cdf")
    table = wave_directions(seen, (np.datetime64("2020-07-11T02:24"), np.datetime64("2020-07-11T03:10")))
    west = 180.0 - table.set_index("frequency_mhz")["longitude_deg"]
    assert west.index[-1] == pytest.approx(1.04)
    assert west.iloc[-1] == pytest.approx(4.4, abs=1.0)
    assert west[west.index > 0.4].is_monotonic_decreasing
    assert west[(west.index > 0.2) & (west.index < 0.5)].between(11.0, 15.5).all()
    assert table["latitude_deg"].between(-1.0, 6.0).all()
    assert (table["sigma_deg"] < 6.0).all()
    assert table["frequency_mhz"].min() > 0.15
    assert not table.attrs["turned"]


def test_channels_of_too_few_samples_are_left_out() -> None:
    holes = spectrum(20.0, 1.0, np.random.default_rng(5))
    holes["wave_azimuth_hee_deg"][:, 0] = np.nan
    assert list(wave_directions(holes, WINDOW)["frequency_mhz"]) == [0.5]


def test_spectra_without_directions_or_samples_are_refused() -> None:
    whole = spectrum(20.0, 1.0, np.random.default_rng(5))
    with pytest.raises(InputError, match="take STEREO L3"):
        wave_directions(whole.drop_vars("wave_azimuth_hee_deg"), WINDOW)
    with pytest.raises(InputError, match="fewer than 3 samples"):
        wave_directions(whole, (WINDOW[1] + np.timedelta64(1, "D"), WINDOW[1] + np.timedelta64(2, "D")))
