"""Runs revisions in the transaction of the catalogue that asks for them; from Alembic's command line in its own."""

from typing import Literal

from alembic import context
from alembic.autogenerate.api import AutogenContext
from sqlalchemy import Connection
from sqlalchemy.types import TypeDecorator

from bella.catalogue.engine import connect, parse_url, writing
from bella.catalogue.models import Base
from bella.catalogue.schema import REVISION_TABLE
from bella.settings import Settings


def render_item(_kind: str, item: object, _context: AutogenContext) -> str | Literal[False]:
    """Write the type a column has in the database, not the class that converts its values today."""
    return f"sa.{item.impl!r}" if isinstance(item, TypeDecorator) else False


def migrate(connection: Connection) -> None:
    """Run the revisions that were asked for on a connection that is in a transaction."""
    context.configure(
        connection=connection,
        target_metadata=Base.metadata,
        version_table=REVISION_TABLE,
        render_as_batch=connection.dialect.name == "sqlite",
        render_item=render_item,
    )
    with context.begin_transaction():
        context.run_migrations()


given = context.config.attributes.get("connection")
if given is not None:
    migrate(given)
else:
    with writing(connect(parse_url(Settings().catalogue_url))) as own:
        migrate(own)
