"""Alerts sent to real receivers on the loopback: signed, in order, again until they are taken."""

import hashlib
import hmac
import ipaddress
import json
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import httpx
import jsonschema
import pytest

from bella.catalogue import Catalogue, Webhook
from bella.exceptions import InputError
from bella.formats.alerts import alert_schema
from bella.pipeline.alerts import Delivered, _is_public, check_address, deliver_alerts, delivering, signature, wait_s
from bella.records import Origin
from bella.settings import Settings
from tests.catalogue.examples import burst, publication
from tests.waiting import until

START = datetime.now(UTC)


@dataclass
class Receiver:
    """A server that takes alerts, or answers what it is told to."""

    taken: list[dict[str, Any]] = field(default_factory=list)
    seen: list[tuple[dict[str, str], bytes]] = field(default_factory=list)
    answer: Callable[[dict[str, Any]], int] = lambda _: 204
    address: str = ""
    location: str = ""

    def take(self, headers: dict[str, str], body: bytes) -> int:
        self.seen.append((headers, body))
        status = self.answer(json.loads(body))
        if status < 300:
            self.taken.append(json.loads(body))
        return status

    @property
    def sequences(self) -> list[int]:
        return [one["sequence"] for one in self.taken]


@pytest.fixture
def receiver() -> Iterator[Receiver]:
    own = Receiver()

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            body = self.rfile.read(int(self.headers["Content-Length"]))
            status = own.take({name.lower(): value for name, value in self.headers.items()}, body)
            self.send_response(status)
            if own.location:
                self.send_header("Location", own.location)
            self.send_header("Content-Length", "0")
            self.end_headers()

        def log_message(self, *_: object) -> None:
            """Say nothing."""

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        own.address = f"http://127.0.0.1:{server.server_address[1]}/hook?of=bella"
        yield own
        server.shutdown()


@dataclass
class Service:
    """A catalogue with one receiver, and a clock."""

    settings: Settings
    hook: Webhook
    now: datetime = START

    def publish(self, name: str, burst_id: str = "T3-20120607-1929", origin: Origin = Origin.ARCHIVE) -> None:
        with Catalogue.open(self.settings.catalogue_url) as catalogue:
            catalogue.publish(publication(name, of=burst(burst_id, origin=origin)))

    def deliver(self, later_s: float = 0.0) -> Delivered:
        self.now += timedelta(seconds=later_s)
        return deliver_alerts(self.settings, now=lambda: self.now)

    def state(self) -> Webhook:
        with Catalogue.open(self.settings.catalogue_url) as catalogue:
            return catalogue.webhooks()[0]


@pytest.fixture
def service(tmp_path: Path, receiver: Receiver) -> Service:
    settings = Settings(
        home=tmp_path, database_url=None, private_webhooks=True, public_url="https://bella.example.org/"
    )
    with Catalogue.open(settings.catalogue_url, create=True) as catalogue:
        return Service(settings, catalogue.add_webhook(receiver.address), datetime.now(UTC) + timedelta(minutes=1))


def test_an_alert_arrives_once_and_is_signed(service: Service, receiver: Receiver) -> None:
    service.publish("h1")
    assert service.deliver() == Delivered(taken=1)
    assert service.deliver(1000) == Delivered()
    ((headers, body),) = receiver.seen
    stamp = headers["x-bella-timestamp"]
    secret = service.hook.secret.encode()
    expected = hmac.new(secret, f"{stamp}.".encode() + body, hashlib.sha256).hexdigest()
    assert headers["x-bella-signature"] == f"v1={expected}"
    assert abs(int(stamp) - service.now.timestamp() + 1000) <= 1
    assert headers["idempotency-key"] == "T3-20120607-1929.alert-1.1"
    assert headers["content-type"] == "application/json"
    assert (headers["x-bella-alert-type"], headers["x-bella-sequence"]) == ("PRELIMINARY", "1")
    document = json.loads(body)
    jsonschema.Draft202012Validator(alert_schema()).validate(document)
    assert document["data_archive_page"] == "https://bella.example.org/bursts/T3-20120607-1929"


@pytest.mark.parametrize(
    ("secret", "stamp", "body"),
    [("other", "1700000000", b"{}"), ("s", "1700000001", b"{}"), ("s", "1700000000", b"{ }")],
)
def test_a_signature_depends_on_all_that_it_signs(secret: str, stamp: str, body: bytes) -> None:
    right = signature("s", "1700000000", b"{}")
    # openssl dgst -sha256 -hmac s of the text 1700000000.{}
    assert right == "v1=" + hmac.digest(b"s", b"1700000000.{}", "sha256").hex()
    assert signature(secret, stamp, body) != right


def test_a_receiver_that_is_away_for_a_day_misses_nothing(service: Service, receiver: Receiver) -> None:
    receiver.answer = lambda _: 503
    for number in range(5):
        service.publish(f"h{number}")
        service.publish("h", f"T3-other-{number}")
    tries = 0
    while tries < 200 and service.now < START + timedelta(hours=24):
        tries += service.deliver(600).away
    assert receiver.taken == []
    assert 48 <= tries <= 70
    receiver.answer = lambda _: 200
    for _ in range(10):
        service.deliver(600)
    assert sorted(receiver.sequences) == list(range(1, 11))
    own = [one["sequence"] for one in receiver.taken if one["event_name"] == "T3-20120607-1929"]
    assert own == [1, 3, 5, 7, 9]
    assert (service.state().waiting, service.state().failures, service.state().message) == (0, 0, "")


def test_nothing_is_listening(service: Service, tmp_path: Path) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with Catalogue.open(service.settings.catalogue_url) as catalogue:
        catalogue.add_webhook(f"http://127.0.0.1:{port}/")
        catalogue.add_webhook("http://no-such-host.invalid/")
    service.publish("h1")
    assert service.deliver() == Delivered(taken=1, away=2)
    with Catalogue.open(service.settings.catalogue_url) as catalogue:
        assert [one.waiting for one in catalogue.webhooks()] == [0, 1, 1]
        assert all("ConnectError" in one.message for one in catalogue.webhooks()[1:])


def test_a_receiver_that_answers_byte_by_byte_is_away_and_keeps_no_other_waiting(
    service: Service, receiver: Receiver
) -> None:
    service.settings = service.settings.model_copy(update={"webhook_timeout_s": 0.5})
    with socket.create_server(("127.0.0.1", 0)) as slow, Catalogue.open(service.settings.catalogue_url) as catalogue:
        catalogue.remove_webhook(service.hook.webhook_id)
        catalogue.add_webhook(f"http://127.0.0.1:{slow.getsockname()[1]}/hook")
        catalogue.add_webhook(receiver.address)
        threading.Thread(target=dribble, args=(slow,), daemon=True).start()
        service.publish("h1")
        assert service.deliver() == Delivered(taken=1, away=1)
        assert [one.message for one in catalogue.webhooks()] == ["ReadTimeout: no answer within 0.5 s", ""]


def dribble(server: socket.socket) -> None:
    """Answer with a header that has no end, faster than any timeout between two bytes."""
    connection, _ = server.accept()
    with connection, suppress(OSError):
        connection.sendall(b"HTTP/1.1 204 No Content\r\nX: ")
        while True:
            connection.sendall(b"y")
            time.sleep(0.05)


def test_a_refused_alert_holds_back_its_own_burst_alone(service: Service, receiver: Receiver) -> None:
    for name in ("h1", "h2"):
        service.publish(name)
    service.publish("h1", "T3-other")
    receiver.answer = lambda document: 400 if document["sequence"] == 1 else 204
    assert service.deliver() == Delivered(taken=1, refused=1)
    assert receiver.sequences == [3]
    assert service.deliver(5) == Delivered()
    assert service.deliver(6) == Delivered(refused=1)
    assert service.state().message == "status 400"
    receiver.answer = lambda _: 204
    service.deliver(21)
    assert receiver.sequences == [3, 1, 2]


@pytest.mark.parametrize("status", [408, 429, 500, 503])
def test_a_receiver_that_cannot_now_is_left_alone(service: Service, receiver: Receiver, status: int) -> None:
    service.publish("h1")
    service.publish("h1", "T3-other")
    receiver.answer = lambda _: status
    assert service.deliver() == Delivered(away=1)
    assert len(receiver.seen) == 1
    assert service.deliver(9) == Delivered()
    assert service.deliver(2) == Delivered(away=1)
    assert service.deliver(15) == Delivered()
    assert service.deliver(6) == Delivered(away=1)


@pytest.mark.parametrize("status", [301, 302, 307, 308])
def test_a_redirect_is_not_followed(service: Service, receiver: Receiver, status: int) -> None:
    receiver.location = receiver.address.replace("/hook", "/elsewhere")
    receiver.answer = lambda _: status
    service.publish("h1")
    assert service.deliver() == Delivered(refused=1)
    assert len(receiver.seen) == 1


def test_the_same_alert_has_the_same_key_and_body_whenever_it_is_sent(service: Service, receiver: Receiver) -> None:
    receiver.answer = lambda _: 400
    service.publish("h1")
    service.deliver()
    service.deliver(20)
    (first, body), (second, again) = receiver.seen
    assert body == again
    assert first["idempotency-key"] == second["idempotency-key"]
    assert first["x-bella-timestamp"] != second["x-bella-timestamp"]
    assert first["x-bella-signature"] != second["x-bella-signature"]


def test_what_nobody_takes_for_a_month_is_given_up(service: Service, receiver: Receiver) -> None:
    receiver.answer = lambda _: 503
    service.publish("h1")
    service.publish("h2")
    assert service.deliver(29 * 86400) == Delivered(away=1)
    service.deliver(2 * 86400)
    assert service.state().waiting == 0
    assert len(Catalogue.open(service.settings.catalogue_url).alerts()) == 2


def test_tests_go_only_to_those_who_ask(service: Service, receiver: Receiver) -> None:
    service.publish("h1", "TEST-1", Origin.TEST)
    assert service.deliver() == Delivered()
    with Catalogue.open(service.settings.catalogue_url) as catalogue:
        catalogue.add_webhook(receiver.address, with_tests=True)
    service.publish("h2", "TEST-1", Origin.TEST)
    assert service.deliver() == Delivered(taken=1)
    assert receiver.taken[0]["type"] == "TEST"


def test_two_runs_at_once_send_one_after_the_other(service: Service, receiver: Receiver) -> None:
    service.publish("h1")
    with Catalogue.open(service.settings.catalogue_url) as catalogue, catalogue.lease("alerts", "webhooks", "x", 60.0):
        assert service.deliver() == Delivered()
    assert receiver.seen == []
    assert service.deliver() == Delivered(taken=1)


def test_a_private_address_is_refused_when_it_is_used_too(service: Service, receiver: Receiver) -> None:
    """The name may have meant a public machine when it was added."""
    service.publish("h1")
    service.settings = service.settings.model_copy(update={"private_webhooks": False})
    assert service.deliver() == Delivered(refused=1)
    assert receiver.seen == []
    assert service.state().message != ""


@pytest.mark.parametrize(
    "host",
    [
        "127.0.0.1",
        "127.8.8.8",
        "0.0.0.0",
        "10.1.2.3",
        "172.16.0.1",
        "192.168.1.1",
        "169.254.169.254",
        "100.64.0.1",
        "224.0.0.1",
        "255.255.255.255",
        "[::1]",
        "[::]",
        "[fe80::1]",
        "[fc00::1]",
        "[::ffff:127.0.0.1]",
        "[::ffff:10.0.0.1]",
        "[64:ff9b::7f00:1]",
        "[2002:7f00:1::]",
        "localhost",
        "2130706433",
        "0x7f000001",
        "127.1",
    ],
)
def test_addresses_that_are_not_public_are_refused(host: str) -> None:
    with pytest.raises((InputError, httpx.ConnectError)):
        check_address(f"https://{host}/", private=False)


@pytest.mark.parametrize("address", ["8.8.8.8", "2001:4860:4860::8888", "::ffff:8.8.8.8", "64:ff9b::808:808"])
def test_public_addresses_are_public(address: str) -> None:
    assert _is_public(ipaddress.ip_address(address))
    host = f"[{address}]" if ":" in address else address
    check_address(f"https://{host}/hook", private=False)


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("http://8.8.8.8/", "has no TLS"),
        ("ftp://8.8.8.8/", "is not an address"),
        ("file:///etc/passwd", "is not an address"),
        ("https://", "is not an address"),
        ("https://user:secret@8.8.8.8/", "a password in an address"),
        ("https://8.8.8.8:99999/", "is not an address"),
        ("https://8.8.8.8/\n", "is not an address"),
        ("https://8.8.8.8/" + "x" * 2000, "is not an address"),
        ("https://127.0.0.1/", "no public address"),
    ],
)
def test_what_is_no_address_says_so(url: str, words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        check_address(url, private=False)
    assert "secret" not in str(caught.value)


def test_waits_double_up_to_half_an_hour() -> None:
    assert [wait_s(failures) for failures in (0, 1, 2, 7, 8, 10**6)] == [10.0, 20.0, 40.0, 1280.0, 1800.0, 1800.0]


def test_alerts_are_sent_beside_other_work_until_it_ends(service: Service, receiver: Receiver) -> None:
    with delivering(service.settings, 0.05):
        service.publish("h1")
        until(lambda: receiver.sequences == [1])
        receiver.answer = lambda _: 400
        service.publish("h1", "T3-other")
        until(lambda: len(receiver.seen) == 2)
    service.publish("h2")
    assert not [one for one in threading.enumerate() if one.name == "alerts"]
    assert receiver.sequences == [1]


def test_follow_sends_alerts_where_nothing_is_fetched(service: Service, receiver: Receiver, tmp_path: Path) -> None:
    service.publish("h1")
    environment = {
        "PATH": os.environ["PATH"],
        "BELLA_HOME": str(service.settings.home),
        "BELLA_ARCHIVE": str(tmp_path),
        "BELLA_RECENT_DAYS": "0",
        "BELLA_PRIVATE_WEBHOOKS": "true",
        "BELLA_HORIZONS_URL": f"{receiver.address}/none",
    }
    bella = str(Path(sys.executable).with_name("bella"))
    with subprocess.Popen([bella, "fetch", "--follow"], env=environment) as process:
        try:
            until(lambda: receiver.sequences == [1])
        finally:
            process.terminate()
    assert process.returncode == 0
