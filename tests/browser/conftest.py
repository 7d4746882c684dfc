"""A real server, a real Chromium, and a watch over what the pages ask for and complain about."""

import shutil
from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, expect, sync_playwright

from bella.catalogue import Catalogue, SearchedDay
from bella.pipeline.draw import draw_day
from bella.plotting import shared_profile_figure, write_whole
from bella.settings import COLLAPSED_FIGURE, Settings
from tests.api.published import ONSET, publish_event, publish_many, served, settings_of
from tests.catalogue.test_detections import received
from tests.plotting.synthetic import (
    BURST_ID,
    FREQUENCIES_MHZ,
    synthetic_samples,
    synthetic_spectra,
)

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
ARTIFACTS = Path(__file__).parents[2] / "test-artifacts"
SHOWN_S = 60.0
"""A loaded machine still shows within this time what a page has: what is not there fails with its name."""

LOADED_S = 300.0
"""The same for a page itself, whose server shares the machine."""

expect.set_options(timeout=1000 * SHOWN_S)
FLAGS = ["--no-sandbox", "--disable-gpu", "--disable-background-networking"]


@dataclass
class Watch:
    """A page with everything it asked for and complained about."""

    page: Page
    address: str
    requests: list[str] = field(default_factory=list)
    complaints: list[str] = field(default_factory=list)

    def open(self, path: str) -> Page:
        """Load a page."""
        self.page.goto(self.address + path)
        return self.page

    def photograph(self, name: str, **more: Any) -> Path:
        """Keep a picture of the page as it is."""
        ARTIFACTS.mkdir(exist_ok=True)
        path = ARTIFACTS / f"{name}.png"
        self.page.screenshot(path=path, **more)
        return path


@pytest.fixture(scope="session")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A service over nine bursts, the first one with both tracks at all its frequencies."""
    settings = settings_of(tmp_path_factory.mktemp("browser"))
    with Catalogue.open(settings.catalogue_url, create=True) as catalogue:
        for solution in publish_event(settings, catalogue, FREQUENCIES_MHZ):
            kept = settings.solution_figure(solution.burst_id, solution.solution_id, COLLAPSED_FIGURE)
            write_whole(kept, shared_profile_figure(synthetic_samples()))
        publish_many(settings, catalogue, 8)
        search_days(settings, catalogue)
    with served(settings) as base:
        yield base


def search_days(settings: Settings, catalogue: Catalogue) -> None:
    """Record the day of the first burst, with its figure, and two quiet days beside it."""
    names, until = ("WIND", "STEREO-A", "STEREO-B"), ONSET + timedelta(minutes=30)
    lone = {
        "tier": "catalogued",
        "reason": "not localisable: received by 1 of 3 spacecraft",
        "burst_id": "T3-20120607-0700",
    }
    found = [
        *(received(0, name, start_utc=ONSET, end_utc=until, burst_id=BURST_ID) for name in names),
        received(0, start_utc=ONSET.replace(hour=7), end_utc=until.replace(hour=7), **lone),
        received(0, start_utc=ONSET.replace(hour=20), end_utc=until.replace(hour=20), tier="rejected", burst_id=""),
    ]
    for offset in (-1, 0, 1):
        day = SearchedDay(ONSET.date() + timedelta(days=offset), "a" * 64, "0.2.0", names)
        catalogue.record_day(day, [] if offset else found)
    spectra = [one.to_dataset() for one in synthetic_spectra().children.values()]
    assert draw_day(ONSET.date(), spectra, found, settings)


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """Chromium of the system; none is downloaded."""
    if CHROMIUM is None:
        pytest.skip("no Chromium found: install the package chromium to run the browser tests")
    with sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield running
        running.close()


@pytest.fixture
def watch(browser: Browser, address: str, request: pytest.FixtureRequest) -> Iterator[Watch]:
    """A fresh page; when the test is over it must have asked the loopback only, and complained of nothing."""
    context = browser.new_context(**{"viewport": {"width": 1280, "height": 800}, **getattr(request, "param", {})})
    seen = Watch(context.new_page(), address)
    seen.page.set_default_timeout(1000 * SHOWN_S)
    seen.page.set_default_navigation_timeout(1000 * LOADED_S)
    seen.page.on("request", lambda asked: seen.requests.append(asked.url))
    seen.page.on("console", lambda note: note.type in {"error", "warning"} and seen.complaints.append(note.text))
    seen.page.on("pageerror", lambda error: seen.complaints.append(str(error)))
    yield seen
    context.close()
    assert seen.requests
    assert [url for url in seen.requests if not url.startswith((address, "data:", "blob:"))] == []
    assert seen.complaints == []


@pytest.fixture
def burst_path() -> str:
    """Path of the burst page."""
    return f"/bursts/{BURST_ID}"
