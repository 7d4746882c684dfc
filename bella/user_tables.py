"""Arrival tables as users have them: pandas, astropy, or a dict of columns, with units or without.

A column may carry its unit in its name (``frequency_mhz``, ``sigma_s``, ``x_rsun``), or be a Quantity of any unit of
its kind under the name with or without that ending (``frequency``, ``sigma``, ``x``). Times are UTC, or a `Time` of any
scale.
"""

from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
import pandas as pd
from astropy import units as u
from astropy.table import Table
from astropy.time import Time

from bella.arrivals import NUISANCE, POSITION, REQUIRED, RISE
from bella.exceptions import InputError

CANONICAL = {
    "frequency_mhz": u.MHz,
    "sigma_s": u.s,
    **dict.fromkeys(POSITION, u.R_sun),
    **dict.fromkeys((*NUISANCE, RISE), u.s),
}
"""Columns with a unit, and the unit that their name carries."""

SHORT = {name.removesuffix("_mhz").removesuffix("_rsun").removesuffix("_s"): name for name in CANONICAL}
TIME, TIME_NAMES = "arrival_utc", ("arrival", "arrival_time", "time")
EDGE_NOT_STATED = "not stated"
"""Definition of the edge of a table that does not name it."""

UserTable: TypeAlias = pd.DataFrame | Table | Mapping[str, Any]


def arrival_frame(table: UserTable) -> pd.DataFrame:
    """Arrival table of a user with the columns, units and types that :func:`bella.arrivals.check_arrivals` takes.

    Parameters
    ----------
    table : pandas.DataFrame, astropy Table or QTable, or mapping of columns
        Columns `observatory`, a frequency, an arrival time and an error at least; `edge` may be left out.

    Returns
    -------
    pandas.DataFrame

    Raises
    ------
    InputError
        Names the column, and the row where it is one: a unit that is missing or of another kind, a value that is
        masked or NaN, a column that is missing or given twice.
    """
    columns = _columns(table)
    found: dict[str, Any] = {}
    for given, values in columns.items():
        name = TIME if given in TIME_NAMES else SHORT.get(given, given)
        if name in found:
            raise InputError(f"column {given}: {name} is given twice; keep one of them")
        found[name] = _bare(given, name, values)
        if found[name].ndim > 1:
            raise InputError(f"column {given}: has {found[name].ndim} dimensions; give one value for each row")
    missing = [name for name in REQUIRED if name not in found and name != "edge"]
    if missing:
        raise InputError(f"column {missing[0]} is missing; needed are observatory, frequency, arrival time and sigma")
    rows = len(np.atleast_1d(found["observatory"]))
    unlike = next((name for name, values in found.items() if values.ndim and len(values) != rows), None)
    if unlike:
        raise InputError(f"column {unlike}: has {len(found[unlike])} rows, and observatory {rows}; give as many")
    frame = pd.DataFrame(found, index=range(rows))
    if "edge" not in frame:
        frame["edge"] = EDGE_NOT_STATED
    frame.attrs = dict(getattr(table, "attrs", None) or getattr(table, "meta", None) or {})
    return frame


def _columns(table: UserTable) -> dict[str, Any]:
    if isinstance(table, pd.DataFrame):
        twice = table.columns[table.columns.duplicated()]
        if len(twice):
            raise InputError(f"column {twice[0]}: is given twice; keep one of them")
        return {str(name): table[name].to_numpy() for name in table.columns}
    if isinstance(table, Table):
        return {name: table[name] for name in table.colnames}
    if isinstance(table, Mapping):
        return {str(name): values for name, values in table.items()}
    raise InputError(
        f"{type(table).__name__} is no table; give a pandas DataFrame, an astropy Table or a dict of columns"
    )


def _bare(given: str, name: str, values: Any) -> npt.NDArray[Any]:
    """Values of one column as numpy, in the unit of the canonical name."""
    required = name in REQUIRED
    _refuse_masked(given, values, required=required)
    if isinstance(values, Time):
        return _utc(given, values)
    if name not in CANONICAL:
        return np.asarray(_filled(values, ""))
    unit = _unit(given, values)
    if unit is None:
        if given != name:
            kinds = f"{name}, or give a Quantity such as {given} * u.{CANONICAL[name]}"
            raise InputError(f"column {given}: has no unit; name it {kinds}")
        numbers = _filled(values, np.nan)
    else:
        numbers = _converted(given, values, unit, CANONICAL[name])
    if required:
        _refuse_nan(given, numbers)
    return np.asarray(numbers)


def _unit(given: str, values: Any) -> Any:
    """Unit of a column; of a column of objects that of its quantities, None where there is none."""
    if getattr(values, "unit", None) is not None:
        return values.unit
    if isinstance(values, np.ndarray | list | tuple) and len(values) and isinstance(values[0], u.Quantity):
        bare = [i for i, one in enumerate(values) if not isinstance(one, u.Quantity)]
        if bare:
            raise InputError(f"column {given}: row {bare[0] + 1} has no unit, as others have; give one to every row")
        return values[0].unit
    return None


def _converted(given: str, values: Any, unit: Any, wanted: Any) -> npt.NDArray[Any]:
    try:
        if getattr(values, "unit", None) is None:
            return np.array([one.to_value(wanted) for one in values])
        plain = _filled(values, np.nan)
        return np.asarray(u.Quantity(np.asarray(getattr(plain, "value", plain), dtype=float), unit).to_value(wanted))
    except u.UnitConversionError as error:
        raise InputError(f"column {given}: its unit is {unit}, and should be one of {wanted.physical_type}") from error


def _refuse_masked(given: str, values: Any, *, required: bool) -> None:
    mask = getattr(values, "mask", None)
    if mask is None or not required:
        return
    hidden = np.flatnonzero(np.broadcast_to(mask, np.shape(values)))
    if hidden.size:
        raise InputError(
            f"column {given}: row {hidden[0] + 1} is masked; give a value in every row, or leave the row out"
        )


def _refuse_nan(given: str, numbers: npt.NDArray[Any]) -> None:
    if np.asarray(numbers).dtype.kind != "f":
        return
    unknown = np.flatnonzero(np.isnan(numbers))
    if unknown.size:
        raise InputError(
            f"column {given}: row {unknown[0] + 1} is NaN; give a number in every row, or leave the row out"
        )


def _utc(given: str, moments: Time) -> npt.NDArray[np.datetime64]:
    stamps = np.asarray(moments.utc.to_value("datetime64"), dtype="datetime64[ns]")
    if np.isnat(stamps).any():
        raise InputError(
            f"column {given}: row {np.flatnonzero(np.isnat(stamps))[0] + 1} is no time; give one in every row"
        )
    return stamps


def _filled(values: Any, empty: Any) -> Any:
    return values.filled(empty) if np.any(getattr(values, "mask", False)) and hasattr(values, "filled") else values
