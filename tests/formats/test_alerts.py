"""Alerts as documents: valid by the schema, with what the record says, in three forms."""

import json
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree as Xml

import jsonschema
import pytest

from bella.formats.alerts import (
    ATOM,
    alert_document,
    alert_name,
    alert_schema,
    alert_text,
    atom_feed,
    server_sent_event,
)
from bella.records import Alert, AlertSource, AlertType, Interval, Origin

BASE = "https://bella.example.org"
VALIDATOR = jsonschema.Draft202012Validator(alert_schema())


def alert(**changes: Any) -> Alert:
    source = AlertSource(
        frequency_mhz=0.5,
        emission_utc="2026-11-28T19:20:01.000Z",
        x_rsun=20.5,
        y_rsun=-3.25,
        z_rsun=0.0,
        cov_xx_rsun2=4.0,
        cov_xy_rsun2=-0.5,
        cov_yy_rsun2=2.25,
    )
    return Alert(
        sequence=17,
        record_number=2,
        alert_type=AlertType.UPDATE,
        created_utc="2026-11-28T22:00:00.000Z",
        origin=Origin.ARCHIVE,
        burst_id="T3-20261128-1929",
        start_utc="2026-11-28T19:29:00.000Z",
        end_utc="2026-11-28T20:09:00.000Z",
        f_low_mhz=0.15,
        f_high_mhz=13.8,
        observatories=("WIND", "STEREO-A", "SOLO"),
        solution_id="T3-20261128-1929.half_rise.posterior.default.2d.v2",
        grade="B",
        sentence="26\N{DEGREE SIGN} W (22 to 31), grade B",
        reference_utc="2026-11-28T19:29:00.000Z",
        phi0_deg=26.0,
        phi0_low_deg=22.0,
        phi0_high_deg=31.0,
        phi0_68=(Interval(low=22.0, high=31.0, probability=0.68),),
        sources=(source,),
        flags=("speed_not_constrained",),
    ).model_copy(update=changes)


RETRACTED = {"alert_type": AlertType.RETRACTION, "retracted_reason": "interference", "sentence": "retracted"}
KINDS: dict[str, dict[str, Any]] = {
    "update": {},
    "first": {"alert_type": AlertType.PRELIMINARY, "record_number": 1, "tier": "preliminary", "grade": "D"},
    "retraction": RETRACTED,
    "test": {"alert_type": AlertType.TEST, "origin": Origin.TEST},
    "test retraction": RETRACTED | {"alert_type": AlertType.TEST, "origin": Origin.TEST},
    "simulated": {"alert_type": AlertType.TEST, "origin": Origin.SIMULATED, "record_number": 1},
    "no positions": {"sources": (), "phi0_deg": None, "phi0_low_deg": None, "phi0_high_deg": None, "phi0_68": ()},
}


def test_the_schema_is_a_schema() -> None:
    jsonschema.Draft202012Validator.check_schema(alert_schema())


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("base", [BASE, ""])
def test_every_kind_of_alert_is_valid(kind: str, base: str) -> None:
    VALIDATOR.validate(alert_document(alert(**KINDS[kind]), base))


def test_the_core_says_who_when_and_in_which_order() -> None:
    document = alert_document(alert(), BASE)
    expected = {
        "alert_datetime": "2026-11-28T22:00:00.000Z",
        "alert_tense": "current",
        "alert_type": "update",
        "record_number": 2,
        "event_name": "T3-20261128-1929",
        "id": "T3-20261128-1929.alert-2.17",
        "mission": "BELLA",
        "messenger": "EM",
        "trigger_time": "2026-11-28T19:29:00.000Z",
        "data_archive_page": f"{BASE}/bursts/T3-20261128-1929",
        "type": "UPDATE",
        "sequence": 17,
        "origin": "archive",
        "band_mhz": [0.15, 13.8],
    }
    assert expected.items() <= document.items()
    assert not {"ra", "dec", "retracted_reason"} & document.keys()


def test_the_extension_says_where() -> None:
    place = alert_document(alert(), BASE)["heliospheric_localization"]
    assert (place["frame"], place["source"], place["grade"], place["tier"]) == ("HEE", "apparent", "B", "final")
    assert place["longitude_at_1_rsun"] == {
        "median_deg": 26.0,
        "interval_68_deg": [22.0, 31.0],
        "region_68_deg": [[22.0, 31.0, 0.68]],
    }
    assert place["positions"] == [
        {
            "frequency_mhz": 0.5,
            "time": "2026-11-28T19:20:01.000Z",
            "position_rsun": [20.5, -3.25, 0.0],
            "covariance_rsun2": {"xx": 4.0, "xy": -0.5, "yy": 2.25},
        }
    ]


@pytest.mark.parametrize(
    ("kind", "type_", "tense"),
    [
        ("first", "initial", "current"),
        ("retraction", "retraction", "current"),
        ("test", "update", "test"),
        ("test retraction", "retraction", "test"),
        ("simulated", "initial", "injection"),
    ],
)
def test_types_and_tenses(kind: str, type_: str, tense: str) -> None:
    document = alert_document(alert(**KINDS[kind]), BASE)
    assert (document["alert_type"], document["alert_tense"]) == (type_, tense)
    assert ("heliospheric_localization" in document) == (type_ != "retraction")


def test_what_is_told_a_week_late_is_archival() -> None:
    for day, tense in (("21T22:00:00.000Z", "current"), ("21T18:00:00.000Z", "archival")):
        assert alert_document(alert(start_utc=f"2026-11-{day}"), BASE)["alert_tense"] == tense


@dataclass(frozen=True)
class Fault:
    path: tuple[str, ...]
    value: Any


FAULTS = {
    "unknown field": Fault(("ra",), 1.0),
    "no such type": Fault(("type",), "INITIAL"),
    "real data told as a test": Fault(("type",), "TEST"),
    "test data told as real": Fault(("origin",), "test"),
    "time without a zone": Fault(("alert_datetime",), "2026-11-28T22:00:00"),
    "another frame": Fault(("heliospheric_localization", "frame"), "HEEQ"),
    "not apparent": Fault(("heliospheric_localization", "source"), "true"),
    "no number": Fault(("sequence",), 0),
    "retraction with a place": Fault(("alert_type",), "retraction"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_the_schema_refuses_what_is_wrong(name: str) -> None:
    document = alert_document(alert(), BASE)
    place, fault = document, FAULTS[name]
    for step in fault.path[:-1]:
        place = place[step]
    place[fault.path[-1]] = fault.value
    assert not VALIDATOR.is_valid(document)


def test_an_event_of_the_stream_is_its_number_its_type_and_one_line_of_json() -> None:
    event = server_sent_event(alert(), BASE)
    number, kind, data, *rest = event.split("\n")
    assert (number, kind, rest) == ("id: 17", "event: UPDATE", ["", ""])
    assert json.loads(data.removeprefix("data: ")) == alert_document(alert(), BASE)
    assert alert_text(alert(), BASE) == alert_text(alert(), BASE)
    assert "\n" not in alert_text(alert(sentence="two\nlines"), BASE)


def test_the_feed_is_atom_and_escapes_what_it_is_told() -> None:
    feed = Xml.fromstring(atom_feed([alert(sentence="<script>&"), alert(sequence=3)], BASE, "x"))
    name = f"{{{ATOM}}}"
    assert feed.tag == f"{name}feed"
    assert feed.findtext(f"{name}updated") == "2026-11-28T22:00:00.000Z"
    first, second = feed.findall(f"{name}entry")
    assert first.findtext(f"{name}title") == "T3-20261128-1929 update: <script>&"
    assert first.findtext(f"{name}id") == f"{BASE}/api/v1/alerts#{alert_name(alert())}"
    assert second.findtext(f"{name}id") != first.findtext(f"{name}id")
    link = first.find(f"{name}link")
    assert link is not None
    assert link.get("href") == f"{BASE}/bursts/T3-20261128-1929"
    empty = Xml.fromstring(atom_feed([], BASE, "1970-01-01T00:00:00Z"))
    assert empty.findtext(f"{name}updated") == "1970-01-01T00:00:00Z"
