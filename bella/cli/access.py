"""The commands ``bella token`` and ``bella webhook``: who may submit arrival tables, and who is sent alerts."""

from contextlib import closing
from typing import Annotated

import typer

from bella.cli.options import AsJson, Home, open_catalogue, settings_of
from bella.cli.output import answer, new_table, print_json, say, show
from bella.exceptions import InputError

token_app = typer.Typer(help="Make and revoke the tokens that arrival tables are submitted with.", no_args_is_help=True)


@token_app.command("create", epilog="Example: bella token create --name 'Ann, Meudon'")
def create(
    name: Annotated[str, typer.Option(help="Whose token it is, in words.")], home: Home = None, as_json: AsJson = False
) -> None:
    """Make a token and show it, once: the catalogue keeps a checksum only."""
    with closing(open_catalogue(settings_of(home), create=True)) as catalogue:
        token, secret = catalogue.create_token(name)
    if as_json:
        print_json({"token_id": token.token_id, "name": token.name, "token": secret})
        return
    say(f"Token {token.token_id} of {token.name}. It is shown this once; send it as Authorization: Bearer TOKEN")
    answer(secret)


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
        print_json(rows)
        return
    table = new_table("Tokens", "token", "name", "created (UTC)", "revoked (UTC)", left=("name",), whole=("token",))
    for row in rows:
        table.add_row(*(value or "" for value in row.values()))
    show(table)
    answer(f"{len(rows)} tokens, {sum(row['revoked_utc'] is None for row in rows)} of them valid")


@token_app.command("revoke", epilog="Example: bella token revoke 1f2e3d4c")
def revoke(
    token_id: Annotated[str, typer.Argument(help="Id of the token; bella token list shows it.")],
    home: Home = None,
    as_json: AsJson = False,
) -> None:
    """Let a token open nothing any more; what was submitted with it stays."""
    with closing(open_catalogue(settings_of(home))) as catalogue:
        token = catalogue.revoke_token(token_id)
    if as_json:
        print_json({"token_id": token.token_id, "name": token.name, "revoked": True})
        return
    answer(f"Token {token.token_id} of {token.name} is revoked")


webhook_app = typer.Typer(help="Add and remove the addresses that alerts are sent to.", no_args_is_help=True)


@webhook_app.command("add", epilog="Example: bella webhook add https://example.org/bella")
def add(
    url: Annotated[str, typer.Argument(help="Address that takes a POST of JSON; https.")],
    tests: Annotated[bool, typer.Option("--tests", help="Send alerts of simulated and test data too.")] = False,
    home: Home = None,
    as_json: AsJson = False,
) -> None:
    """Send all alerts from now on to an address, and show the secret that signs them, once."""
    import httpx

    from bella.pipeline.alerts import check_address

    settings = settings_of(home)
    try:
        check_address(url, private=settings.private_webhooks)
    except httpx.ConnectError as error:
        raise InputError(f"{error}: check the name") from error
    with closing(open_catalogue(settings, create=True)) as catalogue:
        hook = catalogue.add_webhook(url, with_tests=tests)
    if as_json:
        print_json({"webhook_id": hook.webhook_id, "url": hook.url, "tests": tests, "secret": hook.secret})
        return
    say(f"Webhook {hook.webhook_id} to {hook.url}. This secret signs its alerts, and is shown this once:")
    answer(hook.secret)


@webhook_app.command("list", epilog="Example: bella webhook list --json")
def list_webhooks(home: Home = None, as_json: AsJson = False) -> None:
    """List the addresses that alerts are sent to, and how much waits for each."""
    with closing(open_catalogue(settings_of(home))) as catalogue:
        hooks = catalogue.webhooks()
    rows = [
        {
            "webhook_id": one.webhook_id,
            "url": one.url,
            "tests": one.with_tests,
            "waiting": one.waiting,
            "failures": one.failures,
            "message": one.message,
        }
        for one in hooks
    ]
    if as_json:
        print_json(rows)
        return
    columns = ("webhook", "address", "tests", "waiting", "failures", "message")
    table = new_table("Webhooks", *columns, left=("address", "message"), whole=("webhook",))
    for row in rows:
        table.add_row(*("yes" if value is True else "no" if value is False else str(value) for value in row.values()))
    show(table)
    answer(f"{len(rows)} webhooks, {sum(one.waiting for one in hooks)} alerts wait")


@webhook_app.command("deliver", epilog="Example: bella webhook deliver --json")
def deliver(home: Home = None, as_json: AsJson = False) -> None:
    """Send what waits, once; bella fetch --follow does so every few seconds."""
    from dataclasses import asdict

    from bella.pipeline.alerts import deliver_alerts

    done = deliver_alerts(settings_of(home))
    if as_json:
        print_json(asdict(done))
        return
    answer(f"{done.taken} alerts taken, {done.refused} refused; {done.away} receivers did not answer")


@webhook_app.command("remove", epilog="Example: bella webhook remove 1f2e3d4c")
def remove(
    webhook_id: Annotated[str, typer.Argument(help="Id of the webhook; bella webhook list shows it.")],
    home: Home = None,
    as_json: AsJson = False,
) -> None:
    """Send an address no more alerts; what waits for it is dropped."""
    with closing(open_catalogue(settings_of(home))) as catalogue:
        hook = catalogue.remove_webhook(webhook_id)
    if as_json:
        print_json({"webhook_id": hook.webhook_id, "url": hook.url, "removed": True})
        return
    answer(f"Webhook {hook.webhook_id} to {hook.url} is removed")
