"""Positions in the plane of the ecliptic as distance and longitude, with the covariance of the two."""

import math

import numpy as np
import xarray as xr

from bella.units import FloatArray

NEAREST_SIGMAS = 3.0
"""A position nearer to the Sun than this many of its errors has no longitude to speak of."""


def planar_positions(posterior: xr.Dataset) -> tuple[FloatArray, FloatArray]:
    """Positions of a solution in the plane of the ecliptic, and their covariances.

    Parameters
    ----------
    posterior : xarray.Dataset
        Variables ``x_rsun, y_rsun, cov_xx_rsun2, cov_xy_rsun2, cov_yy_rsun2`` over ``frequency``.

    Returns
    -------
    tuple of numpy.ndarray
        Solar radii, shape (F, 2), and solar radii squared, shape (F, 2, 2).
    """
    x, y, xx, xy, yy = (
        posterior[name].to_numpy().astype(np.float64)
        for name in ("x_rsun", "y_rsun", "cov_xx_rsun2", "cov_xy_rsun2", "cov_yy_rsun2")
    )
    return np.stack([x, y], -1), np.stack([np.stack([xx, xy], -1), np.stack([xy, yy], -1)], -2)


def polar_covariance(position_rsun: FloatArray, covariance_rsun2: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Distance and longitude of positions, and the covariance of the two to first order.

    Parameters
    ----------
    position_rsun : numpy.ndarray, shape (N, 2)
        HEE x and y, solar radii.
    covariance_rsun2 : numpy.ndarray, shape (N, 2, 2)
        Of x and y.

    Returns
    -------
    polar : numpy.ndarray, shape (N, 2)
        Solar radii, and degrees between -180 and 180.
    covariance : numpy.ndarray, shape (N, 2, 2)
        In solar radii and degrees; NaN at the centre of the Sun.
    """
    position = np.asarray(position_rsun, dtype=np.float64)
    distance = np.linalg.norm(position, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        cosine, sine = position.T / distance
        to_deg = math.degrees(1.0) / distance
        turn = np.stack([np.stack([cosine, sine], -1), np.stack([-sine * to_deg, cosine * to_deg], -1)], axis=1)
        covariance = np.einsum("nij,njk,nlk->nil", turn, np.asarray(covariance_rsun2, dtype=np.float64), turn)
    longitude = np.degrees(np.arctan2(position[:, 1], position[:, 0]))
    return np.stack([distance, longitude], axis=-1), covariance


def has_longitude(range_rsun: FloatArray, variance_rsun2: FloatArray) -> "np.ndarray[tuple[int], np.dtype[np.bool_]]":
    """Whether positions are far enough from the Sun for a longitude: three errors of their distance.

    Parameters
    ----------
    range_rsun, variance_rsun2 : numpy.ndarray, shape (N,)
        Distance, and its variance.

    Returns
    -------
    numpy.ndarray of bool, shape (N,)
        False where a number is missing.
    """
    with np.errstate(invalid="ignore"):
        return np.asarray(range_rsun**2 > NEAREST_SIGMAS**2 * variance_rsun2)
