"""The catalogue in SQL: bursts, versioned solutions and leases of runs; the only importer of SQLAlchemy."""

from bella.exceptions import require_extra

require_extra("sqlalchemy")

from bella.catalogue.catalogue import Catalogue
from bella.catalogue.detections import UNSEARCHED
from bella.catalogue.events import EventPage, EventQuery, KnownEvent, ListRead, PublishedEvents
from bella.catalogue.leases import Lease
from bella.catalogue.observability import FleetMap, ObservedDay, ReceiverDay
from bella.catalogue.operation import Freshness, Latency, MockRun, Operation, SolutionTimes, Work
from bella.catalogue.records import (
    BURST_SORTS,
    RANGES,
    Burst,
    BurstPage,
    BurstQuery,
    BurstSummary,
    DayPage,
    DaySummary,
    Delivery,
    Detection,
    Localisation,
    Preference,
    Publication,
    Retraction,
    SearchedDay,
    Series,
    Solution,
    SourceFile,
    StageRun,
    StoredGroup,
    Submission,
    Token,
    Webhook,
    edge_rank,
)
from bella.catalogue.submissions import ANONYMOUS, submission_name

__all__ = [
    "ANONYMOUS",
    "BURST_SORTS",
    "RANGES",
    "UNSEARCHED",
    "Burst",
    "BurstPage",
    "BurstQuery",
    "BurstSummary",
    "Catalogue",
    "DayPage",
    "DaySummary",
    "Delivery",
    "Detection",
    "EventPage",
    "EventQuery",
    "FleetMap",
    "Freshness",
    "KnownEvent",
    "Latency",
    "Lease",
    "ListRead",
    "Localisation",
    "MockRun",
    "ObservedDay",
    "Operation",
    "Preference",
    "Publication",
    "PublishedEvents",
    "ReceiverDay",
    "Retraction",
    "SearchedDay",
    "Series",
    "Solution",
    "SolutionTimes",
    "SourceFile",
    "StageRun",
    "StoredGroup",
    "Submission",
    "Token",
    "Webhook",
    "Work",
    "edge_rank",
    "submission_name",
]
