"""Tokens: shown once, kept as a checksum, revoked for good."""

import hashlib

import pytest

from bella.catalogue import Catalogue
from bella.catalogue.engine import connect, parse_url, reading
from bella.catalogue.models import TokenRow, table_of
from bella.exceptions import InputError, NoDataError


def test_a_token_is_known_by_its_secret_alone(catalogue: Catalogue) -> None:
    ann, secret = catalogue.create_token("Ann, Observatory of Meudon")
    bob, other = catalogue.create_token("Bob")
    assert (ann.name, ann.revoked_utc) == ("Ann, Observatory of Meudon", None)
    assert catalogue.token_of(secret) == ann
    assert catalogue.token_of(other) == bob
    assert catalogue.tokens() == (ann, bob)
    for wrong in (secret[:-1], secret + "x", secret.upper(), "", ann.token_id, "bella_"):
        assert catalogue.token_of(wrong) is None


def test_only_a_checksum_is_kept(catalogue: Catalogue, catalogue_url: str) -> None:
    _, secret = catalogue.create_token("Ann")
    assert secret.startswith("bella_")
    assert len(secret) == len("bella_") + 43
    engine = connect(parse_url(catalogue_url))
    with reading(engine) as connection:
        (row,) = connection.execute(table_of(TokenRow).select()).all()
    engine.dispose()
    assert row.sha256 == hashlib.sha256(secret.encode()).hexdigest()
    assert not any(secret in str(value) for value in row)


def test_a_revoked_token_stays_revoked(catalogue: Catalogue) -> None:
    token, secret = catalogue.create_token("Ann")
    revoked = catalogue.revoke_token(token.token_id)
    assert revoked.revoked_utc is not None
    assert catalogue.token_of(secret) == revoked
    assert catalogue.revoke_token(token.token_id) == revoked
    with pytest.raises(NoDataError, match="bella token list"):
        catalogue.revoke_token("none")


@pytest.mark.parametrize("name", ["", "   ", "a\nb", "\x1b[31m", "x" * 101])
def test_a_name_is_one_line(catalogue: Catalogue, name: str) -> None:
    with pytest.raises(InputError, match="--name must be one line"):
        catalogue.create_token(name)
    assert catalogue.tokens() == ()
