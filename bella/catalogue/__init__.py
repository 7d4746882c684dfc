"""The catalogue in SQL: bursts, versioned solutions and leases of runs; the only importer of SQLAlchemy."""

from bella.catalogue.catalogue import Catalogue
from bella.catalogue.detections import UNSEARCHED
from bella.catalogue.leases import Lease
from bella.catalogue.observability import FleetMap, ObservedDay, ReceiverDay
from bella.catalogue.operation import Freshness, Latency, MockRun, Operation, SolutionTimes, Work
from bella.catalogue.records import (
    Burst,
    BurstPage,
    BurstQuery,
    BurstSummary,
    DayPage,
    DaySummary,
    Detection,
    Localisation,
    Preference,
    Publication,
    SearchedDay,
    Series,
    Solution,
    SourceFile,
    StageRun,
    StoredGroup,
    Submission,
    edge_rank,
)

__all__ = [
    "UNSEARCHED",
    "Burst",
    "BurstPage",
    "BurstQuery",
    "BurstSummary",
    "Catalogue",
    "DayPage",
    "DaySummary",
    "Detection",
    "FleetMap",
    "Freshness",
    "Latency",
    "Lease",
    "Localisation",
    "MockRun",
    "ObservedDay",
    "Operation",
    "Preference",
    "Publication",
    "ReceiverDay",
    "SearchedDay",
    "Series",
    "Solution",
    "SolutionTimes",
    "SourceFile",
    "StageRun",
    "StoredGroup",
    "Submission",
    "Work",
    "edge_rank",
]
