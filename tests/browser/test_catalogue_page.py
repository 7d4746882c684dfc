"""The catalogue page filters, pages, and leads to a burst."""

import pytest
from playwright.sync_api import expect

from tests.browser.conftest import Watch
from tests.plotting.synthetic import BURST_ID


def test_list_of_all_bursts(watch: Watch) -> None:
    page = watch.open("/")
    assert page.locator("table.bursts tbody tr").count() == 9
    expect(page.get_by_role("status")).to_contain_text("9 bursts")
    first = page.locator("table.bursts tbody tr").first
    expect(first.locator(".longitude")).to_contain_text("13° W")
    expect(first.locator(".grade")).to_contain_text("A")
    expect(first.locator("svg.thumbnail .track")).to_have_count(1)
    expect(page.locator("table.bursts tbody")).not_to_contain_text("speed not constrained")
    watch.photograph("catalogue", full_page=True)


def test_filter_is_the_query_of_the_address(watch: Watch) -> None:
    page = watch.open("/")
    page.get_by_label("From (UTC)").fill("2012-06-08")
    page.get_by_label("Before (UTC)").fill("2012-06-11")
    page.get_by_text("Spacecraft, flags, origin, numbers").click()
    page.get_by_label("STEREO-B").check()
    page.get_by_role("button", name="Show bursts").click()
    expect(page.locator("table.bursts tbody tr")).to_have_count(3)
    assert page.url.endswith("/?start=2012-06-08&stop=2012-06-11&observatory=STEREO-B")
    expect(page.get_by_label("STEREO-B")).to_be_checked()
    page.get_by_label("PSP").check()
    page.get_by_role("button", name="Show bursts").click()
    expect(page.locator("#no-match")).to_be_visible()
    page.get_by_role("link", name="Clear").click()
    expect(page.locator("table.bursts tbody tr")).to_have_count(9)


def test_keyboard_alone_filters(watch: Watch) -> None:
    page = watch.open("/")
    page.get_by_text("Spacecraft, flags, origin, numbers").focus()
    page.keyboard.press("Enter")
    page.get_by_label("Without flag").focus()
    page.keyboard.type("multimodal")
    page.get_by_role("button", name="Show bursts").focus()
    page.keyboard.press("Enter")
    expect(page.locator("table.bursts tbody tr")).to_have_count(5)
    assert "without_flag=multimodal" in page.url


def test_pages_follow_one_another(watch: Watch) -> None:
    page = watch.open("/?limit=4")
    expect(page.get_by_role("status")).to_contain_text("Showing 4 of 9 bursts")
    page.get_by_role("link", name="Next page").click()
    page.get_by_role("link", name="Next page").click()
    expect(page.locator("table.bursts tbody tr")).to_have_count(1)
    page.get_by_role("link", name="First page").click()
    expect(page.locator("table.bursts tbody tr")).to_have_count(4)


def test_a_burst_is_one_click_away(watch: Watch) -> None:
    page = watch.open("/")
    page.get_by_role("link", name=BURST_ID, exact=True).click()
    expect(page.get_by_role("heading", level=1)).to_contain_text("Type III burst of 2012-06-07 19:29 UTC")
    expect(page.locator(".burst-id")).to_have_text(BURST_ID)


PHONE = {"viewport": {"width": 390, "height": 844}, "has_touch": True}


@pytest.mark.parametrize("watch", [PHONE, PHONE | {"color_scheme": "dark"}], indirect=True)
def test_bursts_are_cards_on_a_phone(watch: Watch) -> None:
    page = watch.open("/")
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    box = page.locator("table.bursts tbody tr").first.bounding_box()
    assert box is not None
    assert box["height"] < 260
    expect(page.locator("table.bursts tbody tr").first).to_contain_text("13° W")
    scheme = page.evaluate("matchMedia('(prefers-color-scheme: dark)').matches")
    watch.photograph(f"bursts-phone-{'dark' if scheme else 'light'}", full_page=True)


def test_a_table_of_times_is_checked_and_shown(watch: Watch) -> None:
    page = watch.open("/submit")
    page.get_by_role("button", name="Check").click()
    expect(page.locator("#preview svg.constellation")).to_contain_text("STEREO-A")
    expect(page.locator("#preview")).to_contain_text("2 frequencies")
    watch.photograph("submit", full_page=True)
