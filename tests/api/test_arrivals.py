"""Arrival tables submitted over HTTP: with a token, under an id of their own, withdrawn by it."""

import hashlib
import re
from dataclasses import dataclass

import pandas as pd
import pytest
from fastapi.testclient import TestClient
from httpx import Response

from api.app import create_app
from bella.arrivals import arrivals_csv, check_arrivals
from bella.catalogue import Catalogue
from bella.settings import Settings
from tests.api.published import published, served
from tests.plotting.synthetic import BURST_ID, REFERENCE, synthetic_posterior

CSV = {"Content-Type": "text/csv"}
ADDRESS = "/api/v1/arrivals"


@dataclass
class Sender:
    """Somebody with a token, at a service."""

    client: TestClient
    token: str

    def headers(self) -> dict[str, str]:
        return {"Authorization": f"Bearer {self.token}"}

    def post(self, content: str | bytes, **more: str) -> Response:
        return self.client.post(ADDRESS, content=content, headers=CSV | self.headers() | more)

    def delete(self, submission_id: str) -> Response:
        return self.client.delete(f"{ADDRESS}/{submission_id}", headers=self.headers())


@pytest.fixture
def ann(empty: Settings, token: str) -> Sender:
    return Sender(TestClient(create_app(empty), raise_server_exceptions=False), token)


@pytest.fixture
def bob(empty: Settings, ann: Sender) -> Sender:
    with Catalogue.open(empty.catalogue_url) as catalogue:
        return Sender(ann.client, catalogue.create_token("Bob")[1])


def table(shift_s: float = 0.0) -> pd.DataFrame:
    stacked = synthetic_posterior()["arrival_s"][::20].to_dataframe().reset_index()
    start = pd.Timestamp(REFERENCE).tz_localize(None)
    return pd.DataFrame(
        {
            "observatory": stacked["observatory"],
            "frequency_mhz": stacked["frequency"],
            "arrival_utc": start + pd.to_timedelta(stacked["arrival_s"] + shift_s, unit="s"),
            "sigma_s": 30.0,
            "edge": "half_maximum",
        }
    )


def text(frame: pd.DataFrame) -> str:
    return frame.to_csv(index=False)


def waiting(settings: Settings) -> list[str]:
    with Catalogue.open(settings.catalogue_url) as catalogue:
        return [one.submission_id for one in catalogue.pending_submissions()]


def test_a_good_table_is_kept_and_waits_for_the_next_run(empty: Settings, ann: Sender) -> None:
    body = arrivals_csv(check_arrivals(table()))
    reply = ann.post(body)
    assert reply.status_code == 202, reply.text
    own = reply.json()["submission_id"]
    assert re.fullmatch(r"S-20120607-[a-z2-9]{10}", own)
    assert reply.json()["sha256"] == hashlib.sha256(body.encode()).hexdigest()
    assert reply.json()["state"] == "received"
    assert reply.json()["links"] == {"self": f"{ADDRESS}/{own}"}
    assert ann.client.get(f"{ADDRESS}/{own}").json() == reply.json()
    assert {file.name: file.read_text() for file in empty.incoming_root.iterdir()} == {f"{own}.csv": body}
    assert waiting(empty) == [own]


def test_the_same_table_of_one_token_is_one_submission(empty: Settings, ann: Sender) -> None:
    first, second = (ann.post(text(table())) for _ in range(2))
    assert (first.status_code, second.status_code) == (202, 202)
    assert first.json() == second.json()
    assert len(waiting(empty)) == 1
    assert [file.name for file in empty.incoming_root.iterdir()] == [f"{first.json()['submission_id']}.csv"]


def test_equal_tables_of_two_people_are_two_submissions(empty: Settings, ann: Sender, bob: Sender) -> None:
    replies = [one.post(text(table())).json() for one in (ann, bob)]
    assert replies[0]["sha256"] == replies[1]["sha256"]
    assert waiting(empty) == [one["submission_id"] for one in replies]
    assert len({*waiting(empty)}) == 2
    assert len(list(empty.incoming_root.iterdir())) == 2


def wrong_headers(token: str) -> dict[str, str | None]:
    return {
        "none": None,
        "empty": "",
        "another scheme": f"Basic {token}",
        "no scheme": token,
        "without its end": f"Bearer {token[:-1]}",
        "with more": f"Bearer {token}x",
        "in capitals": f"Bearer {token.upper()}",
        "only a scheme": "Bearer ",
        "another one": "Bearer bella_" + "A" * 43,
    }


@pytest.mark.parametrize("fault", wrong_headers(""))
@pytest.mark.parametrize("method", ["POST", "DELETE"])
def test_without_a_known_token_nothing_is_written(empty: Settings, ann: Sender, method: str, fault: str) -> None:
    own = ann.post(text(table(5.0))).json()["submission_id"]
    header = wrong_headers(ann.token)[fault]
    headers = CSV if header is None else CSV | {"Authorization": header}
    address = ADDRESS if method == "POST" else f"{ADDRESS}/{own}"
    reply = ann.client.request(method, address, content=text(table()), headers=headers)
    assert reply.status_code == 401
    assert reply.headers["www-authenticate"] == 'Bearer realm="bella"'
    assert reply.headers["content-type"] == "application/problem+json"
    assert "bella token create" in reply.json()["detail"]
    assert ann.token not in reply.text
    assert waiting(empty) == [own]


def test_a_revoked_token_opens_nothing(empty: Settings, ann: Sender) -> None:
    own = ann.post(text(table())).json()["submission_id"]
    with Catalogue.open(empty.catalogue_url) as catalogue:
        catalogue.revoke_token(catalogue.tokens()[0].token_id)
    for reply in (ann.post(text(table(1.0))), ann.delete(own)):
        assert reply.status_code == 403
        assert "was revoked" in reply.json()["detail"]
        assert "www-authenticate" not in reply.headers
    assert waiting(empty) == [own]


def test_the_scheme_may_be_written_in_any_case(ann: Sender) -> None:
    headers = CSV | {"Authorization": f"bearer {ann.token}"}
    assert ann.client.post(ADDRESS, content=text(table()), headers=headers).status_code == 202


def test_open_submissions_need_no_token_but_a_wrong_one_stays_wrong(empty: Settings) -> None:
    client = TestClient(create_app(empty.model_copy(update={"open_submissions": True})))
    assert not Settings.model_fields["open_submissions"].default
    reply = client.post(ADDRESS, content=text(table()), headers=CSV)
    assert reply.status_code == 202
    assert client.post(ADDRESS, content=text(table()), headers=CSV | {"Authorization": "Bearer x"}).status_code == 401
    refused = client.delete(f"{ADDRESS}/{reply.json()['submission_id']}")
    assert refused.status_code == 403
    assert len(waiting(empty)) == 1


def test_a_token_withdraws_what_it_submitted_and_nothing_else(empty: Settings, ann: Sender, bob: Sender) -> None:
    own = ann.post(text(table())).json()["submission_id"]
    assert bob.delete(own).status_code == 403
    assert waiting(empty) == [own]
    for reply in (ann.delete(own), ann.delete(own), ann.client.get(f"{ADDRESS}/{own}")):
        assert reply.status_code == 200
        assert (reply.json()["state"], reply.json()["message"]) == ("withdrawn", "withdrawn by its submitter")
    assert waiting(empty) == []
    assert ann.delete("S-20120607-none").status_code == 404


def test_a_submission_never_touches_a_burst_of_its_minute(empty: Settings, ann: Sender) -> None:
    with Catalogue.open(empty.catalogue_url) as catalogue:
        published(empty, catalogue)
    before = ann.client.get(f"/api/v1/bursts/{BURST_ID}").json()
    own = ann.post(text(table())).json()["submission_id"]
    assert own != BURST_ID
    assert ann.client.get(f"/api/v1/bursts/{BURST_ID}").json() == before


def test_a_real_server_asks_for_the_token_before_it_reads_the_table(empty: Settings) -> None:
    import socket
    from urllib.parse import urlsplit

    with served(empty) as address, socket.create_connection(("127.0.0.1", urlsplit(address).port or 0), 20) as line:
        head = f"POST {ADDRESS} HTTP/1.1\r\nHost: x\r\nContent-Type: text/csv\r\nContent-Length: 1000000\r\n\r\n"
        line.sendall(head.encode())
        assert line.recv(12) == b"HTTP/1.1 401"


def test_a_full_queue_asks_to_come_later_and_keeps_nothing(empty: Settings, ann: Sender) -> None:
    replies = [ann.post(text(table(shift))) for shift in (0.0, 1.0, 2.0)]
    known = ann.post(text(table(1.0)))
    assert [reply.status_code for reply in replies] == [202, 202, 503]
    assert int(replies[-1].headers["retry-after"]) > 0
    assert known.status_code == 202
    assert len(list(empty.incoming_root.iterdir())) == 2


def changed(row: int, column: str, value: object) -> str:
    frame = table().astype({column: object})
    frame.loc[row, column] = value
    return text(frame)


def located(replace: dict[str, str]) -> pd.DataFrame:
    """Table of receivers that the ephemeris need not know."""
    frame = table()
    known = {name: (200.0, 40.0 * at, 0.0) for at, name in enumerate(dict.fromkeys(frame["observatory"]))}
    for at, axis in enumerate(("x_rsun", "y_rsun", "z_rsun")):
        frame[axis] = [known[name][at] for name in frame["observatory"]]
    return frame.replace({"observatory": replace})


BROKEN: dict[str, tuple[str, list[str]]] = {
    "missing column": (text(table().drop(columns="sigma_s")), ["column sigma_s"]),
    "not a number": (changed(4, "sigma_s", "NaN"), ["row 5", "column sigma_s"]),
    "sigma": (changed(2, "sigma_s", 0), ["row 3", "column sigma_s"]),
    "twice": (text(pd.concat([table(), table().iloc[[3]]])), ["row 31", "column frequency_mhz"]),
    "unknown observatory": (text(table().replace("WIND", "VOYAGER")), ["row 1", "column observatory", "VOYAGER"]),
    "two spacecraft": (text(table().query("observatory != 'WIND'")), ["column observatory"]),
    "another day": (changed(1, "arrival_utc", "2012-06-08T19:30:00Z"), ["row 2", "column arrival_utc"]),
    "formula": (text(located(replace={"WIND": '=HYPERLINK("http://x")'})), ["row", "column observatory", "= + - @"]),
    **{
        f"name with {sign}": (text(located(replace={"WIND": f"{sign}wind"})), ["column observatory", "= + - @"])
        for sign in ("+", "-", "@", " =")
    },
    "control character": (text(located(replace={"WIND": "wind\x1b[31m"})), ["column observatory"]),
    "control character alone": (text(located(replace={"WIND": "wind\x1b"})), ["column observatory"]),
    "edge as a formula": (text(table().assign(edge="=1+1")), ["column edge"]),
    "edge as a path": (text(table().assign(edge="../x")), ["column edge", "letters, digits"]),
    "future": (text(table(shift_s=86400.0 * 365 * 100)), ["row 1", "column arrival_utc"]),
    "empty": ("", ["not a CSV table"]),
    "not text": ("\x00\x01", ["names one column"]),
}


@pytest.mark.parametrize("fault", BROKEN)
def test_a_bad_table_is_refused_by_row_and_column_and_nothing_is_kept(empty: Settings, ann: Sender, fault: str) -> None:
    body, words = BROKEN[fault]
    reply = ann.post(body)
    assert reply.status_code == 422, reply.text
    detail = reply.json()["detail"]
    assert all(word in detail for word in words), detail
    assert "\n" not in detail
    assert not empty.incoming_root.exists()
    with Catalogue.open(empty.catalogue_url) as catalogue:
        assert catalogue.pending_submissions() == ()


def test_a_time_outside_the_ephemeris_is_an_error_of_the_table(ann: Sender) -> None:
    frame = table()
    frame["arrival_utc"] -= pd.Timedelta(days=365 * 60)
    reply = ann.post(text(frame))
    assert reply.status_code == 422, reply.text


def test_a_time_that_has_not_come_is_refused(ann: Sender) -> None:
    soon = pd.Timestamp.now("UTC").tz_localize(None) + pd.Timedelta(minutes=5)
    frame = table()
    frame["arrival_utc"] += soon - frame["arrival_utc"].max()
    reply = ann.post(text(frame))
    assert reply.status_code == 422
    assert "is in the future" in reply.json()["detail"]


def test_bytes_that_are_not_text_are_refused(ann: Sender) -> None:
    reply = ann.post(b"observatory\n\xff\xfe")
    assert reply.status_code == 422
    assert "byte 13" in reply.json()["detail"]


def test_a_table_that_is_too_large_is_not_read_to_its_end(empty: Settings, ann: Sender) -> None:
    reply = ann.post(text(table()) + "#" * 30_000)
    assert reply.status_code == 413
    assert "20000 bytes" in reply.json()["detail"]
    assert not empty.incoming_root.exists()


@pytest.mark.parametrize("kind", ["application/json", "multipart/form-data; boundary=x"])
def test_another_media_type_says_how_to_send_it(ann: Sender, kind: str) -> None:
    reply = ann.post(text(table()), **{"Content-Type": kind})
    assert reply.status_code == 415
    assert "--data-binary" in reply.json()["detail"]


def test_an_unknown_submission_is_not_found(ann: Sender) -> None:
    assert ann.client.get(f"{ADDRESS}/S-20120607-none").status_code == 404
