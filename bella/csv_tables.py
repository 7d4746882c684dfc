"""Tables that are handed in as CSV: from a file or text to a frame of text, with one line for whatever is wrong."""

import io
from pathlib import Path

import pandas as pd

from bella.exceptions import InputError


def read_table_text(path: Path) -> str:
    """Text of a CSV file.

    Raises
    ------
    InputError
        If the file cannot be read as text.
    """
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read as a text file ({error}); give the path of a CSV table") from error


def parse_table(text: str, source: str) -> pd.DataFrame:
    """Cells of a CSV table, all of them text; lines that begin with # are comments, of which some state a number.

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
    try:
        frame = pd.read_csv(io.StringIO("".join(rows)), dtype=str, keep_default_na=False, skipinitialspace=True)
    except (pd.errors.ParserError, pd.errors.EmptyDataError, ValueError) as error:
        reason = " ".join(str(error).split())
        raise InputError(f"{source}: is not a CSV table ({reason}); its first line must name the columns") from error
    if not isinstance(frame.index, pd.RangeIndex):
        raise InputError(f"{source}: row 1 has more columns than the header; check the separators")
    stated = (line[1:].partition(":") for line in lines if line.startswith("#") and ":" in line)
    frame.attrs = {name.strip(): value.strip() for name, _, value in stated}
    return frame
