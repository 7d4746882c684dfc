"""Arrival tables handed in over HTTP."""

import hashlib

import pandas as pd
import pytest
from fastapi.testclient import TestClient

from api.app import create_app
from bella.arrivals import arrivals_csv, check_arrivals
from bella.catalogue import Catalogue
from bella.settings import Settings
from tests.plotting.synthetic import REFERENCE, synthetic_posterior

CSV = {"Content-Type": "text/csv"}


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


def test_a_good_table_is_kept_and_waits_for_the_next_run(empty: Settings) -> None:
    body = arrivals_csv(check_arrivals(table()))
    sha256 = hashlib.sha256(body.encode()).hexdigest()
    with TestClient(create_app(empty)) as client:
        reply = client.post("/api/v1/arrivals", content=body, headers=CSV)
        assert reply.status_code == 202, reply.text
        assert reply.json()["sha256"] == sha256
        assert reply.json()["state"] == "received"
        assert client.get(reply.json()["links"]["self"]).json() == reply.json()
    assert (empty.incoming_root / f"{sha256}.csv").read_text() == body
    assert [entry.name for entry in empty.incoming_root.iterdir()] == [f"{sha256}.csv"]
    with Catalogue.open(empty.catalogue_url) as catalogue:
        assert [submission.sha256 for submission in catalogue.pending_submissions()] == [sha256]


def test_the_same_table_twice_is_one_submission(empty: Settings) -> None:
    with TestClient(create_app(empty)) as client:
        first, second = (client.post("/api/v1/arrivals", content=text(table()), headers=CSV) for _ in range(2))
    assert (first.status_code, second.status_code) == (202, 202)
    assert first.json() == second.json()
    with Catalogue.open(empty.catalogue_url) as catalogue:
        assert len(catalogue.pending_submissions()) == 1


def test_a_full_queue_asks_to_come_later_and_keeps_nothing(empty: Settings) -> None:
    with TestClient(create_app(empty)) as client:
        replies = [
            client.post("/api/v1/arrivals", content=text(table(shift)), headers=CSV) for shift in (0.0, 1.0, 2.0)
        ]
        known = client.post("/api/v1/arrivals", content=text(table(1.0)), headers=CSV)
    assert [reply.status_code for reply in replies] == [202, 202, 503]
    assert int(replies[-1].headers["retry-after"]) > 0
    assert known.status_code == 202
    assert len(list(empty.incoming_root.iterdir())) == 2


def changed(row: int, column: str, value: object) -> str:
    frame = table().astype({column: object})
    frame.loc[row, column] = value
    return text(frame)


BROKEN: dict[str, tuple[str, list[str]]] = {
    "missing column": (text(table().drop(columns="sigma_s")), ["column sigma_s"]),
    "not a number": (changed(4, "sigma_s", "NaN"), ["row 5", "column sigma_s"]),
    "sigma": (changed(2, "sigma_s", 0), ["row 3", "column sigma_s"]),
    "twice": (text(pd.concat([table(), table().iloc[[3]]])), ["row 31", "column frequency_mhz"]),
    "unknown observatory": (text(table().replace("WIND", "VOYAGER")), ["row 1", "column observatory", "VOYAGER"]),
    "two spacecraft": (text(table().query("observatory != 'WIND'")), ["column observatory"]),
    "another day": (changed(1, "arrival_utc", "2012-06-08T19:30:00Z"), ["row 2", "column arrival_utc"]),
    "empty": ("", ["not a CSV table"]),
    "not text": ("\x00\x01", ["column observatory"]),
}


@pytest.mark.parametrize("fault", BROKEN)
def test_a_bad_table_is_refused_by_row_and_column_and_nothing_is_kept(empty: Settings, fault: str) -> None:
    body, words = BROKEN[fault]
    with TestClient(create_app(empty)) as client:
        reply = client.post("/api/v1/arrivals", content=body, headers=CSV)
    assert reply.status_code == 422, reply.text
    detail = reply.json()["detail"]
    assert all(word in detail for word in words), detail
    assert "\n" not in detail
    assert not empty.incoming_root.exists()
    with Catalogue.open(empty.catalogue_url) as catalogue:
        assert catalogue.pending_submissions() == ()


def test_a_time_outside_the_ephemeris_is_an_error_of_the_table(empty: Settings) -> None:
    frame = table()
    frame["arrival_utc"] -= pd.Timedelta(days=365 * 60)
    with TestClient(create_app(empty)) as client:
        reply = client.post("/api/v1/arrivals", content=text(frame), headers=CSV)
    assert reply.status_code == 422, reply.text


def test_bytes_that_are_not_text_are_refused(empty: Settings) -> None:
    with TestClient(create_app(empty)) as client:
        reply = client.post("/api/v1/arrivals", content=b"observatory\n\xff\xfe", headers=CSV)
    assert reply.status_code == 422
    assert "byte 13" in reply.json()["detail"]


def test_a_table_that_is_too_large_is_not_read_to_its_end(empty: Settings) -> None:
    with TestClient(create_app(empty)) as client:
        reply = client.post("/api/v1/arrivals", content=text(table()) + "#" * 30_000, headers=CSV)
    assert reply.status_code == 413
    assert "20000 bytes" in reply.json()["detail"]
    assert not empty.incoming_root.exists()


@pytest.mark.parametrize("kind", ["application/json", "multipart/form-data; boundary=x"])
def test_another_media_type_says_how_to_send_it(empty: Settings, kind: str) -> None:
    with TestClient(create_app(empty)) as client:
        reply = client.post("/api/v1/arrivals", content=text(table()), headers={"Content-Type": kind})
    assert reply.status_code == 415
    assert "--data-binary" in reply.json()["detail"]


def test_an_unknown_submission_is_not_found(empty: Settings) -> None:
    with TestClient(create_app(empty)) as client:
        assert client.get(f"/api/v1/arrivals/{'0' * 64}").status_code == 404
