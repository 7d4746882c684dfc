"""Days of simulated data sets in a folder that looks like the archive."""

from collections.abc import Callable, Iterator, Sequence
from datetime import date, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from bella.exceptions import InputError
from bella.simulation.archive_tree import write_spectra
from bella.simulation.day import observe_day
from bella.simulation.instruments import WRITABLE, Instrument, instruments
from bella.simulation.sky import Sky, draw_sky
from bella.simulation.truth import day_truth
from bella.spacecraft import OBSERVATORIES, fleet
from bella.spectra.archive_datasets import find_datasets

DAY = timedelta(days=1)
MARK = ".simulated"
"""File that tells a simulated archive from a mirror of the real one."""


def simulate_days(
    root: Path,
    days: Sequence[date],
    seed: int,
    datasets: Sequence[str] = (),
    advance: Callable[[int], None] = lambda _: None,
) -> dict[str, Any]:
    """Write days of simulated files under the names and in the folders of the archive.

    A day depends on the seed and its date only, not on which other days or data sets are written, and bursts go on past
    midnight.

    Parameters
    ----------
    root : pathlib.Path
        Folder that is new, empty, or was simulated before.
    days : sequence of datetime.date
    seed : int
    datasets : sequence of str
        Keys of `WRITABLE`; none for all that exist on a day.
    advance : callable
        Told 1 after each day.

    Returns
    -------
    dict
        The truth: ``seed`` and ``days`` (:func:`bella.simulation.truth.day_truth`, and the ``files`` of the day).

    Raises
    ------
    InputError
        If the folder holds anything else, a data set cannot be written, or there is nothing to write for a day.
    """
    wanted = _wanted(datasets)
    _claim(root)
    truth = []
    for day in days:
        truth.append(_simulate(root, day, seed, wanted))
        advance(1)
    return {"seed": seed, "days": truth}


def _wanted(datasets: Sequence[str]) -> tuple[str, ...]:
    keys = [dataset.key for dataset in find_datasets(datasets)] if datasets else list(WRITABLE)
    unknown = [key for key in keys if key not in WRITABLE]
    if unknown:
        raise InputError(f"files of data set {unknown[0]!r} cannot be simulated; choose from {', '.join(WRITABLE)}")
    return tuple(keys)


def _claim(root: Path) -> None:
    if root.exists() and not root.is_dir():
        raise InputError(f"{root} is a file; name a folder")
    if root.is_dir() and any(root.iterdir()) and not (root / MARK).exists():
        raise InputError(f"{root} is not empty and was not simulated; name a new folder, so that no real file is lost")
    try:
        root.mkdir(parents=True, exist_ok=True)
        (root / MARK).touch()
    except OSError as error:
        raise InputError(f"{root} cannot be written ({error.strerror}); name another folder") from error


def _simulate(root: Path, day: date, seed: int, datasets: Sequence[str]) -> dict[str, Any]:
    known = set(fleet(np.datetime64(day, "ns") + np.timedelta64(12, "h"))["observatory"])
    skies = {other: sky_of(other, seed) for other in (day - DAY, day, day + DAY)}
    files = []
    observatories: dict[str, None] = {}
    for key, receivers in _receivers(day, datasets, known):
        rng = np.random.default_rng([seed, day.toordinal(), WRITABLE.index(key) + 1])
        spectra = [observe_day(receiver, tuple(skies.values()), day, rng) for receiver in receivers]
        files.append(str(write_spectra(spectra, key, day, root).relative_to(root)))
        observatories |= dict.fromkeys(receiver.receiver.observatory for receiver in receivers)
    if not files:
        raise InputError(f"no data set asked for has files of {day}; choose other days or data sets")
    return day_truth(skies[day], list(observatories)) | {"files": files}


def sky_of(day: date, seed: int) -> Sky:
    """What is to be heard on a day, the same for every call with its date and seed.

    Parameters
    ----------
    day : datetime.date
    seed : int

    Returns
    -------
    Sky
    """
    return draw_sky(day, OBSERVATORIES, np.random.default_rng([seed, day.toordinal()]))


def _receivers(day: date, datasets: Sequence[str], known: set[str]) -> Iterator[tuple[str, list[Instrument]]]:
    for dataset in find_datasets(datasets):
        if dataset.covers(day) and known & set(dataset.observatories):
            receivers = instruments(dataset.key, day)
            yield dataset.key, [one for one in receivers if one.receiver.observatory in known]
