"""Simulated bursts: the physics of their arrival times, the light curve, and what a receiver records."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from bella.exceptions import InputError, NoDataError
from bella.heliosphere.scattering import NO_DELAY
from bella.multilateration import localise
from bella.simulation import Receiver, SimulatedBurst, observe, true_arrivals
from bella.simulation.burst import (
    DENSITIES,
    SPEED_LAWS,
    Aspect,
    Companion,
    arrival_s,
    light_arrival_s,
    mean_beam_speed_c,
    received,
    source_position_rsun,
    source_range_rsun,
    travel_s,
)
from bella.simulation.light_curves import PulseLaw, draw_pulse_law
from bella.simulation.sky import DEPARTURES
from bella.spacecraft import position_hee
from bella.units import C_RSUN_S

RELEASE = np.datetime64("2012-06-07T19:20:00", "ns")
BURST = SimulatedBurst(RELEASE, density_factor=4.0)
FREQUENCY = np.geomspace(0.15, 2.0, 25)
FLEET = ("WIND", "STEREO-A", "STEREO-B")


def test_differences_between_spacecraft_are_light_travel_alone() -> None:
    source = source_position_rsun(BURST, FREQUENCY)
    there = [position_hee(name, RELEASE, RELEASE)[0] for name in FLEET]
    way_s = [np.linalg.norm(source - where, axis=1) / C_RSUN_S for where in there]
    received = [arrival_s(BURST, FREQUENCY, name) for name in FLEET]

    np.testing.assert_allclose(
        received[1] - received[0], way_s[1] - way_s[0], atol=0.2
    )  # the fleet moves by 0.1 s of light
    assert (np.diff(received[0]) < 0).all()


def test_sources_lie_on_the_spiral_where_the_density_says() -> None:
    position, range_rsun = source_position_rsun(BURST, FREQUENCY), source_range_rsun(BURST, FREQUENCY)

    np.testing.assert_allclose(np.linalg.norm(position, axis=1), range_rsun)
    np.testing.assert_allclose(source_range_rsun(replace(BURST, density_factor=1.0), FREQUENCY / 2), range_rsun)
    assert range_rsun[0] > 100 > range_rsun[-1]


def test_localisation_of_the_true_times_gives_the_spiral_back() -> None:
    """From a beam to arrival times to positions to the spiral: the whole chain, without noise."""
    solved = localise(true_arrivals(BURST, FREQUENCY, FLEET, sigma_s=0.5), draws=10, delay=NO_DELAY)
    source = source_position_rsun(BURST, FREQUENCY)
    range_rsun = np.hypot(solved["x_rsun"], solved["y_rsun"])
    slope_deg, phi0_deg = np.polyfit(range_rsun - 1.0, np.degrees(np.arctan2(solved["y_rsun"], solved["x_rsun"])), 1)
    turned_deg_s = 360.0 / (25.38 * 86_400.0)

    np.testing.assert_allclose(solved["x_rsun"], source[:, 0], atol=0.3)
    np.testing.assert_allclose(solved["y_rsun"], source[:, 1], atol=0.3)
    assert -turned_deg_s / slope_deg * 695_700.0 == pytest.approx(400, abs=4)
    assert phi0_deg == pytest.approx(30, abs=0.3)


def test_a_radial_burst_arrives_when_a_hand_calculation_says() -> None:
    """Wind blows so fast that the spiral is a straight line towards Earth: everything is along one axis."""
    burst = SimulatedBurst(RELEASE, phi0_deg=0.0, v_sw_km_s=1e9, beam_speed_c=0.2, harmonic=1)
    frequency_mhz = 0.5
    density_cm3 = (frequency_mhz * 1e3 / 8.97866) ** 2
    range_rsun = brentq(lambda r: 3.3e5 / r**2 + 4.1e6 / r**4 + 8.0e7 / r**6 - density_cm3, 2.0, 200.0)
    wind_rsun = position_hee("WIND", RELEASE, RELEASE)[0]
    rsun_light_s = 695_700.0 / 299_792.458

    heard_s = arrival_s(burst, np.array([frequency_mhz]), "WIND")[0]

    expected_s = rsun_light_s * ((range_rsun - 1.0) / 0.2 + np.hypot(wind_rsun[0] - range_rsun, wind_rsun[1]))
    assert heard_s == pytest.approx(expected_s, abs=0.02)


def test_a_delay_grows_with_the_angle_as_calculated_by_hand() -> None:
    law = PulseLaw("emg", 80.0, -1.0)
    burst = replace(BURST, kappa=0.25, pulse=law, width_factor=1.5)
    frequency = np.array([0.4])
    x, y, _ = source_position_rsun(burst, frequency)[0]
    for name in FLEET:
        sx, sy, _ = position_hee(name, RELEASE, RELEASE)[0]
        angle = np.arctan2(sy - y, sx - x) - np.arctan2(y, x)
        late_s = arrival_s(burst, frequency, name) - light_arrival_s(burst, frequency, name)

        assert late_s[0] == pytest.approx(0.25 * 1.5 * 100.0 * (1.0 - np.cos(angle)), abs=0.2)
    assert (arrival_s(BURST, frequency, "WIND") == light_arrival_s(BURST, frequency, "WIND")).all()


@pytest.mark.parametrize("law", SPEED_LAWS)
def test_a_beam_takes_the_time_that_its_speed_along_the_spiral_asks_for(law: str) -> None:
    burst = replace(BURST, speed_law=law, slowing=0.3, beam_speed_c=0.4, v_sw_km_s=350.0)
    per_rsun = 2.0 * np.pi / (25.38 * 86_400.0) * 695_700.0 / 350.0
    speed = {
        "constant": lambda _: 0.4,
        "power": lambda r: 0.4 * r**-0.3,
        "levelling": lambda r: 0.4 * (1.0 + 0.3 * np.exp(-r / 35.0)) / 1.3,
    }[law]
    light_s = 695_700.0 / 299_792.458
    for range_rsun in (3.0, 40.0, 150.0):
        taken = quad(lambda r: light_s * np.sqrt(1 + (per_rsun * r) ** 2) / speed(r), 1.0, range_rsun)[0]
        assert travel_s(burst, np.array([range_rsun]))[0] == pytest.approx(taken, rel=2e-4)
    assert mean_beam_speed_c(burst, FREQUENCY) <= 0.4001


def test_the_mean_speed_of_a_constant_beam_is_its_speed() -> None:
    assert mean_beam_speed_c(BURST, FREQUENCY) == pytest.approx(0.15, rel=1e-4)
    slow = replace(BURST, speed_law="power", slowing=0.3)
    assert mean_beam_speed_c(slow, FREQUENCY[:2]) < mean_beam_speed_c(slow, FREQUENCY[-2:]) < 0.15


def test_densities_are_those_of_their_authors_and_reach_all_frequencies() -> None:
    at_1au, at_10 = (
        {name: float(model.density_cm3(np.array(r))) for name, model in DENSITIES.items()} for r in (214.94, 10.0)
    )
    assert at_1au["mann_wind"] == pytest.approx(6.6, rel=0.03)  # Mann et al. 1999 give 6.59 cm^-3 at 1 au
    assert at_1au["newkirk_wind"] == pytest.approx(6.6, rel=0.05)
    assert at_10["newkirk_wind"] == pytest.approx(2774 + 4.2e4 * (10**0.432 - 1) / 10**1.5, rel=0.01)
    range_rsun = np.geomspace(1.05, 300.0, 3000)
    for name, model in DENSITIES.items():
        density = model.density_cm3(range_rsun)
        slope = np.gradient(np.log(density), np.log(range_rsun))
        assert (slope < -0.5).all(), name
        low_mhz, high_mhz = 8.98e-3 * np.sqrt(density[[-1, 0]])
        assert low_mhz < 0.026, name
        assert high_mhz > 20.0, name
    wavy = np.gradient(np.log(DENSITIES["wavy"].density_cm3(range_rsun)), np.log(range_rsun))[range_rsun > 20.0]
    assert np.ptp(wavy) > 1.5, "no power law"


def test_a_wind_of_one_temperature_obeys_its_equation() -> None:
    """(v/c)^2 - ln (v/c)^2 = 4 ln(r/rc) + 4 rc/r - 3 of Parker, with the speed that the density stands for."""
    range_rsun = np.array([1.5, 4.0, 20.0, 100.0])
    sound_km_s = 117.29  # sqrt(k 10^6 K / (0.6 m_p))
    critical_rsun = 1.32712e11 / (2 * sound_km_s**2) / 695_700.0
    speed_km_s = 6.3e34 / ((range_rsun * 6.957e10) ** 2 * DENSITIES["mann_wind"].density_cm3(range_rsun)) / 1e5
    squared, x = (speed_km_s / sound_km_s) ** 2, range_rsun / critical_rsun

    np.testing.assert_allclose(squared - np.log(squared), 4 * np.log(x) + 4 / x - 3, rtol=2e-3)
    assert (np.diff(speed_km_s) > 0).all()


def test_a_source_out_of_the_ecliptic_is_there() -> None:
    flat, tilted = (source_position_rsun(replace(BURST, latitude_deg=lat), FREQUENCY) for lat in (0.0, 15.0))

    np.testing.assert_allclose(np.linalg.norm(tilted, axis=1), np.linalg.norm(flat, axis=1))
    np.testing.assert_allclose(tilted[:, 2], np.sin(np.radians(15.0)) * np.linalg.norm(flat, axis=1))
    np.testing.assert_allclose(tilted[:, 1] / tilted[:, 0], flat[:, 1] / flat[:, 0])


def seen_half_rise_s(burst: SimulatedBurst, frequency_mhz: float, name: str) -> float:
    """When a receiver that is fast and without noise sees half of the maximum for the first time."""
    receiver = Receiver(name, "fast", np.array([frequency_mhz, 1.001 * frequency_mhz]), 0.5, 0.01, np.zeros(2), 0.0)
    spectrum = observe(receiver, [burst], RELEASE, RELEASE + np.timedelta64(3, "h"), np.random.default_rng(1))
    power = 10 ** (spectrum["intensity"].to_numpy()[:, 0].astype(float) / 10) - 1
    after = int((power >= 0.5 * power.max()).argmax())
    time_s = (spectrum["time"].to_numpy() - RELEASE) / np.timedelta64(1, "s")
    return float(np.interp(0.5 * power.max(), power[after - 1 : after + 1], time_s[after - 1 : after + 1]))


@pytest.mark.parametrize("stratum", DEPARTURES)
def test_the_truth_is_the_half_rise_of_what_is_received(stratum: str) -> None:
    for seed in range(3):
        rng = np.random.default_rng(seed)
        burst = DEPARTURES[stratum][1](replace(BURST, contrast=1000.0, pulse=draw_pulse_law(rng)), FLEET, rng)
        for name, frequency_mhz in (("WIND", 0.3), ("STEREO-A", 1.2)):
            expected = arrival_s(burst, np.array([frequency_mhz]), name)[0]
            assert seen_half_rise_s(burst, frequency_mhz, name) == pytest.approx(expected, abs=0.3)


def test_width_of_the_light_curve_follows_direction_and_spacecraft() -> None:
    burst = replace(BURST, widening=0.6, aspects={"WIND": Aspect(rise=0.8, decay=1.3)})
    frequency = np.array([0.5])
    plain, wide = (received(one, frequency, "WIND") for one in (BURST, burst))
    turned = 1.0 - np.cos(np.radians(55.0))
    other = received(burst, frequency, "STEREO-B").rise_s / received(BURST, frequency, "STEREO-B").rise_s

    assert (plain.arrival_s == wide.arrival_s).all()
    assert 0.8 < wide.rise_s / plain.rise_s < 0.8 * (1 + 0.3 * turned)
    assert wide.decay_s / plain.decay_s == pytest.approx(1.3 / 0.8 * wide.rise_s / plain.rise_s)
    assert 1.2 < other < 1.6, "STEREO-B sees the burst from behind"


def test_the_delay_of_a_component_goes_with_its_own_rise() -> None:
    quick = Companion(harmonic=1, rise_factor=0.6)
    frequency = np.array([0.4])
    late, on_time = (
        received(replace(BURST, companion=quick, kappa=kappa), frequency, "STEREO-B") for kappa in (0.2, 0.0)
    )
    own = received(replace(BURST, harmonic=1, kappa=0.2), frequency, "STEREO-B").arrival_s - on_time.arrival_s[:, 1]

    np.testing.assert_allclose((late.arrival_s - on_time.arrival_s)[:, 1], 0.6 * own[0])
    np.testing.assert_allclose(on_time.rise_s[:, 1], 0.6 * on_time.rise_s[:, 0])


def test_both_components_of_a_pair_are_received() -> None:
    pair = replace(BURST, companion=Companion(harmonic=1, height=0.5, directivity=0.3), directivity=2.0)
    frequency = np.array([0.3, 1.0])
    toward, aside = (received(pair, frequency, name) for name in ("WIND", "STEREO-B"))
    alone = light_arrival_s(replace(BURST, harmonic=1), frequency, "WIND")

    np.testing.assert_allclose(toward.arrival_s[:, 1], alone)
    assert (toward.arrival_s[:, 1] < toward.arrival_s[:, 0]).all(), "the fundamental comes from nearer the Sun"
    assert (aside.height[:, 1] / aside.height[:, 0] < 0.2 * toward.height[:, 1] / toward.height[:, 0]).all()


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
    curve = BURST.pulse.curves(spectrum["frequency"].to_numpy()[[column]])
    expected = BURST.contrast * curve.mean(0, seconds - arrived - 0.05, seconds - arrived + 0.05)

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
    with pytest.raises(InputError, match="density 'aether' is not known; choose one of leblanc"):
        SimulatedBurst(RELEASE, density="aether")
    with pytest.raises(InputError, match=r"a beam of 1\.5 c is not one"):
        SimulatedBurst(RELEASE, beam_speed_c=1.5)
    with pytest.raises(InputError, match="speed_law 'warp' is not known; choose one of constant"):
        SimulatedBurst(RELEASE, speed_law="warp")
    with pytest.raises(InputError, match="width_factor is 0; give a number above zero"):
        SimulatedBurst(RELEASE, width_factor=0.0)
    with pytest.raises(NoDataError, match="STEREO-B"):
        true_arrivals(replace(BURST, release_utc=np.datetime64("2016-01-01", "ns")), FREQUENCY, FLEET, 1.0)
    with pytest.raises(InputError, match="a stop after the start"):
        observe(swept(), [], RELEASE, RELEASE, np.random.default_rng(1))
    with pytest.raises(InputError, match="'leblanc' has no"):
        source_range_rsun(BURST, np.array([1e-4]))
