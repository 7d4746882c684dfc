"""Alerts as documents: JSON on the public core of GCN's unified schema, server-sent events, and an Atom feed.

The core (https://github.com/nasa-gcn/gcn-schema, gcn/notices/core: Alert, Event, DateTime, Reporter, AdditionalInfo)
has places on the sky only. One extension, `heliospheric_localization`, says where a source was in the heliosphere;
`alert.schema.json` beside this module describes the whole.
"""

import json
from collections.abc import Sequence
from datetime import datetime, timedelta
from functools import cache
from importlib import resources
from typing import Any
from xml.etree import ElementTree as Xml

from bella.flags import APPARENT_SOURCE
from bella.records import Alert, AlertSource, AlertType, Origin

SCHEMA_FILE = "alert.schema.json"
ATOM = "http://www.w3.org/2005/Atom"
RECENT = timedelta(days=7)
"""A burst whose alert comes later than this is `archival`: the first data of most receivers come within some days."""

_GCN_TYPE = {AlertType.PRELIMINARY: "initial", AlertType.UPDATE: "update", AlertType.RETRACTION: "retraction"}
_COVARIANCE = ("xx", "xy", "yy", "xz", "yz", "zz")


@cache
def alert_schema() -> dict[str, Any]:
    """JSON Schema (2020-12) of the documents."""
    schema: dict[str, Any] = json.loads(resources.files("bella.formats").joinpath(SCHEMA_FILE).read_text("utf-8"))
    return schema


def alert_name(alert: Alert) -> str:
    """Name of an alert that no other one has: the key by which a receiver knows that it has it already."""
    return f"{alert.burst_id}.alert-{alert.record_number}.{alert.sequence}"


def alert_document(alert: Alert, base_url: str) -> dict[str, Any]:
    """An alert as a JSON document.

    Parameters
    ----------
    base_url : str
        Address of the service, without a slash at its end; empty for paths alone.

    Returns
    -------
    dict
        Valid by :func:`alert_schema`; what is not known is not there.
    """
    page = f"{base_url}/bursts/{alert.burst_id}"
    document = {
        "$schema": f"{base_url}/api/v1/alerts/schema",
        "alert_datetime": alert.created_utc,
        "alert_tense": _tense(alert),
        "alert_type": _gcn_type(alert),
        "mission": "BELLA",
        "instrument": ", ".join(alert.observatories),
        "messenger": "EM",
        "record_number": alert.record_number,
        "event_name": alert.burst_id,
        "id": alert_name(alert),
        "data_archive_page": page,
        "trigger_time": alert.start_utc,
        "observation_start": alert.start_utc,
        "observation_stop": alert.end_utc,
        "additional_info": alert.sentence,
        "type": alert.alert_type.value,
        "sequence": alert.sequence,
        "origin": alert.origin.value,
        "observatories": list(alert.observatories),
        "band_mhz": [alert.f_low_mhz, alert.f_high_mhz],
        "solution": alert.solution_id,
        "retracted_reason": alert.retracted_reason,
        "heliospheric_localization": None if alert.retracted_reason else _localisation(alert, base_url),
    }
    return _known(document)


def _gcn_type(alert: Alert) -> str:
    if alert.alert_type is not AlertType.TEST:
        return _GCN_TYPE[alert.alert_type]
    return "retraction" if alert.retracted_reason else "initial" if alert.record_number == 1 else "update"


def _tense(alert: Alert) -> str:
    if alert.origin is Origin.SIMULATED:
        return "injection"
    if alert.origin is Origin.TEST:
        return "test"
    late = datetime.fromisoformat(alert.created_utc) - datetime.fromisoformat(alert.start_utc)
    return "current" if late <= RECENT else "archival"


def _localisation(alert: Alert, base_url: str) -> dict[str, Any]:
    longitude = {
        "median_deg": alert.phi0_deg,
        "interval_68_deg": [alert.phi0_low_deg, alert.phi0_high_deg] if alert.phi0_deg is not None else None,
        "region_68_deg": [[part.low, part.high, part.probability] for part in alert.phi0_68] or None,
    }
    return _known(
        {
            "frame": "HEE",
            "frame_epoch": alert.reference_utc,
            "source": "apparent",
            "remark": APPARENT_SOURCE,
            "grade": alert.grade,
            "tier": alert.tier,
            "flags": list(alert.flags),
            "longitude_at_1_rsun": _known(longitude) or None,
            "positions": [_position(one) for one in alert.sources],
            "track": f"{base_url}/api/v1/bursts/{alert.burst_id}/track",
        }
    )


def _position(source: AlertSource) -> dict[str, Any]:
    covariance = {name: getattr(source, f"cov_{name}_rsun2") for name in _COVARIANCE}
    return _known(
        {
            "frequency_mhz": source.frequency_mhz,
            "time": source.emission_utc,
            "position_rsun": [source.x_rsun, source.y_rsun, source.z_rsun],
            "covariance_rsun2": _known(covariance) or None,
        }
    )


def _known(fields: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in fields.items() if value is not None}


def alert_text(alert: Alert, base_url: str) -> str:
    """An alert as JSON on one line, the same characters whenever it is written."""
    return json.dumps(alert_document(alert, base_url), separators=(",", ":"), sort_keys=True, allow_nan=False)


def server_sent_event(alert: Alert, base_url: str) -> str:
    """An alert as a server-sent event (HTML standard, section 9.2), whose id is its sequence number."""
    return f"id: {alert.sequence}\nevent: {alert.alert_type.value}\ndata: {alert_text(alert, base_url)}\n\n"


def atom_feed(alerts: Sequence[Alert], base_url: str, updated_utc: str) -> str:
    """Atom feed (RFC 4287) of alerts.

    Parameters
    ----------
    alerts : sequence of Alert
        The newest first.
    base_url : str
        Address of the service, without a slash at its end.
    updated_utc : str
        When the feed changed, where it has no alert.
    """
    feed = Xml.Element("feed", xmlns=ATOM)
    _add(feed, "id", f"{base_url}/feed.atom")
    _add(feed, "title", "BELLA: solar radio bursts")
    _add(feed, "updated", alerts[0].created_utc if alerts else updated_utc)
    Xml.SubElement(feed, "link", rel="self", href=f"{base_url}/feed.atom")
    Xml.SubElement(feed, "link", rel="alternate", href=f"{base_url}/")
    Xml.SubElement(_add(feed, "author", ""), "name").text = "BELLA service"
    for alert in alerts:
        entry = _add(feed, "entry", "")
        _add(entry, "id", f"{base_url}/api/v1/alerts#{alert_name(alert)}")
        _add(entry, "title", f"{alert.burst_id} {alert.alert_type.value.lower()}: {alert.sentence}")
        _add(entry, "updated", alert.created_utc)
        _add(entry, "summary", f"{alert.sentence}. {', '.join(alert.observatories)}. {APPARENT_SOURCE}.")
        Xml.SubElement(entry, "category", term=alert.alert_type.value)
        Xml.SubElement(entry, "category", term=f"origin:{alert.origin.value}")
        Xml.SubElement(entry, "link", rel="alternate", href=f"{base_url}/bursts/{alert.burst_id}")
    return Xml.tostring(feed, encoding="unicode", xml_declaration=True)


def _add(parent: Xml.Element, name: str, text: str) -> Xml.Element:
    child = Xml.SubElement(parent, name)
    if text:
        child.text = text
    return child
