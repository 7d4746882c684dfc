"""The catalogue in SQL: bursts, versioned solutions and leases of runs; the only importer of SQLAlchemy."""

from bella.catalogue.catalogue import Catalogue
from bella.catalogue.detections import UNSEARCHED
from bella.catalogue.leases import Lease
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
    "Lease",
    "Localisation",
    "Preference",
    "Publication",
    "SearchedDay",
    "Series",
    "Solution",
    "SourceFile",
    "StageRun",
    "StoredGroup",
    "Submission",
    "edge_rank",
]
