"""The grid of the search: means of what was measured, at its time, without columns that are no bursts."""

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

from bella.bursts.matched_filter import (
    BEAM_SPEEDS_C,
    CHANNELS,
    EDGES_MHZ,
    FREQUENCY_MHZ,
    THRESHOLDS,
    SearchGrid,
    channel_match,
    drift_delays_s,
    drift_match,
    over_quiet,
    search_grid,
)
from bella.spectra.assembly import Origin, assemble

START = np.datetime64("2020-07-21T00:00", "ns")
NOISE_DB = 0.5
MINUTES = 600


def quiet(minutes: int = MINUTES, cadence_s: float = 60.0, mhz: np.ndarray = FREQUENCY_MHZ) -> xr.Dataset:
    """Noise about 0 dB, one channel in every cell of the grid."""
    records = int(minutes * 60 / cadence_s)
    time = START + ((np.arange(records) + 0.5) * cadence_s * 1e9).astype("timedelta64[ns]")
    noise = np.random.default_rng(4).normal(0.0, NOISE_DB, (records, mhz.size)).astype(np.float32)
    return assemble(Origin("TEST", "grid", "db_over_background", "none"), time, mhz, noise, {})


def grid_of(spectrum: xr.Dataset) -> SearchGrid:
    return search_grid(over_quiet(spectrum))


def with_column(spectrum: xr.Dataset, records: slice, channels: slice, height_db: float = 10.0) -> xr.Dataset:
    intensity = spectrum["intensity"].copy()
    intensity[records, channels] += height_db
    return spectrum.assign(intensity=intensity)


def test_grid_covers_the_band_of_bursts() -> None:
    assert (EDGES_MHZ[0], EDGES_MHZ[-1]) == pytest.approx((0.1, 14.0))
    assert FREQUENCY_MHZ.shape == (CHANNELS,)
    np.testing.assert_allclose(np.diff(np.log(FREQUENCY_MHZ)), np.log(140.0) / CHANNELS)


def test_every_record_is_in_its_minute() -> None:
    grid = grid_of(quiet())

    assert grid.excess_db.shape == (MINUTES, CHANNELS)
    assert grid.start == quiet()["time"].to_numpy()[0].astype("datetime64[m]")


def test_noise_is_that_of_the_quiet_minutes_and_never_less_than_the_least() -> None:
    noise = grid_of(quiet()).noise_db

    assert np.median(noise) == pytest.approx(0.67 * NOISE_DB, rel=0.15)  # of medians of three channels
    still = quiet()
    np.testing.assert_array_equal(
        grid_of(still.assign(intensity=still["intensity"] * 0.0)).noise_db, THRESHOLDS.noise_db
    )


@pytest.mark.parametrize("cadence_s", [7.0, 16.0, 60.0])
def test_cadence_does_not_move_a_rise(cadence_s: float) -> None:
    spectrum = quiet(cadence_s=cadence_s)
    is_late = (spectrum["time"].to_numpy() - START) >= np.timedelta64(300 * 60, "s")
    is_late &= (spectrum["time"].to_numpy() - START) < np.timedelta64(330 * 60, "s")
    grid = grid_of(spectrum.assign(intensity=spectrum["intensity"] + 10.0 * is_late[:, None].astype(np.float32)))

    high = np.flatnonzero(np.median(grid.excess_db, axis=1) > 5.0)
    assert (high[0], high[-1]) == pytest.approx((300, 329), abs=1)


def test_samples_of_a_sweep_are_at_their_own_times() -> None:
    offset_s = np.linspace(-120.0, 120.0, CHANNELS)
    spectrum = quiet().assign(sample_offset_s=("frequency", offset_s))
    spectrum = with_column(spectrum, slice(300, 330), slice(None))
    rise = np.argmax(grid_of(spectrum).excess_db > 5.0, axis=0)

    np.testing.assert_allclose(rise, 300 + offset_s / 60.0, atol=1.01)


@pytest.mark.parametrize("minutes", [1, 2])
def test_a_calibration_column_goes(minutes: int) -> None:
    grid = grid_of(with_column(quiet(), slice(300, 300 + minutes), slice(None)))

    assert np.isnan(grid.excess_db[300 : 300 + minutes]).all()
    assert np.isfinite(np.delete(grid.excess_db, [300, 301], axis=0)).all()


def test_a_column_at_high_frequencies_stays() -> None:
    """There, bursts last no longer."""
    grid = grid_of(with_column(quiet(), slice(300, 301), slice(30, None)))

    assert np.median(grid.excess_db[300, 31:]) > 8.0


def test_a_single_disturbed_channel_goes() -> None:
    grid = grid_of(with_column(quiet(), slice(200, 300), slice(20, 21)))

    assert np.abs(grid.excess_db[200:300]).max() < 4.0


@settings(max_examples=15)
@given(st.sets(st.integers(0, CHANNELS - 1), min_size=1, max_size=CHANNELS))
def test_channels_without_data_have_neither_values_nor_noise(dead: set[int]) -> None:
    spectrum = quiet(minutes=90)
    intensity = spectrum["intensity"].to_numpy().copy()
    intensity[:, list(dead)] = np.nan
    grid = grid_of(spectrum.assign(intensity=(("time", "frequency"), intensity)))

    expected = np.isin(np.arange(CHANNELS), list(dead))
    np.testing.assert_array_equal(np.isnan(grid.noise_db), expected)
    np.testing.assert_array_equal(np.isnan(grid.excess_db).all(axis=0), expected)


def test_channels_outside_the_grid_do_not_count() -> None:
    outside = quiet(minutes=90, mhz=np.array([0.01, 0.05, 15.0, 19.0]))

    assert np.isnan(grid_of(outside).excess_db).all()


def test_match_of_noise_has_unit_scatter() -> None:
    noise = np.random.default_rng(5).normal(0.0, 1.0, (5000, CHANNELS))
    match = channel_match(noise, np.ones(CHANNELS))

    assert np.nanstd(match) == pytest.approx(1.0, abs=0.05)
    assert np.nanmean(match) == pytest.approx(0.0, abs=0.05)


def test_match_does_not_look_at_what_comes_before_its_minutes() -> None:
    noise = np.random.default_rng(5).normal(0.0, 1.0, (400, CHANNELS))
    later = noise.copy()
    later[:100] += 50.0

    with_past, without = (channel_match(one, np.ones(CHANNELS))[110:] for one in (later, noise))
    np.testing.assert_allclose(with_past, without, equal_nan=True, atol=1e-9)


def test_best_drift_is_that_of_the_beam() -> None:
    """A train of rises along the delays of a beam is recognised as that beam, at its minute."""
    delays = drift_delays_s()
    for drift in range(len(BEAM_SPEEDS_C)):
        match = np.zeros((600, CHANNELS))
        match[200 + np.rint(delays[drift] / 60.0).astype(int), np.arange(CHANNELS)] = 10.0
        score = drift_match(match).score
        assert np.unravel_index(score.argmax(), score.shape) == (drift, 200)


def test_beams_that_leave_the_sun_reach_low_frequencies_later() -> None:
    delays = drift_delays_s()[: len(BEAM_SPEEDS_C)]

    assert delays.shape[1] == CHANNELS
    assert (np.diff(delays, axis=1) < 0.0).all()  # the highest frequency comes first
    assert (np.diff(delays[:, 0]) < 0.0).all()  # the fastest beam arrives first
    np.testing.assert_array_equal(delays[:, -1], 0.0)


def test_a_grid_without_records_of_bursts_has_a_score_of_zero() -> None:
    empty = SearchGrid(START, np.full((30, CHANNELS), np.nan), np.full(CHANNELS, np.nan))
    found = drift_match(channel_match(empty.excess_db, empty.noise_db))

    assert (found.score == 0.0).all()
    assert not found.hit.any()
    assert not found.measured.any()


def test_beams_slow_down_as_they_were_measured_to() -> None:
    """Travel of the beam between the first and last channel, summed over small steps at 0.15 c (r / 10)^-0.37."""
    from bella.heliosphere import DENSITY_MODELS, emission_range_rsun

    inner, outer = emission_range_rsun(FREQUENCY_MHZ[[-1, 0]], DENSITY_MODELS["leblanc"], 2)
    path = np.linspace(inner, outer, 20001)
    middle, step = 0.5 * (path[1:] + path[:-1]), np.diff(path)
    drift = 5
    travel_s = float((step / (BEAM_SPEEDS_C[drift] * 0.430862 * (middle / 10.0) ** -0.37)).sum())
    assert drift_delays_s()[drift, 0] == pytest.approx(travel_s, rel=1e-3)
