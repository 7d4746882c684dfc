"""The commands ``bella calibrate`` and ``bella coverage``: whether errors hold, and how large they are where."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bella.cli.options import AsJson, check_file, check_output, instant, know_updates
from bella.cli.output import answer, naming_steps, print_json, say, steps, warn, write_netcdf, write_whole
from bella.exceptions import BellaError, InputError

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from bella.calibration.found import FoundBurst, Task

CALIBRATE_EPILOG = (
    "Example: bella calibrate --sources 200 --strata wide,four-robust; bella calibrate --found --bursts 4 --workers 2"
)
COVERAGE_EPILOG = "Example: bella coverage --at 2012-06-07T19:30 --output map.nc --preset bella-2024"
TABLE, PAGE, FIGURE = "calibration.csv", "calibration.md", "calibration.png"
FOUND_TABLE, FOUND_PAGE = "calibration-found.csv", "calibration-found.md"


def calibrate(  # noqa: PLR0913, PLR0917 - one argument per option
    output: Annotated[Path, typer.Option(help="Folder for table, page and figure; made if need be.")] = Path(
        "calibration"
    ),
    sources: Annotated[int, typer.Option(help="Simulated sources per stratum, 20 or more.")] = 1000,
    seed: Annotated[int, typer.Option(help="Seed of the random numbers, 0 or more.")] = 1,
    strata: Annotated[
        str | None, typer.Option(help="Strata to run, such as wide,four-robust.", show_default="all")
    ] = None,
    found: Annotated[
        bool, typer.Option("--found", help="Simulated bursts through detection, timing, localisation and track.")
    ] = False,
    bursts: Annotated[int, typer.Option(help="With --found: bursts per stratum and fleet.")] = 24,
    workers: Annotated[int, typer.Option(help="With --found: processes, 1 or more.")] = 1,
    as_json: AsJson = False,
) -> None:
    """Check what is published against simulated sources: coverage, and ranks of the truth."""
    names = [name.strip() for name in strata.split(",")] if strata is not None else []
    if seed < 0:
        raise InputError(f"--seed {seed} is below 0; give 0 or more")
    if found:
        from bella.calibration.found import FOUND_STRATA, tasks_of

        _calibrate_found(output, tasks_of(names or FOUND_STRATA, bursts, seed), seed, workers, as_json=as_json)
    else:
        _calibrate_posterior(output, names, sources, seed, as_json=as_json)


def _calibrate_found(output: Path, tasks: "list[Task]", seed: int, workers: int, *, as_json: bool) -> None:
    from bella.calibration.found import check_workers, find_all
    from bella.calibration.found_page import found_page
    from bella.calibration.found_table import found_csv, found_rows

    check_workers(workers)
    _check_writable(output)
    measured: list[FoundBurst] = []
    with naming_steps("calibrate", len(tasks)) as (advance, describe):
        for one in find_all(tasks, workers):
            describe(f"{one.task.stratum}, {one.task.fleet}")
            advance(1)
            measured.append(one)
    rows = found_rows(measured, seed)
    write_whole(output / FOUND_TABLE, found_csv(rows))
    write_whole(output / FOUND_PAGE, found_page(rows, table=FOUND_TABLE))
    answers = sum(not one.reason for one in measured)
    if as_json:
        made = {"bursts": len(measured), "answers": answers, "page": f"{output / FOUND_PAGE}"}
        print_json(made | {"rows": [asdict(row) for row in rows]})
        return
    answer(f"{answers} of {len(measured)} bursts have an answer; whether it holds: {output / FOUND_PAGE}")


def _calibrate_posterior(output: Path, names: list[str], sources: int, seed: int, *, as_json: bool) -> None:
    from bella.calibration import (
        calibration_page,
        check_sources,
        failing,
        find_strata,
        judge,
        run_stratum,
        verdict_table,
    )
    from bella.plotting import Caption, calibration_caption, calibration_figure, comparison_panels, write_figure

    chosen = find_strata(names)
    check_sources(sources)
    _check_writable(output)
    comparisons = []
    with naming_steps("calibrate", len(chosen) * sources) as (advance, describe):
        for stratum in chosen:
            describe(stratum.name)
            comparisons.append(run_stratum(stratum, sources, seed, advance))
    verdicts = judge(comparisons, seed)
    write_whole(output / TABLE, verdict_table(verdicts))
    write_whole(output / PAGE, calibration_page(verdicts, table=TABLE, figure=FIGURE))
    with _reporting(output):
        drawn = calibration_figure(comparison_panels(comparisons))
        write_figure(output / FIGURE, drawn, Caption(calibration_caption()))
    failed = failing(verdicts)
    if as_json:
        print_json({"page": f"{output / PAGE}", "failed": failed, "strata": [asdict(one) for one in verdicts]})
    if failed:
        raise BellaError(f"not calibrated: {', '.join(failed)}; see {output / PAGE}")
    declared = sum(not one.misfit for one in verdicts)
    if not as_json:
        answer(f"{declared} of {declared} strata are calibrated: {output / PAGE}")


def _check_writable(folder: Path) -> None:
    """Find out before the work whether its result can be kept."""
    with _reporting(folder):
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass


@contextmanager
def _reporting(path: Path, option: str = "--output") -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise InputError(f"{path} cannot be written ({error.strerror or error}); name another {option}") from error


def coverage(  # noqa: PLR0913, PLR0917 - one argument per option
    output: Annotated[Path, typer.Option(help="Map to write, netCDF.")],
    at: Annotated[str | None, typer.Option(help="Time of the fleet, UTC, such as 2012-06-07T19:30.")] = None,
    positions: Annotated[
        Path | None,
        typer.Option(help="CSV with observatory, x_rsun, y_rsun, z_rsun (HEE) and, where wanted, sigma_s."),
    ] = None,
    fleet: Annotated[str | None, typer.Option(help="Spacecraft to take, such as WIND,STEREO-A,SOLO.")] = None,
    sigma: Annotated[
        str | None,
        typer.Option(help="Timing error in s, for all (38) or each (WIND=60,SOLO=7).", show_default="cadence"),
    ] = None,
    preset: Annotated[str, typer.Option(help="default, free-speed, paper or bella-2024.")] = "default",
    size: Annotated[int, typer.Option(help="Nodes per axis, 2 to 2000.")] = 500,
    exact: Annotated[
        bool, typer.Option("--exact", help="Exact posterior at every node: minutes, not seconds.")
    ] = False,
    figure: Annotated[
        Path | None, typer.Option(help="Figure to write: .svg, .png or .pdf.", show_default="name of the map, .svg")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Map how well a fleet localises a burst, everywhere in the ecliptic plane."""
    from bella.multilateration.priors import find_preset, fleet_sigma
    from bella.multilateration.uncertainty_map import exact_nodes, uncertainty_map
    from bella.plotting import Caption, coverage_caption, coverage_figure, write_figure
    from bella.spacecraft import OBSERVATORIES

    picture = _check_paths(output, figure)
    chosen = find_preset(preset)
    if chosen.noise.bad_probability or chosen.priors.is_truncated:
        raise InputError(f"a map knows Gaussian errors only, not preset {preset!r}; use default or free-speed")
    given = timing_option(sigma)
    nodes = exact_nodes(size, exact=exact)
    receivers = _chosen(_receivers(at, positions), fleet, expected=OBSERVATORIES if positions is None else ())
    with steps("exact posteriors", nodes) as advance:
        uncertainty = uncertainty_map(
            dict(zip(receivers["observatory"], receivers[["x_rsun", "y_rsun", "z_rsun"]].to_numpy(), strict=True)),
            fleet_sigma(receivers, chosen, given),
            chosen.priors,
            size=size,
            exact=exact,
            epoch=None if at is None else instant(at),
            advance=advance,
        )
    uncertainty.attrs |= {"preset": chosen.name}
    write_netcdf(uncertainty, output)
    with _reporting(picture, "--figure"):
        write_figure(picture, coverage_figure(uncertainty), Caption(coverage_caption(uncertainty)))
    _print_map(uncertainty, output, picture, as_json=as_json)


def timing_option(text: str | None) -> dict[str, float] | float | None:
    """Timing errors as ``--sigma`` gives them: one number for all, or a number for each of some observatories.

    Parameters
    ----------
    text : str or None
        ``38`` or ``WIND=60,STEREO-A=38``.

    Returns
    -------
    dict of str to float, or float, or None
        s.

    Raises
    ------
    InputError
        If it is neither, or not above 0.
    """
    if text is None:
        return None
    if "=" not in text:
        return _seconds(text, text)
    parts = [part.partition("=") for part in text.split(",")]
    names = [name.strip() for name, _, _ in parts]
    if len(set(names)) < len(names):
        raise InputError(f"--sigma {text}: a spacecraft is named twice; give one number for each")
    return {name: _seconds(value, text) for name, (_, _, value) in zip(names, parts, strict=True)}


def _check_paths(output: Path, figure: Path | None) -> Path:
    """Path of the figure; refuses, before any work, what cannot be written."""
    from bella.plotting import kind_of

    picture = output.with_suffix(".svg") if figure is None else figure
    check_output(output)
    check_output(picture, "--figure")
    kind_of(picture)
    if picture.resolve() == output.resolve():
        raise InputError(f"map and figure would both be {output}; name the map .nc, or another --figure")
    return picture


def _receivers(at: str | None, positions: Path | None) -> "pd.DataFrame":
    """Table of receivers with columns observatory, x_rsun, y_rsun, z_rsun, sigma_s."""
    from bella.spacecraft import fleet
    from bella.spacecraft.positions import read_positions

    if at is not None and positions is not None:
        raise InputError("both --at and --positions are given; keep one of them")
    if positions is not None:
        check_file(positions)
        return read_positions(positions)
    if at is None:
        raise InputError("where is the fleet? give a time with --at 2012-06-07T19:30, or a table with --positions FILE")
    know_updates()
    return fleet(instant(at)).assign(sigma_s=float("nan"))


def _chosen(receivers: "pd.DataFrame", fleet: str | None, *, expected: tuple[str, ...]) -> "pd.DataFrame":
    """Rows of the spacecraft that were asked for, or of all; says which of the expected ones are not there."""
    known = list(dict.fromkeys([*receivers["observatory"], *expected]))
    wanted = known if fleet is None else [name.strip() for name in fleet.split(",")]
    unknown = [name for name in wanted if name not in known]
    if unknown:
        raise InputError(f"--fleet: spacecraft {unknown[0]!r} is not known; known are {', '.join(known)}")
    chosen = receivers[receivers["observatory"].isin(wanted)]
    absent = [name for name in wanted if name not in set(chosen["observatory"])]
    if absent:
        warn(f"Left out, not in the ephemeris at this time: {', '.join(absent)}")
    return chosen


def _seconds(value: str, option: str) -> float:
    try:
        seconds = float(value)
    except ValueError as error:
        raise InputError(f"--sigma {option}: {value!r} is not a number; write 38 or WIND=60,STEREO-A=38") from error
    if not seconds > 0:
        raise InputError(f"--sigma {option}: {value} s is not above 0; give seconds")
    return seconds


def _print_map(uncertainty: "xr.Dataset", output: Path, picture: Path, *, as_json: bool) -> None:
    off = float(uncertainty["closed_form_off"].mean())
    names = [str(name) for name in uncertainty["observatory"].to_numpy()]
    if as_json:
        made = {"observatories": names, "preset": uncertainty.attrs["preset"], "closed_form_off": off}
        print_json(made | {"map": f"{output}", "figure": f"{picture}"})
        return
    say(f"Fleet   {', '.join(names)}")
    say(f"Figure  {picture}")
    say(f"The closed form is off by more than 10 % at {off:.0%} of the nodes, flagged closed_form_off")
    answer(f"Map of the errors of {len(names)} spacecraft in {output}")
