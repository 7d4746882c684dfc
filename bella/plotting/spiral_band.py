"""Where the spiral of a joint fit lies: bands of longitude by distance, from its posterior draws."""

from dataclasses import dataclass

import numpy as np
import xarray as xr

from bella.heliosphere import spiral_longitude_deg
from bella.units import FloatArray

PERCENTS = (95, 68)
"""The wider band first, as it is drawn."""

ARC_POINTS = 24


@dataclass(frozen=True)
class SpiralBand:
    """Longitudes that the spirals of a posterior have at each distance.

    Attributes
    ----------
    range_rsun : ndarray, shape (R,)
    median_deg : ndarray, shape (R,)
        HEE, without jumps of a turn.
    low_deg, high_deg : dict of int to ndarray, shape (R,)
        Ends of the interval that holds so many per cent of the draws at each distance, equal shares beyond either end.
    """

    range_rsun: FloatArray
    median_deg: FloatArray
    low_deg: dict[int, FloatArray]
    high_deg: dict[int, FloatArray]


def spiral_band(posterior: xr.Dataset, range_rsun: FloatArray) -> SpiralBand | None:
    """Bands of the spiral of a joint fit.

    Parameters
    ----------
    posterior : xarray.Dataset
        A solution with the draws of its joint fit, as :func:`bella.tracks.with_joint_draws` returns it.
    range_rsun : ndarray, shape (R,)
        Solar radii, ascending.

    Returns
    -------
    SpiralBand or None
        None where a solution has no joint fit.

    Notes
    -----
    Longitudes at 1 solar radius are taken within half a turn of their mean direction (Mardia & Jupp 2000, Directional
    Statistics, chapter 2, doi:10.1002/9780470316979) and followed outward from there, so that a band across +-180
    degrees is no wider than elsewhere.
    """
    if "joint_draws" not in posterior:
        return None
    drawn = posterior["joint_draws"]
    phi0_deg, v_sw_km_s = (
        drawn.sel(joint_parameter=name).to_numpy().astype(np.float64)[:, None] for name in ("phi0_deg", "v_sw_km_s")
    )
    period_d = float(drawn.attrs["rotation_period_d"])
    longitude = spiral_longitude_deg(range_rsun, _beside_mean(phi0_deg), v_sw_km_s, period_d)
    ends = {p: np.quantile(longitude, [0.5 - p / 200, 0.5 + p / 200], axis=0) for p in PERCENTS}
    low, high = ({p: both[side] for p, both in ends.items()} for side in (0, 1))
    return SpiralBand(range_rsun, np.median(longitude, axis=0), low, high)


def _beside_mean(longitude_deg: FloatArray) -> FloatArray:
    """Longitudes within half a turn of their mean direction, degrees."""
    turned = np.exp(1j * np.radians(longitude_deg))
    mean = turned.mean()
    return np.asarray(np.degrees(np.angle(mean) + np.angle(turned * np.conj(mean))))


def band_outline(band: SpiralBand, percent: int) -> FloatArray:
    """Outline of a band in the plane.

    Parameters
    ----------
    band : SpiralBand
    percent : int
        One of `PERCENTS`.

    Returns
    -------
    ndarray, shape (2 R + A + 1, 2)
        HEE x, y in solar radii; outward along one end, on an arc to the other and back along it, and closed.
    """
    low, high = band.low_deg[percent], band.high_deg[percent]
    arc = np.linspace(low[-1], high[-1], ARC_POINTS)
    longitude = np.radians(np.concatenate([low, arc, high[::-1]]))
    distance = np.concatenate([band.range_rsun, np.full(ARC_POINTS, band.range_rsun[-1]), band.range_rsun[::-1]])
    outline = np.column_stack([distance * np.cos(longitude), distance * np.sin(longitude)])
    return np.concatenate([outline, outline[:1]])
