"""Bursts of a selection: against time, around the Sun, and what the time axis says."""

import re
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from bella.plotting import (
    Estimate,
    Marked,
    footpoint_figure,
    longitude_figure,
    selection_caption,
    wind_figure,
)
from bella.plotting.selection import MOST_LINKED, time_labels
from bella.plotting.svg import Scale
from tests.plotting.reading import SVG, of_class, parsed, points, texts

START = datetime(2012, 6, 7, 19, 29, tzinfo=UTC)


def burst(day: float, longitude: float | None, *, wind: float | None = None, grade: str = "B") -> Marked:
    where = None if longitude is None else Estimate(longitude, longitude - 10.0, longitude + 10.0)
    blows = None if wind is None else Estimate(wind, wind - 50.0, wind + 60.0)
    return Marked(START + timedelta(days=day), where, blows, grade, f"said {day}", f"/bursts/{day}")


def test_west_is_up_and_later_is_right_and_each_burst_leads_to_its_page() -> None:
    root = parsed(longitude_figure([burst(0, 60.0, grade="A"), burst(1, -60.0, grade="D"), burst(2, None)]))
    links = root.findall(f"{SVG}a")
    assert [one.get("href") for one in links] == ["/bursts/0", "/bursts/1", "/bursts/2"]
    circles = [one.find(f"{SVG}circle") for one in links]
    assert [float(one.get("cx")) for one in circles] == sorted(float(one.get("cx")) for one in circles)
    west, east, unknown = (float(one.get("cy")) for one in circles)
    assert west < east < unknown
    labels = {one.text: float(one.get("y")) - 4 for one in of_class(root, "tick")}
    assert west == pytest.approx(labels["0°"] + (labels["90°W"] - labels["0°"]) * 60 / 90, abs=0.2)
    (interval,) = links[0].findall(f"{SVG}line")
    assert float(interval.get("y2")) < west < float(interval.get("y1"))
    assert len(of_class(root, "grade-A")) == 1


def test_an_interval_across_the_far_side_has_two_parts() -> None:
    for longitude in (175.0, -175.0, 185.0):
        (link,) = parsed(longitude_figure([burst(0, longitude)])).findall(f"{SVG}a")
        ends = [sorted((float(one.get("y1")), float(one.get("y2")))) for one in link.findall(f"{SVG}line")]
        assert len(ends) == 2
        height = float(link.find(f"{SVG}circle").get("cy"))
        assert any(low <= height <= high for low, high in ends)


def test_faster_wind_is_higher_and_what_was_not_measured_stands_below() -> None:
    root = parsed(wind_figure([burst(0, 10.0, wind=700.0), burst(1, 10.0, wind=350.0), burst(2, 10.0)]))
    fast, slow, none = (float(one.find(f"{SVG}circle").get("cy")) for one in root.findall(f"{SVG}a"))
    assert fast < slow < none
    assert len(of_class(root, "open")) == 1
    labels = {one.text: float(one.get("y")) - 4 for one in of_class(root, "tick")}
    share = (slow - labels["200"]) / (labels["400"] - labels["200"])
    assert 200 + 200 * share == pytest.approx(350.0, abs=2.0)


def test_a_thousand_bursts_are_all_there_and_stay_small() -> None:
    rng = np.random.default_rng(1)
    many = [
        burst(n / 10, float(one), wind=400.0 + one, grade="ABCD"[n % 4])
        for n, one in enumerate(rng.normal(0, 60, 1000))
    ]
    for draw in (longitude_figure, wind_figure):
        drawn = draw(many)
        assert len(drawn) < 60_000
        marks = list(of_class(parsed(drawn), "points"))
        assert sum(one.get("d").count("h0") for one in marks) == 1000
        assert "<a " not in drawn
    few = parsed(longitude_figure(many[:MOST_LINKED]))
    assert len(few.findall(f"{SVG}a")) == MOST_LINKED
    one_by_one = [(float(one.get("cx")), float(one.get("cy"))) for one in few.iter(f"{SVG}circle")]
    (kind,) = of_class(parsed(longitude_figure(many)), "points grade-A")
    together = re.findall(r"M([\d.]+) ([\d.]+)h0", kind.get("d"))
    assert len(together) == 250
    assert float(together[5][1]) == pytest.approx(one_by_one[20][1], abs=0.1)


def test_bars_stand_in_the_direction_of_their_bursts_and_lead_to_them() -> None:
    found = [burst(0, 35.0), burst(1, 38.0, grade="C"), burst(2, 392.0), burst(3, -95.0), burst(4, None)]
    root = parsed(footpoint_figure(found, "/?grade=B"))
    links = root.findall(f"{SVG}a")
    assert [one.get("href") for one in links] == [
        "/?grade=B&longitude_min=-100&longitude_max=-90",
        "/?grade=B&longitude_min=30&longitude_max=40",
    ]
    assert [one.find(f"{SVG}title").text for one in links] == ["100° E to 90° E: 1 burst", "30° W to 40° W: 3 bursts"]
    best, other = links[1].findall(f"{SVG}path")
    assert ("grade-B" in best.get("class"), "grade-C" in other.get("class")) == (True, True)
    reach = []
    for link, longitude in zip(links, (-95.0, 35.0), strict=True):
        outline = np.vstack([points(one) for one in link.findall(f"{SVG}path")]) - 180.0
        middle = outline.mean(axis=0)
        assert np.degrees(np.arctan2(-middle[1], middle[0])) == pytest.approx(longitude, abs=0.5)
        reach.append(np.hypot(*outline.T).max() - 44.0)
    assert reach[0] == pytest.approx(reach[1] / 3, rel=0.02)
    assert texts(root, "on-sun") == ["4"]
    assert "href" not in footpoint_figure(found)


def test_captions_say_how_many_are_drawn() -> None:
    assert "1000 of 5231 bursts" in selection_caption("wind", 1000, 5231)
    assert "12 bursts." in selection_caption("footpoints", 12, 12)


@pytest.mark.parametrize(("days", "first"), [(0.5, "20:00"), (10, "08 Jun"), (200, "Jul 2012"), (4000, "2013")])
def test_a_time_axis_says_hours_days_months_or_years(days: float, first: str) -> None:
    scale = Scale(START.timestamp(), (START + timedelta(days=days)).timestamp(), 0.0, 1000.0)
    labels = time_labels(scale)
    assert labels[0][1] == first
    assert 3 <= len(labels) <= 20
    assert all(scale.holds(moment) for moment, _ in labels)
