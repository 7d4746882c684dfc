"""The ledger of quirks over HTTP."""

from fastapi.testclient import TestClient

from bella.spectra import quirks


def test_quirks_are_served_and_chosen(client: TestClient) -> None:
    every = client.get("/api/v1/quirks").json()
    of_day = client.get("/api/v1/quirks", params={"observatory": "Solar Orbiter", "day": "2023-06-01"}).json()
    before = client.get("/api/v1/quirks", params={"observatory": "SOLO", "day": "2022-12-19"}).json()

    assert [one["name"] for one in every] == [one.name for one in quirks()]
    assert [one["name"] for one in of_day] == ["solo_hfr_five_then_fifty"]
    assert before == []


def test_a_typing_error_is_answered(client: TestClient) -> None:
    reply = client.get("/api/v1/quirks", params={"observatory": "STERO-A"})

    assert reply.status_code in {400, 422}
    assert "did you mean STEREO-A" in reply.text
