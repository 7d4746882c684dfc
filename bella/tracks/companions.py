"""What other methods say of the track of a burst, beside its joint fit: SEMP, a broken spiral, the density it implies.

None of them decides anything: each rests on an assumption that the joint fit does without, which stands in ``model``.
"""

import math
from typing import Any

import numpy as np
import xarray as xr
from scipy.optimize import brentq

from bella.arrivals import ArrivalGrid
from bella.flags import OPEN_PROFILE
from bella.heliosphere import DENSITY_MODELS, emission_range_rsun, spiral_path_rsun
from bella.heliosphere.polar import polar_covariance
from bella.records import Parameter
from bella.tracks.density_excess import HARMONICS, density_excess
from bella.tracks.semp import SEMP_ROTATION_D, SempFit, SempTimes, fit_semp, semp_residual_s
from bella.units import C_KM_S, R_SUN_KM, FloatArray

MODEL = DENSITY_MODELS["leblanc"]
SEMP_DENSER = 2.0
"""By how much the wind is denser than the model in the published fits (Zhang et al. 2019)."""

ASSUMED_WIND_KM_S = 400.0
CHI2_OF_ONE = {"68": 1.0, "95": 3.841}
"""Growth of chi-squared that holds one parameter with this probability, in per cent."""

UNKNOWNS = 3
SHOWN_FREQUENCIES = 5
PHI0_STEP_DEG = 0.05


def semp_companion(grid: ArrivalGrid, v_sw_km_s: float = ASSUMED_WIND_KM_S) -> dict[str, Any]:
    """SEMP fit to the arrival times of a burst (Zhang et al. 2019, doi:10.1007/s11207-019-1448-0).

    Parameters
    ----------
    grid : ArrivalGrid
    v_sw_km_s : float
        Speed of the wind, which the fit assumes, km/s.

    Returns
    -------
    dict
        Ready for JSON: longitude with the intervals of its profile (its sd is half of the 68 per cent one), release
        time and beam speed with errors to first order, residual, model and flags. All errors grow with the misfit,
        where that is larger than they explain.

    Raises
    ------
    InputError
        If there are fewer than four arrival times, or one frequency only.
    """
    times = semp_times(grid)
    fit = fit_semp(times, v_sw_km_s)
    scale = max(1.0, float(times.weight.sum()) * fit.rms_s**2 / max(len(times.weight) - UNKNOWNS, 1))
    intervals = {p: profile_interval_deg(times, fit, v_sw_km_s, scale * growth) for p, growth in CHI2_OF_ONE.items()}
    within = intervals["68"]
    phi0_sd = None if within is None else 0.5 * (within[1] - within[0])
    release_sd, beam_sd = _standard_errors(times, fit, v_sw_km_s, scale, phi0_sd or 0.0)
    return {
        "model": f"one beam, distances by {MODEL.name} x {SEMP_DENSER:g}, fundamental, wind {v_sw_km_s:g} km/s assumed",
        "phi0_deg": {"mean": fit.phi0_deg, "sd": phi0_sd, **_ends(intervals)},
        "beam_speed_c": Parameter.gaussian(fit.beam_speed_c, beam_sd).model_dump(),
        "release_utc": _moment(grid, fit.release_s, release_sd),
        "v_sw_km_s": v_sw_km_s,
        "rms_s": fit.rms_s,
        "error_scale": math.sqrt(scale),
        "points": len(times.arrival_s),
        "rotation_period_d": SEMP_ROTATION_D,
        "flags": [*fit.flags, *([OPEN_PROFILE] if None in intervals.values() else [])],
    }


def semp_times(grid: ArrivalGrid) -> SempTimes:
    """Arrival times of a burst in the form that SEMP takes, weighted by their errors.

    Parameters
    ----------
    grid : ArrivalGrid

    Returns
    -------
    SempTimes

    Raises
    ------
    InputError
        If there are fewer than four arrival times, or one frequency only.
    """
    row, column = np.nonzero(np.isfinite(grid.arrival_s))
    denser = grid.frequency_mhz / math.sqrt(SEMP_DENSER)
    variance = (grid.sigma_s**2 + grid.delay_sd_s**2)[row, column]
    return SempTimes(
        (grid.arrival_s - grid.delay_s)[row, column],
        emission_range_rsun(denser, MODEL)[row],
        grid.receiver_rsun[row, column],
        1.0 / variance,
    )


def profile_interval_deg(times: SempTimes, fit: SempFit, v_sw_km_s: float, growth: float) -> tuple[float, float] | None:
    """Longitudes between which the least chi-squared of any release and speed stays within `growth` of its minimum.

    Parameters
    ----------
    times : SempTimes
        Weighted by the inverse squares of their errors.
    fit : SempFit
    v_sw_km_s : float
    growth : float

    Returns
    -------
    tuple of float or None
        Degrees, about the best longitude; None where half a turn to a side does not reach that growth.
    """
    total = float(times.weight.sum())

    def _above(apart_deg: float) -> float:
        residual = semp_residual_s(times, fit.phi0_deg + apart_deg, v_sw_km_s)[0]
        return float(times.weight @ residual**2) - total * fit.rms_s**2 - growth

    steps = np.arange(0.0, 180.0, 1.0)
    ends = []
    for side in (-1.0, 1.0):
        beyond = next((step for step in steps if _above(side * step) > 0), None)
        if beyond is None:
            return None
        ends.append(fit.phi0_deg + side * brentq(lambda apart, side=side: _above(side * apart), beyond - 1.0, beyond))
    return ends[0], ends[1]


def _standard_errors(
    times: SempTimes, fit: SempFit, v_sw_km_s: float, scale: float, phi0_sd_deg: float
) -> tuple[float, float]:
    """Errors of release time (s) and beam speed (c), to first order, that of the longitude included."""
    ahead, behind = (semp_residual_s(times, fit.phi0_deg + d, v_sw_km_s)[1] for d in (PHI0_STEP_DEG, -PHI0_STEP_DEG))
    drift = (ahead - behind) / (2 * PHI0_STEP_DEG)
    path = spiral_path_rsun(times.range_rsun, v_sw_km_s, SEMP_ROTATION_D)
    design = np.column_stack([np.ones_like(path), path])
    conditional = scale * np.linalg.inv(design.T @ (design * times.weight[:, None]))
    release_sd, slowness_sd = np.sqrt(np.diag(conditional) + (drift * phi0_sd_deg) ** 2)
    return float(release_sd), fit.beam_speed_c**2 * C_KM_S / R_SUN_KM * float(slowness_sd)


def _ends(intervals: dict[str, tuple[float, float] | None]) -> dict[str, float | None]:
    (low68, high68), (low95, high95) = (intervals[p] or (None, None) for p in ("68", "95"))
    return {"q2_5": low95, "q16": low68, "q84": high68, "q97_5": high95}


def _moment(grid: ArrivalGrid, release_s: float, sd_s: float) -> dict[str, Any]:
    moment = grid.reference_utc.astype("datetime64[ms]") + np.timedelta64(round(release_s * 1e3), "ms")
    return {"mean": f"{moment}Z", "sd": sd_s}


def density_companion(posterior: xr.Dataset) -> dict[str, Any]:
    """How much denser than a model the wind would be, if the sources were where they appear, at a few frequencies.

    Parameters
    ----------
    posterior : xarray.Dataset
        A solution of :func:`bella.multilateration.localise`.

    Returns
    -------
    dict
        Ready for JSON: model and rows with frequency, distance and its error, and the ratio of densities with its value
        one error inward and outward, for fundamental and harmonic; None where the model gives no density.
    """
    chosen = _spread(posterior["frequency"].to_numpy().astype(np.float64))
    few = posterior.isel(frequency=chosen)
    distance, distance_sd = _distances(few)
    table = density_excess(few["frequency"].to_numpy(), distance, distance_sd, {MODEL.name: MODEL})
    columns = ("excess", "excess_low", "excess_high")
    rows: list[dict[str, Any]] = [
        {"frequency_mhz": float(f), "range_rsun": _number(r), "range_sd_rsun": _number(sd)}
        for f, r, sd in zip(few["frequency"].to_numpy(), distance, distance_sd, strict=True)
    ]
    for harmonic, word in zip(HARMONICS, ("fundamental", "harmonic"), strict=True):
        values = table[table["harmonic"] == harmonic][list(columns)].to_numpy()
        for row, three in zip(rows, values, strict=True):
            row[word] = dict(zip(("mean", "q16", "q84"), (_number(value) for value in three), strict=True))
    return {"model": f"density of frequency over that of {MODEL.name} at the source", "rows": rows, "flags": []}


def _spread(frequency_mhz: FloatArray) -> np.ndarray:
    """Places of a few frequencies, evenly spread in logarithm."""
    wanted = np.geomspace(frequency_mhz.min(), frequency_mhz.max(), SHOWN_FREQUENCIES)
    return np.unique(np.abs(np.log(frequency_mhz[:, None] / wanted)).argmin(axis=0))


def _distances(posterior: xr.Dataset) -> tuple[FloatArray, FloatArray]:
    position = np.stack([posterior["x_rsun"].to_numpy(), posterior["y_rsun"].to_numpy()], axis=-1)
    xx, xy, yy = (posterior[f"cov_{pair}_rsun2"].to_numpy() for pair in ("xx", "xy", "yy"))
    covariance = np.stack([np.stack([xx, xy], -1), np.stack([xy, yy], -1)], -2)
    place, polar = polar_covariance(position, covariance)
    return place[:, 0], np.sqrt(polar[:, 0, 0])


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
