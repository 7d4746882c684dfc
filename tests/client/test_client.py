"""A client of a service: all pages, units, the draws, and one line where something is wrong."""

import re
import socket
from pathlib import Path
from socketserver import BaseRequestHandler, ThreadingTCPServer
from threading import Thread

import numpy as np
import pytest
from astropy import units as u
from astropy.time import Time

import bella
from bella.catalogue import Catalogue
from bella.client import Client, client
from bella.exceptions import InputError, NoDataError, UnreachableError
from bella.settings import Settings
from tests.plotting.synthetic import BURST_ID


def test_bursts_are_a_table_with_units_and_times(address: str, filled: Settings) -> None:
    table = Client(address).bursts()
    with Catalogue.open(filled.catalogue_url) as catalogue:
        known = catalogue.bursts().bursts
    assert table["burst_id"].tolist() == [one.burst.burst_id for one in known]
    assert table["phi0_deg"].unit == u.deg
    assert isinstance(table["start_utc"], Time)
    assert table["start_utc"][0].isot == "2012-06-07T19:29:15.000000"
    assert table["phi0_deg"].value.tolist() == [one.preferred.answer.phi0_deg for one in known if one.preferred]
    assert "next" not in table.meta


def test_pages_are_put_together(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = Client(address).bursts()
    monkeypatch.setattr(client, "PAGE_ROWS", 1)
    assert Client(address).bursts()["burst_id"].tolist() == whole["burst_id"].tolist()
    assert len(whole) == 3


def test_times_may_be_text_or_of_another_scale(address: str) -> None:
    onset = Time("2012-06-07T19:29:15", scale="utc")
    service = Client(address)
    assert len(service.bursts(start=onset.tt, stop=(onset + 1 * u.s).tai)) == 1
    assert len(service.bursts(start="2012-06-07T19:29:16", stop="2012-06-08")) == 0


def test_the_posterior_comes_by_one_call(address: str) -> None:
    posterior = Client(address).posterior(BURST_ID)
    assert posterior.attrs["frame"] == "HEE"
    assert np.isfinite(posterior["draws"].isel(frequency=0).to_numpy()).all()


def test_tables_of_one_burst(address: str) -> None:
    service = Client(address)
    track, arrivals = service.track(BURST_ID, edge="gauss_hermite"), service.arrivals(BURST_ID)
    assert set(track["edge"]) == {"gauss_hermite"}
    assert track["x_rsun"].unit == u.solRad
    assert set(arrivals["observatory"]) == {"WIND", "STEREO-A", "STEREO-B"}
    assert service.burst(BURST_ID)["burst_id"] == BURST_ID
    assert set(service.detections("2012-06-07", "2012-06-08", "WIND")["tier"]) == {"localisable", "rejected"}
    assert len(service.localisations()) > len(service.tracks()) == 3


def test_events_come_with_the_bursts_that_they_are_near_to(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(client, "PAGE_ROWS", 1)
    found = Client(address).events("2012-06-07", "2012-06-08")
    assert found["event_id"].tolist() == ["DONKI:F", "DONKI:C"]
    assert found["burst_id"].tolist() == [BURST_ID, ""]
    assert found["delay_s"][0] == -120 * u.s
    assert found["longitude_deg"].unit == u.deg
    assert Client(address).events(kind="cme", linked=False)["event_id"].tolist() == ["DONKI:C"]


def test_arrival_times_of_a_service_can_be_localised_at_once(address: str) -> None:
    arrivals = Client(address).arrivals(BURST_ID)
    found = bella.localise(
        arrivals[np.isin(arrivals["frequency_mhz"].value, arrivals["frequency_mhz"].value[:2])], draws=50
    )
    assert found.to_table()["frequency_mhz"].value.tolist() == arrivals["frequency_mhz"].value[:2].tolist()


def test_a_service_that_is_away_is_one_line(tmp_path: Path) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"http://127.0.0.1:{free.getsockname()[1]}"
    with pytest.raises(UnreachableError) as caught:
        Client(address).bursts()
    assert str(caught.value).startswith(f"{address} does not answer")
    assert "\n" not in str(caught.value)
    assert caught.value.__suppress_context__


@pytest.mark.parametrize(
    ("reply", "error"),
    [
        (b"Content-Length: 13\r\n\r\n<html></html>", InputError),
        (b"Content-Length: 2\r\n\r\n[]", InputError),
        (b"Content-Length: 3\r\n\r\n\xff\xfe\x00", InputError),
        (b"Content-Length: 500\r\n\r\ncut short", UnreachableError),
        (b"Transfer-Encoding: chunked\r\n\r\nzz\r\n", UnreachableError),
    ],
)
def test_another_server_or_a_reply_cut_short_is_one_line(reply: bytes, error: type[Exception]) -> None:
    class Another(BaseRequestHandler):
        def handle(self) -> None:
            self.request.recv(65536)
            self.request.sendall(b"HTTP/1.1 200 OK\r\n" + reply)

    with ThreadingTCPServer(("127.0.0.1", 0), Another) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        service = Client(f"http://127.0.0.1:{server.server_address[1]}")
        for question in (service.bursts, lambda: service.burst("T3-1")):
            with pytest.raises(error, match=re.escape(service.url)) as caught:
                question()
            assert "\n" not in str(caught.value)
        server.shutdown()


def test_what_the_service_refuses_is_said_in_its_words(address: str) -> None:
    service = Client(address)
    with pytest.raises(NoDataError, match="there is no burst T3-1"):
        service.track("T3-1")
    with pytest.raises(InputError, match="observatry"):
        service.bursts(observatry="WIND")
    with pytest.raises(InputError, match="is not the address of a service"):
        Client("ftp://example.org")
    with pytest.raises(NoDataError, match="nothing at this address"):
        Client(f"{address}/elsewhere").bursts()
