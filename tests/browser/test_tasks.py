"""Five things that a visitor comes for, each done in a browser by what the pages say."""

import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Route, expect

from bella.catalogue import Catalogue
from bella.pipeline.run import Run, process_submissions
from bella.pipeline.workers import Workers
from bella.settings import Settings
from tests.api.published import publish_event, published, served, settings_of, synthetic_burst
from tests.browser.conftest import Watch
from tests.plotting.synthetic import BURST_ID, synthetic_posterior

RECENT = datetime.now(UTC).replace(microsecond=0) - timedelta(days=3)
RECENT_ID = f"T3-{RECENT:%Y%m%d-%H%M}"
TABLE = Path(__file__).parents[2] / "docs" / "examples" / "arrivals.csv"


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Settings:
    """An old burst, and one of this week."""
    settings = settings_of(tmp_path_factory.mktemp("tasks"), draws=200)
    with Catalogue.open(settings.catalogue_url, create=True) as catalogue:
        publish_event(settings, catalogue)
        recent = synthetic_burst(burst_id=RECENT_ID)
        published(settings, catalogue, burst=replace(recent, start_utc=RECENT, end_utc=RECENT + timedelta(minutes=30)))
    return settings


@pytest.fixture(scope="module")
def address(home: Settings) -> Iterator[str]:
    """The service over it."""
    with served(home) as base:
        yield base


def test_find_the_bursts_of_last_week(watch: Watch) -> None:
    page = watch.open("/")
    expect(page.locator("table.bursts tbody tr")).to_have_count(2)
    page.get_by_role("link", name="Last 7 days").click()
    expect(page.locator("table.bursts tbody tr")).to_have_count(1)
    expect(page.locator("table.bursts tbody")).to_contain_text(RECENT_ID)
    watch.photograph("task-last-week")


def test_say_where_a_burst_was_and_how_sure(watch: Watch) -> None:
    page = watch.open("/?stop=2013-01-01")
    page.get_by_role("link", name=BURST_ID).click()
    expect(page.locator("#answer")).to_contain_text("13° W (9 to 17), 13 to 152 R☉")
    expect(page.locator("#answer .grade")).to_contain_text("A")
    page.get_by_role("link", name="how sure?").click()
    expect(page.locator("#calibration")).to_be_in_viewport()
    expect(page.locator("#calibration")).to_contain_text("how often its intervals hold")
    watch.photograph("task-how-sure")


def test_get_its_posterior_into_python(watch: Watch) -> None:
    page = watch.open(f"/bursts/{BURST_ID}")
    code = page.locator("#in-python").inner_text()
    watch.photograph("task-python", full_page=True)
    told = f"{code}\nprint(posterior.sizes['draw'], *posterior['x_rsun'].values)"
    done = subprocess.run([sys.executable, "-c", told], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    draws, *x_rsun = done.stdout.split()
    assert int(draws) > 0
    known = synthetic_posterior("half_maximum")["x_rsun"].to_numpy()
    assert np.isin(np.round(np.array(x_rsun, dtype=float), 3), np.round(known, 3)).all()


def test_see_whether_a_day_could_have_been_located(watch: Watch) -> None:
    page = watch.open("/")
    page.get_by_role("navigation", name="Site").get_by_role("link", name="Planning").click()
    page.get_by_label("Day (UTC)").fill("2013-05-13")
    page.get_by_role("button", name="Show the map").click()
    expect(page.locator("#verdict-title")).to_have_text("Yes, from 50 R☉ outwards")
    expect(page.locator("#map-title")).to_contain_text("WIND, STEREO-A, STEREO-B")
    assert "day=2013-05-13" in page.url
    watch.photograph("task-planning", full_page=True)


def test_localise_a_table(watch: Watch, home: Settings) -> None:
    with Catalogue.open(home.catalogue_url) as catalogue:
        _, secret = catalogue.create_token("visitor")
    page = watch.open("/")
    page.get_by_role("navigation", name="Site").get_by_role("link", name="Submit").click()
    page.locator("#file").set_input_files(TABLE)
    expect(page.locator("#next-title")).to_have_text("Nothing is wrong with this table")
    watch.photograph("task-submit", full_page=True)
    page.get_by_label("Token").fill(secret)
    page.get_by_role("button", name="Submit", exact=True).click()
    expect(page.get_by_role("heading", level=1)).to_contain_text("Submission S-")
    expect(page.locator("main")).to_contain_text("the next scheduled run localises it")
    assert process_submissions(Run(home, "visitor", Workers(1, home))) == 1
    page.reload()
    page.get_by_role("link", name="Its burst").click()
    expect(page.locator("#submitted")).to_be_visible()
    expect(page.locator("#answer")).to_contain_text("R☉")
    expect(page.locator("svg.constellation .dots circle").first).to_be_visible()
    watch.photograph("task-localised", full_page=True)


def test_a_file_chosen_before_the_script_came_is_checked_too(watch: Watch) -> None:
    held: list[Route] = []

    def hold(route: Route) -> None:
        held.append(route)

    watch.page.route("**/submit.js*", hold)
    watch.page.goto(f"{watch.address}/submit", wait_until="commit")
    watch.page.locator("#file").set_input_files(TABLE)
    assert held, "the script has not been asked for"
    held[0].continue_()
    expect(watch.page.locator("#next-title")).to_have_text("Nothing is wrong with this table")
