"""What a solution says of each frequency in numbers: names, units, and where each comes from."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bella.arrivals import ArrivalGrid
from bella.multilateration.clocks import SHIFT_S, clock_shift_rsun
from bella.multilateration.draws import Draws
from bella.multilateration.likelihood import evaluate, problems_of
from bella.multilateration.moments import Moments
from bella.multilateration.predictive import predictive_check
from bella.multilateration.priors import Preset, Priors
from bella.multilateration.regions import LEVELS, Region
from bella.units import FloatArray

AXES = "xyz"


@dataclass(frozen=True)
class Posterior:
    """What any method hands over for the frequencies of a grid.

    Attributes
    ----------
    draws : Draws
    moments : Moments
    regions : sequence of Region
    remarks : sequence of str
        Flags that the method itself raises, one text per frequency, joined by semicolons; none if empty.
    """

    draws: Draws
    moments: Moments
    regions: Sequence[Region]
    remarks: Sequence[str] = ()


VARIABLES = {
    **{f"{axis}_rsun": ("Rsun", f"posterior mean of {axis}") for axis in "xy"},
    "z_rsun": ("Rsun", "posterior mean of z; 0 for a source held in the ecliptic plane"),
    **{f"cov_{a}{b}_rsun2": ("Rsun2", f"posterior covariance of {a} and {b}") for a, b in ("xy", "xz", "yz")},
    **{f"cov_{axis}{axis}_rsun2": ("Rsun2", f"posterior variance of {axis}") for axis in AXES},
    **{f"mode_{axis}_rsun": ("Rsun", f"{axis} of the highest posterior density") for axis in AXES},
    **{f"area{part}_rsun2": ("Rsun2", f"area of the {part} % highest-density region of (x, y)") for part in (68, 95)},
    **{f"volume{level}_rsun3": ("Rsun3", f"volume of the {level} % highest-density region") for level in (68, 95)},
    "modes": ("1", "number of separate maxima of the density"),
    "emission_s": ("s", "posterior mean of the emission time after reference_time"),
    "emission_sd_s": ("s", "posterior standard deviation of the emission time"),
    "v_over_c": ("1", "posterior mean of the propagation speed"),
    "v_over_c_sd": ("1", "posterior standard deviation of the propagation speed"),
    "above_c_probability": ("1", "posterior probability that the propagation speed is above that of light"),
    **{f"contraction_{axis}": ("1", f"posterior over prior standard deviation of {axis}") for axis in AXES},
    "contraction_v": ("1", "posterior over prior standard deviation of the propagation speed"),
    "contraction_emission": ("1", "posterior over prior standard deviation of the emission time"),
    **{f"prior_pull_{axis}_rsun": ("Rsun", f"move of the mean of {axis} by the prior, first order") for axis in AXES},
    "kappa": ("1", "posterior mean of the directional delay, in half widths of the rise"),
    "kappa_sd": ("1", "posterior standard deviation of the directional delay, in half widths of the rise"),
    "contraction_kappa": ("1", "posterior over prior standard deviation of the directional delay"),
    "misfit": ("1", "weighted sum of squared residuals at the highest posterior density"),
    "predictive_p": ("1", "posterior predictive p-value of the sum of squared residuals"),
    "log_evidence": ("1", "natural logarithm of the evidence"),
    "draw_ess": ("1", "effective number of draws"),
    "residual_s": ("s", "arrival time less posterior prediction"),
    "residual_p": ("1", "posterior predictive p-value of the residual"),
    "clock_offset_s": ("s", "how late the receiver is at all frequencies, if it alone is"),
    "clock_offset_sd_s": ("s", "standard deviation of that"),
    **{
        f"clock_shift_{axis}_rsun": ("Rsun", f"move of {axis} if the clock of the receiver were {SHIFT_S:g} s late")
        for axis in AXES
    },
    "bad_probability": ("1", "posterior probability that the arrival time is bad"),
    "mode_weight": ("1", "share of the probability in the basin of each mode, largest first"),
    "mode_mean_rsun": ("Rsun", "mean position in the basin of each mode"),
}
"""Units and meaning of every number of a solution."""


def summarise(grid: ArrivalGrid, posterior: Posterior, preset: Preset) -> dict[str, FloatArray]:
    """Numbers of each frequency, shape (F,).

    Parameters
    ----------
    grid : ArrivalGrid
    posterior : Posterior
    preset : Preset

    Returns
    -------
    dict of str to ndarray
        A subset of `VARIABLES`; those of z and the volumes only for a source in space.
    """
    moments, priors = posterior.moments, preset.priors
    return {
        **_of_position(posterior, priors),
        **_of_delay(moments, preset),
        "emission_s": moments.emission_s,
        "emission_sd_s": moments.emission_sd_s,
        "v_over_c": moments.v_over_c,
        "v_over_c_sd": moments.v_over_c_sd,
        "above_c_probability": moments.above_c,
        "contraction_v": np.where(moments.v_over_c_sd > 0, moments.v_over_c_sd / priors.speed_sd_c, 1.0),
        "contraction_emission": moments.emission_sd_s / (priors.emission_half_width_s / np.sqrt(3)),
        "misfit": _misfit(grid, posterior, preset),
        "log_evidence": moments.log_evidence,
        "draw_ess": posterior.draws.effective,
    }


def _of_position(posterior: Posterior, priors: Priors) -> dict[str, FloatArray]:
    moments, regions = posterior.moments, posterior.regions
    axes = AXES[: moments.mean.shape[1]]
    prior_sd_rsun = priors.position_sd_rsun(len(axes))
    highest = np.array([region.mode_rsun for region in regions])
    columns: dict[str, FloatArray] = {"z_rsun": np.zeros(len(regions))}
    for i, axis in enumerate(axes):
        columns[f"{axis}_rsun"] = moments.mean[:, i]
        columns[f"mode_{axis}_rsun"] = highest[:, i]
        columns[f"contraction_{axis}"] = np.sqrt(moments.covariance[:, i, i]) / prior_sd_rsun
        columns[f"prior_pull_{axis}_rsun"] = moments.prior_pull[:, i]
        columns |= {f"cov_{axis}{axes[j]}_rsun2": moments.covariance[:, i, j] for j in range(i, len(axes))}
    for i, level in enumerate(round(100 * level) for level in LEVELS):
        columns[f"area{level}_rsun2"] = np.array([region.area_rsun2[i] for region in regions])
        if len(axes) == len(AXES):
            columns[f"volume{level}_rsun3"] = np.array([region.volume_rsun3[i] for region in regions])
    columns["modes"] = np.array([region.modes.weight.size for region in regions], dtype=np.int16)
    return columns


def _of_delay(moments: Moments, preset: Preset) -> dict[str, FloatArray]:
    """Of a delay that is fixed, or that there is not, nothing is measured: its contraction is 1."""
    free = preset.delay.kappa_sd > 0
    return {
        "kappa": moments.kappa,
        "kappa_sd": moments.kappa_sd,
        "contraction_kappa": moments.kappa_sd / preset.delay.kappa_sd if free else np.ones_like(moments.kappa),
    }


def _misfit(grid: ArrivalGrid, posterior: Posterior, preset: Preset) -> FloatArray:
    """Of the likeliest component of the noise at the highest density, shape (F,)."""
    highest = np.array([region.mode_rsun for region in posterior.regions]).T
    problems = problems_of(grid, preset.priors, len(highest), preset.noise, preset.delay)
    local = evaluate(problems, highest)
    likeliest = local.log_density.argmax(axis=0)
    return np.asarray(np.take_along_axis(local.misfit, likeliest[None], axis=0)[0])


def of_receivers(grid: ArrivalGrid, posterior: Posterior, preset: Preset) -> tuple[dict[str, FloatArray], FloatArray]:
    """Residuals of each receiver, shape (F, n), and the predictive p-value of each frequency, shape (F,).

    Parameters
    ----------
    grid : ArrivalGrid
    posterior : Posterior
    preset : Preset

    Returns
    -------
    dict of str to ndarray, ndarray
    """
    check = predictive_check(grid, posterior.draws, posterior.moments.bad_probability)
    bad = np.where(np.isfinite(grid.arrival_s), posterior.moments.bad_probability, np.nan)
    columns = {"residual_s": check.residual_s, "residual_p": check.receiver_p, "bad_probability": bad}
    moments = posterior.moments
    shift = clock_shift_rsun(grid, moments.mean, moments.covariance, preset.priors, preset.delay)
    columns |= {f"clock_shift_{axis}_rsun": shift[..., i] for i, axis in enumerate(AXES[: shift.shape[-1]])}
    return columns, check.burst_p


def of_modes(regions: Sequence[Region]) -> Mapping[str, FloatArray]:
    """Weight (F, J) and mean position (F, J, 3) of the modes; weight 0 and position NaN where there are fewer than J.

    Parameters
    ----------
    regions : sequence of Region

    Returns
    -------
    mapping of str to ndarray
    """
    most = max(region.modes.weight.size for region in regions)
    weight = np.zeros((len(regions), most))
    mean = np.full((len(regions), most, 3), np.nan)
    for row, region in enumerate(regions):
        number, dimensions = region.modes.mean_rsun.shape
        weight[row, :number] = region.modes.weight
        mean[row, :number] = 0.0
        mean[row, :number, :dimensions] = region.modes.mean_rsun
    return {"mode_weight": weight, "mode_mean_rsun": mean}
