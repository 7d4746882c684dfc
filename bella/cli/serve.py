"""The commands ``bella serve`` and ``bella status``: the service to its readers, and to its operator."""

import errno
import socket
from contextlib import closing
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bella.cli.options import AsJson, Home, open_catalogue, settings_of
from bella.cli.output import answer, bars, new_table, print_json, show
from bella.exceptions import BusyError, InputError
from bella.logs import log_to

if TYPE_CHECKING:
    from datetime import datetime

    from bella.catalogue import StageRun

SERVE_EPILOG = "Example: bella serve --port 8000"
STATUS_EPILOG = "Example: bella status --json"
RUNS_SHOWN = 20


def serve(
    home: Home = None,
    host: Annotated[str, typer.Option(help="Address to listen on.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=1, max=65535, help="Port to listen on.")] = 8000,
    processes: Annotated[int, typer.Option(min=1, max=64, help="Processes that answer side by side.")] = 1,
) -> None:
    """Serve the catalogue: REST API and pages, until stopped."""
    settings = settings_of(home)
    _check_free(host, port)
    from api.serve import run as run_server
    from bella.settings import make_folder

    make_folder(settings.home)
    log_to(None)
    open_catalogue(settings, create=True).close()
    bars.print(f"Catalogue of {settings.home.resolve()} on http://{host}:{port}", soft_wrap=True, highlight=False)
    run_server(host, port, processes)


def _check_free(host: str, port: int) -> None:
    """Refuse an address that cannot be listened on, before anything is started."""
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind, protocol) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            raise BusyError(f"port {port} of {host} is used by another program; name another --port") from error
        reason = error.strerror or error
        raise InputError(f"cannot listen on {host}, port {port} ({reason}); name another --host or --port") from error


def status(home: Home = None, as_json: AsJson = False) -> None:
    """Show the last runs of the service, and what waits."""
    with closing(open_catalogue(settings_of(home))) as catalogue:
        runs = catalogue.stage_runs(RUNS_SHOWN)
        waiting = len(catalogue.pending_submissions())
        revision = catalogue.revision()
    rows = [_row(run) for run in runs]
    if as_json:
        print_json({"revision": revision, "waiting": waiting, "runs": rows})
        return
    columns = ("stage", "subject", "state", "attempts", "started (UTC)", "took", "message")
    left = ("stage", "subject", "state", "message")
    table = new_table("Last runs", *columns, left=left, whole=("subject", "started (UTC)"))
    for row in rows:
        took = "-" if row["duration_s"] is None else f"{row['duration_s']:.0f} s"
        started = row["started_utc"][:19].replace("T", " ")
        cells = (row["stage"], row["subject"], row["state"], str(row["attempts"]), started, took, row["message"])
        table.add_row(*cells)
    show(table)
    answer(f"{waiting} arrival tables wait; catalogue revision {revision}")


def _row(run: "StageRun") -> dict[str, Any]:
    ended = run.ended_utc
    return {
        "stage": run.stage,
        "subject": run.subject,
        "run_id": run.run_id,
        "state": run.state,
        "attempts": run.attempts,
        "started_utc": _iso(run.started_utc),
        "ended_utc": None if ended is None else _iso(ended),
        "duration_s": None if ended is None else round((ended - run.started_utc).total_seconds(), 3),
        "message": run.message,
    }


def _iso(moment: "datetime") -> str:
    return f"{moment:%Y-%m-%dT%H:%M:%SZ}"
