"""Published tables as TFCat: features in time and frequency, one collection per spacecraft.

TFCat 1.0 (Cecconi et al. 2022, doi:10.25935/6068-8528) has one reference position per collection, which is the
spacecraft. A detection is a polygon (the box of its times and frequencies), the arrival times of a burst are one line.
"""

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from bella.exceptions import InputError
from bella.formats.columns import ARRIVALS, DETECTIONS, EVENTS, Column
from bella.formats.record_table import RecordTable, Values, plain_rows

TFCAT_TABLES = (DETECTIONS.name, ARRIVALS.name, EVENTS.name)
"""Tables whose rows have a spacecraft, times and frequencies."""

SCHEMA_URI = "https://voparis-ns.obspm.fr/maser/tfcat/v1.0/schema#"
REFERENCE_POSITIONS = {
    "WIND": "wind",
    "STEREO-A": "stereo-a",
    "STEREO-B": "stereo-b",
    "PSP": "parker-solar-probe",
    "SOLO": "solar-orbiter",
}
"""Names of the spacecraft as TFCat writes them; of others, their own in lower case."""

_KINDS = {"time": "str", "float": "float", "int": "int", "bool": "int", "text": "str"}
"""Data types of TFCat fields, which know no truth value: 1 and 0 stand for true and false."""

LINE_PROPERTIES = ("burst_id", "edge", "solution_id")
"""Columns that are the same for all arrival times of a burst at a spacecraft."""

Json = dict[str, Any]


def tfcat_collections(table: RecordTable) -> dict[str, Json]:
    """TFCat objects of a table of detections or arrival times.

    Returns
    -------
    dict of str to dict
        By observatory, JSON in the order of their first row.

    Raises
    ------
    InputError
        If the table has no features in time and frequency; events without frequencies are left out.
    """
    if table.schema.name not in TFCAT_TABLES:
        raise InputError(f"{table.schema.name}: TFCat holds {', '.join(TFCAT_TABLES)} only; take another format")
    if table.schema.name == EVENTS.name:
        table = table.take(np.flatnonzero(np.isfinite(table.data["f_low_mhz"]) & ~np.isnat(table.data["end_utc"])))
    names = table.data["observatory"]
    parts = {str(name): table.take(np.flatnonzero(names == name)) for name in dict.fromkeys(names.tolist())}
    made = _lines if table.schema.name == ARRIVALS.name else _boxes
    return {name: _collection(name, part, made(part)) for name, part in parts.items()}


def tfcat(table: RecordTable) -> bytes:
    """TFCat of the one spacecraft of a table.

    Raises
    ------
    InputError
        If there is no row, or rows of several spacecraft.
    """
    found = tfcat_collections(table)
    if len(found) != 1:
        whose = f"of {', '.join(found)}" if found else "with no row"
        raise InputError(f"a TFCat collection has one spacecraft, and this is a table {whose}: name one (observatory=)")
    return json.dumps(next(iter(found.values())), allow_nan=False, ensure_ascii=False).encode()


def _collection(observatory: str, table: RecordTable, features: list[Json]) -> Json:
    shown = _line_columns(table) if table.schema.name == ARRIVALS.name else table.schema.columns
    return {
        "type": "FeatureCollection",
        "schema": SCHEMA_URI,
        "features": features,
        "properties": {
            "title": table.schema.title,
            "facility_name": observatory,
            "instrument_host_name": observatory,
            "feature_name": "Type III burst",
            "target_name": "Sun",
            **table.header,
        },
        "fields": {column.name: _field(column) for column in shown},
        "crs": {
            "type": "local",
            "properties": {
                "name": "Time-Frequency",
                "time_coords_id": "unix",
                "spectral_coords": {"type": "frequency", "unit": "MHz"},
                "ref_position_id": REFERENCE_POSITIONS.get(observatory, observatory.lower()),
            },
        },
    }


def _field(column: Column) -> Mapping[str, str]:
    described = {"info": column.description, "datatype": _KINDS[column.kind], "ucd": column.ucd}
    return described | ({"unit": column.unit} if column.unit else {})


def _boxes(table: RecordTable) -> list[Json]:
    """A polygon for each detection or event, counterclockwise from the onset at the lowest frequency."""
    begin, end = (unix_s(table.data[name]) for name in ("start_utc", "end_utc"))
    low, high = (table.data[name] for name in ("f_low_mhz", "f_high_mhz"))
    corners = np.stack([begin, low, end, low, end, high, begin, high, begin, low], axis=1).reshape(-1, 5, 2)
    return [
        _feature(row, {"type": "Polygon", "coordinates": [ring]}, [ring[0], ring[2]], properties)
        for row, (ring, properties) in enumerate(zip(corners.tolist(), plain_rows(table), strict=True))
    ]


def _lines(table: RecordTable) -> list[Json]:
    """A line for each burst, through its arrival times from the lowest to the highest frequency."""
    made: list[Json] = []
    for burst in dict.fromkeys(table.data["burst_id"].tolist()):
        rows = np.flatnonzero(table.data["burst_id"] == burst)
        part = table.take(rows[np.argsort(table.data["frequency_mhz"][rows])])
        points = np.stack([unix_s(part.data["arrival_utc"]), part.data["frequency_mhz"]], axis=1)
        geometry = {"type": "LineString", "coordinates": points.tolist()}
        if len(points) == 1:
            geometry = {"type": "Point", "coordinates": points[0].tolist()}
        properties = {name: value for name, value in plain_rows(part)[0].items() if name in LINE_PROPERTIES}
        made.append(
            _feature(len(made), geometry, [points.min(axis=0).tolist(), points.max(axis=0).tolist()], properties)
        )
    return made


def _feature(number: int, geometry: Json, corners: list[list[float]], properties: Mapping[str, object]) -> Json:
    return {
        "type": "Feature",
        "id": number,
        "bbox": [*corners[0], *corners[1]],
        "geometry": geometry,
        "properties": {name: int(one) if isinstance(one, bool) else one for name, one in properties.items()},
    }


def _line_columns(table: RecordTable) -> tuple[Column, ...]:
    return tuple(column for column in table.schema.columns if column.name in LINE_PROPERTIES)


def unix_s(times: Values) -> Values:
    """Unix time of datetime64[us], seconds, as the nearest float64 (0.2 microseconds today)."""
    return times.astype("datetime64[us]").astype(np.int64) / 1e6
