"""The joint fit: right on simulated bursts, equivariant where physics is, honest where the data say nothing."""

import dataclasses
import json
import math

import numpy as np
import pytest

from bella.exceptions import InputError
from bella.flags import TRACK_FLAGS
from bella.tracks import (
    Ingredients,
    JointFit,
    JointModel,
    JointOptions,
    JointPriors,
    compare_models,
    fit_ingredients,
    fit_joint,
    joint_json,
    track_positions,
)
from bella.tracks.joint_fit import beside_mean, summarise
from tests.tracks.bursts import FREQUENCY_MHZ, RELEASE_S, retrograde, reversed_rows, simulated, standard

MODEL = JointModel()
PAPER_LIKE = standard(MODEL, 30.0, 400.0)


@pytest.fixture(scope="module")
def fit() -> JointFit:
    return fit_joint(simulated(PAPER_LIKE, MODEL, np.random.default_rng(1)))


def test_a_burst_is_recovered(fit: JointFit) -> None:
    truth = {"phi0_deg": 30.0, "v_sw_km_s": 400.0, "a_rsun": 40.0, "b": -1.0, "beam_speed_c": 0.15}
    for name, value in truth.items():
        found = fit.summary[name]
        assert abs(found.mean - value) < 3 * found.sd, name
        assert found.q2_5 < found.q16 < found.q50 < found.q84 < found.q97_5
    assert abs(fit.summary["release_s"].mean - RELEASE_S) < 3 * fit.summary["release_s"].sd
    assert fit.flags == ()
    # errors of a burst of forty frequencies at the cadence of 2012, with the offsets that are assumed
    assert 6.0 < fit.summary["phi0_deg"].sd < 9.0
    assert 50.0 < fit.summary["v_sw_km_s"].sd < 110.0
    assert fit.quality is not None
    assert fit.quality.ess_share > 0.5


def test_precise_times_give_the_truth() -> None:
    exact = fit_joint(simulated(PAPER_LIKE, MODEL, None, scale=0.01))
    assert exact.summary["v_sw_km_s"].mean == pytest.approx(400.0, abs=2.0)
    assert exact.summary["phi0_deg"].mean == pytest.approx(30.0, abs=0.2)
    assert exact.summary["release_s"].mean == pytest.approx(RELEASE_S, abs=0.5)


def test_draws_say_what_the_summary_says(fit: JointFit) -> None:
    for name, found in fit.summary.items():
        drawn = fit.draws[name]
        assert drawn.mean() == pytest.approx(found.mean, abs=0.1 * found.sd)
        assert drawn.std() == pytest.approx(found.sd, rel=0.1)


@pytest.mark.parametrize("turn_deg", [77.0, -150.0, 180.0])
def test_turning_spacecraft_and_prior_turns_the_spiral(fit: JointFit, turn_deg: float) -> None:
    turned = JointModel(JointPriors(phi0_deg=turn_deg))
    grid = simulated(PAPER_LIKE, turned, np.random.default_rng(1), turned_deg=turn_deg)
    other = fit_joint(grid, turned)
    for name in ("v_sw_km_s", "a_rsun", "b", "beam_speed_c", "release_s"):
        assert other.summary[name].mean == pytest.approx(fit.summary[name].mean, rel=1e-5)
        assert other.summary[name].sd == pytest.approx(fit.summary[name].sd, rel=1e-4)
    moved = other.summary["phi0_deg"].mean - fit.summary["phi0_deg"].mean - turn_deg
    assert (moved + 180) % 360 - 180 == pytest.approx(0.0, abs=1e-3)
    assert other.summary["phi0_deg"].sd == pytest.approx(fit.summary["phi0_deg"].sd, rel=1e-4)


def test_a_later_burst_is_released_later(fit: JointFit) -> None:
    grid = simulated(PAPER_LIKE, MODEL, np.random.default_rng(1))
    later = fit_joint(dataclasses.replace(grid, arrival_s=grid.arrival_s + 1000.0))
    for name, found in fit.summary.items():
        shift = 1000.0 if name == "release_s" else 0.0
        assert later.summary[name].mean == pytest.approx(found.mean + shift, rel=1e-5)


def test_the_order_of_the_receivers_does_not_matter(fit: JointFit) -> None:
    other = fit_joint(reversed_rows(simulated(PAPER_LIKE, MODEL, np.random.default_rng(1))))
    for name, found in fit.summary.items():
        assert other.summary[name].mean == pytest.approx(found.mean, rel=1e-5)


def test_the_same_seed_gives_the_same_draws(fit: JointFit) -> None:
    again = fit_joint(simulated(PAPER_LIKE, MODEL, np.random.default_rng(1)))
    for name, drawn in fit.draws.items():
        np.testing.assert_array_equal(again.draws[name], drawn)


def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    """24 bursts drawn from the prior; bands that a calibrated fit leaves once in a thousand times."""
    rng = np.random.default_rng(7)
    within = {name: [0, 0] for name in ("phi0_deg", "v_sw_km_s", "beam_speed_c")}
    for _ in range(24):
        z = rng.standard_normal(5)
        found = fit_joint(simulated(z, MODEL, rng), draws=1000).summary
        for name, count in within.items():
            value, one = float(getattr(MODEL.natural(z[None]), name)[0]), found[name]
            if name == "phi0_deg":
                value = one.mean + (value - one.mean + 180) % 360 - 180
            count[0] += one.q16 < value < one.q84
            count[1] += one.q2_5 < value < one.q97_5
    for one_sigma, two_sigma in within.values():
        assert 9 <= one_sigma <= 23
        assert two_sigma >= 19


def test_a_common_offset_widens_the_longitude_most() -> None:
    grid = simulated(PAPER_LIKE, MODEL, np.random.default_rng(1))
    none, shared = (fit_joint(grid, common_sd_s=offset).summary for offset in (0.0, 30.0))
    assert shared["phi0_deg"].sd > 1.5 * none["phi0_deg"].sd
    assert shared["b"].sd < 1.5 * none["b"].sd


def test_an_offset_that_is_there_is_not_taken_for_a_longitude() -> None:
    grid = simulated(PAPER_LIKE, MODEL, None, scale=0.2)
    late = dataclasses.replace(grid, arrival_s=grid.arrival_s + np.array([0.0, 40.0, 0.0]))
    blind, aware = (fit_joint(late, common_sd_s=offset).summary["phi0_deg"] for offset in (0.0, 40.0))
    assert abs(blind.mean - 30.0) > 4 * blind.sd
    assert abs(aware.mean - 30.0) < 2 * aware.sd


def test_a_source_behind_the_sun_has_one_longitude_across_180_degrees() -> None:
    behind = fit_joint(simulated(standard(MODEL, 179.0, 400.0), MODEL, np.random.default_rng(3)))
    found = behind.summary["phi0_deg"]
    assert abs((found.mean - 179.0 + 180) % 360 - 180) < 4 * found.sd
    assert found.sd < 15.0
    assert np.ptp(behind.draws["phi0_deg"]) < 180.0


def test_a_source_that_turns_with_the_sun_is_no_spiral() -> None:
    assert "not_a_spiral" in fit_joint(retrograde(np.random.default_rng(2))).flags


def test_noise_that_hides_the_wind_is_flagged() -> None:
    noisy = fit_joint(simulated(PAPER_LIKE, MODEL, np.random.default_rng(1), scale=20.0))
    assert "v_sw_not_constrained" in noisy.flags
    assert noisy.summary["v_sw_km_s"].contraction > 0.9


def test_a_beam_that_would_outrun_light_is_held_below_it() -> None:
    """0.3 c at the Sun, growing as the root of the distance: above c beyond 11 solar radii."""
    model = JointModel(deceleration=True)
    outrunning = standard(model, 30.0, 400.0)
    outrunning[4:] = math.log(2.0) / 0.5, -0.5 / 0.3
    held = fit_joint(simulated(outrunning, model, np.random.default_rng(1)), model)
    range_rsun = model.range_rsun(held.parameters, FREQUENCY_MHZ[:1])[:, 0]
    fastest = held.draws["beam_speed_c"] * np.maximum(range_rsun ** -held.draws["deceleration"], 1.0)
    assert fastest.max() <= 1.0
    assert held.summary["beam_speed_c"].sd > 0


def test_errors_stated_too_small_are_flagged() -> None:
    grid = simulated(PAPER_LIKE, MODEL, np.random.default_rng(1))
    assert "poor_fit" in fit_joint(dataclasses.replace(grid, sigma_s=grid.sigma_s / 2)).flags


def test_times_that_no_spiral_explains_give_no_numbers() -> None:
    grid = simulated(PAPER_LIKE, MODEL, None)
    wrong = fit_joint(dataclasses.replace(grid, arrival_s=grid.arrival_s[::-1]))
    assert set(wrong.flags) == {"poor_fit", "poor_weights"}
    assert joint_json(wrong)["v_sw_km_s"]["mean"] is None


def test_times_that_no_spiral_explains_are_not_sampled_for_a_minute() -> None:
    grid = simulated(PAPER_LIKE, MODEL, None)
    hopeless = Ingredients(dataclasses.replace(grid, arrival_s=grid.arrival_s[::-1]))
    fit = fit_ingredients(hopeless, options=JointOptions(fallback=True))
    assert fit.account.sampler == "importance"
    assert fit.summary == {}


@pytest.mark.parametrize("factor", [1e-9, 1e-170])
def test_errors_of_almost_nothing_overflow_nothing(factor: float) -> None:
    grid = simulated(PAPER_LIKE, MODEL, np.random.default_rng(1))
    with np.errstate(all="raise", under="ignore"):
        wrong = fit_joint(dataclasses.replace(grid, sigma_s=grid.sigma_s * factor))
    assert "poor_fit" in wrong.flags
    json.dumps(joint_json(wrong), allow_nan=False)


@pytest.mark.parametrize("number", [1, 2, 3])
def test_few_frequencies_give_no_numbers(number: int) -> None:
    few = fit_joint(simulated(PAPER_LIKE, MODEL, np.random.default_rng(1)).take(np.arange(number)))
    assert few.flags == ("too_few_frequencies",)
    assert few.summary == few.draws == {}
    record = joint_json(few)
    assert record["v_sw_km_s"]["mean"] is None
    assert record["release_utc"]["q50"] is None
    json.dumps(record, allow_nan=False)
    with pytest.raises(InputError, match="too_few_frequencies"):
        track_positions(few, FREQUENCY_MHZ)


def test_frequencies_of_two_receivers_count() -> None:
    grid = simulated(PAPER_LIKE, MODEL, np.random.default_rng(1))
    gaps = grid.arrival_s.copy()
    gaps[::2, 2] = np.nan
    some = dataclasses.replace(grid, arrival_s=gaps)
    third, with_gaps, whole = (fit_joint(one) for one in (grid.take(np.arange(1, 40, 2)), some, grid))
    widths = [one.summary["b"].sd for one in (third, with_gaps, whole)]
    assert widths == sorted(widths, reverse=True)


def test_bad_arguments_are_refused() -> None:
    grid = simulated(PAPER_LIKE, MODEL, None)
    for wrong in ({"draws": 10}, {"common_sd_s": -1.0}, {"common_sd_s": float("nan")}):
        with pytest.raises(InputError, match=r"give 100 draws or more|give 0 s or more"):
            fit_joint(grid, **wrong)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="cannot be compared"):
        compare_models(grid, [])


def test_positions_follow_the_spiral(fit: JointFit) -> None:
    mean, covariance = track_positions(fit, FREQUENCY_MHZ)
    truth = MODEL.natural(PAPER_LIKE[None])
    expected = MODEL.position_rsun(truth, MODEL.range_rsun(truth, FREQUENCY_MHZ))[0, :, :2]
    away = mean - expected
    assert (np.einsum("fi,fij,fj->f", away, np.linalg.inv(covariance), away) < 16).all()
    assert (np.linalg.eigvalsh(covariance) > 0).all()


@pytest.mark.parametrize("variant", [{"deceleration": True}, {"two_slope": True}])
def test_evidence_finds_what_is_there_and_asks_for_no_more(variant: dict[str, bool]) -> None:
    rich = JointModel(**variant)  # type: ignore[arg-type]
    strong = standard(rich, 30.0, 400.0)
    strong[5] = 2.0
    for truth, model in ((strong, rich), (PAPER_LIKE, MODEL)):
        grid = simulated(truth, model, np.random.default_rng(2), scale=0.25)
        best, other = compare_models(grid, [MODEL, rich])
        assert best.fit.model == model
        assert best.probability + other.probability == pytest.approx(1.0)
        assert best.log_bayes_factor == 0.0 > other.log_bayes_factor


def test_record_has_the_promised_columns(fit: JointFit) -> None:
    record = joint_json(fit)
    columns = ["mean", "sd", "q2_5", "q16", "q50", "q84", "q97_5", "contraction"]
    for name in (*MODEL.parameters, "release_utc"):
        assert list(record[name]) == columns
    assert record["release_utc"]["mean"].startswith("2012-06-07T19:08:")
    assert record["release_utc"]["mean"].endswith("Z")
    assert set(record["flags"]) <= set(TRACK_FLAGS)
    assert record["rotation_period_d"] == 25.38
    assert record["epoch_utc"] == "2012-06-07T19:00:00.000Z"
    json.dumps(record, allow_nan=False)


def test_weighted_draws_have_the_moments_of_their_distribution() -> None:
    rng = np.random.default_rng(0)
    values = rng.uniform(-8, 8, 200_000)
    weight = np.exp(-0.5 * values**2)
    found = summarise(values, weight / weight.sum(), 0.0)
    expected = {"mean": 0.0, "sd": 1.0, "q2_5": -1.96, "q16": -0.9945, "q50": 0.0, "q84": 0.9945, "q97_5": 1.96}
    for name, value in expected.items():
        assert getattr(found, name) == pytest.approx(value, abs=0.02)


def test_longitudes_on_both_sides_of_180_degrees_stay_together() -> None:
    close = beside_mean(np.array([175.0, -175.0, -170.0]), np.full(3, 1 / 3))
    assert np.ptp(close) == pytest.approx(15.0)
    assert close.mean() == pytest.approx(-176.667, abs=1e-3)
