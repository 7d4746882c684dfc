"""Pruning: the draws of superseded solutions, which are most of the store, are removed after a while.

What stays of them: arrival times, positions with their errors, tracks, seeds and settings, from which the same draws
can be made again.
"""

from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

import structlog

from bella.catalogue import Catalogue, Solution
from bella.pipeline.publication import store_group
from bella.settings import Settings
from bella.store import open_group

DRAWS = "draw"
"""Dimensions whose names begin so are those of draws."""

log = structlog.get_logger(__name__)


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
    settings : Settings
    older_than : datetime.timedelta
        Since they were superseded.
    dry_run : bool
        True to change nothing.
    advance : callable
        Told 1 after each solution.

    Returns
    -------
    tuple of Pruned

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
        name = solution.store_path.removesuffix(".zarr")
        catalogue.note_pruned(solution.solution_id, *store_group(kept, settings, f"{name}-pruned"))
        log.info("draws pruned", solution_id=solution.solution_id, draws=draws)
    return Pruned(solution.solution_id, draws)
