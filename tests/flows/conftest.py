from pathlib import Path
from subprocess import CompletedProcess

import pytest

from tests.commands import Sandbox


@pytest.fixture(scope="session")
def first_run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Sandbox, "CompletedProcess[str]"]:
    """The built-in event, run once with Prefect by a user who has nothing yet."""
    sandbox = Sandbox.within(tmp_path_factory.mktemp("first"))
    return sandbox, sandbox.bella("run")


@pytest.fixture(scope="session")
def direct_run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Sandbox, "CompletedProcess[str]"]:
    """The same without Prefect."""
    sandbox = Sandbox.within(tmp_path_factory.mktemp("direct"))
    return sandbox, sandbox.bella("run", "--direct")


@pytest.fixture(scope="session")
def run_as_published(tmp_path_factory: pytest.TempPathFactory) -> Sandbox:
    """The built-in event with the errors and the speed that the code of the paper had."""
    sandbox = Sandbox.within(tmp_path_factory.mktemp("published"))
    sandbox.bella("run", "--direct", "--preset", "bella-2024")
    return sandbox


@pytest.fixture
def sandbox(tmp_path: Path) -> Sandbox:
    return Sandbox.within(tmp_path)
