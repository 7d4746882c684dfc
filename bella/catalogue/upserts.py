"""Inserts that yield to a row that is there already, in the words both databases understand."""

from typing import Any

from sqlalchemy import Connection, Table, literal_column
from sqlalchemy.dialects import postgresql, sqlite


def dialect_insert(connection: Connection, table: Table) -> sqlite.Insert | postgresql.Insert:
    """Insert statement with ON CONFLICT of the connection's dialect.

    Parameters
    ----------
    connection : sqlalchemy.Connection
        To a SQLite or PostgreSQL database.
    table : sqlalchemy.Table
        Table to insert into.

    Returns
    -------
    sqlalchemy.dialects.sqlite.Insert or sqlalchemy.dialects.postgresql.Insert
        Both have `on_conflict_do_nothing` and `on_conflict_do_update`.
    """
    return sqlite.insert(table) if connection.dialect.name == "sqlite" else postgresql.insert(table)


def insert_ignoring(connection: Connection, table: Table, values: dict[str, Any]) -> bool:
    """Insert a row unless one of its keys is taken; waits for a rival that is inserting the same.

    Parameters
    ----------
    connection : sqlalchemy.Connection
        In a writing transaction.
    table : sqlalchemy.Table
        Table to insert into.
    values : dict
        Columns of the row.

    Returns
    -------
    bool
        True where the row was inserted.
    """
    statement = dialect_insert(connection, table).on_conflict_do_nothing().values(values)
    return connection.execute(statement.returning(literal_column("1"))).first() is not None
