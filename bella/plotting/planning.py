"""How well a fleet would locate a source, in each direction and at each distance, SVG."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from bella.plotting.ecliptic import SIZE, Map, bodies, rings, spokes
from bella.plotting.svg import element, figure, path, words
from bella.spacecraft import position
from bella.units import AU_RSUN, FloatArray

SHARES = (0.1, 0.25, 0.5, 1.0)
"""Of the distance of a source, as radius of its 68 % region: bounds of the shades."""

SWATCH, PITCH, LEGEND_WIDTH = 13.0, 20.0, 196.0


def planning_figure(
    utc: np.datetime64,
    receivers: Mapping[str, FloatArray],
    longitudes_deg: Sequence[float],
    radii_rsun: Mapping[float, Sequence[float | None]],
    marked: tuple[str, float] | None = None,
) -> str:
    """Map of the ecliptic, shaded by the size of the 68 % region that a source would have there.

    Parameters
    ----------
    utc : numpy.datetime64
        Of Earth.
    receivers : mapping of str to ndarray, shape (3,)
        HEE, solar radii.
    longitudes_deg : sequence of float
        HEE, evenly spaced.
    radii_rsun : mapping of float to sequence of float or None
        Radius of the region in each direction, by distance in solar radii; empty where nothing can be located.
    marked : (str, float), optional
        Name and radius of a circle that stands out.

    Returns
    -------
    str
    """
    earth = position("EARTH", utc)[0]
    farthest = max([float(np.abs(one[:2]).max()) for one in receivers.values()] + [AU_RSUN])
    chart = Map((0.0, 0.0), SIZE[1] / (2.2 * farthest))
    sun = chart(np.zeros((1, 2)))[0]
    return figure(
        "planning",
        SIZE,
        "Map of the inner heliosphere, shaded by how well a source would be located.",
        element("rect", x=0, y=0, width=SIZE[0], height=SIZE[1], class_="sky"),
        *_cells(chart, longitudes_deg, radii_rsun),
        *rings(chart),
        *spokes(chart, "hee", utc),
        *(_circle(chart, *marked) if marked and radii_rsun else ()),
        element("circle", cx=sun[0], cy=sun[1], r=7, class_="sun"),
        *bodies(chart, receivers, earth),
        *(_legend() if radii_rsun else ()),
    )


def _cells(
    chart: Map, longitudes_deg: Sequence[float], radii_rsun: Mapping[float, Sequence[float | None]]
) -> Iterator[str]:
    distances = sorted(radii_rsun)
    if not distances:
        return
    between = np.sqrt(np.array(distances[1:]) * np.array(distances[:-1]))
    bounds = np.concatenate([[0.5 * distances[0]], between, [distances[-1] * 1.15]])
    half = 0.5 * (longitudes_deg[1] - longitudes_deg[0])
    for index, distance in enumerate(distances):
        for longitude, radius in zip(longitudes_deg, radii_rsun[distance], strict=True):
            angle = np.radians(np.linspace(longitude - half, longitude + half, 5))
            way = np.column_stack([np.cos(angle), np.sin(angle)])
            outline = chart(np.vstack([way * bounds[index], way[::-1] * bounds[index + 1]]))
            said = element("title", _said(distance, longitude, radius))
            yield element("g", said, path(outline, closed=True, class_=f"cell share-{share_class(radius, distance)}"))


def _said(distance_rsun: float, longitude_deg: float, radius_rsun: float | None) -> str:
    side = "" if longitude_deg in {0.0, -180.0} else " W" if longitude_deg > 0 else " E"
    where = f"{distance_rsun:g} R\N{SUN}, {abs(longitude_deg):.0f}°{side}"
    if radius_rsun is None:
        return f"{where}: not known"
    percent = 100.0 * radius_rsun / distance_rsun
    return f"{where}: \N{PLUS-MINUS SIGN}{radius_rsun:.0f} R\N{SUN}, {percent:.0f} % of its distance"


def share_class(radius_rsun: float | None, distance_rsun: float) -> int:
    """Which of the shades a region has, 0 for the best; one more than the last for what is not located.

    Parameters
    ----------
    radius_rsun : float or None
    distance_rsun : float

    Returns
    -------
    int
    """
    if radius_rsun is None:
        return len(SHARES)
    return int(np.searchsorted(SHARES, radius_rsun / distance_rsun))


def _circle(chart: Map, name: str, radius_rsun: float) -> Iterator[str]:
    x, y = chart(np.zeros((1, 2)))[0]
    radius = radius_rsun * chart.per_rsun
    yield element("circle", cx=x, cy=y, r=radius, class_="marked-ring")
    yield words(name, x, y + radius + 13, class_="other-label", text_anchor="middle")


def _legend() -> Iterator[str]:
    said = [f"within {100 * share:.0f} %{'' if index else ' of its distance'}" for index, share in enumerate(SHARES)]
    top = SIZE[1] - PITCH * (len(said) + 1)
    yield element("rect", x=4, y=top - 6, width=LEGEND_WIDTH, height=SIZE[1] - top + 2, class_="sky under")
    for index, text in enumerate([*said, "not located"]):
        y = top + PITCH * index
        yield element("rect", x=10, y=y, width=SWATCH, height=SWATCH, class_=f"cell share-{index}")
        yield words(text, 10 + SWATCH + 6, y + 11, class_="legend")


def planning_caption(day: object, names: Sequence[str], sigma_s: float) -> str:
    """What the figure shows, for a file of its own."""
    return (
        f"How well {', '.join(names)} would locate a source of a Type III burst on {day}, with timing errors of "
        f"{sigma_s:g} s: radius of the 68 % region as a share of the distance from the Sun, by direction and distance "
        "in the ecliptic. From the exact posterior of noise-free arrival times at one frequency."
    )
