"""The functions that ``import bella`` offers, and what they return: tables, sky coordinates, posteriors and plots.

They put together what the rooms of the package do, with the defaults of the command line.

>>> import bella
>>> arrivals = bella.read_arrivals("arrivals.csv")
>>> source = bella.localise(arrivals, draws=100)
>>> source.to_table()["frequency_mhz"].unit
Unit("MHz")
>>> source.to_skycoord().frame.name
'heliocentricearthecliptic'
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr
from astropy import units as u
from astropy.table import QTable, Table
from astropy.time import Time

from bella.answer import written_68
from bella.arrivals import MIN_OBSERVATORIES, arrival_grid, check_arrivals, locate_receivers
from bella.arrivals import read_arrivals as read_arrival_file
from bella.exceptions import InputError, NoDataError
from bella.formats.astropy_tables import quantity_table
from bella.formats.columns import ARRIVALS, DETECTIONS, LOCALISATIONS, TRACKS
from bella.formats.record_table import RecordTable, record_table
from bella.formats.tables import localisation_records, track_numbers
from bella.records import JointTrack
from bella.times import parse_utc
from bella.units import FloatArray
from bella.user_tables import arrival_frame

if TYPE_CHECKING:
    from astropy.coordinates import SkyCoord

    from bella.plotting import Figure
    from bella.spectra import FleetPiece

FEWEST_FOR_TRACK = 2
EDGE_FREQUENCIES = 40

Spectrum = str | Path | xr.Dataset | xr.DataArray | xr.DataTree
SPECTRUM = (str, Path, xr.Dataset, xr.DataArray, xr.DataTree)
Spectra = Spectrum | Iterable[Spectrum]


@dataclass(frozen=True)
class Arrivals:
    """Arrival times of one burst.

    Attributes
    ----------
    frame : pandas.DataFrame
        As :func:`bella.arrivals.check_arrivals` returns it.
    covariance_s2 : ndarray, shape (rows, rows), or None
        Full covariance of the times, s^2, where it is known; `localise` and `fit_track` use it.
    """

    frame: pd.DataFrame
    covariance_s2: FloatArray | None = None

    def __repr__(self) -> str:
        names = ", ".join(dict.fromkeys(self.frame["observatory"]))
        return f"Arrivals({len(self)} times at {self.frame['frequency_mhz'].nunique()} frequencies, {names})"

    def __len__(self) -> int:
        return len(self.frame)

    def to_table(self) -> QTable:
        """Table with a Time, and a Quantity for every column with a unit."""
        return quantity_table(_table(ARRIVALS.without("burst_id", "solution_id"), self.frame))

    def plot(self) -> "Figure":
        """Frequency against arrival time, one line per spacecraft."""
        from bella.plotting import arrivals_figure  # noqa: PLC0415 - heavy

        return arrivals_figure(self.frame)


@dataclass(frozen=True)
class Localisation:
    """Where the source of a burst was at each frequency.

    Attributes
    ----------
    posterior : xarray.Dataset
        Draws and summary, as :func:`bella.multilateration.localise` returns them.
    """

    posterior: xr.Dataset

    def __repr__(self) -> str:
        said = self.posterior.attrs
        return f"Localisation({self.posterior.sizes['frequency']} frequencies, {said['method']}, {said['preset']})"

    def to_table(self) -> QTable:
        """Localisation table, one row per frequency: positions HEE, covariances, areas, flags."""
        said = {name: self.posterior.attrs[name] for name in ("edge", "method", "preset")}
        rows = [{**record, **said} for record in localisation_records(self.posterior)]
        header = {name: str(self.posterior.attrs[name]) for name in ("frame", "reference_time", "comment")}
        return quantity_table(record_table(LOCALISATIONS.without("burst_id", "solution_id"), rows, header))

    def to_skycoord(self) -> "SkyCoord":
        """Mean position at each frequency in the sunpy frame HeliocentricEarthEcliptic, of the time of the burst."""
        xyz = [self.posterior[f"{axis}_rsun"].to_numpy() for axis in "xyz"]
        return _skycoord(np.array(xyz), self.posterior.attrs["reference_time"])

    def plot(self) -> "Figure":
        """Positions with their regions on the map of the ecliptic, and the receivers."""
        from bella.plotting import positions_figure  # noqa: PLC0415 - heavy

        return positions_figure(self.posterior)


@dataclass(frozen=True)
class FittedTrack:
    """The Parker spiral behind a burst.

    Attributes
    ----------
    record : JointTrack
        All that is published about it.
    posterior : xarray.Dataset
        Draws of the joint fit, ``joint_draws``; empty for two spacecraft and where nothing could be fitted.
    """

    record: JointTrack
    posterior: xr.Dataset

    def __repr__(self) -> str:
        written = written_68(self.record.phi0_deg.model_dump())
        said = f"longitude {written} deg" if written else "no longitude"
        return f"FittedTrack({said}, {self.record.model})"

    def to_table(self) -> QTable:
        """One row: median and 68 % interval of longitude, wind and beam, with their units."""
        schema = TRACKS.without("burst_id", "start_utc", "grade", "edge", "method", "preset", "solution_id")
        return quantity_table(record_table(schema, [track_numbers(self.record)], {"model": self.record.model}))

    def to_skycoord(self) -> "SkyCoord":
        """Source at each frequency of the profile, in the sunpy frame HeliocentricEarthEcliptic of the burst.

        Raises
        ------
        NoDataError
            If the track has no profile.
        """
        known = [one for one in self.record.profile if None not in {one.range_rsun.q50, one.longitude_deg.q50}]
        if not known:
            raise NoDataError("the track has no position at any frequency: see its flags")
        distance = np.array([one.range_rsun.q50 for one in known], dtype=float)
        longitude = np.radians(np.array([one.longitude_deg.q50 for one in known], dtype=float))
        xyz = distance * np.array([np.cos(longitude), np.sin(longitude), np.zeros_like(longitude)])
        return _skycoord(xyz, self.record.epoch_utc)

    def plot(self) -> "Figure":
        """Sources of the profile and the spiral on the map of the ecliptic."""
        from bella.plotting import track_figure  # noqa: PLC0415 - heavy

        return track_figure(self.record, self.posterior)


@dataclass(frozen=True)
class Detections:
    """Bursts that were found in spectra.

    Attributes
    ----------
    frame : pandas.DataFrame
        One row per burst and spacecraft, as the command ``bella detect`` writes it.
    not_searchable : tuple of str
        Why spectra could not be searched, a line for each: no burst in the table does not mean that they show none.
    """

    frame: pd.DataFrame
    not_searchable: tuple[str, ...] = ()

    def __repr__(self) -> str:
        unsearched = "".join(f"; not searchable: {one}" for one in self.not_searchable)
        return f"Detections({len(self)} of {self.frame['observatory'].nunique()} spacecraft{unsearched})"

    def __len__(self) -> int:
        return len(self.frame)

    def to_table(self) -> QTable:
        """Table with Times, and a Quantity for every column with a unit."""
        return quantity_table(_table(DETECTIONS.without("burst_id"), self.frame))

    def plot(self) -> "Figure":
        """Boxes of time and frequency."""
        from bella.plotting import detections_figure  # noqa: PLC0415 - heavy

        return detections_figure(self.frame)


def read_arrivals(path: str | Path) -> Arrivals:
    """Read and check an arrival table (CSV) of two spacecraft or more.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    Arrivals

    Raises
    ------
    InputError
        Names the row and column that is wrong.
    """
    return Arrivals(read_arrival_file(Path(path), received_by=FEWEST_FOR_TRACK))


def localise(table: "Arrivals | pd.DataFrame | Table | Mapping[str, Any] | str | Path", **choices: Any) -> Localisation:
    """Locate the source of a burst at every frequency that three or more spacecraft received.

    Parameters
    ----------
    table : Arrivals, DataFrame, astropy Table or QTable, mapping of columns, or path
        With units as :mod:`bella.user_tables` says.
    **choices
        `preset`, `method`, `dimensions`, `draws`, `seed`, `delay`: see :func:`bella.multilateration.localise`.

    Returns
    -------
    Localisation

    Raises
    ------
    InputError
        Names the row and column, or the choice, that is wrong.
    """
    from bella.multilateration import localise as posterior_of  # noqa: PLC0415 - heavy

    given = _arrivals(table, MIN_OBSERVATORIES)
    return Localisation(posterior_of(given.frame, **{"covariance_s2": given.covariance_s2, **choices}))


def fit_track(
    table: "Arrivals | pd.DataFrame | Table | Mapping[str, Any] | str | Path",
    *,
    preset: str = "default",
    draws: int | None = None,
    seed: int = 0,
) -> FittedTrack:
    """Fit one source on one Parker spiral to the arrival times of all frequencies together.

    Parameters
    ----------
    table : Arrivals, DataFrame, astropy Table or QTable, mapping of columns, or path
        Of two spacecraft (which give a preliminary track) or more.
    preset : str
        A name of `bella.multilateration.PRESETS`.
    draws : int, optional
        Posterior draws to keep.
    seed : int

    Returns
    -------
    FittedTrack

    Raises
    ------
    InputError
        Names the row and column, or the choice, that is wrong.
    NotPlacedError
        If two spacecraft alone say too little.
    """
    from bella.multilateration.priors import apply_sigma_rule, find_preset  # noqa: PLC0415 - heavy
    from bella.tracks import TrackModel, fit_preliminary, with_joint_draws  # noqa: PLC0415
    from bella.tracks import fit_track as joint_fit  # noqa: PLC0415
    from bella.tracks.fit import DRAWS  # noqa: PLC0415

    given = _arrivals(table, FEWEST_FOR_TRACK)
    chosen = find_preset(preset)
    grid = arrival_grid(locate_receivers(given.frame), received_by=1, covariance_s2=given.covariance_s2)
    grid = apply_sigma_rule(grid, chosen)
    if len(grid.observatories) < MIN_OBSERVATORIES:
        return FittedTrack(fit_preliminary(grid), xr.Dataset())
    fit = joint_fit(grid, TrackModel(delay=chosen.delay), draws=draws or DRAWS, seed=seed)
    return FittedTrack(fit.record, with_joint_draws(xr.Dataset(), fit))


def detect(spectra: Spectra) -> Detections:
    """Find Type III bursts in spectra of one or more spacecraft, and tell which are the same one.

    Parameters
    ----------
    spectra : path, xarray.Dataset or DataTree, or several of them
        Archive files, netCDF, Zarr, or dynamic spectra that are open.

    Returns
    -------
    Detections

    Raises
    ------
    InputError
        If a file cannot be read as a spectrum.
    """
    from bella.bursts.association import detect_in_fleet  # noqa: PLC0415 - heavy

    found = detect_in_fleet(_pieces(spectra))
    return Detections(found.table, tuple(found.not_searchable))


def time_edges(
    spectra: Spectra,
    around: "str | np.datetime64 | datetime | Time",
    *,
    edge: str = "shared_profile",
    frequencies: int = EDGE_FREQUENCIES,
) -> Arrivals:
    """Time the edges of one burst at frequencies that all spacecraft share.

    Parameters
    ----------
    spectra : path, xarray.Dataset, or several of them
        Of one burst, at least one per spacecraft.
    around : str, datetime64, datetime or Time
        About when the burst begins at high frequencies, UTC.
    edge : str
        A name of `bella.bursts.timing.EDGES`.
    frequencies : int
        So many, evenly spread in logarithm.

    Returns
    -------
    Arrivals
        With the full covariance of its rows.

    Raises
    ------
    InputError
        If the edge or the time is not known.
    NoDataError
        If no spacecraft shows a burst there.
    """
    from bella.bursts.timing import EDGES, arrivals_of, time_spectra  # noqa: PLC0415 - heavy
    from bella.bursts.timing import arrival_frame as timed_frame  # noqa: PLC0415

    if edge not in EDGES:
        raise InputError(f"edge {edge!r} is not known; choose one of {', '.join(EDGES)}")
    if frequencies < 1:
        raise InputError(f"{frequencies} frequencies are too few; ask for 1 or more")
    moment = _moment(around)
    nearest = min(_pieces(spectra), key=lambda piece: piece.apart_s(moment))
    timed, _ = time_spectra(nearest.spectra.values(), moment, edge)
    rows = arrivals_of(timed, frequencies)
    return Arrivals(timed_frame(timed, rows), rows.covariance_s2())


def _pieces(spectra: Spectra) -> "list[FleetPiece]":
    from bella.spectra import as_spectrum, fleet_pieces, open_spectra  # noqa: PLC0415 - heavy

    is_several = isinstance(spectra, Iterable) and not isinstance(spectra, (*SPECTRUM, pd.DataFrame))
    several: list[Any] = list(spectra) if is_several else [spectra]  # type: ignore[arg-type]
    opened: list[xr.Dataset] = []
    for one in several:
        if not isinstance(one, SPECTRUM):
            raise InputError(f"{type(one).__name__} is no spectrum; give a file, an xarray.Dataset or several of them")
        if isinstance(one, xr.Dataset | xr.DataArray):
            opened.append(as_spectrum(one, "the dataset"))
        elif isinstance(one, xr.DataTree):
            opened += [as_spectrum(leaf.to_dataset(), leaf.path) for leaf in one.leaves]
        else:
            opened += open_spectra(one)
    pieces, left_out = fleet_pieces(opened)
    if left_out:
        raise InputError(left_out[0])
    return pieces


def _moment(around: "str | np.datetime64 | datetime | Time") -> np.datetime64:
    text = around.utc.isot if isinstance(around, Time) else str(around)
    moment = parse_utc(text, "around")
    return np.datetime64(moment.replace(tzinfo=None), "ns")  # type: ignore[union-attr]


def _arrivals(table: Any, received_by: int) -> Arrivals:
    if isinstance(table, Arrivals):
        return Arrivals(check_arrivals(table.frame, received_by=received_by), table.covariance_s2)
    if isinstance(table, str | Path):
        return Arrivals(read_arrival_file(Path(table), received_by=received_by))
    return Arrivals(check_arrivals(arrival_frame(table), received_by=received_by))


def _table(schema: Any, frame: pd.DataFrame) -> RecordTable:
    rows = frame.astype(object).where(frame.notna(), None).to_dict("records")
    return record_table(schema, [{str(name): value for name, value in row.items()} for row in rows])


def _skycoord(xyz_rsun: npt.NDArray[np.float64], epoch_utc: str) -> "SkyCoord":
    from astropy.coordinates import SkyCoord  # noqa: PLC0415 - sunpy is heavy
    from sunpy.coordinates import HeliocentricEarthEcliptic  # noqa: PLC0415

    frame = HeliocentricEarthEcliptic(obstime=Time(epoch_utc.removesuffix("Z"), scale="utc"))
    x, y, z = xyz_rsun * u.R_sun
    return SkyCoord(x, y, z, frame=frame, representation_type="cartesian")
