"""Records of solutions and tracks, and the CSV form of the localisation table: one record per frequency."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import pandas as pd
import xarray as xr

from bella.formats.columns import LOCALISATIONS, SOLUTION_COLUMNS
from bella.formats.record_table import record_table
from bella.formats.text import csv_text
from bella.records import JointTrack, Parameter

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


def track_numbers(joint: JointTrack) -> dict[str, object]:
    """Columns of the table of tracks that a joint fit says: medians with the ends of their 68 % intervals.

    Parameters
    ----------
    joint : JointTrack

    Returns
    -------
    dict
        Keys are columns of `bella.formats.TRACKS`; None for what is not known.
    """
    parameters = {
        "phi0": (joint.phi0_deg, "_deg"),
        "v_sw": (joint.v_sw_km_s, "_km_s"),
        "beam_speed": (joint.beam_speed_c, "_c"),
    }
    row: dict[str, object] = {
        "tier": joint.tier,
        "release_utc": joint.release_utc.q50,
        "release_sd_s": joint.release_utc.sd,
        "misfit_p": joint.misfit_p,
        "rotation_period_d": joint.rotation_period_d,
        "flags": ";".join(joint.flags),
    }
    for name, (value, unit) in parameters.items():
        row |= _median_and_ends(name, unit, value) | {f"{name}_contraction": value.contraction}
    return row


def _median_and_ends(name: str, unit: str, value: Parameter) -> dict[str, float | None]:
    return {f"{name}{unit}": value.q50, f"{name}_low{unit}": value.q16, f"{name}_high{unit}": value.q84}
