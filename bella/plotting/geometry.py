"""What the figures of a track are drawn from: polar numbers, region outlines, spiral, receivers."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from bella.flags import NOT_CONSTRAINED
from bella.heliosphere import spiral_longitude_deg
from bella.plotting.listing import listed, significant
from bella.units import FloatArray

SPIRAL_POINTS = 160


@dataclass(frozen=True)
class TrackView:
    """One localised burst with one definition of the edge, ready to be drawn.

    Attributes
    ----------
    label : str
        What the legend calls it.
    posterior : xarray.Dataset
        Posterior of one solution: means, covariances, regions per frequency.
    track_fit : mapping
        Fit of the spiral, as kept in the catalogue; may be empty.
    """

    label: str
    posterior: xr.Dataset
    track_fit: Mapping[str, Any]

    @property
    def edge(self) -> str:
        """Definition of the edge, such as ``half_maximum``."""
        return str(self.posterior.attrs.get("edge", self.label))


@dataclass(frozen=True)
class PolarTrack:
    """Polar form of a track in the ecliptic plane; all arrays of shape (F,)."""

    frequency_mhz: FloatArray
    x_rsun: FloatArray
    y_rsun: FloatArray
    range_rsun: FloatArray
    longitude_deg: FloatArray
    range_sd_rsun: FloatArray
    longitude_sd_deg: FloatArray


def polar_track(posterior: xr.Dataset) -> PolarTrack:
    """Distance and longitude of the posterior means, with the covariance projected on both directions.

    Parameters
    ----------
    posterior : xarray.Dataset
        Variables ``x_rsun, y_rsun, cov_xx_rsun2, cov_xy_rsun2, cov_yy_rsun2`` over ``frequency``.

    Returns
    -------
    PolarTrack
        Longitude is HEE, -180 to 180 deg; its sd is the transverse sd over the distance, at most 180 deg.
    """
    x, y, xx, xy, yy = (
        posterior[name].to_numpy().astype(np.float64)
        for name in ("x_rsun", "y_rsun", "cov_xx_rsun2", "cov_xy_rsun2", "cov_yy_rsun2")
    )
    distance = np.hypot(x, y)
    angle = np.arctan2(y, x)
    cos, sin = np.cos(angle), np.sin(angle)
    along = np.sqrt(np.maximum(cos**2 * xx + 2 * cos * sin * xy + sin**2 * yy, 0.0))
    across = np.sqrt(np.maximum(sin**2 * xx - 2 * cos * sin * xy + cos**2 * yy, 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        longitude_sd = np.minimum(np.degrees(across / distance), 180.0)
    frequency = posterior["frequency"].to_numpy().astype(np.float64)
    return PolarTrack(frequency, x, y, distance, np.degrees(angle), along, longitude_sd)


def spread_indices(track: PolarTrack, count: int) -> npt.NDArray[np.intp]:
    """Indices of at most `count` channels evenly spread in distance, nearest and farthest included.

    Even steps of frequency would pile up near the Sun, where their regions hide one another.

    Parameters
    ----------
    track : PolarTrack
    count : int

    Returns
    -------
    ndarray of int, shape (<= count,)
        Ascending.
    """
    wanted = np.linspace(np.nanmin(track.range_rsun), np.nanmax(track.range_rsun), count)
    return np.unique(np.nanargmin(np.abs(track.range_rsun[:, None] - wanted[None, :]), axis=0))


def nearest_index(frequency_mhz: FloatArray, wanted_mhz: float) -> int:
    """Index of the channel nearest in log frequency."""
    return int(np.abs(np.log(frequency_mhz) - np.log(wanted_mhz)).argmin())


def region_outline(posterior: xr.Dataset, index: int, percent: int) -> FloatArray:
    """Outline of a highest-density region without its padding.

    Parameters
    ----------
    posterior : xarray.Dataset
    index : int
        Of the frequency.
    percent : int
        68 or 95.

    Returns
    -------
    ndarray, shape (m, 2)
        HEE x, y in solar radii; closed polygons with a NaN row between them.
    """
    outline = posterior[f"region{percent}"].isel(frequency=index).to_numpy().astype(np.float64)
    given = np.flatnonzero(np.isfinite(outline).all(axis=1))
    return outline[: given[-1] + 1] if len(given) else outline[:0]


def receiver_positions(posterior: xr.Dataset) -> dict[str, FloatArray]:
    """Mean position of each receiver during the burst: name to HEE x, y, z in solar radii, shape (3,)."""
    positions = posterior["receiver_rsun"].mean("frequency", skipna=True)
    names = (str(name) for name in posterior["observatory"].to_numpy())
    return dict(zip(names, positions.to_numpy().astype(np.float64), strict=True))


def fitted_spiral(track_fit: Mapping[str, Any], range_rsun: FloatArray) -> FloatArray | None:
    """Parker spiral of the two-step fit as HEE x, y.

    Parameters
    ----------
    track_fit : mapping
        As kept in the catalogue.
    range_rsun : ndarray, shape (m,)

    Returns
    -------
    ndarray, shape (m, 2), or None
        None where the track has no finite fit.
    """
    fit = track_fit.get("two_step") or {}
    try:
        phi0 = float(fit["phi0_deg"]["mean"])
        speed = float(fit["v_sw_km_s"]["mean"])
        period = float(track_fit["rotation_period_d"])
    except (KeyError, TypeError):
        return None
    if not np.isfinite([phi0, speed, period]).all():
        return None
    longitude = np.radians(spiral_longitude_deg(range_rsun, phi0, speed, period))
    return np.column_stack([range_rsun * np.cos(longitude), range_rsun * np.sin(longitude)])


def speed_remark(contraction: float) -> str:
    """Sentence on whether the propagation speed was measured.

    Parameters
    ----------
    contraction : float
        Posterior sd over prior sd.
    """
    if not np.isfinite(contraction):
        return "speed: no statement"
    if contraction > NOT_CONSTRAINED:
        return f"speed not constrained (contraction {contraction:.2f})"
    return f"speed constrained (contraction {contraction:.2f})"


def selected_regions(posterior: Any, frequency_mhz: float) -> dict[str, Any]:
    """Numbers and outlines of the one channel nearest to a frequency.

    Parameters
    ----------
    posterior : xarray.Dataset
    frequency_mhz : float

    Returns
    -------
    dict
        ``frequency_mhz, x_rsun, y_rsun, range_rsun, range_sd_rsun, longitude_deg, longitude_sd_deg, area68_rsun2,
        area95_rsun2, contraction_v, speed, region68, region95``; a region is ``{"x": [...], "y": [...]}`` with None
        between its polygons.
    """
    track = polar_track(posterior)
    index = nearest_index(track.frequency_mhz, frequency_mhz)
    contraction = float(posterior["contraction_v"][index])
    numbers = {
        "frequency_mhz": significant([track.frequency_mhz[index]], 5)[0],
        "x_rsun": listed(track.x_rsun[index : index + 1])[0],
        "y_rsun": listed(track.y_rsun[index : index + 1])[0],
        "range_rsun": listed(track.range_rsun[index : index + 1])[0],
        "range_sd_rsun": listed(track.range_sd_rsun[index : index + 1])[0],
        "longitude_deg": listed(track.longitude_deg[index : index + 1])[0],
        "longitude_sd_deg": listed(track.longitude_sd_deg[index : index + 1])[0],
        "area68_rsun2": significant([float(posterior["area68_rsun2"][index])])[0],
        "area95_rsun2": significant([float(posterior["area95_rsun2"][index])])[0],
        "contraction_v": listed([contraction], 3)[0],
        "speed": speed_remark(contraction),
    }
    return numbers | {f"region{p}": _listed_outline(region_outline(posterior, index, p)) for p in (68, 95)}


def _listed_outline(points: FloatArray) -> dict[str, Any]:
    return {"x": listed(points[:, 0], 1), "y": listed(points[:, 1], 1)}
