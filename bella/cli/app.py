"""All commands of ``bella``, in the order in which help shows them."""

import json
import os
import sys
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from bella.cli.arrivals import EPILOG as ARRIVALS_EPILOG
from bella.cli.arrivals import arrivals
from bella.cli.calibrate import EPILOG as CALIBRATE_EPILOG
from bella.cli.calibrate import calibrate
from bella.cli.catalogue import (
    AsJson,
    Home,
    catalogue_app,
    new_table,
    open_catalogue,
    settings_of,
)
from bella.cli.coverage import EPILOG as COVERAGE_EPILOG
from bella.cli.coverage import coverage
from bella.cli.detect import EPILOG as DETECT_EPILOG
from bella.cli.detect import detect
from bella.cli.ephemeris import EPILOG as EPHEMERIS_EPILOG
from bella.cli.ephemeris import UPDATE_EPILOG, ephemeris, know_updates, update_ephemeris
from bella.cli.fetch import EPILOG as FETCH_EPILOG
from bella.cli.fetch import day_range, fetch
from bella.cli.fit_track import EPILOG as FIT_TRACK_EPILOG
from bella.cli.fit_track import fit_track
from bella.cli.formats import EPILOG as FORMATS_EPILOG
from bella.cli.formats import formats
from bella.cli.output import write_whole
from bella.cli.prune import EPILOG as PRUNE_EPILOG
from bella.cli.prune import prune
from bella.cli.run import Asked, pipeline, progress_bars, run_days, run_event, run_folder
from bella.cli.simulate import EPILOG as SIMULATE_EPILOG
from bella.cli.simulate import simulate
from bella.cli.store import store_app
from bella.cli.token import token_app
from bella.cli.webhook import webhook_app
from bella.exceptions import BellaError, InputError
from bella.flags import APPARENT_SOURCE
from bella.logs import log_to

if TYPE_CHECKING:
    from bella.heliosphere.scattering import DirectionalDelay

LARGEST_KAPPA = 10.0
"""Delays of more half widths of the rise, ten times any published one, are a mistake in the unit."""

app = typer.Typer(
    name="bella",
    help="Where was that solar radio burst, and how sure are we?",
    epilog="Start with: bella run, then: bella serve",
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    add_completion=False,
)
app.add_typer(catalogue_app, name="catalogue")
app.add_typer(token_app, name="token")
app.add_typer(webhook_app, name="webhook")
app.add_typer(store_app, name="store")

out, err = Console(), Console(stderr=True)

PRESETS = "default, paper, bella-2024, free-speed, subluminal or robust."
PresetName = Annotated[str, typer.Option("--preset", help=PRESETS)]
MethodName = Annotated[
    str, typer.Option("--method", help="posterior (exact), nuts (sampled with PyMC) or tdoa (time differences).")
]


def main() -> None:
    """Run the command line; an error raised on purpose ends it with one line and its exit code."""
    try:
        app()
    except BellaError as error:
        print(f"bella: {error}", file=sys.stderr)
        sys.exit(error.exit_code)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


@app.command(epilog="Example: bella run --from 2020-07-21 --to 2020-07-22 --archive mirror --workers 2")
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
    if workers is not None:
        os.environ["BELLA_WORKERS"] = str(workers)
    settings = settings_of(home)
    if spectra is not None:
        if archive is not None:
            raise InputError("--spectra and --archive are two sources of days: give one of them")
        begin, end = (None, None) if first is None else day_range(first, last or first)
        if first is None and last is not None:
            raise InputError("--to needs a first day: give --from too, or neither for all days of the folder")
        with pipeline(settings, preset, "posterior") as bar:
            run_folder(spectra, (begin, end), settings, Asked(preset, direct=direct, as_json=as_json), bar)
        return
    if first is None and (last or archive) is not None:
        raise InputError("days of the archive need a first one: give --from 2020-07-21")
    if first is not None:
        days = day_range(first, last or first)
        with pipeline(settings, preset, "posterior") as bar:
            run_days(days, archive or settings.archive, settings, Asked(preset, direct=direct, as_json=as_json), bar)
        return
    with pipeline(settings, preset, method, event) as bar:
        run_event(event, settings, Asked(preset, method, direct=direct, as_json=as_json), bar)


@app.command(epilog="Example: bella localise arrivals.csv --output localisations.csv --preset default")
def localise(  # noqa: PLR0913, PLR0917 - one argument per option
    arrivals: Annotated[Path, typer.Argument(help="Arrival table, CSV.")],
    output: Annotated[Path, typer.Option(help="Localisation table to write, CSV.")],
    draws: Annotated[Path | None, typer.Option(help="Zarr group to write the posterior draws to.")] = None,
    method: MethodName = "posterior",
    preset: PresetName = "default",
    dimensions: Annotated[int, typer.Option(help="2: source in the ecliptic plane. 3: anywhere in space.")] = 2,
    covariance: Annotated[
        Path | None, typer.Option(help="Full covariance of the rows of the table, netCDF as bella arrivals writes it.")
    ] = None,
    kappa: Annotated[
        str | None,
        typer.Option(help="Directional delay in half widths of the rise: MEAN,SD, or none; the preset's if left out."),
    ] = None,
) -> None:
    """Localise the bursts of an arrival table, without a catalogue."""
    from bella.arrivals import read_arrivals, read_covariance
    from bella.formats import localisation_csv, localisation_records
    from bella.multilateration import localise as locate

    if draws is not None and draws.exists():
        raise InputError(f"{draws} exists and is never overwritten; name another --draws")
    if not output.parent.is_dir():
        raise InputError(f"folder {output.parent} does not exist; make it or name another --output")
    know_updates()
    delay = None if kappa is None else _directional_delay(kappa)
    table = read_arrivals(arrivals)
    measured = None if covariance is None else read_covariance(covariance, len(table))
    with progress_bars() as bar:
        task = bar.add_task("localise", total=table["frequency_mhz"].nunique())
        posterior = locate(
            table,
            method=method,
            preset=preset,
            dimensions=dimensions,
            covariance_s2=measured,
            delay=delay,
            advance=lambda steps: bar.advance(task, steps),
        )
    if draws is not None:
        _write_draws(posterior, draws)
    kept = (
        "frame",
        "reference_time",
        "edge",
        "method",
        "preset",
        "sigma_rule",
        "tau_rsun",
        "v_prior_sd_over_c",
        "kappa_prior",
        "kappa_prior_sd",
        "seed",
    )
    comments = {name: posterior.attrs[name] for name in kept} | {"remark": APPARENT_SOURCE}
    write_whole(output, localisation_csv(localisation_records(posterior), comments))
    out.print(f"{posterior.sizes['frequency']} frequencies in {output}")


def _directional_delay(text: str) -> "DirectionalDelay":
    """Prior of the directional delay from the text of an option."""
    from bella.heliosphere.scattering import NO_DELAY, DirectionalDelay

    if text.strip().lower() == "none":
        return NO_DELAY
    try:
        mean, sd = (float(part) for part in text.split(","))
    except ValueError:
        mean, sd = float("nan"), float("nan")
    if not (abs(mean) <= LARGEST_KAPPA and 0 <= sd <= LARGEST_KAPPA):
        raise InputError(f"--kappa {text!r} is not MEAN,SD within {LARGEST_KAPPA:g}; write 0.1,0.12 or none")
    return DirectionalDelay(mean, sd)


@app.command(epilog="Example: bella serve --port 8000")
def serve(
    home: Home = None,
    host: Annotated[str, typer.Option(help="Address to listen on.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=1, max=65535, help="Port to listen on.")] = 8000,
) -> None:
    """Serve the catalogue: REST API and pages."""
    from api.app import create_app
    from api.serve import run as run_server

    settings = settings_of(home)
    log_to(None)
    settings.home.mkdir(parents=True, exist_ok=True)
    open_catalogue(settings, create=True).close()
    err.print(f"Catalogue of {settings.home.resolve()} on http://{host}:{port}")
    run_server(create_app(settings), host, port)


@app.command(epilog="Example: bella status --json")
def status(home: Home = None, as_json: AsJson = False) -> None:
    """Tell what the service did last and what waits."""
    settings = settings_of(home)
    with closing(open_catalogue(settings)) as catalogue:
        runs = catalogue.stage_runs(20)
        waiting = len(catalogue.pending_submissions())
        revision = catalogue.revision()
    if as_json:
        rows = [
            {"stage": run.stage, "subject": run.subject, "state": run.state, "attempts": run.attempts} for run in runs
        ]
        out.print_json(json.dumps({"revision": revision, "waiting": waiting, "runs": rows}))
        return
    table = new_table("Last runs", "stage", "subject", "state", "attempts", "started", "message")
    for run in runs:
        started = f"{run.started_utc:%Y-%m-%d %H:%M:%S}"
        table.add_row(run.stage, run.subject[:16], run.state, str(run.attempts), started, run.message)
    out.print(table)
    out.print(f"{waiting} arrival tables wait; catalogue revision {revision}")


# after those above, so that help begins with what is done first
app.command("fit-track", epilog=FIT_TRACK_EPILOG)(fit_track)
app.command(epilog=COVERAGE_EPILOG)(coverage)
app.command(epilog=CALIBRATE_EPILOG)(calibrate)
app.command(epilog=EPHEMERIS_EPILOG)(ephemeris)
app.command("update-ephemeris", epilog=UPDATE_EPILOG)(update_ephemeris)
app.command(epilog=FORMATS_EPILOG)(formats)
app.command(epilog=DETECT_EPILOG)(detect)
app.command(epilog=ARRIVALS_EPILOG)(arrivals)
app.command(epilog=FETCH_EPILOG)(fetch)
app.command(epilog=SIMULATE_EPILOG)(simulate)
app.command(epilog=PRUNE_EPILOG)(prune)


def _write_draws(posterior: Any, path: Path) -> None:
    from bella.store import place_group, stage_group, verify_group

    staged = stage_group(posterior, path.parent)
    verify_group(staged, posterior)
    place_group(staged, path.parent, path.name)
    staged.parent.rmdir()
