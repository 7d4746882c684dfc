"""Tables that are handed in as CSV: from a file or text to a frame of text, with one line for whatever is wrong."""

import codecs
import io
import re
from pathlib import Path

import pandas as pd

from bella.exceptions import InputError

SEPARATORS = (",", ";", "\t")
"""Between columns; spreadsheets write semicolons where numbers have a decimal comma."""

DECIMAL_COMMA = r"^\s*([+-]?\d*),(\d+)((?:[eE][+-]?\d+)?)\s*$", r"\1.\2\3"
FORTRAN = r"^\s*([+-]?\d*\.?\d+\.?)[dD]([+-]?\d+)\s*$", r"\1e\2"
"""Other ways to write a number, and what they become; the first only where no comma stands between columns."""


def read_table_text(path: Path) -> str:
    """Text of a CSV file, in UTF-8, or UTF-16 with its mark.

    Raises
    ------
    InputError
        If the file cannot be read as text.
    """
    try:
        content = path.read_bytes()
        is_utf16 = content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
        return content.decode("utf-16" if is_utf16 else "utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); give the path of a CSV table") from error
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise InputError(f"{path}: line {line} is not text in UTF-8; give a CSV table, saved as UTF-8") from error


def parse_table(text: str, source: str) -> pd.DataFrame:
    """Cells of a CSV table, all of them text; lines that begin with # are comments, of which some state a number.

    Columns may be separated by semicolons or tabs, and numbers have decimal commas or exponents of Fortran, which are
    made those of CSV; names of columns are without blanks and, where that keeps them apart, in lower case.

    Parameters
    ----------
    source : str
        What the table is called in error messages.

    Returns
    -------
    pandas.DataFrame
        With what comments such as ``# name: text`` state in `attrs`.

    Raises
    ------
    InputError
        If it is no table, or its heading has fewer fields than its rows.
    """
    lines = list(io.StringIO(text.removeprefix("\ufeff"), newline=None))
    rows = [line for line in lines if not line.startswith("#")]
    heading = next(filter(str.strip, rows), "")
    separator = max(SEPARATORS, key=heading.count)
    try:
        frame = pd.read_csv(
            io.StringIO("".join(rows)), sep=separator, dtype=str, keep_default_na=False, skipinitialspace=True
        )
    except (pd.errors.ParserError, pd.errors.EmptyDataError, ValueError) as error:
        reason = " ".join(str(error).split())
        raise InputError(f"{source}: is not a CSV table ({reason}); its first line must name the columns") from error
    if not isinstance(frame.index, pd.RangeIndex):
        raise InputError(f"{source}: row 1 has more columns than the header; check the separators")
    if len(frame.columns) == 1:
        raise InputError(f"{source}: its first line names one column, {frame.columns[0]!r}; put commas between columns")
    plain = [name.strip().lower() for name in frame.columns]
    frame.columns = plain if len(set(plain)) == len(plain) else frame.columns.str.strip()
    others = [DECIMAL_COMMA] * (separator != ",") + [FORTRAN] * bool(re.search(r"\d\.?[dD][+-]?\d", text))
    frame = frame.replace(dict(others), regex=True) if others else frame
    stated = (line[1:].partition(":") for line in lines if line.startswith("#") and ":" in line)
    frame.attrs = {name.strip(): value.strip() for name, _, value in stated}
    return frame
