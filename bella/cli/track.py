"""The command ``bella fit-track``: the spiral behind a burst, from its arrival times."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bella.cli.options import (
    AsJson,
    CovarianceFile,
    check_file,
    check_output,
    delay_option,
    know_updates,
    numbers,
)
from bella.cli.output import answer, new_table, out, say, show, steps, write_whole
from bella.exceptions import InputError
from bella.heliosphere.parker import SIDEREAL_ROTATION_D
from bella.heliosphere.scattering import LITERATURE_DELAY

if TYPE_CHECKING:
    from bella.records import JointTrack, Moment, Parameter, Track
    from bella.tracks import TrackModel, WindPrior

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
    covariance: CovarianceFile = None,
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
            help="Arrival table by another definition of the edge, CSV: of two spacecraft, both must agree.",
            show_default="none",
        ),
    ] = None,
    compare: Annotated[
        bool, typer.Option("--compare", help="Weigh models with a density law, a beam law, and a wind that changes.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Fit spiral, wind and beam of a burst to its arrival times."""
    from bella.answer import answer_of
    from bella.arrivals import read_arrivals, read_covariance
    from bella.multilateration.priors import find_preset
    from bella.tracks import TrackRecipe, fit_table
    from bella.tracks.directions import read_directions

    find_preset(preset)
    check_output(output)
    if not 0 <= directions_floor <= 180:
        raise InputError(f"--directions-floor {directions_floor:g} is not between 0 and 180; give degrees")
    model, measured = _model(kappa, rotation), _wind(wind)
    for path in filter(None, (arrivals, covariance, directions, other_edges)):
        check_file(path)
    know_updates()
    table = read_arrivals(arrivals, received_by=2)
    recipe = TrackRecipe(
        model,
        preset,
        read_covariance(covariance, len(table)) if covariance else None,
        compare=compare,
        directions=read_directions(directions) if directions else None,
        floor_deg=directions_floor,
        wind=measured,
        other_edges=read_arrivals(other_edges, received_by=2) if other_edges else None,
    )
    with steps("positions", table["frequency_mhz"].nunique()) as advance:
        track = fit_table(table, recipe, advance)
    text = track.model_dump_json(indent=2) + "\n"
    write_whole(output, text)
    if as_json:
        out.print_json(text)
        return
    _print_fit(track)
    say(f"Fit    {output}")
    answer(answer_of(track, ()).sentence)


def _model(kappa: str | None, rotation: float) -> "TrackModel":
    from bella.tracks import TrackModel

    if not 1 <= rotation <= 100:
        raise InputError(f"--rotation {rotation:g} is not between 1 and 100 days; the sidereal period is 25.38")
    delay = delay_option(kappa)
    model = TrackModel(rotation_period_d=rotation)
    return model if delay is None else replace(model, delay=delay)


def _wind(text: str | None) -> "WindPrior | None":
    from bella.tracks import measured_wind

    return None if text is None else measured_wind(*numbers(text, "--wind", (2, 4), "390,25"))


def _print_fit(track: "Track") -> None:
    from bella.answer import wind_gap, written_68

    joint, line = track.joint, track.two_step
    if joint.tier == "preliminary":
        _print_regions(joint)
        return
    columns = ("", "median (68 %)", "95 %", "of prior", "two-step")
    table = new_table(f"Track of the burst: {joint.model}", *columns, left=("",))
    for name, (label, decimals) in SHOWN.items():
        cells, two_step = _cells(getattr(joint, name), decimals), written_68(line.get(name), decimals) or "-"
        if name == "v_sw_km_s":
            cells = (wind_gap(joint.model_dump()) or cells[0], *cells[1:])
            two_step = wind_gap(line) or two_step
        table.add_row(label, *cells, two_step)
    table.add_row("release of the beam, UTC", *_release_cells(joint.release_utc), "")
    show(table)
    say(f"Remark {track.remark}")
    for which, flags in (("joint", joint.flags), ("two-step", line.get("flags", ()))):
        say(f"Flags  {which}: {', '.join(flags) or 'none'}")
    for text in (*_account(joint), *_beside(track)):
        say(text)


def _print_regions(joint: "JointTrack") -> None:
    """What two spacecraft say: a list of longitudes with their probabilities."""
    say(f"Track of the burst: {joint.model}")
    for level, parts in (("68 %", joint.phi0_68), ("95 %", joint.phi0_95)):
        each = ", ".join(f"{one.low:.0f} to {one.high:.0f} ({one.probability:.2f})" for one in parts)
        say(f"Longitude at 1 R_sun, deg, {level}: {each}")
    say(f"Flags  {', '.join(joint.flags) or 'none'}")


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
