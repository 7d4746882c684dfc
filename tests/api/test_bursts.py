"""Browsing, and what one burst has to say."""

import csv
import io
from typing import Any

import httpx
import numpy as np
import pytest
from fastapi.testclient import TestClient

from tests.api.published import CHANNELS, EDGES
from tests.plotting.synthetic import BURST_ID, synthetic_posterior

BURST = f"/api/v1/bursts/{BURST_ID}"


def listed(client: TestClient, **query: Any) -> dict[str, Any]:
    reply = client.get("/api/v1/bursts", params=query)
    assert reply.status_code == 200, reply.text
    return reply.json()  # type: ignore[no-any-return]


def test_all_bursts_come_the_newest_first(client: TestClient) -> None:
    reply = listed(client)
    starts = [burst["start_utc"] for burst in reply["bursts"]]
    assert starts == sorted(starts, reverse=True)
    assert (reply["total"], reply["returned"], reply["truncated"], reply["next"]) == (8, 8, False, None)


def test_a_cut_list_says_so_and_its_pages_make_the_whole(client: TestClient) -> None:
    whole = [burst["burst_id"] for burst in listed(client)["bursts"]]
    reply = listed(client, limit=3)
    assert (reply["total"], reply["returned"], reply["truncated"]) == (8, 3, True)
    seen = [burst["burst_id"] for burst in reply["bursts"]]
    while reply["next"]:
        reply = client.get(reply["next"]).json()
        seen += [burst["burst_id"] for burst in reply["bursts"]]
    assert seen == whole
    assert not reply["truncated"]


@pytest.mark.parametrize(
    ("query", "expected"),
    [
        ({"start": "2012-06-08", "stop": "2012-06-10"}, 2),
        ({"start": "2012-06-07T19:29:15Z", "stop": "2012-06-07T19:29:16Z"}, 1),
        ({"stop": "2012-06-07T19:29:15Z"}, 0),
        ({"start": "2012-06-07T21:29:15+02:00", "stop": "2012-06-08"}, 1),
        ({"observatory": ["WIND", "STEREO-B"]}, 8),
        ({"observatory": ["WIND", "PSP"]}, 0),
        ({"without_flag": "multimodal"}, 4),
        ({"without_flag": ["multimodal", "speed_not_constrained"]}, 0),
        ({"start": "", "stop": "", "observatory": "", "without_flag": ""}, 8),
        ({"start": "1990-01-01", "stop": "1991-01-01"}, 0),
    ],
)
def test_filters(client: TestClient, query: dict[str, Any], expected: int) -> None:
    reply = listed(client, **query)
    assert reply["total"] == len(reply["bursts"]) == expected


@pytest.mark.parametrize(
    ("query", "word"),
    [
        ({"start": "yesterday"}, "start"),
        ({"start": "2012-06-31"}, "start"),
        ({"stop": "2012-06-07T25:00"}, "stop"),
        ({"start": "2013-01-01", "stop": "2012-01-01"}, "start"),
        ({"cursor": "%%%"}, "cursor"),
        ({"cursor": "bm9wZQ"}, "cursor"),
        ({"limit": "0"}, "limit"),
        ({"limit": "1001"}, "limit"),
        ({"limit": "many"}, "limit"),
        ({"observatry": "WIND"}, "observatry"),
    ],
)
def test_a_filter_that_cannot_be_read_is_refused_by_name(client: TestClient, query: dict[str, str], word: str) -> None:
    reply = client.get("/api/v1/bursts", params=query)
    assert reply.status_code == 422
    assert word in reply.json()["detail"].partition(":")[0]


def test_a_burst_has_the_newest_solution_of_each_series(client: TestClient) -> None:
    reply = client.get(BURST).json()
    assert {(s["edge"], s["version"]) for s in reply["solutions"]} == {("half_maximum", 2), ("gauss_hermite", 1)}
    assert reply["remark"] == "apparent source: not corrected for scattering"
    assert reply["start_utc"] == "2012-06-07T19:29:15Z"


def test_every_link_of_a_burst_leads_somewhere(client: TestClient) -> None:
    burst = client.get(BURST).json()
    links = [*burst["links"].values(), *(link for s in burst["solutions"] for link in s["links"].values())]
    for link in links:
        address = f"{link}/zarr.json" if link.endswith(".zarr") else link
        assert client.get(address).status_code == 200, link


def test_versions_are_all_there_and_the_superseded_one_is_marked(client: TestClient) -> None:
    versions = client.get(f"{BURST}/versions").json()["versions"]
    by_key = {(v["edge"], v["version"]): v for v in versions}
    assert set(by_key) == {("half_maximum", 1), ("half_maximum", 2), ("gauss_hermite", 1)}
    old, new = by_key["half_maximum", 1], by_key["half_maximum", 2]
    assert old["superseded_by"] == new["solution_id"]
    assert new["supersedes"] == old["solution_id"]
    assert new["superseded_by"] is None


def test_track_holds_the_localisations_of_the_posterior(client: TestClient) -> None:
    for edge in EDGES:
        reply = client.get(f"{BURST}/track", params={"edge": edge}).json()
        posterior = synthetic_posterior(edge, frequencies=CHANNELS)
        rows = reply["localisations"]
        np.testing.assert_allclose([row["frequency_mhz"] for row in rows], CHANNELS)
        np.testing.assert_allclose([row["x_rsun"] for row in rows], posterior["x_rsun"])
        assert rows[0]["cov_zz_rsun2"] is None
        assert reply["frame"] == "HEE"
        assert reply["track_fit"]["two_step"]["points"] == 200
        assert reply["track_fit"]["joint"]["v_sw_km_s"]["q97_5"] > reply["track_fit"]["joint"]["v_sw_km_s"]["mean"]
        assert reply["track_fit"]["companions"]["piecewise"]["flags"] == ["not_computed"]


def test_an_older_version_is_still_there(client: TestClient) -> None:
    reply = client.get(f"{BURST}/track", params={"edge": "half_maximum", "version": 1}).json()
    assert reply["solution"]["version"] == 1
    assert len(reply["localisations"]) == len(CHANNELS)


@pytest.mark.parametrize("ask", [{"params": {"format": "csv"}}, {"headers": {"Accept": "text/csv"}}])
def test_csv_has_the_numbers_of_json_under_a_commented_header(client: TestClient, ask: dict[str, Any]) -> None:
    reply = client.get(f"{BURST}/track", **ask)
    assert reply.headers["content-type"].startswith("text/csv")
    lines = reply.text.splitlines()
    comments = [line for line in lines if line.startswith("#")]
    assert "# remark: apparent source: not corrected for scattering" in comments
    table = list(csv.DictReader(io.StringIO("\n".join(line for line in lines if not line.startswith("#")))))
    rows = client.get(f"{BURST}/track").json()["localisations"]
    np.testing.assert_allclose([float(row["x_rsun"]) for row in table], [row["x_rsun"] for row in rows], rtol=1e-9)
    assert {row["preset"] for row in table} == {"bella-2024"}


def test_json_wins_over_csv_where_both_are_accepted(client: TestClient) -> None:
    reply = client.get(f"{BURST}/track", headers={"Accept": "application/json, text/csv;q=0.5"})
    assert reply.headers["content-type"] == "application/json"


def test_posterior_summary_is_the_group_without_its_draws(client: TestClient) -> None:
    reply = client.get(f"{BURST}/posterior", params={"edge": "gauss_hermite"}).json()
    posterior = synthetic_posterior("gauss_hermite", frequencies=CHANNELS)
    for name in ("x_rsun", "mode_y_rsun", "area95_rsun2", "contraction_v", "draw_ess"):
        np.testing.assert_allclose(reply["summary"][name], posterior[name], rtol=1e-6)
    np.testing.assert_allclose(reply["summary"]["frequency_mhz"], CHANNELS, rtol=1e-6)
    assert reply["draws"] == 50
    assert reply["attributes"]["sigma_rule"] == "30 s for all"
    assert "draws" not in reply["summary"]
    assert reply["zarr_url"].startswith("http://testserver/api/v1/solutions/")


def test_regions_at_a_frequency_come_for_every_edge(client: TestClient) -> None:
    reply = client.get(f"{BURST}/regions", params={"frequency_mhz": 0.3}).json()
    regions = reply["regions"]
    assert reply["remark"] == "apparent source: not corrected for scattering"
    assert {region["edge"] for region in regions} == set(EDGES)
    assert len({region["frequency_mhz"] for region in regions}) == 1
    assert all(len(region["region68"]["x"]) > 10 for region in regions)


@pytest.mark.parametrize("frequency", ["0", "-1", "nan", "inf", "", "x"])
def test_regions_need_a_frequency(client: TestClient, frequency: str) -> None:
    reply = client.get(f"{BURST}/regions", params={"frequency_mhz": frequency})
    assert reply.status_code == 422
    assert "frequency_mhz" in reply.json()["detail"]


@pytest.mark.parametrize("name", ["constellation", "spectra"])
def test_a_figure_that_is_known_is_not_sent_again(client: TestClient, name: str) -> None:
    first = client.get(f"{BURST}/figures/{name}.svg")
    assert first.headers["content-type"] == "image/svg+xml"
    again = client.get(f"{BURST}/figures/{name}.svg", headers={"If-None-Match": first.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")
    for another in ("png", "svg?theme=dark"):
        assert client.get(f"{BURST}/figures/{name}.{another}").headers["etag"] != first.headers["etag"]
    other = client.get(f"{BURST}/figures/{name}.svg", headers={"If-None-Match": '"other"'})
    assert other.status_code == 200


def test_a_burst_without_spectra_says_why_there_is_no_figure(client: TestClient) -> None:
    reply = client.get("/api/v1/bursts/T3-20120608-1929/figures/spectra.svg")
    assert reply.status_code == 404
    assert "no spectra" in reply.json()["detail"]


@pytest.mark.parametrize(
    "rest", ["", "/versions", "/track", "/posterior", "/regions?frequency_mhz=1", "/figures/spectra.svg"]
)
def test_an_unknown_burst_is_not_an_empty_list(client: TestClient, rest: str) -> None:
    reply = client.get(f"/api/v1/bursts/T3-19990101-0000{rest}")
    assert reply.status_code == 404
    assert "T3-19990101-0000" in reply.json()["detail"]


def test_an_unknown_solution_of_a_known_burst_lists_what_there_is(client: TestClient) -> None:
    reply = client.get(f"{BURST}/track", params={"method": "nuts"})
    assert reply.status_code == 404
    assert "half_maximum/posterior/bella-2024 v2" in reply.json()["detail"]


def test_replies_are_compressed_for_those_who_ask(client: TestClient) -> None:
    reply: httpx.Response = client.get(f"{BURST}/figures/constellation.svg", headers={"Accept-Encoding": "gzip"})
    assert reply.headers["content-encoding"] == "gzip"
    assert int(reply.headers["content-length"]) < len(reply.content) / 2
