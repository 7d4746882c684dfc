"""Directions of the waves of a burst, from a spectrum that carries them: one per channel, at the peak of its flux.

While the flux is near its peak the burst outshines the background, and scattering has turned the waves least (Krupar et
al. 2012, J. Geophys. Res. 117, A06101, doi:10.1029/2011JA017333).

STEREO gives its angles in HEE. Wind gives them in a frame of its own, X to the Sun and Z to solar north; the burst of
2020-07-11 is within 5 degrees of X there at 1 MHz. Angles towards the source and along the wave vector are half a turn
apart, and which is meant is told by the Sun: no burst that leaves it is behind a spacecraft in most of its channels.
"""

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr

from bella.exceptions import InputError
from bella.spacecraft import cartesian, hee_from, position_hee
from bella.units import FloatArray

ANGLES = ("wave_colatitude_{}_deg", "wave_azimuth_{}_deg")
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
    frame = next((one for one in FRAMES if all(name.format(one) in spectrum for name in ANGLES)), None)
    if frame is None:
        raise InputError("spectrum has no wave directions; take STEREO L3 or Wind RAD1 L3 files, which carry them")
    shown = spectrum.sel(time=slice(*window)).transpose("time", "frequency", ...)
    if shown.sizes["time"] < MIN_SAMPLES:
        raise InputError(f"spectrum has fewer than {MIN_SAMPLES} samples between {window[0]} and {window[1]}")
    name, utc = str(spectrum.attrs.get("observatory", "")), shown["time"].to_numpy()[0]
    sunwards = -position_hee(name, np.array([utc]), utc)[0]
    flux = shown["intensity"].to_numpy().astype(np.float64)
    colatitude, azimuth = (shown[angle.format(frame)].to_numpy().ravel() for angle in ANGLES)
    towards = cartesian(1.0, azimuth, 90.0 - colatitude).reshape(*flux.shape, 3)
    if frame == "rtn":
        towards = towards @ _sunward_axes(sunwards, utc)
    return _table(name, shown["frequency"].to_numpy(), _mean_directions(flux, towards), sunwards)


def _sunward_axes(sunwards: FloatArray, utc: np.datetime64) -> FloatArray:
    """Rows X to the Sun, Y, and Z as near to solar north as X allows, in HEE."""
    x = sunwards / np.linalg.norm(sunwards)
    north = hee_from("heeq", np.array([[0.0, 0.0, 1.0]]), utc)[0]
    z = north - (north @ x) * x
    z /= np.linalg.norm(z)
    return np.stack([x, np.cross(z, x), z])


def _mean_directions(flux: FloatArray, towards: FloatArray) -> list[tuple[FloatArray, float, int] | None]:
    return [_mean_direction(flux[:, column], towards[:, column]) for column in range(flux.shape[1])]


def _table(
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
