"""Make the compact ephemeris table out of a dense one.

``python -m bella.spacecraft.encode SOURCE.h5 TARGET.nc``

The source holds positions every 3 h (Earth: 12 h) in the layout of the HUXt package, ``BODY/HAE/`` with ``time``,
``radius``, ``longitude`` and ``latitude`` in Julian days, km and degrees. A cubic spline through far fewer nodes gives
the same positions back; nodes are added where it does not, until every node left out is met within the tolerance.
So they lie close together at the perihelia of Parker Solar Probe, on the days of planetary flybys, and where the source
itself jumps because two trajectory files were joined.
"""

import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import xarray as xr
from scipy.interpolate import CubicSpline

from bella.units import FloatArray

TOLERANCE_KM = 20.0
"""Largest distance between a source position and the spline, before positions are rounded to whole km."""

FIRST_SPACING_D = 16.0
J2000_MIDNIGHT_JD = 2_451_544.5
DAY_MS = 86_400_000
SOURCE_NAMES = {"EARTH": "EARTH", "ACE": "ACE", "STEREO-A": "STA", "STEREO-B": "STB", "PSP": "PSP", "SOLO": "SOLO"}
REFERENCE_UTC = np.datetime64("2000-01-01", "ns")
CONTACT_LOST_MS = int((np.datetime64("2014-10-01", "ms") - REFERENCE_UTC).astype("timedelta64[ms]").astype(np.int64))
MILLISECONDS_UNIT = "milliseconds since 2000-01-01T00:00:00"


class Orbit(NamedTuple):
    """Positions of one body at the nodes of a table."""

    time_ms: npt.NDArray[np.int64]
    """UTC, milliseconds after 2000-01-01 without leap seconds, shape (N,)."""
    position_km: FloatArray
    """Mean ecliptic and equinox of J2000, shape (N, 3)."""


def read_source(path: Path, body: str) -> Orbit:
    """Positions of one body as the dense table has them.

    Parameters
    ----------
    path : Path
        HDF5 file in the layout of HUXt.
    body : str
        One of the keys of ``SOURCE_NAMES``. STEREO-B ends on 2014-10-01, when contact was lost.

    Returns
    -------
    Orbit
        All nodes of the source.
    """
    with xr.open_dataset(path, group=f"{SOURCE_NAMES[body]}/HAE", engine="h5netcdf", phony_dims="sort") as table:
        time_ms = np.rint((table["time"].values - J2000_MIDNIGHT_JD) * DAY_MS).astype(np.int64)
        longitude, latitude = np.radians(table["longitude"].values), np.radians(table["latitude"].values)
        direction = [np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)]
        position_km = np.stack(direction, axis=-1) * table["radius"].values[:, np.newaxis]
    known = time_ms <= (CONTACT_LOST_MS if body == "STEREO-B" else time_ms[-1])
    return Orbit(time_ms[known], position_km[known])


def thin(orbit: Orbit, tolerance_km: float = TOLERANCE_KM) -> Orbit:
    """Leave out the nodes that a cubic spline through the others gives back.

    Parameters
    ----------
    orbit : Orbit
        All nodes, at least four.
    tolerance_km : float
        Largest distance allowed at a node that is left out.

    Returns
    -------
    Orbit
        The nodes that are kept, rounded to whole km.
    """
    stride = max(1, int(FIRST_SPACING_D * DAY_MS / np.median(np.diff(orbit.time_ms))))
    kept = np.zeros(len(orbit.time_ms), dtype=bool)
    kept[::stride] = kept[-1] = kept[1] = kept[-2] = True
    while len(worst := worst_nodes(orbit, kept, tolerance_km)):
        kept[worst] = True
    return Orbit(orbit.time_ms[kept], np.rint(orbit.position_km[kept]))


def worst_nodes(orbit: Orbit, kept: npt.NDArray[np.bool_], tolerance_km: float) -> npt.NDArray[np.intp]:
    """Index of the worst node of every gap between kept nodes where the spline misses by more than the tolerance.

    Parameters
    ----------
    orbit : Orbit
        All N nodes.
    kept : numpy.ndarray
        Which of them the spline goes through, shape (N,).
    tolerance_km : float
        Misses up to this are left alone.

    Returns
    -------
    numpy.ndarray
        Indices into the N nodes, none of them kept so far.
    """
    spline = CubicSpline(orbit.time_ms[kept] / DAY_MS, orbit.position_km[kept])
    miss_km = np.linalg.norm(spline(orbit.time_ms / DAY_MS) - orbit.position_km, axis=1)
    miss_km[kept] = 0.0
    candidates = np.flatnonzero(miss_km > tolerance_km)
    gap = np.cumsum(kept)[candidates]
    order = np.lexsort((-miss_km[candidates], gap))
    _, first = np.unique(gap[order], return_index=True)
    return candidates[order][first]


def to_dataset(orbits: dict[str, Orbit]) -> xr.Dataset:
    """Put the nodes of all bodies one behind the other (CF contiguous ragged array).

    Parameters
    ----------
    orbits : dict of str to Orbit
        Thinned nodes by body.

    Returns
    -------
    xarray.Dataset
        ``time`` (ms), ``position`` (km, int32) over ``node``; ``node_count`` over ``body``.
    """
    time_ms = np.concatenate([orbit.time_ms for orbit in orbits.values()])
    position_km = np.concatenate([orbit.position_km for orbit in orbits.values()]).astype(np.int32)
    count = np.array([len(orbit.time_ms) for orbit in orbits.values()], dtype=np.int32)
    table = xr.Dataset(
        {
            "time": (
                "node",
                time_ms,
                {"units": MILLISECONDS_UNIT, "long_name": "UTC of the node", "calendar": "standard"},
            ),
            "position": (("node", "axis"), position_km, {"units": "km", "long_name": "heliocentric position"}),
            "node_count": ("body", count, {"sample_dimension": "node", "long_name": "number of nodes of the body"}),
        },
        coords={"body": list(orbits), "axis": ["x", "y", "z"]},
    )
    return table.assign_attrs(
        Conventions="CF-1.11",
        title="Heliocentric positions of Earth and of spacecraft that carry radio receivers",
        frame="mean ecliptic and equinox of J2000, origin the centre of the Sun, geometric (no light time)",
        source="JPL Horizons, by way of ephemeris.hdf5 of the package huxt 5.0.3 (MIT licence), frame HAE",
        history="bella.spacecraft.encode: thinned for cubic spline interpolation, rounded to 1 km",
        tolerance_km=TOLERANCE_KM,
        comment="Julian days of the source are UTC: only so does Earth agree with an independent ephemeris "
        "(30 km, against 2000 km if they were TDB). STEREO-B ends with the loss of contact on 2014-10-01.",
    )


def encode(source: Path, target: Path) -> None:
    """Read the dense table, thin every body, write the compact table.

    Parameters
    ----------
    source, target : Path
        HDF5 file in the layout of HUXt; netCDF4 file to be written.
    """
    table = to_dataset({body: thin(read_source(source, body)) for body in SOURCE_NAMES})
    packed = {"zlib": True, "complevel": 9, "shuffle": True}
    table.to_netcdf(target, engine="h5netcdf", encoding={"time": packed, "position": packed})


if __name__ == "__main__":
    encode(Path(sys.argv[1]), Path(sys.argv[2]))
