"""Prefect's own server inside one command: a thread of it, which ends when the command does, however that ends."""

import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import prefect
import uvicorn
from prefect.server.api.server import create_app
from prefect.settings import PREFECT_API_URL, temporary_settings

from bella.exceptions import UnreachableError

START_S, STOP_S = 120.0, 10.0


@contextmanager
def prefect_server() -> Iterator[str]:
    """Use the Prefect server of ``PREFECT_API_URL``, or run one until the block ends.

    Yields
    ------
    str
        URL of its API.

    Raises
    ------
    UnreachableError
        If the embedded server does not come up.
    """
    given = prefect.settings.get_current_settings().api.url
    if given:
        yield given
        return
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        url = f"http://127.0.0.1:{listening.getsockname()[1]}/api"
        server = uvicorn.Server(uvicorn.Config(create_app(ephemeral=True), log_level="critical", lifespan="on"))
        thread = threading.Thread(target=server.run, args=([listening],), name="prefect server", daemon=True)
        thread.start()
        until = time.monotonic() + START_S
        try:
            while not server.started:
                if not thread.is_alive() or time.monotonic() > until:
                    raise UnreachableError(
                        "the embedded Prefect server did not start: is the home folder writable, whole, and not full?"
                    )
                time.sleep(0.02)
            with temporary_settings({PREFECT_API_URL: url}):
                yield url
        finally:
            server.should_exit = True
            thread.join(STOP_S)
