"""Replay of simulated days with the latency of each data set, quiet and with faults: ``python -m benchmarks.replay``.

Days of the fleet of November 2021 are simulated, one burst each. On a clock that is run fast their files become visible
in an archive as they do in the real one: the key parameters, then level 2 and level 3, then files that are replaced by
``_v02``. After every step ``bella run`` processes what is visible: once undisturbed, without Prefect, on SQLite; and
once with PostgreSQL and a Prefect server that are killed at random instants as the command itself is, a clock that is
wrong, several runs at a time, archives that do not answer, and a full disk, while the API is asked for bursts every
second. In the end both catalogues must be the same, byte for byte.
"""

import argparse
import hashlib
import json
import os
import random
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import asdict, dataclass, field
from datetime import UTC, date, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import structlog

from bella.archive import find_datasets
from bella.catalogue import BurstQuery, Catalogue
from bella.exceptions import BellaError
from bella.logs import log_to
from bella.pipeline.housekeeping import sweep_store
from bella.records import Origin
from bella.settings import Settings
from bella.simulation.archive_days import write_spectra
from bella.simulation.day import Scene, observe_scene
from bella.simulation.instruments import instruments
from bella.simulation.sky import Conditions
from bella.simulation.strata import isolated_burst
from bella.store import SUFFIX, open_group
from benchmarks.services import Services

BELLA = str(Path(sys.executable).with_name("bella"))
FIRST_GUESS_S = 5.0
"""How long a run takes, until one has been timed: less than any, so that the first kills hit."""

SIMULATED = frozenset({Origin.SIMULATED})
FIRST_DAY = date(2021, 11, 1)
DAY = timedelta(days=1)

LATENCY_D = {
    "WI_K0_WAV": 1,
    "STEREO_LEVEL2_SWAVES": 2,
    "WI_H1_WAV": 15,
    "WI_L2_WAV_RAD1": 15,
    "WI_L2_WAV_RAD2": 15,
    "STA_L3_WAV_LFR": 30,
    "STA_L3_WAV_HFR": 30,
    "SOLO_L3_RPW-TNR-SURV-FLUX": 92,
    "SOLO_L3_RPW-HFR-SURV-FLUX": 92,
    "PSP_FLD_L2_RFS_LFR": 125,
    "PSP_FLD_L2_RFS_HFR": 125,
}
"""Data sets of the fleet, and after how many days their files become visible."""

REVISED, REVISED_AFTER_D = "SOLO_L3_RPW-HFR-SURV-FLUX", 170
"""Data set whose files are replaced by a new version, and when."""

STEP_D = 6
"""Days of the fast clock after which what has become visible is processed."""

DISK_MB = 1500
FAULTS = ("outage", "data set away", "full disk", "duplicates", "wrong clock", "full disk")
MOST_S = 900.0
"""Time in which a run ends, whatever is killed under it."""

MOST_RUNS = 8
"""Runs in which a step must be done once the faults are over; a killed one may have left a lease of a few seconds."""

DRAWS, LEASE_S = 100, 5
CLOCKS = ("+3h", "-3h")
"""Clocks that a run may have in place of the right one, as ``faketime`` takes them."""

log = structlog.get_logger(__name__)

SERVICES = ("database", "prefect")
"""What is killed beside the command itself."""


@dataclass(frozen=True)
class Plan:
    """What is replayed.

    Attributes
    ----------
    days, kills, seed : int
    duplicates : int
        Runs that are started at the same time, once in a while.
    datasets : tuple of str
        Keys of `LATENCY_D`.
    has_revisions : bool
        Whether files of `REVISED` are replaced.
    first : datetime.date
    """

    days: int
    kills: int
    seed: int
    duplicates: int = 4
    datasets: tuple[str, ...] = tuple(LATENCY_D)
    has_revisions: bool = True
    first: date = FIRST_DAY

    @property
    def all_days(self) -> list[date]:
        """Days of the replay."""
        return [self.first + number * DAY for number in range(self.days)]


@dataclass
class Home:
    """One of the two services that are compared.

    Attributes
    ----------
    path, archive : pathlib.Path
    services : Services or None
        That its runs use; None for SQLite without Prefect.
    runs_s, rss_mb : list of float
        Duration and largest memory of every run that was not killed.
    latency_s : list of float
        From files visible to their solution published, s.
    faults : dict of str to int
        How often each fault was met.
    growth : list of tuple of int
        Files of the store and rows of the catalogue after every step.
    turn : list of str
        Faults that come next: each once, in a random order, then all again.
    workers : int
        Processes that a run computes with.
    started : list of subprocess.Popen
        All runs, for :meth:`end`.
    """

    path: Path
    archive: Path
    services: Services | None = None
    runs_s: list[float] = field(default_factory=list)
    rss_mb: list[float] = field(default_factory=list)
    latency_s: list[float] = field(default_factory=list)
    faults: dict[str, int] = field(default_factory=dict)
    growth: list[tuple[int, int]] = field(default_factory=list)
    turn: list[str] = field(default_factory=list)
    workers: int = 1
    started: "list[subprocess.Popen[bytes]]" = field(default_factory=list)

    @property
    def settings(self) -> Settings:
        """Settings with which its results are read."""
        url = self.services.environment["BELLA_DATABASE_URL"] if self.services else None
        return Settings(home=self.path, database_url=url)

    def start(self, days: Sequence[date], archive: str | None = None, clock: str = "") -> "subprocess.Popen[bytes]":
        """Start the command on some days."""
        command = [BELLA, "run", "--from", f"{days[0]}", "--to", f"{days[-1]}"]
        if clock:
            command = ["faketime", "-f", clock, *command]
        environment = {"PATH": os.environ["PATH"], "OPENBLAS_NUM_THREADS": "1", "BELLA_ARCHIVE_TIMEOUT_S": "2"}
        environment |= {"BELLA_DRAWS": f"{DRAWS}", "BELLA_LEASE_S": f"{LEASE_S}", "HOME": str(self.path.parent)}
        environment["BELLA_WORKERS"] = f"{self.workers}"
        if self.services is None or clock:  # a Prefect server has one clock with its clients
            command.append("--direct")
        if self.services is not None:
            environment |= self.services.environment
        with (self.path.parent / "runs.log").open("ab") as log:
            process = subprocess.Popen(
                [*command, "--archive", archive or str(self.archive), "--home", str(self.path)],
                env=environment,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )
        self.started.append(process)
        return process

    def run(self, days: Sequence[date], archive: str | None = None) -> int:
        """Run the command to its end; its exit status."""
        begin, process = time.monotonic(), self.start(days, archive)
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        self.runs_s.append(time.monotonic() - begin)
        self.rss_mb.append(usage.ru_maxrss / 1024)
        log.info("run", status=process.returncode, took_s=round(self.runs_s[-1], 1))
        return process.returncode

    def finish(self, days: Sequence[date]) -> None:
        """Run until nothing is left to be done; RuntimeError where that does not come."""
        for _ in range(MOST_RUNS):
            if self.run(days) == 0:
                return
        raise RuntimeError(f"no run succeeds: see {self.path.parent / 'runs.log'}")

    def end(self) -> None:
        """Kill the runs that are still at work, as one is when the replay is stopped."""
        for process in self.started:
            if process.poll() is None:
                with suppress(ProcessLookupError):
                    os.killpg(process.pid, signal.SIGKILL)
                process.wait()

    def met(self, fault: str) -> None:
        """Count a fault."""
        self.faults[fault] = self.faults.get(fault, 0) + 1


def simulate(root: Path, plan: Plan) -> dict[date, list[tuple[str, Path]]]:
    """Write all files of all days; returns data set and path of each, by day."""
    written: dict[date, list[tuple[str, Path]]] = {}
    for number, day in enumerate(plan.all_days):
        case = isolated_burst("clean", day, (plan.seed + number) % 9000)
        scene = Scene(np.datetime64(day, "ns"), (case.burst,), Conditions(), ())
        for key in plan.datasets:
            rng = np.random.default_rng([plan.seed, number, *key.encode()])
            receivers = [one for one in instruments(key, day) if one.receiver.observatory != "STEREO-B"]
            spectra = [observe_scene(one, scene, case.drawn.between_s, rng) for one in receivers]
            path = write_spectra(spectra, key, day, root).relative_to(root)
            written.setdefault(day, []).append((key, path))
    return written


def releases(plan: Plan, written: dict[date, list[tuple[str, Path]]]) -> list[list[tuple[Path, str]]]:
    """What becomes visible in each step: path of a file and its version."""
    due: dict[int, list[tuple[Path, str]]] = {}
    for day, files in written.items():
        for key, path in files:
            after = (day - plan.first).days + LATENCY_D[key] + 1
            due.setdefault(after // STEP_D, []).append((path, "v01"))
            if plan.has_revisions and key == REVISED:
                due.setdefault((after + REVISED_AFTER_D - LATENCY_D[key]) // STEP_D, []).append((path, "v02"))
    return [due[step] for step in sorted(due)]


def lay_out(archive: Path, days: Sequence[date]) -> None:
    """Make the folders of all data sets: where one is missing the archive counts as moved, not as empty."""
    for dataset in find_datasets(()):
        for day in days:
            (archive / dataset.folders(day)[0]).mkdir(parents=True, exist_ok=True)


def make_visible(files: Sequence[tuple[Path, str]], source: Path, archive: Path) -> None:
    """Let files appear in an archive, each whole."""
    for path, version in files:
        content = (source / path).read_bytes()
        name = path.name.lower().replace("v01", version)
        target = archive / path.parent / (path.name if version == "v01" else name)
        target.parent.mkdir(parents=True, exist_ok=True)
        staged = target.with_name(f".{name}.staged")
        # readers heed the length that a CDF file states of itself: the same spectra in another file
        staged.write_bytes(content if version == "v01" else content + version.encode())
        staged.replace(target)


@contextmanager
def full_disk(home: Path) -> Iterator[bool]:
    """Take all room but a little of the disk that the home is on; false where it is not a disk of its own."""
    ballast, room = home / ".ballast", shutil.disk_usage(home)
    if room.total > 2 * DISK_MB * 2**20:
        yield False
        return
    try:
        with suppress(OSError), ballast.open("wb") as stream:
            left = room.free - random.Random(room.free).randrange(50_000, 3_000_000)
            os.posix_fallocate(stream.fileno(), 0, max(left, 0))
        yield True
    finally:
        ballast.unlink(missing_ok=True)


def kill_something(home: Home, days: Sequence[date], rng: random.Random) -> bool:
    """Start a run, and kill it or a service under it at a random instant; a service comes back within seconds.

    Returns
    -------
    bool
        False where the run was done before: nothing is left to be disturbed.
    """
    begin, process = time.monotonic(), home.start(days)
    with suppress(subprocess.TimeoutExpired):
        process.wait(rng.uniform(0.0, 1.2 * statistics.mean(home.runs_s or [FIRST_GUESS_S])))
    if process.poll() is not None:
        log.info("ended before it was killed", status=process.returncode, took_s=round(time.monotonic() - begin, 1))
        return process.returncode != 0
    victim = rng.choice(["run", *SERVICES]) if home.services else "run"
    after_s = time.monotonic() - begin
    home.met(f"{victim} killed")
    if home.services is not None and victim in SERVICES:
        home.services.kill(victim)
        time.sleep(rng.uniform(0.0, 5.0))
        home.services.start(victim)
        with suppress(subprocess.TimeoutExpired):
            process.wait(MOST_S)
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    log.info("killed", victim=victim, after_s=round(after_s, 1), took_s=round(time.monotonic() - begin, 1))
    return True


def disturb(home: Home, days: Sequence[date], kills: int, plan: Plan, rng: random.Random) -> int:
    """Let runs on some days meet faults; what they leave behind is the next run's affair.

    Returns
    -------
    int
        Kills that are left because all was done before.
    """
    is_last = rng.random() < 0.5  # a fault that comes first meets a run with everything to do
    while is_last and kills and kill_something(home, days, rng):
        kills -= 1
    home.turn = home.turn or rng.sample(FAULTS, len(FAULTS))
    fault, begin = home.turn.pop(), time.monotonic()
    if meet(fault, home, days, plan, rng):
        home.met(fault)
    log.info("fault", fault=fault, took_s=round(time.monotonic() - begin, 1))
    while not is_last and kills and kill_something(home, days, rng):
        kills -= 1
    return kills


def meet(fault: str, home: Home, days: Sequence[date], plan: Plan, rng: random.Random) -> bool:
    """Run with one of the `FAULTS`; false where this machine cannot have it."""
    if fault == "wrong clock":
        if shutil.which("faketime") is None:
            return False
        home.start(days, clock=rng.choice(CLOCKS)).wait()
    elif fault == "outage":
        home.run(days, "http://127.0.0.1:9")
    elif fault == "data set away":
        away = home.archive / "pub"
        with suppress(FileNotFoundError):
            away.rename(home.archive / "moved")
        home.run(days)
        (home.archive / "moved").rename(away)
    elif fault == "full disk":
        with full_disk(home.path) as is_full:
            if is_full:
                home.run(days)
            return is_full
    else:
        started = [home.start(days) for _ in range(plan.duplicates)]
        for process in started:
            process.wait()
    return True


def replay(home: Home, plan: Plan, steps: list[list[tuple[Path, str]]], source: Path, *, quiet: bool) -> None:
    """Go through all steps with one service."""
    rng = random.Random(plan.seed)
    shares = [rng.random() for _ in steps]
    kills = [round(plan.kills * share / sum(shares)) for share in shares]
    left = 0
    for step, files in enumerate(steps):
        make_visible(files, source, home.archive)
        visible = datetime.now(UTC)
        stamps = {path.name.split("20211")[1][:3] for path, _ in files}
        days = [day for day in plan.all_days if f"{day:%Y%m%d}".removeprefix("20211") in stamps]
        days = [day for day in plan.all_days if days[0] <= day <= days[-1]]
        log.info("step", step=step, of=len(steps), first=f"{days[0]}", last=f"{days[-1]}", quiet=quiet)
        if not quiet:
            left = disturb(home, days, kills[step] + left, plan, rng)
        home.finish(days)
        with closing(Catalogue.open(home.settings.catalogue_url)) as catalogue:
            rows = 0
            for solution in _solutions(catalogue):
                rows += 1
                if solution.created_utc >= visible:
                    home.latency_s.append((solution.created_utc - visible).total_seconds())
        home.growth.append((sum(1 for path in home.settings.store_root.rglob("*") if path.is_file()), rows))


def _solutions(catalogue: Catalogue) -> list[Any]:
    bursts = catalogue.bursts(BurstQuery(limit=1000, origins=SIMULATED)).bursts
    return [one for burst in bursts for one in catalogue.versions(burst.burst.burst_id)]


def export(home: Home, plan: Plan) -> dict[str, Any]:
    """All that the catalogue says, but for when it was written and under which names files are kept."""
    untold = {"created_utc", "store_path", "spectra_path", "changed_utc", "received_utc", "searched_utc", "updated_utc"}

    def _told(record: Any) -> dict[str, Any]:
        return {name: value for name, value in asdict(record).items() if name not in untold}

    with closing(Catalogue.open(home.settings.catalogue_url)) as catalogue:
        solutions = sorted(_solutions(catalogue), key=lambda one: str(one.solution_id))
        found = {
            "bursts": [_told(one.burst) for one in catalogue.bursts(BurstQuery(limit=1000, origins=SIMULATED)).bursts],
            "solutions": [_told(one) for one in solutions],
            "localisations": {
                one.solution_id: [_told(row) for row in catalogue.localisations(one.solution_id)] for one in solutions
            },
            "tracks": {one.solution_id: catalogue.track_fit(one.solution_id) for one in solutions},
            "days": [_told(day) for day in (catalogue.searched_day(one, SIMULATED) for one in plan.all_days) if day],
            "detections": [[_told(one) for one in catalogue.detections_of(day, SIMULATED)] for day in plan.all_days],
        }
    plain: dict[str, Any] = json.loads(json.dumps(found, default=str, sort_keys=True))
    return plain


def half_published(home: Home) -> list[str]:
    """Solutions whose files cannot be read, or are not what was published."""
    bad = []
    with closing(Catalogue.open(home.settings.catalogue_url)) as catalogue:
        for one in _solutions(catalogue):
            spectra = catalogue.burst(one.burst_id).burst.spectra_path
            try:
                open_group(home.settings.store_root, one.store_path, sha256=one.store_sha256)
                if spectra is not None and not (home.settings.store_root / spectra).is_file():
                    bad.append(f"{one.solution_id}: spectra")
            except BellaError as error:
                bad.append(f"{one.solution_id}: {error}")
    return bad


def orphans(home: Home) -> list[str]:
    """Groups of the store that no row refers to, after housekeeping."""
    time.sleep(LEASE_S)  # younger ones may be of a run that is at work
    settings = home.settings.model_copy(update={"lease_s": float(LEASE_S)})
    with closing(Catalogue.open(settings.catalogue_url)) as catalogue:
        sweep_store(catalogue, settings, "replay")
        known = catalogue.referenced_paths()
    root = home.settings.store_root
    groups = [path.relative_to(root) for path in root.glob(f"*/*{SUFFIX}")]
    return sorted(str(path) for path in groups if str(path) not in known)


def report(quiet: Home, disturbed: Home, plan: Plan) -> dict[str, Any]:
    """What the replay found."""
    expected, got = export(quiet, plan), export(disturbed, plan)
    ids = [{str(one["solution_id"]) for one in found["solutions"]} for found in (expected, got)]
    bursts = [{str(one["burst_id"]) for one in found["bursts"]} for found in (expected, got)]
    digests = [hashlib.sha256(json.dumps(one, sort_keys=True).encode()).hexdigest() for one in (expected, got)]
    third = max(len(disturbed.rss_mb) // 3, 1)
    return {
        "days": plan.days,
        "bursts": len(bursts[0]),
        "solutions": len(ids[0]),
        "faults": disturbed.faults,
        "bursts_lost": sorted(bursts[0] - bursts[1]),
        "bursts_doubled": sorted(bursts[1] - bursts[0]),
        "solutions_lost": sorted(ids[0] - ids[1]),
        "solutions_doubled": sorted(ids[1] - ids[0]),
        "half_published": half_published(disturbed),
        "orphans": orphans(disturbed),
        "exports_equal": digests[0] == digests[1],
        "differs": [name for name in expected if expected[name] != got[name]],
        "latency_s": {
            name: {
                "solutions": len(home.latency_s),
                "median": statistics.median(home.latency_s),
                "p98": float(np.quantile(home.latency_s, 0.98)),
            }
            for name, home in (("quiet", quiet), ("disturbed", disturbed))
            if home.latency_s
        },
        "rss_mb": {
            "first_third": max(disturbed.rss_mb[:third]),
            "last_third": max(disturbed.rss_mb[-third:]),
        },
        "api": dict(disturbed.services.answers) if disturbed.services else {},
        "growth": {"store_files": [one[0] for one in quiet.growth], "solutions": [one[1] for one in quiet.growth]},
    }


@contextmanager
def small_disk(folder: Path) -> Iterator[bool]:
    """Put a folder on a disk of its own in memory, where the machine allows that."""
    command = ["mount", "-t", "tmpfs", "-o", f"size={DISK_MB}m", "tmpfs", str(folder)]
    try:
        is_mounted = subprocess.run(command, capture_output=True, check=False).returncode == 0
    except OSError:
        is_mounted = False
    try:
        yield is_mounted
    finally:
        if is_mounted:
            subprocess.run(["umount", "--lazy", str(folder)], capture_output=True, check=False)


def compare(plan: Plan, folder: Path, workers: int = 1) -> dict[str, Any]:
    """Replay a plan in peace and with faults, and compare.

    Parameters
    ----------
    plan : Plan
    folder : pathlib.Path
        Empty; everything is written there.
    workers : int
        Processes that each run computes with.

    Returns
    -------
    dict
        Ready for JSON: see :func:`report`.
    """
    source = folder / "simulated"
    steps = releases(plan, simulate(source, plan))
    homes = []
    with ExitStack() as stack:
        for name in ("quiet", "disturbed"):
            place = folder / name
            (place / "bella-home").mkdir(parents=True)
            lay_out(place / "archive", plan.all_days)
            if name == "disturbed":
                stack.enter_context(small_disk(place / "bella-home"))
            homes.append(Home(place / "bella-home", place / "archive", workers=workers))
            stack.callback(homes[-1].end)
            if name == "disturbed":
                homes[-1].services = stack.enter_context(Services(homes[-1].path)).watch()
            replay(homes[-1], plan, steps, source, quiet=name == "quiet")
        return report(*homes, plan)


def is_clean(found: dict[str, Any]) -> bool:
    """Whether nothing was lost, doubled or half-published, and the API answered while its database was up."""
    bad = ("bursts_lost", "bursts_doubled", "solutions_lost", "solutions_doubled", "half_published", "orphans")
    refused = any(name.endswith("up") and not name.startswith("200") for name in found["api"])
    return bool(found["exports_equal"]) and not refused and not any(found[name] for name in bad)


def main() -> None:
    """Print the report; exit status 1 where the two catalogues differ."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.replay", description=__doc__)
    parser.add_argument("--days", type=int, default=30)
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--duplicates", type=int, default=16, help="runs started at the same time")
    parser.add_argument("--dataset", action="append", choices=[*LATENCY_D], help="may be given again; default: all")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1, help="processes of each run")
    parser.add_argument("--folder", type=Path, help="empty; kept, with the logs of all runs; default: one that is not")
    given = parser.parse_args()
    log_to(None)
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # the services end with it
    datasets = tuple(given.dataset or LATENCY_D)
    plan = Plan(given.days, given.kills, given.seed, given.duplicates, datasets)
    with ExitStack() as stack:
        made = tempfile.TemporaryDirectory(prefix="bella-replay-", ignore_cleanup_errors=True)
        folder = given.folder or Path(stack.enter_context(made))
        found = compare(plan, folder, given.workers)
    print(json.dumps(found, indent=1))
    sys.exit(0 if is_clean(found) else 1)


if __name__ == "__main__":
    main()
