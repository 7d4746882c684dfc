"""All commands of ``bella``, in the order in which help shows them, and how the program ends."""

import inspect
import sys
import warnings
from collections.abc import Callable
from functools import wraps
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from bella import __version__
from bella.cli import (
    access,
    calibrate,
    catalogue,
    ephemeris,
    events,
    fetch,
    localise,
    release,
    run,
    serve,
    spectra,
    track,
    upkeep,
)
from bella.cli.output import be_quiet
from bella.exceptions import BellaError
from bella.logs import log_nothing

Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print the answer and errors only.")]


class Command(TyperCommand):
    """A command whose flags are shown as flags."""

    def get_params(self, *arguments: Any) -> list[Any]:
        """Arguments and options, flags without the type of a value."""
        return _plain_flags(super().get_params(*arguments))


class Group(TyperGroup):
    """A group of commands whose flags are shown as flags."""

    def get_params(self, *arguments: Any) -> list[Any]:
        """Options, flags without the type of a value."""
        return _plain_flags(super().get_params(*arguments))


def _plain_flags(options: list[Any]) -> list[Any]:
    for one in options:
        if getattr(one, "is_flag", False):
            one.metavar = ""
    return options


def _with_quiet(command: Callable[..., None]) -> Callable[..., None]:
    """A command that also takes ``--quiet``."""

    @wraps(command)
    def _quietly(*arguments: Any, quiet: bool = False, **options: Any) -> None:
        be_quiet(quiet)
        command(*arguments, **options)

    signature = inspect.signature(command)
    option = inspect.Parameter("quiet", inspect.Parameter.KEYWORD_ONLY, default=False, annotation=Quiet)
    taken = signature.replace(parameters=[*signature.parameters.values(), option])
    _quietly.__signature__ = taken  # type: ignore[attr-defined]
    _quietly.__annotations__ = command.__annotations__ | {"quiet": Quiet}
    return _quietly


def _print_version(asked: bool) -> None:
    if asked:
        print(f"bella {__version__}")
        raise typer.Exit


app = typer.Typer(
    name="bella",
    cls=Group,
    epilog="Start with: bella run, then: bella serve",
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


@app.callback(help="Where was that solar radio burst, and how sure are we?")
def bella(
    version: Annotated[
        bool, typer.Option("--version", is_eager=True, callback=_print_version, help="Print the version.")
    ] = False,
) -> None:
    """Take the options that need no command."""


for name, function, epilog in (
    ("run", run.run, run.EPILOG),
    ("serve", serve.serve, serve.SERVE_EPILOG),
    ("status", serve.status, serve.STATUS_EPILOG),
    ("localise", localise.localise, localise.EPILOG),
    ("fit-track", track.fit_track, track.EPILOG),
    ("detect", spectra.detect, spectra.DETECT_EPILOG),
    ("arrivals", spectra.arrivals, spectra.ARRIVALS_EPILOG),
    ("formats", spectra.formats, spectra.FORMATS_EPILOG),
    ("simulate", spectra.simulate, spectra.SIMULATE_EPILOG),
    ("fetch", fetch.fetch, fetch.EPILOG),
    ("ephemeris", ephemeris.ephemeris, ephemeris.EPILOG),
    ("update-ephemeris", ephemeris.update_ephemeris, ephemeris.UPDATE_EPILOG),
    ("coverage", calibrate.coverage, calibrate.COVERAGE_EPILOG),
    ("calibrate", calibrate.calibrate, calibrate.CALIBRATE_EPILOG),
    ("prune", upkeep.prune, upkeep.PRUNE_EPILOG),
):
    app.command(name, cls=Command, epilog=epilog)(_with_quiet(function))

for name, group in (
    ("catalogue", catalogue.catalogue_app),
    ("events", events.events_app),
    ("release", release.release_app),
    ("store", upkeep.store_app),
    ("token", access.token_app),
    ("webhook", access.webhook_app),
):
    for registered in group.registered_commands:
        registered.cls = Command
        if registered.callback is not None:
            registered.callback = _with_quiet(registered.callback)
    app.add_typer(group, name=name, cls=Group)


def main() -> None:
    """Run the command line; an error raised on purpose ends it with one line and its exit code."""
    log_nothing()
    if not sys.warnoptions:
        warnings.simplefilter("ignore")  # those of libraries are for people who write programs
    try:
        app()
    except BellaError as error:
        print(f"bella: {error}", file=sys.stderr)
        sys.exit(error.exit_code)
