"""Records to exchange formats: pure functions, nothing read or written."""

from bella.formats.tables import COLUMNS, localisation_csv, localisation_records

__all__ = ["COLUMNS", "localisation_csv", "localisation_records"]
