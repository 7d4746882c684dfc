"""Which quality flags a localisation raises; what they mean is in :mod:`bella.flags`."""

import numpy as np
import xarray as xr
from scipy import stats

from bella.flags import NOT_CONSTRAINED
from bella.units import FloatArray

ONCE_IN = 10_000
"""How often arrival times with errors as stated may be called inconsistent."""


def flags_of(posterior: xr.Dataset) -> list[str]:
    """Flags of each frequency of a posterior, joined by semicolons.

    Parameters
    ----------
    posterior : xarray.Dataset
        With the summary variables of a solution.

    Returns
    -------
    list of str
        One per frequency; empty where nothing is to be said.
    """
    raised = {
        "speed_not_constrained": posterior["contraction_v"] > NOT_CONSTRAINED,
        "position_not_constrained": _widest_sd(posterior) > NOT_CONSTRAINED * posterior.attrs["tau_rsun"],
        "multimodal": posterior["modes"] > 1,
        "arrivals_inconsistent": posterior["misfit"] > _largest_misfit(posterior),
        "few_effective_draws": posterior["draw_ess"] < 0.5 * posterior.sizes["draw"],
    }
    table = {name: where.to_numpy() for name, where in raised.items()}
    return [";".join(name for name in table if table[name][row]) for row in range(posterior.sizes["frequency"])]


def _largest_misfit(posterior: xr.Dataset) -> FloatArray:
    """Misfit that consistent arrival times exceed once in `ONCE_IN` times at most, shape (frequency,)."""
    receivers = np.isfinite(posterior["arrival_s"].to_numpy()).sum(axis=1)
    return np.asarray(stats.chi2.isf(1 / ONCE_IN, receivers - 1))


def _widest_sd(posterior: xr.Dataset) -> xr.DataArray:
    """Root of the larger eigenvalue of the covariance, shape (frequency,)."""
    xx, xy, yy = (posterior[f"cov_{pair}_rsun2"] for pair in ("xx", "xy", "yy"))
    variance: xr.DataArray = 0.5 * (xx + yy) + np.hypot(0.5 * (xx - yy), xy)
    return np.sqrt(variance)  # type: ignore[return-value]
