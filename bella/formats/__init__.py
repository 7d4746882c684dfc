"""Records to exchange formats: pure functions of tables whose columns are declared once.

`columns` says what the published tables hold, `record_table` makes a table of records, and `FORMATS` holds what can be
written from it: all formats hold the same numbers.
"""

from bella.formats.columns import (
    ARRIVALS,
    BURSTS,
    DAYS,
    DETECTIONS,
    EVENTS,
    LATENCIES,
    LOCALISATIONS,
    SCHEMAS,
    TRACKS,
    Column,
    Schema,
)
from bella.formats.record_table import RecordTable, record_table
from bella.formats.registry import FORMATS, Format, find_format
from bella.formats.tables import COLUMNS, localisation_csv, localisation_records, track_numbers

__all__ = [
    "ARRIVALS",
    "BURSTS",
    "COLUMNS",
    "DAYS",
    "DETECTIONS",
    "EVENTS",
    "FORMATS",
    "LATENCIES",
    "LOCALISATIONS",
    "SCHEMAS",
    "TRACKS",
    "Column",
    "Format",
    "RecordTable",
    "Schema",
    "find_format",
    "localisation_csv",
    "localisation_records",
    "record_table",
    "track_numbers",
]
