"""The commands ``bella catalogue list``, ``show``, ``prefer``, ``retract``, and tables that ``bella run`` prints."""

import json
from collections.abc import Collection
from contextlib import closing
from dataclasses import asdict
from datetime import UTC, datetime, time, timedelta
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bella.cli.localise import position_table
from bella.cli.options import AsJson, Home, open_catalogue, settings_of
from bella.cli.output import answer, new_table, print_json, say, show
from bella.exceptions import InputError
from bella.flags import APPARENT_SOURCE, FLAGS
from bella.records import REAL_ORIGINS
from bella.times import parse_day

if TYPE_CHECKING:
    from rich.table import Table

    from bella.catalogue import Burst, BurstSummary, Catalogue, Localisation, Solution
    from bella.linked_events import Link
    from bella.records import Origin

OriginOption = Annotated[
    str | None,
    typer.Option(
        help="archive, event, submission, user, simulated, test, or all.", show_default="all but simulated and test"
    ),
]
METHODS = ("posterior", "nuts", "tdoa")
BurstId = Annotated[str, typer.Argument(help="Such as T3-20120607-1929; bella catalogue list names them.")]

catalogue_app = typer.Typer(help="Look into the catalogue of bursts, and choose their answers.", no_args_is_help=True)


@catalogue_app.command("list", epilog="Example: bella catalogue list --from 2012-06-01 --grade AB --json")
def list_bursts(  # noqa: PLR0913, PLR0917 - one argument per option
    home: Home = None,
    first: Annotated[str | None, typer.Option("--from", help="First day of the onset, UTC.")] = None,
    last: Annotated[str | None, typer.Option("--to", help="Last day of the onset, UTC.")] = None,
    observatory: Annotated[
        list[str] | None, typer.Option(help="Spacecraft that detected it; may be given again: all of them.")
    ] = None,
    grade: Annotated[str | None, typer.Option(help="Grades of the answer, such as AB.", show_default="all")] = None,
    tier: Annotated[str | None, typer.Option(help="final or preliminary.", show_default="both")] = None,
    flag: Annotated[list[str] | None, typer.Option(help="Flag that the answer has; may be given again.")] = None,
    without_flag: Annotated[
        list[str] | None, typer.Option(help="Flag that the answer does not have; may be given again.")
    ] = None,
    edge: Annotated[list[str] | None, typer.Option(help="Edge that it may come from; may be given again.")] = None,
    method: Annotated[list[str] | None, typer.Option(help="Method that it may come from; may be given again.")] = None,
    frequency_min: Annotated[float | None, typer.Option(help="The band reaches it or higher, MHz.")] = None,
    frequency_max: Annotated[float | None, typer.Option(help="The band reaches it or lower, MHz.")] = None,
    longitude_min: Annotated[
        float | None, typer.Option(help="From this longitude (HEE degrees, west positive) westward ...")
    ] = None,
    longitude_max: Annotated[
        float | None, typer.Option(help="... to this one, across 180 where it is smaller.")
    ] = None,
    latitude_min: Annotated[float | None, typer.Option(help="Sources reach it or farther north, HEE degrees.")] = None,
    latitude_max: Annotated[float | None, typer.Option(help="Sources reach it or farther south, HEE degrees.")] = None,
    distance_min: Annotated[float | None, typer.Option(help="Sources reach it or farther, solar radii.")] = None,
    distance_max: Annotated[float | None, typer.Option(help="Sources reach it or nearer, solar radii.")] = None,
    wind_min: Annotated[float | None, typer.Option(help="Speed of the wind at least, km/s.")] = None,
    wind_max: Annotated[float | None, typer.Option(help="Speed of the wind at most, km/s.")] = None,
    area_min: Annotated[
        float | None, typer.Option(help="Area of the 68 % region at least, solar radii squared.")
    ] = None,
    area_max: Annotated[
        float | None, typer.Option(help="Area of the 68 % region at most, solar radii squared.")
    ] = None,
    updated_since: Annotated[str | None, typer.Option(help="Changed on this day or later, UTC.")] = None,
    origin: OriginOption = None,
    retracted: Annotated[bool, typer.Option("--retracted", help="With those that were retracted.")] = False,
    sort: Annotated[
        str, typer.Option(help="start, updated, grade, longitude, wind ...; after a minus sign the other way round.")
    ] = "-start",
    limit: Annotated[int, typer.Option(help="Largest number of bursts, 1 to 1000.")] = 50,
    as_json: AsJson = False,
) -> None:
    """List the bursts with their answers, newest first."""
    from bella.catalogue import BurstQuery
    from bella.spacecraft.names import observatory_name

    query = BurstQuery(
        start=None if first is None else _midnight(first, "--from"),
        stop=None if last is None else _midnight(last, "--to") + timedelta(days=1),
        updated_since=None if updated_since is None else _midnight(updated_since, "--updated-since"),
        observatories=frozenset(map(observatory_name, observatory or ())),
        flags=_known(flag, "--flag", FLAGS),
        flags_absent=_known(without_flag, "--without-flag", FLAGS),
        grades=_grades(grade),
        tier=next(iter(_known([tier] if tier else None, "--tier", ("final", "preliminary"))), None),
        edges=frozenset(edge or ()),
        methods=_known(method, "--method", METHODS),
        frequency_min=frequency_min,
        frequency_max=frequency_max,
        longitude_min=longitude_min,
        longitude_max=longitude_max,
        latitude_min=latitude_min,
        latitude_max=latitude_max,
        distance_min=distance_min,
        distance_max=distance_max,
        wind_min=wind_min,
        wind_max=wind_max,
        area_min=area_min,
        area_max=area_max,
        sort=sort,
        limit=limit,
        origins=frozenset(origins_of(origin)),
        with_retracted=retracted,
    )
    with closing(open_catalogue(settings_of(home))) as catalogue:
        page = catalogue.bursts(query)
    if as_json:
        print_json([burst_row(one) for one in page.bursts])
        return
    columns = ("burst", "onset (UTC)", "longitude", "wind", "grade", "detected by", "MHz", "origin", "remark")
    left = ("burst", "detected by", "origin", "remark")
    table = new_table("Bursts", *columns, left=left, whole=("burst", "onset (UTC)"))
    for one in page.bursts:
        table.add_row(*_listed(one))
    show(table)
    answer(f"{len(page.bursts)} of {page.total} bursts")


def _midnight(text: str, option: str) -> datetime:
    return datetime.combine(parse_day(text, option), time(), UTC)


def _known(names: list[str] | None, option: str, known: Collection[str]) -> frozenset[str]:
    """Names that are given, all of them known."""
    if strange := sorted(set(names or ()) - set(known)):
        raise InputError(f"{option} {strange[0]!r}: give one of {', '.join(known)}")
    return frozenset(names or ())


def _grades(text: str | None) -> frozenset[str]:
    from bella.answer import GRADES

    asked = frozenset((text or "").upper().replace(",", ""))
    if not asked <= GRADES.keys():
        raise InputError(f"--grade {text!r}: give some of {', '.join(GRADES)}, such as AB")
    return asked


def _listed(one: "BurstSummary") -> tuple[str, ...]:
    burst, solution = one.burst, one.preferred
    said = solution.answer if solution else None
    longitude = wind = "-"
    if said and said.phi0_deg is not None:
        longitude = _interval(said.phi0_deg, said.phi0_low_deg, said.phi0_high_deg) + "°"
    if said and said.v_sw_km_s is not None:
        wind = _interval(said.v_sw_km_s, said.v_sw_low_km_s, said.v_sw_high_km_s)
    pinned = "pinned" if one.preference and one.preference.chosen_by == "person" else ""
    remark = f"retracted: {burst.retracted.reason}" if burst.retracted else pinned if said else "no solution"
    return (
        burst.burst_id,
        f"{burst.start_utc:%Y-%m-%d %H:%M}",
        longitude,
        wind,
        said.grade if said else "-",
        ", ".join(burst.observatories),
        f"{burst.f_low_mhz:g} - {burst.f_high_mhz:g}",
        burst.origin.value,
        remark,
    )


def _interval(middle: float, low: float | None, high: float | None) -> str:
    return f"{middle:.0f}" if low is None or high is None else f"{middle:.0f} ({low:.0f} to {high:.0f})"


@catalogue_app.command("show", epilog="Example: bella catalogue show T3-20120607-1929")
def show_burst(burst_id: BurstId, home: Home = None, as_json: AsJson = False) -> None:
    """Print tracks, fits and the answer of a burst, the preferred solution first."""
    with closing(open_catalogue(settings_of(home))) as catalogue:
        summary = catalogue.burst(burst_id)
        if as_json:
            near = [asdict(one.event) | {"delay_s": one.delay_s} for one in catalogue.events.of_burst(burst_id)]
            details = [_details(catalogue, one) for one in summary.solutions]
            print_json(burst_row(summary) | {"events": near, "details": details})
            return
        for solution in summary.solutions:
            show(track_table(catalogue, solution.solution_id))
        fits = [(one.series.edge, catalogue.track_fit(one.solution_id)) for one in summary.solutions]
        show(fit_table(fits))
        for link in catalogue.events.of_burst(burst_id):
            say(f"Near      {event_line(link)}")
        for solution in summary.solutions:
            which = "Preferred" if solution.preferred else "Other    "
            say(f"{which} {solution.solution_id}: {solution.answer.sentence}")
        say_answer(summary)


def event_line(link: "Link") -> str:
    """A published event near a burst, in one line."""
    event, minutes = link.event, link.delay_s / 60.0
    when = f"{abs(minutes):.0f} min {'after' if minutes >= 0 else 'before'} it at the Sun"
    parts = (event.kind, event.size, f"{event.start_utc:%Y-%m-%d %H:%M}", f"({when}, {event.event_id})")
    return " ".join(part for part in parts if part)


def _details(catalogue: "Catalogue", solution: "Solution") -> dict[str, Any]:
    """A solution for JSON with its positions and its track."""
    positions = [_position(one) for one in catalogue.localisations(solution.solution_id)]
    return {
        "solution_id": solution.solution_id,
        "preferred": solution.preferred,
        "version": solution.version,
        "series": asdict(solution.series),
        "flags": list(solution.flags),
        "answer": solution.answer.model_dump(),
        "localisations": positions,
        "track": catalogue.track_fit(solution.solution_id),
    }


def _position(row: "Localisation") -> dict[str, Any]:
    return asdict(row) | {"emission_utc": f"{row.emission_utc:%Y-%m-%dT%H:%M:%S.%fZ}"}


@catalogue_app.command(
    "prefer", epilog="Example: bella catalogue prefer T3-20120607-1929 half_maximum --reason 'clean light curves'"
)
def prefer(  # noqa: PLR0913, PLR0917 - one argument per option
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
    as_json: AsJson = False,
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
        _say_changed(catalogue.burst(burst_id), f"Preferred {chosen.solution_id}", as_json=as_json)


@catalogue_app.command("retract", epilog="Example: bella catalogue retract T3-20120607-1929 --reason 'interference'")
def retract(
    name: Annotated[str, typer.Argument(help="Id of a burst or of a solution.")],
    reason: Annotated[str, typer.Option(help="Why, in one line; it is published.")],
    home: Home = None,
    as_json: AsJson = False,
) -> None:
    """Retract a burst or one solution: it stays where it is, marked, and is no answer any more."""
    from bella.logs import log_to

    settings = settings_of(home)
    with closing(open_catalogue(settings)) as catalogue:
        log_to(settings.home / "logs" / "bella.log")
        burst_id = catalogue.retract(name, reason)
        _say_changed(catalogue.burst(burst_id), f"Retracted {name}", as_json=as_json)


def _say_changed(summary: "BurstSummary", done: str, *, as_json: bool) -> None:
    if as_json:
        print_json(burst_row(summary))
        return
    say(done)
    say_answer(summary)


def origins_of(text: str | None) -> "tuple[Origin, ...]":
    """Origins that an option asks for."""
    from bella.records import ALL_ORIGINS, Origin, origins_asked

    try:
        return origins_asked(text)
    except ValueError as error:
        raise InputError(f"--origin {text!r}: give one of {', '.join([*Origin, ALL_ORIGINS])}") from error


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


def track_table(catalogue: "Catalogue", solution_id: str) -> "Table":
    """Positions of a solution, at most nine."""
    return position_table(solution_id, [asdict(row) for row in catalogue.localisations(solution_id)])


def fit_table(fits: list[tuple[str, dict[str, Any]]]) -> "Table":
    """Spirals by edge and method: medians with their 68 % intervals."""
    columns = ("edge", "fit", "days", "phi0, deg", "v_sw, km/s", "flags")
    table = new_table(
        "Parker spiral behind the track", *columns, left=("edge", "fit", "flags"), whole=("edge", "fit", *columns[3:5])
    )
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
    flags = ", ".join(fit.get("flags", ())).replace("_", " ")  # so that lines break between words
    return f"{period:g}" if period else "-", longitude, speed, flags


def say_answer(summary: "BurstSummary") -> None:
    """The answer about a burst as the last line, and who chose it."""
    preferred, preference = summary.preferred, summary.preference
    if summary.burst.origin not in REAL_ORIGINS:
        say(f"{summary.burst.burst_id} is of {summary.burst.origin} data, not of the Sun")
    if summary.burst.retracted is not None:
        answer(f"{summary.burst.burst_id}: retracted: {summary.burst.retracted.reason}")
        return
    if preferred is None or preference is None:
        answer(f"{summary.burst.burst_id}: no solution")
        return
    say(calibration_sentence(summary.burst, preferred))
    by = "chosen by the rule" if preference.chosen_by == "rule" else "pinned"
    why = f", {preference.reason}" if preference.chosen_by == "person" and preference.reason else ""
    answer(f"{summary.burst.burst_id}: {preferred.answer.sentence} ({preferred.series.name}, {by}{why})")


def calibration_sentence(burst: "Burst", solution: "Solution") -> str:
    """How often answers about simulated bursts like this one held the truth."""
    from bella.calibration.tried import NOT_TRIED, PAGE, tried

    found = tried(solution.answered(burst.observatories))
    return f"{found.sentence} See {PAGE}" if found else NOT_TRIED
