"""What the tests of the archive share: a server on the loopback, a mirror, and time that costs nothing."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.archive.server import Clock, Server


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[Server]:
    monkeypatch.setenv("no_proxy", "127.0.0.1")
    with Server() as running:
        yield running


@pytest.fixture
def mirror(tmp_path: Path) -> Path:
    return tmp_path / "home" / "mirror"
