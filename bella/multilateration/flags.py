"""Which quality flags a localisation raises; what they mean is in :mod:`bella.flags`."""

from collections.abc import Sequence

import numpy as np
import xarray as xr
from scipy import stats

from bella.flags import NOT_CONSTRAINED
from bella.units import FloatArray

ONCE_IN = 10_000
"""How often arrival times with errors as stated may be called inconsistent."""


DOMINATED_SD = 0.5
"""Move of the mean by the prior of the position, in standard deviations, from which the prior is said to decide."""
LIKELY_ABOVE_C = 0.95
"""Probability of v > c, one half in the prior, from which the arrival times are said to prefer it."""
LIKELY_BAD = 0.5


def flags_of(posterior: xr.Dataset, remarks: Sequence[str] = ()) -> list[str]:
    """Flags of each frequency of a posterior, joined by semicolons.

    Parameters
    ----------
    posterior : xarray.Dataset
        With the summary variables of a solution.
    remarks : sequence of str
        Flags that the method raised itself, one text per frequency; none if empty.

    Returns
    -------
    list of str
        One per frequency; empty where nothing is to be said.
    """
    axes = [axis for axis in "xyz" if f"contraction_{axis}" in posterior]
    raised = {
        "speed_not_constrained": posterior["contraction_v"] > NOT_CONSTRAINED,
        "speed_above_c": posterior["above_c_probability"] > LIKELY_ABOVE_C,
        **{f"{axis}_not_constrained": posterior[f"contraction_{axis}"] > NOT_CONSTRAINED for axis in axes},
        "position_not_constrained": _widest_sd(posterior, axes)
        > NOT_CONSTRAINED * posterior.attrs["position_prior_sd_rsun"],
        "prior_dominated": _pull_in_sd(posterior, axes) > DOMINATED_SD,
        "multimodal": posterior["modes"] > 1,
        "arrivals_inconsistent": posterior["misfit"] > _largest_misfit(posterior),
        "bad_arrival": posterior["bad_probability"].max("observatory") > LIKELY_BAD,
        "clock_offset": np.full(posterior.sizes["frequency"], bool(posterior.attrs["clock_offset"])),
        "few_effective_draws": posterior["draw_ess"] < 0.5 * posterior.sizes["draw"],
    }
    table = {name: np.asarray(where) for name, where in raised.items()}
    own = list(remarks) or [""] * posterior.sizes["frequency"]
    return [
        ";".join(filter(None, [*(name for name in table if table[name][row]), own[row]]))
        for row in range(posterior.sizes["frequency"])
    ]


def _largest_misfit(posterior: xr.Dataset) -> FloatArray:
    """Misfit that consistent arrival times exceed once in `ONCE_IN` times at most, shape (frequency,)."""
    receivers = np.isfinite(posterior["arrival_s"].to_numpy()).sum(axis=1)
    return np.asarray(stats.chi2.isf(1 / ONCE_IN, receivers - 1))


def _widest_sd(posterior: xr.Dataset, axes: Sequence[str]) -> FloatArray:
    """Root of the largest eigenvalue of the covariance, shape (frequency,)."""
    return np.asarray(np.sqrt(np.linalg.eigvalsh(_covariance(posterior, axes))[:, -1]))


def _pull_in_sd(posterior: xr.Dataset, axes: Sequence[str]) -> FloatArray:
    """Length of the pull of the prior in standard deviations of the position along it, shape (frequency,)."""
    pull = np.stack([posterior[f"prior_pull_{axis}_rsun"].to_numpy() for axis in axes], axis=-1)
    return np.asarray(np.sqrt(np.einsum("fi,fij,fj->f", pull, np.linalg.pinv(_covariance(posterior, axes)), pull)))


def _covariance(posterior: xr.Dataset, axes: Sequence[str]) -> FloatArray:
    """Covariance of the position, shape (frequency, D, D)."""
    names = [[f"cov_{min(one, other)}{max(one, other)}_rsun2" for other in axes] for one in axes]
    return np.stack([np.stack([posterior[name].to_numpy() for name in row], axis=-1) for row in names], axis=-1)
