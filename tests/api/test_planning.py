"""Could a source be located: the page, the reply and the map; bad questions in words; nobody waits for ever."""

import re

import pytest
from fastapi.testclient import TestClient

from api.routers import observability as planning
from tests.api.test_pages import page

ASKED = "day=2013-05-13&observatory=Wind&observatory=STA&observatory=STEREO-B"


def test_the_page_says_from_where_on_and_its_link_keeps_the_state(client: TestClient) -> None:
    text = page(client, f"/planning?{ASKED}&sigma_s=15")
    assert "2013-05-13: STEREO-A, STEREO-B, WIND" in text
    assert re.search(r">Yes, from 50 R☉ outwards<", text)
    assert "located in 24 of 24 directions" in text
    assert len(re.findall(r'<th scope="row">[^<]*°', text)) == 12
    (link,) = re.findall(r'href="(/api/v1/planning\?[^"]+)"', text)
    reply = client.get(link.replace("&amp;", "&")).json()
    assert reply["day"] == "2013-05-13"
    assert reply["sigma_s"] == 15.0
    radius = reply["radius68_rsun"][reply["distances_rsun"].index(50.0)][reply["longitudes_deg"].index(0.0)]
    assert f"±{radius:.0f} <span" in text
    blunt = page(client, f"/planning?{ASKED}&sigma_s=600")
    assert "In few directions, with such errors" in blunt


def test_the_whole_fleet_of_a_day_is_taken_where_none_is_named(client: TestClient) -> None:
    found = client.get("/api/v1/planning?day=2013-05-13").json()
    assert set(found["receivers_rsun"]) == {"WIND", "STEREO-A", "STEREO-B"}
    assert found["missing"] == {}
    assert "No position is known on this day of PSP and of SOLO." in page(client, "/planning?day=2013-05-13")
    assert "No position is known" not in page(client, f"/planning?{ASKED}")
    assert client.get("/api/v1/planning").json()["localisable"] in {True, False}


def test_two_spacecraft_are_not_enough_and_the_page_says_why(client: TestClient) -> None:
    text = page(client, "/planning?day=2016-05-13&observatory=WIND&observatory=STA&observatory=STB")
    assert ">No<" in text
    assert "STEREO-B is left out:" in text
    assert "2014-09-30" in text
    assert "give its HEE" not in text


@pytest.mark.parametrize("day", ["1900-01-01", "2100-01-01"])
def test_a_day_without_positions_keeps_the_form_and_names_those_with(client: TestClient, day: str) -> None:
    text = page(client, f"/planning?day={day}", 422)
    assert "positions of the spacecraft are known from 2006-01-01 to 20" in text[text.index('id="fault"') :]
    assert f'value="{day}"' in text


@pytest.mark.parametrize(
    ("query", "word"),
    [
        ("day=tomorrow", "is not a day"),
        ("sigma_s=0", "sigma_s"),
        ("sigma_s=x", "sigma_s"),
        ("frequency_mhz=1000", "frequency_mhz"),
        ("fleet=WIND", "fleet"),
        ("observatory=STEREO-Q", "STEREO-Q"),
        ("&".join(["observatory=WIND"] * 9), "observatory"),
    ],
)
def test_bad_questions_are_answered_in_words(client: TestClient, query: str, word: str) -> None:
    reply = client.get(f"/api/v1/planning?{query}")
    assert reply.status_code == 422
    assert word in reply.json()["detail"]
    text = page(client, f"/planning?{query}", 422)
    assert word in text[text.index('id="fault"') :]


def test_the_map_is_a_file_that_says_how_to_cite_it(client: TestClient) -> None:
    text = page(client, f"/planning?{ASKED}")
    (link,) = re.findall(r'href="(/api/v1/planning/figure.svg[^"]+)"', text)
    reply = client.get(link.replace("&amp;", "&"))
    assert "STEREO-A, STEREO-B, WIND" in reply.text
    assert "/planning?day=2013-05-13" in reply.text
    assert client.get(reply.request.url, headers={"If-None-Match": reply.headers["etag"]}).status_code == 304
    dark = client.get(f"/api/v1/planning/figure.png?{ASKED}&theme=dark")
    assert dark.content.startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("radius", "said"), [(12.5, "yes"), (12.6, "roughly"), (25.0, "roughly"), (25.1, "no"), (None, "no")]
)
def test_a_source_is_located_within_a_quarter_of_its_distance(radius: float | None, said: str) -> None:
    assert planning.verdict(radius, 50.0) == said


def test_one_prediction_at_a_time_and_those_who_wait_too_long_are_told(
    client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(planning, "PATIENCE_S", 0.05)
    with planning._alone:
        reply = client.get(f"/api/v1/planning?{ASKED}&sigma_s=77")
    assert reply.status_code == 503
    assert "try again" in reply.json()["detail"]
    assert reply.headers["retry-after"]
    assert client.get(f"/api/v1/planning?{ASKED}&sigma_s=77").status_code == 200
    wanted = planning.PlanningQuery(day="2013-05-13", observatory=["WIND", "STA", "STB"], sigma_s=77)
    assert wanted.prediction() is wanted.prediction(), "computed once"
