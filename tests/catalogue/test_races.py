"""Several real processes at once on one catalogue: one result, whoever is faster."""

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from bella.catalogue import BurstQuery, Catalogue
from bella.exceptions import BusyError
from tests.catalogue.examples import SERIES

REPOSITORY = Path(__file__).parents[2]
AtOnce = Callable[..., list[dict[str, Any]]]


def start_rival(name: str) -> "subprocess.Popen[str]":
    command = [sys.executable, "-m", "tests.catalogue.rival", name]
    return subprocess.Popen(
        command, cwd=REPOSITORY, text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    )


def tell(rival: "subprocess.Popen[str]", order: dict[str, Any]) -> None:
    assert rival.stdin is not None
    rival.stdin.write(json.dumps(order) + "\n")
    rival.stdin.flush()


def hear(rival: "subprocess.Popen[str]") -> dict[str, Any]:
    assert rival.stdout is not None
    return dict(json.loads(rival.stdout.readline()))


@pytest.fixture(scope="module")
def at_once() -> Iterator[AtOnce]:
    """Tell three processes the same, each with its own changes, before listening to any."""
    rivals = [start_rival(str(number)) for number in range(3)]

    def everyone(orders: list[dict[str, Any]]) -> list[dict[str, Any]]:
        for rival, order in zip(rivals, orders, strict=True):
            tell(rival, order)
        return [hear(rival) for rival in rivals]

    yield everyone
    for rival in rivals:
        rival.communicate()


def test_processes_that_start_at_once_all_find_a_catalogue(at_once: AtOnce, database_url: str) -> None:
    answers = at_once([{"do": "create", "url": database_url}] * 3)
    newest = max(one.name[:4] for one in (REPOSITORY / "migrations" / "versions").glob("0*.py"))
    assert answers == [{"result": newest}] * 3
    with Catalogue.open(database_url) as catalogue:
        assert catalogue.bursts(BurstQuery()).total == 0


def test_one_of_three_gets_a_lease(at_once: AtOnce, catalogue: Catalogue, catalogue_url: str) -> None:
    for subject in (f"T3-{number}" for number in range(10)):
        orders = [{"do": "take", "url": catalogue_url, "subject": subject, "run_id": f"run{n}"} for n in range(3)]
        answers = at_once(orders)
        assert sorted(one.get("error", "has it") for one in answers) == ["BusyError", "BusyError", "has it"]


def test_one_of_three_inherits_the_lease_of_a_killed_process(
    at_once: AtOnce, catalogue: Catalogue, catalogue_url: str
) -> None:
    victim = start_rival("victim")
    for number in range(5):
        order = {"do": "take", "url": catalogue_url, "subject": f"T3-{number}", "run_id": "killed"}
        tell(victim, order)
        assert "result" in hear(victim)
    with pytest.raises(BusyError, match="run killed"), catalogue.lease("localise", "T3-0", "early", 60.0):
        pass
    victim.kill()
    victim.communicate()
    for number in range(5):
        orders = [
            {"do": "take", "url": catalogue_url, "subject": f"T3-{number}", "run_id": f"run{n}"} for n in range(3)
        ]
        assert sorted(one.get("error", "has it") for one in at_once(orders)) == ["BusyError", "BusyError", "has it"]
    assert {one.attempts for one in catalogue.stage_runs(10)} == {2}


@pytest.mark.parametrize("backend", ["sqlite"])
def test_a_zombie_is_dead(catalogue: Catalogue, catalogue_url: str) -> None:
    victim = start_rival("victim")
    tell(victim, {"do": "take", "url": catalogue_url, "subject": "T3-1", "run_id": "killed"})
    hear(victim)
    victim.kill()
    # dead but not reaped, as under a parent that does not look after its children
    os.waitid(os.P_PID, victim.pid, os.WEXITED | os.WNOWAIT)
    assert Path(f"/proc/{victim.pid}").exists()
    try:
        with catalogue.lease("localise", "T3-1", "next", 60.0) as lease:
            assert lease.attempt == 2
    finally:
        victim.communicate()


def test_versions_of_concurrent_publishers_are_consecutive(
    at_once: AtOnce, catalogue: Catalogue, catalogue_url: str
) -> None:
    orders = [{"do": "publish", "url": catalogue_url, "hashes": [f"{n}-{i}" for i in range(6)]} for n in range(3)]
    answers = at_once(orders)
    published = [solution_id for one in answers for solution_id in one["result"]]
    versions = catalogue.versions("T3-20120607-1929")
    assert sorted(published) == sorted(one.solution_id for one in versions)
    assert [one.version for one in versions] == list(range(18, 0, -1))
    earlier = [one.solution_id for one in versions[1:]]
    assert [one.supersedes for one in versions] == [*earlier, None]
    assert all(len(catalogue.localisations(one)) == 2 for one in published)


def test_the_same_solution_is_published_once(at_once: AtOnce, catalogue: Catalogue, catalogue_url: str) -> None:
    answers = at_once([{"do": "publish", "url": catalogue_url, "hashes": ["same"] * 4}] * 3)
    assert [one["result"] for one in answers] == [[answers[0]["result"][0]] * 4] * 3
    (only,) = catalogue.versions("T3-20120607-1929")
    assert (only.version, only.series) == (1, SERIES)
    assert catalogue.referenced_paths() == {only.store_path}


def test_a_table_handed_in_three_times_at_once_is_one_submission(
    at_once: AtOnce, catalogue: Catalogue, catalogue_url: str
) -> None:
    answers = at_once([{"do": "submit", "url": catalogue_url, "sha256": "ee" * 32}] * 3)
    assert answers == [{"result": "received"}] * 3
    assert [one.sha256 for one in catalogue.pending_submissions()] == ["ee" * 32]
