"""The arrival table: what bursts hands over, and what multilateration and tracks take.

One table holds one burst with one definition of the edge: one row per spacecraft and channel, with the time at which
the edge arrived and its timing error. As a file it is a CSV with the columns ``observatory, frequency_mhz,
arrival_utc, sigma_s, edge, flag`` and, for observatories the ephemeris does not know, ``x_rsun, y_rsun, z_rsun``
(HEE). Lines that begin with ``#`` are comments.

Three more columns say what is known of errors that ``sigma_s`` does not hold: ``delay_s`` and ``delay_sd_s``, by how
much the edge was late beyond light travel (scattering) and how well that is known, row by row; and ``offset_sd_s``, the
size of the timing offset that all channels of an observatory share (sample grid, clock).
"""

from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd

from bella.csv_tables import parse_table, read_table_text
from bella.exceptions import InputError
from bella.spacecraft import position_hee
from bella.units import AU_RSUN, DAY_S, FloatArray

IntArray = npt.NDArray[np.intp]

REQUIRED = ("observatory", "frequency_mhz", "arrival_utc", "sigma_s", "edge")
POSITION = ("x_rsun", "y_rsun", "z_rsun")
NUISANCE = ("delay_s", "delay_sd_s", "offset_sd_s")
OPTIONAL = ("flag", *POSITION, *NUISANCE)
MIN_OBSERVATORIES = 3
MAX_ROWS = 100_000
SPACE_AGE = (1957, 2200)
LONGEST_BURST_H = 6.0
FARTHEST_RECEIVER_RSUN = 100 * AU_RSUN
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
    delay_s, delay_sd_s : ndarray, shape (F, n)
        Delay beyond light travel, and its standard deviation.
    offset_sd_s : ndarray, shape (F, n)
        Standard deviation of the timing offset that a receiver has at all frequencies; one value per column.
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
    delay_s: FloatArray = field(default_factory=partial(np.zeros, ()))
    delay_sd_s: FloatArray = field(default_factory=partial(np.zeros, ()))
    offset_sd_s: FloatArray = field(default_factory=partial(np.zeros, ()))

    def __post_init__(self) -> None:
        for name in NUISANCE:
            object.__setattr__(self, name, np.broadcast_to(getattr(self, name), self.arrival_s.shape))

    def take(self, rows: npt.NDArray[np.bool_] | npt.NDArray[np.intp]) -> "ArrivalGrid":
        """Keep the named frequencies only."""
        per_frequency = ("frequency_mhz", "arrival_s", "sigma_s", "receiver_rsun", *NUISANCE)
        return replace(self, **{name: getattr(self, name)[rows] for name in per_frequency})


def read_arrivals(path: Path) -> pd.DataFrame:
    """Read and check an arrival table from a CSV file.

    Parameters
    ----------
    path : Path

    Returns
    -------
    pandas.DataFrame
        As :func:`check_arrivals` returns it.

    Raises
    ------
    InputError
        If the file cannot be read, or names the row and column that is wrong.
    """
    return parse_arrivals(read_table_text(path), source=str(path))


def parse_arrivals(text: str, *, source: str = "arrival table") -> pd.DataFrame:
    """Parse and check an arrival table from the text of a CSV file.

    Parameters
    ----------
    text : str
    source : str
        What the table is called in error messages.

    Returns
    -------
    pandas.DataFrame
        As :func:`check_arrivals` returns it.

    Raises
    ------
    InputError
        Names the row and column that is wrong.
    """
    return check_arrivals(parse_table(text, source), source=source)


def check_arrivals(frame: pd.DataFrame, *, source: str = "arrival table") -> pd.DataFrame:
    """Check an arrival table and give its columns their types.

    Parameters
    ----------
    frame : pandas.DataFrame
        At least the columns `REQUIRED`; text or typed.
    source : str
        What the table is called in error messages.

    Returns
    -------
    pandas.DataFrame
        Columns `REQUIRED` + `OPTIONAL`, rows in the order given; ``arrival_utc`` is datetime64[ns] in UTC, positions
        are NaN and delays and offsets 0 where the table has none.

    Raises
    ------
    InputError
        Names the row (1 is the first row under the heading) and column that is wrong.
    """
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
            **{name: _nuisance(frame, name, source) for name in NUISANCE},
        }
    )
    _check_rows_agree(table, source)
    return table


def write_arrivals(frame: pd.DataFrame, path: Path) -> None:
    """Write an arrival table as CSV; times with milliseconds and Z.

    Parameters
    ----------
    frame : pandas.DataFrame
        As :func:`check_arrivals` returns it.
    path : Path
    """
    path.write_text(arrivals_csv(frame), encoding="utf-8")


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
    unplaced = [name for name in POSITION if table[name].isna().all()]
    unneeded = [name for name in NUISANCE if not table[name].any()]
    return table.drop(columns=unplaced + unneeded).to_csv(index=False, float_format="%.10g", lineterminator="\n")


def locate_receivers(frame: pd.DataFrame, *, source: str = "arrival table") -> pd.DataFrame:
    """Fill in where each receiver was, from the ephemeris, in the rows that do not say it themselves.

    Parameters
    ----------
    frame : pandas.DataFrame
        As :func:`check_arrivals` returns it.
    source : str
        What the table is called in error messages.

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
                f"{source}: row {row + 1}, column observatory: {observatory!r} is not in the ephemeris; "
                "add the columns x_rsun, y_rsun, z_rsun (HEE)"
            ) from error
        located.loc[unplaced, list(POSITION)] = where
    return located


def reference_utc(frame: pd.DataFrame) -> np.datetime64:
    """Time that the seconds of a burst count from: its earliest arrival, down to the full second."""
    earliest: np.datetime64 = frame["arrival_utc"].to_numpy("datetime64[s]").min()
    return np.datetime64(str(earliest), "ns")


def arrival_grid(
    frame: pd.DataFrame, *, source: str = "arrival table", heard_by: int = MIN_OBSERVATORIES
) -> ArrivalGrid:
    """Arrange a located arrival table on frequencies x observatories.

    Parameters
    ----------
    frame : pandas.DataFrame
        As :func:`locate_receivers` returns it.
    source : str
        What the table is called in error messages.
    heard_by : int
        Frequencies of fewer observatories are left out.

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
    )
    enough = np.isfinite(grid.arrival_s).sum(axis=1) >= heard_by
    if not enough.any():
        raise InputError(
            f"{source}: no frequency has arrival times of {heard_by} observatories; "
            "put the arrival times of all spacecraft on common frequencies"
        )
    return grid.take(enough)


def _spread(values: FloatArray, row: IntArray, column: IntArray, names: tuple[str, ...]) -> FloatArray:
    grid = np.full((row.max() + 1, len(names), *values.shape[1:]), np.nan)
    grid[row, column] = values
    return grid


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
    if not given:
        return {name: np.full(len(frame), np.nan) for name in POSITION}
    if len(given) < len(POSITION):
        lacking = next(name for name in POSITION if name not in given)
        raise InputError(f"{source}: column {lacking} is missing; give all of {', '.join(POSITION)} or none")
    empty = frame[list(POSITION)].apply(lambda column: column.isna() | (column.astype(str).str.strip() == ""))
    for name in POSITION:
        _reject((empty[name] & ~empty.all(axis=1)).to_numpy(), frame, name, source, "is empty; give all three or none")
    return {name: _coordinate(frame, name, source, empty[name].to_numpy()) for name in POSITION}


def _coordinate(frame: pd.DataFrame, name: str, source: str, empty: npt.NDArray[np.bool_]) -> FloatArray:
    values = pd.to_numeric(frame[name], errors="coerce").to_numpy(dtype=np.float64)
    _reject(~empty & ~np.isfinite(values), frame, name, source, "is not a number")
    far = ~empty & ~(np.abs(values) <= FARTHEST_RECEIVER_RSUN)
    _reject(far, frame, name, source, "is farther than 100 au; positions are in solar radii")
    return values


def _nuisance(frame: pd.DataFrame, name: str, source: str) -> FloatArray:
    """Values of a column that may be absent or have empty fields, which stand for 0."""
    if name not in frame:
        return np.zeros(len(frame))
    empty = (frame[name].isna() | (frame[name].astype(str).str.strip() == "")).to_numpy()
    values = np.where(empty, 0.0, pd.to_numeric(frame[name], errors="coerce").to_numpy(dtype=np.float64))
    low = -DAY_S if name == "delay_s" else 0.0
    wrong = ~((values >= low) & (values <= DAY_S))
    _reject(wrong, frame, name, source, f"is not a number between {low:g} and {DAY_S:g}")
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
    heard_by = sorted(set(table["observatory"]))
    if len(heard_by) < MIN_OBSERVATORIES:
        raise InputError(
            f"{source}: column observatory: only {', '.join(heard_by)}; "
            f"timing needs {MIN_OBSERVATORIES} or more spacecraft"
        )
