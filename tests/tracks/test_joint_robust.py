"""Bad arrival times: named and without effect, where there are few; not invented, and not hiding a wrong model."""

import dataclasses

import numpy as np
import pytest

from bella.arrivals import ArrivalGrid
from bella.tracks import Ingredients, JointModel, JointOptions, fit_ingredients, fit_joint
from tests.tracks.bursts import simulated, standard

MODEL = JointModel()
BURST = simulated(standard(MODEL, 30.0, 400.0), MODEL, np.random.default_rng(1))


def late(grid: ArrivalGrid, row: int, column: int, by_s: float) -> ArrivalGrid:
    arrival = grid.arrival_s.copy()
    arrival[row, column] += by_s
    return dataclasses.replace(grid, arrival_s=arrival)


@pytest.mark.parametrize(("row", "column"), [(0, 0), (20, 1), (39, 2)])
@pytest.mark.parametrize("by_s", [5000.0, -5000.0, 600.0])
def test_one_bad_arrival_is_named_and_does_no_harm(row: int, column: int, by_s: float) -> None:
    clean, hurt = fit_joint(BURST), fit_joint(late(BURST, row, column, by_s))
    for name, found in clean.summary.items():
        assert hurt.summary[name].mean == pytest.approx(found.mean, abs=0.6 * found.sd), name
        assert hurt.summary[name].sd == pytest.approx(found.sd, rel=0.25), name
    assert hurt.flags == ("arrivals_down_weighted",)
    ((observatory, frequency, weight),) = hurt.account.down_weighted
    assert (observatory, frequency) == (BURST.observatories[column], BURST.frequency_mhz[row])
    assert weight < 0.01


def test_without_weights_one_bad_arrival_destroys_the_fit() -> None:
    bad = Ingredients(late(BURST, 20, 1, 5000.0))
    blind = fit_ingredients(bad, options=JointOptions(robust=False))
    assert "poor_fit" in blind.flags
    assert blind.account.down_weighted == ()


def test_good_arrivals_keep_their_full_weight() -> None:
    robust, plain = (fit_ingredients(Ingredients(BURST), options=JointOptions(robust=on)) for on in (True, False))
    assert robust.summary == plain.summary
    assert robust.account.down_weighted == ()


def test_a_wrong_model_is_not_hidden_by_weights() -> None:
    reversed_times = dataclasses.replace(BURST, arrival_s=BURST.arrival_s[::-1])
    wrong = fit_joint(reversed_times)
    assert "poor_fit" in wrong.flags
    assert wrong.account.down_weighted == ()


def test_undeclared_offsets_are_assumed_and_declared_ones_are_taken() -> None:
    assumed = fit_joint(BURST).account
    assert assumed.common_assumed == BURST.observatories
    assert assumed.common_sd_s == pytest.approx({"A": 18.0, "B": 11.4, "C": 11.4})
    small = dataclasses.replace(BURST, sigma_s=np.full(BURST.arrival_s.shape, 1.0))
    assert set(fit_joint(small).account.common_sd_s.values()) == {2.0}
    declared = np.broadcast_to([0.0, 5.0, 0.0], BURST.arrival_s.shape)
    some = fit_joint(dataclasses.replace(BURST, offset_sd_s=declared)).account
    assert (some.common_assumed, some.common_sd_s["B"]) == (("A", "C"), 5.0)
    assert fit_joint(BURST, common_sd_s=0.0).account.common_assumed == ()


def test_a_receiver_that_hears_nothing_changes_nothing() -> None:
    """Two receivers hear all, and the third nothing at all."""
    gaps = BURST.arrival_s.copy(), BURST.sigma_s.copy()
    for one in gaps:
        one[:, 2] = np.nan
    silent = dataclasses.replace(BURST, arrival_s=gaps[0], sigma_s=gaps[1])
    pair = {name: getattr(BURST, name)[:, :2] for name in ("arrival_s", "sigma_s", "receiver_rsun", "offset_sd_s")}
    nuisance = {name: getattr(BURST, name)[:, :2] for name in ("delay_s", "delay_sd_s")}
    two = dataclasses.replace(BURST, observatories=("A", "B"), **pair, **nuisance)
    for name, found in fit_joint(two).summary.items():
        assert fit_joint(silent).summary[name].mean == pytest.approx(found.mean, rel=1e-6)


def test_assumed_offsets_do_not_hide_a_beam_that_slows() -> None:
    """Three receivers cannot show an offset, so what an assumed one takes up is a wrong model."""
    slow = JointModel(deceleration=True)
    z = standard(slow, 30.0, 400.0)
    z[slow.parameters.index("deceleration")] = 1.0
    grid = simulated(z, slow, np.random.default_rng(2), scale=0.3)
    for common_sd_s in (None, 0.0):
        assert "poor_fit" in fit_joint(grid, common_sd_s=common_sd_s).flags
    assert "poor_fit" not in fit_joint(grid, slow).flags


def test_weights_do_not_hide_a_beam_that_slows() -> None:
    """A dozen times at the ends of the band could be called bad, and the rest would fit."""
    slow = JointModel(deceleration=True)
    z = standard(slow, 30.0, 400.0)
    z[4:] = np.log(2.0) / 0.5, 1.0
    wrong = fit_joint(simulated(z, slow, np.random.default_rng(3), scale=0.15), common_sd_s=0.0)
    assert "poor_fit" in wrong.flags
    assert wrong.account.down_weighted == ()


def test_offsets_that_are_there_are_no_poor_fit() -> None:
    shared = BURST.arrival_s + np.array([40.0, -30.0, 30.0])
    assert "poor_fit" not in fit_joint(dataclasses.replace(BURST, arrival_s=shared)).flags
