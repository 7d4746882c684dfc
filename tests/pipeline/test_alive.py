"""Links of the chain whose limit no other test meets."""

import pytest

from bella.pipeline.alive import Disk, _disk


@pytest.mark.parametrize(("free_bytes", "state"), [(1_000_000_000, "ok"), (999_999_999, "stale")])
def test_less_than_a_gigabyte_is_too_little(free_bytes: int, state: str) -> None:
    assert _disk(Disk(10**12, free_bytes)).state == state
