"""The burst page draws, answers to the mouse, and keeps its view in the address."""

from typing import Any
from urllib.parse import parse_qs, urlsplit

import pytest
from playwright.sync_api import Page, expect

from tests.browser.conftest import Watch
from tests.plotting.synthetic import FREQUENCIES_MHZ

PHONE = {"viewport": {"width": 390, "height": 844}, "has_touch": True}
LAPTOP = {"viewport": {"width": 1200, "height": 800}}
DARK = {"color_scheme": "dark"}


def view(page: Page) -> dict[str, str]:
    return {name: values[0] for name, values in parse_qs(urlsplit(page.url).query).items()}


def ranges(page: Page, plot: str) -> list[list[Any]]:
    script = "id => ['xaxis', 'yaxis'].map(axis => document.getElementById(id)._fullLayout[axis].range)"
    return page.evaluate(script, plot)  # type: ignore[no-any-return]


def drag(page: Page, plot: str, start: tuple[float, float], end: tuple[float, float]) -> None:
    """Drag over a plot, in parts of the area between its axes."""
    box = page.locator(f"#{plot} .nsewdrag").first.bounding_box()
    assert box is not None
    at = [(box["x"] + box["width"] * x, box["y"] + box["height"] * y) for x, y in (start, end)]
    page.mouse.move(*at[0])
    page.mouse.down()
    page.mouse.move((at[0][0] + at[1][0]) / 2, (at[0][1] + at[1][1]) / 2, steps=4)
    page.mouse.move(*at[1], steps=4)
    page.mouse.up()


def pixel_of(page: Page, plot: str, x: float, y: float) -> tuple[float, float]:
    script = """([id, x, y]) => {
      const plot = document.getElementById(id), {xaxis, yaxis} = plot._fullLayout, box = plot.getBoundingClientRect();
      return [box.left + xaxis._offset + xaxis.l2p(x), box.top + yaxis._offset + yaxis.l2p(y)];
    }"""
    left, top = page.evaluate(script, [plot, x, y])
    return left, top


def test_both_figures_are_drawn(watch: Watch, burst_path: str) -> None:
    page = watch.open(burst_path)
    drawn = page.locator("#constellation .scatterlayer .trace")
    assert drawn.count() > 30
    assert page.locator("#spectra .heatmaplayer image").count() == 3
    assert page.locator("#spectra .scatterlayer .trace").count() == 6
    points = page.locator("#constellation .scatterlayer .trace path.point").count()
    assert points >= 2 * len(FREQUENCIES_MHZ)
    for name in ("WIND", "STEREO-A", "STEREO-B", "Sun"):
        assert page.locator("#constellation text", has_text=name).count() >= 1
    watch.photograph("burst", full_page=True)


def test_hover_names_the_channel_and_its_errors(watch: Watch, burst_path: str) -> None:
    page = watch.open(burst_path)
    page.evaluate("() => document.getElementById('constellation').scrollIntoView({block: 'center'})")
    x, y = page.evaluate(
        """() => {const t = document.getElementById('constellation').data.find(
            t => t.meta?.role === 'track' && t.meta.edge === 'gauss_hermite'); return [t.x[0], t.y[0]];}"""
    )
    page.mouse.move(*pixel_of(page, "constellation", x, y))
    label = page.locator("#constellation .hoverlayer")
    expect(label).to_contain_text("0.15")
    expect(label).to_contain_text("68 % area")
    expect(label).to_contain_text("speed not constrained (contraction 0.99)")
    watch.photograph("burst-hover")


def test_zoom_goes_into_the_address_and_comes_back_from_it(watch: Watch, burst_path: str) -> None:
    page = watch.open(burst_path)
    before = ranges(page, "constellation")
    drag(page, "constellation", (0.45, 0.35), (0.85, 0.65))
    page.wait_for_function("() => location.search.includes('x=')")
    zoomed = ranges(page, "constellation")
    assert zoomed[0][1] - zoomed[0][0] < 0.7 * (before[0][1] - before[0][0])
    page.reload()
    page.wait_for_selector("body[data-drawn='2']")
    for restored, wanted in zip(ranges(page, "constellation"), zoomed, strict=True):
        assert restored == pytest.approx(wanted, abs=0.5)
    watch.photograph("burst-zoom")


def test_zoom_of_the_spectra_is_shared_by_the_panels_and_kept_in_mhz(watch: Watch, burst_path: str) -> None:
    page = watch.open(burst_path)
    drag(page, "spectra", (0.05, 0.2), (0.4, 0.9))
    page.wait_for_function("() => location.search.includes('f=')")
    low, high = sorted(float(end) for end in view(page)["f"].split(","))
    assert 0.05 < low < high < 5
    assert view(page)["t"].startswith("2012-06-07T19:")
    zoomed = ranges(page, "spectra")
    third = page.evaluate("document.getElementById('spectra')._fullLayout.yaxis3.range")
    assert third == pytest.approx(zoomed[1])
    page.reload()
    page.wait_for_selector("body[data-drawn='2']")
    restored = ranges(page, "spectra")
    assert restored[1] == pytest.approx(zoomed[1], abs=1e-3)
    assert [end[:19] for end in restored[0]] == [end[:19].replace(" ", "T") for end in zoomed[0]]


def test_double_click_takes_the_zoom_out_of_the_address(watch: Watch, burst_path: str) -> None:
    page = watch.open(f"{burst_path}?x=0,120&y=-60,60")
    assert ranges(page, "constellation")[0] == pytest.approx([0, 120], abs=20)
    page.locator("#constellation .nsewdrag").first.dblclick()
    page.wait_for_function("() => !location.search.includes('x=')")


def test_buttons_zoom_to_the_track_and_back(watch: Watch, burst_path: str) -> None:
    page = watch.open(burst_path)
    whole = ranges(page, "constellation")
    page.get_by_role("button", name="Zoom to track").click()
    page.wait_for_function("() => location.search.includes('x=')")
    (west, east), (south, north) = ranges(page, "constellation")
    assert east - west == pytest.approx(north - south)
    assert east - west < 0.6 * (whole[0][1] - whole[0][0])
    shown = page.evaluate(
        """() => document.getElementById('constellation').data.filter(trace => trace.meta?.role === 'region')
        .map(trace => [Math.min(...trace.x), Math.max(...trace.x), Math.min(...trace.y), Math.max(...trace.y)])"""
    )
    assert len(shown) == 24
    for left, right, below, above in shown:
        assert west < left < right < east
        assert south < below < above < north
    watch.photograph("burst-track")
    page.get_by_role("button", name="Whole constellation").click()
    page.wait_for_function("() => !location.search.includes('x=')")
    for restored, before in zip(ranges(page, "constellation"), whole, strict=True):
        assert restored == pytest.approx(before)


def test_slider_moves_the_regions_and_the_numbers(watch: Watch, burst_path: str) -> None:
    page = watch.open(burst_path)
    read = """() => document.getElementById('constellation').data
        .filter(trace => trace.meta?.role === 'selected').map(trace => trace.x[0])"""
    before, numbers = page.evaluate(read), page.locator("#selected-rows").inner_text()
    assert len(before) == 4
    page.locator("#frequency").focus()
    with page.expect_response(lambda reply: "/regions" in reply.url):
        page.keyboard.press("Home")
    expect(page.locator("#frequency-shown")).to_have_text("0.150 MHz")
    expect(page.locator("#selected-rows")).not_to_have_text(numbers)
    page.wait_for_function(f"() => JSON.stringify(({read})()) !== {str(before).replace(' ', '')!r}")
    assert view(page)["frequency"] == "0.1500"
    page.reload()
    page.wait_for_selector("body[data-drawn='2']")
    expect(page.locator("#frequency-shown")).to_have_text("0.150 MHz")
    watch.photograph("burst-frequency", full_page=True)


def test_click_on_a_spectrum_chooses_its_frequency(watch: Watch, burst_path: str) -> None:
    page = watch.open(burst_path)
    box = page.locator("#spectra .nsewdrag").first.bounding_box()
    assert box is not None
    page.mouse.click(box["x"] + box["width"] * 0.7, box["y"] + box["height"] * 0.75)
    page.wait_for_function("() => location.search.includes('frequency=')")
    assert 0.1 < float(view(page)["frequency"]) < 0.6


def test_a_track_that_is_switched_off_is_off_in_both_figures_and_in_the_address(watch: Watch, burst_path: str) -> None:
    page = watch.open(burst_path)
    count = """() => ['constellation', 'spectra'].map(id => document.getElementById(id).data.filter(
        t => t.legendgroup === 'half_maximum' && t.visible !== 'legendonly').length)"""
    assert min(page.evaluate(count)) >= 3
    page.locator("#constellation .legendtoggle").first.click()
    page.wait_for_function("() => location.search.includes('hidden=half_maximum')")
    assert page.evaluate(count) == [0, 0]
    page.reload()
    page.wait_for_selector("body[data-drawn='2']")
    assert page.evaluate(count) == [0, 0]
    page.locator("#spectra .legendtoggle").first.click()
    page.wait_for_function("() => !location.search.includes('hidden')")
    assert min(page.evaluate(count)) >= 3


@pytest.mark.parametrize("state", ["x=1&y=,&f=a,b&t=,", "frequency=-3", "frequency=abc", "hidden=nothing", "x=%22,%27"])
def test_nonsense_in_the_address_is_no_harm(watch: Watch, burst_path: str, state: str) -> None:
    page = watch.open(f"{burst_path}?{state}")
    assert page.locator("#constellation .scatterlayer .trace").count() > 30


@pytest.mark.parametrize("watch", [PHONE], indirect=True)
def test_a_phone_needs_no_sideways_scrolling(watch: Watch, burst_path: str) -> None:
    page = watch.open(burst_path)
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    assert page.locator("#constellation .scatterlayer .trace").count() > 30
    watch.photograph("burst-phone", full_page=True)
    watch.open("/")
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    watch.photograph("catalogue-phone")


@pytest.mark.parametrize("watch", [LAPTOP], indirect=True)
def test_no_table_scrolls_and_no_legend_touches_the_toolbar_on_a_laptop(watch: Watch, burst_path: str) -> None:
    page = watch.open(burst_path)
    wide = "[...document.querySelectorAll('.scroll')].filter(e => e.scrollWidth > e.clientWidth).length"
    assert page.evaluate(wide) == 0
    page.locator("#spectra").hover()
    legend, toolbar = (
        page.locator(f"#spectra {part}").first.bounding_box() for part in (".legend", ".modebar-container .modebar")
    )
    assert legend is not None
    assert toolbar is not None
    assert toolbar["y"] + toolbar["height"] <= legend["y"]


def test_track_section_shows_both_figures_of_each_edge(watch: Watch, burst_path: str) -> None:
    page = watch.open(burst_path)
    pictures = page.locator(".drawn img")
    assert pictures.count() == 4
    page.locator("details.edge:not([open]) > summary").click()
    for picture in pictures.all():
        picture.scroll_into_view_if_needed()
        page.wait_for_function("image => image.complete && image.naturalWidth > 500", arg=picture.element_handle())
    expect(page.locator("table.methods").first).to_contain_text("13.0 (8.6 to 17.4)")
    watch.photograph("burst-track-section", full_page=True)


@pytest.mark.parametrize("watch", [DARK], indirect=True)
def test_dark_page_has_light_writing_in_its_figures(watch: Watch, burst_path: str) -> None:
    page = watch.open(burst_path)
    colour = page.locator("#constellation text", has_text="WIND").first.evaluate("t => getComputedStyle(t).fill")
    channels = [int(part) for part in colour.removeprefix("rgb(").removesuffix(")").split(",")]
    assert min(channels) > 180
    watch.photograph("burst-dark", full_page=True)


@pytest.mark.parametrize("watch", [LAPTOP, PHONE], indirect=True)
def test_the_answer_is_the_first_thing_that_is_seen(watch: Watch, burst_path: str) -> None:
    page = watch.open(burst_path)
    answer = page.locator("#answer")
    expect(answer).to_contain_text("13° W (9 to 17), 12 to 152 R_sun, wind 2000 km/s (1710 to 2380), grade A")
    box = answer.bounding_box()
    assert box is not None
    assert box["y"] + box["height"] < 420
    assert page.evaluate("document.documentElement.scrollWidth") <= page.viewport_size["width"]  # type: ignore[index]
    watch.photograph(f"burst-answer-{page.viewport_size['width']}")  # type: ignore[index]


def test_the_first_track_of_page_and_legend_is_the_preferred_one(watch: Watch, burst_path: str) -> None:
    page = watch.open(burst_path)
    expect(page.locator("details.edge[open] h3")).to_have_text("Half-maximum edge")
    expect(page.locator("#selected-rows tr").first).to_contain_text("Half-maximum edge")
    expect(page.locator("#selected-rows tr").first).to_contain_text(" to ")
    expect(page.locator("table.versions .chip.good")).to_have_text("preferred")
