"""The command ``bella coverage``: an uncertainty map as netCDF, and its figure."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from bella.cli.ephemeris import instant, know_updates
from bella.cli.output import steps
from bella.exceptions import InputError

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from bella.multilateration.priors import Preset

out, err = Console(), Console(stderr=True)

EPILOG = "Example: bella coverage --at 2012-06-07T19:30 --output map.nc --preset bella-2024"


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
        Path | None, typer.Option(help="Figure to write, PNG.", show_default="name of the map, .png")
    ] = None,
) -> None:
    """Map how well a fleet places a burst, everywhere in the ecliptic plane."""
    from bella.multilateration.priors import find_preset
    from bella.multilateration.uncertainty_map import exact_nodes, uncertainty_map
    from bella.plotting import write_coverage_png
    from bella.spacecraft import OBSERVATORIES

    picture = _check_paths(output, figure)
    chosen = find_preset(preset)
    if chosen.noise.bad_probability or chosen.priors.is_truncated:
        raise InputError(f"a map knows Gaussian errors only, not preset {preset!r}; use default or free-speed")
    receivers = _chosen(_receivers(at, positions), fleet, expected=OBSERVATORIES if positions is None else ())
    given = timing_option(sigma)
    with steps("exact posteriors", exact_nodes(size, exact=exact)) as advance:
        uncertainty = uncertainty_map(
            dict(zip(receivers["observatory"], receivers[["x_rsun", "y_rsun", "z_rsun"]].to_numpy(), strict=True)),
            _sigma(receivers, chosen, given),
            chosen.priors,
            size=size,
            exact=exact,
            epoch=None if at is None else instant(at),
            advance=advance,
        )
    uncertainty.attrs |= {"preset": chosen.name}
    with _reporting(output):
        write_netcdf(uncertainty, output)
    with _reporting(picture):
        write_coverage_png(picture, uncertainty)
    _say(uncertainty, output, picture)


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


def write_netcdf(dataset: "xr.Dataset", path: Path) -> None:
    """Write a dataset as compressed netCDF, floats in single precision, beside the target, then rename.

    Parameters
    ----------
    dataset : xarray.Dataset
    path : Path
        In a folder that exists.
    """
    partial = path.with_name(f".{path.name}.{os.getpid()}")
    maps = [str(name) for name, variable in dataset.data_vars.items() if variable.ndim == 2 and "x" in variable.dims]
    encoding: dict[str, dict[str, object]] = {name: {"zlib": True, "complevel": 4} for name in maps}
    for name in maps:
        if dataset[name].dtype == "float64":
            encoding[name]["dtype"] = "float32"
    try:
        dataset.to_netcdf(partial, engine="h5netcdf", encoding=encoding)
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def _check_paths(output: Path, figure: Path | None) -> Path:
    """Path of the figure; refuses, before any work, what cannot be written."""
    picture = output.with_suffix(".png") if figure is None else figure
    for option, path in (("--output", output), ("--figure", picture)):
        if not path.parent.is_dir():
            raise InputError(f"folder {path.parent} does not exist; make it or name another {option}")
        if path.is_dir():
            raise InputError(f"{path} is a folder; name a file with {option}")
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
        err.print(f"Left out, not in the ephemeris at this time: {', '.join(absent)}")
    return chosen


def _sigma(
    receivers: "pd.DataFrame", preset: "Preset", given: dict[str, float] | float | None
) -> dict[str, float] | float | None:
    """Timing errors: what the option says, else what the rule of the preset says, else the table, else the cadence."""
    if isinstance(given, float):
        return given
    names = list(receivers["observatory"])
    ruled: dict[str, float] = {}
    if preset.sigma_rule == "constant":
        ruled = dict.fromkeys(names, preset.sigma_s)
    elif preset.sigma_rule == "table":
        timed = receivers.dropna(subset=["sigma_s"])
        ruled = dict(zip(timed["observatory"], timed["sigma_s"], strict=True))
    return ruled | (given or {})


def _seconds(value: str, option: str) -> float:
    try:
        seconds = float(value)
    except ValueError as error:
        raise InputError(f"--sigma {option}: {value!r} is not a number; write 38 or WIND=60,STEREO-A=38") from error
    if not seconds > 0:
        raise InputError(f"--sigma {option}: {value} s is not above 0; give seconds")
    return seconds


@contextmanager
def _reporting(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise InputError(f"{path} cannot be written ({error.strerror or error}); name another file") from error


def _say(uncertainty: "xr.Dataset", output: Path, picture: Path) -> None:
    off = float(uncertainty["closed_form_off"].mean())
    names = ", ".join(uncertainty["observatory"].to_numpy())
    for line in (
        f"Fleet   {names}",
        f"Map     {output}",
        f"Figure  {picture}",
        f"The closed form is off by more than 10 % at {off:.0%} of the nodes, flagged closed_form_off",
    ):
        out.print(line, soft_wrap=True, highlight=False)
