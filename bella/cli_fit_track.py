"""The command ``bella fit-track``: the spiral behind a burst, from its arrival times."""

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from bella.cli_ephemeris import know_updates
from bella.cli_output import steps, write_whole
from bella.exceptions import InputError

if TYPE_CHECKING:
    from bella.tracks import JointModel, WindPrior

out, err = Console(), Console(stderr=True)

EPILOG = "Example: bella fit-track arrivals.csv --output track.json"
MOST_KNOTS = 2
SHOWN = {
    "phi0_deg": ("longitude at 1 R_sun, deg", 1),
    "v_sw_km_s": ("solar wind, km/s", 0),
    "beam_speed_c": ("beam, c", 3),
    "a_rsun": ("distance at 0.55 MHz, R_sun", 1),
    "b": ("exponent of distance on frequency", 3),
    "b2": ("the same below the break", 3),
    "deceleration": ("exponent of the slowing", 3),
}
"""Name and decimals of each parameter of the table."""


def fit_track(  # noqa: PLR0913, PLR0917 - one argument per option
    arrivals: Annotated[Path, typer.Argument(help="Arrival table, CSV.")],
    output: Annotated[Path, typer.Option(help="Fit to write, JSON.")],
    preset: Annotated[
        str, typer.Option(help="Timing errors of both fits, priors of the two-step positions: default, paper, ...")
    ] = "default",
    phi0_prior: Annotated[
        str, typer.Option(help="Centre and standard deviation of the prior of the longitude at the Sun, degrees HEE.")
    ] = "0,60",
    common_sigma: Annotated[
        float | None,
        typer.Option(help="Timing offset all channels of a spacecraft share, s.", show_default="offset_sd_s of table"),
    ] = None,
    rotation: Annotated[float, typer.Option(help="Rotation period of the Sun, days.")] = 25.38,
    slowing_beam: Annotated[bool, typer.Option("--slowing-beam", help="Let the beam slow down.")] = False,
    two_slope: Annotated[
        bool, typer.Option("--two-slope", help="Let the distance follow another power below 0.55 MHz.")
    ] = False,
    directions: Annotated[
        Path | None, typer.Option(help="Wave directions to fit as well, CSV.", show_default="none")
    ] = None,
    directions_floor: Annotated[float, typer.Option(help="Error directions of a spacecraft share, degrees.")] = 0.0,
    wind_prior: Annotated[
        str | None,
        typer.Option(help="Wind speed along the track and its deviation, km/s, such as 390,25.", show_default="none"),
    ] = None,
    compare: Annotated[
        bool, typer.Option("--compare", help="Weigh all variants of the model, and winds that change on the way.")
    ] = False,
    fallback: Annotated[
        bool, typer.Option(help="Sample with PyMC where importance sampling finds too few draws.")
    ] = True,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False,
) -> None:
    """Fit spiral, wind and beam of a burst to its arrival times."""
    from bella.answer import answer_of, read_track
    from bella.arrivals import read_arrivals
    from bella.flags import APPARENT_SOURCE
    from bella.tracks import JointOptions, TrackRecipe, read_directions
    from bella.tracks import fit_track as fit

    _check_output(output)
    model = _model(phi0_prior, rotation, slowing_beam, two_slope)
    if common_sigma is not None and not 0 <= common_sigma < math.inf:
        raise InputError(f"--common-sigma {common_sigma} is not 0 or more; give seconds")
    wind = _wind(wind_prior)
    if not 0 <= directions_floor <= 180:
        raise InputError(f"--directions-floor {directions_floor:g} is not between 0 and 180; give degrees")
    know_updates()
    table = read_arrivals(arrivals)
    recipe = TrackRecipe(
        model,
        preset,
        common_sigma,
        others=model.variants[1:] if compare else (),
        most_knots=MOST_KNOTS if compare else 0,
        directions=read_directions(directions) if directions else None,
        floor_deg=directions_floor,
        wind=wind,
        options=JointOptions(fallback=fallback),
    )
    with steps("positions", table["frequency_mhz"].nunique()) as advance:
        track = {"remark": APPARENT_SOURCE} | fit(table, recipe, advance)
    text = json.dumps(track, indent=2, allow_nan=False) + "\n"
    write_whole(output, text)
    if as_json:
        out.print_json(text)
        return
    _print_fit(track)
    out.print(f"Fit    {output}", soft_wrap=True, highlight=False)
    out.print(f"Answer {answer_of(read_track(track), ()).sentence}", soft_wrap=True, highlight=False)


def _check_output(output: Path) -> None:
    if not output.parent.is_dir():
        raise InputError(f"folder {output.parent} does not exist; make it or name another --output")
    if output.is_dir():
        raise InputError(f"{output} is a folder; name a file with --output")


def _model(phi0_prior: str, rotation: float, slowing_beam: bool, two_slope: bool) -> "JointModel":
    from bella.tracks import JointModel, JointPriors

    if not 1 <= rotation <= 100:
        raise InputError(f"--rotation {rotation:g} is not between 1 and 100 days; the sidereal period is 25.38")
    centre, sd = _centre_and_sd(phi0_prior)
    priors = JointPriors(phi0_deg=centre, phi0_sd_deg=sd)
    return JointModel(priors, rotation, deceleration=slowing_beam, two_slope=two_slope)


def _wind(text: str | None) -> "WindPrior | None":
    from bella.tracks import WindPrior

    if text is None:
        return None
    try:
        speed, sd = (float(part) for part in text.split(","))
    except ValueError as error:
        raise InputError(f"--wind-prior {text}: not two numbers; write 390,25") from error
    return WindPrior(speed, sd)


def _centre_and_sd(text: str) -> tuple[float, float]:
    try:
        centre, sd = (float(part) for part in text.split(","))
    except ValueError as error:
        raise InputError(f"--phi0-prior {text}: not two numbers; write 0,60") from error
    if not (abs(centre) <= 360 and 1 <= sd <= 180):
        raise InputError(f"--phi0-prior {text}: give a centre within 360 degrees and a deviation between 1 and 180")
    return centre, sd


def _print_fit(track: dict[str, Any]) -> None:
    from bella.answer import wind_gap

    joint, line = track["joint"], track["two_step"]
    table = Table(title=f"Track of the burst, {joint['model']}", title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
    for name in ("", "joint (68 %)", "95 %", "contraction", "two-step"):
        table.add_column(name, justify="left" if not name else "right")
    for name, (label, decimals) in SHOWN.items():
        if name in joint:
            cells = _cells(joint[name], decimals)
            two_step = _median(line.get(name, {}), decimals)
            if name == "v_sw_km_s":
                cells, two_step = (wind_gap(joint) or cells[0], *cells[1:]), wind_gap(line) or two_step
            table.add_row(label, *cells, two_step)
    table.add_row("release of the beam, UTC", *_release_cells(joint["release_utc"]), "")
    out.print(table)
    out.print(f"Remark {track['remark']}", soft_wrap=True, highlight=False)
    for which, flags in (("joint", joint["flags"]), ("two-step", line["flags"])):
        out.print(f"Flags  {which}: {', '.join(flags) or 'none'}", soft_wrap=True, highlight=False)
    _print_account(joint)
    for one in track.get("models", []):
        winds = ", ".join(f"{part['v_sw_km_s']['mean']:.0f}" for part in one.get("segments", []))
        speeds = f" ({winds} km/s)" if winds else ""
        line_of_model = f"Model  {one['model']}{speeds}: probability {one['probability']:.3f}"
        out.print(line_of_model, soft_wrap=True, highlight=False)


def _print_account(joint: dict[str, Any]) -> None:
    """What was assumed, weighted down, sampled otherwise, and what each ingredient adds."""
    shared = joint["common_sd_s"]
    lines = [
        f"Assume an offset of {shared[name]:.1f} s shared by all channels of {name}"
        for name in joint["common_sd_assumed"]
    ]
    lines += [
        f"Bad    {one['observatory']} at {one['frequency_mhz']:.3g} MHz: weight {one['weight']:.3f}"
        for one in joint["down_weighted"]
    ]
    lines += ["Sample with PyMC, as too few draws of importance sampling count"] if joint["sampler"] == "nuts" else []
    lines += [_ingredient_line(one) for one in joint["ingredients"]]
    for line in lines:
        out.print(line, soft_wrap=True, highlight=False)


def _ingredient_line(one: dict[str, Any]) -> str:
    begin = f"With   {one['name']}: chi2 {one['chi2']:.0f} of {one['number']}"
    if not one["sd_ratio"]:
        return f"{begin}; the others alone give no track; tension {one['tension']:.1f}"
    widths = ", ".join(f"{name} {one['sd_ratio'][name]:.2f}" for name in ("phi0_deg", "v_sw_km_s"))
    return f"{begin}; errors over those without it: {widths}; tension {one['tension']:.1f}"


def _cells(parameter: dict[str, float | None], decimals: int) -> tuple[str, str, str]:
    low, high, contraction = (parameter[name] for name in ("q2_5", "q97_5", "contraction"))
    if low is None or high is None or contraction is None:
        return "-", "-", "-"
    return _median(parameter, decimals), f"{low:.{decimals}f} to {high:.{decimals}f}", f"{contraction:.2f}"


def _median(parameter: dict[str, float | None], decimals: int) -> str:
    from bella.answer import written_68

    return written_68(parameter, decimals) or "-"


def _release_cells(release: dict[str, Any]) -> tuple[str, str, str]:
    if release["q50"] is None:
        return "-", "-", "-"
    clock = {name: release[name][11:19] for name in ("q2_5", "q16", "q50", "q84", "q97_5")}
    return f"{clock['q50']} ({clock['q16']} to {clock['q84']})", f"{clock['q2_5']} to {clock['q97_5']}", ""
