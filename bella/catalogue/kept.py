"""What was read before and is not read again: each item under a key that changes with it."""

from collections.abc import Callable, Iterable, Mapping
from threading import Lock
from typing import Generic, TypeVar

from cachetools import LRUCache

Key = TypeVar("Key")
Row = TypeVar("Row")
Item = TypeVar("Item")


class Kept(Generic[Key, Item]):
    """The items that were asked for last."""

    def __init__(self, most: int) -> None:
        self._kept: LRUCache = LRUCache(most)
        self._changing = Lock()

    def of(self, wanted: Mapping[Key, Row], read: Callable[[list[Row]], Iterable[Item]]) -> dict[Key, Item]:
        """Items by key; those that are not kept are read, in the order in which they are given."""
        with self._changing:
            found = {key: self._kept[key] for key in wanted if key in self._kept}
        missing = {key: row for key, row in wanted.items() if key not in found}
        new = dict(zip(missing, read(list(missing.values())), strict=True)) if missing else {}
        with self._changing:
            self._kept.update(new)
        return found | new
