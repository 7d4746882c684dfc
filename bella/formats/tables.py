"""The localisation table: one record per frequency, and its CSV form."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import pandas as pd
import xarray as xr

from bella.formats.columns import LOCALISATIONS, SOLUTION_COLUMNS
from bella.formats.record_table import record_table
from bella.formats.text import csv_text

COLUMNS = SOLUTION_COLUMNS
"""Columns in order. The covariances with z are there for solutions in space only."""

SPATIAL = ("cov_xz_rsun2", "cov_yz_rsun2", "cov_zz_rsun2")

Record = Mapping[str, object]


def localisation_records(posterior: xr.Dataset) -> list[dict[str, object]]:
    """Records of a solution, one per frequency.

    Parameters
    ----------
    posterior : xarray.Dataset
        A solution of :func:`bella.multilateration.localise`.

    Returns
    -------
    list of dict
        Keys `COLUMNS`; ``emission_utc`` is a timezone-aware :class:`datetime.datetime`, what a solution does not
        have is None.
    """
    reference = pd.Timestamp(posterior.attrs["reference_time"])
    emitted = reference + pd.to_timedelta(posterior["emission_s"].to_numpy(), unit="s")
    columns: dict[str, Sequence[object]] = {
        name: posterior[name].to_numpy().tolist() for name in COLUMNS if name in posterior.data_vars
    }
    columns["frequency_mhz"] = posterior["frequency"].to_numpy().tolist()
    columns["emission_utc"] = list(emitted.round("ms").to_pydatetime())
    missing = [None] * posterior.sizes["frequency"]
    rows = zip(*(columns.get(name, missing) for name in COLUMNS), strict=True)
    return [dict(zip(COLUMNS, map(_known, row), strict=True)) for row in rows]


def _known(value: object) -> object:
    return None if isinstance(value, float) and not np.isfinite(value) else value


def localisation_csv(records: Iterable[Record], comments: Mapping[str, object]) -> str:
    """CSV of localisation records, with the method and preset of the solution as its last columns.

    Parameters
    ----------
    records : iterable of mapping
        As :func:`localisation_records` returns them; further keys are left out.
    comments : mapping
        Written as ``# key: value`` lines before the heading; ``method`` and ``preset`` become columns too.

    Returns
    -------
    str
    """
    solution = {name: comments[name] for name in ("method", "preset") if name in comments}
    rows = [{**record, **solution} for record in records]
    flat = () if any(row.get(name) is not None for row in rows for name in SPATIAL) else SPATIAL
    unsaid = {"burst_id", "solution_id", "edge", "method", "preset"} - solution.keys()
    schema = LOCALISATIONS.without(*flat, *unsaid)
    return csv_text(record_table(schema, rows, {key: str(value) for key, value in comments.items()})).decode()
