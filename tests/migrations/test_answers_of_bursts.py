"""What lists filter by is copied to older bursts as publication writes it."""

from contextlib import closing
from typing import Any

from sqlalchemy import Engine, select

from bella.answer import Answer
from bella.catalogue import Catalogue
from bella.catalogue.engine import connect, parse_url, reading
from bella.catalogue.models import BurstRow, table_of
from tests.catalogue.examples import burst, fitted, publication
from tests.migrations.test_revisions import migrate


def rows(engine: Engine) -> list[dict[str, Any]]:
    with reading(engine) as connection:
        return [dict(one) for one in connection.execute(select(table_of(BurstRow)).order_by("burst_id")).mappings()]


def test_copies_of_answers_are_those_that_publication_writes(database_url: str) -> None:
    with closing(Catalogue.open(database_url, create=True)) as catalogue:
        catalogue.publish(publication("h1", of=burst("A"), track_fit=fitted(26.0)))
        answer = catalogue.publish(publication("h2", of=burst("A"), track_fit=fitted(-26.0))).answer
        catalogue.publish(publication(of=burst("B")))
        catalogue.retract("B", "timed on interference")
    engine = connect(parse_url(database_url))
    published = rows(engine)
    migrate(engine, "0009")
    migrate(engine, "0010")
    assert rows(engine) == published
    engine.dispose()
    first, second = published
    assert {name: first[f"answer_{name}"] for name in Answer.model_fields} == answer.model_dump()
    assert first["answer_phi0_deg"] == -26.0
    assert {value for name, value in second.items() if name.startswith("answer_")} == {None}
