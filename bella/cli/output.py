"""What several commands do with their results: write a file whole, and show how far they are."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from bella.exceptions import InputError

err = Console(stderr=True)


def write_whole(path: Path, text: str) -> None:
    """Write beside the target, then rename: the file is there whole or not at all.

    Parameters
    ----------
    path : Path
        In a folder that exists.
    text : str

    Raises
    ------
    InputError
        If it cannot be written.
    """
    partial = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        partial.write_text(text, encoding="utf-8")
        partial.replace(path)
    except OSError as error:
        raise InputError(f"{path} cannot be written ({error.strerror or error}); name another file") from error
    finally:
        partial.unlink(missing_ok=True)


@contextmanager
def steps(stage: str, total: int) -> Iterator[Callable[[int], None]]:
    """A bar on standard error that is drawn with the first step: bad input is answered by one line alone.

    Parameters
    ----------
    stage : str
    total : int
        Steps there are.

    Yields
    ------
    callable
        To be told how many steps are done since its last call.
    """
    columns = (TextColumn("{task.description:<28}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    bar = Progress(*columns, console=err)
    task = bar.add_task(stage, total=total)

    def _advance(done: int = 1) -> None:
        bar.start()
        bar.advance(task, done)

    try:
        yield _advance
    finally:
        if bar.live.is_started:
            bar.stop()
