"""The posterior is calibrated; one that is not is found out."""

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from bella.arrivals import ArrivalGrid
from bella.calibration import Comparison, Verdict, find_strata, judge, run_stratum
from bella.calibration.study import FEWEST_SOURCES, compare, recipe_of
from bella.calibration.truths import Truths, arrival_grid, draw_truths
from bella.exceptions import InputError
from bella.multilateration.posterior import Posterior, exact_posterior

WRONG_SOURCES = 200


def run(name: str, sources: int = 100, seed: int = 3) -> Comparison:
    return run_stratum(find_strata([name])[0], sources, seed, lambda _: None)


def verdict(comparison: Comparison) -> Verdict:
    return judge([comparison], 3)[0]


@pytest.mark.parametrize("name", ["near", "wide-speed", "four-subluminal", "four-robust", "four-offsets"])
def test_the_posterior_is_calibrated(name: str) -> None:
    found = verdict(run(name))
    assert found.passed, found
    assert found.ess_share_least > 0.25


def test_the_posterior_is_calibrated_in_space() -> None:
    comparison = run("space-four", 30)
    assert list(comparison.ranks) == ["x", "y", "z", "emission", "speed", "density"]
    assert verdict(comparison).passed


def test_stated_errors_half_of_the_true_ones_are_found_out() -> None:
    comparison = run("sigma-halved", WRONG_SOURCES)
    found = verdict(comparison)
    assert not found.passed
    assert found.smallest_p * found.tests < 0.001
    assert not any(coverage.passes for coverage in comparison.coverage.values())


def test_only_the_robust_preset_survives_an_outlier() -> None:
    plain, robust = verdict(run("outlier", 60)), verdict(run("outlier-robust", 60))
    assert plain.cover68 < 0.1
    assert robust.cover68 > 0.4
    assert not plain.passed


@lru_cache
def wide() -> tuple[Truths, ArrivalGrid, Posterior]:
    stratum = find_strata(["wide"])[0]
    rng = np.random.default_rng(8)
    truths = draw_truths(stratum, WRONG_SOURCES, rng)
    grid = arrival_grid(stratum, truths, rng)
    return truths, grid, exact_posterior(grid, recipe_of(stratum, 1), lambda _: None)


def moved(posterior: Posterior) -> Posterior:
    draws = posterior.draws
    return replace(posterior, draws=replace(draws, position=draws.position + np.array([8.0, 0.0])))


def narrowed(posterior: Posterior) -> Posterior:
    draws = posterior.draws
    centre = draws.position.mean(axis=1, keepdims=True)
    return replace(posterior, draws=replace(draws, position=centre + 0.6 * (draws.position - centre)))


def shrunk(posterior: Posterior) -> Posterior:
    regions = [replace(one, log_threshold=tuple(np.array(one.log_threshold) + 0.5)) for one in posterior.regions]
    return replace(posterior, regions=regions)


def late(posterior: Posterior) -> Posterior:
    draws = posterior.draws
    return replace(posterior, draws=replace(draws, emission_s=draws.emission_s + 15.0))


@pytest.mark.parametrize(
    ("damage", "passes", "of"),
    [(lambda same: same, True, None), (moved, False, "x"), (narrowed, False, "density"), (late, False, "emission")],
)
def test_wrong_draws_are_found_out(damage: Callable[[Posterior], Posterior], passes: bool, of: str | None) -> None:
    truths, grid, posterior = wide()
    found = verdict(compare(find_strata(["wide"])[0], truths, grid, damage(posterior), np.random.default_rng(0)))
    assert found.passed is passes
    assert of in {None, found.smallest_p_of}


def test_regions_that_are_too_small_are_found_out() -> None:
    truths, grid, posterior = wide()
    found = compare(find_strata(["wide"])[0], truths, grid, shrunk(posterior), np.random.default_rng(0))
    assert not verdict(found).passed
    assert not found.coverage[0.68].passes


def test_a_stratum_has_random_numbers_of_its_own() -> None:
    one, again, other = run("wide", 20), run("wide", 20), run("wide", 20, seed=4)
    assert one.ranks["x"].tolist() == again.ranks["x"].tolist()
    assert one.ranks["x"].tolist() != other.ranks["x"].tolist()


def test_progress_is_told_of_every_source() -> None:
    told: list[int] = []
    run_stratum(find_strata(["wide"])[0], 30, 1, told.append)
    assert sum(told) == 30


def test_too_few_sources_are_refused() -> None:
    with pytest.raises(InputError, match="19 sources say nothing"):
        run("wide", FEWEST_SOURCES - 1)
