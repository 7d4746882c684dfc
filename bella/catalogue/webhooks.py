"""Receivers of alerts, and what waits for each: an alert goes when it was taken, and one burst's alerts go in order."""

import secrets
from datetime import UTC, datetime

from sqlalchemy import ColumnElement, Connection, Engine, Row, delete, func, insert, select, update

from bella.catalogue.alerts import alert_of
from bella.catalogue.engine import reading, writing
from bella.catalogue.models import AlertRow, DeliveryRow, WebhookRow, table_of
from bella.catalogue.records import Delivery, Webhook
from bella.exceptions import NoDataError

SECRET_BYTES = 32
"""As many as SHA-256 has, which RFC 2104 recommends for the key of an HMAC."""
_HOOKS, _WAITING, _ALERTS = table_of(WebhookRow), table_of(DeliveryRow), table_of(AlertRow)


def add(engine: Engine, url: str, *, with_tests: bool) -> Webhook:
    """Add a receiver of the alerts from now on, with a new secret."""
    now = datetime.now(UTC)
    own = secrets.token_hex(4)
    values = {
        "webhook_id": own,
        "url": url,
        "secret": secrets.token_urlsafe(SECRET_BYTES),
        "with_tests": with_tests,
        "created_utc": now,
        "removed_utc": None,
        "failures": 0,
        "next_attempt_utc": now,
        "message": "",
    }
    with writing(engine) as connection:
        connection.execute(insert(_HOOKS).values(values))
        return _one(connection, own)


def webhooks(engine: Engine) -> tuple[Webhook, ...]:
    """Receivers that were not removed, in the order they were added."""
    with reading(engine) as connection:
        query = select(_HOOKS).where(_HOOKS.c.removed_utc.is_(None)).order_by(_HOOKS.c.created_utc)
        return tuple(_webhook(connection, row) for row in connection.execute(query).all())


def remove(engine: Engine, webhook_id: str) -> Webhook:
    """Send a receiver no more alerts.

    Raises
    ------
    NoDataError
        Where there is no such receiver.
    """
    with writing(engine) as connection:
        _one(connection, webhook_id)
        connection.execute(delete(_WAITING).where(_WAITING.c.webhook_id == webhook_id))
        connection.execute(
            update(_HOOKS).where(_HOOKS.c.webhook_id == webhook_id).values(removed_utc=datetime.now(UTC), secret="")
        )
        return _one(connection, webhook_id, removed=True)


def due(engine: Engine, webhook_id: str, now: datetime, limit: int) -> tuple[Delivery, ...]:
    """Alerts that may be sent to a receiver now: of each burst the first that waits, in the order of their commits."""
    earlier, of_earlier = _WAITING.alias("earlier"), _ALERTS.alias("of_earlier")
    blocked = (
        select(earlier.c.sequence)
        .join(of_earlier, of_earlier.c.sequence == earlier.c.sequence)
        .where(earlier.c.webhook_id == _WAITING.c.webhook_id, earlier.c.sequence < _WAITING.c.sequence)
        .where(of_earlier.c.burst_id == _ALERTS.c.burst_id)
        .correlate(_WAITING, _ALERTS)
        .exists()
    )
    query = (
        select(_ALERTS.c.body, _WAITING.c.attempts)
        .join(_WAITING, _WAITING.c.sequence == _ALERTS.c.sequence)
        .where(_WAITING.c.webhook_id == webhook_id, _WAITING.c.next_attempt_utc <= now, ~blocked)
        .order_by(_WAITING.c.sequence)
        .limit(limit)
    )
    with reading(engine) as connection:
        return tuple(Delivery(alert_of(row), row.attempts) for row in connection.execute(query))


def note_taken(engine: Engine, webhook_id: str, sequence: int) -> None:
    """Note that a receiver took an alert, or that it is given up."""
    with writing(engine) as connection:
        connection.execute(delete(_WAITING).where(_is(webhook_id, sequence)))
        connection.execute(update(_HOOKS).where(_HOOKS.c.webhook_id == webhook_id).values(failures=0, message=""))


def note_refused(engine: Engine, webhook_id: str, sequence: int, message: str, again_utc: datetime) -> None:
    """Note that a receiver refused this one alert: it waits, and with it all that follow of its burst."""
    with writing(engine) as connection:
        values = {"attempts": _WAITING.c.attempts + 1, "next_attempt_utc": again_utc}
        connection.execute(update(_WAITING).where(_is(webhook_id, sequence)).values(values))
        connection.execute(update(_HOOKS).where(_HOOKS.c.webhook_id == webhook_id).values(message=message))


def note_away(engine: Engine, webhook_id: str, message: str, again_utc: datetime) -> None:
    """Note that a receiver does not answer: everything waits for it."""
    values = {"failures": _HOOKS.c.failures + 1, "next_attempt_utc": again_utc, "message": message}
    with writing(engine) as connection:
        connection.execute(update(_HOOKS).where(_HOOKS.c.webhook_id == webhook_id).values(values))


def _is(webhook_id: str, sequence: int) -> ColumnElement[bool]:
    return (_WAITING.c.webhook_id == webhook_id) & (_WAITING.c.sequence == sequence)


def _one(connection: Connection, webhook_id: str, *, removed: bool = False) -> Webhook:
    row = connection.execute(select(_HOOKS).where(_HOOKS.c.webhook_id == webhook_id)).one_or_none()
    if row is None or (row.removed_utc is not None and not removed):
        raise NoDataError(f"there is no webhook {webhook_id}: bella webhook list shows their ids")
    return _webhook(connection, row)


def _webhook(connection: Connection, row: Row[tuple[object, ...]]) -> Webhook:
    own = select(func.count()).select_from(_WAITING).where(_WAITING.c.webhook_id == row.webhook_id)
    names = [name for name in Webhook.__dataclass_fields__ if name != "waiting"]
    return Webhook(**{name: getattr(row, name) for name in names}, waiting=connection.execute(own).scalar_one())
