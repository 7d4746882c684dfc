"""Simulated bursts: the physics of their arrival times, the light curve, and what a receiver records."""

from dataclasses import replace

import numpy as np
import pytest

from bella.bursts.widths import decay_s, rise_half_width_s
from bella.exceptions import InputError, NoDataError
from bella.multilateration import localise
from bella.simulation import Receiver, SimulatedBurst, observe, true_arrivals
from bella.simulation.burst import arrival_s, source_position_rsun, source_range_rsun
from bella.simulation.light_curve import light_curve
from bella.spacecraft import position_hee
from bella.tracks import track_fit
from bella.units import C_RSUN_S

RELEASE = np.datetime64("2012-06-07T19:20:00", "ns")
BURST = SimulatedBurst(RELEASE, density_factor=4.0)
FREQUENCY = np.geomspace(0.15, 2.0, 25)
FLEET = ("WIND", "STEREO-A", "STEREO-B")


def test_differences_between_spacecraft_are_light_travel_alone() -> None:
    source = source_position_rsun(BURST, FREQUENCY)
    there = [position_hee(name, RELEASE, RELEASE)[0] for name in FLEET]
    way_s = [np.linalg.norm(source - where, axis=1) / C_RSUN_S for where in there]
    heard = [arrival_s(BURST, FREQUENCY, name) for name in FLEET]

    np.testing.assert_allclose(heard[1] - heard[0], way_s[1] - way_s[0], atol=0.2)  # the fleet moves by 0.1 s of light
    assert (np.diff(heard[0]) < 0).all()


def test_sources_lie_on_the_spiral_where_the_density_says() -> None:
    position, range_rsun = source_position_rsun(BURST, FREQUENCY), source_range_rsun(BURST, FREQUENCY)

    np.testing.assert_allclose(np.linalg.norm(position, axis=1), range_rsun)
    np.testing.assert_allclose(source_range_rsun(replace(BURST, density_factor=1.0), FREQUENCY / 2), range_rsun)
    assert range_rsun[0] > 100 > range_rsun[-1]


def test_localisation_of_the_true_times_gives_the_spiral_back() -> None:
    """From a beam to arrival times to positions to the spiral: the whole chain, without noise."""
    solved = localise(true_arrivals(BURST, FREQUENCY, FLEET, sigma_s=0.5), draws=10)
    source = source_position_rsun(BURST, FREQUENCY)
    line = track_fit(solved)["two_step_other_rotations"]["25.38"]

    np.testing.assert_allclose(solved["x_rsun"], source[:, 0], atol=0.3)
    np.testing.assert_allclose(solved["y_rsun"], source[:, 1], atol=0.3)
    assert line["v_sw_km_s"]["mean"] == pytest.approx(400, abs=4)
    assert line["phi0_deg"]["mean"] == pytest.approx(30, abs=0.3)


@pytest.mark.parametrize("frequency_mhz", [0.2, 0.5, 1.0, 8.0])
def test_light_curve_rises_to_one_half_at_zero_and_decays_as_it_should(frequency_mhz) -> None:
    curve = light_curve(frequency_mhz)
    narrow = 0.01 * rise_half_width_s(frequency_mhz)

    def at(time_s: float) -> float:
        return float(curve.mean(np.array(time_s - narrow), np.array(time_s + narrow)))

    assert at(0.0) == pytest.approx(0.5, abs=0.005)
    late = 5 * decay_s(frequency_mhz)
    slope = np.log(at(late) / at(late + decay_s(frequency_mhz)))
    # far out a gamma distribution decays with its scale, decay / shape, but for a power of the time
    assert slope == pytest.approx(1.3 - 0.3 * np.log(6 / 5), abs=0.06)
    assert max(at(t) for t in np.linspace(0, late, 400)) == pytest.approx(1.0, abs=0.01)


def test_factors_change_the_light_curve_and_leave_the_half_rise_at_zero() -> None:
    plain, slow = light_curve(0.5), light_curve(0.5, rise_factor=2.0, decay_factor=2.0)
    at = np.linspace(-300.0, 600.0, 40)

    # twice as slow in everything is the same curve on a time axis twice as long
    np.testing.assert_allclose(slow.mean(2 * at - 2, 2 * at + 2), plain.mean(at - 1, at + 1), atol=1e-4)
    for curve in (light_curve(0.5, rise_factor=1.5), light_curve(0.5, decay_factor=0.6, gamma_shape=1.0)):
        assert curve.mean(np.array(-0.5), np.array(0.5)) == pytest.approx(0.5, abs=0.005)


def test_a_receiver_sees_the_factors_of_the_burst() -> None:
    start, stop = RELEASE, RELEASE + np.timedelta64(3600, "s")
    slow = replace(BURST, width_factor=1.5, decay_factor=1.33, gamma_shape=1.1)
    seen = [observe(swept(), [burst], start, stop, np.random.default_rng(1)) for burst in (BURST, slow)]
    fluence = [float((10 ** (spectrum["intensity"] / 10) - 1).isel(frequency=30).sum()) for spectrum in seen]

    assert 1.5 < fluence[1] / fluence[0] < 2.0


def test_rise_and_decay_at_known_frequencies() -> None:
    assert rise_half_width_s(30.0) == pytest.approx(1.5)
    assert rise_half_width_s(0.5) == pytest.approx(35.1, abs=0.1)
    assert decay_s(1.0) == pytest.approx(72.0)


def swept(observatory: str = "STEREO-A", noise: float = 0.0) -> Receiver:
    frequency = np.geomspace(0.2, 4.0, 60)
    offset = np.linspace(-17, 17, 60)
    return Receiver(observatory, "HFR", frequency, 38.0, 0.1, offset, noise)


def test_a_channel_is_seen_when_the_sweep_comes_to_it() -> None:
    start, stop = RELEASE, RELEASE + np.timedelta64(3600, "s")
    spectrum = observe(swept(), [BURST], start, stop, np.random.default_rng(1))
    column = 20
    arrived = arrival_s(BURST, spectrum["frequency"].to_numpy()[[column]], "STEREO-A")[0]
    seconds = (spectrum["time"].to_numpy() - start) / np.timedelta64(1, "s") + float(
        spectrum["sample_offset_s"][column]
    )
    power = 10 ** (spectrum["intensity"].to_numpy()[:, column] / 10) - 1
    after = int(np.searchsorted(seconds, arrived))
    curve = light_curve(float(f"{float(spectrum['frequency'][column]):.3g}"))
    expected = BURST.contrast * curve.mean(seconds - arrived - 0.05, seconds - arrived + 0.05)

    np.testing.assert_allclose(power, expected, atol=1e-3 * BURST.contrast)
    assert power[after - 1] < 0.5 * BURST.contrast < power[after]


def test_background_has_the_noise_that_was_asked_for() -> None:
    quiet = observe(swept(noise=0.1), [], RELEASE, RELEASE + np.timedelta64(12, "h"), np.random.default_rng(2))
    power = 10 ** (quiet["intensity"].to_numpy() / 10)

    assert np.nanmean(power) == pytest.approx(1.0, abs=0.002)
    assert np.nanstd(power) == pytest.approx(0.1, rel=0.02)
    assert quiet.sizes["time"] == 12 * 3600 // 38


def test_the_same_seed_gives_the_same_spectrum() -> None:
    one, other = (
        observe(swept(noise=0.1), [BURST], RELEASE, RELEASE + np.timedelta64(1, "h"), np.random.default_rng(3))
        for _ in range(2)
    )
    np.testing.assert_array_equal(one["intensity"], other["intensity"])


def test_what_cannot_be_simulated_is_refused() -> None:
    with pytest.raises(InputError, match="density model 'aether' is not known; choose one of leblanc"):
        SimulatedBurst(RELEASE, density="aether")
    with pytest.raises(InputError, match=r"a beam of 1\.5 c is not one"):
        SimulatedBurst(RELEASE, beam_speed_c=1.5)
    with pytest.raises(InputError, match="decay_factor is 0; give a number above zero"):
        SimulatedBurst(RELEASE, decay_factor=0.0)
    with pytest.raises(NoDataError, match="STEREO-B"):
        true_arrivals(replace(BURST, release_utc=np.datetime64("2016-01-01", "ns")), FREQUENCY, FLEET, 1.0)
    with pytest.raises(InputError, match="a stop after the start"):
        observe(swept(), [], RELEASE, RELEASE, np.random.default_rng(1))
    with pytest.raises(InputError, match="'leblanc' has no"):
        source_range_rsun(BURST, np.array([1e-4]))
