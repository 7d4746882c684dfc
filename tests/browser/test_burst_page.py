"""The page of a burst: the answer first, figures that follow the link, and nothing lost without scripts."""

import re
from urllib.parse import parse_qs, urlsplit

import pytest
from playwright.sync_api import Page, expect

from tests.browser.conftest import Watch

PHONE = {"viewport": {"width": 390, "height": 844}, "has_touch": True}
LAPTOP = {"viewport": {"width": 1440, "height": 900}}
WIDE = {"viewport": {"width": 2560, "height": 1300}}
DARK = {"color_scheme": "dark"}
PLAIN = {"java_script_enabled": False}
LIGHTEST_KB = 400


def view(page: Page) -> dict[str, str]:
    return {name: values[0] for name, values in parse_qs(urlsplit(page.url).query).items()}


def scale(page: Page) -> float:
    return float(page.locator("svg.constellation").get_attribute("data-per-rsun") or 0)


def shown(page: Page) -> None:
    """Wait until the parts of another address have come."""
    page.wait_for_function("() => document.body.dataset.shown && !document.body.dataset.busy")
    page.evaluate("() => { delete document.body.dataset.shown; }")


@pytest.mark.parametrize("watch", [LAPTOP, LAPTOP | DARK, PHONE, PHONE | DARK, WIDE], indirect=True)
def test_answer_grade_and_picture_are_seen_first(watch: Watch, burst_path: str) -> None:
    page = watch.open(burst_path)
    answer, size = page.locator("#answer"), page.viewport_size
    assert size is not None
    expect(answer).to_contain_text("13° W (9 to 17), 12 to 152 R☉, wind 2000 km/s (1710 to 2380)")
    expect(answer.locator(".grade")).to_contain_text("A")
    for one, share in ((answer, 1.0), (page.locator("svg.constellation"), 0.6)):
        box = one.bounding_box()
        assert box is not None
        assert box["y"] + share * box["height"] <= size["height"]
    assert page.evaluate("document.documentElement.scrollWidth") <= size["width"]
    sky, ink = (
        page.locator(name).first.evaluate("one => getComputedStyle(one).fill")
        for name in ("svg.constellation .sky", "svg.constellation .craft-label")
    )
    assert sky != ink
    scheme = page.evaluate("matchMedia('(prefers-color-scheme: dark)').matches")
    watch.photograph(f"burst-{size['width']}-{'dark' if scheme else 'light'}", full_page=True)


SLOW = {"offline": False, "latency": 200, "downloadThroughput": 20_000, "uploadThroughput": 20_000}
PAINTED = """() => [
  performance.getEntriesByName("first-contentful-paint")[0].startTime,
  performance.getEntriesByType("navigation")[0].responseEnd,
]"""


@pytest.mark.parametrize("watch", [PHONE], indirect=True)
def test_on_a_slow_network_the_answer_is_painted_before_the_rest_of_its_page_has_come(
    watch: Watch, burst_path: str
) -> None:
    watch.page.context.new_cdp_session(watch.page).send("Network.emulateNetworkConditions", SLOW)
    page = watch.open(burst_path)
    painted, whole = page.evaluate(PAINTED)
    assert painted < whole
    assert "".join(page.content().partition('id="answer"')[:2]).count("<svg") <= 1, "the answer comes before figures"


NARROW = """() => [...document.querySelectorAll(".scroll")].filter(one => one.scrollWidth > one.clientWidth + 1)
  .map(one => one.textContent.trim().slice(0, 40))"""


@pytest.mark.parametrize("watch", [PHONE], indirect=True)
@pytest.mark.parametrize("path", ["", "/status", "/planning?day=2013-05-13", "/api/v1/docs"])
def test_nothing_scrolls_sideways_on_a_phone(watch: Watch, burst_path: str, path: str) -> None:
    page = watch.open(path or burst_path)
    page.evaluate("document.querySelectorAll('details').forEach(one => { one.open = true })")
    assert page.evaluate(NARROW) == []
    assert page.evaluate("document.documentElement.scrollWidth") <= 390


def test_first_visit_is_light_and_needs_nobody_else(watch: Watch, burst_path: str) -> None:
    sizes: list[int] = []
    watch.page.on("requestfinished", lambda one: sizes.append(one.sizes()["responseBodySize"]))
    watch.open(burst_path)
    watch.page.wait_for_load_state("networkidle")
    assert sum(sizes) < LIGHTEST_KB * 1000


def test_map_changes_with_its_links_and_the_link_holds_it(watch: Watch, burst_path: str) -> None:
    page = watch.open(burst_path)
    near = scale(page)
    page.get_by_role("link", name="whole fleet").click()
    shown(page)
    assert view(page) == {"view": "fleet"}
    assert scale(page) < 0.7 * near
    expect(page.locator("svg.constellation")).to_contain_text("STEREO-B")
    page.get_by_role("link", name="Carrington").click()
    shown(page)
    expect(page.locator("svg.constellation")).to_contain_text("210°")
    page.reload()
    assert view(page) == {"view": "fleet", "frame": "carrington"}
    assert scale(page) < 0.7 * near
    watch.photograph("burst-fleet")


def test_slider_and_click_choose_a_frequency_with_its_regions_and_numbers(watch: Watch, burst_path: str) -> None:
    page = watch.open(burst_path)
    expect(page.locator("svg.constellation .selected").first).to_have_attribute("d", "")
    page.locator("#frequency").focus()
    page.keyboard.press("Home")
    shown(page)
    expect(page.locator("#frequency-shown")).to_have_text("0.15 MHz")
    expect(page.locator("#numbers")).to_contain_text("R☉ from the Sun, longitude")
    assert page.evaluate("document.activeElement.id") == "frequency"
    assert len(page.locator("svg.constellation .selected").first.get_attribute("d") or "") > 100
    assert view(page)["frequency"] == "0.1500"
    box = page.locator("svg.spectra").bounding_box()
    assert box is not None
    page.mouse.click(box["x"] + 0.5 * box["width"], box["y"] + 0.1 * box["height"])
    shown(page)
    assert float(view(page)["frequency"]) > 0.5


def test_the_source_moves_out_with_a_clock(watch: Watch, burst_path: str) -> None:
    page = watch.open(burst_path)
    page.get_by_role("button", name="Play").click()
    expect(page.locator("#emitted")).to_contain_text(re.compile(r"MHz emitted at 19:\d\d:\d\d UTC"))
    expect(page.locator("svg.constellation .dots circle[visibility=hidden]")).to_have_count(0)
    expect(page.locator("#emitted")).to_contain_text("0.150 MHz")


def test_dragging_over_a_spectrum_zooms_and_the_link_keeps_it(watch: Watch, burst_path: str) -> None:
    page = watch.open(burst_path)
    figure = page.locator("svg.spectra")
    figure.scroll_into_view_if_needed()
    box = figure.bounding_box()
    assert box is not None
    x, y = (lambda share: box["x"] + share * box["width"]), (lambda share: box["y"] + share * box["height"])
    page.mouse.move(x(0.2), y(0.08))
    expect(page.locator("#reading")).to_contain_text("WIND: 19:")
    page.mouse.down()
    page.mouse.move(x(0.3), y(0.15), steps=3)
    page.mouse.move(x(0.5), y(0.22), steps=3)
    page.mouse.up()
    shown(page)
    first, last = view(page)["t"].split(",")
    assert "2012-06-07T19:" in first < last
    low, high = (float(one) for one in view(page)["f"].split(","))
    assert 0.1 < low < high < 3
    page.reload()
    assert [float(one) for one in (figure.get_attribute("data-band") or "").split(",")] == pytest.approx([low, high])
    page.get_by_role("link", name="whole burst").click()
    shown(page)
    assert view(page) == {}


def test_spectra_are_shifted_by_light_time(watch: Watch, burst_path: str) -> None:
    page = watch.open(burst_path)
    before = page.locator("svg.spectra").get_attribute("data-time")
    page.get_by_role("link", name="at the Sun").click()
    shown(page)
    expect(page.locator("svg.spectra")).to_contain_text("less the light time to each spacecraft")
    after = page.locator("svg.spectra").get_attribute("data-time")
    earlier = float((before or "").split(",")[0]) - float((after or "").split(",")[0])
    assert 450 < earlier < 550  # light takes 500 s to 1 au


def test_other_answers_are_one_click_away(watch: Watch, burst_path: str) -> None:
    page = watch.open(burst_path)
    row = page.locator("table.others tbody tr").nth(1)
    expect(row).to_contain_text("Gauss-Hermite")
    expect(row).to_contain_text("+16°")
    page.get_by_role("link", name="show on the figures").click()
    shown(page)
    expect(page.locator("svg.constellation .track.other")).to_have_count(1)
    page.locator("table.others tbody tr").nth(1).get_by_role("link", name="show").click()
    expect(page.locator("#other-series")).to_contain_text("You look at another answer")
    expect(page.locator("#answer")).to_contain_text("13° W")
    page.get_by_role("link", name="Show the preferred one").click()
    expect(page.locator("#other-series")).to_have_count(0)


@pytest.mark.parametrize("watch", [PLAIN, PLAIN | PHONE], indirect=True)
def test_without_scripts_every_figure_and_control_is_there(watch: Watch, burst_path: str) -> None:
    page = watch.open(burst_path)
    for figure in ("constellation", "spectra", "evolution"):
        expect(page.locator(f"svg.{figure}")).to_be_visible()
    page.get_by_role("link", name="whole fleet").click()
    assert view(page) == {"view": "fleet"}
    page.get_by_role("link", name="at Earth").click()
    assert view(page) == {"view": "fleet", "clock": "earth"}


NONSENSE = "x=1&f=a,b&t=,&frequency=-3&view=moon&frame=%22&clock=me&all=perhaps"


def test_nonsense_in_the_address_is_no_harm(watch: Watch, burst_path: str) -> None:
    page = watch.open(f"{burst_path}?{NONSENSE}&frequency=0.5")
    expect(page.locator("svg.constellation")).to_be_visible()
    expect(page.locator("svg.spectra")).to_be_visible()


def test_a_copied_link_names_series_and_version(watch: Watch, burst_path: str) -> None:
    page = watch.open(f"{burst_path}?view=fleet")
    permanent = page.get_by_role("link", name="Copy lasting link").get_attribute("href") or ""
    assert "edge=half_maximum" in permanent
    assert "version=1" in permanent
    page.get_by_role("link", name="Copy lasting link").click()
    expect(page.locator("#copied")).not_to_be_empty()
    assert view(page) == {"view": "fleet"}
    page.goto(watch.address + permanent)
    expect(page.locator("#answer")).to_contain_text("13° W")
