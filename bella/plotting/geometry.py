"""What figures are drawn from: polar numbers, region outlines, spiral and its bands, receivers, columns of tables."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr

from bella.exceptions import InputError
from bella.flags import NOT_CONSTRAINED
from bella.heliosphere import spiral_longitude_deg
from bella.units import FloatArray

PERCENTS = (95, 68)
"""The wider band first, as it is drawn."""

ARC_POINTS = 24


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


@dataclass(frozen=True)
class SpiralBand:
    """Longitudes that the spirals of a posterior have at each distance.

    Attributes
    ----------
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


def listed(values: npt.ArrayLike, digits: int = 2) -> list[Any]:
    """Numbers rounded to a number of decimals, None for what is not finite.

    Parameters
    ----------
    values : array_like, any shape
    digits : int
        Decimals kept.

    Returns
    -------
    list
        Nested as the array is.
    """
    array = np.round(np.asarray(values, dtype=np.float64), digits)
    return _without_nan(array.tolist())


def significant(values: npt.ArrayLike, digits: int = 4) -> list[Any]:
    """Numbers rounded to a number of significant digits, None for what is not finite."""
    return [float(f"{value:.{digits}g}") if math.isfinite(value) else None for value in np.asarray(values, dtype=float)]


def _without_nan(values: list[Any]) -> list[Any]:
    if values and isinstance(values[0], list):
        return [_without_nan(row) for row in values]
    return [value if math.isfinite(value) else None for value in values]


def require_columns(table: pd.DataFrame, columns: Iterable[str], name: str) -> pd.DataFrame:
    """Refuse a table that lacks a column.

    Parameters
    ----------
    name : str
        What the table is called in the error.

    Returns
    -------
    pandas.DataFrame
        The same table.

    Raises
    ------
    InputError
        If a column is missing.
    """
    missing = [column for column in columns if column not in table.columns]
    if missing:
        raise InputError(f"the {name} has no column {missing[0]!r}: add it, or make the table with bella anew")
    return table
