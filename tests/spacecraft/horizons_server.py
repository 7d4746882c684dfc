"""A service on the loopback that answers as Horizons does, in the form its documentation gives."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import parse_qs, urlsplit

import numpy as np

from bella.spacecraft.ephemeris import packaged_coverage, packaged_km
from bella.spacecraft.horizons import HORIZONS_IDS

SIGNATURE = "API VERSION: 1.2\nAPI SOURCE: NASA/JPL Horizons API\n\n"
STARS = "*" * 79
PATH, MOVED = "/api/horizons.api", "/moved/horizons.api"
TDB_MINUS_UTC = np.timedelta64(69_184, "ms")

Answer = Callable[[dict[str, str]], tuple[int, str]]


@contextmanager
def horizons(answer: Answer) -> Iterator[tuple[str, list[dict[str, str]]]]:
    """Address of the service, and the queries it was asked."""
    queries: list[dict[str, str]] = []

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            query = {name: values[0].strip("'") for name, values in parse_qs(urlsplit(self.path).query).items()}
            if urlsplit(self.path).path == MOVED:
                self.send_response(302)
                self.send_header("Location", self.path.replace(MOVED, PATH))
                self.end_headers()
                return
            queries.append(query)
            status, text = answer(query)
            self.send_response(status)
            self.end_headers()
            self.wfile.write(text.encode())

        def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - the name the base class gives it
            """Keep quiet."""

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_port}{PATH}", queries
    finally:
        server.shutdown()
        server.server_close()


def continued_km(body: str, utc: np.ndarray) -> np.ndarray:
    """Positions of the packaged table, and after its end those on a circle in the same plane at the same speed."""
    start, stop = packaged_coverage(body)
    found = packaged_km(body, np.clip(utc, start, stop))
    hour = np.timedelta64(1, "h")
    before, last = packaged_km(body, np.array([stop - hour, stop]))
    radius = np.linalg.norm(last)
    across = last - before - ((last - before) @ last) * last / radius**2
    angle = (np.linalg.norm(across) / radius * np.maximum((utc - stop) / hour, 0.0))[:, np.newaxis]
    circle = np.cos(angle) * last + np.sin(angle) * radius * across / np.linalg.norm(across)
    return np.where((utc > stop)[:, np.newaxis], circle, found)


def vectors(query: dict[str, str]) -> tuple[int, str]:
    """The answer to a query for vectors, as far as the packaged table and a circle after it go."""
    body = next(name for name, code in HORIZONS_IDS.items() if code == query["COMMAND"])
    start, stop = (np.datetime64(query[name].replace(" ", "T"), "ns") for name in ("START_TIME", "STOP_TIME"))
    tdb = np.arange(start, stop + np.timedelta64(1, "m"), np.timedelta64(int(query["STEP_SIZE"].split()[0]), "h"))
    return 200, table(tdb, continued_km(body, tdb - TDB_MINUS_UTC), body)


def table(tdb: np.ndarray, position_km: np.ndarray, name: str) -> str:
    days = (tdb - np.datetime64("2000-01-01T12:00", "ns")) / np.timedelta64(1, "D") + 2_451_545.0
    lines = [
        f"{day:.9f}, A.D. {np.datetime_as_string(moment, unit='ms').replace('T', ' ')}, "
        + "".join(f" {value: .15E}," for value in row)
        for day, moment, row in zip(days, tdb, position_km, strict=True)
    ]
    heading = "            JDTDB,            Calendar Date (TDB),                      X,                      Y,"
    return "\n".join(
        [
            f"{SIGNATURE}{STARS}",
            f"Target body name: {name}       {{source: merged}}",
            "Center body name: Sun (10)                        {source: DE441}",
            "Output units    : KM-S",
            "Output type     : GEOMETRIC cartesian states",
            "Reference frame : Ecliptic of J2000.0",
            STARS,
            f"{heading}                      Z,",
            STARS,
            "$$SOE",
            *lines,
            "$$EOE",
            STARS,
        ]
    )
