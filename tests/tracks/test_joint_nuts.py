"""The PyMC model is the joint model: their log densities differ by a constant, wherever they are compared."""

from dataclasses import replace

import numpy as np
import pytest

from bella.tracks import DirectionTerms, JointModel, WindPrior
from bella.tracks.joint_likelihood import log_likelihood, timed_channels
from bella.tracks.joint_nuts import build_joint_model
from bella.tracks.joint_observed import Observed
from tests.tracks.bursts import simulated, standard, towards_source

MODEL = JointModel()
RICH = JointModel(deceleration=True, two_slope=True, knots_rsun=(30.0, 60.0))


@pytest.mark.parametrize("model", [MODEL, RICH], ids=["plain", "all variants and ingredients"])
def test_pymc_has_the_same_density(model: JointModel) -> None:
    """At the best release time, without offsets; `level_s` is the release and the mean delay after it."""
    grid = simulated(standard(MODEL, 30.0, 400.0), MODEL, np.random.default_rng(1))
    channels = timed_channels(grid, 0.0)
    observed = Observed(channels) if model is MODEL else Observed(channels, _directions(), WindPrior(390.0, 25.0))
    built = build_joint_model(observed, model)
    names = [f"{name}_z" for name in ("phi0", "slowness", "ln_a", "b", "ln_beam")]
    names += [] if model is MODEL else ["deceleration_z", "b2_z", "slowness_2_z", "slowness_3_z"]
    transforms = [built.rvs_to_transforms[built[name]] for name in names]
    density = built.compile_fn(built.logp(jacobian=False), inputs=built.value_vars, mode="FAST_COMPILE")
    z = 0.3 * np.random.default_rng(2).standard_normal((5, len(names)))
    log_fit, release_s = log_likelihood(model, observed, z)
    delay_s = model.delay_s(z, channels.frequency_mhz, channels.receiver_rsun)
    share = channels.precision / channels.precision.sum()
    level_s = release_s + ((delay_s - channels.arrival_s) * share).sum(axis=(1, 2))
    found = []
    for row, level in zip(z, level_s, strict=True):
        point = {"level_s": np.array(level)}
        for name, value, transform in zip(names, row, transforms, strict=True):
            inputs = built[name].owner.inputs
            key = name if transform is None else f"{name}_{transform.name}__"
            point[key] = np.array(value) if transform is None else transform.forward(value, *inputs).eval()
        found.append(float(density(point)))
    expected = log_fit - 0.5 * (z**2).sum(axis=1)
    np.testing.assert_allclose(np.diff(found), np.diff(expected), rtol=1e-6, atol=1e-6)


def _directions() -> DirectionTerms:
    alone = towards_source(standard(MODEL, 30.0, 400.0), MODEL, np.random.default_rng(4))
    return replace(alone, shared_deg=2.0, observatories=("B", "C") * (alone.frequency_mhz.size // 2))
