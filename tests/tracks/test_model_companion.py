"""Models beside the joint one: those that the times ask for, and a longitude that stands for all of them."""

import numpy as np
import pytest

from bella.exceptions import NoDataError
from bella.tracks import Ingredients, JointModel, fit_joint
from bella.tracks.joint_modes import find_modes
from bella.tracks.model_companion import model_companion, variants
from tests.tracks.bursts import simulated, standard

MODEL = JointModel()


def companion(deceleration: float, seed: int) -> dict[str, object]:
    slowing = JointModel(deceleration=True)
    z = standard(slowing, 30.0, 400.0)
    z[slowing.parameters.index("deceleration")] = slowing.standard("deceleration", np.array(deceleration))
    known = Ingredients(simulated(z, slowing, np.random.default_rng(seed)), 0.0)
    return model_companion(known, fit_joint(known.arrivals, MODEL, common_sd_s=0.0), 1)


def test_a_steady_beam_does_not_ask_for_more() -> None:
    said = companion(0.0, 3)
    rows = said["rows"]
    assert len(rows) == len({row["name"] for row in rows}) == 6
    assert sum(row["probability"] for row in rows) == pytest.approx(1.0)
    assert [row["log_bayes_factor"] for row in rows] == sorted((row["log_bayes_factor"] for row in rows), reverse=True)
    plain = next(row for row in rows if row["name"] == MODEL.name)
    assert plain["log_bayes_factor"] > -3
    assert said["phi0_deg"]["q2_5"] < 30.0 < said["phi0_deg"]["q97_5"]


def test_the_average_is_that_of_the_mixture() -> None:
    said = companion(0.3, 4)  # asks for a slowing beam, and the steady ones are degrees away
    share = np.array([row["probability"] for row in said["rows"]])
    mean, sd = (np.array([row["phi0_deg"][name] for row in said["rows"]]) for name in ("mean", "sd"))
    assert abs(share @ mean - mean.mean()) > 0.1 * sd.mean(), "all models alike would show no weights"
    assert said["phi0_deg"]["mean"] == pytest.approx(share @ mean, abs=0.05 * sd.mean())
    expected = np.sqrt(share @ (sd**2 + mean**2) - (share @ mean) ** 2)
    assert said["phi0_deg"]["sd"] == pytest.approx(expected, rel=0.02)


def test_knots_divide_the_track() -> None:
    grid = simulated(standard(MODEL, 30.0, 400.0), MODEL, np.random.default_rng(5))
    known = Ingredients(grid, 0.0)
    found = variants(fit_joint(grid, MODEL, common_sd_s=0.0), known)
    knots = [model.knots_rsun for model in found if model.knots_rsun]
    assert [len(places) for places in knots] == [1, 2]
    assert knots[1][0] < knots[0][0] < knots[1][1]


def test_without_a_joint_fit_there_is_nothing_to_compare() -> None:
    grid = simulated(standard(MODEL, 30.0, 400.0), MODEL, np.random.default_rng(5))
    few = grid.take(np.array([0, 20]))
    with pytest.raises(NoDataError, match="too_few_frequencies"):
        model_companion(Ingredients(few), fit_joint(few, MODEL), 1)


@pytest.mark.parametrize("longitude_deg", [30.0, 170.0, -120.0])
def test_maxima_of_variants_are_found_from_those_of_the_plain_model(longitude_deg: float) -> None:
    grid = simulated(standard(MODEL, longitude_deg, 400.0), MODEL, np.random.default_rng(6))
    known = Ingredients(grid, 0.0)
    plain = find_modes(MODEL, known.observed())
    near = dict(zip(MODEL.parameters, plain.z.T, strict=True))
    for model in variants(fit_joint(grid, MODEL, common_sd_s=0.0), known):
        everywhere, from_near = find_modes(model, known.observed()), find_modes(model, known.observed(), near)
        assert from_near.misfit == pytest.approx(everywhere.misfit, abs=1e-3), model.name
