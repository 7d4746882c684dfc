"""Bursts of a selection against time, and what the time axis says."""

from datetime import UTC, datetime, timedelta

import pytest

from bella.plotting import Marked, selection_figure
from bella.plotting.svg import Scale
from bella.plotting.timeline import time_labels
from tests.plotting.reading import SVG, of_class, parsed

START = datetime(2012, 6, 7, 19, 29, tzinfo=UTC)


def test_west_is_up_and_later_is_right_and_each_burst_leads_to_its_page() -> None:
    bursts = [
        Marked(START, 60.0, 50.0, 70.0, "A", "one", "/bursts/one"),
        Marked(START + timedelta(days=1), -60.0, -80.0, -40.0, "D", "two", "/bursts/two"),
        Marked(START + timedelta(days=2), None, None, None, "D", "three", "/bursts/three"),
    ]
    root = parsed(selection_figure(bursts))
    links = root.findall(f"{SVG}a")
    assert [one.get("href") for one in links] == ["/bursts/one", "/bursts/two", "/bursts/three"]
    circles = [one.find(f"{SVG}circle") for one in links]
    assert [float(one.get("cx")) for one in circles] == sorted(float(one.get("cx")) for one in circles)
    west, east, unknown = (float(one.get("cy")) for one in circles)
    assert west < east < unknown
    (interval,) = links[0].findall(f"{SVG}line")
    assert float(interval.get("y2")) < west < float(interval.get("y1"))
    assert len(of_class(root, "grade-A")) == 1


def test_an_interval_across_the_far_side_has_two_parts() -> None:
    root = parsed(selection_figure([Marked(START, 175.0, 165.0, 190.0, "B", "far", "/x")]))
    assert len(root.find(f"{SVG}a").findall(f"{SVG}line")) == 2


@pytest.mark.parametrize(("days", "first"), [(0.5, "20:00"), (10, "08 Jun"), (200, "Jul 2012"), (4000, "2013")])
def test_a_time_axis_says_hours_days_months_or_years(days: float, first: str) -> None:
    scale = Scale(START.timestamp(), (START + timedelta(days=days)).timestamp(), 0.0, 1000.0)
    labels = time_labels(scale)
    assert labels[0][1] == first
    assert 3 <= len(labels) <= 20
    assert all(scale.holds(moment) for moment, _ in labels)
