"""The PyMC model is the joint model: their log densities differ by a constant, wherever they are compared."""

import numpy as np
import pytest

from bella.exceptions import InputError
from bella.tracks import JointModel, sample_joint_nuts
from bella.tracks.joint_likelihood import log_likelihood, timed_channels
from bella.tracks.joint_nuts import build_joint_model
from tests.tracks.bursts import simulated, standard

MODEL = JointModel()


def test_pymc_has_the_same_density() -> None:
    """At the best release time, without offsets; `level_s` is the release and the mean delay after it."""
    grid = simulated(standard(MODEL, 30.0, 400.0), MODEL, np.random.default_rng(1))
    channels, built = timed_channels(grid), build_joint_model(grid, MODEL, None)
    names = ("phi0_z", "slowness_z", "ln_a_z", "b_z", "ln_beam_z")
    transforms = [built.rvs_to_transforms[built[name]] for name in names]
    density = built.compile_fn(built.logp(jacobian=False), inputs=built.value_vars, mode="FAST_COMPILE")
    z = 0.3 * np.random.default_rng(2).standard_normal((5, 5))
    log_fit, release_s = log_likelihood(MODEL, channels, z)
    delay_s = MODEL.delay_s(z, channels.frequency_mhz, channels.receiver_rsun)
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


def test_variants_are_refused() -> None:
    with pytest.raises(InputError, match="without variants"):
        sample_joint_nuts(simulated(standard(MODEL, 30.0, 400.0), MODEL, None), JointModel(two_slope=True))
