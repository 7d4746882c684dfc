"""From a file that is visible to the track that is served, with all services: ``python -m benchmarks.latency``.

Files of simulated days of three spacecraft are put into the mirror as the fetcher does it. PostgreSQL, Prefect, the
worker and the API run as in ``docker-compose.yml``, and the API is asked until it serves a track of the day: once while
nothing else is to be done, after the first runs of the worker, and once beside a backfill of whole days.
"""

import argparse
import json
import shutil
import signal
import statistics
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from datetime import UTC, date, datetime, timedelta
from pathlib import Path
from typing import Any

import httpx
import numpy as np

from bella.catalogue import Catalogue
from bella.pipeline.burst import Begun, Choice, continue_burst
from bella.pipeline.day import search_day
from bella.pipeline.day_files import Mirror
from bella.pipeline.housekeeping import has_event
from bella.pipeline.run import begin_found
from bella.pipeline.workers import prepare
from bella.records import Origin
from bella.settings import Settings
from benchmarks.replay import DAY, Plan, simulate
from benchmarks.services import Services

DATASETS = ("WI_K0_WAV", "STEREO_LEVEL2_SWAVES", "SOLO_L3_RPW-TNR-SURV-FLUX", "SOLO_L3_RPW-HFR-SURV-FLUX")
LAST_DAY = date(2026, 8, 10)
"""Near the end of the packaged positions of STEREO-A."""

MOST_S, POLL_S, WORKERS = 3600.0, 0.5, 2
"""Longest wait for a track, time between two requests, s; and workers, as many as ``docker-compose.yml`` has."""


def arrive(files: Sequence[Path], source: Path, mirror: Path) -> None:
    """Put files into the mirror, each whole."""
    for path in files:
        target = mirror / path
        target.parent.mkdir(parents=True, exist_ok=True)
        staged = target.with_name(f".{path.name}.staged")
        shutil.copyfile(source / path, staged)
        staged.replace(target)


def served_s(services: Services, day: date) -> float | None:
    """Time until the API serves a solution for a burst of a day, s; None where the day has none."""
    begin, url = time.monotonic(), f"http://127.0.0.1:{services.ports['api']}/api/v1/bursts"
    with closing(Catalogue.open(services.environment["BELLA_DATABASE_URL"])) as catalogue:
        while time.monotonic() - begin < MOST_S:
            is_done = catalogue.searched_day(day, (Origin.SIMULATED,)) is not None
            reply = httpx.get(url, params={"origin": "simulated", "limit": 1000}, trust_env=False, timeout=60)
            bursts = reply.json()["bursts"] if reply.status_code == 200 else []
            if any(one["solutions"] for one in bursts if one["start_utc"][:10] == f"{day}"):
                return time.monotonic() - begin
            if is_done:
                return None
            time.sleep(POLL_S)
    raise RuntimeError(f"nothing became of {day} in {MOST_S:g} s: see {services.folder / 'log'}")


def wait_for_rest(services: Services) -> None:
    """Wait until the first runs of the worker are over: the built-in event, and the first mock burst."""
    begin = time.monotonic()
    with closing(Catalogue.open(services.environment["BELLA_DATABASE_URL"])) as catalogue:
        while not (has_event(catalogue) and catalogue.operation.last_mock()):
            if time.monotonic() - begin > MOST_S:
                raise RuntimeError(f"the worker does not come to rest: see {services.folder / 'log'}")
            time.sleep(POLL_S)


def measure(days: int, backfill: int, folder: Path) -> dict[str, Any]:
    """Latency, quiet and beside a backfill.

    Parameters
    ----------
    days, backfill : int
        Of each kind; the days of the backfill are visible at once.
    folder : pathlib.Path
        Empty; everything is written there.

    Returns
    -------
    dict
        Ready for JSON.
    """
    first = LAST_DAY - (2 * days + backfill - 1) * DAY
    plan = Plan(2 * days + backfill, 0, 1, datasets=DATASETS, first=first)
    written = simulate(folder / "simulated", plan)
    home = folder / "home"
    home.mkdir()
    settings = Settings(home=home)
    recent = (datetime.now(UTC).date() - first) // timedelta(days=1)
    found: dict[str, list[float | None]] = {}
    with Services(home, {"BELLA_RECENT_DAYS": f"{recent}", "BELLA_WORKERS": f"{WORKERS}"}) as services:
        services.start("worker")
        wait_for_rest(services)
        for name, wanted in (("quiet", plan.all_days[:days]), ("beside a backfill", plan.all_days[days : 2 * days])):
            if name != "quiet":
                for day in plan.all_days[2 * days :]:
                    arrive([path for _, path in written[day]], folder / "simulated", settings.mirror_root)
            for day in wanted:
                arrive([path for _, path in written[day]], folder / "simulated", settings.mirror_root)
                found.setdefault(name, []).append(served_s(services, day))
    return {name: _summary(values) for name, values in found.items()}


def steps_cpu_s(folder: Path) -> dict[str, float]:
    """CPU time of each step of one day that is processed after another, s: says something on a busy machine too.

    Parameters
    ----------
    folder : pathlib.Path
        Empty; everything is written there.

    Returns
    -------
    dict of str to float
        By step.
    """
    plan = Plan(2, 0, 1, datasets=DATASETS, first=LAST_DAY - DAY)
    written, settings = simulate(folder / "simulated", plan), Settings(home=folder / "home")
    prepare(settings)
    for day in plan.all_days:
        found: dict[str, float] = {}
        arrive([path for _, path in written[day]], folder / "simulated", settings.mirror_root)
        files = Mirror(settings).day(day)
        searched = _timed(found, "search", search_day, files, ())
        (burst,) = [one for one in searched.bursts if one.edges]
        begun = _timed(found, "first solution", begin_found, files, burst, Choice(), settings, "cpu")
        while isinstance(begun, Begun):
            begun = _timed(found, "other edges, comparisons, figures", continue_burst, begun, settings, "cpu")
    return found


def _timed(found: dict[str, float], name: str, function: Callable[..., Any], *arguments: Any) -> Any:
    begin = time.process_time()
    result = function(*arguments)
    found[name] = round(found.get(name, 0.0) + time.process_time() - begin, 2)
    return result


def _summary(values: Sequence[float | None]) -> dict[str, Any]:
    served = [one for one in values if one is not None]
    found: dict[str, Any] = {"days": len(values), "with a track": len(served)}
    if served:
        found["median_s"] = round(statistics.median(served), 1)
        found["p98_s"] = round(float(np.quantile(served, 0.98)), 1)
    return found


def main() -> None:
    """Print the latencies."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.latency", description=__doc__)
    parser.add_argument("--days", type=int, default=10, help="days measured, quiet and beside a backfill")
    parser.add_argument("--backfill", type=int, default=30, help="days of the backfill")
    parser.add_argument("--cpu", action="store_true", help="only the CPU time of each step of a day")
    given = parser.parse_args()
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # the services end with it
    with tempfile.TemporaryDirectory(prefix="bella-latency-", ignore_cleanup_errors=True) as folder:
        place = Path(folder)
        found = steps_cpu_s(place) if given.cpu else measure(given.days, given.backfill, place)
        print(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
