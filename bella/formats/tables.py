"""The localisation table: one record per frequency, and its CSV form."""

import csv
import io
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import pandas as pd
import xarray as xr

COLUMNS = (
    "frequency_mhz",
    "x_rsun",
    "y_rsun",
    "z_rsun",
    "cov_xx_rsun2",
    "cov_xy_rsun2",
    "cov_yy_rsun2",
    "cov_xz_rsun2",
    "cov_yz_rsun2",
    "cov_zz_rsun2",
    "area68_rsun2",
    "area95_rsun2",
    "modes",
    "emission_utc",
    "v_over_c",
    "v_over_c_sd",
    "contraction_x",
    "contraction_y",
    "contraction_v",
    "log_evidence",
    "flags",
)
"""Columns in order. The covariances with z are there for solutions in space only."""

SPATIAL = frozenset({"cov_xz_rsun2", "cov_yz_rsun2", "cov_zz_rsun2"})

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
    rows = [dict(record) for record in records]
    spatial = any(row.get(name) is not None for row in rows for name in SPATIAL)
    names = [name for name in COLUMNS if spatial or name not in SPATIAL]
    text = io.StringIO()
    text.writelines(f"# {key}: {value}\n" for key, value in comments.items())
    writer = csv.writer(text, lineterminator="\n")
    solution = [name for name in ("method", "preset") if name in comments]
    writer.writerow([*names, *solution])
    writer.writerows(
        [*(_written(row.get(name)) for name in names), *(comments[name] for name in solution)] for row in rows
    )
    return text.getvalue()


def _written(value: object) -> str:
    if value is None:
        return ""
    if hasattr(value, "isoformat"):
        return pd.Timestamp(value).tz_convert("UTC").strftime("%Y-%m-%dT%H:%M:%S.%f")[:-3] + "Z"  # type: ignore[arg-type]
    return f"{value:.10g}" if isinstance(value, float) else str(value)
