"""Windows of each kind, at the Sun, up to their ends and not beyond."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta

import pytest

from bella.linked_events import Event, links_of
from bella.linked_events.events import EventKind, at_sun

BURST = datetime(2012, 6, 7, 19, 30, tzinfo=UTC)
MINUTE = timedelta(minutes=1)


def event(kind: EventKind, minutes: float, rise: float | None = None) -> Event:
    """An event that begins so many minutes after the burst, at the Sun; at the observer 8 minutes later."""
    begun = BURST + minutes * MINUTE
    start = begun + 8 * MINUTE
    peak = None if rise is None else start + rise * MINUTE
    return Event(f"x:{kind}{minutes}", kind, "x", f"{minutes}", "EARTH", start, begun, peak)


@pytest.mark.parametrize(
    ("kind", "inside", "outside", "rise"),
    [
        ("flare", [5, 0, -30], [5.1, -30.1], 20),
        ("flare", [5, -25], [-25.1], None),
        ("cme", [-10, 0, 90], [-10.1, 90.1], None),
        ("particles", [0, 180], [-0.1, 180.1], None),
        ("radio", [-5, 5], [-5.1, 5.1], None),
    ],
)
def test_windows(kind: EventKind, inside: list[float], outside: list[float], rise: float | None) -> None:
    found = links_of(BURST, [event(kind, minutes, rise) for minutes in [*inside, *outside]])
    assert sorted(link.delay_s for link in found) == sorted(60.0 * minutes for minutes in inside)


def test_the_nearest_comes_first() -> None:
    found = links_of(BURST, [event("cme", 30), event("flare", -2, 5), event("particles", 12)])
    assert [link.event.kind for link in found] == ["flare", "particles", "cme"]
    assert [link.delay_s for link in found] == [-120.0, 720.0, 1800.0]


def test_a_radio_burst_belongs_to_the_nearest_burst_alone() -> None:
    theirs, flare = event("radio", 3), event("flare", 3)
    assert links_of(BURST, [theirs, flare], [BURST + 5 * MINUTE]) == links_of(BURST, [flare])
    assert len(links_of(BURST, [theirs], [BURST + 7 * MINUTE])) == 1


def test_light_travel_is_taken_off_by_where_the_observer_was() -> None:
    moment = datetime(2021, 11, 20, 12, tzinfo=UTC)
    assert (moment - at_sun(moment, "EARTH")).total_seconds() == pytest.approx(0.988 * 499.005, abs=1.0)
    psp = (moment - at_sun(moment, "PSP")).total_seconds()
    assert 40 < psp < 60  # PSP passed its perihelion at 0.062 au the day after
    assert (moment - at_sun(moment, "MARS")).total_seconds() == 499.005
    assert (moment - at_sun(replace_year(moment, 1991), "STEREO-A")).total_seconds() > 9e8


def replace_year(moment: datetime, year: int) -> datetime:
    return moment.replace(year=year)


def test_the_records_are_frozen() -> None:
    one = event("flare", 0)
    assert replace(one, size="X1") != one
