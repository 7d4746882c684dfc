"""What receivers make of a scene: the unit of the file, the mean over the integration, clipped peaks, modes."""

from dataclasses import replace
from datetime import date

import numpy as np
import pytest
import xarray as xr

from bella.simulation import Receiver, SimulatedBurst
from bella.simulation.burst import arrival_s, received
from bella.simulation.day import Scene, observe_scene
from bella.simulation.instruments import WRITABLE, Instrument, instruments
from bella.simulation.receiver import Samples, minute_means, received_power, record_middles_s
from bella.simulation.sky import Conditions, Gain
from bella.spectra import power_above_background
from bella.spectra.background import decibels

DAY = date(2021, 11, 2)
MIDNIGHT = np.datetime64(DAY, "ns")
BURST = SimulatedBurst(MIDNIGHT + np.timedelta64(5, "h"), f_low_mhz=0.2, f_high_mhz=12.0, contrast=200.0)
BETWEEN_S = (5 * 3600.0 - 600.0, 5 * 3600.0 + 5400.0)
QUIET = Conditions()


def recorded(dataset: str, conditions: Conditions = QUIET, noise: float = 0.0) -> tuple[Instrument, xr.Dataset]:
    """Without noise, unless asked for."""
    instrument = instruments(dataset, DAY)[-1]
    still = replace(
        instrument,
        receiver=replace(instrument.receiver, noise=noise),
        averaged=tuple(replace(one, noise=noise) for one in instrument.averaged),
        fast=None if instrument.fast is None else replace(instrument.fast, noise=noise),
    )
    return still, observe_scene(still, Scene(MIDNIGHT, (BURST,), conditions), BETWEEN_S, np.random.default_rng(1))


@pytest.mark.parametrize("dataset", WRITABLE)
def test_twice_the_background_is_what_the_unit_makes_of_it(dataset: str) -> None:
    """Voltages go with the root of the power; fluxes have the background taken away."""
    if dataset.startswith(("STB", "STEREO")):
        pytest.skip("STEREO-B is silent on that day")
    instrument, spectrum = recorded(dataset)
    background = instrument.background
    doubled = {
        "voltage_ratio": np.sqrt(2.0) * background,
        "psd_v2_hz": 2.0 * background,
        "flux_w_m2_hz": background,
        "db_over_background": np.full_like(background, 10.0 * np.log10(2.0)),
    }[instrument.quantity]
    twice = Conditions(gain=Gain(0.0, 10.0 * np.log10(2.0), 0.0))
    lifted = observe_scene(instrument, Scene(MIDNIGHT, (), twice), BETWEEN_S, np.random.default_rng(1))

    assert spectrum.attrs["quantity"] == instrument.quantity
    assert spectrum.attrs["origin"] == "simulated"
    np.testing.assert_allclose(lifted["intensity"].to_numpy()[5], doubled, rtol=1e-5)


def test_voltage_squared_is_the_power_that_is_read() -> None:
    instrument, spectrum = recorded("WI_H1_WAV")
    middle_s = np.arange(*BETWEEN_S, 60.0) + 30.0
    power = 1.0 + received_power(instrument.receiver, [BURST], MIDNIGHT, middle_s)

    np.testing.assert_allclose(spectrum["intensity"].to_numpy() ** 2, power, rtol=1e-5)
    np.testing.assert_allclose(10 ** (decibels(spectrum) / 10.0), power, rtol=1e-5)


@pytest.mark.parametrize("integration_s", [0.5, 10.0, 60.0])
def test_integration_neither_loses_nor_adds_energy(integration_s: float) -> None:
    """Samples that follow one another without a gap add up to the integral of the light curve."""
    channels = np.array([0.4, 1.0, 3.0])
    receiver = Receiver("WIND", "any", channels, integration_s, integration_s, np.zeros(3))
    middle_s = record_middles_s(integration_s, 4.9 * 3600.0, 7.5 * 3600.0)
    energy_s = integration_s * received_power(receiver, [BURST], MIDNIGHT, middle_s).sum(axis=0)
    what = received(BURST, channels, "WIND")
    time_s = np.arange(-600.0, 8000.0, 0.1)
    curves = BURST.pulse.curves(channels)

    for column in range(3):
        expected_s = what.height[column, 0] * curves.at(column, time_s).sum() * 0.1
        assert energy_s[column] == pytest.approx(expected_s, rel=1e-3)


def test_a_sample_is_the_mean_over_its_integration_at_the_time_it_was_taken() -> None:
    channels, offset_s = np.array([0.5, 0.6]), np.array([0.0, 11.0])
    long = Receiver("WIND", "long", channels, 60.0, 40.0, offset_s)
    short = Receiver("WIND", "short", channels, 0.25, 0.25, np.zeros(2))
    middle_s = 5 * 3600.0 + np.arange(600.0, 1500.0, 60.0)
    fine_s = 5 * 3600.0 + np.arange(500.0, 1600.0, 0.25) + 0.125
    fine = received_power(short, [BURST], MIDNIGHT, fine_s)
    for column in range(2):
        inside = [np.abs(fine_s - middle - offset_s[column]) < 20.0 for middle in middle_s]
        expected = [fine[one, column].mean() for one in inside]

        found = received_power(long, [BURST], MIDNIGHT, middle_s)[:, column]
        np.testing.assert_allclose(found, expected, atol=0.05)


def test_peaks_above_the_limit_of_a_receiver_are_flat() -> None:
    _, whole = recorded("PSP_FLD_L2_RFS_LFR")
    instrument, clipped = recorded("PSP_FLD_L2_RFS_LFR", Conditions(clip=50.0))
    limit = 50.0 * instrument.background

    assert (whole["intensity"].max("time") > 1.5 * limit).any()
    np.testing.assert_allclose(clipped["intensity"], np.minimum(whole["intensity"], limit), rtol=1e-5)


def test_a_receiver_changes_into_its_fast_mode() -> None:
    change_s = 5 * 3600.0 + 1000.0
    instrument, spectrum = recorded("PSP_FLD_L2_RFS_LFR", Conditions(fast_from_s=change_s))
    after_s = (spectrum["time"].to_numpy() - MIDNIGHT) / np.timedelta64(1, "s")
    step_s, late = np.diff(after_s), after_s[1:] > change_s + 30.0

    np.testing.assert_allclose(step_s[after_s[1:] < change_s - 60.0], 55.92, atol=1e-6)
    np.testing.assert_allclose(step_s[late], 6.99, atol=1e-6)
    assert step_s.min() > 6.9
    column = int(np.abs(spectrum["frequency"].to_numpy() - 0.5).argmin())
    channel = spectrum["frequency"].to_numpy()[[column]]
    power = spectrum["intensity"].to_numpy()[:, column] / instrument.background[column] - 1.0
    expected_s = 5 * 3600.0 + arrival_s(BURST, channel, "PSP")[0]
    rising = slice(int(np.searchsorted(after_s, expected_s - 300.0)), int(power.argmax()) + 1)
    assert np.interp(0.5 * power.max(), power[rising], after_s[rising]) == pytest.approx(expected_s, abs=8.0)


def test_means_of_minutes_are_those_of_their_samples() -> None:
    channels = np.array([0.5, 0.7, 0.9])
    receiver = Receiver("WIND", "hopping", channels[[0, 2]], 45.0, 2.8, np.array([0.0, 3.0]), 0.0)

    def take(one: Receiver, middle_s: np.ndarray) -> Samples:
        time_s = middle_s[:, None] + one.sample_offset_s
        return Samples(time_s, time_s**2)

    means = minute_means(channels, [receiver], take, 7.0, (10, 20))
    visits_s = 7.0 + 45.0 * np.arange(200)
    for row in range(10):
        begin_s = 60.0 * (10 + row)
        parts_s = (visits_s[:, None] + np.array([-1.05, -0.35, 0.35, 1.05])).ravel()
        inside = parts_s[(parts_s >= begin_s) & (parts_s < begin_s + 60.0)]
        assert means.time_s[row, 0] == pytest.approx(inside.mean(), abs=1e-6)
        assert means.power[row, 0] == pytest.approx((inside**2).mean())
        assert means.length_s[row, 0] == pytest.approx(0.7 * inside.size)
        assert means.apart_s[row, 0] == pytest.approx(2 * inside.std(), abs=1e-6)
    assert np.isnan(means.power[:, 1]).all()
    assert (means.length_s[:, 1] == 0).all()


def test_power_above_the_background_is_the_contrast() -> None:
    _, spectrum = recorded("SOLO_L3_RPW-HFR-SURV-FLUX")
    instrument = instruments("SOLO_L3_RPW-HFR-SURV-FLUX", DAY)[0]
    power = power_above_background(spectrum).to_numpy() / instrument.background
    channels = spectrum["frequency"].to_numpy()
    inside = (channels > 0.5) & (channels < 2.0)

    np.testing.assert_allclose(power.max(axis=0)[inside], 200.0, rtol=0.06)
