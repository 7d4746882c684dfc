"""A catalogue of a million localisations: one real burst, many times, at other times and with other answers."""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from datetime import UTC, date, datetime, time, timedelta
from pathlib import Path
from typing import Any

from sqlalchemy import (
    CHAR,
    Column,
    ColumnElement,
    Connection,
    Double,
    Engine,
    Integer,
    MetaData,
    String,
    Table,
    case,
    cast,
    func,
    insert,
    literal,
    null,
    select,
    text,
)

from bella.catalogue import BurstQuery, Catalogue
from bella.catalogue.engine import connect, parse_url
from bella.catalogue.models import (
    AlertRow,
    Base,
    BurstObservatoryRow,
    BurstRow,
    DetectionRow,
    LocalisationRow,
    PreferenceRow,
    SearchedDayRow,
    SolutionFlagRow,
    SolutionRow,
    SolutionSourceRow,
    TrackFitRow,
    UtcTime,
    table_of,
)
from bella.catalogue.solutions import COPIED_OF_ANSWER
from bella.pipeline.page_figures import first_look_path
from bella.pipeline.rows import all_bursts
from bella.settings import Settings

LOCALISATIONS = 1_000_000
SERIES = ("shared_profile", "half_rise")
"""Series of the real burst that every burst gets: those that a burst of the archive has."""

FIRST_DAY = date(2007, 1, 1)
BURSTS_A_DAY, DETECTIONS_A_DAY = 4, 30
CANDIDATES = DETECTIONS_A_DAY - 3 * BURSTS_A_DAY
"""Rejected detections of a day."""

_CLONE = Table(
    "clone", MetaData(), Column("number", Integer), Column("burst_id", CHAR(16)), Column("shift_s", Integer),
    prefixes=["TEMPORARY"],
)  # fmt: skip
_REAL = "T3-20120607-1929"


@dataclass(frozen=True)
class Large:
    """What was made.

    Attributes
    ----------
    burst_ids : tuple of str
    days : tuple of datetime.date
        With bursts.
    localisations : int
    """

    burst_ids: tuple[str, ...]
    days: tuple[date, ...]
    localisations: int


def make_template(home: Path, draws: int = 500) -> None:
    """Localise the burst of 2012-06-07 as anybody does."""
    bella = Path(sys.executable).with_name("bella")
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "BELLA_DRAWS": f"{draws}"}
    command = [bella, "run", "--direct", "--home", home]
    subprocess.run(command, env=environment, check=True, capture_output=True)


def fill(settings: Settings, template: Path, localisations: int = LOCALISATIONS) -> Large:
    """Fill an empty home with copies of the burst of another one.

    Parameters
    ----------
    settings : Settings
        Of the home to fill; its groups are links to those of the one burst.
    template : pathlib.Path
        Home of `make_template`.
    localisations : int
        At least so many are made.

    Returns
    -------
    Large
    """
    Catalogue.open(settings.catalogue_url, create=True).close()
    known, engine = (connect(parse_url(one)) for one in (_catalogue_of(template), settings.catalogue_url))
    with closing(known.raw_connection()):
        with engine.begin() as connection, known.connect() as real:
            each = _copy_real(real, connection)
            clones = list(_clones(-(-localisations // each) - 1))
            _CLONE.create(connection)
            connection.execute(insert(_CLONE), clones)
            _copy_bursts(connection)
            _add_days(connection, clones)
        _analyse(engine)
    engine.dispose()
    known.dispose()
    burst_ids = tuple(str(one["burst_id"]) for one in clones)
    _link_groups(settings.store_root, template, burst_ids)
    _link_figures(settings, template)
    days = tuple(dict.fromkeys(_start(one).date() for one in clones))
    return Large(burst_ids, days, each * (len(clones) + 1))


def _catalogue_of(home: Path) -> str:
    return Settings(home=home, database_url=None).catalogue_url


def _clones(number: int) -> Iterator[dict[str, Any]]:
    """Every burst at a minute of its own."""
    real = datetime(2012, 6, 7, 19, 29, tzinfo=UTC)
    for place in range(number):
        day, nth = divmod(place, BURSTS_A_DAY)
        start = datetime.combine(FIRST_DAY, time(), UTC) + timedelta(days=day, minutes=37 + 340 * nth + day % 60)
        yield {
            "number": place + 1,
            "burst_id": f"T3-{start:%Y%m%d-%H%M}",
            "shift_s": int((start - real).total_seconds()),
        }


def _start(clone: dict[str, Any]) -> datetime:
    return datetime(2012, 6, 7, 19, 29, tzinfo=UTC) + timedelta(seconds=clone["shift_s"])


def _copy_real(real: Connection, connection: Connection) -> int:
    """Copy the rows of the real burst, two of its series alone; how many localisations these have."""
    wanted = {f"{_REAL}.{edge}.posterior.default.2d.v1" for edge in SERIES}
    found = 0
    for table in Base.metadata.sorted_tables:
        rows: list[dict[str, Any]] = [dict(row) for row in real.execute(select(table)).mappings()]
        if "solution_id" in table.c:
            rows = [row for row in rows if row["solution_id"] in wanted]
        if rows:
            connection.execute(insert(table), rows)
        found += len(rows) if table is table_of(LocalisationRow) else 0
    return found


def _copy_bursts(connection: Connection) -> None:
    """Copy every row of the real burst for each of the others, one statement a table."""
    number, rest = _CLONE.c.number, {"supersedes": null()}
    turned = cast((_CLONE.c.number * 37) % 360 - 180, Double)
    answers = {
        **{name: turned + width for name, width in (("phi0_low_deg", -6.0), ("phi0_deg", 0.0), ("phi0_high_deg", 6.0))},
        "grade": case((number % 8 == 0, "A"), (number % 8 < 5, "B"), (number % 8 < 7, "C"), else_="D"),
        **{
            name: case((number % 3 == 0, cast(300 + number % 300 + width, Double)), else_=null())
            for name, width in (("v_sw_low_km_s", -30), ("v_sw_km_s", 0), ("v_sw_high_km_s", 30))
        },
        "range_high_rsun": cast(60 + number % 100, Double),
        "area68_rsun2": cast(20 + number % 500, Double),
    }
    copied = {f"answer_{name}": one for name, one in answers.items() if f"answer_{name}" in COPIED_OF_ANSWER}
    sequence = select(func.max(table_of(AlertRow).c.sequence)).scalar_subquery()
    for model, own in (
        (BurstRow, {"origin": literal("archive"), **copied}),
        (BurstObservatoryRow, {}),
        (SolutionRow, answers | rest),
        (SolutionFlagRow, {}),
        (SolutionSourceRow, {}),
        (LocalisationRow, {}),
        (TrackFitRow, {}),
        (PreferenceRow, {}),
        (AlertRow, {"sequence": sequence + number, "origin": literal("archive")}),
    ):
        table = table_of(model)
        columns = {column.name: own.get(column.name, _cloned(connection, column)) for column in table.c}
        key = table.c.burst_id if "burst_id" in table.c else table.c.solution_id
        rows = select(*columns.values()).select_from(table.join(_CLONE, key.startswith(_REAL)))
        connection.execute(insert(table).from_select([*columns], rows))


def _cloned(connection: Connection, column: Column[Any]) -> ColumnElement[Any]:
    """Value of a column in the copy of a row."""
    if isinstance(column.type, UtcTime):
        return _shifted(connection, column)
    if column.name.endswith(("burst_id", "solution_id", "answer_id", "_path")):
        return func.replace(column, _REAL, func.trim(_CLONE.c.burst_id))
    return column


def _shifted(connection: Connection, column: Column[Any]) -> ColumnElement[Any]:
    """Time of a burst at the time of its copy."""
    if connection.dialect.name == "sqlite":
        return func.strftime("%Y-%m-%d %H:%M:%f000", column, cast(_CLONE.c.shift_s, String) + " seconds")
    return column.op("+")(func.make_interval(0, 0, 0, 0, 0, 0, _CLONE.c.shift_s))


def _add_days(connection: Connection, clones: list[dict[str, Any]]) -> None:
    """Add searched days with detections: three of each burst, and candidates that were rejected."""
    found: list[dict[str, Any]] = []
    for clone in clones:
        start = _start(clone)
        found += [_detection(start, place, str(clone["burst_id"])) for place in range(3)]
    days = sorted({_start(one).date() for one in clones})
    for day in days:
        midnight = datetime.combine(day, time(), UTC)
        found += [_detection(midnight + timedelta(minutes=50 * place), place % 3, "") for place in range(CANDIDATES)]
    same = {"inputs_hash": "a" * 64, "code_version": "0.2.0", "observatories": "WIND STEREO-A STEREO-B"}
    searched = [{"day": day, "searched_utc": datetime(2026, 1, 1, tzinfo=UTC), **same} for day in days]
    connection.execute(insert(table_of(SearchedDayRow)), searched)
    connection.execute(insert(table_of(DetectionRow)), found)


def _detection(start: datetime, place: int, burst_id: str) -> dict[str, Any]:
    return {
        "day": start.date(),
        "observatory": ("WIND", "STEREO-A", "STEREO-B")[place],
        "start_utc": start + timedelta(minutes=place),
        "peak_utc": start + timedelta(minutes=place + 3),
        "end_utc": start + timedelta(minutes=place + 30),
        "f_low_mhz": 0.15,
        "f_high_mhz": 10.0,
        "score": 12.0,
        "drift": 0.15,
        "peak_db": 21.0,
        "channels": 70,
        "isolated": bool(burst_id),
        "tier": "localisable" if burst_id else "rejected",
        "reason": "" if burst_id else "too_weak",
        "burst_id": burst_id,
        "flux_sfu_1au": 1e4,
    }


def _analyse(engine: Engine) -> None:
    """Let the database tidy up and learn how its tables are filled, as it does by itself in time."""
    tidy = "VACUUM ANALYZE" if engine.dialect.name == "postgresql" else "ANALYZE"
    with engine.connect().execution_options(isolation_level="AUTOCOMMIT") as connection:
        connection.execute(text(tidy))


def _link_groups(store: Path, template: Path, burst_ids: tuple[str, ...]) -> None:
    """Let all bursts have the groups of the real one."""
    real = Settings(home=template).store_root / _REAL
    shutil.copytree(real, store / _REAL)
    for burst_id in burst_ids:
        (store / burst_id).symlink_to(_REAL)


def _link_figures(settings: Settings, template: Path) -> None:
    """Let all bursts have what was drawn of the real one when it was published."""
    with Catalogue.open(settings.catalogue_url) as catalogue:
        for summary in all_bursts(catalogue, BurstQuery(limit=1000)):
            for solution in summary.solutions:
                path = first_look_path(summary.burst, solution, settings)
                path.parent.mkdir(parents=True, exist_ok=True)
                series = solution.solution_id.removeprefix(f"{summary.burst.burst_id}.")
                (drawn,) = (Settings(home=template).figures_root / _REAL).glob(f"page-{series}-*")
                path.symlink_to(drawn.resolve())
