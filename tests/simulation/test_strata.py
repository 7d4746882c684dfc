"""Isolated bursts: each stratum is what its name says, seeds for judging are apart, and truth survives the file."""

import json
import subprocess
import sys
from datetime import date
from pathlib import Path

import numpy as np
import pytest

from bella.exceptions import InputError
from bella.simulation import SimulatedBurst
from bella.simulation.burst import SPEED_LAWS, received, source_position_rsun
from bella.simulation.light_curves import PulseLaw
from bella.simulation.sky import DEPARTURES, draw_burst
from bella.simulation.strata import FLEETS, STRATA, JudgingSeed, SimulatedCase, isolated_burst, judging_seed
from bella.simulation.truth import burst_truth
from bella.spacecraft import position_hee
from bella.spectra import over_background, sample_times

PROBE = """
import pkgutil, sys, importlib, bella.simulation
for one in pkgutil.iter_modules(bella.simulation.__path__):
    importlib.import_module(f"bella.simulation.{one.name}")
print(sorted({".".join(name.split(".")[:2]) for name in sys.modules if name.startswith("bella.")}))
"""


def test_nothing_that_is_judged_is_imported() -> None:
    answer = subprocess.run([sys.executable, "-c", PROBE], capture_output=True, text=True, check=True).stdout

    assert "bella.simulation" in answer
    for judged in ("bursts", "tracks", "multilateration", "solar_wind", "calibration"):
        assert f"bella.{judged}" not in answer


@pytest.mark.parametrize("stratum", STRATA)
def test_every_stratum_has_spectra_of_its_fleet(stratum: str) -> None:
    case = isolated_burst(stratum, "2021", 3)

    assert set(case.spectra) == {"WIND", "STEREO-A", "PSP", "SOLO"}
    assert case.burst.stratum == stratum
    for name, spectrum in case.spectra.items():
        assert spectrum.attrs["observatory"] == name
        assert spectrum.attrs["origin"] == "simulated"
        assert np.isfinite(spectrum["intensity"].to_numpy()).any()


def test_a_case_is_that_of_its_stratum_fleet_and_seed() -> None:
    one, again, other = (isolated_burst("clean", "pair", seed) for seed in (1, 1, 2))

    assert one.burst == again.burst != other.burst
    for name in one.spectra:
        np.testing.assert_array_equal(one.spectra[name]["intensity"], again.spectra[name]["intensity"])
    assert isolated_burst("slowing", "pair", 1).burst.phi0_deg != one.burst.phi0_deg


def test_seeds_for_judging_are_asked_for_by_name() -> None:
    assert isolated_burst("clean", "pair", judging_seed(0)).seed == 1_000_000
    for seed in (-1, 10_000, 1_000_000):
        with pytest.raises(InputError, match=f"seed {seed} is not between 0 and 9999; for judging, use judging_seed"):
            isolated_burst("clean", "pair", seed)
    with pytest.raises(InputError, match="judging seed -1 is below 0"):
        judging_seed(-1)
    with pytest.raises(InputError, match="5 is no seed for judging"):
        JudgingSeed(5)


def test_what_is_not_known_is_refused() -> None:
    with pytest.raises(InputError, match="stratum 'odd' is not known; choose one of clean, slowing"):
        isolated_burst("odd", "2021", 1)
    with pytest.raises(InputError, match="fleet '1999' is not known; choose one of 2012, 2020"):
        isolated_burst("clean", "1999", 1)


def cadence_s(case: SimulatedCase, name: str) -> float:
    return float(np.median(np.diff(case.spectra[name]["time"])) / np.timedelta64(1, "s"))


def test_fleets_are_where_and_as_fast_as_they_were() -> None:
    for fleet in FLEETS:
        for seed in range(2):
            case = isolated_burst("clean", fleet, seed)
            release = case.burst.release_utc
            place = {name: position_hee(name, np.array([release]), release)[0] for name in case.datasets}
            assert cadence_s(case, "WIND") == 60.0
            assert cadence_s(case, "STEREO-A") == pytest.approx(38.05)
            if fleet.isdigit():
                assert release.astype("datetime64[Y]").astype(str) == fleet
            if "PSP" in place:
                near = np.linalg.norm(place["PSP"]) < 0.25 * 215.03
                assert cadence_s(case, "SOLO") == pytest.approx(17.0)
                assert cadence_s(case, "PSP") == pytest.approx(6.99 if near else 55.92)
                # the two bands are sampled in turn
                assert case.spectra["PSP"].attrs["integration_s"] == pytest.approx(0.5 * cadence_s(case, "PSP"))
                assert near or fleet != "encounter"
    assert set(isolated_burst("clean", date(2013, 5, 1), 1).datasets) == {"WIND", "STEREO-A", "STEREO-B"}


def test_two_spacecraft_are_30_to_120_degrees_apart() -> None:
    apart_deg = []
    for seed in range(60):
        release = isolated_burst("clean", "pair", seed).burst.release_utc
        wind, stereo = (position_hee(name, np.array([release]), release)[0] for name in ("WIND", "STEREO-A"))
        apart_deg.append(np.degrees(np.arccos(wind @ stereo / np.linalg.norm(wind) / np.linalg.norm(stereo))))
    assert 29.0 < min(apart_deg) < 50.0
    assert 100.0 < max(apart_deg) < 121.0


def test_bursts_rise_in_the_spectra_when_the_truth_says() -> None:
    """Half of the maximum of each channel, by a straight line between samples: near the truth, whatever the unit."""
    off_s = []
    for seed in range(4):
        case = isolated_burst("clean", "encounter", seed)
        for name, spectrum in case.spectra.items():
            power = 10 ** (over_background(spectrum)["intensity"].to_numpy() / 10) - 1.0
            after_s = (sample_times(spectrum).to_numpy() - case.burst.release_utc) / np.timedelta64(1, "s")
            channels = spectrum["frequency"].to_numpy()
            truth = case.truth(name, channels[(channels > 0.3) & (channels < 1.0)]).set_index("frequency_mhz")
            for column in np.flatnonzero((channels > 0.3) & (channels < 1.0)):
                one = truth.loc[channels[column]]
                good = np.isfinite(power[:, column]) & (np.abs(after_s[:, column] - one["arrival_s"]) < 1500.0)
                if one["peak_over_background"] < 20.0 or good.sum() < 20:
                    continue
                level, time_s = power[good, column], after_s[good, column]
                top = int(level.argmax())
                assert level[top] == pytest.approx(one["peak_over_background"], rel=0.6)
                below = int(np.flatnonzero(level[:top] < 0.5 * level[top])[-1])
                pair = slice(below, below + 2)
                off_s.append(np.interp(0.5 * level[top], level[pair], time_s[pair]) - one["arrival_s"])
    assert len(off_s) > 100
    assert abs(np.median(off_s)) < 4.0
    assert np.quantile(np.abs(off_s), 0.9) < 20.0


def test_the_kinds_of_strata() -> None:
    rng = np.random.default_rng(1)
    kappas = [isolated_burst("directional", "pair", seed).burst.kappa for seed in range(20)]
    assert 0.1 <= min(kappas) < 0.17
    assert 0.23 < max(kappas) <= 0.3
    slow = [isolated_burst("slowing", "pair", seed) for seed in range(6)]
    for case in slow:
        assert case.mean_beam_speed_c(np.array([0.15, 0.3])) < 0.97 * case.mean_beam_speed_c(np.array([3.0, 8.0]))
    for seed in range(6):
        usual = draw_burst(date(2012, 6, 7), np.random.default_rng(seed))
        slowed = DEPARTURES["slowing"][1](usual, (), np.random.default_rng(seed))
        there = SPEED_LAWS[slowed.speed_law](np.array([30.0]), slowed.slowing)[0]
        assert there * slowed.beam_speed_c == pytest.approx(min(usual.beam_speed_c, 0.8 * there))
    far = [isolated_burst("far side", "pair", seed) for seed in range(5)]
    for case in far:
        assert (source_position_rsun(case.burst, np.array([6.0]))[:, 0] < 0).all()
    assert len(isolated_burst("storm", "pair", 1).drawn.others) > 20
    (second,) = isolated_burst("followed", "pair", 1).drawn.others
    later_s = (second.release_utc - isolated_burst("followed", "pair", 1).burst.release_utc) / np.timedelta64(1, "s")
    assert 200.0 < later_s < 1300.0
    bounded = DEPARTURES["uneven"][1](draw_burst(date(2012, 6, 7), rng), ("WIND", "STEREO-A"), rng)
    lag = [bounded.aspects[name].lag for name in ("WIND", "STEREO-A")]
    assert all(0.1 * 2**0.5 <= one <= 0.2 * 2**0.5 for one in lag)


def test_strata_of_the_receivers() -> None:
    evening = isolated_burst("midnight", "2012", 1)
    for spectrum in evening.spectra.values():
        last = spectrum["time"].to_numpy()[-1]
        assert last.astype("datetime64[D]") == evening.burst.release_utc.astype("datetime64[D]")
        assert last > evening.burst.release_utc + np.timedelta64(500, "s")
    lows = [float(one["frequency"][0]) for one in isolated_burst("low missing", "2012", 1).spectra.values()]
    assert sum(low >= 1.0 for low in lows) == 1
    changing = isolated_burst("mode change", date(2021, 10, 20), 1).spectra["PSP"]
    steps_s = np.diff(changing["time"]) / np.timedelta64(1, "s")
    assert np.isclose(steps_s, 55.92, atol=0.1).any()
    assert np.isclose(steps_s, 6.99, atol=0.1).any()
    gaps = isolated_burst("gaps", "2012", 1).drawn.conditions
    assert sum(len(one.gaps_s) for one in gaps.values()) >= 1
    clipped = isolated_burst("clipped", "2012", 1)
    assert any(np.isfinite(one.clip) for one in clipped.drawn.conditions.values())


def test_components_of_a_pair_differ_between_spacecraft() -> None:
    shares = []
    for seed in range(5):
        case = isolated_burst("pairs", "2012", seed)
        height = [received(case.burst, np.array([0.6]), name).height[0] for name in case.datasets]
        shares.append([one[1] / one.sum() for one in height])
    assert np.ptp(shares, axis=1).max() > 0.4
    assert np.min(shares) < 0.1
    assert np.max(shares) > 0.5


@pytest.mark.parametrize("stratum", ["clean", *DEPARTURES])
def test_the_truth_survives_json(stratum: str) -> None:
    burst = isolated_burst(stratum, "pair", 4).burst
    stored = json.loads(json.dumps(burst_truth(burst, ["WIND"]), allow_nan=False))

    assert set(SimulatedBurst.__dataclass_fields__) <= set(stored)
    assert (stored["phi0_deg"], stored["v_sw_km_s"]) == (burst.phi0_deg, burst.v_sw_km_s)
    assert PulseLaw(**stored["pulse"]) == burst.pulse
    half_rise, light = (
        np.array([moment.rstrip("Z") for moment in stored["received"]["WIND"][name]], dtype="datetime64[ns]")
        for name in ("half_rise_utc", "light_utc")
    )
    late_s = (half_rise - light) / np.timedelta64(1, "s")
    if stratum in {"clean", "slowing", "latitude", "widths"}:
        np.testing.assert_allclose(late_s, 0.0, atol=2e-3)
    if stratum == "directional":
        assert late_s.min() >= 0.0
        assert late_s.max() > 0.2
    np.testing.assert_allclose(
        stored["position_rsun"], source_position_rsun(burst, np.array(stored["frequency_mhz"])), rtol=1e-9
    )


def test_infinite_beams_survive_json() -> None:
    burst = SimulatedBurst(np.datetime64("2012-06-07T19:20:00.123456789", "ns"), pulse=PulseLaw("gamma"))
    assert np.isinf(burst.directivity)
    assert json.loads(json.dumps(burst_truth(burst, ["WIND"]), allow_nan=False))["directivity"] is None


def test_the_page_names_every_stratum_and_fleet() -> None:
    page = (Path(__file__).parents[2] / "docs" / "simulation.md").read_text(encoding="utf-8")
    for name in (*STRATA, *FLEETS):
        assert name in page, name
    shares = {name: share for name, (share, _) in DEPARTURES.items()}
    clean = round(100 * (1.0 - sum(shares.values())))
    assert f"{clean} % clean, {100 * shares['slowing']:.0f} % slowing" in page
