from pathlib import Path

import pytest

from tests.commands import Sandbox


@pytest.fixture
def sandbox(tmp_path: Path) -> Sandbox:
    return Sandbox.within(tmp_path)
