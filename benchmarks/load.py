"""The API under load with a million localisations: ``python -m benchmarks.load``.

Fills a catalogue with copies of one real burst, starts the service as an operator does, and asks it: first one kind of
request after another, for the CPU time of each, that of the database included; then all kinds mixed, a fixed number a
second whether or not the service keeps up, for latencies and lost requests. Where other programs use the machine, the
CPU times are the figures that hold.
"""

import argparse
import asyncio
import random
import shutil
import signal
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path

import aiohttp
import httpx
import numpy as np
import psutil
from rich.console import Console
from rich.table import Table
from yarl import URL

from bella.settings import Settings
from benchmarks import history
from benchmarks.large_catalogue import LOCALISATIONS, SERIES, Large, fill, make_template
from benchmarks.localisation import Row
from benchmarks.services import Services

RATE_HZ, REQUESTS, ALONE = 100.0, 6000, 60
MOST_WAITING = 2000
"""Requests that may be under way: more, and the rest is not sent, and counts as lost."""

TIMEOUT_S = 30.0


@dataclass(frozen=True)
class Kind:
    """A kind of request.

    Attributes
    ----------
    name : str
    share : int
        Of 100 requests, about so many.
    address : callable
        Path and query of one, made with a random generator.
    headers : dict of str to str
        Beside those of every request.
    is_known : bool
        Whether the client has the reply already and sends its entity tag.
    """

    name: str
    share: int
    address: Callable[[random.Random], str]
    headers: tuple[tuple[str, str], ...] = ()
    is_known: bool = False


FILTERS = (
    "grade=A",
    "grade=AB&sort=-wind",
    "observatory=WIND&observatory=STEREO-A",
    "longitude_min=-30&longitude_max=30",
    "longitude_min=20&longitude_max=60&grade=AB",
    "distance_max=80&sort=distance",
    "wind_min=350&wind_max=450&sort=-updated",
    "without_flag=speed_not_constrained",
    "area_max=50&sort=area",
    "frequency_min=1&frequency_max=5&sort=longitude",
    "edge=shared_profile&tier=final&sort=grade",
)
"""What users ask a list for."""

STATIC = ("/static/bella.css", "/static/page.js", "/static/favicon.svg")


def kinds(made: Large) -> list[Kind]:
    """What is asked for, as people and scripts do."""

    def _burst(rest: str, root: str = "/api/v1/bursts/") -> Callable[[random.Random], str]:
        return lambda rng: f"{root}{rng.choice(made.burst_ids)}{rest}"

    def _days(start: str, length: int, more: str = "") -> Callable[[random.Random], str]:
        def _address(rng: random.Random) -> str:
            first = rng.choice(made.days)
            return f"{start}{first}T00:00:00Z&stop={first + timedelta(days=length)}T00:00:00Z{more}"

        return _address

    def _one_of(*paths: str) -> Callable[[random.Random], str]:
        return lambda rng: rng.choice(paths)

    lists = [f"/api/v1/bursts?{one}" for one in FILTERS]
    solution = f".{SERIES[0]}.posterior.default.2d.v1"
    hapi = "/hapi/data?dataset="
    return [
        Kind("bursts, newest 50", 8, _one_of("/api/v1/bursts")),
        Kind("bursts, newest 100", 4, _one_of("/api/v1/bursts?limit=100")),
        Kind("bursts, filtered", 14, _one_of(*lists)),
        Kind("bursts of a month", 4, _days("/api/v1/bursts?start=", 30)),
        Kind("bursts of a month, CSV", 2, _days("/api/v1/bursts?start=", 30, "&format=csv")),
        Kind("bursts, newest 50, known", 4, _one_of("/api/v1/bursts"), is_known=True),
        Kind("newest burst", 2, _one_of("/api/v1/bursts/latest")),
        Kind("burst", 12, _burst("")),
        Kind("burst, known", 3, _burst(""), is_known=True),
        Kind("versions", 1, _burst("/versions")),
        Kind("track", 10, _burst("/track")),
        Kind("track, CSV", 3, _burst("/track?format=csv")),
        Kind("posterior, summary", 2, _burst("/posterior")),
        Kind("posterior, chunk", 3, _burst(f"{solution}/posterior.zarr/zarr.json", "/api/v1/solutions/")),
        Kind("solution", 2, _burst(solution, "/api/v1/solutions/")),
        Kind("tracks of a month", 2, _days("/api/v1/tracks?start=", 30)),
        Kind("localisations of a day", 1, _days("/api/v1/localisations?start=", 1)),
        Kind("detections of a day", 3, _days("/api/v1/detections?start=", 1)),
        Kind("days", 1, _one_of("/api/v1/days")),
        Kind("alerts", 2, lambda rng: f"/api/v1/alerts?after={rng.randrange(len(made.burst_ids))}&limit=20"),
        Kind("HAPI info", 1, _one_of("/hapi/info?dataset=bursts", "/hapi/info?dataset=tracks", "/hapi/catalog")),
        Kind("HAPI bursts of a month", 2, _days(f"{hapi}bursts&start=", 30)),
        Kind("HAPI localisations of a day", 2, _days(f"{hapi}localisations&start=", 1)),
        Kind("page: bursts", 5, _one_of("/")),
        Kind("page: bursts, filtered", 2, _one_of(*(f"/?{one}" for one in FILTERS))),
        Kind("page: burst", 5, _burst("", "/bursts/")),
        Kind("page: day", 3, lambda rng: f"/days/{rng.choice(made.days)}"),
        Kind("page: days", 1, _one_of("/days")),
        Kind("figure", 2, _burst("/figures/constellation.svg")),
        Kind("static file", 10, _one_of(*STATIC)),
        Kind("static file, known", 4, _one_of(*STATIC), is_known=True),
    ]


@dataclass(frozen=True)
class Served:
    """A service that is asked: its address, and the processes that answer."""

    url: str
    roots: tuple[int, ...]

    def cpu_s(self) -> float:
        """CPU time of its processes, those of the database and those that have ended included, s."""
        return sum(_cpu_s(one) for one in self.roots)


def _cpu_s(root: int) -> float:
    total, parent = 0.0, psutil.Process(root)
    ended = parent.cpu_times()
    total += ended.children_user + ended.children_system
    for process in (parent, *parent.children(recursive=True)):
        used = process.cpu_times()
        total += used.user + used.system
    return total


@contextmanager
def served(home: Path, template: Path, localisations: int, *, postgres: bool) -> Iterator[tuple[Served, Large]]:
    """A filled catalogue and the service before it."""
    names = ("database", "api") if postgres else ("api",)
    home.mkdir()
    with Services(home, names=("database",) if postgres else (), api_processes=2) as services:
        url = services.environment.get("BELLA_DATABASE_URL")
        made = fill(Settings(home=home, database_url=url), template, localisations)
        print(f"{made.localisations} localisations of {len(made.burst_ids)} bursts")
        services.start("api")
        roots = tuple(services.process_id(name) for name in names)
        yield Served(f"http://127.0.0.1:{services.ports['api']}", roots), made


def alone(service: Served, some: Sequence[Kind], number: int, seed: int) -> dict[str, tuple[float, float, float]]:
    """Ask for one kind after another; of each CPU time and median latency of a request, ms, and its size, kB."""
    found = {}
    with httpx.Client(base_url=service.url, timeout=TIMEOUT_S, trust_env=False) as client:
        for kind in some:
            rng = random.Random(seed)
            addresses = [kind.address(rng) for _ in range(number)]
            tags = {one: client.get(one).headers.get("etag", "") for one in addresses[: number if kind.is_known else 3]}
            begin_s, times, sizes = service.cpu_s(), [], []
            for address in addresses:
                headers = {"If-None-Match": tags[address]} if kind.is_known else {}
                begin = time.perf_counter()
                with client.stream("GET", address, headers=headers) as reply:
                    sizes.append(sum(map(len, reply.iter_raw())))
                times.append(time.perf_counter() - begin)
                if reply.status_code != (304 if kind.is_known else 200):
                    raise RuntimeError(f"{address}: {reply.status_code}")
            used_ms = 1e3 * (service.cpu_s() - begin_s) / number
            found[kind.name] = (used_ms, 1e3 * statistics.median(times), statistics.mean(sizes) / 1e3)
    return found


@dataclass
class Mixed:
    """What became of requests of all kinds: latencies of each kind, s, how many were not sent, and not answered."""

    latencies_s: dict[str, list[float]]
    lost: int
    refused: int
    cpu_ms: float
    own_cpu_ms: float


async def mixed(service: Served, some: Sequence[Kind], requests: int, rate_hz: float, seed: int) -> Mixed:
    """Send requests at a fixed rate, each when its time has come, whatever became of those before."""
    rng, latencies, lost = random.Random(seed), {one.name: [] for one in some}, 0
    refused = 0
    tags: dict[str, str] = {}
    waiting: set[asyncio.Task[None]] = set()
    # the time of the generator counts, too: replies are taken as they come
    connector, timeout = aiohttp.TCPConnector(limit=200), aiohttp.ClientTimeout(TIMEOUT_S)
    async with aiohttp.ClientSession(
        service.url, connector=connector, timeout=timeout, auto_decompress=False, trust_env=False
    ) as client:

        async def _ask(kind: Kind, due_s: float) -> None:
            nonlocal refused
            address = kind.address(rng)
            headers = {"If-None-Match": tags[address]} if kind.is_known and address in tags else {}
            try:
                async with client.get(URL(address, encoded=True), headers=headers) as reply:
                    await reply.read()
                good = reply.status in {200, 304}
                tags.setdefault(address, reply.headers.get("etag", ""))
            except (aiohttp.ClientError, TimeoutError):
                good = False
            refused += not good
            latencies[kind.name].append(time.perf_counter() - due_s)

        begin, begin_s, own_s = time.perf_counter(), service.cpu_s(), time.process_time()
        for number, kind in enumerate(rng.choices(some, [one.share for one in some], k=requests)):
            due_s = begin + number / rate_hz
            await asyncio.sleep(max(0.0, due_s - time.perf_counter()))
            if len(waiting) >= MOST_WAITING:
                lost += 1
                continue
            task = asyncio.create_task(_ask(kind, due_s))
            waiting.add(task)
            task.add_done_callback(waiting.discard)
        await asyncio.gather(*waiting)
    used = service.cpu_s() - begin_s
    return Mixed(latencies, lost, refused, 1e3 * used / requests, 1e3 * (time.process_time() - own_s) / requests)


def report(name: str, some: Sequence[Kind], cpu: dict[str, tuple[float, float, float]], found: Mixed) -> list[Row]:
    """Print what was measured on one database; rows for the history of all figures."""
    table = Table(title=name)
    columns = ("request", "share", "CPU, ms", "alone, ms", "kB", "p50, ms", "p99, ms")
    for column in columns:
        table.add_column(column, justify="left" if column == "request" else "right")
    for kind in sorted(some, key=lambda one: -one.share * cpu[one.name][0]):
        used_ms, alone_ms, size_kb = cpu[kind.name]
        times = 1e3 * np.array(found.latencies_s[kind.name] or [np.nan])
        cells = (used_ms, alone_ms, size_kb, *np.percentile(times, (50, 99)))
        table.add_row(kind.name, f"{kind.share}", *(f"{one:.1f}" for one in cells))
    times = 1e3 * np.concatenate([*map(np.array, found.latencies_s.values())])
    whole = sum(one.share for one in some)
    mean_ms = sum(one.share * cpu[one.name][0] for one in some) / whole
    table.add_section()
    table.add_row(
        "all", f"{whole}", f"{mean_ms:.1f}", "", "", *(f"{one:.1f}" for one in np.percentile(times, (50, 99)))
    )
    Console(width=110).print(table)
    asked = times.size + found.lost
    answered = 100 * (1 - (found.lost + found.refused) / asked)
    print(
        f"{name}: {asked} requests, {answered:.2f} % answered; CPU of the service "
        f"{found.cpu_ms:.1f} ms a request, of this generator {found.own_cpu_ms:.1f} ms"
    )
    return [(f"API on {name}: CPU of a request of the mix", f"{mean_ms:.1f} ms", "8 ms")]


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.load", description=__doc__)
    parser.add_argument("--localisations", type=int, default=LOCALISATIONS)
    parser.add_argument("--requests", type=int, default=REQUESTS, help="of the mix; 0 for none")
    parser.add_argument("--rate", type=float, default=RATE_HZ, help="of the mix, requests a second")
    parser.add_argument("--alone", type=int, default=ALONE, help="requests of each kind alone")
    parser.add_argument("--database", choices=("sqlite", "postgresql", "both"), default="both")
    parser.add_argument("--template", type=Path, help="home that a run of the built-in event has filled")
    parser.add_argument("--only", default="", help="kinds whose names hold this text")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--note", action="store_true", help="add the mean CPU time to benchmarks/history.csv")
    given = parser.parse_args(arguments)
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # the services end with it
    folder = Path(tempfile.mkdtemp(prefix="bella-load-"))
    try:
        template = given.template or folder / "template"
        if given.template is None:
            make_template(template)
        for name in ("sqlite", "postgresql") if given.database == "both" else (given.database,):
            with served(folder / name, template, given.localisations, postgres=name != "sqlite") as (service, made):
                some = [one for one in kinds(made) if given.only in one.name]
                cpu = alone(service, some, given.alone, given.seed)
                found = asyncio.run(mixed(service, some, given.requests, given.rate, given.seed))
                rows = report(name, some, cpu, found)
                if given.note:
                    print(*history.note(rows), sep="\n")
            shutil.rmtree(folder / name)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    main()
