"""The joint fit against sampling of the identical posterior, so long that its own error is below what is asked."""

import numpy as np
import pytest

from bella.tracks import JointModel, fit_joint, sample_joint_nuts
from tests.tracks.bursts import simulated, standard

pytestmark = pytest.mark.acceptance
MODEL = JointModel()


@pytest.mark.parametrize("offset_s", [0.0, 20.0])
def test_mean_within_a_twentieth_and_width_within_a_sixteenth(offset_s: float) -> None:
    grid = simulated(standard(MODEL, 30.0, 400.0), MODEL, np.random.default_rng(3))
    fit = fit_joint(grid, common_sd_s=offset_s, draws=40_000)
    sampled = sample_joint_nuts(grid, common_sd_s=offset_s, draws=40_000)

    assert sampled["effective"] > 5_000
    for name, found in fit.summary.items():
        sd = sampled[name].std()
        assert abs(found.mean - sampled[name].mean()) <= 0.05 * sd, name
        assert abs(found.sd / sd - 1) <= 1 / 16, name
