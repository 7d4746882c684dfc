"""The declared cases, and the truths drawn for them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from bella.calibration.strata import STRATA, Misfit, Stratum, find_strata
from bella.calibration.truths import SPIRAL_RSUN, Truths, arrival_grid, draw_truths
from bella.exceptions import InputError
from bella.multilateration.priors import Noise, Priors
from bella.units import AU_RSUN, C_RSUN_S

PLAIN = Stratum("case", 3, 116.0, 38.0)


def errors(stratum: Stratum, number: int = 4000) -> np.ndarray:
    """Arrival times less light travel at the true speed and the emission time, s."""
    rng = np.random.default_rng(12)
    truths = draw_truths(stratum, number, rng)
    grid = arrival_grid(stratum, truths, rng)
    source = np.zeros((number, 3))
    source[:, : stratum.dimensions] = truths.position_rsun
    distance = np.linalg.norm(source[:, None] - grid.receiver_rsun, axis=2)
    return grid.arrival_s - truths.emission_s[:, None] - distance / truths.v_over_c[:, None] / C_RSUN_S


def test_the_table_has_what_was_promised() -> None:
    declared = [stratum for stratum in STRATA if stratum.misfit is None]
    assert len({stratum.name for stratum in STRATA}) == len(STRATA)
    assert {stratum.separation_deg for stratum in declared} == {10, 40, 116, 170}
    assert {stratum.receivers for stratum in declared} == {3, 4, 5}
    assert {stratum.sigma_s for stratum in declared} == {7, 38, 60}
    assert {(stratum.dimensions, stratum.receivers) for stratum in declared} >= {(3, 4), (3, 5)}
    assert len(STRATA) - len(declared) == 5


def test_receivers_leave_the_plane_for_a_source_in_space_only() -> None:
    flat = replace(PLAIN, receivers=5).receiver_rsun
    deep = replace(PLAIN, receivers=5, dimensions=3).receiver_rsun
    assert np.linalg.norm(flat, axis=1) == pytest.approx(AU_RSUN * np.array([1, 1, 1, 0.5, 0.8]))
    assert np.linalg.norm(deep, axis=1) == pytest.approx(np.linalg.norm(flat, axis=1))
    assert not flat[:, 2].any()
    assert np.degrees(np.arcsin(deep[3:, 2] / np.linalg.norm(deep[3:], axis=1))) == pytest.approx([30, -25])
    assert np.degrees(np.arctan2(flat[1, 1], flat[1, 0])) == pytest.approx(116)


def test_find_strata_in_order_of_the_table() -> None:
    assert [stratum.name for stratum in find_strata(["wide", "near"])] == ["near", "wide"]
    assert find_strata() == STRATA
    with pytest.raises(InputError, match="stratum 'far' is not known; choose from together"):
        find_strata(["near", "far"])


def test_truths_come_from_the_prior() -> None:
    stratum = replace(PLAIN, priors=Priors(v_sd_c=0.1, v_max_c=1.0))
    truths = draw_truths(stratum, 4000, np.random.default_rng(2))
    assert stats.kstest(truths.position_rsun.ravel() / stratum.priors.tau_rsun, "norm").pvalue > 0.01
    # below its centre a Gaussian is a half-normal
    assert stats.kstest((1 - truths.v_over_c) / 0.1, "halfnorm").pvalue > 0.01


@pytest.mark.parametrize(
    ("change", "sd"),
    [
        ({}, 38.0),
        ({"offset_sd_s": 50.0}, np.hypot(38, 50)),
        ({"misfit": Misfit("", error_factor=2.0)}, 76.0),
        ({"dimensions": 3, "receivers": 4, "priors": Priors(v_sd_c=0.1)}, 38.0),
    ],
)
def test_errors_are_gaussian_with_the_declared_width(change: dict[str, object], sd: float) -> None:
    found = errors(replace(PLAIN, **change))  # type: ignore[arg-type]
    assert stats.kstest(found.ravel() / sd, "norm").pvalue > 0.01


def test_bad_arrivals_are_as_many_as_the_model_says_and_never_two() -> None:
    found = np.abs(errors(replace(PLAIN, receivers=4, sigma_s=1.0, noise=Noise(bad_probability=0.05)))) > 6
    # one of four or none: 4 p q^3 / (q^4 + 4 p q^3) = 4 p / (q + 4 p); of the bad ones 0.8 % are within 6 s by chance
    expected = 4 * 0.05 / (0.95 + 4 * 0.05) * 0.992
    assert found.sum(axis=1).max() == 1
    assert abs(found.sum() - 4000 * expected) < 4 * np.sqrt(4000 * expected * (1 - expected))


def test_one_receiver_is_late() -> None:
    found = errors(replace(PLAIN, sigma_s=0.01, misfit=Misfit("", late_s=300.0)))
    assert np.sort(found, axis=1) == pytest.approx(np.tile([0, 0, 300], (4000, 1)), abs=0.1)
    assert np.bincount(found.argmax(axis=1)).min() > 1200


def test_delay_grows_towards_a_view_from_behind() -> None:
    stratum = replace(PLAIN, separation_deg=90.0, sigma_s=1e-6, misfit=STRATA[-1].misfit)
    truths = Truths(np.array([[100.0, 0.0], [-1e-9, 0.0]]), np.zeros(2), np.ones(2))
    grid = arrival_grid(stratum, truths, np.random.default_rng(0))
    source = np.pad(truths.position_rsun, ((0, 0), (0, 1)))
    late = grid.arrival_s - np.linalg.norm(source[:, None] - grid.receiver_rsun, axis=2) / C_RSUN_S
    # ahead of the source: 10 s; from the side, behind by atan(100/215): cos a = -100/237.1
    side = 10 + 25 * (1 + 100 / np.hypot(100, AU_RSUN))
    assert late[0] == pytest.approx([10, side, side], abs=1e-3)
    assert late[1] == pytest.approx([60, 35, 35], abs=1e-3)


def test_sources_on_spirals_keep_their_range() -> None:
    stratum = replace(PLAIN, misfit=Misfit("", on_spiral=True))
    radius = np.linalg.norm(draw_truths(stratum, 4000, np.random.default_rng(4)).position_rsun, axis=1)
    low, high = SPIRAL_RSUN
    assert stats.kstest((radius - low) / (high - low), "uniform").pvalue > 0.01
