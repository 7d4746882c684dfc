"""The commands ``bella catalogue list``, ``show``, ``prefer``, ``retract``, and tables that ``bella run`` prints."""

import json
import math
import os
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from bella.exceptions import InputError
from bella.flags import APPARENT_SOURCE
from bella.records import REAL_ORIGINS

if TYPE_CHECKING:
    from bella.catalogue import Burst, BurstSummary, Catalogue, Solution
    from bella.records import Origin
    from bella.settings import Settings

out = Console()

Home = Annotated[
    Path | None, typer.Option(help="Folder that holds catalogue, store and figures.", show_default="bella-home")
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")]
OriginOption = Annotated[
    str | None,
    typer.Option(
        help="archive, event, submission, user, simulated, test, or all.", show_default="all but simulated and test"
    ),
]
BurstId = Annotated[str, typer.Argument(help="Such as T3-20120607-1929; bella catalogue list names them.")]
ROWS_SHOWN = 9
WHOLE = frozenset({"burst", "fit", "phi0, deg", "v_sw, km/s"})
"""Columns that are not broken into lines."""
LEFT = frozenset({"burst", "edge", "fit", "observatory", "flags", "answer"})

catalogue_app = typer.Typer(help="Look into the catalogue of bursts, and choose their answers.", no_args_is_help=True)


@catalogue_app.command("list", epilog="Example: bella catalogue list --json")
def list_bursts(
    home: Home = None,
    limit: Annotated[int, typer.Option(help="So many bursts at most, 1 to 1000.")] = 50,
    origin: OriginOption = None,
    retracted: Annotated[bool, typer.Option("--retracted", help="With those that were retracted.")] = False,
    as_json: AsJson = False,
) -> None:
    """List the bursts with their answers, earliest first."""
    from bella.catalogue import BurstQuery

    asked = frozenset(origins_of(origin))
    with closing(open_catalogue(settings_of(home))) as catalogue:
        page = catalogue.bursts(BurstQuery(limit=limit, origins=asked, with_retracted=retracted))
    if as_json:
        out.print_json(json.dumps([burst_row(one) for one in page.bursts]))
        return
    table = new_table(
        f"{len(page.bursts)} of {page.total} bursts", "burst", "origin", "heard by", "MHz", "answer", "pinned"
    )
    for one in page.bursts:
        burst, solution = one.burst, one.preferred
        band = f"{burst.f_low_mhz:g} - {burst.f_high_mhz:g}"
        pinned = "yes" if one.preference and one.preference.chosen_by == "person" else ""
        said = solution.answer.sentence if solution else "no solution"
        said = f"retracted: {burst.retracted.reason}" if burst.retracted else said
        table.add_row(burst.burst_id, burst.origin.value, ", ".join(burst.observatories), band, said, pinned)
    out.print(table)


@catalogue_app.command("show", epilog="Example: bella catalogue show T3-20120607-1929")
def show_burst(burst_id: BurstId, home: Home = None, as_json: AsJson = False) -> None:
    """Print tracks, fits and the answer of a burst, the preferred solution first."""
    with closing(open_catalogue(settings_of(home))) as catalogue:
        summary = catalogue.burst(burst_id)
        if as_json:
            out.print_json(json.dumps(burst_row(summary)))
            return
        for solution in summary.solutions:
            out.print(track_table(catalogue, solution.solution_id))
        fits = [(one.series.edge, catalogue.track_fit(one.solution_id)) for one in summary.solutions]
        out.print(fit_table(fits))
        for solution in summary.solutions:
            which = "Preferred" if solution.preferred else "Other    "
            say(f"{which} {solution.solution_id}: {solution.answer.sentence}")
        say_answer(summary)


@catalogue_app.command(
    "prefer", epilog="Example: bella catalogue prefer T3-20120607-1929 half_maximum --reason 'clean light curves'"
)
def prefer(
    burst_id: BurstId,
    series: Annotated[
        str | None,
        typer.Argument(
            help="Series, such as half_rise/posterior/default/2d or its first parts, or a solution id.",
            show_default=False,
        ),
    ] = None,
    reason: Annotated[str, typer.Option(help="Why, in words; kept with the choice.")] = "",
    auto: Annotated[bool, typer.Option("--auto", help="Pin nothing: let the rule choose again.")] = False,
    home: Home = None,
) -> None:
    """Choose which series of a burst is its answer, whatever is published later."""
    if (series is None) != auto:
        raise InputError("name one series (bella catalogue show lists them), or give --auto for the rule")
    if auto and reason:
        raise InputError("--reason belongs to a choice of yours: leave it out with --auto")
    from bella.logs import log_to

    settings = settings_of(home)
    with closing(open_catalogue(settings)) as catalogue:
        log_to(settings.home / "logs" / "bella.log")
        chosen = catalogue.prefer_by_rule(burst_id) if series is None else catalogue.prefer(burst_id, series, reason)
        say(f"Preferred {chosen.solution_id}")
        say_answer(catalogue.burst(burst_id))


@catalogue_app.command("retract", epilog="Example: bella catalogue retract T3-20120607-1929 --reason 'interference'")
def retract(
    name: Annotated[str, typer.Argument(help="Id of a burst or of a solution.")],
    reason: Annotated[str, typer.Option(help="Why, in one line; it is published.")],
    home: Home = None,
) -> None:
    """Retract a burst or one solution: it stays where it is, marked, and is no answer any more."""
    from bella.logs import log_to

    settings = settings_of(home)
    with closing(open_catalogue(settings)) as catalogue:
        log_to(settings.home / "logs" / "bella.log")
        burst_id = catalogue.retract(name, reason)
        say(f"Retracted {name}")
        say_answer(catalogue.burst(burst_id))


def origins_of(text: str | None) -> "tuple[Origin, ...]":
    """Origins that an option asks for."""
    from bella.records import ALL_ORIGINS, Origin, origins_asked

    try:
        return origins_asked(text)
    except ValueError as error:
        raise InputError(f"--origin {text!r}: give one of {', '.join([*Origin, ALL_ORIGINS])}") from error


def settings_of(home: Path | None) -> "Settings":
    """Settings of the environment; `home` wins, and is handed on to what reads the environment later."""
    from bella.settings import read_settings

    if home is not None:
        os.environ["BELLA_HOME"] = str(home.resolve())
    return read_settings()


def open_catalogue(settings: "Settings", *, create: bool = False) -> "Catalogue":
    """Catalogue of the settings."""
    from bella.catalogue import Catalogue

    return Catalogue.open(settings.catalogue_url, create=create)


def burst_row(one: "BurstSummary") -> dict[str, Any]:
    """A burst for JSON: all that the table has, and its solutions."""
    burst, preference, preferred = one.burst, one.preference, one.preferred
    return {
        "burst_id": burst.burst_id,
        "start_utc": f"{burst.start_utc:%Y-%m-%dT%H:%M:%SZ}",
        "origin": burst.origin.value,
        "retracted": {
            "reason": burst.retracted.reason,
            "retracted_utc": f"{burst.retracted.retracted_utc:%Y-%m-%dT%H:%M:%SZ}",
        }
        if burst.retracted
        else None,
        "observatories": list(burst.observatories),
        "f_low_mhz": burst.f_low_mhz,
        "f_high_mhz": burst.f_high_mhz,
        "preferred": preferred.solution_id if preferred else None,
        "answer": preferred.answer.model_dump() if preferred else None,
        "calibration": calibration_sentence(burst, preferred) if preferred else None,
        "chosen_by": preference.chosen_by if preference else None,
        "reason": preference.reason if preference else None,
        "solutions": [solution.solution_id for solution in one.solutions],
    }


def new_table(title: str, *columns: str) -> Table:
    """Empty table; columns of words are to the left."""
    table = Table(
        title=title, title_justify="left", title_style="bold", caption_justify="left", box=SIMPLE_HEAD, pad_edge=False
    )
    for name in columns:
        table.add_column(name, justify="left" if name in LEFT else "right", no_wrap=name in WHOLE)
    return table


def track_table(catalogue: "Catalogue", solution_id: str) -> Table:
    """Positions of a solution, at most nine."""
    rows = catalogue.localisations(solution_id)
    table = new_table(solution_id, "MHz", "R_sun", "longitude", "sd x, y", "68 % area", "emitted", "speed")
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


def fit_table(fits: list[tuple[str, dict[str, Any]]]) -> Table:
    """Spirals by edge and method: medians with their 68 % intervals."""
    table = new_table("Parker spiral behind the track", "edge", "fit", "days", "phi0, deg", "v_sw, km/s", "flags")
    for edge, track in fits:
        beside = track.get("companions", {})
        lines = [("joint", track.get("joint")), ("fused", beside.get("fused")), ("two-step", track.get("two_step"))]
        lines += [("two-step", line) for line in track.get("two_step_other_rotations", {}).values()]
        for name, fit in lines:
            if fit and "phi0_deg" in fit:
                table.add_row(edge, name, *_fit_row(fit))
    for paper in {json.dumps(one): one for _, track in fits if (one := track.get("published"))}.values():
        table.add_row("the paper", "two-step", *_fit_row(paper))
    table.caption = (
        "Medians with 68 % intervals. joint: to the arrival times. fused: also to\n"
        "measured wind, wave directions. two-step: through the positions, formal\n"
        "errors. days: rotation assumed.\n"
        f"All: {APPARENT_SOURCE}"
    )
    return table


def _fit_row(fit: dict[str, Any]) -> tuple[str, str, str, str]:
    from bella.answer import written_68, written_wind

    period = fit.get("rotation_period_d")
    longitude, speed = written_68(fit.get("phi0_deg")) or "-", written_wind(fit).removesuffix(" km/s") or "-"
    return f"{period:g}" if period else "-", longitude, speed, ", ".join(fit.get("flags", ()))


def say_answer(summary: "BurstSummary") -> None:
    """The answer about a burst as the last line, and who chose it."""
    preferred, preference = summary.preferred, summary.preference
    if summary.burst.origin not in REAL_ORIGINS:
        say(f"{summary.burst.burst_id} is of {summary.burst.origin} data, not of the Sun")
    if summary.burst.retracted is not None:
        say(f"{summary.burst.burst_id}: retracted: {summary.burst.retracted.reason}")
        return
    if preferred is None or preference is None:
        say(f"{summary.burst.burst_id}: no solution")
        return
    say(calibration_sentence(summary.burst, preferred))
    by = "chosen by the rule" if preference.chosen_by == "rule" else "pinned"
    why = f", {preference.reason}" if preference.chosen_by == "person" and preference.reason else ""
    say(f"{summary.burst.burst_id}: {preferred.answer.sentence} ({preferred.series.name}, {by}{why})")


def calibration_sentence(burst: "Burst", solution: "Solution") -> str:
    """How often answers about simulated bursts like this one held the truth."""
    from bella.calibration.tried import NOT_TRIED, PAGE, Answered, tried

    series, answer = solution.series, solution.answer
    real = Answered(
        len(burst.observatories),
        series.edge,
        answer.tier,
        answer.grade,
        method=series.method,
        preset=series.preset,
        origin=solution.origin,
    )
    found = tried(real)
    return f"{found.sentence} See {PAGE}" if found else NOT_TRIED


def say(line: str) -> None:
    """Print a line as one line, so that a path in it can be copied."""
    out.print(line, soft_wrap=True, highlight=False, markup=False)
