"""The ecliptic seen from north with the Earth to the right: grid, Earth and spacecraft below tracks and predictions.

HEE X to the right, HEE Y up, solar radii.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from bella.heliosphere import spiral_longitude_deg
from bella.plotting.svg import element, line, number, path, round_step, words
from bella.spacecraft import cartesian, hee_from
from bella.units import AU_RSUN, FloatArray

Frame = Literal["hee", "heeq", "carrington"]

SIZE = (620.0, 560.0)
SPOKE_STEP_DEG = 30
RINGS_AU = (0.25, 0.5, 0.75, 1.0)
NOMINAL_WIND_KM_S, NOMINAL_PERIOD_D = 400.0, 25.38
"""Of the spirals through the spacecraft: the usual slow wind, and the sidereal rotation of Carrington."""

SPIRAL_POINTS = 48
SCALE_ROOM = (215.0, 56.0)
"""Corner of the colours, with letters as large as on a phone."""

BORDER = 15.0
"""Room between the border of the map and the labels of the longitudes along it."""


@dataclass(frozen=True)
class Map:
    """The part of the ecliptic that is drawn, and where it is on the figure."""

    centre: tuple[float, float]
    per_rsun: float

    def __call__(self, points: FloatArray) -> FloatArray:
        """Places of HEE points of shape (N, 2 or 3) on the figure."""
        plane = np.atleast_2d(points)[:, :2] - self.centre
        return np.asarray(np.array(SIZE) / 2 + plane * (self.per_rsun, -self.per_rsun))

    def to_border(self, angle: float, inset: float = 0.0) -> tuple[FloatArray, bool]:
        """Where a ray from the Sun leaves the figure, and whether it crosses it at all; `angle` in radians."""
        start, way = self(np.zeros((1, 2)))[0], np.array([np.cos(angle), -np.sin(angle)])
        box = np.array([[inset, SIZE[0] - inset], [inset, SIZE[1] - inset]])
        with np.errstate(divide="ignore"):
            steps = (box - start[:, np.newaxis]) / way[:, np.newaxis]
        leave = float(np.min(np.max(steps, axis=1)))
        return start + leave * way, leave > 0


def rings(chart: Map) -> Iterator[str]:
    """Circles around the Sun: quarters of an au, or round numbers of solar radii where the view is smaller."""
    sun = chart(np.zeros((1, 2)))[0]
    corners = np.array([[x, y] for x in (0.0, SIZE[0]) for y in (0.0, SIZE[1])])
    reach = float(np.linalg.norm(corners - sun, axis=1).max()) / chart.per_rsun
    step = round_step(reach / 5.0)
    in_au = reach > 1.2 * AU_RSUN
    radii = [one * AU_RSUN for one in RINGS_AU] if in_au else [step * n for n in range(1, int(reach / step) + 1)]
    for radius in radii:
        is_au = in_au and radius == AU_RSUN
        yield element("circle", cx=sun[0], cy=sun[1], r=radius * chart.per_rsun, class_="ring au" if is_au else "ring")
        label = f"{radius / AU_RSUN:g} au" if in_au else f"{radius:g} R\N{SUN}"
        x, y = chart(np.array([[radius * np.cos(np.radians(75.0)), radius * np.sin(np.radians(75.0))]]))[0]
        if 12 < y < SIZE[1] - 4 and 20 < x < SIZE[0] - 20:
            yield words(label, x, y + 4, class_="grid-label")


def spokes(chart: Map, frame: Frame, utc: np.datetime64) -> Iterator[str]:
    """Rays of round longitudes of a frame, each with its longitude where it leaves the map."""
    sun = chart(np.zeros((1, 2)))[0]
    for longitude in range(0, 360, SPOKE_STEP_DEG):
        x, y, _ = hee_from(frame, cartesian(1.0, longitude, 0.0), utc)[0]
        angle = float(np.arctan2(y, x))
        end, is_seen = chart.to_border(angle)
        if not is_seen:
            continue
        yield line(sun[0], sun[1], end[0], end[1], class_="spoke")
        place, _ = chart.to_border(angle, BORDER)
        is_free = place[0] > SCALE_ROOM[0] or place[1] < SIZE[1] - SCALE_ROOM[1]
        if is_free and np.linalg.norm(place - sun) > 60:
            anchor = "start" if place[0] < 40 else "end" if place[0] > SIZE[0] - 40 else "middle"
            aside = {"start": -9.0, "end": 9.0, "middle": 0.0}[anchor]
            said = _written(longitude, frame)
            yield words(said, place[0] + aside, place[1] + 4, class_="spoke-label", text_anchor=anchor)


def _written(longitude_deg: int, frame: Frame) -> str:
    if frame == "carrington" or longitude_deg in {0, 180}:
        return f"{longitude_deg}°"
    return f"{longitude_deg}°W" if longitude_deg < 180 else f"{360 - longitude_deg}°E"


def nominal_spirals(chart: Map, receivers: Mapping[str, FloatArray]) -> Iterator[str]:
    """Spirals of the usual slow wind from the Sun to each spacecraft."""
    for name, where in receivers.items():
        reach = float(np.hypot(*where[:2]))
        distance = np.linspace(1.0, reach, SPIRAL_POINTS)
        turned = spiral_longitude_deg(distance, 0.0, NOMINAL_WIND_KM_S, NOMINAL_PERIOD_D)
        longitude = np.radians(turned - turned[-1]) + np.arctan2(where[1], where[0])
        points = np.column_stack([distance * np.cos(longitude), distance * np.sin(longitude)])
        yield path(chart(points), class_="nominal", data_name=name)


def bodies(chart: Map, receivers: Mapping[str, FloatArray], earth: FloatArray) -> Iterator[str]:
    """Earth and spacecraft; those outside the map as an arrow at its border."""
    near_earth = [name for name, where in receivers.items() if float(np.linalg.norm(where - earth)) < 4.0]
    named = {name: where for name, where in receivers.items() if name not in near_earth}
    taken: list[FloatArray] = []
    for name, where in [("Earth" + "".join(f", {one}" for one in near_earth), earth), *named.items()]:
        kind = "earth" if where is earth else "craft"
        x, y = place = chart(where[np.newaxis])[0]
        angle = float(np.arctan2(where[1], where[0]))
        if 8 < x < SIZE[0] - 8 and 8 < y < SIZE[1] - 8:
            yield _marker(kind, x, y)
            side = -1.0 if x > SIZE[0] - 100 else 1.0
            below = any(np.linalg.norm(place - one) < 40 for one in taken)
            anchor = "end" if side < 0 else "start"
            yield words(name, x + side * 10, y + (16 if below else -7), class_="craft-label", text_anchor=anchor)
            taken.append(place)
            continue
        end, is_seen = chart.to_border(angle, 34.0)
        if is_seen:
            x, y = float(end[0]), float(end[1])
            yield _triangle(x, y, f"away {kind}", f"rotate({90 - np.degrees(angle):.0f} {number(x)} {number(y)})")
            anchor = "end" if x > SIZE[0] - 120 else "start" if x < 120 else "middle"
            aside = {"end": -9, "start": 9, "middle": 0}[anchor]
            yield words(name, x + aside, y + (18 if y < 60 else -8), class_="craft-label", text_anchor=anchor)


def _marker(kind: str, x: float, y: float) -> str:
    if kind == "earth":
        return element("circle", cx=x, cy=y, r=5.5, class_="earth")
    return _triangle(x, y, "craft")


def _triangle(x: float, y: float, kind: str, transform: str | None = None) -> str:
    return path(np.array([[x, y - 6], [x + 6, y + 5], [x - 6, y + 5]]), closed=True, class_=kind, transform=transform)
