"""A run that stages, verifies, places and commits one solution, and can be told where to be killed.

Run as ``python -m tests.catalogue.publisher HOME URL STEP [HOME URL STEP ...]``: each in a process of its own, which is
killed right after STEP, or never for "none". What they ended with, as `subprocess` has it, is the last line it writes.
"""

import os
import signal
import sys
import uuid
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any, cast

from sqlalchemy import Engine, event

import bella.store.writing
from bella.catalogue import Catalogue, Solution
from bella.store import place_group, stage_group, verify_group
from tests.catalogue.examples import SERIES, publication
from tests.store.examples import posterior

STEPS = ("lease", "half written", "not flushed", "stage", "verify", "place", "before commit", "commit")
BURST = "T3-20120607-1929"


def die(*_: Any) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def arm(step: str) -> Callable[[str], None]:
    """Arrange to be killed inside a step, and give back what kills after one."""
    if step == "half written":
        _die_in_the_middle_of_writing()
    if step == "not flushed":
        bella.store.writing.flush = die

    def after(done: str) -> None:
        if done == step:
            die()
        if (done, step) == ("place", "before commit"):
            # transactions that only read commit as well
            event.listen(Engine, "commit", lambda connection: die() if _has_solution(connection) else None)

    return after


def _die_in_the_middle_of_writing() -> None:
    put = zipfile.ZipFile.writestr
    chunks: list[str] = []

    def writestr(self: zipfile.ZipFile, name: zipfile.ZipInfo, *given: Any) -> None:
        put(self, name, *given)
        chunks.append(name.filename)
        if len([one for one in chunks if not one.endswith("zarr.json")]) == 4:
            cast("IO[bytes]", self.fp).flush()
            die()

    zipfile.ZipFile.writestr = writestr  # type: ignore[method-assign, assignment]


def _has_solution(connection: Any) -> bool:
    return bool(connection.exec_driver_sql("SELECT count(*) FROM solution").scalar_one())


def run(home: Path, database_url: str, step: str = "none") -> Solution:
    """One run, the way a flow does it: what is published already is not made again."""
    done = arm(step)
    root = home / "store"
    with (
        Catalogue.open(database_url, create=True) as catalogue,
        catalogue.lease("localise", BURST, uuid.uuid4().hex, 600),
    ):
        done("lease")
        found = catalogue.find_solution(BURST, SERIES, "h1", "0.1.0")
        if found:
            return found
        group = posterior()
        staged = stage_group(group, root)
        done("stage")
        sha256 = verify_group(staged, group)
        done("verify")
        path = place_group(staged, root, f"{BURST}/{uuid.uuid4().hex}.zarr.zip")
        done("place")
        solution = catalogue.publish(publication("h1", store_path=path, store_sha256=sha256))
        done("commit")
        return solution


def fork(home: str, database_url: str, step: str) -> int:
    """Run in a process that has imported everything already, and say how it ended."""
    child = os.fork()
    if not child:
        run(Path(home), database_url, step)
        os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


if __name__ == "__main__":
    codes = [fork(*sys.argv[at : at + 3]) for at in range(1, len(sys.argv), 3)]
    sys.stdout.write(" ".join(map(str, codes)))
