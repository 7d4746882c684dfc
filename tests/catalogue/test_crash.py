"""A run killed between any two steps shows nothing half, and the next run finishes what it began."""

import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
import xarray as xr

from bella.catalogue import BurstQuery, Catalogue
from bella.exceptions import StoreError
from bella.store import open_group, sweep
from tests.catalogue.publisher import BURST, STEPS, run
from tests.fixtures_postgres import postgres_database
from tests.store.examples import posterior

REPOSITORY = Path(__file__).parents[2]
# on a server only the steps differ that touch it
HALF_WRITTEN = ("half written", "opened")
CASES = [*((step, "sqlite") for step in STEPS), ("lease", "postgresql"), ("before commit", "postgresql")]
Killed = dict[tuple[str, str], tuple[Path, str]]


def killed_runs(*runs: tuple[Path, str, str]) -> list[int]:
    """How runs ended that were to be killed, one after the other."""
    words = [str(word) for one in runs for word in one]
    command = [sys.executable, "-m", "tests.catalogue.publisher", *words]
    ended = subprocess.run(command, cwd=REPOSITORY, capture_output=True, check=True, text=True)
    return [int(code) for code in ended.stdout.splitlines()[-1].split()]


@pytest.fixture(scope="module")
def killed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Killed]:
    """Homes of runs that were killed, each after another step."""
    with ExitStack() as databases:
        homes: Killed = {}
        for step, backend in (*CASES, HALF_WRITTEN):
            home = tmp_path_factory.mktemp("home")
            url = f"sqlite:///{home / 'catalogue.sqlite'}"
            if backend == "postgresql":
                url = databases.enter_context(postgres_database())
            homes[step, backend] = home, url
        codes = killed_runs(*((*home, case[0]) for case, home in homes.items()))
        assert codes == [-signal.SIGKILL] * len(homes)
        yield homes


@pytest.mark.parametrize("case", CASES, ids="-".join)
def test_a_killed_run_shows_all_or_nothing_and_the_next_finishes(killed: Killed, case: tuple[str, str]) -> None:
    home, url = killed[case]
    committed = case[0] == "commit"
    with Catalogue.open(url) as catalogue:
        assert catalogue.bursts(BurstQuery()).total == int(committed)
        assert len(catalogue.referenced_paths()) == int(committed)
        assert [one.state for one in catalogue.stage_runs()] == ["running"]

    solution = run(home, url)

    with Catalogue.open(url) as catalogue:
        assert catalogue.versions(BURST) == (solution,)
        assert solution.version == 1
        assert len(catalogue.localisations(solution.solution_id)) == 2
        (stage,) = catalogue.stage_runs()
        assert (stage.state, stage.attempts) == ("done", 2)
        referenced = catalogue.referenced_paths()
    check_sweep(home / "store", referenced, orphans=int(case[0] not in {"lease", "commit"}))
    xr.testing.assert_identical(open_group(home / "store", solution.store_path, solution.store_sha256), posterior())
    assert run(home, url) == solution


def check_sweep(root: Path, referenced: frozenset[str], orphans: int) -> None:
    assert sweep(root, referenced, older_than_s=3600.0) == []
    assert len(sweep(root, referenced, older_than_s=0.0)) == orphans
    assert {one.relative_to(root).as_posix() for one in root.rglob("*.zarr.zip")} == referenced


def test_a_half_written_group_would_not_even_open(killed: Killed) -> None:
    home, _ = killed[HALF_WRITTEN]
    (staged,) = (home / "store" / ".staging").iterdir()
    assert staged.stat().st_size > 0
    staged.rename(home / "store" / "placed_by_hand.zarr.zip")
    with pytest.raises(StoreError):
        open_group(home / "store", "placed_by_hand.zarr.zip")
