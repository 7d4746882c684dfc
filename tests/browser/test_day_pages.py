"""Searched days, from the list to a day, to a burst and back: with the mouse, the keyboard, and without scripts."""

import re

import pytest
from playwright.sync_api import Page, expect

from tests.browser.conftest import Watch
from tests.plotting.synthetic import BURST_ID

PHONE = {"viewport": {"width": 375, "height": 800}, "has_touch": True}
DARK = {"color_scheme": "dark"}
DAY = "/days/2012-06-07"


def loaded_figure(page: Page) -> None:
    """The day is drawn with its boxes."""
    expect(page.locator("svg.day image")).to_have_count(3)
    expect(page.locator("svg.day .box.localised")).to_have_count(3)


def fits_across(page: Page) -> bool:
    return bool(page.evaluate("document.documentElement.scrollWidth <= window.innerWidth"))


def test_from_the_catalogue_to_a_day_to_a_burst_and_back(watch: Watch) -> None:
    page = watch.open("/")
    page.get_by_role("navigation", name="Site").get_by_role("link", name="Days").click()
    expect(page.get_by_role("heading", level=1)).to_have_text("Searched days")
    expect(page.locator("table.days tbody tr:not(.month)")).to_have_count(3)
    watch.photograph("days", full_page=True)
    expect(page.locator("svg.strips .strip")).to_have_count(3)
    page.locator("table.days").get_by_role("link", name="2012-06-07").click()
    loaded_figure(page)
    page.locator("svg.day a", has=page.locator(".box.localised")).first.click()
    assert page.url.endswith(f"{DAY}#{BURST_ID}")
    expect(page.locator("table.received tbody")).to_have_count(2)
    watch.photograph("day", full_page=True)
    page.locator("table.received").get_by_role("link", name=BURST_ID).click()
    page.get_by_role("link", name="2012-06-07").first.click()
    expect(page.locator(f"#{BURST_ID}")).to_be_in_viewport()
    assert page.url.endswith(f"{DAY}?burst={BURST_ID}#{BURST_ID}")


def across_day(page: Page, *shares: float) -> None:
    """Drag over shares of the width of the first spectrum."""
    box = page.locator("svg.day .no-data").first.bounding_box()
    assert box
    places = [(box["x"] + share * box["width"], box["y"] + 0.9 * box["height"]) for share in shares]
    page.mouse.move(*places[0])
    page.mouse.down()
    page.mouse.move(*places[1], steps=5)
    page.mouse.up()


def test_a_part_of_the_day_is_zoomed_by_the_mouse_and_by_links(watch: Watch) -> None:
    page = watch.open(DAY)
    loaded_figure(page)
    across_day(page, 0.75, 0.875)
    expect(page.locator("svg.day")).to_have_attribute("data-time", re.compile("^6[45]"))
    assert re.search(r"t=1[78]:\d\d,2[01]:\d\d$", page.url)
    expect(page.locator("svg.day .hours")).to_contain_text("19:30")
    expect(page.locator("svg.day .onset-label")).to_have_count(3)
    page.get_by_role("link", name="00 to 06").click()
    expect(page.locator("svg.day .onset-label")).to_have_count(0)
    assert page.url.endswith("?t=00:00,06:00")
    page.reload()
    expect(page.locator("svg.day .hours")).to_contain_text("05:00")
    page.get_by_role("link", name="whole day").click()
    expect(page.locator("svg.day .onset-label")).to_have_count(3)
    page.locator("svg.day a", has=page.locator(".box.localised")).first.click()
    assert page.url.endswith(f"{DAY}#{BURST_ID}")


def test_the_searched_days_beside_it_are_one_click_away(watch: Watch) -> None:
    page = watch.open(DAY)
    page.locator("a[rel=next]").click()
    expect(page.get_by_role("heading", level=1)).to_have_text("2012-06-08")
    expect(page.locator("#quiet")).to_be_visible()
    expect(page.locator("#not-drawn")).to_contain_text("bella run --from 2012-06-08")
    expect(page.locator("a[rel=next]")).to_have_count(0)
    page.locator("a[rel=prev]").click()
    page.locator("a[rel=prev]").click()
    expect(page.get_by_role("heading", level=1)).to_have_text("2012-06-06")


def test_rejected_candidates_unfold_by_keyboard(watch: Watch) -> None:
    page = watch.open(DAY)
    table = page.locator("table.rejected")
    expect(table).to_be_hidden()
    page.locator("summary").focus()
    page.keyboard.press("Enter")
    expect(table).to_be_visible()
    expect(table.locator("tbody tr")).to_have_count(1)


def test_the_filter_is_the_query_of_the_address(watch: Watch) -> None:
    page = watch.open("/days")
    page.get_by_label("From (UTC day)").fill("2012-06-07")
    page.keyboard.press("Enter")
    expect(page.locator("table.days tbody tr:not(.month)")).to_have_count(2)
    assert "from=2012-06-07" in page.url
    page.get_by_label("To (UTC day)").fill("2012-06-07")
    page.get_by_role("button", name="Show days").click()
    expect(page.get_by_role("status")).to_have_text("1 day.")
    page.get_by_role("link", name="Clear").click()
    expect(page.get_by_role("status")).to_have_text("3 days.")


@pytest.mark.parametrize("watch", [PHONE, PHONE | DARK, {"java_script_enabled": False}], indirect=True)
def test_pages_need_neither_width_nor_scripts(watch: Watch) -> None:
    page = watch.open("/days")
    expect(page.locator("table.days tbody tr:not(.month)")).to_have_count(3)
    expect(page.get_by_role("columnheader", name="Localised")).to_be_in_viewport(ratio=1)
    page.locator("table.days").get_by_role("link", name="2012-06-07").click()
    expect(page.locator("table.received").get_by_text("localised", exact=True)).to_be_visible()
    page.locator("summary").first.click()
    expect(page.locator("table.rejected")).to_be_visible()
    for path in ("/days", DAY):
        assert fits_across(watch.open(path))


def test_every_picture_and_table_says_what_it_is(watch: Watch) -> None:
    page = watch.open(DAY)
    tree = page.locator("main").aria_snapshot()
    assert "Dynamic spectra of WIND, STEREO-A, STEREO-B on 2012-06-07 with 4 detections" in tree
    for name in ("Burst", "Localised, or why not", "Onset", "Spacecraft", "MHz", "Beam (c)", "Score"):
        assert f'columnheader "{name}"' in tree
    assert f'rowheader "{BURST_ID}"' in tree
