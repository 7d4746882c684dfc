"""The commands ``bella webhook add``, ``list``, ``deliver`` and ``remove``: who is sent alerts."""

import json
from contextlib import closing
from typing import Annotated

import typer

from bella.cli.catalogue import AsJson, Home, new_table, open_catalogue, out, say, settings_of
from bella.exceptions import InputError

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
        out.print_json(json.dumps({"webhook_id": hook.webhook_id, "url": hook.url, "secret": hook.secret}))
        return
    say(f"Webhook {hook.webhook_id} to {hook.url}. This secret signs its alerts, and is shown this once:")
    say(hook.secret)


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
        out.print_json(json.dumps(rows))
        return
    table = new_table(f"{len(rows)} webhooks", "webhook", "address", "tests", "waiting", "failures", "message")
    for row in rows:
        table.add_row(*("yes" if value is True else "no" if value is False else str(value) for value in row.values()))
    out.print(table)


@webhook_app.command("deliver", epilog="Example: bella webhook deliver --json")
def deliver(home: Home = None, as_json: AsJson = False) -> None:
    """Send what waits, once; bella fetch --follow does so every few seconds."""
    from dataclasses import asdict

    from bella.pipeline.alerts import deliver_alerts

    done = deliver_alerts(settings_of(home))
    if as_json:
        out.print_json(json.dumps(asdict(done)))
        return
    say(f"{done.taken} alerts taken, {done.refused} refused; {done.away} receivers did not answer")


@webhook_app.command("remove", epilog="Example: bella webhook remove 1f2e3d4c")
def remove(
    webhook_id: Annotated[str, typer.Argument(help="Id of the webhook; bella webhook list shows it.")],
    home: Home = None,
) -> None:
    """Send an address no more alerts; what waits for it is dropped."""
    with closing(open_catalogue(settings_of(home))) as catalogue:
        hook = catalogue.remove_webhook(webhook_id)
    say(f"Webhook {hook.webhook_id} to {hook.url} is removed")
