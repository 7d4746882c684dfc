"""Ranks: uniform ones pass, others do not, and the band holds what it says."""

import numpy as np
import pytest
from scipy import stats

from bella.calibration.ranks import bins_of, fractional_ranks, pp_curve, simultaneous_band, uniformity

SOURCES, DRAWS = 400, 199


def ranks_of(shift: float, scale: float, seed: int = 5) -> np.ndarray:
    """Ranks of standard normal truths among draws of another normal."""
    rng = np.random.default_rng(seed)
    draws = shift + scale * rng.standard_normal((SOURCES, DRAWS))
    return fractional_ranks(rng.standard_normal(SOURCES), draws, rng)


def test_ranks_of_a_right_posterior_are_uniform() -> None:
    assert uniformity(ranks_of(0.0, 1.0)).smallest > 0.01


def test_shifted_draws_are_seen_by_their_distribution() -> None:
    found = uniformity(ranks_of(0.4, 1.0))
    assert found.ks_p < 1e-6
    assert found.smallest == min(found.ks_p, found.chi2_p)


@pytest.mark.parametrize("scale", [0.6, 1.6])
def test_draws_of_the_wrong_width_are_seen_by_their_shape(scale: float) -> None:
    assert uniformity(ranks_of(0.0, scale)).chi2_p < 1e-6


def test_a_rank_counts_the_draws_below() -> None:
    truth, draws = np.array([0.5, -1.0, 9.0]), np.tile(np.arange(4.0), (3, 1))
    ranks = fractional_ranks(truth, draws, np.random.default_rng(0))
    assert np.floor(ranks * 5).tolist() == [1, 0, 4]


def test_ties_are_broken_evenly() -> None:
    ranks = fractional_ranks(np.zeros(5000), np.zeros((5000, 9)), np.random.default_rng(3))
    assert uniformity(ranks).smallest > 0.01


def test_bins_keep_enough_sources() -> None:
    assert [bins_of(number) for number in (20, 100, 1000)] == [2, 10, 20]


def test_pp_curve_ends_at_one() -> None:
    assert pp_curve(np.array([0.1, 0.2, 0.3, 0.9]), 4).tolist() == [0.5, 0.75, 0.75, 1.0]


@pytest.mark.parametrize("number", [100, 1000])
def test_band_holds_the_whole_curve_of_uniform_ranks_in_95_of_100_cases(number: int) -> None:
    rng = np.random.default_rng(17)
    low, high = simultaneous_band(number, 50)
    curves = np.array([pp_curve(rng.random(number), 50) for _ in range(3000)])
    held = ((curves >= low) & (curves <= high)).all(axis=1).sum()
    # counts are discrete, so the band may hold a little more; its level comes from 10 000 simulations of its own
    assert stats.binom.ppf(0.0005, 3000, 0.945) <= held <= stats.binom.ppf(0.9995, 3000, 0.96)


def test_band_leaves_out_a_curve_of_shifted_draws() -> None:
    low, high = simultaneous_band(SOURCES, 50)
    curve = pp_curve(ranks_of(0.4, 1.0), 50)
    assert ((curve < low) | (curve > high)).any()
