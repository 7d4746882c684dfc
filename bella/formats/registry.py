"""The formats that a published table is written in, by name."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from bella.exceptions import InputError
from bella.formats.columns import Schema
from bella.formats.record_table import RecordTable

Writer = Callable[[RecordTable], bytes]
Pieces = Callable[[Schema, Mapping[str, str], Iterable[RecordTable]], Iterator[bytes]]


@dataclass(frozen=True)
class Format:
    """How a table is written.

    Attributes
    ----------
    name : str
    media_type : str
    suffix : str
        Of a file, with its dot.
    where : str
        Module of this room and function that write it, imported when they are first used.
    pieces : str
        The same for what writes it piece by piece, of any number of rows; empty where it has to be written at once.
    """

    name: str
    media_type: str
    suffix: str
    where: str
    pieces: str = ""

    def write(self, table: RecordTable) -> bytes:
        """Bytes of a table in this format.

        Raises
        ------
        InputError
            If the format cannot hold the table, or needs a package that is not installed.
        """
        writer: Writer = _imported(self.where)
        return writer(table)

    def write_pieces(self, schema: Schema, header: Mapping[str, str], tables: Iterable[RecordTable]) -> Iterator[bytes]:
        """Bytes of tables that follow one another as one table, for a format that has `pieces`."""
        writer: Pieces = _imported(self.pieces)
        return writer(schema, header, tables)


def _imported(where: str) -> Any:
    module, _, function = where.partition(":")
    return getattr(import_module(f"bella.formats.{module}"), function)


FORMATS = {
    one.name: one
    for one in (
        Format("json", "application/json", ".json", "text:json_text", "text:json_pieces"),
        Format("csv", "text/csv", ".csv", "text:csv_text", "text:csv_pieces"),
        Format("ecsv", "text/ecsv", ".ecsv", "astropy_tables:ecsv", "astropy_tables:ecsv_pieces"),
        Format(
            "votable", "application/x-votable+xml", ".vot", "astropy_tables:votable", "astropy_tables:votable_pieces"
        ),
        Format("tfcat", "application/tfcat+json", ".tfcat.json", "tfcat:tfcat"),
        Format("cdf", "application/x-cdf", ".cdf", "binary:istp_cdf"),
        Format("netcdf", "application/x-netcdf", ".nc", "binary:netcdf", "binary:netcdf_pieces"),
        Format("parquet", "application/vnd.apache.parquet", ".parquet", "binary:parquet", "binary:parquet_pieces"),
    )
}
"""Formats by name; ``json`` is what is given where none is asked for."""


def find_format(name: str) -> Format:
    """Format of a name.

    Raises
    ------
    InputError
        If it is not known; the message lists those that are.
    """
    if name not in FORMATS:
        raise InputError(f"format {name[:40]!r} is not known; choose one of {', '.join(FORMATS)}")
    return FORMATS[name]
