"""Whether a group that the catalogue refers to is in the store as it was published."""

import re
from pathlib import Path

from bella.catalogue import StoredGroup
from bella.exceptions import StoreError
from bella.store import content_sha256, open_group, open_tree

SPECTRA = re.compile(r"/spectra-([0-9a-f]{8})-[0-9a-f]{8}\.zarr$")
"""Name of the spectra of a burst: it begins with the first digits of their checksum."""


def damage_of(group: StoredGroup, root: Path) -> str:
    """What is wrong with a group; everything in it is read.

    Parameters
    ----------
    group : StoredGroup
    root : Path
        Of the store.

    Returns
    -------
    str
        Empty where it is whole.
    """
    try:
        if group.sha256 is not None:
            open_group(root, group.store_path, group.sha256)
            return ""
        named = SPECTRA.search(group.store_path)
        found = content_sha256(open_tree(root, group.store_path))
    except StoreError as error:
        return str(error)
    return "" if named is None or found.startswith(named[1]) else "its content is not what its name says"
