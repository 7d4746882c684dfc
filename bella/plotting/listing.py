"""Arrays as short lists that any JSON reader takes."""

import math
from typing import Any

import numpy as np
import numpy.typing as npt


def listed(values: npt.ArrayLike, digits: int = 2) -> list[Any]:
    """Numbers rounded to a number of decimals, None for what is not finite.

    Parameters
    ----------
    values : array_like, any shape
    digits : int
        Decimals kept.

    Returns
    -------
    list
        Nested as the array is.
    """
    array = np.round(np.asarray(values, dtype=np.float64), digits)
    return _without_nan(array.tolist())


def significant(values: npt.ArrayLike, digits: int = 4) -> list[Any]:
    """Numbers rounded to a number of significant digits, None for what is not finite.

    Parameters
    ----------
    values : array_like, one-dimensional
    digits : int

    Returns
    -------
    list of float or None
    """
    return [float(f"{value:.{digits}g}") if math.isfinite(value) else None for value in np.asarray(values, dtype=float)]


def stamps(times: npt.NDArray[np.datetime64]) -> list[str | None]:
    """UTC times as ISO text with milliseconds, None where there is no time."""
    text = np.datetime_as_string(times.astype("datetime64[ms]"))
    return [None if np.isnat(time) else str(stamp) for time, stamp in zip(times, text, strict=True)]


def _without_nan(values: list[Any]) -> list[Any]:
    if values and isinstance(values[0], list):
        return [_without_nan(row) for row in values]
    return [value if math.isfinite(value) else None for value in values]
