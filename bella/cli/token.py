"""The commands ``bella token create``, ``list`` and ``revoke``: who may submit arrival tables."""

import json
from contextlib import closing
from typing import Annotated

import typer

from bella.cli.catalogue import AsJson, Home, new_table, open_catalogue, out, say, settings_of

token_app = typer.Typer(help="Make and revoke the tokens that arrival tables are submitted with.", no_args_is_help=True)


@token_app.command("create", epilog="Example: bella token create --name 'Ann, Meudon'")
def create(
    name: Annotated[str, typer.Option(help="Whose token it is, in words.")], home: Home = None, as_json: AsJson = False
) -> None:
    """Make a token and show it, once: the catalogue keeps a checksum only."""
    with closing(open_catalogue(settings_of(home), create=True)) as catalogue:
        token, secret = catalogue.create_token(name)
    if as_json:
        out.print_json(json.dumps({"token_id": token.token_id, "name": token.name, "token": secret}))
        return
    say(f"Token {token.token_id} of {token.name}. It is shown this once; send it as Authorization: Bearer TOKEN")
    say(secret)


@token_app.command("list", epilog="Example: bella token list --json")
def list_tokens(home: Home = None, as_json: AsJson = False) -> None:
    """List the tokens; what they look like is not known to anybody but their owners."""
    with closing(open_catalogue(settings_of(home))) as catalogue:
        tokens = catalogue.tokens()
    rows = [
        {
            "token_id": one.token_id,
            "name": one.name,
            "created_utc": f"{one.created_utc:%Y-%m-%dT%H:%M:%SZ}",
            "revoked_utc": f"{one.revoked_utc:%Y-%m-%dT%H:%M:%SZ}" if one.revoked_utc else None,
        }
        for one in tokens
    ]
    if as_json:
        out.print_json(json.dumps(rows))
        return
    table = new_table(f"{len(rows)} tokens", "token", "name", "created (UTC)", "revoked (UTC)")
    for row in rows:
        table.add_row(*(value or "" for value in row.values()))
    out.print(table)


@token_app.command("revoke", epilog="Example: bella token revoke 1f2e3d4c")
def revoke(
    token_id: Annotated[str, typer.Argument(help="Id of the token; bella token list shows it.")], home: Home = None
) -> None:
    """Let a token open nothing any more; what was submitted with it stays."""
    with closing(open_catalogue(settings_of(home))) as catalogue:
        token = catalogue.revoke_token(token_id)
    say(f"Token {token.token_id} of {token.name} is revoked")
