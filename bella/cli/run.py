"""What ``bella run`` does and prints: days of the archive, or one burst, under Prefect or without it."""

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from bella.cli.catalogue import fit_table, open_catalogue, say, say_answer, track_table
from bella.logs import log_to

if TYPE_CHECKING:
    from bella.pipeline.burst import Choice, Outcome
    from bella.pipeline.outcome import DayOutcome
    from bella.pipeline.user import BroughtFolder
    from bella.settings import Settings

MOST_REFUSALS = 3
DIRECT = "direct"
"""Name of a run without an orchestrator, in leases and logs."""

out, err = Console(), Console(stderr=True)


@dataclass(frozen=True)
class Asked:
    """Options of a run.

    Attributes
    ----------
    preset, method : str
    direct : bool
        Without Prefect.
    as_json : bool
    """

    preset: str
    method: str = "posterior"
    direct: bool = False
    as_json: bool = False

    @property
    def choice(self) -> "Choice":
        """How bursts are localised."""
        from bella.pipeline.burst import Choice

        return Choice(self.method, self.preset)


@contextmanager
def pipeline(settings: "Settings", preset: str, method: str, event: str | None = None) -> Iterator[Progress]:
    """What a run needs around it: folders, a log, its progress on the screen; bad choices are refused first.

    Parameters
    ----------
    settings : Settings
    preset, method : str
    event : str, optional
        Subject to be localised.

    Yields
    ------
    rich.progress.Progress

    Raises
    ------
    InputError
        If a choice is not known, or the home folder cannot be made.
    """
    from bella.multilateration import check_choices
    from bella.pipeline.environment import prepare
    from bella.pipeline.inputs import check_subject

    check_choices(preset, method)
    if event is not None:
        check_subject(event, settings.incoming_root)
    prepare(settings)
    log_to(settings.home / "logs" / "bella.log")
    with progress_bars() as bar:
        yield bar


def run_folder(
    folder: Path, days: "tuple[date | None, date | None]", settings: "Settings", asked: Asked, bar: Progress
) -> None:
    """Process days of a folder of spectra and print what became of them.

    Parameters
    ----------
    folder : Path
    days : tuple of (datetime.date or None)
        First and last; None for all that the folder has.
    settings : Settings
    asked : Asked
    bar : rich.progress.Progress
        Is ended before anything is printed.

    Raises
    ------
    UnfinishedError
        After printing, if a day is not done, or a file was left out.
    """
    from bella.pipeline.user import BroughtFolder

    brought = BroughtFolder(folder, settings)
    wanted = brought.days(*days)
    for one in brought.left_out:
        err.print(f"Left out: {one}", soft_wrap=True, highlight=False)
    _print_done(lambda: _folder_done(wanted, brought, settings, asked, bar), asked, bar)


def run_days(days: tuple[date, date], archive: str, settings: "Settings", asked: Asked, bar: Progress) -> None:
    """Process days and print what became of them.

    Parameters
    ----------
    days : tuple of datetime.date
        First and last.
    archive : str
    settings : Settings
    asked : Asked
    bar : rich.progress.Progress
        Is ended before anything is printed.

    Raises
    ------
    UnfinishedError
        After printing, if a day is not done.
    """
    _print_done(lambda: _days_done(days, archive, settings, asked, bar), asked, bar)


def _print_done(process: "Callable[[], Sequence[DayOutcome]]", asked: Asked, bar: Progress) -> None:
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
    days: "Sequence[date]", brought: "BroughtFolder", settings: "Settings", asked: Asked, bar: Progress
) -> "Sequence[DayOutcome]":
    if not asked.direct:
        with _prefect(bar):
            from flows.days import process_folder

            return process_folder(days, brought, asked.choice)
    return _directly(days, None, settings, asked, brought)


def _days_done(
    days: tuple[date, date], archive: str, settings: "Settings", asked: Asked, bar: Progress
) -> "Sequence[DayOutcome]":
    from bella.pipeline.run import days_between

    if not asked.direct:
        with _prefect(bar):
            from flows.days import process_range

            return process_range(*days, archive, asked.choice)
    return _directly(days_between(*days), archive, settings, asked)


def _directly(
    days: "Sequence[date]",
    archive: str | None,
    settings: "Settings",
    asked: Asked,
    brought: "BroughtFolder | None" = None,
) -> "Sequence[DayOutcome]":
    from bella.pipeline.outcome import check_finished
    from bella.pipeline.run import Direct, Run, process_days
    from bella.pipeline.workers import Workers

    log = settings.home / "logs" / "bella.log"
    with Workers(settings.workers, settings, log) as workers, Direct(settings.workers) as executor:
        done = process_days(days, archive, Run(settings, DIRECT, workers, asked.choice), executor, brought)
    check_finished(done.outcomes, done.unreachable, done.left_out)
    return done.outcomes


def run_event(event: str, settings: "Settings", asked: Asked, bar: Progress) -> None:
    """Localise one burst and print its tracks, fits, figures and answer.

    Parameters
    ----------
    event : str
        Date of the built-in event, or checksum of a submitted table.
    settings : Settings
    asked : Asked
    bar : rich.progress.Progress
        Is ended before anything is printed.
    """
    from bella.pipeline.burst import summary_table

    outcomes = _event_done(event, settings, asked, bar)
    bar.stop()
    if asked.as_json:
        out.print_json(json.dumps(summary_table(outcomes)))
        return
    with closing(open_catalogue(settings)) as catalogue:
        for outcome in outcomes:
            out.print(track_table(catalogue, outcome.solution.solution_id))
        summary = catalogue.burst(outcomes[0].solution.burst_id)
    out.print(fit_table([(outcome.solution.series.edge, outcome.track) for outcome in outcomes]))
    _print_places(settings, summary.burst.burst_id, new=[outcome.new for outcome in outcomes])
    say_answer(summary)


def _event_done(event: str, settings: "Settings", asked: Asked, bar: Progress) -> "Sequence[Outcome]":
    from bella.exceptions import NotPlacedError
    from bella.pipeline.run import Direct, Run, process_subject
    from bella.pipeline.workers import Workers

    if not asked.direct:
        with _prefect(bar):
            from flows.bursts import localise_burst

            return localise_burst(event, asked.choice)
    with Workers(1, settings) as workers, Direct(1) as executor:
        done = executor.tried(process_subject, event, Run(settings, DIRECT, workers, asked.choice))
    if done.reason:
        raise NotPlacedError(done.reason)
    return done.outcomes


@contextmanager
def _prefect(bar: Progress) -> Iterator[None]:
    """A Prefect server for the time of a run."""
    starting = bar.add_task("start Prefect", total=1)
    # Prefect reads its settings when it is imported
    from flows.embedded import prefect_server
    from flows.tasks import answering

    with answering(), prefect_server():
        bar.update(starting, completed=1)
        yield


@contextmanager
def progress_bars() -> Iterator[Progress]:
    """Progress bars on standard error, one for each stage that the pipeline counts."""
    from bella.pipeline.progress import listen

    columns = (TextColumn("{task.description:<28}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=err) as bar:
        tasks: dict[str, Any] = {}

        def _heard(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = bar.add_task(stage, total=total)
            bar.update(tasks[stage], completed=done, total=total)

        listen(_heard)
        yield bar


def _print_days(outcomes: "Sequence[DayOutcome]", asked: Asked) -> None:
    from bella.pipeline.outcome import summary_rows

    days = list(summary_rows(outcomes))
    if asked.as_json:
        out.print_json(json.dumps(days))
        return
    out.print(days_table(days))
    for burst_id, sentence in (pair for day in days for pair in day["answers"].items()):
        say(f"{burst_id}: {sentence}")


def days_table(days: Sequence[dict[str, Any]]) -> Table:
    """Table of processed days.

    Parameters
    ----------
    days : sequence of dict
        As :func:`bella.pipeline.outcome.summary_rows` returns them.

    Returns
    -------
    rich.table.Table
    """
    names = ("day", "state", "answer", "found", "bursts", "localised", "preliminary", "not localised")
    table = Table(*names, box=SIMPLE_HEAD, pad_edge=False)
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


def _print_places(settings: "Settings", burst_id: str, *, new: list[bool]) -> None:
    changed = f"{sum(new)} new solutions" if any(new) else "nothing new: same inputs, same versions"
    say(f"Catalogue  {settings.catalogue_url.rsplit('@', 1)[-1].removeprefix('sqlite:///')} ({changed})")
    say(f"Posteriors {settings.store_root.resolve() / burst_id}")
    for path in sorted((settings.figures_root.resolve() / burst_id).glob("*.png")):
        say(f"Figure     {path}")
    say("Page       make serve (or bella serve), then http://127.0.0.1:8000/bursts/" + burst_id)
