"""No page, and no state of a page, breaks a rule of axe-core (WCAG 2.2 AA and best practice), in light and in dark."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, Page

from bella.catalogue import Catalogue
from bella.records import Origin
from tests.api.published import publish_event, publish_many, published, served, settings_of, synthetic_burst
from tests.browser.conftest import search_days
from tests.plotting.synthetic import BURST_ID

RETRACTED, SIMULATED = "T3-20120607-2100", "SIM-20120607-1929"
TABLE = "observatory,frequency_mhz,arrival_utc,sigma_s,edge\nWIND,{},2012-06-07T19:31:10Z,10,half_rise\n"


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A service with bursts of every kind."""
    settings = settings_of(tmp_path_factory.mktemp("axe"))
    with Catalogue.open(settings.catalogue_url, create=True) as catalogue:
        publish_event(settings, catalogue)
        publish_many(settings, catalogue, 2)
        published(settings, catalogue, burst=synthetic_burst(burst_id=RETRACTED))
        catalogue.retract(RETRACTED, "timed on interference")
        published(settings, catalogue, burst=replace(synthetic_burst(burst_id=SIMULATED), origin=Origin.SIMULATED))
        search_days(settings, catalogue)
    with served(settings) as address:
        yield address


@pytest.fixture(scope="module")
def page(browser: Browser, base: str) -> Iterator[Page]:
    """One page for all states."""
    context = browser.new_context(viewport={"width": 1280, "height": 900}, base_url=base)
    yield context.new_page()
    context.close()


@pytest.fixture(scope="module")
def empty(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A service without any burst."""
    settings = settings_of(tmp_path_factory.mktemp("empty"))
    with Catalogue.open(settings.catalogue_url, create=True):
        pass
    with served(settings) as address:
        yield address


def opened(page: Page) -> None:
    """Unfold all that can be unfolded; of the routes and schemas of the API, a few: the others are like them."""
    page.evaluate("document.querySelectorAll('.card > details:nth-of-type(n + 4)').forEach(one => one.remove())")
    page.evaluate("document.querySelectorAll('details').forEach(one => { one.open = true })")


def checked(page: Page, table: str) -> None:
    """Have an arrival table checked."""
    page.locator("#table").fill(table)
    page.get_by_role("button", name="Check").click()


def violations(page: Page) -> list[str]:
    """What axe complains of: of all rules in light, and of contrast, which alone depends on colours, in dark."""
    found = []
    for scheme, options in (("light", {}), ("dark", {"runOnly": ["color-contrast"]})):
        page.emulate_media(color_scheme=scheme)
        for one in Axe().run(page, options={"resultTypes": ["violations"], **options}).response["violations"]:
            found += [f"{scheme}: {one['id']}: {node['target']}: {node['failureSummary']}" for node in one["nodes"]]
    return found


STATES: dict[str, tuple[str, Callable[[Page], None] | None]] = {
    "list": ("/", opened),
    "list with a fault": ("/?start=yesterday", None),
    "list without a match": ("/?start=2025-01-01", None),
    "list with a retracted burst": ("/?retracted=true&limit=1&origin=all", None),
    "burst": (f"/bursts/{BURST_ID}", opened),
    "another answer, with the others": (
        f"/bursts/{BURST_ID}?edge=gauss_hermite&all=true&frequency=0.5&view=fleet",
        None,
    ),
    "retracted burst": (f"/bursts/{RETRACTED}", opened),
    "simulated burst": (f"/bursts/{SIMULATED}", None),
    "unknown burst": ("/bursts/T3-19990101-0000", None),
    "days": ("/days?from=2012-06-01&to=2012-06-30", opened),
    "days with a fault": ("/days?from=x", None),
    "day": ("/days/2012-06-07", opened),
    "quiet day": ("/days/2012-06-08", None),
    "planning": ("/planning?day=2013-05-13", opened),
    "planning without a map": ("/planning?day=2016-05-13&observatory=WIND&observatory=STB", None),
    "planning with a fault": ("/planning?day=x", None),
    "submit": ("/submit", None),
    "submit with faults": ("/submit", lambda page: checked(page, TABLE.format("minus one"))),
    "submit with a map": ("/submit", lambda page: page.get_by_role("button", name="Check").click()),
    "guide": ("/guide", opened),
    "API": ("/api/v1/docs", opened),
    "status": ("/status", opened),
}


@pytest.mark.parametrize("name", STATES)
def test_no_rule_is_broken(page: Page, name: str) -> None:
    address, act = STATES[name]
    page.goto(address)
    if act:
        act(page)
    assert violations(page) == []


def test_no_rule_is_broken_on_an_empty_catalogue(page: Page, empty: str) -> None:
    page.goto(empty)
    assert page.locator("#empty-catalogue").is_visible()
    assert violations(page) == []


def test_axe_finds_what_is_wrong(page: Page) -> None:
    page.goto("/guide")
    page.evaluate("document.querySelector('nav').innerHTML += '<a href=\"/x\"></a>'")
    page.evaluate("document.querySelector('main p').style.color = 'rgb(110, 110, 110)'")
    found = violations(page)
    assert any(one.startswith("light: link-name") for one in found)
    assert any(one.startswith("dark: color-contrast") for one in found)
