"""Solutions that were superseded before their companions came say that none follow."""

from contextlib import closing

from sqlalchemy import update

from bella.catalogue import Catalogue
from bella.catalogue.engine import connect, parse_url, writing
from bella.catalogue.models import TrackFitRow, table_of
from tests.catalogue.examples import fitted, publication
from tests.migrations.test_revisions import REVISIONS, migrate


def test_only_the_newest_version_expects_companions(database_url: str) -> None:
    track = fitted().model_copy(update={"companions_pending": True})
    with closing(Catalogue.open(database_url, create=True)) as catalogue:
        first, second = (catalogue.publish(publication(one, track_fit=track)) for one in ("h1", "h2"))
        fit = catalogue.track_fit(second.solution_id)
    engine, fits = connect(parse_url(database_url)), table_of(TrackFitRow)
    with writing(engine) as connection:
        connection.execute(update(fits).values(fit=fit))
    migrate(engine, "0008")
    migrate(engine, REVISIONS[-1])
    engine.dispose()
    with closing(Catalogue.open(database_url)) as catalogue:
        assert catalogue.track_fit(first.solution_id) == fit | {"companions_pending": False}
        assert catalogue.track_fit(second.solution_id) == fit
