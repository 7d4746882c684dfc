"""Lists page by page: their order, and cursors that say where a page ended.

A cursor holds the values of the last row shown, and a mark of the question, so that it goes on where that row was
whatever came meanwhile, and is refused by any other question.
"""

import base64
import binascii
import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import date, datetime
from typing import Any, Protocol

from sqlalchemy import ColumnElement, Connection, RowMapping, Select, and_, false, func, or_

from bella.catalogue.models import as_utc
from bella.exceptions import InputError

MAX_LIMIT = 1000
LARGEST_INTEGER = 2**63 - 1


@dataclass(frozen=True)
class Key:
    """One column of an order.

    Attributes
    ----------
    name : str
        Of the column in a row.
    kind : type
        datetime, date, float, int or str.
    nullable : bool
        Rows without a value come last, whichever way the order goes.
    """

    name: str
    column: ColumnElement[Any]
    kind: type
    descending: bool = False
    nullable: bool = False

    def order(self) -> list[ColumnElement[Any]]:
        """What to order by."""
        own = self.column.desc() if self.descending else self.column.asc()
        return [self.column.is_(None), own] if self.nullable else [own]

    def beyond(self, value: Any) -> ColumnElement[bool]:
        """Condition that a row is after this value."""
        if value is None:
            return false()
        later = self.column < value if self.descending else self.column > value
        return or_(later, self.column.is_(None)) if self.nullable else later

    def at(self, value: Any) -> ColumnElement[bool]:
        """Condition that a row has this value."""
        return self.column.is_(None) if value is None else self.column == value


Order = Sequence[Key]
"""Columns of an order; the last ones tell all rows apart."""


def ordered_by(order: Order) -> list[ColumnElement[Any]]:
    """What a statement is to be ordered by."""
    return [one for key in order for one in key.order()]


def after(order: Order, values: Sequence[Any]) -> ColumnElement[bool]:
    """Condition that a row comes after the one with these values."""
    condition: ColumnElement[bool] = false()
    for key, value in reversed(list(zip(order, values, strict=True))):
        condition = or_(key.beyond(value), and_(key.at(value), condition))
    first, value = order[0], values[0]
    if first.nullable:
        return condition
    # implied by the rest, but it lets SQLite seek in the index
    return and_(first.column <= value if first.descending else first.column >= value, condition)


class Question(Protocol):
    """What every list is asked with."""

    @property
    def cursor(self) -> str | None:
        """Of the page before."""

    @property
    def limit(self) -> int:
        """Most rows of a page."""


@dataclass(frozen=True)
class Page:
    """Rows of a page, the cursor of the next one (None on the last), and the number of rows on all pages."""

    rows: Sequence[RowMapping]
    next_cursor: str | None
    total: int


def check_limit(limit: int, most: int = MAX_LIMIT) -> None:
    """Refuse a page that is empty or too large.

    Raises
    ------
    InputError
    """
    if not 1 <= limit <= most:
        raise InputError(f"limit is {limit}: give 1 to {most}")


def read_page(
    connection: Connection,
    question: Question,
    found: Select[Any],
    order: Order,
    counted: Select[tuple[int]] | None = None,
) -> Page:
    """Page of the rows that a statement finds.

    Parameters
    ----------
    connection : sqlalchemy.Connection
        In a transaction that sees one state.
    question : dataclass
        Its fields but `limit` and `cursor` make the mark of the cursor.
    found : sqlalchemy.Select
        With the columns of the order, by the names of its keys.
    counted : sqlalchemy.Select, optional
        How many rows there are on all pages, where that can be found with less work.

    Raises
    ------
    InputError
        Where the cursor is not one of ours, or of another question.
    """
    mark = mark_of(question)
    beyond = [] if question.cursor is None else [after(order, parse_cursor(order, question.cursor, mark))]
    page = found.where(*beyond).order_by(*ordered_by(order)).limit(question.limit + 1)
    rows = connection.execute(page).mappings().all()
    shown = rows[: question.limit]
    following = cursor_after(order, dict(shown[-1]), mark) if len(rows) > question.limit else None
    if question.cursor is None and following is None:
        return Page(shown, None, len(shown))
    counted = found.with_only_columns(func.count(), maintain_column_froms=True) if counted is None else counted
    return Page(shown, following, connection.execute(counted).scalar_one())


def mark_of(question: Any, *more: object) -> str:
    """Short text that tells one question from another, whatever page of it is asked for.

    Parameters
    ----------
    question : dataclass or None
        Its fields `cursor` and `limit` do not count.
    *more : object
        What else makes the question.
    """
    fields = {} if question is None else asdict(question)
    said = {name: value for name, value in fields.items() if name not in {"cursor", "limit"}}
    content = json.dumps([said, *more], default=_plain, sort_keys=True)
    return hashlib.sha256(content.encode()).hexdigest()[:12]


def cursor_after(order: Order, row: Mapping[str, Any], mark: str) -> str:
    """Opaque cursor of the page that begins after a row.

    Parameters
    ----------
    row : mapping
        The last one shown.
    mark : str
        Of the question.

    Returns
    -------
    str
        URL-safe text.
    """
    content = json.dumps([mark, *(_written(row[key.name]) for key in order)])
    return base64.urlsafe_b64encode(content.encode()).decode().rstrip("=")


def parse_cursor(order: Order, cursor: str, mark: str) -> list[Any]:
    """Values that `cursor_after` was given.

    Raises
    ------
    InputError
        Where the cursor is not one of ours, or was given with another question.
    """
    try:
        padded = cursor.encode("ascii") + b"=" * (-len(cursor) % 4)
        known, *values = json.loads(base64.b64decode(padded, altchars=b"-_", validate=True))
        found = [_read(key, value) for key, value in zip(order, values, strict=True)] if known == mark else None
    except (binascii.Error, ValueError, TypeError, OverflowError, RecursionError) as error:
        raise InputError("cursor: is not one of ours; take that of the page before, or none for the first") from error
    if found is None:
        raise InputError("cursor: was given with other filters or another sort; leave it out to begin anew")
    return found


def _written(value: Any) -> Any:
    if isinstance(value, datetime):
        return as_utc(value).isoformat()
    return value.isoformat() if isinstance(value, date) else value


def _read(key: Key, value: Any) -> Any:
    if value is None and key.nullable:
        return None
    if key.kind is datetime:
        return as_utc(datetime.fromisoformat(value))
    if key.kind is date:
        return date.fromisoformat(value)
    if key.kind is str:
        return str(value).encode().decode().replace("\0", "")
    number = key.kind(value)
    if not math.isfinite(number) or (key.kind is int and abs(number) > LARGEST_INTEGER):
        raise ValueError(f"{number} is out of range")
    return number


def _plain(value: Any) -> Any:
    return sorted(map(str, value)) if isinstance(value, frozenset | set | tuple) else str(value)
