"""Reads published tables back, each format by a reader that shares no code with what wrote it."""

import csv
import io
import json
import tempfile
from pathlib import Path
from typing import Any

import cdflib
import numpy as np
import pyarrow.parquet as pq
import xarray as xr
from astropy.io.votable import parse_single_table
from astropy.table import MaskedColumn, QTable
from astropy.utils.masked import Masked

from bella.formats import Schema

Columns = dict[str, list[Any]]


def read_back(name: str, raw: bytes, schema: Schema) -> Columns:
    """Columns as plain lists: times as datetime64[us] (NaT), floats (NaN), ints, bools and texts."""
    return READERS[name](raw, schema)


def _typed(kind: str, text: Any) -> Any:
    if kind == "time":
        return np.datetime64(text.removesuffix("Z") if text else "NaT", "us")
    if kind == "float":
        return np.nan if text in {"", None} else float(text)
    if kind == "bool":
        return text if isinstance(text, bool) else {"true": True, "false": False}[text]
    return int(text) if kind == "int" else text


def _csv(raw: bytes, schema: Schema) -> Columns:
    lines = [line for line in raw.decode().split("\n") if not line.startswith("#")]
    rows = list(csv.DictReader(io.StringIO("\n".join(lines), newline="")))
    return {one.name: [_typed(one.kind, row[one.name]) for row in rows] for one in schema.columns}


def _json(raw: bytes, schema: Schema) -> Columns:
    rows = json.loads(raw)["rows"]
    return {one.name: [_typed(one.kind, row[one.name]) for row in rows] for one in schema.columns}


def _ecsv(raw: bytes, schema: Schema) -> Columns:
    table = QTable.read(raw.decode(), format="ascii.ecsv")
    found: Columns = {}
    for one in schema.columns:
        column = table[one.name]
        if one.kind == "time":
            unknown = np.broadcast_to(getattr(column, "mask", False), len(table))
            texts = [""] * len(table)
            for row in np.flatnonzero(~unknown):
                texts[row] = str(column[row].isot)
            found[one.name] = [_typed("time", text) for text in texts]
        else:
            values = column.unmasked if isinstance(column, Masked) else column
            if one.kind == "text" and isinstance(values, MaskedColumn):
                values = values.filled("")  # ECSV has no other way to write an empty text
            found[one.name] = np.asarray(getattr(values, "value", values)).tolist()
            if one.kind == "text":
                found[one.name] = [str(value) for value in found[one.name]]
    return found


def _votable(raw: bytes, schema: Schema) -> Columns:
    table = parse_single_table(io.BytesIO(raw))
    found: Columns = {}
    for one in schema.columns:
        values = table.array[one.name]
        plain = values.data.tolist() if one.kind in {"float", "int", "bool"} else [str(v) for v in values.data]
        found[one.name] = [_typed("time", text) for text in plain] if one.kind == "time" else plain
    return found


def _cdf(raw: bytes, schema: Schema) -> Columns:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "table.cdf"
        path.write_bytes(raw)
        file = cdflib.CDF(path)
        found: Columns = {}
        for one in schema.columns:
            values = np.atleast_1d(file.varget(one.name))
            fill = file.varattsget(one.name)["FILLVAL"]
            if one.kind == "time":
                known = values != fill
                times = np.full(values.shape, np.datetime64("NaT", "us"))
                if known.any():
                    stamps = cdflib.cdfepoch.encode_tt2000(values[known])
                    times[known] = [np.datetime64(stamp, "ns") for stamp in np.atleast_1d(stamps)]
                found[one.name] = list(times)
            elif one.kind == "float":
                found[one.name] = np.where(values == fill, np.nan, values).tolist()
            elif one.kind == "bool":
                found[one.name] = values.astype(bool).tolist()
            else:
                found[one.name] = [str(v) for v in values] if one.kind == "text" else values.tolist()
        return found


def _netcdf(raw: bytes, schema: Schema) -> Columns:
    with xr.open_dataset(io.BytesIO(raw), engine="h5netcdf") as dataset:
        found = {one.name: dataset[one.name].to_numpy() for one in schema.columns}
    return {
        one.name: list(found[one.name].astype("datetime64[us]")) if one.kind == "time" else found[one.name].tolist()
        for one in schema.columns
    }


def _parquet(raw: bytes, schema: Schema) -> Columns:
    table = pq.read_table(io.BytesIO(raw))
    found: Columns = {}
    for one in schema.columns:
        values = table.column(one.name).to_pylist()
        if one.kind == "time":
            values = [np.datetime64("NaT" if v is None else v.replace(tzinfo=None), "us") for v in values]
        found[one.name] = values
    return found


READERS = {
    "csv": _csv,
    "json": _json,
    "ecsv": _ecsv,
    "votable": _votable,
    "cdf": _cdf,
    "netcdf": _netcdf,
    "parquet": _parquet,
}
