"""Which burst of the catalogue a burst of a day is, the nearest and only one; and the figure of a day."""

from contextlib import closing
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pandas as pd
import pytest

from bella.catalogue import Catalogue
from bella.pipeline.day import _searched, known_burst_ids, known_bursts
from bella.pipeline.draw import detection_frame, draw_day, redraw_day
from bella.settings import Settings
from tests.catalogue.examples import publication
from tests.catalogue.test_detections import received as detection
from tests.pipeline.examples import files_of
from tests.plotting.test_days import DAY, green
from tests.plotting.test_days import day as spectrum


def received(name: str, start: pd.Timestamp) -> Any:
    return SimpleNamespace(burst_id=name, start_utc=start)


def test_a_burst_keeps_its_name_and_lends_it_to_no_other(tmp_path: Path) -> None:
    known = publication()
    onset = pd.Timestamp(known.burst.start_utc).tz_localize(None)
    with closing(Catalogue.open(f"sqlite:///{tmp_path / 'catalogue.sqlite'}", create=True)) as catalogue:
        catalogue.publish(known)
        near, nearer = received("near", onset + timedelta(minutes=6)), received("nearer", onset - timedelta(minutes=2))
        far = received("far", onset + timedelta(hours=2))

        names = known_burst_ids(known_bursts(catalogue, onset.date(), onset.date()), [near, nearer, far])

    assert names == {"near": "near", "nearer": known.burst.burst_id, "far": "far"}


def test_over_midnight_only_the_same_minute_is_the_same_burst() -> None:
    midnight = datetime(2021, 2, 2, tzinfo=UTC)
    before = [
        ("T3-20210201-2358", midnight - timedelta(minutes=1.5)),
        ("T3-20210201-2353", midnight - timedelta(minutes=7)),
    ]

    def named(minutes: float) -> str:
        burst = received("own", pd.Timestamp(midnight).tz_localize(None) + timedelta(minutes=minutes))
        return known_burst_ids(before, [burst])["own"]

    assert named(0.3) == "T3-20210201-2358"
    assert named(1.0) == "own"
    assert named(-4.0) == "T3-20210201-2358"
    assert named(-16.0) == "T3-20210201-2353"
    assert named(-18.0) == "own"


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    return Settings(home=tmp_path / "home")


def test_a_day_is_drawn_with_what_the_catalogue_has_of_it(settings: Settings) -> None:
    onset = datetime(2022, 3, 1, 1, tzinfo=UTC)
    times = {"start_utc": onset, "peak_utc": onset, "end_utc": onset + timedelta(minutes=20)}

    assert draw_day(DAY, [spectrum()], [], settings)
    quiet = green(settings.day_figure(DAY))
    assert draw_day(DAY, [spectrum()], [detection(1, "SOLO", **times)], settings)

    assert settings.day_figure(DAY) == settings.home / "figures" / "days" / "2022-03-01.svg"
    assert green(settings.day_figure(DAY)) > quiet == 0.0


def test_a_figure_that_fails_ends_nothing_and_leaves_no_older_one(settings: Settings) -> None:
    assert draw_day(DAY, [spectrum()], [], settings)

    assert not draw_day(DAY, [spectrum(quantity="counts")], [], settings)

    assert list(settings.day_figure(DAY).parent.iterdir()) == []


def test_a_folder_that_cannot_be_made_ends_nothing(settings: Settings) -> None:
    settings.home.mkdir()
    settings.figures_root.write_text("in the way")

    assert not draw_day(DAY, [spectrum()], [], settings)


def test_files_that_have_gone_end_nothing(settings: Settings, tmp_path: Path) -> None:
    (tmp_path / "gone.cdf").touch()
    gone = files_of(DAY, [tmp_path / "gone.cdf"])
    (tmp_path / "gone.cdf").unlink()
    assert not redraw_day(gone, [], settings)


def test_a_detection_table_has_utc_without_a_zone_also_when_empty() -> None:
    for found in ([], [detection(3)]):
        table = detection_frame(found)
        assert {str(table[name].dtype) for name in ("start_utc", "peak_utc", "end_utc")} == {"datetime64[ns]"}
    assert table["start_utc"][0] == pd.Timestamp("2020-07-21 03:00")


def test_a_spectrum_of_an_unknown_kind_is_named_and_costs_the_day_no_other() -> None:
    found, reasons = _searched({"SOLO": spectrum(), "WIND": spectrum(quantity="counts")})
    assert [one.observatory for one in found] == ["SOLO"]
    (reason,) = (one for one in reasons if one.startswith("WIND: "))
    assert "counts" in reason
