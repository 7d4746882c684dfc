"""Rows of a table, each a dataclass, as CSV and back."""

import csv
import io
from collections.abc import Callable, Sequence
from dataclasses import asdict, fields
from typing import TYPE_CHECKING, Any, TypeVar

from bella.exceptions import InputError

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

    Row = TypeVar("Row", bound=DataclassInstance)

_READ: dict[Any, Callable[[str], Any]] = {
    str: str,
    int: int,
    float: float,
    float | None: lambda text: float(text) if text else None,
    bool: {"True": True, "False": False}.__getitem__,
}


def rows_csv(rows: "Sequence[Row]", kind: "type[Row]") -> str:
    """Rows as CSV, numbers written so that they are read back as they were; None is an empty cell.

    Parameters
    ----------
    kind : type
        The dataclass; its fields are the columns.
    """
    text = io.StringIO()
    lines = csv.DictWriter(text, [field.name for field in fields(kind)], lineterminator="\n")
    lines.writeheader()
    lines.writerows(asdict(one) for one in rows)
    return text.getvalue()


def parse_rows(text: str, kind: "type[Row]") -> "list[Row]":
    """Rows of a table that :func:`rows_csv` wrote.

    Raises
    ------
    InputError
        If it is not such a table.
    """
    lines = csv.DictReader(io.StringIO(text))
    if lines.fieldnames != [field.name for field in fields(kind)]:
        raise InputError("not a calibration table: its columns are others; make one with bella calibrate")
    try:
        return [kind(**{field.name: _READ[field.type](row[field.name]) for field in fields(kind)}) for row in lines]
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"not a calibration table ({error}); make one with bella calibrate") from error
