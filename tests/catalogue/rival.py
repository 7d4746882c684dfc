"""A process that does to a catalogue what it is told, line by line, so that several can be told at once."""

import json
import sys
from datetime import UTC, date, datetime
from typing import Any

import structlog

from bella.catalogue import Catalogue, submission_name
from bella.catalogue.leases import acquire
from bella.exceptions import BellaError
from tests.catalogue.examples import publication


def create(url: str) -> str:
    with Catalogue.open(url, create=True) as catalogue:
        return catalogue.revision()


def take(url: str, subject: str, run_id: str) -> str:
    with Catalogue.open(url) as catalogue:
        return acquire(catalogue._engine, "localise", subject, run_id, 600.0).token


def publish(url: str, hashes: list[str]) -> list[str]:
    with Catalogue.open(url) as catalogue:
        return [catalogue.publish(publication(one, store_path=_unique_path())).solution_id for one in hashes]


def submit(url: str, sha256: str) -> str:
    with Catalogue.open(url) as catalogue:
        return catalogue.submit("ann", sha256, submission_name(date(2012, 6, 7))).state


def _unique_path() -> str:
    return f"T3-20120607-1929/{datetime.now(UTC).timestamp():.6f}-{id(object())}-{_name()}.zarr.zip"


def _name() -> str:
    return sys.argv[1]


def answer(line: str) -> dict[str, Any]:
    order = json.loads(line)
    act = {"create": create, "take": take, "publish": publish, "submit": submit}[order.pop("do")]
    try:
        return {"result": act(**order)}
    except BellaError as error:
        return {"error": type(error).__name__, "message": str(error)}


def main() -> None:
    # stdout is for the answers
    structlog.configure(logger_factory=structlog.PrintLoggerFactory(sys.stderr))
    for line in sys.stdin:
        sys.stdout.write(json.dumps(answer(line)) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
