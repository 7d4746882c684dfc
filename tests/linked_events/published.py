"""Lists as their publishers write them, cut to a few rows around the burst of 2012-06-07."""

import json
from datetime import datetime, timedelta
from typing import Any

from bella.catalogue import Catalogue, ListRead
from bella.linked_events import Event, Link

SWPC = """\
:Product: 20120607events.txt
:Created: 2012 Jun 08 0302 UT
:Date: 2012 06 07
# Prepared by the U.S. Dept. of Commerce, NOAA, Space Weather Prediction Center
# Missing data: ////
#                            Edited Events for 2012 Jun 07
#
#Event    Begin    Max       End  Obs  Q  Type  Loc/Frq   Particulars       Reg#
#-------------------------------------------------------------------------------

5190       0031   0031      0031  LEA  G   RBR  245       250
5200 +     1924   1935      1946  G15  5   XRA  1-8A      C3.4    3.1E-03   1494
5200       1926   1934      1950  HOL  3   FLA  S17W62    SF                1494
5210      B2350   ////      0012  G15  5   XRA  1-8A      B9.1    7.7E-04
5220       2358   0003      0009  G15  5   XRA  1-8A      M1.2    7.7E-03   1499
"""

SWPC_JSON: list[dict[str, Any]] = [
    {
        "begin_datetime": "2012-06-07T19:24:00",
        "max_datetime": "2012-06-07T19:35:00",
        "end_datetime": "2012-06-07T19:46:00",
        "observatory": "G15",
        "type": "XRA",
        "location": "S17W62",
        "particulars1": "C3.4",
        "region": 1494,
    },
    {"begin_datetime": "2012-06-07T19:26:00", "type": "RSP", "particulars1": "III/1"},
]

GOES: list[dict[str, Any]] = [
    {
        "time_tag": "2012-06-07T19:46:00Z",
        "begin_time": "2012-06-07T19:24:00Z",
        "begin_class": "B8.1",
        "max_time": "2012-06-07T19:35:00Z",
        "max_class": "C3.4",
        "end_time": "2012-06-07T19:46:00Z",
        "satellite": 15,
    }
]

DONKI_FLARES: list[dict[str, Any]] = [
    {
        "flrID": "2012-06-07T19:24:00-FLR-001",
        "instruments": [{"displayName": "GOES15: SEM/XRS 1.0-8.0"}],
        "beginTime": "2012-06-07T19:24Z",
        "peakTime": "2012-06-07T19:35Z",
        "endTime": None,
        "classType": "C3.4",
        "sourceLocation": "S17W62",
        "activeRegionNum": 11494,
        "linkedEvents": [{"activityID": "2012-06-07T20:00:00-CME-001"}],
        "link": "https://webtools.ccmc.gsfc.nasa.gov/DONKI/view/FLR/1/-1",
    }
]

DONKI_CMES: list[dict[str, Any]] = [
    {
        "activityID": "2012-06-07T20:00:00-CME-001",
        "catalog": "M2M_CATALOG",
        "startTime": "2012-06-07T20:00Z",
        "sourceLocation": "",
        "activeRegionNum": None,
        "note": "seen in COR2A",
        "instruments": [{"displayName": "SOHO: LASCO/C2"}],
        "cmeAnalyses": [
            {"speed": 410.0, "isMostAccurate": False},
            {"speed": 560.0, "isMostAccurate": True},
        ],
        "linkedEvents": None,
    }
]

DONKI_PARTICLES: list[dict[str, Any]] = [
    {
        "sepID": "2012-06-07T20:20:00-SEP-001",
        "eventTime": "2012-06-07T20:20Z",
        "instruments": [{"displayName": "STEREO A: IMPACT 13-100 MeV"}],
        "linkedEvents": None,
    }
]

BEGIN_UNIX_S = 1_339_097_340.0
"""2012-06-07T19:29:00Z."""

TFCAT: dict[str, Any] = {
    "type": "FeatureCollection",
    "features": [
        {
            "type": "Feature",
            "id": 17,
            "geometry": {
                "type": "Polygon",
                "coordinates": [
                    [
                        [BEGIN_UNIX_S, 16000.0],
                        [BEGIN_UNIX_S + 1500.0, 200.0],
                        [BEGIN_UNIX_S + 60.0, 16000.0],
                        [BEGIN_UNIX_S, 16000.0],
                    ]
                ],
            },
            "properties": {"feature_type": "Type III"},
        },
        {
            "type": "Feature",
            "id": 18,
            "geometry": {
                "type": "LineString",
                "coordinates": [[BEGIN_UNIX_S + 9e4, 900.0], [BEGIN_UNIX_S + 9.1e4, 300]],
            },
            "properties": {"feature_type": "Type III"},
        },
    ],
    "properties": {"facility_name": "Solar Orbiter"},
    "fields": {},
    "crs": {
        "type": "local",
        "properties": {
            "name": "Time-Frequency",
            "time_coords_id": "unix",
            "spectral_coords": {"type": "frequency", "unit": "kHz"},
            "ref_position_id": "stereo-a",
        },
    },
}

FILES = {
    "20120607events.txt": SWPC,
    "CME-2012.json": json.dumps(DONKI_CMES),
    "FLR-2012.json": json.dumps(DONKI_FLARES),
    "SEP-2012.json": json.dumps(DONKI_PARTICLES),
    "type3.tfcat": json.dumps(TFCAT),
}


def link_flare(catalogue: Catalogue, burst_id: str, near: datetime) -> None:
    """Publish a flare two minutes before a burst, linked to it, and a CME an hour later that is linked to nothing."""
    before, after = near - timedelta(minutes=2), near + timedelta(hours=1)
    flare = Event("DONKI:F", "flare", "DONKI", "F", "EARTH", before, before, size="C3.4", longitude_deg=62.0)
    cme = Event("DONKI:C", "cme", "DONKI", "C", "EARTH", after, after)
    held = ListRead("list.json", "read", "a" * 64, 2, 0, "", flare.start_utc, cme.start_utc, near, near)
    catalogue.events.replace(held, [flare, cme])
    catalogue.events.link(burst_id, [Link(flare, -120.0)])
