"""The command ``bella fit-track``: the spiral behind a burst, from its arrival times."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from bella.cli.ephemeris import know_updates
from bella.cli.output import steps, write_whole
from bella.exceptions import InputError
from bella.heliosphere.parker import SIDEREAL_ROTATION_D
from bella.heliosphere.scattering import LITERATURE_DELAY, NO_DELAY, DirectionalDelay

if TYPE_CHECKING:
    from bella.records import JointTrack, Moment, Parameter, Track
    from bella.tracks import TrackModel, WindPrior

out, err = Console(), Console(stderr=True)

EPILOG = "Example: bella fit-track arrivals.csv --output track.json"
SHOWN = {
    "phi0_deg": ("longitude at 1 R_sun, deg", 1),
    "v_sw_km_s": ("solar wind, km/s", 0),
    "beam_speed_c": ("beam, c", 3),
}
"""Name and decimals of each parameter of the table."""


def fit_track(  # noqa: PLR0913, PLR0917 - one argument per option
    arrivals: Annotated[Path, typer.Argument(help="Arrival table of two spacecraft or more, CSV.")],
    output: Annotated[Path, typer.Option(help="Fit to write, JSON.")],
    preset: Annotated[
        str, typer.Option(help="Timing errors of both fits, priors of the two-step positions: default, paper, ...")
    ] = "default",
    covariance: Annotated[
        Path | None,
        typer.Option(help="Full covariance of the rows, netCDF, as bella arrivals writes it.", show_default="none"),
    ] = None,
    kappa: Annotated[
        str | None,
        typer.Option(
            help="Delay of receivers that the source does not point to, over the rise: mean and deviation, or none.",
            show_default=f"{LITERATURE_DELAY.kappa:g},{LITERATURE_DELAY.kappa_sd:g}",
        ),
    ] = None,
    rotation: Annotated[float, typer.Option(help="Rotation period of the Sun, days.")] = SIDEREAL_ROTATION_D,
    directions: Annotated[
        Path | None, typer.Option(help="Wave directions to fit as well, CSV.", show_default="none")
    ] = None,
    directions_floor: Annotated[float, typer.Option(help="Error directions of a spacecraft share, degrees.")] = 0.0,
    wind: Annotated[
        str | None,
        typer.Option(
            help="Wind measured in situ and its deviation, km/s, such as 390,25; or with apparent over true distance "
            "and its deviation, such as 390,25,1.7,0.3.",
            show_default="none",
        ),
    ] = None,
    other_edges: Annotated[
        Path | None,
        typer.Option(
            help="Arrival table by another definition of the edge, CSV: two spacecraft are placed where both agree.",
            show_default="none",
        ),
    ] = None,
    compare: Annotated[
        bool, typer.Option("--compare", help="Weigh models with a density law, a beam law, and a wind that changes.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False,
) -> None:
    """Fit spiral, wind and beam of a burst to its arrival times."""
    from bella.answer import answer_of
    from bella.arrivals import read_arrivals, read_covariance
    from bella.tracks import TrackRecipe, fit_table
    from bella.tracks.directions import read_directions

    _check_output(output)
    if not 0 <= directions_floor <= 180:
        raise InputError(f"--directions-floor {directions_floor:g} is not between 0 and 180; give degrees")
    model, measured = _model(kappa, rotation), _wind(wind)
    know_updates()
    table = read_arrivals(arrivals, heard_by=2)
    recipe = TrackRecipe(
        model,
        preset,
        read_covariance(covariance, len(table)) if covariance else None,
        compare=compare,
        directions=read_directions(directions) if directions else None,
        floor_deg=directions_floor,
        wind=measured,
        other_edges=read_arrivals(other_edges, heard_by=2) if other_edges else None,
    )
    with steps("positions", table["frequency_mhz"].nunique()) as advance:
        track = fit_table(table, recipe, advance)
    text = track.model_dump_json(indent=2) + "\n"
    write_whole(output, text)
    if as_json:
        out.print_json(text)
        return
    _print_fit(track)
    out.print(f"Fit    {output}", soft_wrap=True, highlight=False)
    out.print(f"Answer {answer_of(track, ()).sentence}", soft_wrap=True, highlight=False)


def _check_output(output: Path) -> None:
    if not output.parent.is_dir():
        raise InputError(f"folder {output.parent} does not exist; make it or name another --output")
    if output.is_dir():
        raise InputError(f"{output} is a folder; name a file with --output")


def _model(kappa: str | None, rotation: float) -> "TrackModel":
    from bella.tracks import TrackModel

    if not 1 <= rotation <= 100:
        raise InputError(f"--rotation {rotation:g} is not between 1 and 100 days; the sidereal period is 25.38")
    if kappa is None:
        return TrackModel(rotation_period_d=rotation)
    if kappa == "none":
        return TrackModel(rotation_period_d=rotation, delay=NO_DELAY)
    mean, sd = _numbers(kappa, "--kappa", (2,), "0.1,0.12")
    if not (abs(mean) <= 2 and 0 <= sd <= 2):
        raise InputError(f"--kappa {kappa}: give a mean within 2 and a deviation between 0 and 2")
    return TrackModel(rotation_period_d=rotation, delay=DirectionalDelay(mean, sd))


def _wind(text: str | None) -> "WindPrior | None":
    from bella.tracks import measured_wind

    return None if text is None else measured_wind(*_numbers(text, "--wind", (2, 4), "390,25"))


def _numbers(text: str, option: str, counts: tuple[int, ...], example: str) -> tuple[float, ...]:
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError as error:
        raise InputError(f"{option} {text}: not numbers; write {example}") from error
    if len(values) not in counts:
        raise InputError(f"{option} {text}: give {' or '.join(map(str, counts))} numbers, such as {example}")
    return values


def _print_fit(track: "Track") -> None:
    from bella.answer import wind_gap, written_68

    joint, line = track.joint, track.two_step
    if joint.tier == "preliminary":
        _print_regions(joint)
        return
    table = Table(title=f"Track of the burst: {joint.model}", title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
    for name in ("", "median (68 %)", "95 %", "of prior", "two-step"):
        table.add_column(name, justify="left" if not name else "right")
    for name, (label, decimals) in SHOWN.items():
        cells, two_step = _cells(getattr(joint, name), decimals), written_68(line.get(name), decimals) or "-"
        if name == "v_sw_km_s":
            cells = (wind_gap(joint.model_dump()) or cells[0], *cells[1:])
            two_step = wind_gap(line) or two_step
        table.add_row(label, *cells, two_step)
    table.add_row("release of the beam, UTC", *_release_cells(joint.release_utc), "")
    out.print(table)
    out.print(f"Remark {track.remark}", soft_wrap=True, highlight=False)
    for which, flags in (("joint", joint.flags), ("two-step", line.get("flags", ()))):
        out.print(f"Flags  {which}: {', '.join(flags) or 'none'}", soft_wrap=True, highlight=False)
    for text in (*_account(joint), *_beside(track)):
        out.print(text, soft_wrap=True, highlight=False)


def _print_regions(joint: "JointTrack") -> None:
    """What two spacecraft say: a list of longitudes with their probabilities."""
    out.print(f"Track of the burst: {joint.model}", highlight=False)
    for level, parts in (("68 %", joint.phi0_68), ("95 %", joint.phi0_95)):
        each = ", ".join(f"{one.low:.0f} to {one.high:.0f} ({one.probability:.2f})" for one in parts)
        out.print(f"Longitude at 1 R_sun, deg, {level}: {each}", soft_wrap=True, highlight=False)
    out.print(f"Flags  {', '.join(joint.flags) or 'none'}", soft_wrap=True, highlight=False)


def _account(joint: "JointTrack") -> list[str]:
    """Misfit, noise, and clocks that do not fit."""
    if joint.chi2 is None or joint.noise is None:
        return []
    lines = [f"Misfit chi2 {joint.chi2:.0f} for {joint.freedom} degrees of freedom, p = {joint.misfit_p:.2g}"]
    if joint.noise.added:
        lines += [f"Noise  errors of {joint.noise.added:g} of the rise added, which the table does not state"]
    if "clock_offset" in joint.flags:
        lines += [
            f"Clock  {name} {one.mean:.0f} ± {one.sd:.0f} s"
            for name, one in joint.offsets_s.items()
            if one.mean is not None and one.sd is not None and abs(one.mean) > 3 * one.sd
        ]
    return lines


def _beside(track: "Track") -> list[str]:
    """What further data add, and models by their evidence."""
    fused, models = (track.companions.get(name, {}) for name in ("fused", "models"))
    lines = [
        f"With   {one['name']}: intervals over those without, "
        + ", ".join(f"{name} {ratio:.2f}" for name, ratio in one["sd_ratio"].items())
        + f"; tension {one['tension']:.1f}"
        for one in fused.get("ingredients", [])
    ]
    return lines + [f"Model  {row['name']}: probability {row['probability']:.3f}" for row in models.get("rows", [])]


def _cells(parameter: "Parameter", decimals: int) -> tuple[str, str, str]:
    if parameter.q50 is None:
        return "-", "-", "-"
    shown = f"{parameter.q50:.{decimals}f} ({parameter.q16:.{decimals}f} to {parameter.q84:.{decimals}f})"
    contraction = "-" if parameter.contraction is None else f"{parameter.contraction:.2f}"
    return shown, f"{parameter.q2_5:.{decimals}f} to {parameter.q97_5:.{decimals}f}", contraction


def _release_cells(release: "Moment") -> tuple[str, str, str]:
    if release.q50 is None or release.q2_5 is None or release.q97_5 is None:
        return "-", "-", "-"
    return f"{release.q50[11:19]} ± {release.sd:.0f} s", f"{release.q2_5[11:19]} to {release.q97_5[11:19]}", ""
