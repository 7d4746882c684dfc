"""Options that several commands share, and the checks of options before any work begins."""

import os
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bella.exceptions import InputError
from bella.times import parse_day

if TYPE_CHECKING:
    import numpy as np

    from bella.catalogue import Catalogue
    from bella.heliosphere.scattering import DirectionalDelay
    from bella.settings import Settings

Home = Annotated[
    Path | None, typer.Option(help="Folder that holds catalogue, store and figures.", show_default="bella-home")
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")]
PresetName = Annotated[
    str, typer.Option("--preset", help="default, paper, bella-2024, free-speed, subluminal or robust.")
]
MethodName = Annotated[
    str, typer.Option("--method", help="posterior (exact), nuts (sampled with PyMC) or tdoa (time differences).")
]
CovarianceFile = Annotated[
    Path | None,
    typer.Option(
        "--covariance", help="Full covariance of the rows, netCDF, as bella arrivals writes it.", show_default="none"
    ),
]
MOST_DAYS = 3660
LARGEST_KAPPA = 2.0
"""Delays of more half widths of the rise, several times any published one, are a mistake in the unit."""


def settings_of(home: Path | None) -> "Settings":
    """Settings of the environment; `home` wins, also for what reads the environment later."""
    from bella.settings import read_settings

    if home is not None:
        os.environ["BELLA_HOME"] = str(home.resolve())
    return read_settings()


def open_catalogue(settings: "Settings", *, create: bool = False) -> "Catalogue":
    """Catalogue of the settings."""
    from bella.catalogue import Catalogue

    return Catalogue.open(settings.catalogue_url, create=create)


def know_updates(home: Path | None = None) -> None:
    """Extend the ephemeris by the table that the home folder holds, if it holds one.

    Parameters
    ----------
    home : Path or None
        The home folder; None for that of the settings.
    """
    from bella.spacecraft import extend_with

    extend_with(settings_of(home).ephemeris_extension)


def check_output(path: Path, option: str = "--output") -> None:
    """Refuse, before any work, a file that cannot be written.

    Parameters
    ----------
    option : str
        That names it.

    Raises
    ------
    InputError
        If its folder does not exist, or it is itself a folder.
    """
    if not path.parent.is_dir():
        raise InputError(f"folder {path.parent} does not exist; make it or name another {option}")
    if path.is_dir():
        raise InputError(f"{path} is a folder; name a file with {option}")
    if not os.access(path.parent, os.W_OK):
        raise InputError(f"folder {path.parent} cannot be written; name another {option}")


def check_file(path: Path) -> None:
    """Refuse, before any work, a file to read that does not exist.

    Raises
    ------
    InputError
        If there is nothing at this path.
    """
    if not path.exists():
        raise InputError(f"{path} does not exist; name a file that does")


def instant(utc: str) -> "np.datetime64":
    """An instant as a person writes it.

    Parameters
    ----------
    utc : str
        ISO 8601, with or without Z.

    Returns
    -------
    numpy.datetime64
        UTC, ns.

    Raises
    ------
    InputError
        If it is not a time.
    """
    import numpy as np

    try:
        moment = np.datetime64(utc.removesuffix("Z"), "ns")
    except ValueError as error:
        raise InputError(f"{utc!r} is not a time; write UTC as 2012-06-07T19:30") from error
    if np.isnat(moment):
        raise InputError(f"{utc!r} is not a time; write UTC as 2012-06-07T19:30")
    return moment


def day_range(first: str, last: str) -> tuple[date, date]:
    """First and last day as options give them.

    Raises
    ------
    InputError
        If one is no day, the last is before the first, or there are too many.
    """
    begin, end = parse_day(first, "--from"), parse_day(last, "--to")
    if end < begin:
        raise InputError(f"--to {last} is before --from {first}; exchange them")
    if (end - begin).days >= MOST_DAYS:
        raise InputError(f"--from {first} --to {last} is more than {MOST_DAYS} days; take them in parts")
    return begin, end


def numbers(text: str, option: str, counts: tuple[int, ...], example: str) -> tuple[float, ...]:
    """Numbers that an option gives, separated by commas.

    Parameters
    ----------
    counts : tuple of int
        How many there may be.
    example : str
        How to write them.

    Raises
    ------
    InputError
        If they are not so many numbers.
    """
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError as error:
        raise InputError(f"{option} {text}: not numbers; write {example}") from error
    if len(values) not in counts:
        raise InputError(f"{option} {text}: give {' or '.join(map(str, counts))} numbers, such as {example}")
    return values


def delay_option(text: str | None) -> "DirectionalDelay | None":
    """Prior of the directional delay as ``--kappa`` gives it.

    Parameters
    ----------
    text : str or None
        ``0.1,0.12``, or ``none`` for no delay.

    Returns
    -------
    DirectionalDelay or None
        None where the option was not given.

    Raises
    ------
    InputError
        If it is neither.
    """
    from bella.heliosphere.scattering import NO_DELAY, DirectionalDelay

    if text is None:
        return None
    if text.strip().lower() == "none":
        return NO_DELAY
    mean, sd = numbers(text, "--kappa", (2,), "0.1,0.12")
    if not (abs(mean) <= LARGEST_KAPPA and 0 <= sd <= LARGEST_KAPPA):
        within = f"{LARGEST_KAPPA:g}"
        raise InputError(f"--kappa {text}: give a mean within {within} and a deviation between 0 and {within}")
    return DirectionalDelay(mean, sd)
