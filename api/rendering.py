"""The pages' templates, and how numbers, times, flags and reasons are written in them."""

from collections.abc import Iterable, Mapping
from datetime import UTC, datetime, timedelta
from functools import cache
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

from fastapi import Request
from fastapi.responses import HTMLResponse
from jinja2 import Environment, FileSystemLoader, StrictUndefined, pass_context
from jinja2.runtime import Context

from api.links import linked_text, own_path
from bella import __version__
from bella.answer import interval_68, wind_gap, written_68, written_wind
from bella.catalogue import Solution
from bella.flags import COMPANION_FLAGS, FLAGS
from bella.plotting import KINDS, edge_name
from bella.records import DayAnswer
from bella.spacecraft import OBSERVATORIES

NOT_COMPARED = "its position is not known, so it was not compared with others"
_ANSWERS = {
    DayAnswer.NO_DATA: "the archives were asked and have no file of this day.",
    DayAnswer.ARCHIVE_SILENT: "an archive could not be asked, so it is not known whether there are files of this day.",
    DayAnswer.NOT_SEARCHABLE: "there are files, but a burst could not be found in them whatever the Sun did.",
    DayAnswer.NO_BURST: "the spectra were searched, and no burst was found in them.",
    DayAnswer.NOT_LOCALISABLE: "bursts were found, but none could be localised.",
    DayAnswer.LOCALISED: "at least one burst was localised.",
}
TEMPLATES = Path(__file__).parent / "templates"


def flag_meaning(flag: str) -> str:
    """What a quality flag means, for a reader of the page."""
    return (FLAGS | COMPANION_FLAGS).get(flag, flag.replace("_", " "))


def answer_words(answer: DayAnswer) -> str:
    """What an answer about a day means, for a reader of the page."""
    return _ANSWERS[answer]


def answer_class(answer: DayAnswer) -> str:
    """Name of an answer in style sheets, such as answer-no-burst."""
    return f"answer-{answer.value.replace(' ', '-')}"


def reason_words(reason: str) -> str:
    """Why a burst was not localised, or a candidate refused, for a reader of the page."""
    return reason.removeprefix("not localisable: ").replace("_", " ").replace(" mhz", " MHz")


MINUS, DASH = "\N{MINUS SIGN}", "\N{EN DASH}"


def is_page(request: Request) -> bool:
    """Whether a request is for a page, not for the API or a file."""
    accepts = request.headers.get("accept", "")
    return "text/html" in accepts and not own_path(request.scope).startswith(("/api/", "/health", "/static/"))


def render(
    request: Request, template: str, *, status: int = 200, headers: Mapping[str, str] | None = None, **values: Any
) -> HTMLResponse:
    """Page from a template.

    Parameters
    ----------
    template : str
        File name in the folder of templates.
    **values : Any
        What the template speaks of.
    """
    text = (
        environment()
        .get_template(template)
        .render(path=own_path(request.scope), query=request.query_params.multi_items(), status=status, **values)
    )
    return HTMLResponse(linked_text(text), status, headers)


@cache
def environment() -> Environment:
    """Templates with their filters."""
    made = Environment(
        loader=FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters.update(
        utc=written_time,
        day=written_day,
        clock=written_clock,
        minute=written_minute,
        sentence=written_sentence,
        series_query=series_query,
        changed=changed_query,
        interval=written_interval,
        number=written_number,
        middle=written_middle,
        moment=written_moment,
        two=written_two,
        band=written_band,
        has_number=has_number,
        wind_gap=wind_gap,
        wind=written_speed,
        crafts=written_crafts,
        edge=edge_name,
        meaning=flag_meaning,
        why=reason_words,
        answer_words=answer_words,
        answer_class=answer_class,
    )
    made.globals.update(version=__version__, kinds=KINDS)
    return made


def written_time(moment: datetime) -> str:
    """Time as 2012-06-07 19:29:15 UTC."""
    return f"{_in_utc(moment):%Y-%m-%d %H:%M:%S} UTC"


def written_day(moment: datetime) -> str:
    """Day as 2012-06-07."""
    return f"{_in_utc(moment):%Y-%m-%d}"


def written_clock(moment: datetime) -> str:
    """Time of day as 19:29:15."""
    return f"{_in_utc(moment):%H:%M:%S}"


def written_minute(moment: datetime) -> str:
    """Time of day as 19:29."""
    return f"{_in_utc(moment):%H:%M}"


def written_sentence(sentence: str) -> str:
    """Answer of a solution without its grade, which pages show beside it, and with the sign of the Sun."""
    return sentence.partition(", grade ")[0].replace("R_sun", "R\N{SUN}")


def series_query(solution: Solution, *, with_version: bool = False) -> str:
    """Query of an address that asks for the series of a solution, or for just this version of it."""
    series = solution.series
    asked: dict[str, Any] = {"edge": series.edge, "method": series.method, "preset": series.preset}
    return urlencode(asked | ({"version": solution.version} if with_version else {}))


@pass_context
def changed_query(context: Context, values: Mapping[str, str]) -> str:
    """Address of the page that is rendered with other values in its query; an empty one takes the name out."""
    kept = [(name, value) for name, value in context["query"] if name not in values]
    asked = urlencode([*kept, *((name, value) for name, value in values.items() if value)], safe=",:")
    return f"?{asked}" if asked else str(context["path"])


def written_crafts(names: Iterable[str]) -> str:
    """Names of spacecraft, in the same order on every page."""
    known = {name: place for place, name in enumerate(OBSERVATORIES)}
    return ", ".join(sorted(names, key=lambda name: (known.get(name, len(known)), name)))


def written_interval(parameter: Mapping[str, Any] | None, digits: int = 1) -> str:
    """Fitted parameter as its median with the 68 % interval; a dash where there is no number."""
    return written_68(parameter, digits).replace("-", MINUS) or DASH


def written_speed(fit: Mapping[str, Any], unit: str = "") -> str:
    """Speed of the wind of a fit as its median with the 68 % interval, or why there is none."""
    said = written_wind(fit)
    return said.removesuffix(" km/s") + (unit if said.endswith(" km/s") else "") if said else DASH


def written_number(value: float, digits: int = 0) -> str:
    """Number with so many decimals and a real minus sign."""
    return f"{value:.{digits}f}".replace("-", MINUS)


def written_middle(parameter: Mapping[str, Any] | None, digits: int = 0) -> str:
    """Median of a parameter; a dash where there is none."""
    known = interval_68(parameter)
    return written_number(known[0], digits) if known else DASH


def written_moment(value: Mapping[str, Any] | None) -> str:
    """Time of day with its 68 % interval; a dash where there is none."""
    value = value or {}
    middle, low, high = (value.get(name) for name in ("q50", "q16", "q84"))
    if middle and low and high:
        return f"{middle[11:19]} ({low[11:19]} to {high[11:19]})"
    if not value.get("mean"):
        return DASH
    mean, sd = datetime.fromisoformat(value["mean"]), timedelta(seconds=value.get("sd") or 0.0)
    return f"{mean:%H:%M:%S} ({mean - sd:%H:%M:%S} to {mean + sd:%H:%M:%S})"


def written_two(value: float | None) -> str:
    """Number with two significant digits; a dash where there is none."""
    return DASH if value is None else f"{value:#.2g}".rstrip(".")


def written_band(burst: Any, digits: int = 2) -> str:
    """Lowest and highest frequency of a burst or detection, MHz; one where they are the same."""
    ends = (f"{one:.{digits}g}" for one in (burst.f_low_mhz, burst.f_high_mhz))
    return "\N{EN DASH}".join(dict.fromkeys(ends))


def has_number(parameter: Mapping[str, Any] | None) -> bool:
    """Whether a parameter has a median."""
    return interval_68(parameter) is not None


def _in_utc(moment: datetime) -> datetime:
    return moment.replace(tzinfo=UTC) if moment.tzinfo is None else moment.astimezone(UTC)
