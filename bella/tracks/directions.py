"""Wave directions as a part of the likelihood: the angle between them and the lines of sight to the source.

The angle is taken in the plane that touches the sphere at the measured direction, as a length and two components, each
of them Gaussian (for small errors the distribution of Fisher 1953, Proc. R. Soc. A 217, 295,
doi:10.1098/rspa.1953.0064). Refraction, scattering and calibration turn all directions of a spacecraft alike; with that
turn integrated out, the covariance of each component is diagonal plus a constant, and residuals are made independent by
the inverse root of it.

Directions come from a table, or from spectra that carry them: one per channel, at the peak of its flux, where the burst
outshines the background and scattering has turned the waves least (Krupar et al. 2012, J. Geophys. Res. 117, A06101,
doi:10.1029/2011JA017333). STEREO gives its angles in HEE, Wind in a frame with X to the Sun and Z to solar north.
Angles towards the source and along the wave vector are half a turn apart; the Sun tells which is meant, since no burst
that leaves it is behind a spacecraft in most of its channels.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr

from bella.arrivals import POSITION
from bella.csv_tables import parse_table, read_table_text
from bella.exceptions import InputError
from bella.spacecraft import cartesian, hee_from, position_hee
from bella.units import FloatArray

REQUIRED = ("observatory", "frequency_mhz", "sigma_deg")
ANGLES = (("longitude_deg", "latitude_deg"), ("azimuth_deg", "colatitude_deg"))
"""Pairs of columns, either of which says where a direction points to, HEE."""
LIMITS = {
    "frequency_mhz": (0.001, 1000.0),
    "sigma_deg": (0.01, 180.0),
    "longitude_deg": (-360.0, 360.0),
    "azimuth_deg": (-360.0, 360.0),
    "latitude_deg": (-90.0, 90.0),
    "colatitude_deg": (0.0, 180.0),
}
LARGEST_TABLE = 100_000
SMALL_ANGLE = 1e-9


WAVE_ANGLES = ("wave_colatitude_{}_deg", "wave_azimuth_{}_deg")
FRAMES = ("hee", "rtn")
"""In order of preference."""
NEAR_PEAK = 0.5
"""Samples in one piece with the peak, and of more than this share of its flux, count."""
MIN_SAMPLES = 3
QUIET, NOISE = 0.25, 0.05
LEAST_RISE = 8.0
"""How far a peak rises over the lowest quarter of the samples, in units of what lies between that and the lowest
twentieth (a standard deviation of Gaussian noise): else the channel has no burst to tell the direction of."""
LARGEST_SCATTER_DEG = 20.0
"""Directions that scatter by more are those of no burst: from everywhere, they would by some 50 degrees."""
LEAST_SIGMA_DEG = 0.1


@dataclass(frozen=True)
class DirectionTerms:
    """Directions towards the source, as the likelihood needs them.

    Attributes
    ----------
    receiver_rsun : ndarray, shape (K, 3)
        HEE, solar radii.
    towards : ndarray, shape (K, 3)
        Unit vectors, HEE.
    sigma_deg : ndarray, shape (K,)
        Standard deviation in each of two perpendicular directions on the sky, without what is shared, degrees.
    shared_deg : float
        Standard deviation of the turn that all directions of a spacecraft share, in the same two, degrees.
    observatories : tuple of str
        Spacecraft of each, in any number of directions; empty for one.
    """

    frequency_mhz: FloatArray
    receiver_rsun: FloatArray
    towards: FloatArray
    sigma_deg: FloatArray
    shared_deg: float = 0.0
    observatories: tuple[str, ...] = ()

    def within(self, low_mhz: float, high_mhz: float) -> "DirectionTerms | None":
        """Those of a band of frequencies; None where there are none."""
        some = np.flatnonzero((self.frequency_mhz >= low_mhz) & (self.frequency_mhz <= high_mhz))
        if not some.size:
            return None
        names = tuple(self.observatories[place] for place in some) if self.observatories else ()
        parts = {name: getattr(self, name)[some] for name in ("frequency_mhz", "receiver_rsun", "towards", "sigma_deg")}
        return replace(self, **parts, observatories=names)

    @property
    def total_deg(self) -> FloatArray:
        """Error of each alone, with what is shared, degrees, shape (K,)."""
        return np.hypot(self.sigma_deg, self.shared_deg)

    @property
    def sides(self) -> tuple[FloatArray, FloatArray]:
        """Two unit vectors across each direction: along the ecliptic, and north of it, shape (K, 3) each."""
        tangents = _tangents(self.towards)
        return tangents[:, 0], tangents[:, 1]

    @property
    def size(self) -> int:
        """Number of residuals, two for each direction."""
        return 2 * self.frequency_mhz.size

    @property
    def log_norm(self) -> float:
        """Logarithm of the factor before the exponential of the likelihood."""
        alone = float(np.log(2 * math.pi * np.radians(self.sigma_deg) ** 2).sum())
        return -alone - float(np.log1p(self._shared[1]).sum())

    @cached_property
    def _shared(self) -> tuple[FloatArray, FloatArray]:
        """Of each spacecraft the unit vector of 1 / sigma, (S, K), and the variance shared along it in those, (S,)."""
        names = np.array(self.observatories or ("",) * self.frequency_mhz.size)
        weight = (np.unique(names)[:, None] == names) / self.sigma_deg
        length = np.linalg.norm(weight, axis=1, keepdims=True)
        return weight / length, (self.shared_deg * length[:, 0]) ** 2

    def independent(self, residual: Any) -> Any:
        """Residuals in units of `sigma_deg` without what those of a spacecraft share: independent, of deviation 1.

        Parameters
        ----------
        residual : ndarray or tensor, shape (..., K, 2)

        Returns
        -------
        ndarray or tensor, shape (..., K, 2)
        """
        if not self.shared_deg:
            return residual
        unit, shared = self._shared
        lost = (1 - 1 / np.sqrt(1 + shared))[:, None] * unit
        return residual - lost.T @ (unit @ residual)

    @cached_property
    def _axes(self) -> FloatArray:
        """The two sides of each direction and the direction itself, shape (K, 3, 3)."""
        return np.stack([*self.sides, self.towards], axis=1)

    def residual(self, source_rsun: FloatArray) -> FloatArray:
        """Angles between the lines of sight to sources and the measured directions.

        Parameters
        ----------
        source_rsun : ndarray, shape (B, K, 3)
            HEE.

        Returns
        -------
        ndarray, shape (B, 2 K)
            Two perpendicular components, in units of the error, as `independent` has them.
        """
        alone = self.independent(self.angles(source_rsun)[0])
        return np.asarray(alone.reshape(len(source_rsun), -1))

    def angles(self, source_rsun: FloatArray, *moved_rsun: FloatArray) -> list[FloatArray]:
        """The same in units of `sigma_deg`, and derivatives of them.

        Parameters
        ----------
        source_rsun : ndarray, shape (B, K, 3)
        *moved_rsun : ndarray, shape (B, K, 3)
            Derivatives of the sources.

        Returns
        -------
        list of ndarray, shape (B, K, 2)
        """
        sight = source_rsun - self.receiver_rsun
        distance = np.sqrt((sight**2).sum(axis=-1, keepdims=True))
        across, ahead = self._components(sight / distance)
        sine = np.maximum(np.sqrt((across**2).sum(axis=-1, keepdims=True)), SMALL_ANGLE)
        is_off = sine > SMALL_ANGLE
        stretch = np.where(is_off, np.arctan2(sine, ahead) / sine, 1.0)
        bend = np.where(is_off, (1 - stretch * ahead) / sine**2, 1 / 3)
        found = [stretch * across]
        for moved in moved_rsun:
            beside, further = self._components(moved / distance)
            out = (across * beside).sum(axis=-1, keepdims=True) + ahead * further  # along the line of sight
            found.append(stretch * (beside - out * across) - bend * (further - out * ahead) * across)
        return [one / np.radians(self.sigma_deg)[:, None] for one in found]

    def _components(self, vector: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Of vectors, shape (B, K, 3), those across the directions, shape (B, K, 2), and along them, (B, K, 1)."""
        turned = np.einsum("nki,kmi->nkm", vector, self._axes, optimize=True)
        return turned[..., :2], turned[..., 2:]


def _tangents(towards: FloatArray) -> FloatArray:
    """Two unit vectors across each direction: along the ecliptic, and north of it, shape (K, 2, 3)."""
    along = np.stack([-towards[:, 1], towards[:, 0], np.zeros(len(towards))], axis=1)
    length = np.linalg.norm(along, axis=1, keepdims=True)
    along = np.where(length > SMALL_ANGLE, along / np.maximum(length, SMALL_ANGLE), [1.0, 0.0, 0.0])
    return np.stack([along, np.cross(towards, along)], axis=1)


def read_directions(path: Path) -> pd.DataFrame:
    """Read and check a table of wave directions from a CSV file; lines that begin with # are comments.

    Returns
    -------
    pandas.DataFrame
        As :func:`check_directions` returns it.

    Raises
    ------
    InputError
        If the file cannot be read, or names the row and column that is wrong.
    """
    return check_directions(parse_table(read_table_text(path), str(path)), source=str(path))


def check_directions(frame: pd.DataFrame, *, source: str = "directions") -> pd.DataFrame:
    """Check a table of wave directions.

    Parameters
    ----------
    frame : pandas.DataFrame
        Columns ``observatory, frequency_mhz, sigma_deg``, the direction towards the source in HEE as ``longitude_deg,
        latitude_deg`` or as ``azimuth_deg, colatitude_deg``, and for observatories that neither the arrival table nor
        the ephemeris places ``x_rsun, y_rsun, z_rsun``.
    source : str
        What the table is called in error messages.

    Returns
    -------
    pandas.DataFrame
        ``observatory, frequency_mhz, longitude_deg, latitude_deg, sigma_deg, x_rsun, y_rsun, z_rsun``; the positions
        are NaN where the table has none.

    Raises
    ------
    InputError
        Names the row and column that is wrong.
    """
    angles = next((pair for pair in ANGLES if set(pair) <= set(frame.columns)), None)
    missing = [name for name in REQUIRED if name not in frame.columns]
    if missing or angles is None:
        what = missing[0] if missing else "longitude_deg"
        raise InputError(f"{source}: column {what} is missing; needed are {', '.join((*REQUIRED, *ANGLES[0]))}")
    if not 0 < len(frame) <= LARGEST_TABLE:
        raise InputError(f"{source}: has {len(frame)} rows; give between 1 and {LARGEST_TABLE}")
    first, second = (_number(frame, name, source) for name in angles)
    return pd.DataFrame(
        {
            "observatory": frame["observatory"].astype(str).str.strip().to_numpy(),
            "frequency_mhz": _number(frame, "frequency_mhz", source),
            "longitude_deg": first,
            "latitude_deg": second if angles == ANGLES[0] else 90 - second,
            "sigma_deg": _number(frame, "sigma_deg", source),
            **{name: _coordinate(frame, name) for name in POSITION},
        }
    )


def direction_terms(
    table: pd.DataFrame, arrivals: pd.DataFrame, epoch: np.datetime64, floor_deg: float = 0.0
) -> DirectionTerms:
    """Directions as the likelihood needs them, each from where its spacecraft was.

    Parameters
    ----------
    table : pandas.DataFrame
        As :func:`check_directions` returns it.
    arrivals : pandas.DataFrame
        As :func:`bella.arrivals.locate_receivers` returns it: where it places the observatory, that position is taken.
    epoch : numpy.datetime64
        Of the HEE axes.
    floor_deg : float
        Standard deviation of the turn that all directions of a spacecraft share beside their own errors, degrees.

    Raises
    ------
    InputError
        If the position of an observatory is not known, or the floor is not an angle.
    NoDataError
        If the time is outside the ephemeris.
    """
    if not 0 <= floor_deg <= LIMITS["sigma_deg"][1]:
        raise InputError(f"floor {floor_deg} of the directions is not between 0 and 180; give degrees")
    places = arrivals.groupby("observatory")[list(POSITION)].mean().T.to_dict("list")
    own = table[list(POSITION)].to_numpy(dtype=np.float64)
    receiver = [
        row if np.isfinite(row).all() else places.get(name) or _ephemeris(str(name), epoch)
        for name, row in zip(table["observatory"], own, strict=True)
    ]
    return DirectionTerms(
        table["frequency_mhz"].to_numpy(dtype=np.float64),
        np.array(receiver, dtype=np.float64),
        cartesian(1.0, table["longitude_deg"].to_numpy(), table["latitude_deg"].to_numpy()),
        table["sigma_deg"].to_numpy(dtype=np.float64),
        floor_deg,
        tuple(map(str, table["observatory"])),
    )


def _ephemeris(observatory: str, epoch: np.datetime64) -> FloatArray:
    try:
        return np.asarray(position_hee(observatory, np.array([epoch]), epoch)[0], dtype=np.float64)
    except InputError as error:
        raise InputError(
            f"directions: {observatory!r} is neither in the arrival table nor in the ephemeris; "
            "add the columns x_rsun, y_rsun, z_rsun (HEE)"
        ) from error


def _number(frame: pd.DataFrame, column: str, source: str) -> FloatArray:
    values = pd.to_numeric(frame[column], errors="coerce").to_numpy(dtype=np.float64)
    low, high = LIMITS[column]
    wrong = ~((values >= low) & (values <= high))
    if wrong.any():
        row = int(np.argmax(wrong))
        raise InputError(
            f"{source}: row {row + 1}, column {column}: {str(frame[column].iloc[row])[:80]!r} is not between "
            f"{low:g} and {high:g}"
        )
    return values


def _coordinate(frame: pd.DataFrame, name: str) -> FloatArray:
    if name not in frame.columns:
        return np.full(len(frame), np.nan)
    return np.asarray(pd.to_numeric(frame[name], errors="coerce").to_numpy(dtype=np.float64))


def wave_directions(spectrum: xr.Dataset, window: tuple[np.datetime64, np.datetime64]) -> pd.DataFrame:
    """Direction of the waves in each channel at the peak of its flux, the mean of unit vectors weighted by flux.

    Parameters
    ----------
    spectrum : xarray.Dataset
        With ``intensity`` and, in degrees, ``wave_colatitude_hee_deg`` and ``wave_azimuth_hee_deg`` or the same with
        ``rtn`` (time, frequency), as :func:`bella.spectra.open_spectra` reads STEREO L3 and Wind RAD1 L3 files; the
        attribute ``observatory`` names the receiver.
    window : tuple of numpy.datetime64
        First and last time to look for the peak.

    Returns
    -------
    pandas.DataFrame
        ``observatory, frequency_mhz, longitude_deg, latitude_deg, sigma_deg, samples``, HEE, towards the source, one
        row per channel with three samples or more near its peak that agree; ``sigma_deg`` is their scatter in one of
        two perpendicular directions. The attribute ``turned`` says whether the angles were those of the wave
        vector.

    Raises
    ------
    InputError
        If the spectrum has no directions, or nothing in the window.
    NoDataError
        If the spacecraft is outside the ephemeris then.
    """
    frame = next((one for one in FRAMES if all(name.format(one) in spectrum for name in WAVE_ANGLES)), None)
    if frame is None:
        raise InputError("spectrum has no wave directions; take STEREO L3 or Wind RAD1 L3 files, which carry them")
    shown = spectrum.sel(time=slice(*window)).transpose("time", "frequency", ...)
    if shown.sizes["time"] < MIN_SAMPLES:
        raise InputError(f"spectrum has fewer than {MIN_SAMPLES} samples between {window[0]} and {window[1]}")
    name, utc = str(spectrum.attrs.get("observatory", "")), shown["time"].to_numpy()[0]
    sunwards = -position_hee(name, np.array([utc]), utc)[0]
    flux = shown["intensity"].to_numpy().astype(np.float64)
    colatitude, azimuth = (shown[angle.format(frame)].to_numpy().ravel() for angle in WAVE_ANGLES)
    towards = cartesian(1.0, azimuth, 90.0 - colatitude).reshape(*flux.shape, 3)
    if frame == "rtn":
        towards = towards @ _sunward_axes(sunwards, utc)
    return _direction_table(name, shown["frequency"].to_numpy(), _mean_directions(flux, towards), sunwards)


def _sunward_axes(sunwards: FloatArray, utc: np.datetime64) -> FloatArray:
    """Rows X to the Sun, Y, and Z as near to solar north as X allows, in HEE."""
    x = sunwards / np.linalg.norm(sunwards)
    north = hee_from("heeq", np.array([[0.0, 0.0, 1.0]]), utc)[0]
    z = north - (north @ x) * x
    z /= np.linalg.norm(z)
    return np.stack([x, np.cross(z, x), z])


def _mean_directions(flux: FloatArray, towards: FloatArray) -> list[tuple[FloatArray, float, int] | None]:
    return [_mean_direction(flux[:, column], towards[:, column]) for column in range(flux.shape[1])]


def _direction_table(
    name: str, frequency_mhz: FloatArray, found: list[tuple[FloatArray, float, int] | None], sunwards: FloatArray
) -> pd.DataFrame:
    rows = [(f, *one) for f, one in zip(frequency_mhz, found, strict=True) if one is not None]
    unit = np.array([mean for _, mean, _, _ in rows]).reshape(-1, 3)
    turned = bool(rows) and float((unit @ sunwards).mean()) < 0
    x, y, z = (-unit if turned else unit).T
    columns = {
        "observatory": [name] * len(rows),
        "frequency_mhz": [row[0] for row in rows],
        "longitude_deg": np.degrees(np.arctan2(y, x)),
        "latitude_deg": np.degrees(np.arcsin(z)),
        "sigma_deg": [row[2] for row in rows],
        "samples": [row[3] for row in rows],
    }
    table = pd.DataFrame(columns)
    table.attrs["turned"] = turned
    return table


def _mean_direction(flux: FloatArray, towards: FloatArray) -> tuple[FloatArray, float, int] | None:
    """Unit vector, scatter in degrees, and number of samples; None where there are too few."""
    known = np.isfinite(flux) & np.isfinite(towards).all(axis=1)
    flux, towards = flux[known], towards[known]  # channels that a sweep visits once have holes elsewhere
    if not flux.size or not _rises(flux):
        return None
    taken = _near_peak(flux) & (flux > 0)
    if taken.sum() < MIN_SAMPLES:
        return None
    weight = flux[taken] / flux[taken].sum()
    mean = weight @ towards[taken]
    mean /= np.linalg.norm(mean)
    angle = np.degrees(np.arctan2(np.linalg.norm(np.cross(towards[taken], mean), axis=1), towards[taken] @ mean))
    # two perpendicular components share the angle, and one direction was taken from the same samples
    scatter = np.sqrt(weight @ angle**2 / 2 / max(1 - float((weight**2).sum()), 1e-3))
    if scatter > LARGEST_SCATTER_DEG:
        return None
    return mean, max(float(scatter), LEAST_SIGMA_DEG), int(taken.sum())


def _rises(flux: FloatArray) -> bool:
    quiet, lowest = np.quantile(flux, [QUIET, NOISE])
    return bool(flux.max() - quiet > LEAST_RISE * (quiet - lowest))


def _near_peak(flux: FloatArray) -> npt.NDArray[np.bool_]:
    """Samples in one piece with the highest, above a share of it, and at least its two neighbours."""
    peak, high = int(flux.argmax()), flux > NEAR_PEAK * flux.max()
    piece = np.cumsum(np.concatenate([[0], np.abs(np.diff(high.astype(int)))]))
    near = high & (piece == piece[peak])
    near[max(peak - 1, 0) : peak + 2] = True
    return np.asarray(near)
