"""The catalogue in SQL: bursts, versioned solutions and leases of runs; the only importer of SQLAlchemy."""

from bella.catalogue.catalogue import Catalogue
from bella.catalogue.leases import Lease
from bella.catalogue.records import (
    Burst,
    BurstPage,
    BurstQuery,
    BurstSummary,
    Localisation,
    Publication,
    Series,
    Solution,
    SourceFile,
    StageRun,
    Submission,
)

__all__ = [
    "Burst",
    "BurstPage",
    "BurstQuery",
    "BurstSummary",
    "Catalogue",
    "Lease",
    "Localisation",
    "Publication",
    "Series",
    "Solution",
    "SourceFile",
    "StageRun",
    "Submission",
]
