"""What every test shares: where the reference files are, and no network but the loopback."""

import atexit
import gc
import os
import shutil
import socket
import tempfile
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import Any

import hypothesis
import pytest

hypothesis.settings.register_profile("repeatable", derandomize=True, deadline=None, max_examples=50)
hypothesis.settings.load_profile("repeatable")
pytest_plugins = ["tests.fixtures_postgres"]

if "PREFECT_HOME" not in os.environ:
    os.environ["PREFECT_HOME"] = tempfile.mkdtemp(prefix="bella-prefect-")
    atexit.register(shutil.rmtree, os.environ["PREFECT_HOME"], ignore_errors=True)
# for what starts from here, the workers of `pytest -n` too: threads for matrices as small as these wait for one another
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# the first of these processes compiles the package for all others
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
REFERENCE_FILES = Path(os.environ.get("BELLA_REFERENCE_FILES", Path(__file__).parents[2] / "shared" / "data"))


LONG_FILES = [
    Path(__file__).parent / name
    for name in ("pipeline/test_run.py", "test_service_processes.py", "test_replay.py", "flows/test_run.py")
]
"""Files of few tests that take a minute or more each."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the files that take longest: at the end one of them would keep a worker while the others are idle."""
    assert all(path.is_file() for path in LONG_FILES), "a file was moved: name its new place"
    items.sort(key=lambda item: item.path not in LONG_FILES)


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, Any, Any]:
    """What is collected stays to the end: to look for garbage among it takes a quarter of the time of collecting."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


@pytest.fixture(scope="session")
def reference_files() -> Path:
    """Folder of real archive files; they are too large, or not ours, to be kept in the repository."""
    if not REFERENCE_FILES.is_dir():
        pytest.skip("no reference files: set BELLA_REFERENCE_FILES to the folder that holds them")
    return REFERENCE_FILES


@pytest.fixture(scope="session")
def empty_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A catalogue without rows, to be copied: that is quicker than to make one."""
    from bella.catalogue import Catalogue

    file = tmp_path_factory.mktemp("empty") / "catalogue.sqlite"
    Catalogue.open(f"sqlite:///{file}", create=True).close()
    return file


@pytest.fixture(autouse=True, scope="session")
def _loopback_only() -> Iterator[None]:
    """A test that reaches for the network fails where it does so."""
    connect = socket.socket.connect

    def guarded(self: socket.socket, address: Any) -> None:
        if self.family in {socket.AF_INET, socket.AF_INET6} and address[0] not in {"127.0.0.1", "::1", "localhost"}:
            raise OSError(f"a test tried to reach {address[0]}: only the loopback is allowed")
        connect(self, address)

    socket.socket.connect = guarded  # type: ignore[method-assign,assignment]
    yield
    socket.socket.connect = connect  # type: ignore[method-assign]
