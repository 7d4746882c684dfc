"""The quiet level of a day: what must not lift it, and what must."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from bella.exceptions import InputError
from bella.spectra import decibels, over_background, quiet_level, validate_spectrum
from tests.spectra.real_day import stereo, wind

MINUTES, CHANNELS, NOISE_DB, QUIET_DB = 1440, 120, 0.4, 5.0
TIME = np.datetime64("2010-01-17T00:00:30", "ns") + np.arange(MINUTES) * np.timedelta64(60, "s")
BURST = slice(600, 660)
BURST_LIFT_DB, STORM_LIFT_DB = 0.25, 3.0
STEP_MINUTES = 20


def quiet_day(seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).normal(QUIET_DB, NOISE_DB, (MINUTES, CHANNELS))


def lift_db(added_db: np.ndarray) -> np.ndarray:
    """How much higher the level is for what was added to a quiet day."""
    noise = quiet_day()
    return quiet_level(noise + added_db, TIME).level_db - quiet_level(noise, TIME).level_db


def spectrum(intensity: np.ndarray, quantity: str, **attributes: object) -> xr.Dataset:
    return xr.Dataset(
        {"intensity": (("time", "frequency"), intensity.astype(np.float32))},
        coords={"time": TIME[: len(intensity)], "frequency": np.linspace(0.1, 10.0, intensity.shape[1])},
        attrs={
            "observatory": "TEST",
            "receiver": "noise",
            "quantity": quantity,
            "integration_s": 60.0,
            "source_files": "none",
            **attributes,
        },
    )


def test_constant_noise_is_at_zero_and_its_scatter_is_known() -> None:
    noise = quiet_day()
    found = quiet_level(noise, TIME)

    assert np.abs(np.median(noise - found.level_db, axis=0)).max() < 0.05
    assert np.abs(found.level_db - QUIET_DB).max() < 0.25
    np.testing.assert_allclose(found.noise_db, NOISE_DB, rtol=0.1)


@pytest.mark.parametrize("decay_min", [15.0, np.inf])
def test_a_burst_of_an_hour_does_not_lift_the_level(decay_min: float) -> None:
    burst = np.zeros((MINUTES, CHANNELS))
    burst[BURST] = 20.0 * np.exp(-np.arange(60.0) / decay_min)[:, np.newaxis]

    assert np.abs(lift_db(burst)).max() < BURST_LIFT_DB


@pytest.mark.parametrize("first", [0, 120, 240])
@pytest.mark.parametrize("strength_db", [3.0, 10.0, 30.0])
def test_a_storm_of_twenty_hours_lifts_the_level_by_less_than_three_db(first: int, strength_db: float) -> None:
    storm = np.zeros((MINUTES, CHANNELS))
    rng = np.random.default_rng(2)
    storm[first : first + 1200, :50] = strength_db + rng.normal(0.0, 1.0, (1200, 50))
    found = lift_db(storm)

    assert found[:, :50].max() < STORM_LIFT_DB
    assert np.abs(found[:, 50:]).max() < 1e-9


@pytest.mark.parametrize("step_db", [6.0, -6.0, 25.0])
@pytest.mark.parametrize("minute", [300, 700, 1100])
def test_a_step_of_the_gain_is_followed_within_twenty_minutes(step_db: float, minute: int) -> None:
    day = quiet_day() + np.where(np.arange(MINUTES) >= minute, step_db, 0.0)[:, np.newaxis]
    over = np.median(day - quiet_level(day, TIME).level_db, axis=1)

    wrong = np.flatnonzero(np.abs(over) > 0.5)
    assert wrong.size <= STEP_MINUTES
    assert np.abs(wrong - minute).max() <= STEP_MINUTES


def test_a_burst_is_not_taken_for_a_step_at_either_end_of_the_day() -> None:
    bursts = np.zeros((MINUTES, CHANNELS))
    bursts[:45] = bursts[-45:] = 15.0

    assert np.abs(lift_db(bursts)).max() < BURST_LIFT_DB


def test_a_slow_drift_is_followed() -> None:
    drift = 1.5 * np.sin(np.linspace(0.0, np.pi, MINUTES))[:, np.newaxis]

    over = quiet_day() + drift - quiet_level(quiet_day() + drift, TIME).level_db
    hourly = np.median(over.reshape(24, -1), axis=1)
    assert np.abs(hourly).max() < 0.4


def test_gaps_and_channels_without_data() -> None:
    day = quiet_day()
    day[:, 3] = np.nan
    day[300:700] = np.nan
    day[np.random.default_rng(3).random(day.shape) < 0.1] = np.nan
    found = quiet_level(day, TIME)

    assert np.isnan(found.level_db[:, 3]).all()
    assert np.isnan(found.noise_db[3])
    assert np.isfinite(np.delete(found.level_db, 3, axis=1)).all()
    assert abs(np.nanmedian(day - found.level_db)) < 0.02


def test_uneven_records_are_as_good_as_even_ones() -> None:
    rng = np.random.default_rng(4)
    steps = rng.choice([7, 56, 175], size=4000)
    time = TIME[0] + np.cumsum(steps) * np.timedelta64(1, "s")
    noise = rng.normal(QUIET_DB, NOISE_DB, (4000, 64))

    assert np.abs(np.median(noise - quiet_level(noise, time).level_db, axis=0)).max() < 0.05


@pytest.mark.parametrize("records", [1, 2, 40])
def test_a_short_spectrum_has_a_level(records: int) -> None:
    noise = quiet_day()[:records]

    assert np.isfinite(quiet_level(noise, TIME[:records]).level_db).all()


def test_no_records_are_refused() -> None:
    with pytest.raises(InputError, match="a background needs records"):
        quiet_level(np.zeros((0, 3)), TIME[:0])
    with pytest.raises(InputError, match="3 times go with"):
        quiet_level(np.zeros((2, 3)), TIME[:3])


@pytest.mark.parametrize(
    ("quantity", "attributes", "values"),
    [
        ("db_over_background", {}, lambda level: level),
        ("voltage_ratio", {}, lambda level: 10.0 ** (level / 20.0)),
        ("psd_v2_hz", {}, lambda level: 1e-17 * 10.0 ** (level / 10.0)),
        ("flux_w_m2_hz", {}, lambda level: 1e-21 * 10.0 ** (level / 10.0)),
        ("relative_flux", {}, lambda level: 1e-3 * 10.0 ** (level / 10.0)),
        ("relative_flux", {"power_exponent": 2.0}, lambda level: 1e-3 * 10.0 ** (level / 20.0)),
    ],
)
def test_every_quantity_gives_the_same_decibels(quantity: str, attributes: dict, values: object) -> None:
    level = quiet_day()
    level[BURST] += 12.0
    over = over_background(spectrum(values(level), quantity, **attributes))  # type: ignore[operator]

    validate_spectrum(over, quantity)
    assert over.attrs["quantity"] == "db_over_background"
    assert "4.5 h" in over.attrs["background"]
    assert over["intensity"].dtype == np.float32
    assert float(over["intensity"][BURST].median()) == pytest.approx(12.0, abs=0.1)
    assert float(over["intensity"].median()) == pytest.approx(0.0, abs=0.05)


def test_what_has_no_logarithm_is_no_data() -> None:
    level = decibels(spectrum(np.array([[0.0, -1e-20, np.nan], [1.0, 10.0, np.inf]]), "psd_v2_hz"))

    np.testing.assert_array_equal(np.isnan(level), [[True, True, True], [False, False, True]])
    assert level[1, :2] == pytest.approx([0.0, 10.0])


def test_an_unknown_quantity_is_refused() -> None:
    with pytest.raises(InputError, match="'counts' cannot be turned into dB"):
        decibels(spectrum(np.ones((2, 3)), "counts"))


@pytest.mark.parametrize(
    ("name", "band", "expected_db"),
    [("ahead", (0.12, 0.5), 8.0), ("behind", (0.3, 4.0), 15.0), ("RAD1", (0.12, 0.5), 12.0)],
)
def test_the_group_of_2010_stands_out_and_the_quiet_sky_is_at_zero(
    reference_files: Path, name: str, band: tuple[float, float], expected_db: float
) -> None:
    day = wind(reference_files, name) if name == "RAD1" else stereo(reference_files, name)
    over = over_background(day)["intensity"]
    group = over.sel(time=slice("2010-01-17T03:55", "2010-01-17T04:25"), frequency=slice(*band)).max("time")
    hours_before = over.sel(time=slice("2010-01-17T01:00", "2010-01-17T03:30"), frequency=slice(*band))

    assert float(group.median()) > expected_db
    assert abs(float(hours_before.median())) < 0.3
    assert abs(float(over.median())) < 0.05
