"""What scattering makes of a track: apparent and corrected distances, the delay, and the wind of the corrected spiral.

The positions and the fits of a solution are those of the apparent source. Which harmonic was heard is not known, so
both are given; turbulence is taken as nominal, and what it does to the correction is not in its errors.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from bella.exceptions import NoDataError
from bella.flags import APPARENT_SOURCE
from bella.heliosphere import DENSITY_MODELS, spiral_longitude_deg
from bella.heliosphere.parker import SPIRAL_ORIGIN_RSUN, angular_speed_rad_s
from bella.tracks.density_excess import HARMONICS, density_excess
from bella.tracks.joint_fit import JointFit, summarise
from bella.tracks.scattering import SOURCE, ScatteringModel, corrected_source, scattering_model
from bella.units import R_SUN_KM, FloatArray

REFERENCE = DENSITY_MODELS["leblanc"]
MODELS = {"fundamental": "kontar-2023-fundamental", "harmonic": "kontar-2023-harmonic"}
NOT_IN_ERRORS = (
    "half or twice the nominal turbulence: apparent distances differ by 10 to 25 per cent, delays by a factor of 2 to 3"
)
DIRECTION_KEPT = "the source is moved outward only, its longitude stays"
FEWEST_FREQUENCIES = 3
EXCESS_COLUMNS = {"excess": "mean", "excess_low": "q16", "excess_high": "q84"}
"""Columns of :func:`bella.tracks.density_excess` and what they are called here."""


def scattering_companion(density: Mapping[str, Any], fit: JointFit) -> dict[str, Any]:
    """Sources behind the apparent ones at the frequencies of the density excess, and the spiral through them.

    Parameters
    ----------
    density : mapping
        As :func:`bella.tracks.companions.density_companion` returns it: its frequencies and apparent distances.
    fit : JointFit
        Of the same burst; may be without draws.

    Returns
    -------
    dict
        Ready for JSON: ``model``, ``source``, ``not_in_errors``, and ``rows`` with frequency, apparent distance and for
        fundamental and harmonic the corrected distance with its error, the delay of the peak and the density excess
        that is left; None where nothing was simulated. ``joint`` holds longitude and wind of the corrected spiral by
        harmonic, empty without a joint fit.

    Raises
    ------
    NoDataError
        If the density excess could not be computed.
    """
    if "rows" not in density:
        raise NoDataError(str(density["reason"]))
    seen = [row for row in density["rows"] if row["range_rsun"] is not None]
    return {
        "model": ", ".join(MODELS.values()),
        "source": SOURCE,
        "apparent": APPARENT_SOURCE,
        "assumed": DIRECTION_KEPT,
        "not_in_errors": NOT_IN_ERRORS,
        "rows": _rows(seen),
        "joint": _corrected_spirals(fit, np.array([row["frequency_mhz"] for row in seen])),
        "flags": [],
    }


def _rows(seen: list[Mapping[str, Any]]) -> list[dict[str, Any]]:
    frequency, apparent, sd = (
        np.array([math.nan if row[name] is None else row[name] for row in seen], dtype=np.float64)
        for name in ("frequency_mhz", "range_rsun", "range_sd_rsun")
    )
    rows: list[dict[str, Any]] = [
        {"frequency_mhz": float(f), "apparent_rsun": float(r), "apparent_sd_rsun": _number(s)}
        for f, r, s in zip(frequency, apparent, sd, strict=True)
    ]
    for word, harmonic in zip(MODELS, HARMONICS, strict=True):
        model = scattering_model(MODELS[word])
        distance = corrected_source(apparent, np.zeros(apparent.size), frequency, model).range_rsun
        distance_sd = sd / model.radius_factor(frequency)
        table = density_excess(frequency, distance, distance_sd, {REFERENCE.name: REFERENCE})
        left = table[table["harmonic"] == harmonic][list(EXCESS_COLUMNS)].to_numpy(dtype=np.float64).tolist()
        late_s = model.delay_s(frequency)
        for row, r, s, late, excess in zip(rows, distance, distance_sd, late_s, left, strict=True):
            row[word] = {"range_rsun": _number(r), "range_sd_rsun": _number(s), "delay_s": _number(late)}
            row[word]["excess"] = dict(zip(EXCESS_COLUMNS.values(), [_number(one) for one in excess], strict=True))
    return rows


def _corrected_spirals(fit: JointFit, frequency_mhz: FloatArray) -> dict[str, Any]:
    found = {word: corrected_spiral(fit, scattering_model(name), frequency_mhz) for word, name in MODELS.items()}
    return {word: spiral for word, spiral in found.items() if spiral}


def corrected_spiral(fit: JointFit, model: ScatteringModel, frequency_mhz: FloatArray) -> dict[str, Any]:
    """Longitude and wind of the spirals of a joint fit when every source is moved inward to where it was emitted.

    Parameters
    ----------
    fit : JointFit
    model : ScatteringModel
    frequency_mhz : numpy.ndarray, shape (F,)
        Where the spirals are corrected; frequencies that were not simulated are left out.

    Returns
    -------
    dict
        ``phi0_deg`` and ``v_sw_km_s`` with mean, sd and quantiles; empty without draws, or with fewer than three
        frequencies.

    Notes
    -----
    The angle that the spiral has turned by at the apparent distance r it has turned by at the corrected one, r / k, so
    the wind is slower by about k. Were sources moved along the field (Clarkson et al. 2025,
    doi:10.1038/s41598-025-95270-w), apparent and corrected ones would lie on one spiral, and both numbers would stay.
    """
    known = frequency_mhz[np.isfinite(model.radius_factor(frequency_mhz))]
    if not fit.draws or known.size < FEWEST_FREQUENCIES:
        return {}
    period_d = fit.model.rotation_period_d
    apparent = fit.model.range_rsun(fit.parameters, known)
    drawn = fit.parameters
    longitude = spiral_longitude_deg(apparent, drawn.phi0_deg[:, None], drawn.v_sw_km_s[:, None], period_d)
    height = apparent / model.radius_factor(known) - SPIRAL_ORIGIN_RSUN
    away = height - height.mean(axis=1, keepdims=True)
    slope = (away * longitude).sum(axis=1) / (away**2).sum(axis=1)
    phi0_deg = longitude.mean(axis=1) - slope * height.mean(axis=1)
    v_sw_km_s = -np.degrees(angular_speed_rad_s(period_d)) * R_SUN_KM / slope
    return {"phi0_deg": _summary(phi0_deg), "v_sw_km_s": _summary(v_sw_km_s), "rotation_period_d": period_d}


def _summary(values: FloatArray) -> dict[str, float]:
    summary = vars(summarise(values, np.full(values.size, 1 / values.size), math.nan)).copy()
    del summary["contraction"]
    return summary


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
