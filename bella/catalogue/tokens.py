"""Tokens of people who may submit: made once, shown once, kept as a checksum only.

A token holds 256 random bits, so that nobody can find it by trying, and a plain SHA-256 of it is as safe as a slow
hash of a password would be.
"""

import hashlib
import secrets
from datetime import UTC, datetime

from sqlalchemy import Engine, Row, insert, select, update

from bella.catalogue.engine import reading, writing
from bella.catalogue.models import TokenRow, table_of
from bella.catalogue.records import Token
from bella.exceptions import InputError, NoDataError

RANDOM_BYTES = 32
"""256 bits: beyond any search (NIST SP 800-63B asks 112 of a look-up secret that is stored with a plain hash)."""
PREFIX = "bella_"
"""Lets people, and scanners of leaked secrets, see what it is."""
LONGEST_NAME = 100
_TABLE = table_of(TokenRow)


def create(engine: Engine, name: str) -> tuple[Token, str]:
    """Make a token.

    Parameters
    ----------
    name : str
        Whose it is, in words.

    Returns
    -------
    secret : str
        The token itself, which is kept nowhere.

    Raises
    ------
    InputError
        If the name is empty, too long, or not one line of plain text.
    """
    if not name.strip() or len(name) > LONGEST_NAME or not name.isprintable():
        raise InputError(f"--name must be one line of 1 to {LONGEST_NAME} characters: say whose token it is")
    secret = PREFIX + secrets.token_urlsafe(RANDOM_BYTES)
    token = Token(secrets.token_hex(4), name.strip(), datetime.now(UTC), None)
    with writing(engine) as connection:
        connection.execute(
            insert(_TABLE).values(
                token_id=token.token_id, name=token.name, sha256=_digest(secret), created_utc=token.created_utc
            )
        )
    return token, secret


def tokens(engine: Engine) -> tuple[Token, ...]:
    """All tokens, revoked ones too, in the order they were made."""
    with reading(engine) as connection:
        return tuple(_token(row) for row in connection.execute(select(_TABLE).order_by(_TABLE.c.created_utc)))


def find(engine: Engine, secret: str) -> Token | None:
    """Token of a secret, a revoked one too; None where there is none."""
    with reading(engine) as connection:
        row = connection.execute(select(_TABLE).where(_TABLE.c.sha256 == _digest(secret))).one_or_none()
    return None if row is None else _token(row)


def revoke(engine: Engine, token_id: str) -> Token:
    """Let a token open nothing any more; what was submitted with it stays.

    Raises
    ------
    NoDataError
        Where there is no such token.
    """
    own = _TABLE.c.token_id == token_id
    with writing(engine) as connection:
        connection.execute(
            update(_TABLE).where(own, _TABLE.c.revoked_utc.is_(None)).values(revoked_utc=datetime.now(UTC))
        )
        row = connection.execute(select(_TABLE).where(own)).one_or_none()
        if row is None:
            raise NoDataError(f"there is no token {token_id}: bella token list shows their ids")
        return _token(row)


def _digest(secret: str) -> str:
    return hashlib.sha256(secret.encode()).hexdigest()


def _token(row: Row[tuple[object, ...]]) -> Token:
    return Token(row.token_id, row.name, row.created_utc, row.revoked_utc)
