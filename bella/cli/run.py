"""The command ``bella run``: days of the archive or of a folder, or one burst, under Prefect or without it."""

import os
import shlex
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bella.cli.catalogue import fit_table, say_answer, track_table
from bella.cli.options import AsJson, Home, MethodName, PresetName, day_range, open_catalogue, settings_of
from bella.cli.output import answer, new_table, print_json, say, show, stage_bars, warn
from bella.exceptions import InputError
from bella.logs import log_to

if TYPE_CHECKING:
    from rich.progress import Progress
    from rich.table import Table

    from bella.pipeline.burst import Choice, Outcome
    from bella.pipeline.day_files import BroughtFolder
    from bella.pipeline.outcome import DayOutcome
    from bella.settings import Settings

EPILOG = "Example: bella run --from 2020-07-21 --to 2020-07-22 --archive mirror --workers 2"
MOST_REFUSALS = 3
MOST_NAMES = 5
DIRECT = "direct"
"""Name of a run without an orchestrator, in leases and logs."""


@dataclass(frozen=True)
class Asked:
    """Options of a run.

    Attributes
    ----------
    direct : bool
        Without Prefect.
    home : Path or None
        Folder as it was given.
    """

    preset: str
    method: str = "posterior"
    direct: bool = False
    as_json: bool = False
    home: Path | None = None

    @property
    def choice(self) -> "Choice":
        """How bursts are localised."""
        from bella.pipeline.burst import Choice

        return Choice(self.method, self.preset)


def run(  # noqa: PLR0913, PLR0917 - one argument per option
    event: Annotated[str, typer.Option(help="Built-in event, by its date.")] = "2012-06-07",
    first: Annotated[str | None, typer.Option("--from", help="First day of the archive to process, UTC.")] = None,
    last: Annotated[str | None, typer.Option("--to", help="Last day.", show_default="the first")] = None,
    archive: Annotated[
        str | None, typer.Option(help="URL, or folder, below which pub/data is.", show_default="BELLA_ARCHIVE")
    ] = None,
    spectra: Annotated[
        Path | None,
        typer.Option(help="Folder of your own spectra, netCDF or Zarr, one file per spacecraft; all days it holds."),
    ] = None,
    preset: PresetName = "default",
    method: MethodName = "posterior",
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes side by side; results are the same.", show_default="1")
    ] = None,
    direct: Annotated[bool, typer.Option("--direct", help="Without Prefect: the same results, sooner.")] = False,
    home: Home = None,
    as_json: AsJson = False,
) -> None:
    """Run the whole pipeline: on the built-in burst, or from spectra to sources on days of the archive or your own."""
    from bella.archive import open_archive

    if workers is not None:
        os.environ["BELLA_WORKERS"] = str(workers)
    settings = settings_of(home)
    asked = Asked(preset, method, direct=direct, as_json=as_json, home=home)
    if spectra is not None:
        if archive is not None:
            raise InputError("--spectra and --archive are two sources of days: give one of them")
        if first is None and last is not None:
            raise InputError("--to needs a first day: give --from too, or neither for all days of the folder")
        begin, end = (None, None) if first is None else day_range(first, last or first)
        if not spectra.is_dir():
            raise InputError(f"folder {spectra} does not exist; name the folder of your spectra with --spectra")
        with _pipeline(settings, asked) as bar:
            _run_folder(spectra, (begin, end), settings, asked, bar)
        return
    if first is None and (last or archive) is not None:
        raise InputError("days of the archive need a first one: give --from 2020-07-21")
    if first is not None:
        days, source = day_range(first, last or first), archive or settings.archive
        open_archive(source)  # a wrong folder or address ends it here, before anything is started
        with _pipeline(settings, asked) as bar:
            _run_days(days, source, settings, asked, bar)
        return
    with _pipeline(settings, asked, event) as bar:
        _run_event(event, settings, asked, bar)


@contextmanager
def _pipeline(settings: "Settings", asked: Asked, event: str | None = None) -> "Iterator[Progress]":
    """What a run needs around it: folders, a log, its progress on the screen.

    Bad choices are refused first, then a catalogue that cannot be opened: before Prefect is started.
    """
    from bella.catalogue import Catalogue
    from bella.multilateration import check_choices
    from bella.pipeline.inputs import check_subject
    from bella.pipeline.workers import prepare

    check_choices(asked.preset, asked.method)
    if event is not None:
        check_subject(event, settings.incoming_root)
    prepare(settings)
    log_to(settings.home / "logs" / "bella.log")
    Catalogue.open(settings.catalogue_url, create=True).close()
    with stage_bars() as bar:
        yield bar


def _run_folder(
    folder: Path, days: "tuple[date | None, date | None]", settings: "Settings", asked: Asked, bar: "Progress"
) -> None:
    from bella.pipeline.day_files import BroughtFolder

    brought = BroughtFolder(folder, settings)
    wanted = brought.days(*days)
    for one in brought.left_out:
        warn(f"Left out: {one}")
    if brought.others:
        shown = ", ".join(brought.others[:MOST_NAMES]) + (", ..." if len(brought.others) > MOST_NAMES else "")
        warn(f"Not looked at, no data by name or content: {len(brought.others)} files ({shown})")
    _print_done(lambda: _folder_done(wanted, brought, settings, asked, bar), asked, bar)


def _run_days(days: tuple[date, date], archive: str, settings: "Settings", asked: Asked, bar: "Progress") -> None:
    _print_done(lambda: _days_done(days, archive, settings, asked, bar), asked, bar)


def _print_done(process: "Callable[[], Sequence[DayOutcome]]", asked: Asked, bar: "Progress") -> None:
    from bella.pipeline.outcome import UnfinishedError

    unfinished = None
    try:
        outcomes = process()
    except UnfinishedError as error:
        outcomes, unfinished = error.outcomes, error
    bar.stop()
    _print_days(outcomes, asked)
    if unfinished is not None:
        raise unfinished


def _folder_done(
    days: "Sequence[date]", brought: "BroughtFolder", settings: "Settings", asked: Asked, bar: "Progress"
) -> "Sequence[DayOutcome]":
    if not asked.direct:
        with _prefect(bar):
            from flows.days import process_range

            return process_range(days, None, asked.choice, brought)
    return _directly(days, None, settings, asked, brought)


def _days_done(
    days: tuple[date, date], archive: str, settings: "Settings", asked: Asked, bar: "Progress"
) -> "Sequence[DayOutcome]":
    from bella.pipeline.run import days_between

    if not asked.direct:
        with _prefect(bar):
            from flows.days import process_range

            return process_range(days_between(*days), archive, asked.choice)
    return _directly(days_between(*days), archive, settings, asked)


def _directly(
    days: "Sequence[date]",
    archive: str | None,
    settings: "Settings",
    asked: Asked,
    brought: "BroughtFolder | None" = None,
) -> "Sequence[DayOutcome]":
    from bella.pipeline.workers import Workers

    with Workers(settings.workers, settings, settings.home / "logs" / "bella.log") as workers:
        workers.start()  # they load what they need while this process does

        from bella.pipeline.outcome import check_finished
        from bella.pipeline.run import Direct, Run, process_days

        with Direct(settings.workers) as executor:
            done = process_days(days, archive, Run(settings, DIRECT, workers, asked.choice), executor, brought)
    check_finished(done.outcomes, done.unreachable, done.left_out)
    return done.outcomes


def _run_event(event: str, settings: "Settings", asked: Asked, bar: "Progress") -> None:
    from bella.pipeline.burst import summary_table

    outcomes = _event_done(event, settings, asked, bar)
    bar.stop()
    if asked.as_json:
        print_json(summary_table(outcomes))
        return
    with closing(open_catalogue(settings)) as catalogue:
        for outcome in outcomes:
            show(track_table(catalogue, outcome.solution.solution_id))
        summary = catalogue.burst(outcomes[0].solution.burst_id)
    show(fit_table([(outcome.solution.series.edge, outcome.track) for outcome in outcomes]))
    _print_places(settings, summary.burst.burst_id, asked.home, new=[outcome.new for outcome in outcomes])
    say_answer(summary)


def _event_done(event: str, settings: "Settings", asked: Asked, bar: "Progress") -> "Sequence[Outcome]":
    from bella.pipeline.run import Direct, Run, process_subject
    from bella.pipeline.workers import Workers

    if not asked.direct:
        with _prefect(bar):
            from flows.bursts import localise_burst

            return localise_burst(event, asked.choice)
    with Workers(1, settings) as workers, Direct(1) as executor:
        return executor.tried(process_subject, event, Run(settings, DIRECT, workers, asked.choice)).published()


@contextmanager
def _prefect(bar: "Progress") -> Iterator[None]:
    """A Prefect server for the time of a run."""
    starting = bar.add_task("start Prefect", total=1)
    # Prefect reads its settings when it is imported
    from flows.embedded import prefect_server
    from flows.tasks import answering

    with answering(), prefect_server():
        bar.update(starting, completed=1)
        yield


def _print_days(outcomes: "Sequence[DayOutcome]", asked: Asked) -> None:
    from bella.pipeline.outcome import summary_rows

    days = list(summary_rows(outcomes))
    if asked.as_json:
        print_json(days)
        return
    show(_days_table(days))
    for burst_id, sentence in (pair for day in days for pair in day["answers"].items()):
        say(f"{burst_id}: {sentence}")
    localised, preliminary = (sum(len(day[name]) for day in days) for name in ("localised", "preliminary"))
    answer(f"{len(days)} days: {localised} bursts localised, {preliminary} preliminary")


def _days_table(days: Sequence[dict[str, Any]]) -> "Table":
    names = ("day", "state", "answer", "found", "bursts", "localised", "preliminary", "not localised")
    table = new_table("", *names, left=names, whole=("day", "localised", "preliminary"))
    for day in days:
        is_searched = day["state"] == "searched"
        table.add_row(
            day["day"],
            day["state"],
            day["answer"] or "",
            f"{day['detections']} by {len(day['observatories'])}" if is_searched else "",
            f"{day['bursts']}" if is_searched else "",
            "\n".join(day["localised"]),
            "\n".join(day["preliminary"]),
            day["message"] or _refusals(day["refused"]),
        )
    return table


def _refusals(refused: Sequence[dict[str, str]]) -> str:
    """The most common reasons, each with how often it occurs."""
    reasons = [one["reason"].removeprefix("not localisable: ") for one in refused]
    counted = sorted(((reasons.count(reason), reason) for reason in set(reasons)), reverse=True)
    shown = [f"{number} x {reason}" for number, reason in counted[:MOST_REFUSALS]]
    return "\n".join(shown + [f"and {len(counted) - MOST_REFUSALS} more"] * (len(counted) > MOST_REFUSALS))


def _print_places(settings: "Settings", burst_id: str, home: Path | None, *, new: list[bool]) -> None:
    changed = f"{sum(new)} new solutions" if any(new) else "nothing new: same inputs, same versions"
    say(f"Catalogue  {settings.catalogue_url.rsplit('@', 1)[-1].removeprefix('sqlite:///')} ({changed})")
    say(f"Posteriors {settings.store_root.resolve() / burst_id}")
    for path in sorted((settings.figures_root.resolve() / burst_id).glob("*.[ps][nv]g")):
        say(f"Figure     {path}")
    serving = "bella serve" if home is None else f"bella serve --home {shlex.quote(str(home))}"
    say(f"Page       {serving}, then http://127.0.0.1:8000/bursts/{burst_id}")
