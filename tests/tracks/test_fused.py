"""The fused fit: consistent ingredients narrow it and keep it calibrated, and one that is wrong is found."""

import dataclasses
import json

import numpy as np
import pytest

from bella.exceptions import InputError
from bella.tracks import (
    FusedFit,
    Ingredients,
    JointModel,
    JointOptions,
    WindPrior,
    fit_fused,
    fit_ingredients,
    fit_joint,
    fused_json,
)
from bella.tracks.joint_observed import Observed
from tests.tracks.bursts import simulated, standard, towards_source

MODEL = JointModel()
PAPER_LIKE = standard(MODEL, 30.0, 400.0)
QUICK = JointOptions(draws=1000)


def known(seed: int = 1, *, scale: float = 1.0, wind: WindPrior | None = None) -> Ingredients:
    rng = np.random.default_rng(seed)
    grid = simulated(PAPER_LIKE, MODEL, rng, scale)
    return Ingredients(grid, 0.0, towards_source(PAPER_LIKE, MODEL, rng), wind)


@pytest.fixture(scope="module")
def fused() -> FusedFit:
    return fit_fused(known(wind=WindPrior(395.0, 25.0)))


def test_consistent_ingredients_narrow_the_answer_and_agree(fused: FusedFit) -> None:
    plain = fit_joint(known().arrivals, common_sd_s=0.0)
    for name in ("phi0_deg", "v_sw_km_s"):
        assert fused.fit.summary[name].sd < 0.6 * plain.summary[name].sd
    assert abs(fused.fit.summary["phi0_deg"].mean - 30.0) < 3 * fused.fit.summary["phi0_deg"].sd
    assert fused.fit.flags == ()
    for one in fused.ingredients:
        assert one.chi2 < 2 * one.number + 6
        assert 0 <= one.tension < 3


def test_each_ingredient_has_its_weight_where_it_measures(fused: FusedFit) -> None:
    weights = {one.name: one.sd_ratio for one in fused.ingredients}
    assert list(weights) == ["arrival_times", "wave_directions", "wind_prior"]
    assert weights["wind_prior"]["v_sw_km_s"] < 0.8
    assert weights["wave_directions"]["phi0_deg"] < 0.95
    # nothing but arrival times knows of the beam
    assert weights["arrival_times"]["beam_speed_c"] < 0.3
    assert weights["wind_prior"]["beam_speed_c"] > 0.9


@pytest.mark.parametrize("name", ["wave_directions", "wind_prior"])
def test_a_fit_without_an_ingredient_is_the_fit_that_never_had_it(fused: FusedFit, name: str) -> None:
    everything = known(wind=WindPrior(395.0, 25.0))
    field = {"wave_directions": "directions", "wind_prior": "wind"}[name]
    never = fit_ingredients(dataclasses.replace(everything, **{field: None}), MODEL)
    without = next(one.without for one in fused.ingredients if one.name == name)
    assert without.summary == never.summary
    for drawn in never.draws:
        np.testing.assert_array_equal(without.draws[drawn], never.draws[drawn])


def test_arrival_times_alone_are_the_joint_fit() -> None:
    alone = known().without("wave_directions")
    assert fit_ingredients(alone).summary == fit_joint(alone.arrivals, common_sd_s=0.0).summary
    assert fit_fused(alone).ingredients == ()


def test_a_wrong_wind_is_found() -> None:
    wrong = fit_fused(known(scale=0.25, wind=WindPrior(650.0, 25.0)), MODEL, QUICK)
    assert "ingredients_disagree" in wrong.fit.flags
    tension = {one.name: one.tension for one in wrong.ingredients}
    assert tension["wind_prior"] > 5


def test_directions_that_are_turned_are_found() -> None:
    burst = known(scale=0.25)
    terms = burst.directions
    assert terms is not None
    turn = np.radians(12.0)
    turned = terms.towards @ np.array([[np.cos(turn), np.sin(turn), 0], [-np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    wrong = fit_fused(dataclasses.replace(burst, directions=dataclasses.replace(terms, towards=turned)), MODEL, QUICK)
    assert "ingredients_disagree" in wrong.fit.flags


def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    """24 bursts drawn from the prior; bands that a calibrated fit leaves once in a thousand times."""
    rng = np.random.default_rng(11)
    within = {name: [0, 0] for name in ("phi0_deg", "v_sw_km_s")}
    narrower = []
    for _ in range(24):
        z = rng.standard_normal(5)
        z[1] = np.clip(z[1], -2, 3)
        truth = MODEL.natural(z[None])
        heard = simulated(z, MODEL, rng)
        speed = float(truth.v_sw_km_s[0]) / (1 + 0.06 * rng.standard_normal())
        wind = WindPrior(speed, 0.06 * speed)
        burst = Ingredients(heard, 0.0, towards_source(z, MODEL, rng), wind)
        found = fit_ingredients(burst, MODEL, QUICK).summary
        narrower.append(found["phi0_deg"].sd / fit_joint(heard, common_sd_s=0.0, draws=1000).summary["phi0_deg"].sd)
        for name, count in within.items():
            value, one = float(getattr(truth, name)[0]), found[name]
            if name == "phi0_deg":
                value = one.mean + (value - one.mean + 180) % 360 - 180
            count[0] += one.q16 < value < one.q84
            count[1] += one.q2_5 < value < one.q97_5
    for one_sigma, two_sigma in within.values():
        assert 9 <= one_sigma <= 23
        assert two_sigma >= 19
    assert np.median(narrower) < 0.8


def test_record_shows_every_weight(fused: FusedFit) -> None:
    record = fused_json(fused)
    assert [one["name"] for one in record["ingredients"]] == ["arrival_times", "wave_directions", "wind_prior"]
    for one in record["ingredients"]:
        assert set(one["sd_ratio"]) == set(MODEL.parameters) == set(one["shift_sd"])
    json.dumps(record, allow_nan=False)


@pytest.mark.parametrize(("speed", "sd"), [(0.0, 25.0), (400.0, 0.0), (400.0, 500.0), (float("nan"), 25.0)])
def test_winds_that_are_none_are_refused(speed: float, sd: float) -> None:
    with pytest.raises(InputError, match="give a speed between"):
        WindPrior(speed, sd)


def test_an_ingredient_that_is_not_there_cannot_be_left_out() -> None:
    with pytest.raises(InputError, match="choose one of arrival_times"):
        known().without("wind_prior")


def test_longitudes_shift_the_short_way_round() -> None:
    """A burst behind the Sun, whose posteriors have means on either side of 180 degrees."""
    z, rng = standard(MODEL, 179.0, 400.0), np.random.default_rng(2)
    fused = fit_fused(Ingredients(simulated(z, MODEL, rng), 0.0, towards_source(z, MODEL, rng)), MODEL, QUICK)
    others = [one for one in fused.ingredients if one.without.summary]
    means = [one.without.summary["phi0_deg"].mean for one in others]
    assert min(means) < 0 < fused.fit.summary["phi0_deg"].mean
    assert all(abs(one.shift_sd["phi0_deg"]) < 3 for one in others)


def test_a_wind_prior_is_a_density_of_the_slowness() -> None:
    """It adds up to one over 1 / v in units of that of the prior, as the other parts do over what they measure."""
    prior = WindPrior(420.0, 30.0)
    z = np.zeros((4001, len(MODEL.parameters)))
    z[:, 1] = np.linspace(-3, 3, 4001)
    relative = MODEL.slowness(z)[:, 0] * prior.v_sw_km_s / MODEL.priors.v_sw_km_s
    density = np.exp(Observed(None, wind=prior).log_norm - 0.5 * prior.residual(MODEL, z) ** 2)
    assert np.trapezoid(density, relative) == pytest.approx(1.0, abs=1e-6)
