"""Up, down and up again on both databases, and migrations that make exactly what the models say."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from datetime import date
from pathlib import Path
from typing import Any

import pytest
from alembic import command
from alembic.autogenerate import compare_metadata
from alembic.runtime.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import Engine, inspect

from bella.catalogue import Catalogue, Series
from bella.catalogue.engine import connect, parse_url, reading, writing
from bella.catalogue.models import Base
from bella.catalogue.schema import REVISION_TABLE, migration_config, revision_of
from bella.exceptions import StoreError
from bella.records import Origin
from tests.catalogue.examples import burst as burst_of
from tests.catalogue.examples import publication

REVISIONS = [one.revision for one in ScriptDirectory.from_config(migration_config()).walk_revisions()][::-1]


@pytest.fixture
def engine(database_url: str) -> Iterator[Engine]:
    opened = connect(parse_url(database_url))
    yield opened
    opened.dispose()


def migrate(engine: Engine, revision: str) -> None:
    with writing(engine) as connection:
        before = revision_of(connection)
        at = REVISIONS.index(before) if before else -1
        down = revision == "base" or REVISIONS.index(revision) < at
        (command.downgrade if down else command.upgrade)(migration_config(connection), revision)


def written(found: list[Any]) -> list[str]:
    return sorted(json.dumps(one, sort_keys=True, default=str) for one in found)


def shape(engine: Engine) -> dict[str, object]:
    """Everything about the schema that a database tells."""
    found = inspect(engine)
    return {
        table: (
            [(one["name"], str(one["type"]), one["nullable"]) for one in found.get_columns(table)],
            found.get_pk_constraint(table),
            written(found.get_foreign_keys(table)),
            written(found.get_unique_constraints(table)),
            written(found.get_check_constraints(table)),
            written(found.get_indexes(table)),
        )
        for table in found.get_table_names()
    }


def test_models_are_what_migrations_make(engine: Engine) -> None:
    migrate(engine, REVISIONS[-1])
    with reading(engine) as connection:
        options = {"version_table": REVISION_TABLE, "compare_type": True, "compare_server_default": True}
        context = MigrationContext.configure(connection, opts=options)
        assert compare_metadata(context, Base.metadata) == []


def test_constraints_of_models_are_those_of_migrations(engine: Engine) -> None:
    migrate(engine, REVISIONS[-1])
    migrated = shape(engine)
    migrated.pop(REVISION_TABLE)
    migrate(engine, "base")
    with writing(engine) as connection:
        Base.metadata.create_all(connection)
    made = shape(engine)
    made.pop(REVISION_TABLE)
    assert made == migrated


def test_up_down_up_ends_where_it_was(engine: Engine) -> None:
    for revision in REVISIONS:
        migrate(engine, revision)
    highest = shape(engine)
    for revision in [*REVISIONS[-2::-1], "base"]:
        migrate(engine, revision)
    assert set(inspect(engine).get_table_names()) <= {REVISION_TABLE}
    for revision in REVISIONS:
        migrate(engine, revision)
    assert shape(engine) == highest


def test_down_and_up_with_content(engine: Engine, database_url: str) -> None:
    with Catalogue.open(database_url, create=True) as catalogue:
        catalogue.publish(publication("h1"))
        catalogue.publish(publication("h2"))
    migrate(engine, "base")
    migrate(engine, REVISIONS[-1])
    with Catalogue.open(database_url) as catalogue:
        assert catalogue.publish(publication("h1")).version == 1


def test_a_database_taken_down_is_made_anew_only_when_asked(engine: Engine, database_url: str) -> None:
    migrate(engine, REVISIONS[-1])
    migrate(engine, "base")
    with pytest.raises(StoreError, match="`bella run` brings it to the newest revision"):
        Catalogue.open(database_url)
    with Catalogue.open(database_url, create=True) as catalogue:
        assert catalogue.revision() == REVISIONS[-1]


def test_an_upgrade_that_fails_leaves_nothing(engine: Engine) -> None:
    def upgrade_and_fail() -> None:
        with writing(engine) as connection:
            command.upgrade(migration_config(connection), "head")
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        upgrade_and_fail()
    assert inspect(engine).get_table_names() == []


def test_alembic_on_its_own_finds_the_catalogue_of_the_settings(database_url: str, tmp_path: Path) -> None:
    lines = (
        "from alembic import command",
        "from bella.catalogue.schema import migration_config",
        "command.upgrade(migration_config(), 'head')",
    )
    environment = os.environ | {"BELLA_DATABASE_URL": database_url, "BELLA_HOME": str(tmp_path)}
    subprocess.run([sys.executable, "-c", "\n".join(lines)], env=environment, check=True, cwd=Path(__file__).parents[2])
    with Catalogue.open(database_url) as catalogue:
        assert catalogue.revision() == REVISIONS[-1]


def test_older_solutions_are_graded_and_every_burst_has_a_preferred_one(engine: Engine, database_url: str) -> None:
    """Rows as revision 0002 has them: two series of one burst, the better one second, with a superseded version."""
    joint = {
        "phi0_deg": {"mean": -26.0, "sd": 8.0},
        "v_sw_km_s": {"mean": 440.0, "sd": 93.0},
        "flags": [],
        "model": "x",
    }
    with Catalogue.open(database_url, create=True) as catalogue:
        for inputs, preset, fit in (
            ("h1", "paper", {"joint": joint}),
            ("h2", "default", {"two_step": {"flags": []}}),
            ("h3", "default", {"joint": joint, "rotation_period_d": 24.47}),
        ):
            series = Series("half_rise", "posterior", preset, 2)
            catalogue.publish(publication(inputs, series=series, track_fit=fit))
        before = catalogue.versions("T3-20120607-1929")
    migrate(engine, "0002")
    with pytest.raises(StoreError, match="older revision 0002"):
        Catalogue.open(database_url)
    with Catalogue.open(database_url, create=True) as catalogue:
        after = {one.solution_id: one for one in catalogue.versions("T3-20120607-1929")}
        preference = catalogue.burst("T3-20120607-1929").preference
    assert {one.solution_id: one.answer for one in before} == {name: one.answer for name, one in after.items()}
    newest = after["T3-20120607-1929.half_rise.posterior.default.2d.v2"]
    assert newest.answer.sentence == "26° E (18 to 34), 21 R_sun, wind 440 km/s (350 to 530), grade B"
    assert [one.solution_id for one in after.values() if one.preferred] == [newest.solution_id]
    assert preference is not None
    assert (preference.chosen_by, preference.series) == ("rule", newest.series)
    assert after["T3-20120607-1929.half_rise.posterior.default.2d.v1"].answer.sentence.startswith("no track")


def test_days_detections_sources_and_submissions_of_before_are_kept(engine: Engine, database_url: str) -> None:
    """Rows as revision 0003 has them, read by what is there now."""
    migrate(engine, "0003")
    day = "INSERT INTO searched_day VALUES ('2020-07-21', 'h', '0.2.0', 'WIND SOLO', '2026-01-01 00:00:00')"
    burst = "INSERT INTO burst VALUES ('{0}', '2012-06-07 19:29:00', '2012-06-07 20:09:00', 0.1, 10.0, {1})"
    detection = (
        "INSERT INTO detection VALUES ({0}, '2020-07-21', 'WIND', '2020-07-21 03:0{0}:00', '2020-07-21 03:10:00', "
        "'2020-07-21 03:20:00', 0.1, 10.0, 9.0, 0.2, 12.0, 40, true, 'localisable', '', 'T3-20200721-0300')"
    )
    source = (
        "INSERT INTO source_file VALUES ({0}, '{1}', '2012-06-07', '1', '{2}', '{3}', 'x.csv', '{4}', {5}, "
        "'2026-01-01 00:00:00', '2026-01-02 00:00:00')"
    )
    statements = [
        day,
        *(detection.format(number) for number in (2, 5)),
        burst.format("T3-20120607-1929", "'T3/spectra.zarr.zip'"),
        burst.format("T3-20120607-2100", "NULL"),
        source.format(3, "WI_H1_WAV", "ab" * 32, "used", "", "NULL"),
        source.format(4, "arrival_table", "cd" * 32, "done", "", "'T3-20120607-2100'"),
        source.format(7, "arrival_table", "ef" * 32, "received", "", "NULL"),
    ]
    with writing(engine) as connection:
        for statement in statements:
            connection.exec_driver_sql(statement)
    with Catalogue.open(database_url, create=True) as catalogue:
        known = catalogue.searched_day(date(2020, 7, 21))
        assert known is not None
        assert (known.origin, known.observatories) == (Origin.ARCHIVE, ("WIND", "SOLO"))
        found = catalogue.detections_of(date(2020, 7, 21))
        assert [(one.start_utc.minute, one.origin) for one in found] == [(2, Origin.ARCHIVE), (5, Origin.ARCHIVE)]
        origins = {one.burst.burst_id: one.burst.origin for one in catalogue.bursts().bursts}
        assert origins == {"T3-20120607-1929": Origin.EVENT, "T3-20120607-2100": Origin.SUBMISSION}
        done, lost = (catalogue.submission(f"S-{name * 32}") for name in ("cd", "ef"))
        assert (done.state, done.burst_id) == ("done", "T3-20120607-2100")
        assert (lost.state, lost.message) == ("failed", "it waited while the service was upgraded: submit it again")
        solution = catalogue.publish(publication(of=burst_of("T3-new")))
        assert len(catalogue.sources(solution.solution_id)) == 1
    migrate(engine, "0003")
    with reading(engine) as connection:
        kept = connection.exec_driver_sql("SELECT source_id, dataset FROM source_file ORDER BY source_id").all()
        days = connection.exec_driver_sql("SELECT count(*) FROM detection").scalar()
    assert [tuple(row) for row in kept[:3]] == [(3, "WI_H1_WAV"), (4, "arrival_table"), (7, "arrival_table")]
    assert len(kept) == 4
    assert days == 2
