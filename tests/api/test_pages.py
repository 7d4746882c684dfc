"""What the pages say without a browser's help."""

import re
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path

import pytest
from fastapi.testclient import TestClient

from api.app import create_app
from api.rendering import DASH
from bella.catalogue import Catalogue, ListRead
from bella.linked_events import Event, Link
from bella.settings import Settings
from tests.api.published import published, settings_of, synthetic_burst
from tests.plotting.synthetic import BURST_ID, synthetic_track_fit

API_PAGE = Path(__file__).parents[2] / "docs" / "api.md"
FOLLOW = "What other methods and models say follows within minutes"
HTML = {"Accept": "text/html"}
ROW = re.compile(r'<th scope="row" class="when"><a href="/bursts/(T3-[0-9-]+)"')


def page(client: TestClient, path: str, status: int = 200) -> str:
    reply = client.get(path, headers=HTML)
    assert reply.status_code == status, reply.text
    assert reply.headers["content-type"].startswith("text/html")
    return re.sub(r"\s+", " ", reply.text)


def test_a_burst_whose_companions_are_not_there_yet_says_that_they_follow(tmp_path: Path) -> None:
    settings, fit = settings_of(tmp_path / "home"), synthetic_track_fit("half_maximum")
    early = fit | {"companions": {}, "companions_pending": True}
    with Catalogue.open(settings.catalogue_url, create=True) as catalogue, TestClient(create_app(settings)) as client:
        solution = published(settings, catalogue, track_fit=early)
        address = f"/api/v1/bursts/{BURST_ID}/track"
        first = client.get(address)
        assert first.json()["track_fit"]["companions_pending"]
        assert first.json()["track_fit"]["companions"] == {}
        assert FOLLOW in page(client, f"/bursts/{BURST_ID}")
        catalogue.add_companions(solution.solution_id, fit["companions"])
        later = client.get(address, headers={"If-None-Match": first.headers["etag"]})
        assert later.status_code == 200, "what a reader has kept is not all any more"
        assert not later.json()["track_fit"]["companions_pending"]
        assert later.json()["track_fit"]["companions"].keys() == fit["companions"].keys()
        assert FOLLOW not in page(client, f"/bursts/{BURST_ID}")


def test_catalogue_lists_all_bursts(client: TestClient) -> None:
    text = page(client, "/")
    assert len(ROW.findall(text)) == 8
    assert "8 bursts." in text
    assert "cut here" not in text


def test_a_cut_catalogue_says_so_and_its_next_page_goes_on(client: TestClient) -> None:
    text = page(client, "/?limit=5&observatory=WIND")
    assert "Showing 5 of 8 bursts" in text
    (onward,) = re.findall(r'href="(/\?[^"]+)" rel="next"', text)
    following = page(client, onward.replace("&amp;", "&"))
    assert len(ROW.findall(following)) == 3
    assert "First page" in following
    assert 'value="WIND" checked' in following


def test_longitudes_across_the_far_side_are_said_in_words(client: TestClient) -> None:
    text = page(client, "/?longitude_min=170&longitude_max=-170")
    assert 'id="no-match"' in text
    assert "Longitudes from 170° W westward, across 180°, to 170° E." in text
    assert 'id="arc"' not in page(client, "/?longitude_min=-170&longitude_max=170")
    assert 'id="arc"' not in page(client, "/?longitude_min=170")


def test_three_kinds_of_nothing_are_told_apart(client: TestClient, empty: Settings) -> None:
    assert 'id="no-match"' in page(client, "/?start=1999-01-01&stop=1999-02-01")
    assert 'id="fault"' in page(client, "/?start=yesterday", 422)
    with TestClient(create_app(empty)) as other:
        text = page(other, "/")
        assert 'id="empty-catalogue"' in text
        assert "bella run" in text


def test_a_filter_that_cannot_be_read_stays_in_the_form(client: TestClient) -> None:
    text = page(client, "/?start=2012-99-99&without_flag=multimodal", 422)
    assert 'value="2012-99-99"' in text
    assert "is not a time" in text
    assert '<option value="multimodal" selected>' in text
    assert "observatry: is not a parameter" in page(client, "/?observatry=WIND", 422)


def test_burst_page_shows_the_other_answers_with_what_they_would_change(client: TestClient) -> None:
    text = page(client, f"/bursts/{BURST_ID}")
    table = text[text.index('class="others stack"') :]
    table = table[: table.index("</table>")]
    first, second = table.split("<tbody>")[1].split("</tr>")[:2]
    assert "Half-maximum, posterior, bella-2024" in first
    assert "<strong>13° W</strong>" in first
    assert ">preferred<" in first
    assert "<strong>29° W</strong>" in second
    assert "25 to 33" in second
    assert "+16°" in second
    assert "edge=gauss_hermite&amp;method=posterior&amp;preset=bella-2024" in second
    assert "The definition of the edge decides the track" in text
    assert "apparent source: not corrected for scattering" in text
    other = page(client, f"/bursts/{BURST_ID}?edge=gauss_hermite")
    assert 'id="other-series"' in other
    assert "version=1" in other


def test_a_link_with_a_version_shows_that_version(client: TestClient) -> None:
    query = "edge=half_maximum&method=posterior&preset=bella-2024"
    assert "an older version" in page(client, f"/bursts/{BURST_ID}?{query}&version=1")
    newest = page(client, f"/bursts/{BURST_ID}?{query}&version=2")
    assert 'id="other-series"' not in newest
    assert f'href="/bursts/{BURST_ID}?{query.replace("&", "&amp;")}&amp;version=2" id="copy-link"' in newest
    assert "no such series" in page(client, f"/bursts/{BURST_ID}?{query}&version=9", 404)


def test_track_section_has_a_column_per_method_and_says_why_they_differ(client: TestClient) -> None:
    text = page(client, f"/bursts/{BURST_ID}?edge=gauss_hermite")
    section = text[text.index('id="track-title"') : text.index('id="download-title"')]
    columns = re.findall(r'<th scope="col" class="value">([^<]+)</th>', section)
    assert columns == ["Joint", "Two-step", "Piecewise", "SEMP"]
    assert re.findall(r'data-name="Joint">(29.0 .24.6 to 33.4.) <span class="within">(20.0 to 38.0)', section)
    for words in (
        "claims ± 12 km/s where the joint fit finds ± 80, 7 times as much",
        "with 25.38 d instead of 24.47 d each is 3.6 % lower",
        "18° from that of the joint fit, more than their errors allow",
        "0.50 c against 0.15 c",
        "Piecewise: a spiral needs 3 positions; add frequencies",
        "Stonyhurst 29° (68 %: 24 to 33°, 95 %: 20 to 38°); Carrington 211°",
        ">400 km/s, assumed</td>",
    ):
        assert words in section, words
    assert "<img" not in section, "a run that was killed before it drew has no figures"


def test_track_section_begins_with_where_and_how_sure(client: TestClient) -> None:
    text = page(client, f"/bursts/{BURST_ID}")
    section = text[text.index('id="track-title"') : text.index('id="download-title"')]
    for words in (
        "at 13° (68 %: 9 to 17°, 95 %: 4 to 22°), in a wind of 1995 (1710 to 2375) km/s",
        "86 (77 to 95) R☉ from the Sun at 0.17 MHz",
    ):
        assert words in section[: section.index("<details")], words


def test_track_section_holds_apparent_and_corrected_sources(client: TestClient) -> None:
    text = page(client, f"/bursts/{BURST_ID}?edge=gauss_hermite")
    table = text[text.index('class="scattering') : text.index("</table>", text.index('class="scattering'))]
    first, second = (re.findall(r"<td[^>]*>([^<]+)</td>", row) for row in table.split("<tbody>")[1].split("</tr>")[:2])
    assert first == [
        "0.17",
        "86.0 (77.0 to 95.0)",
        "4.8",
        "40.0 (35.8 to 44.2)",
        "394",
        "1.2",
        "61.2 (57.0 to 65.4)",
        "201",
        "1.2",
    ]
    assert set(second[2:]) == {DASH}
    for words in (
        "Not corrected",
        "10.3847/1538-4357/acf6c1",
        "29.1 (24.7 to 33.5)° and 188 (157 to 219) km/s as fundamental",
    ):
        assert words in text, words


def test_burst_page_of_an_older_version_has_no_track_section(settings_of_old: Settings) -> None:
    with TestClient(create_app(settings_of_old)) as other:
        text = page(other, f"/bursts/{BURST_ID}")
    assert 'id="track-title"' not in text
    assert 'class="figure constellation"' in text


def test_figures_of_a_solution_are_shown_once_they_are_drawn(settings_with_figures: Settings) -> None:
    with TestClient(create_app(settings_with_figures)) as other:
        text = page(other, f"/bursts/{BURST_ID}")
        addresses = re.findall(r'href="(/api/v1/solutions/[^"]+/figures/[^"]+)"', text)
        assert [address.rpartition("/")[2] for address in addresses] == [
            f"{name}.{kind}" for name in ("wind", "shared-profile") for kind in ("svg", "png", "pdf")
        ]
        assert "shifted and stretched onto the profile that they share" in text
        assert text.count("drawing of wind") == 1
        for address, begins in zip(addresses[3:], (b"<svg ", b"\x89PNG", b"%PDF"), strict=True):
            reply = other.get(address)
            assert reply.content.startswith(begins)
            assert reply.headers["content-security-policy"].startswith("default-src 'none'")
        kept = " ".join(other.get(addresses[3]).text.replace("</text>", " ").split())
        for words in ("shifted and stretched", f"Burst {BURST_ID}.", "Cite: BELLA service, http://testserver/api/v1/"):
            assert words in kept, words
        assert other.get(addresses[0].replace("wind", "anything")).status_code == 422
        assert other.get(addresses[0].replace(".svg", ".gif")).status_code == 422


def test_a_figure_that_was_not_drawn_is_said_so(client: TestClient) -> None:
    solution = client.get(f"/api/v1/bursts/{BURST_ID}").json()["preferred_solution"]
    missing = client.get(f"/api/v1/solutions/{solution}/figures/wind.svg")
    assert missing.status_code == 404
    assert "run the burst again" in missing.json()["detail"]


def test_burst_page_marks_the_superseded_version(client: TestClient) -> None:
    text = page(client, f"/bursts/{BURST_ID}")
    assert text.count(">superseded<") == 1
    assert text.count('<span class="chip good">preferred<') == 1
    assert text.count(">current<") == 1


def test_burst_page_offers_downloads_that_are_there(client: TestClient) -> None:
    text = page(client, f"/bursts/{BURST_ID}")
    links = {link.replace("&amp;", "&") for link in re.findall(r'href="(/api/[^"]+)"', text)}
    assert len(links) >= 18
    assert {client.get(link).status_code for link in links} == {200}
    assert text.count("xarray.open_zarr(") == 1


def test_nothing_on_a_page_comes_from_elsewhere(client: TestClient) -> None:
    for path in ("/", f"/bursts/{BURST_ID}"):
        text = page(client, path)
        sources = re.findall(r'(?:src|href)="([^"]+)"', text)
        fetched = re.findall(r'<(?:script|img)[^>]+src="([^"]+)"|<link[^>]+href="([^"]+)"', text)
        assert sources
        assert all("".join(pair).startswith(("/static/", "/feed.atom")) for pair in fetched)
        assert "<style" not in text
        assert not re.findall(r"<script(?![^>]*src=)", text)
        for address in ("".join(pair) for pair in fetched):
            assert client.get(address).status_code == 200, address


def test_style_of_figures_is_kept_by_browsers(client: TestClient) -> None:
    reply = client.get("/static/figure.css?v=1")
    assert "immutable" in reply.headers["cache-control"]
    assert reply.headers["content-type"].startswith("text/css")
    assert "prefers-color-scheme: dark" in reply.text


def test_figures_of_the_page_are_files_too_and_follow_the_view(client: TestClient) -> None:
    text = page(client, f"/bursts/{BURST_ID}?view=fleet&clock=sun&frequency=0.5&f=0.2,1")
    for name, said in (("constellation", "HEE"), ("spectra", "at the Sun"), ("evolution", "Leblanc")):
        (link,) = re.findall(rf'href="(/api/[^"]+/figures/{name}\.svg[^"]*)"', text)
        reply = client.get(link.replace("&amp;", "&"))
        assert reply.headers["content-type"] == "image/svg+xml"
        assert "style-src 'unsafe-inline'" in reply.headers["content-security-policy"]
        assert "script-src" not in reply.headers["content-security-policy"]
        assert said in reply.text
        assert "doi:10.1051/0004-6361/202347747" in reply.text
    near, far = (
        client.get(f"/api/v1/bursts/{BURST_ID}/figures/constellation.svg?view={view}").text
        for view in ("track", "fleet")
    )
    assert near != far
    for kind, begin in (("png", b"\x89PNG"), ("pdf", b"%PDF-")):
        kept = client.get(f"/api/v1/bursts/{BURST_ID}/figures/evolution.{kind}")
        assert kept.content.startswith(begin)
        assert kept.headers["content-type"] in {"image/png", "application/pdf"}
        assert f'filename="{BURST_ID}_evolution.{kind}"' in kept.headers["content-disposition"]
    assert client.get(f"/api/v1/bursts/{BURST_ID}/figures/residuals.gif").status_code == 422
    for wrong in ("view=moon", "frame=galactic", "t=yesterday,today", "f=1,0.1", "frequency=-3", "x=1"):
        assert client.get(f"/api/v1/bursts/{BURST_ID}/figures/spectra.svg?{wrong}").status_code == 422, wrong


def test_list_shows_longitude_distances_and_wind_of_each_burst(client: TestClient) -> None:
    text = page(client, "/")
    row = text[text.index(f'aria-label="{BURST_ID}"') :]
    row = row[: row.index("</tr>")]
    for words in (
        "<strong>13° W</strong>",
        "9 to 17°",
        "13 to 152 R☉",
        "2000",
        "1710 to 2380",
        "WIND, STEREO-A, STEREO-B",
    ):
        assert words in row, words
    assert ROW.findall(text)[0] > ROW.findall(text)[-1], "newest first"
    assert text.count('class="figure thumbnail"') == 8
    assert 'class="figure selection"' in text
    assert ROW.findall(page(client, "/?sort=start")) == ROW.findall(text)[::-1]


def test_newest_burst_has_an_address(client: TestClient) -> None:
    reply = client.get("/latest", follow_redirects=False)
    assert (reply.status_code, reply.headers["location"]) == (302, "/bursts/T3-20120614-1929")


def test_guide_and_api_pages_explain_every_flag_and_address(client: TestClient) -> None:
    guide, api = page(client, "/guide"), page(client, "/api/v1/docs")
    for flag in ("several_tracks", "formal_errors"):
        assert flag.replace("_", " ") in guide
    for path in client.get("/api/v1/openapi.json").json()["paths"]:
        assert f" {path}<" in api, path


def test_a_table_is_checked_row_by_row_and_shown_before_anything_is_kept(client: TestClient) -> None:
    head = "observatory,frequency_mhz,arrival_utc,sigma_s,edge"
    good = [f"{name},1.0,2012-06-07T19:31:1{n}Z,10,half_rise" for n, name in enumerate(("Wind", "STA", "STEREO-B"))]
    reply = client.post("/submit", data={"table": "\n".join([head, *good])}, headers=HTML)
    assert reply.status_code == 200
    assert 'class="figure constellation"' in reply.text
    assert "1 frequency" in re.sub(r"<[^>]+>", "", reply.text)
    bad = [good[0], good[1].replace("1.0", "-1"), good[2].replace("2012", "20x2"), good[0].replace("Wind", "Wnd")]
    reply = client.post("/submit", data={"table": "\n".join([head, *bad])}, headers=HTML)
    assert reply.status_code == 422
    faults = re.findall(r"<li>([^<]+)</li>", reply.text)
    assert [one.partition(",")[0] for one in faults] == ["row 2", "row 3", "row 4"]
    assert "is not in the ephemeris" in faults[2]
    assert good[0] in reply.text
    assert client.post("/submit", data={"table": "nonsense"}, headers=HTML).status_code == 422
    assert client.post("/submit", data={"table": "x" * 10**7}, headers=HTML).status_code == 413


def test_events_near_a_burst_stand_on_its_page(tmp_path: Path) -> None:
    settings, start = settings_of(tmp_path), datetime(2012, 6, 7, 19, 24, tzinfo=UTC)
    place = {"size": "C3.4", "longitude_deg": 62.0, "region": 1494}
    flare = Event("swpc:5200", "flare", "swpc", "5200", "EARTH", start, start, **place)
    with closing(Catalogue.open(settings.catalogue_url, create=True)) as catalogue:
        published(settings, catalogue)
        published(settings, catalogue, burst=synthetic_burst(burst_id="T3-20120608-0000"))
        known = ListRead("goes.json", "read", "a" * 64, 1, 0, "", start, start, start, start)
        catalogue.events.replace(known, [flare])
        catalogue.events.link(BURST_ID, [Link(flare, -120.0)])
    with TestClient(create_app(settings)) as other:
        text = page(other, f"/bursts/{BURST_ID}")
        table = text[text.index('class="events stack"') :].partition("</table>")[0]
        for words in ("flare", "2012-06-07 19:24", "\N{MINUS SIGN}2.0", "C3.4", ">62<", "1494", "swpc"):
            assert words in table, words
        assert 'id="no-events"' in page(other, "/bursts/T3-20120608-0000")


def test_an_unknown_burst_is_a_page_too(client: TestClient) -> None:
    assert "T3-19990101-0000" in page(client, "/bursts/T3-19990101-0000", 404)


def test_form_fields_have_labels(client: TestClient) -> None:
    text = page(client, "/")
    labelled = set(re.findall(r'<label for="([^"]+)"', text))
    fields = set(re.findall(r'<(?:input|select) id="([^"]+)"', text))
    assert fields <= labelled
    assert {"start", "stop", "without_flag"} <= fields


@pytest.mark.parametrize("query", ["x=1,2&y=3,4&frequency=0.3", "hidden=gauss_hermite", "t=nonsense"])
def test_view_state_is_left_to_the_page(client: TestClient, query: str) -> None:
    assert BURST_ID in page(client, f"/bursts/{BURST_ID}?{query}")


def test_api_description_names_every_route_and_parameter(client: TestClient) -> None:
    described = client.get("/api/v1/openapi.json").json()["paths"]
    assert {"/api/v1/bursts", "/api/v1/bursts/{burst_id}/track", "/api/v1/arrivals", "/health"} <= set(described)
    for path, methods in described.items():
        for method, operation in methods.items():
            assert operation.get("description") or operation.get("summary"), (path, method)
            for parameter in operation.get("parameters", []):
                assert parameter["in"] != "query" or parameter.get("description"), (path, parameter["name"])


def test_api_description_says_of_what_kind_errors_are(client: TestClient) -> None:
    described = client.get("/api/v1/openapi.json").json()["paths"]
    reply = client.get("/api/v1/bursts/NOPE")
    for methods in described.values():
        for operation in methods.values():
            (kind,) = operation["responses"]["4XX"]["content"]
            assert reply.headers["content-type"] == kind
            assert "422" not in operation["responses"]
    properties = client.get("/api/v1/openapi.json").json()["components"]["schemas"]["Problem"]["properties"]
    assert set(reply.json()) == set(properties)


def test_flags_of_the_answer_that_is_shown_are_explained(tmp_path: Path) -> None:
    settings = settings_of(tmp_path)
    with closing(Catalogue.open(settings.catalogue_url, create=True)) as catalogue:
        published(settings, catalogue, edge="gauss_hermite", flags=("several_tracks",))
        published(settings, catalogue, edge="half_maximum", flags=("several_tracks", "not_a_spiral"))
    with TestClient(create_app(settings)) as other:
        text = page(other, f"/bursts/{BURST_ID}?edge=half_maximum")
        assert ">not a spiral</span>" in text
        text = page(other, f"/bursts/{BURST_ID}?edge=gauss_hermite")
    assert re.search(r">several tracks</span> \w+", text)
    assert ">not a spiral</span>" not in text


def test_every_companion_of_a_track_is_described(client: TestClient) -> None:
    schemas = client.get("/api/v1/openapi.json").json()["components"]["schemas"]
    described = schemas["TrackFitReply"]["properties"]["companions"]["description"]
    rows = dict(re.findall(r"^\| `(\w+)` \| (.+) \|$", API_PAGE.read_text(), re.MULTILINE))
    track = client.get(f"/api/v1/bursts/{BURST_ID}/track").json()["track_fit"]
    assert {"semp", "footpoint", "scattering"} <= set(track["companions"])
    for name, companion in track["companions"].items():
        assert f"`{name}`" in described, name
        unsaid = [field for field in companion if f"`{field}`" not in rows[name]]
        assert set(unsaid) <= {"model", "flags", "reason"}, (name, unsaid)


def test_figures_of_a_selection_are_of_all_its_bursts_and_files_too(client: TestClient) -> None:
    total = client.get("/api/v1/bursts?limit=1").json()["total"]
    text = page(client, "/?limit=1&sort=start")
    assert f"Figures of these {total} bursts" in text
    for name in ("longitude", "footpoints", "wind"):
        assert f'href="/api/v1/figures/{name}.pdf"' in text
        reply = client.get(f"/api/v1/figures/{name}.svg")
        assert f"{total} bursts." in reply.text
        assert "href=" not in reply.text
        again = client.get(f"/api/v1/figures/{name}.svg", headers={"If-None-Match": reply.headers["etag"]})
        assert again.status_code == 304
    assert len(re.findall(r'<a href="/bursts/[^"]+"><title>', text)) == 2 * total
    (sector,) = set(re.findall(r'href="(/\?longitude_min=[^"]+)"', text))
    assert f"{total} bursts." in page(client, sector.replace("&amp;", "&"))
    some = page(client, "/?stop=2012-06-10&grade=AB")
    assert "stop=2012-06-10" in re.findall(r'href="/api/v1/figures/wind.svg\?([^"]+)"', some)[0]
    assert client.get("/api/v1/figures/wind.svg?stop=2001-01-01").status_code == 404
    assert client.get("/api/v1/figures/wind.svg?limit=3").status_code == 422
