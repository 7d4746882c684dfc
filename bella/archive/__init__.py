"""Data sets of the archives, their listing and download, and the mirror: files, not their content."""

from bella.archive.datasets import COMPANIONS, DATASETS, Dataset, find_datasets
from bella.archive.download import FileVersion, MirrorFile, Received, received, set_aside, versions
from bella.archive.manners import Manners
from bella.archive.mirror import UNANSWERED, Archive, DayFiles, DayInMirror, fetch_days, open_archive, unanswered

__all__ = [
    "COMPANIONS",
    "DATASETS",
    "UNANSWERED",
    "Archive",
    "Dataset",
    "DayFiles",
    "DayInMirror",
    "FileVersion",
    "Manners",
    "MirrorFile",
    "Received",
    "fetch_days",
    "find_datasets",
    "open_archive",
    "received",
    "set_aside",
    "unanswered",
    "versions",
]
