"""The arrival table: what bursts hands over, and what multilateration and tracks take.

One table holds one burst with one definition of the edge: one row per spacecraft and channel, with the time at which
the edge arrived and its timing error. As a file it is a CSV with the columns ``observatory, frequency_mhz,
arrival_utc, sigma_s, edge, flag`` and, for observatories the ephemeris does not know, ``x_rsun, y_rsun, z_rsun``
(HEE). Lines that begin with ``#`` are comments.

The noise model of a table, the same for every method: each row has an independent error ``sigma_s``; an error
``shape_sd_s`` that is smooth along frequency within an observatory, whose correlation length in ln f stands above the
header as ``# shape_length_ln_f: 0.5``; and an offset ``offset_sd_s`` that all channels of an observatory share (sample
grid, clock). ``delay_s`` is a known delay beyond light travel; its error ``delay_sd_s`` changes so slowly along
frequency that a spacecraft keeps it over a factor of three, as directions and the shape of light curves do.
A full covariance of all rows may stand in for ``sigma_s``, ``shape_sd_s`` and ``offset_sd_s``. ``rise_s`` is the half
width of the rise, which scales the delay of a receiver that the source does not point to.
"""

from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr

from bella.containers import check_hdf5
from bella.csv_tables import parse_table, read_table_text
from bella.exceptions import InputError, NoDataError
from bella.heliosphere.scattering import rise_s
from bella.spacecraft import observatory_name, position_hee
from bella.units import AU_RSUN, DAY_S, FloatArray

IntArray = npt.NDArray[np.intp]

REQUIRED = ("observatory", "frequency_mhz", "arrival_utc", "sigma_s", "edge")
POSITION = ("x_rsun", "y_rsun", "z_rsun")
NUISANCE = ("shape_sd_s", "offset_sd_s", "delay_s", "delay_sd_s")
RISE = "rise_s"
OPTIONAL = ("flag", *POSITION, *NUISANCE, RISE)
SHAPE_LENGTH = "shape_length_ln_f"
"""Name, in the header of a table, of the correlation length of ``shape_sd_s``."""

CALLED = "table_name"
"""Attribute of a frame: what it is called in error messages."""

SHAPE_LENGTH_LN_F = 0.5
"""The same where a table does not state it: that of the errors of edges of eight families of light curves."""

DELAY_LENGTH_LN_F = 1.0
"""Correlation length of ``delay_sd_s``: errors of edges whose light curves differ in width between spacecraft keep 0.5
to 0.9 of their correlation over 0.8 in ln f (46 simulated bursts)."""

SCALE_POWER = 0.75
"""Errors of edges grow with this power of the rise along a burst. In proportion to the rise (1) they are less likely
by 2 and 6 in ln L for 2012-06-07 and 2020-07-21, and by 1.7 for a simulated burst; at 0.5, which is likelier still,
half-maximum edges of 2012-06-07 would exclude no wind above 1500 km/s."""

MIN_OBSERVATORIES = 3
MAX_ROWS = 100_000
SPACE_AGE = (1957, 2200)
LONGEST_BURST_H = 6.0
FARTHEST_RECEIVER_RSUN = 100 * AU_RSUN
UNSYMMETRIC = 1e-6
"""Over its largest element, by which a covariance may differ from its transpose."""

ROUNDING = 1e-9
"""Eigenvalues this far below zero, over the largest, are zeros: times on one smooth curve have such."""

LONGEST_SHOWN = 80
"""Characters of a wrong value that an error message repeats."""


@dataclass(frozen=True)
class ArrivalGrid:
    """Arrival times of one burst on frequencies x observatories, in seconds after a stated time.

    Attributes
    ----------
    frequency_mhz : ndarray, shape (F,)
        Ascending.
    observatories : tuple of str, length n
    arrival_s, sigma_s : ndarray, shape (F, n)
        Arrival time after `reference_utc` and its standard deviation; NaN where an observatory has no row.
    receiver_rsun : ndarray, shape (F, n, 3)
        HEE position of the receiver at its arrival time, solar radii; NaN where there is no row.
    shape_sd_s : ndarray, shape (F, n)
        Standard deviation of the error that is smooth along frequency within a receiver.
    offset_sd_s : ndarray, shape (F, n)
        Standard deviation of the timing offset that a receiver has at all frequencies; one value per column.
    delay_s, delay_sd_s : ndarray, shape (F, n)
        Known delay beyond light travel, and the standard deviation of its error.
    rise_s : ndarray, shape (F, n)
        Half width of the rise; that of a typical burst where the table has none.
    shape_length_ln_f : float
        Correlation length, in ln f, of `shape_sd_s`; that of `delay_sd_s` is `DELAY_LENGTH_LN_F`.
    measured_s2 : ndarray, shape (F, n, F, n), or None
        Full covariance of the arrival times, in place of `sigma_s`, `shape_sd_s` and `offset_sd_s`.
    reference_utc : numpy.datetime64
        Also the epoch of the HEE axes.
    edge : str
    """

    frequency_mhz: FloatArray
    observatories: tuple[str, ...]
    arrival_s: FloatArray
    sigma_s: FloatArray
    receiver_rsun: FloatArray
    reference_utc: np.datetime64
    edge: str
    shape_sd_s: FloatArray = field(default_factory=partial(np.zeros, ()))
    offset_sd_s: FloatArray = field(default_factory=partial(np.zeros, ()))
    delay_s: FloatArray = field(default_factory=partial(np.zeros, ()))
    delay_sd_s: FloatArray = field(default_factory=partial(np.zeros, ()))
    rise_s: FloatArray = None  # type: ignore[assignment]  # filled in below
    shape_length_ln_f: float = SHAPE_LENGTH_LN_F
    measured_s2: FloatArray | None = None

    def __post_init__(self) -> None:
        if self.rise_s is None:
            object.__setattr__(self, RISE, rise_s(self.frequency_mhz)[:, None])
        for name in (*NUISANCE, RISE):
            object.__setattr__(self, name, np.broadcast_to(getattr(self, name), self.arrival_s.shape))

    def take(self, rows: npt.NDArray[np.bool_] | npt.NDArray[np.intp]) -> "ArrivalGrid":
        """Keep the named frequencies only."""
        per_frequency = ("frequency_mhz", "arrival_s", "sigma_s", "receiver_rsun", *NUISANCE, RISE)
        measured = None if self.measured_s2 is None else self.measured_s2[rows][:, :, rows]
        return replace(self, **{name: getattr(self, name)[rows] for name in per_frequency}, measured_s2=measured)

    def covariance_s2(self) -> FloatArray:
        """Covariance of all arrival times: the noise model, stated once.

        Returns
        -------
        ndarray, shape (N, N)
            s^2, of the N finite arrival times in the order of `arrival_s` with the frequency first.
        """
        row, column = np.nonzero(np.isfinite(self.arrival_s))
        same = column[:, None] == column
        apart = np.subtract.outer(*2 * [np.log(self.frequency_mhz[row])])
        smooth = np.exp(-0.5 * (apart / self.shape_length_ln_f) ** 2)
        delay = self.delay_sd_s[row, column]
        slow = np.exp(-0.5 * (apart / DELAY_LENGTH_LN_F) ** 2)
        delay_s2 = np.where(same, np.outer(delay, delay) * slow, 0.0)
        if self.measured_s2 is not None:
            return np.asarray(self.measured_s2[row[:, None], column[:, None], row, column] + delay_s2)
        shape, offset = self.shape_sd_s[row, column], self.offset_sd_s[row, column]
        shared = np.outer(shape, shape) * smooth + np.outer(offset, offset)
        return np.asarray(np.diag(self.sigma_s[row, column] ** 2) + np.where(same, shared, 0.0) + delay_s2)

    def covariances_s2(self) -> FloatArray:
        """Covariance of the arrival times of each frequency, between the receivers.

        Returns
        -------
        ndarray, shape (F, n, n)
            s^2; NaN in the rows and columns of receivers that have no arrival time.
        """
        number = len(self.observatories)
        if self.measured_s2 is None:
            variance = self.sigma_s**2 + self.shape_sd_s**2 + self.offset_sd_s**2 + self.delay_sd_s**2
            covariance = np.where(np.eye(number, dtype=bool), variance[:, None, :], 0.0)
        else:
            place = np.arange(self.frequency_mhz.size)
            covariance = self.measured_s2[place, :, place] + np.eye(number) * self.delay_sd_s[:, None, :] ** 2
        absent = ~np.isfinite(self.arrival_s)
        return np.where(absent[:, :, None] | absent[:, None, :], np.nan, covariance)


def error_scale_s(rise_s: FloatArray) -> FloatArray:
    """What errors of edges are shares of: less than the rise where it is long, and more where it is short.

    Parameters
    ----------
    rise_s : ndarray, shape (N,)
        Half widths of the rise of the channels of one burst, s.

    Returns
    -------
    ndarray, shape (N,)
        s; with the geometric mean of the rises.
    """
    middle_s = np.exp(np.log(rise_s).mean())
    return np.asarray(middle_s * (rise_s / middle_s) ** SCALE_POWER)


def evenly_spread(frequency_mhz: FloatArray, most: int) -> IntArray:
    """Places of frequencies that are spread evenly in logarithm.

    Parameters
    ----------
    frequency_mhz : ndarray, shape (F,)
    most : int

    Returns
    -------
    ndarray of int, shape (most,) or fewer
        Ascending; the lowest and the highest frequency among them.
    """
    log = np.log(frequency_mhz)
    wanted = np.linspace(log.min(), log.max(), most)
    return np.unique(np.abs(log[:, None] - wanted).argmin(axis=0))


def read_arrivals(path: Path, received_by: int = MIN_OBSERVATORIES) -> pd.DataFrame:
    """Read an arrival table from a CSV file, and check it as :func:`check_arrivals` does."""
    return parse_arrivals(read_table_text(path), source=str(path), received_by=received_by)


def parse_arrivals(text: str, *, source: str = "arrival table", received_by: int = MIN_OBSERVATORIES) -> pd.DataFrame:
    """Read an arrival table from the text of a CSV file, and check it as :func:`check_arrivals` does."""
    return check_arrivals(parse_table(text, source), source=source, received_by=received_by)


def check_arrivals(frame: pd.DataFrame, *, source: str = "", received_by: int = MIN_OBSERVATORIES) -> pd.DataFrame:
    """Check an arrival table and give its columns their types.

    Parameters
    ----------
    frame : pandas.DataFrame
        At least the columns `REQUIRED`; text or typed.
    source : str
        What the table is called in error messages, here and where it is used.
    received_by : int
        So many observatories there must be.

    Returns
    -------
    pandas.DataFrame
        Columns `REQUIRED` + `OPTIONAL`, rows in the order given; ``arrival_utc`` is datetime64[ns] in UTC; positions
        are NaN, the terms of the noise 0 and ``rise_s`` that of a typical burst where the table has none. `attrs`
        holds the correlation length as a number.

    Raises
    ------
    InputError
        Names the row (1 is the first row under the heading) and column that is wrong.
    """
    source = source or _called(frame)
    missing = [name for name in REQUIRED if name not in frame.columns]
    if missing:
        raise InputError(f"{source}: column {missing[0]} is missing; needed are {', '.join(REQUIRED)}")
    if not 0 < len(frame) <= MAX_ROWS:
        raise InputError(f"{source}: has {len(frame)} rows; give between 1 and {MAX_ROWS}")
    table = pd.DataFrame(
        {
            "observatory": _text(frame, "observatory", source),
            "frequency_mhz": _number(frame, "frequency_mhz", source, low=0.001, high=1000.0),
            "arrival_utc": _time(frame, source),
            "sigma_s": _number(frame, "sigma_s", source, low=0.0, high=DAY_S),
            "edge": _text(frame, "edge", source),
            "flag": _flag(frame),
            **_positions(frame, source),
            **{
                name: _optional(frame, name, source, 0.0, (-DAY_S if name == "delay_s" else 0.0, DAY_S))
                for name in NUISANCE
            },
        }
    )
    given = _optional(frame, RISE, source, 0.0, (0.0, DAY_S))
    table[RISE] = np.where(given > 0, given, rise_s(table["frequency_mhz"].to_numpy()))
    table.attrs = {SHAPE_LENGTH: _shape_length(frame, source), CALLED: source}
    table["observatory"] = _known_names(table, source)
    _check_rows_agree(table, source)
    names = sorted(set(table["observatory"]))
    if len(names) < received_by:
        raise InputError(
            f"{source}: column observatory: only {', '.join(names)}; timing needs {received_by} or more spacecraft"
        )
    return table


def arrivals_csv(frame: pd.DataFrame) -> str:
    """Text of the CSV form of an arrival table; columns of positions, delays and offsets that are empty are left out.

    Parameters
    ----------
    frame : pandas.DataFrame
        As :func:`check_arrivals` returns it.

    Returns
    -------
    str
    """
    stamps = np.datetime_as_string(frame["arrival_utc"].to_numpy("datetime64[ms]"))
    table = frame.assign(arrival_utc=[f"{stamp}Z" for stamp in stamps])
    unneeded = [name for name in POSITION if table[name].isna().all()]
    unneeded += [name for name in NUISANCE if not table[name].any()]
    if np.allclose(table[RISE], rise_s(table["frequency_mhz"].to_numpy())):
        unneeded.append(RISE)
    length = frame.attrs.get(SHAPE_LENGTH, SHAPE_LENGTH_LN_F)
    header = "" if "shape_sd_s" in unneeded else f"# {SHAPE_LENGTH}: {length:g}\n"
    return header + table.drop(columns=unneeded).to_csv(index=False, float_format="%.10g", lineterminator="\n")


def write_covariance(covariance_s2: FloatArray, path: Path) -> None:
    """Write the full covariance of an arrival table as netCDF.

    Parameters
    ----------
    covariance_s2 : ndarray, shape (N, N)
        s^2, of the rows of the table in their order.
    path : Path
    """
    described = {"units": "s2", "long_name": "covariance of the arrival times, rows in the order of the table"}
    xr.Dataset({"covariance_s2": (("row", "row_other"), covariance_s2, described)}).to_netcdf(path, engine="h5netcdf")


def read_covariance(path: Path, rows: int) -> FloatArray:
    """Read the full covariance of an arrival table.

    Parameters
    ----------
    path : Path
    rows : int
        Of the table.

    Returns
    -------
    ndarray, shape (rows, rows)
        s^2.

    Raises
    ------
    InputError
        If it cannot be read, has another shape, or is no covariance.
    """
    try:
        check_hdf5(path)
        with xr.open_dataset(path, engine="h5netcdf") as stored:
            covariance = stored["covariance_s2"].to_numpy().astype(np.float64)
    except (OSError, KeyError, ValueError, TypeError, RuntimeError) as error:
        raise InputError(f"{path}: no covariance_s2 can be read ({error}); give what bella arrivals wrote") from error
    check_covariance(covariance, rows, source=str(path))
    return covariance


def check_covariance(covariance_s2: FloatArray, rows: int, *, source: str = "covariance") -> None:
    """Refuse a matrix that is not the covariance of the rows of a table.

    Parameters
    ----------
    covariance_s2 : ndarray
    rows : int
        Of the table.
    source : str
        What the matrix is called in error messages.

    Raises
    ------
    InputError
        If it has another shape, or is no covariance.
    """
    if covariance_s2.shape != (rows, rows):
        raise InputError(
            f"{source}: covariance_s2 is {covariance_s2.shape}, the table has {rows} rows; give those of one run"
        )
    apart = np.abs(covariance_s2 - covariance_s2.T).max()  # small elements are differences of large ones
    if not apart <= UNSYMMETRIC * np.abs(covariance_s2).max():
        raise InputError(f"{source}: covariance_s2 is not symmetric and finite; give what bella arrivals wrote")
    value = np.linalg.eigvalsh(covariance_s2)
    if value[0] < -ROUNDING * value[-1] or value[-1] <= 0:
        raise InputError(f"{source}: covariance_s2 is not that of errors; no eigenvalue may be below 0")


def locate_receivers(frame: pd.DataFrame) -> pd.DataFrame:
    """Fill in where each receiver was, from the ephemeris, in the rows that do not say it themselves.

    Parameters
    ----------
    frame : pandas.DataFrame
        As :func:`check_arrivals` returns it.

    Returns
    -------
    pandas.DataFrame
        The same rows with finite ``x_rsun, y_rsun, z_rsun``: HEE of the epoch :func:`reference_utc`.

    Raises
    ------
    InputError
        If the ephemeris does not know an observatory.
    NoDataError
        If its time is outside the ephemeris.
    """
    epoch = reference_utc(frame)
    located = frame.copy()
    for observatory, rows in frame.groupby("observatory", sort=False):
        unplaced = rows.index[rows["x_rsun"].isna()]
        if len(unplaced) == 0:
            continue
        try:
            where = position_hee(str(observatory), frame.loc[unplaced, "arrival_utc"].to_numpy("datetime64[ns]"), epoch)
        except InputError as error:
            row = int(frame.index.get_indexer(unplaced[:1])[0])
            raise InputError(
                f"{_called(frame)}: row {row + 1}, column observatory: {observatory!r} is not in the ephemeris; "
                "add the columns x_rsun, y_rsun, z_rsun (HEE)"
            ) from error
        except NoDataError as error:
            raise NoDataError(f"{_called(frame)}: {error}") from error
        located.loc[unplaced, list(POSITION)] = where
    return located


def reference_utc(frame: pd.DataFrame) -> np.datetime64:
    """Time that the seconds of a burst count from: its earliest arrival, down to the full second."""
    earliest: np.datetime64 = frame["arrival_utc"].to_numpy("datetime64[s]").min()
    return np.datetime64(str(earliest), "ns")


def arrival_grid(
    frame: pd.DataFrame,
    *,
    received_by: int = MIN_OBSERVATORIES,
    covariance_s2: FloatArray | None = None,
) -> ArrivalGrid:
    """Arrange a located arrival table on frequencies x observatories.

    Parameters
    ----------
    frame : pandas.DataFrame
        As :func:`locate_receivers` returns it.
    received_by : int
        Frequencies of fewer observatories are left out.
    covariance_s2 : ndarray, shape (N, N), optional
        Full covariance of the rows of the table.

    Returns
    -------
    ArrivalGrid

    Raises
    ------
    InputError
        If no frequency is left.
    """
    names = tuple(dict.fromkeys(frame["observatory"]))
    frequencies, row = np.unique(frame["frequency_mhz"].to_numpy(), return_inverse=True)
    column = frame["observatory"].map({name: i for i, name in enumerate(names)}).to_numpy()
    epoch = reference_utc(frame)
    grid = ArrivalGrid(
        frequencies,
        names,
        _spread((frame["arrival_utc"].to_numpy("datetime64[ns]") - epoch) / np.timedelta64(1, "s"), row, column, names),
        _spread(frame["sigma_s"].to_numpy(), row, column, names),
        _spread(frame[list(POSITION)].to_numpy(), row, column, names),
        epoch,
        str(frame["edge"].iloc[0]),
        **{name: np.nan_to_num(_spread(frame[name].to_numpy(), row, column, names)) for name in NUISANCE},
        rise_s=_spread(frame[RISE].to_numpy(), row, column, names),
        shape_length_ln_f=frame.attrs.get(SHAPE_LENGTH, SHAPE_LENGTH_LN_F),
        measured_s2=None if covariance_s2 is None else _spread_pairs(covariance_s2, row, column, names),
    )
    enough = np.isfinite(grid.arrival_s).sum(axis=1) >= received_by
    if not enough.any():
        raise InputError(
            f"{_called(frame)}: no frequency has arrival times of {received_by} observatories; "
            "put the arrival times of all spacecraft on common frequencies"
        )
    return grid.take(enough)


def _called(frame: pd.DataFrame) -> str:
    """What a table is called in error messages."""
    return str(frame.attrs.get(CALLED, "arrival table"))


def _spread(values: FloatArray, row: IntArray, column: IntArray, names: tuple[str, ...]) -> FloatArray:
    grid = np.full((row.max() + 1, len(names), *values.shape[1:]), np.nan)
    grid[row, column] = values
    return grid


def _spread_pairs(values: FloatArray, row: IntArray, column: IntArray, names: tuple[str, ...]) -> FloatArray:
    frequencies, number = row.max() + 1, len(names)
    place = row * number + column
    pairs = np.full((frequencies * number, frequencies * number), np.nan)
    pairs[np.ix_(place, place)] = values
    return pairs.reshape(frequencies, number, frequencies, number)


def _shape_length(frame: pd.DataFrame, source: str) -> float:
    stated = frame.attrs.get(SHAPE_LENGTH, SHAPE_LENGTH_LN_F)
    length = pd.to_numeric(stated, errors="coerce")
    if not 0 < length <= 10:
        raise InputError(
            f"{source}: {SHAPE_LENGTH} {stated!r} is not above 0 and at most 10; write {SHAPE_LENGTH_LN_F}"
        )
    return float(length)


def _reject(bad: npt.NDArray[np.bool_], frame: pd.DataFrame, column: str, source: str, reason: str) -> None:
    if bad.any():
        row = int(np.argmax(bad))
        value = repr(str(frame[column].iloc[row]))
        shown = value if len(value) <= LONGEST_SHOWN else f"{value[:LONGEST_SHOWN]}..."
        raise InputError(f"{source}: row {row + 1}, column {column}: {shown} {reason}")


def _text(frame: pd.DataFrame, column: str, source: str) -> npt.NDArray[np.object_]:
    values = frame[column].astype(object).where(frame[column].notna(), "").astype(str).str.strip()
    _reject((values == "").to_numpy(), frame, column, source, "is empty; every row needs one")
    odd = ~np.array([value.isprintable() and not value.startswith("#") for value in values], dtype=bool)
    _reject(odd, frame, column, source, "is not a name; use printable characters, the first not #")
    return values.to_numpy(dtype=object)


def _flag(frame: pd.DataFrame) -> npt.NDArray[np.object_] | str:
    if "flag" not in frame:
        return ""
    return frame["flag"].astype(object).where(frame["flag"].notna(), "").astype(str).to_numpy(dtype=object)


def _number(frame: pd.DataFrame, column: str, source: str, *, low: float, high: float) -> FloatArray:
    values = pd.to_numeric(frame[column], errors="coerce").to_numpy(dtype=np.float64)
    _reject(~np.isfinite(values), frame, column, source, "is not a number")
    _reject(~((values > low) & (values <= high)), frame, column, source, f"is not above {low:g} and at most {high:g}")
    return values


def _time(frame: pd.DataFrame, source: str) -> npt.NDArray[np.datetime64]:
    times = pd.to_datetime(frame["arrival_utc"], errors="coerce", utc=True, format="ISO8601")
    relative = frame["arrival_utc"].astype(str).str.strip().str.lower().isin(["now", "today"]).to_numpy()
    wrong = relative | ~times.dt.year.between(*SPACE_AGE).to_numpy()
    _reject(wrong, frame, "arrival_utc", source, "is not a time; write UTC as 2012-06-07T19:30:00.000Z")
    utc = times.dt.tz_localize(None).to_numpy().astype("datetime64[ns]")
    middle = np.sort(utc)[len(utc) // 2]
    away_h = (utc - middle) / np.timedelta64(1, "h")
    reason = f"is more than {LONGEST_BURST_H:g} h from the middle of the table ({middle.astype('datetime64[s]')}Z)"
    _reject(np.abs(away_h) > LONGEST_BURST_H, frame, "arrival_utc", source, f"{reason}; one table holds one burst")
    return utc


def _positions(frame: pd.DataFrame, source: str) -> dict[str, FloatArray]:
    given = [name for name in POSITION if name in frame.columns]
    if given and len(given) < len(POSITION):
        lacking = next(name for name in POSITION if name not in given)
        raise InputError(f"{source}: column {lacking} is missing; give all of {', '.join(POSITION)} or none")
    limits = (-FARTHEST_RECEIVER_RSUN, FARTHEST_RECEIVER_RSUN)
    values = {name: _optional(frame, name, source, np.nan, limits) for name in POSITION}
    empty = np.isnan(list(values.values()))
    for name, lacks in zip(given, empty, strict=False):
        _reject(lacks & ~empty.all(axis=0), frame, name, source, "is empty; give all three or none")
    return values


def _optional(frame: pd.DataFrame, name: str, source: str, absent: float, limits: tuple[float, float]) -> FloatArray:
    """Values of a column that may be absent or have empty fields, which stand for `absent`."""
    if name not in frame:
        return np.full(len(frame), absent)
    empty = (frame[name].isna() | (frame[name].astype(str).str.strip() == "")).to_numpy()
    values = np.where(empty, absent, pd.to_numeric(frame[name], errors="coerce").to_numpy(dtype=np.float64))
    low, high = limits
    wrong = ~empty & ~((values >= low) & (values <= high))
    _reject(wrong, frame, name, source, f"is not a number between {low:g} and {high:g}")
    return values


def _check_rows_agree(table: pd.DataFrame, source: str) -> None:
    twice = table.duplicated(["observatory", "frequency_mhz"]).to_numpy()
    _reject(twice, table, "frequency_mhz", source, "occurs twice for this observatory; keep one row per channel")
    first = table["edge"].iloc[0]
    mixed = (table["edge"] != first).to_numpy()
    _reject(
        mixed, table, "edge", source, f"differs from {first!r} in row 1; one table holds one definition of the edge"
    )
    shared = table.groupby("observatory")["offset_sd_s"].transform("first")
    unequal = (table["offset_sd_s"] != shared).to_numpy()
    _reject(unequal, table, "offset_sd_s", source, "differs between rows of one observatory; all its channels share it")


def _known_names(table: pd.DataFrame, source: str) -> pd.Series:
    """Names as they are used here; one that looks mistyped is refused, unless its row says where it was."""
    named: dict[str, str] = {}
    for row, (name, x) in enumerate(zip(table["observatory"], table[POSITION[0]], strict=True), start=1):
        try:
            named[name] = observatory_name(name) if _is_plain(name) else name
        except InputError as error:
            if np.isnan(x):
                raise InputError(f"{source}: row {row}, column observatory: {error}") from error
            named[name] = name
    return table["observatory"].map(named)


def _is_plain(name: str) -> bool:
    """Whether it can be an alias: "+wind" and names with control characters are none of Wind."""
    return name[:1].isalnum() and name.isprintable()
