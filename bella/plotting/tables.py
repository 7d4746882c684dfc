"""What a table must have before it is drawn."""

from collections.abc import Iterable

import pandas as pd

from bella.exceptions import InputError


def require_columns(table: pd.DataFrame, columns: Iterable[str], name: str) -> pd.DataFrame:
    """Refuse a table that lacks a column.

    Parameters
    ----------
    table : pandas.DataFrame
    columns : iterable of str
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
