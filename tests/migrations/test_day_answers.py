"""Days that were searched before there were answers get theirs from their detections, and solutions their spectra."""

from datetime import UTC, date, datetime

from alembic import command
from sqlalchemy import text

from bella.catalogue.engine import connect, parse_url, writing
from bella.catalogue.schema import migration_config
from tests.migrations.test_revisions import migrate

NOW = datetime(2021, 2, 1, tzinfo=UTC)


def test_answers_follow_from_detections(database_url: str) -> None:
    engine = connect(parse_url(database_url))
    migrate(engine, "0003")
    tiers = {1: [], 2: ["rejected"], 3: ["catalogued"], 4: ["catalogued", "localisable"]}
    with writing(engine) as connection:
        for number, found in tiers.items():
            day = {"day": date(2021, 2, number), "now": NOW}
            connection.execute(text("INSERT INTO searched_day VALUES (:day, 'h', '1', 'WIND', :now)"), day)
            for tier in found:
                connection.execute(
                    text(
                        "INSERT INTO detection (day, observatory, start_utc, peak_utc, end_utc, f_low_mhz, f_high_mhz,"
                        " score, drift, peak_db, channels, isolated, tier, reason, burst_id)"
                        " VALUES (:day, 'WIND', :now, :now, :now, 0.1, 1, 9, 1, 9, 9, :alone, :tier, '', '')"
                    ),
                    day | {"tier": tier, "alone": True},
                )
    with writing(engine) as connection:
        command.upgrade(migration_config(connection), "0005")
    with writing(engine) as connection:
        answers = connection.execute(text("SELECT answer FROM searched_day ORDER BY day")).scalars().all()
    assert answers == ["no burst", "no burst", "not localisable", "localised"]
    engine.dispose()
