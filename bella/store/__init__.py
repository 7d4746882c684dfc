"""Immutable Zarr groups, each one ZIP file: posteriors and spectra on disk, and the only importer of zarr.

A group becomes visible in three steps, each of which may be the last one before a power cut: it is written under
``.staging`` and flushed, read back and compared with what was given, and renamed to a name that is never used again.
Only then does one commit in the catalogue refer to it. What no commit refers to is an orphan, and swept later.
"""

from bella.exceptions import require_extra

require_extra("zarr")

from bella.store.digest import content_sha256
from bella.store.layout import FOLDER, SUFFIX, flush_tree, place_group, sweep
from bella.store.reading import FORMAT_VERSION, file_of_group, open_group, open_tree
from bella.store.writing import copy_group, packed_folder, rounded_draws, stage_group, verify_group, write_group

__all__ = [
    "FOLDER",
    "FORMAT_VERSION",
    "SUFFIX",
    "content_sha256",
    "copy_group",
    "file_of_group",
    "flush_tree",
    "open_group",
    "open_tree",
    "packed_folder",
    "place_group",
    "rounded_draws",
    "stage_group",
    "sweep",
    "verify_group",
    "write_group",
]
