"""Sending alerts to their receivers: signed, tried again until they are taken, and in order for each burst.

A receiver that is away misses nothing: its alerts wait in the catalogue. It may get one twice, with the same
``Idempotency-Key``, where its answer was lost.
"""

import asyncio
import hashlib
import hmac
import ipaddress
import socket
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any
from urllib.parse import urlsplit

import httpx
import structlog

from bella.catalogue import Catalogue, Delivery, Lease, Webhook
from bella.exceptions import BusyError, InputError
from bella.formats.alerts import alert_name, alert_text
from bella.settings import Settings

STAGE = "alerts"
FIRST_WAIT_S = 10.0
LONGEST_WAIT_S = 1800.0
"""Waits double from the first to the longest: a receiver that comes back is found within half an hour."""
GIVEN_UP = timedelta(days=30)
"""An alert that was not taken for so long is given up; `/api/v1/alerts` still has it."""
AT_ONCE = 100
"""Most alerts of one receiver in one pass, so that the others have their turn."""
TRY_LATER = frozenset({408, 425, 429})
"""Answers of a receiver that is there and cannot take anything now; so does any from 500 on."""
LONGEST_URL = 2000
PAUSE_S = 5.0
"""Between two passes."""
NAT64 = ipaddress.IPv6Network("64:ff9b::/96")
"""Addresses whose end is one of IPv4 (RFC 6052)."""

log = structlog.get_logger(__name__)


@dataclass(frozen=True)
class Delivered:
    """What one pass did: alerts that were taken, that were refused, and receivers that were away."""

    taken: int = 0
    refused: int = 0
    away: int = 0


@dataclass(frozen=True)
class _Target:
    """Where to send to: the address that was checked, so that a name cannot mean another one a moment later."""

    url: str
    host: str
    port_text: str


def signature(secret: str, timestamp: str, body: bytes) -> str:
    """Value of the header ``X-Bella-Signature``.

    Parameters
    ----------
    secret : str
        That was shown when the receiver was added.
    timestamp : str
        Value of the header ``X-Bella-Timestamp``, seconds since 1970: a receiver refuses what is older than some
        minutes, so that nobody can send it again.

    Returns
    -------
    str
        ``v1=`` and the HMAC-SHA256 (RFC 2104) of timestamp, a full stop and body, hexadecimal.
    """
    return "v1=" + hmac.new(secret.encode(), timestamp.encode() + b"." + body, hashlib.sha256).hexdigest()


def check_address(url: str, *, private: bool) -> None:
    """Refuse an address that alerts must not be sent to.

    Parameters
    ----------
    private : bool
        Whether this machine, private networks and plain HTTP are allowed.

    Raises
    ------
    InputError
        Where it is no address, has a password, has no TLS, or its name means a machine that is not public.
    """
    _target(url, private=private)


def _target(url: str, *, private: bool) -> _Target:
    try:
        parts = urlsplit(url)
        host, port = parts.hostname or "", parts.port
    except ValueError as error:
        raise InputError(f"{url[:80]!r} is not an address: give one like https://example.org/bella") from error
    if len(url) > LONGEST_URL or not url.isprintable() or parts.scheme not in {"https", "http"} or not host:
        raise InputError(f"{url[:80]!r} is not an address: give one like https://example.org/bella")
    if parts.username is not None or parts.password is not None:
        raise InputError("a password in an address would be in every log: the signature says who sends")
    if parts.scheme == "http" and not private:
        raise InputError(f"{url[:80]} has no TLS: give an https address, or set BELLA_PRIVATE_WEBHOOKS=true")
    port = port or (443 if parts.scheme == "https" else 80)
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError) as error:
        raise httpx.ConnectError(f"{host} is not known: {error}") from error
    addresses = [ipaddress.ip_address(str(one[4][0]).partition("%")[0]) for one in found]
    for address in addresses:
        if not private and not _is_public(address):
            name = host if host == str(address) else f"{host} ({address})"
            raise InputError(f"{name} is no public address: give another one, or set BELLA_PRIVATE_WEBHOOKS=true")
    first = f"[{addresses[0]}]" if addresses[0].version == 6 else str(addresses[0])
    tail = f"{parts.path or '/'}{'?' + parts.query if parts.query else ''}"
    return _Target(f"{parts.scheme}://{first}:{port}{tail}", host, parts.netloc)


def _is_public(address: ipaddress.IPv4Address | ipaddress.IPv6Address) -> bool:
    """Whether an address is one of the public network; of one that wraps another (::ffff:127.0.0.1), that one."""
    if isinstance(address, ipaddress.IPv6Address):
        inner = address.ipv4_mapped or address.sixtofour
        if address in NAT64:
            inner = ipaddress.IPv4Address(int(address) & 0xFFFFFFFF)
        if inner is not None:
            return _is_public(inner)
    return address.is_global and not address.is_multicast


def _now() -> datetime:
    return datetime.now(UTC)


def wait_s(failures: int) -> float:
    """How long to wait after so many failures in a row, s."""
    return float(min(FIRST_WAIT_S * 2.0 ** min(failures, 20), LONGEST_WAIT_S))


def deliver_alerts(settings: Settings, run_id: str = "alerts", now: Callable[[], datetime] = _now) -> Delivered:
    """Send what waits, unless another run is doing so; to be called every few seconds.

    Parameters
    ----------
    now : callable
        Clock.

    Raises
    ------
    BellaError
        If the catalogue cannot be used.
    """
    taken = refused = away = 0
    with closing(Catalogue.open(settings.catalogue_url, create=True)) as catalogue:
        waiting = [one for one in catalogue.webhooks() if one.waiting and one.next_attempt_utc <= now()]
        if not waiting:
            return Delivered()
        try:
            with catalogue.lease(STAGE, "webhooks", run_id, settings.lease_s) as lease:
                for hook in waiting:
                    done = _Receiver(hook, catalogue, settings, lease, now).send_all()
                    taken, refused, away = taken + done.taken, refused + done.refused, away + done.away
        except BusyError as error:
            log.info("alerts are being sent already", reason=str(error))
    return Delivered(taken, refused, away)


@contextmanager
def delivering(settings: Settings, pause_s: float = PAUSE_S) -> Iterator[None]:
    """Deliver alerts every few seconds beside a block, whatever becomes of one pass.

    Parameters
    ----------
    pause_s : float
        Between two passes, s.
    """
    ending = threading.Event()

    def _deliver() -> None:
        while not ending.wait(pause_s):
            try:
                deliver_alerts(settings, "delivering")
            except Exception as error:  # noqa: BLE001 - what ends one pass must not end the next
                log.warning("alerts not sent", reason=f"{type(error).__name__}: {error}")

    thread = threading.Thread(target=_deliver, name="alerts", daemon=True)
    thread.start()
    try:
        yield
    finally:
        ending.set()
        thread.join(settings.webhook_timeout_s)


@dataclass(frozen=True)
class _Receiver:
    """One receiver in one pass."""

    hook: Webhook
    catalogue: Catalogue
    settings: Settings
    lease: Lease
    now: Callable[[], datetime]

    def send_all(self) -> Delivered:
        """Send what waits, burst by burst in order, until nothing does or the receiver is away."""
        taken = refused = 0
        while taken + refused < AT_ONCE:
            due = self.catalogue.due_deliveries(self.hook.webhook_id, self.now(), AT_ONCE - taken - refused)
            if not due:
                break
            for delivery in due:
                self.lease.renew(self.settings.lease_s)
                fault = self._send(delivery)
                if fault is None:
                    return Delivered(taken, refused, 1)
                taken, refused = taken + (fault == ""), refused + (fault != "")
        return Delivered(taken, refused)

    def _send(self, delivery: Delivery) -> str | None:
        """Send one alert: empty where it was taken, why it was refused, None where the receiver is away."""
        alert, own = delivery.alert, self.hook.webhook_id
        bound = log.bind(webhook_id=own, sequence=alert.sequence, burst_id=alert.burst_id)
        try:
            status = self._post(delivery)
            fault = "" if 200 <= status < 300 else f"status {status}"
        except InputError as error:
            status, fault = 0, str(error)
        except httpx.HTTPError as error:
            status, fault = 503, f"{type(error).__name__}: {error}".partition("\n")[0][:200]
        if fault == "":
            self.catalogue.note_delivered(own, alert.sequence)
            bound.info("alert taken")
            return ""
        bound.warning("alert not taken", reason=fault, attempts=delivery.attempts + 1)
        if self.now() - datetime.fromisoformat(alert.created_utc) > GIVEN_UP:
            self.catalogue.note_delivered(own, alert.sequence)
            bound.error("alert given up", reason=fault)
            return fault
        if status >= 500 or status in TRY_LATER:
            failures = next((one.failures for one in self.catalogue.webhooks() if one.webhook_id == own), 0)
            self.catalogue.note_away(own, fault, self.now() + timedelta(seconds=wait_s(failures)))
            return None
        self.catalogue.note_refused(
            own, alert.sequence, fault, self.now() + timedelta(seconds=wait_s(delivery.attempts))
        )
        return fault

    def _post(self, delivery: Delivery) -> int:
        target = _target(self.hook.url, private=self.settings.private_webhooks)
        body = alert_text(delivery.alert, self.settings.public_url.rstrip("/")).encode()
        timestamp = f"{self.now().timestamp():.0f}"
        headers = {
            "Host": target.port_text,
            "Content-Type": "application/json",
            "User-Agent": "BELLA",
            "Idempotency-Key": alert_name(delivery.alert),
            "X-Bella-Alert-Type": delivery.alert.alert_type.value,
            "X-Bella-Sequence": str(delivery.alert.sequence),
            "X-Bella-Timestamp": timestamp,
            "X-Bella-Signature": signature(self.hook.secret, timestamp, body),
        }
        with ThreadPoolExecutor(1) as own:  # the caller may be in an event loop
            return own.submit(asyncio.run, _status(target, body, headers, self.settings.webhook_timeout_s)).result()


async def _status(target: _Target, body: bytes, headers: dict[str, str], limit_s: float) -> int:
    """Status of the answer of a receiver, which has this time in all, even if it answers byte by byte.

    The rest of the answer is not read, and redirects are not followed.
    """
    client = httpx.AsyncClient(timeout=limit_s, trust_env=False, follow_redirects=False)
    own: dict[str, Any] = {"sni_hostname": target.host}
    request = client.build_request("POST", target.url, content=body, headers=headers, extensions=own)
    try:
        async with asyncio.timeout(limit_s), client:
            return int((await client.send(request, stream=True)).status_code)
    except TimeoutError as error:
        raise httpx.ReadTimeout(f"no answer within {limit_s:g} s") from error
