"""Housekeeping of the store: sweep what killed runs have left, prune old draws, verify what was published.

Draws of superseded solutions are most of the store. What stays of them: arrival times, positions with their errors,
tracks, seeds and settings, from which the same draws can be made again.
"""

import re
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import structlog

from bella.bursts.event import EVENT
from bella.catalogue import Catalogue, Solution, StoredGroup
from bella.exceptions import BusyError, NoDataError, StoreError
from bella.pipeline.publication import store_group
from bella.settings import Settings
from bella.store import FOLDER, SUFFIX, content_sha256, open_group, open_tree, packed_folder, place_group, sweep

SWEEP = "sweep"
"""Stage under which the lease of the store is held."""

DRAWS = "draw"
"""Dimensions whose names begin so are those of draws."""

SPECTRA = re.compile(r"/spectra-([0-9a-f]{8})-[0-9a-f]{8}\.zarr\.zip$")
"""Name of the spectra of a burst: it begins with the first digits of their checksum."""

log = structlog.get_logger(__name__)


def sweep_store(catalogue: Catalogue, settings: Settings, run_id: str) -> list[str]:
    """Remove from the store what killed runs have left, unless another run is doing so.

    Returns
    -------
    list of str
        Removed paths.
    """
    try:
        with catalogue.lease(SWEEP, "store", run_id, settings.lease_s):
            referenced, in_use = catalogue.referenced_paths(), catalogue.held_subjects()
            return sweep(settings.store_root, referenced, settings.lease_s, in_use)
    except BusyError:
        return []


def has_event(catalogue: Catalogue) -> bool:
    """Whether the built-in event is published, and nothing of its solutions is to follow."""
    try:
        known = catalogue.burst(EVENT.burst_id).solutions
    except NoDataError:
        return False
    tracks = (catalogue.track_fit(one.solution_id) for one in known)
    return bool(known) and not any(one.get("companions_pending") for one in tracks)


@dataclass(frozen=True)
class Pruned:
    """A superseded solution without its draws."""

    solution_id: str
    draws: int


def prune(
    settings: Settings, older_than: timedelta, *, dry_run: bool = False, advance: Callable[[int], None] = lambda _: None
) -> tuple[Pruned, ...]:
    """Remove the draws of solutions that were superseded long ago; the next sweep of the store frees their room.

    Parameters
    ----------
    older_than : datetime.timedelta
        Since they were superseded.
    dry_run : bool
        True to change nothing.
    advance : callable
        Told 1 after each solution.

    Raises
    ------
    StoreError
        If a group cannot be read or written; what was pruned before it stays so.
    """
    with closing(Catalogue.open(settings.catalogue_url)) as catalogue:
        found = []
        for solution in catalogue.prunable(datetime.now(UTC) - older_than):
            found.append(_pruned(solution, catalogue, settings, dry_run=dry_run))
            advance(1)
    return tuple(found)


def _pruned(solution: Solution, catalogue: Catalogue, settings: Settings, *, dry_run: bool) -> Pruned:
    group = open_group(settings.store_root, solution.store_path)
    dimensions = [str(name) for name in group.dims if str(name).endswith(DRAWS)]
    draws = int(group.sizes.get(DRAWS, 0))
    if not dry_run:
        kept = group.drop_dims(dimensions).load()
        name = solution.store_path.removesuffix(SUFFIX)
        catalogue.note_pruned(solution.solution_id, *store_group(kept, settings, f"{name}-pruned"))
        log.info("draws pruned", solution_id=solution.solution_id, draws=draws)
    return Pruned(solution.solution_id, draws)


def pack(settings: Settings, advance: Callable[[int], None] = lambda _: None) -> int:
    """Make one file of each group that an older version has stored as a folder; the next sweep frees the folders.

    Parameters
    ----------
    advance : callable
        Told 1 after each group.

    Returns
    -------
    int
        Number of groups.

    Raises
    ------
    StoreError
        If one is damaged or cannot be written; those before it are packed.
    """
    root = settings.store_root
    with closing(Catalogue.open(settings.catalogue_url)) as catalogue:
        groups = [one for one in catalogue.stored_groups() if one.store_path.endswith(FOLDER)]
        for group in groups:
            path = f"{group.store_path.removesuffix(FOLDER)}{SUFFIX}"
            if not (root / path).exists():  # a pack that was killed may have placed it
                place_group(packed_folder(root, group.store_path), root, path)
            if damage := damage_of(replace(group, store_path=path), root):
                (root / path).unlink()  # the folder counts, once it was restored
                raise StoreError(damage)
            catalogue.note_packed(group.store_path, path)
            advance(1)
    return len(groups)


def damage_of(group: StoredGroup, root: Path) -> str:
    """What is wrong with a group; everything in it is read.

    Parameters
    ----------
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
