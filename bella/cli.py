"""The ``bella`` command: reads options, calls a room, prints what it returns."""

import json
import math
import os
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from bella.cli_arrivals import EPILOG as ARRIVALS_EPILOG
from bella.cli_arrivals import arrivals
from bella.cli_calibration import EPILOG as CALIBRATE_EPILOG
from bella.cli_calibration import calibrate
from bella.cli_coverage import EPILOG as COVERAGE_EPILOG
from bella.cli_coverage import coverage
from bella.cli_days import days_table
from bella.cli_detect import EPILOG as DETECT_EPILOG
from bella.cli_detect import detect
from bella.cli_ephemeris import EPILOG as EPHEMERIS_EPILOG
from bella.cli_ephemeris import UPDATE_EPILOG, ephemeris, know_updates, update_ephemeris
from bella.cli_fetch import EPILOG as FETCH_EPILOG
from bella.cli_fetch import day_range, fetch
from bella.cli_fit_track import EPILOG as FIT_TRACK_EPILOG
from bella.cli_fit_track import fit_track
from bella.cli_output import write_whole
from bella.cli_simulate import EPILOG as SIMULATE_EPILOG
from bella.cli_simulate import simulate
from bella.cli_spectra import EPILOG as FORMATS_EPILOG
from bella.cli_spectra import formats
from bella.exceptions import BellaError, InputError
from bella.flags import APPARENT_SOURCE
from bella.logs import log_to

if TYPE_CHECKING:
    from bella.catalogue import Catalogue
    from bella.heliosphere.scattering import DirectionalDelay
    from bella.settings import Settings

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
catalogue_app = typer.Typer(help="Look into the catalogue of bursts.", no_args_is_help=True)
app.add_typer(catalogue_app, name="catalogue")

out, err = Console(), Console(stderr=True)

Home = Annotated[
    Path | None, typer.Option(help="Folder that holds catalogue, store and figures.", show_default="bella-home")
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")]
PRESETS = "default, paper, bella-2024, free-speed, subluminal or robust."
PresetName = Annotated[str, typer.Option("--preset", help=PRESETS)]
MethodName = Annotated[
    str, typer.Option("--method", help="posterior (exact), nuts (sampled with PyMC) or tdoa (time differences).")
]
ROWS_SHOWN = 9


def main() -> None:
    """Run the command line; an error raised on purpose ends it with one line and its exit code."""
    try:
        app()
    except BellaError as error:
        print(f"bella: {error}", file=sys.stderr)
        sys.exit(error.exit_code)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


@app.command(epilog="Example: bella run --from 2020-07-21 --to 2020-07-22 --archive mirror")
def run(  # noqa: PLR0913, PLR0917 - one argument per option
    event: Annotated[str, typer.Option(help="Built-in event, by its date.")] = "2012-06-07",
    first: Annotated[str | None, typer.Option("--from", help="First day of the archive to process, UTC.")] = None,
    last: Annotated[str | None, typer.Option("--to", help="Last day.", show_default="the first")] = None,
    archive: Annotated[
        str | None, typer.Option(help="URL, or folder, below which pub/data is.", show_default="BELLA_ARCHIVE")
    ] = None,
    preset: Annotated[
        str | None, typer.Option(help=PRESETS, show_default="bella-2024 for the event, default for days")
    ] = None,
    method: MethodName = "posterior",
    home: Home = None,
    as_json: AsJson = False,
) -> None:
    """Run the whole pipeline: on the built-in burst, or on days of the archive from spectra to sources."""
    settings = _settings(home)
    if first is None and (last or archive) is not None:
        raise InputError("days of the archive need a first one: give --from 2020-07-21")
    if first is not None:
        asked = day_range(first, last or first)
        with _pipeline(settings, preset or "default", "posterior"):
            from flows.process_days import process_days, summary_rows

            days = list(summary_rows(process_days(*asked, archive, preset or "default")))
        out.print_json(json.dumps(days)) if as_json else out.print(days_table(days))
        return
    from flows.inputs import check_subject

    check_subject(event, settings.incoming_root)
    with _pipeline(settings, preset or "bella-2024", method):
        # Prefect takes the address of its server when it is imported
        from flows.localise_burst import localise_burst, summary_row

        outcomes = localise_burst(subject=event, preset=preset or "bella-2024", method=method)
    if as_json:
        out.print_json(json.dumps([summary_row(outcome) for outcome in outcomes]))
        return
    with closing(_catalogue(settings)) as catalogue:
        for outcome in outcomes:
            out.print(_track_table(catalogue, outcome.solution.solution_id))
    out.print(_fit_table([(outcome.solution.series.edge, outcome.track) for outcome in outcomes]))
    _print_places(settings, outcomes[0].solution.burst_id, new=[outcome.new for outcome in outcomes])


@contextmanager
def _pipeline(settings: "Settings", preset: str, method: str) -> Iterator[None]:
    """A Prefect server for the time of a run, with its progress on the screen; refuses bad choices first."""
    from bella.multilateration import check_choices
    from flows.environment import prepare

    check_choices(preset, method)
    prepare(settings)
    log_to(settings.home / "logs" / "bella.log")
    from flows.server import prefect_server

    with _progress() as bar:
        starting = bar.add_task("start Prefect", total=1)
        with prefect_server(settings):
            bar.update(starting, completed=1)
            yield


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
    with _progress() as bar:
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
    import uvicorn

    from api.app import create_app

    settings = _settings(home)
    log_to(None)
    settings.home.mkdir(parents=True, exist_ok=True)
    _catalogue(settings, create=True).close()
    err.print(f"Catalogue of {settings.home.resolve()} on http://{host}:{port}")
    uvicorn.run(create_app(settings), host=host, port=port, log_level="warning")


@app.command(epilog="Example: bella status --json")
def status(home: Home = None, as_json: AsJson = False) -> None:
    """Tell what the service did last and what waits."""
    settings = _settings(home)
    with closing(_catalogue(settings)) as catalogue:
        runs = catalogue.stage_runs(20)
        waiting = len(catalogue.pending_submissions())
        revision = catalogue.revision()
    if as_json:
        rows = [
            {"stage": run.stage, "subject": run.subject, "state": run.state, "attempts": run.attempts} for run in runs
        ]
        out.print_json(json.dumps({"revision": revision, "waiting": waiting, "runs": rows}))
        return
    table = _table("Last runs", "stage", "subject", "state", "attempts", "started", "message")
    for run in runs:
        started = f"{run.started_utc:%Y-%m-%d %H:%M:%S}"
        table.add_row(run.stage, run.subject[:16], run.state, str(run.attempts), started, run.message)
    out.print(table)
    out.print(f"{waiting} arrival tables wait; catalogue revision {revision}")


@catalogue_app.command("list", epilog="Example: bella catalogue list --json")
def list_bursts(
    home: Home = None,
    limit: Annotated[int, typer.Option(help="So many bursts at most, 1 to 1000.")] = 50,
    as_json: AsJson = False,
) -> None:
    """List the bursts, earliest first."""
    from bella.catalogue import BurstQuery

    with closing(_catalogue(_settings(home))) as catalogue:
        page = catalogue.bursts(BurstQuery(limit=limit))
    if as_json:
        rows = [
            {"burst_id": one.burst.burst_id, "solutions": [s.solution_id for s in one.solutions]} for one in page.bursts
        ]
        out.print_json(json.dumps(rows))
        return
    table = _table(f"{len(page.bursts)} of {page.total} bursts", "burst", "heard by", "MHz", "solutions")
    for one in page.bursts:
        burst = one.burst
        band = f"{burst.f_low_mhz:g} - {burst.f_high_mhz:g}"
        table.add_row(burst.burst_id, ", ".join(burst.observatories), band, str(len(one.solutions)))
    out.print(table)


@catalogue_app.command("show", epilog="Example: bella catalogue show T3-20120607-1929")
def show_burst(
    burst_id: Annotated[str, typer.Argument(help="Such as T3-20120607-1929; bella catalogue list names them.")],
    home: Home = None,
) -> None:
    """Print track and fits of a burst."""
    with closing(_catalogue(_settings(home))) as catalogue:
        solutions = catalogue.burst(burst_id).solutions
        for solution in solutions:
            out.print(_track_table(catalogue, solution.solution_id))
        out.print(_fit_table([(one.series.edge, catalogue.track_fit(one.solution_id)) for one in solutions]))


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


def _settings(home: Path | None) -> "Settings":
    """Settings of the environment; `home` wins, and is handed on to what reads the environment later."""
    from bella.settings import read_settings

    if home is not None:
        os.environ["BELLA_HOME"] = str(home.resolve())
    return read_settings()


def _catalogue(settings: "Settings", *, create: bool = False) -> "Catalogue":
    from bella.catalogue import Catalogue

    return Catalogue.open(settings.catalogue_url, create=create)


@contextmanager
def _progress() -> Iterator[Progress]:
    """Progress bars on standard error, one for each stage that a flow tells of."""
    from flows.progress import listen

    columns = (TextColumn("{task.description:<28}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=err) as bar:
        tasks: dict[str, Any] = {}

        def _heard(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = bar.add_task(stage, total=total)
            bar.update(tasks[stage], completed=done)

        listen(_heard)
        yield bar


def _write_draws(posterior: Any, path: Path) -> None:
    from bella.store import place_group, stage_group, verify_group

    staged = stage_group(posterior, path.parent)
    verify_group(staged, posterior)
    place_group(staged, path.parent, path.name)
    staged.parent.rmdir()


def _table(title: str, *columns: str) -> Table:
    table = Table(
        title=title, title_justify="left", title_style="bold", caption_justify="left", box=SIMPLE_HEAD, pad_edge=False
    )
    for name in columns:
        table.add_column(name, justify="left" if name in {"burst", "edge", "fit", "observatory", "flags"} else "right")
    return table


def _track_table(catalogue: "Catalogue", solution_id: str) -> Table:
    rows = catalogue.localisations(solution_id)
    table = _table(solution_id, "MHz", "R_sun", "longitude", "sd x, y", "68 % area", "emitted", "speed")
    shown = min(ROWS_SHOWN, len(rows))
    for i in range(shown):
        table.add_row(*_track_row(rows[round((len(rows) - 1) * (1 - i / max(shown - 1, 1)))]))
    table.caption = f"{APPARENT_SOURCE}\nn.c.: not constrained (share of the prior's width that is left)"
    return table


def _track_row(row: Any) -> tuple[str, ...]:
    constrained = "speed_not_constrained" not in row.flags
    speed = f"{row.v_over_c:.3f} c" if constrained else f"n.c. ({row.contraction_v:.2f})"
    return (
        f"{row.frequency_mhz:.3f}",
        f"{math.hypot(row.x_rsun, row.y_rsun):.1f}",
        f"{math.degrees(math.atan2(row.y_rsun, row.x_rsun)):+.1f}°",
        f"{math.sqrt(row.cov_xx_rsun2):.1f}, {math.sqrt(row.cov_yy_rsun2):.1f}",
        f"{row.area68_rsun2:.0f}",
        f"{row.emission_utc:%H:%M:%S}",
        speed,
    )


def _fit_table(fits: list[tuple[str, dict[str, Any]]]) -> Table:
    table = _table("Parker spiral behind the track", "edge", "fit", "days", "phi0", "v_sw km/s", "flags")
    for edge, track in fits:
        if "joint" in track:
            table.add_row(edge, "joint", *_fit_row(track["joint"]))
        if "phi0_deg" in (fused := track.get("companions", {}).get("fused", {})):
            table.add_row(edge, "fused", *_fit_row(fused))
        for line in (track["two_step"], *track["two_step_other_rotations"].values()):
            table.add_row(edge, "two-step", *_fit_row(line))
    table.add_row("the paper", "two-step", "24.47", "+30 ± 2°", "400 ± 20", "")
    table.caption = (
        "joint: to the arrival times. fused: also to measured wind, wave directions.\n"
        "two-step: through the positions, formal errors. days: rotation assumed.\n"
        f"All: {APPARENT_SOURCE}"
    )
    return table


def _fit_row(fit: dict[str, Any]) -> tuple[str, str, str, str]:
    phi0, v_sw = fit["phi0_deg"], fit["v_sw_km_s"]
    longitude = f"{phi0['mean']:+.1f} ± {phi0['sd']:.1f}°" if phi0["mean"] is not None else "-"
    speed = f"{v_sw['mean']:.0f} ± {v_sw['sd']:.0f}" if v_sw["mean"] is not None else "-"
    return f"{fit['rotation_period_d']:g}", longitude, speed, ", ".join(fit["flags"])


def _print_places(settings: "Settings", burst_id: str, *, new: list[bool]) -> None:
    changed = f"{sum(new)} new solutions" if any(new) else "nothing new: same inputs, same versions"
    _say(f"Catalogue  {settings.catalogue_url.rsplit('@', 1)[-1].removeprefix('sqlite:///')} ({changed})")
    _say(f"Posteriors {settings.store_root.resolve() / burst_id}")
    for path in sorted((settings.figures_root.resolve() / burst_id).glob("*.png")):
        _say(f"Figure     {path}")
    _say("Page       make serve (or bella serve), then http://127.0.0.1:8000/bursts/" + burst_id)


def _say(line: str) -> None:
    """Print a line as one line, so that a path in it can be copied."""
    out.print(line, soft_wrap=True, highlight=False)


if __name__ == "__main__":
    main()
