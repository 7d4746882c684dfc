"""The pen of all figures: elements of SVG, scales with their ticks, pictures of spectra, colours and names of edges.

Figures need no script, and take their colours from `figure.css`: light and dark on a page, and the same in a file that
is kept. An edge has a colour that stays apart from the others under the common forms of colour blindness.
"""

import base64
import io
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from html import escape
from importlib import resources

import numpy as np
import numpy.typing as npt

from bella.units import DAY_S, FloatArray

VIRIDIS = ("#440154", "#482878", "#3e4989", "#31688e", "#26828e", "#1f9e89", "#35b779", "#6ece58", "#b5de2b", "#fde725")
INTENSITY = ("#12161d", "#3d454f", "#9a9a94", "#fbf5e4")
"""Dark to ivory without a hue of its own, so that the coloured edges stand out on it."""

BRIGHTNESS = ("#10131c", "#3b2f6b", "#a8446a", "#f0964a", "#fdf4c9")
"""Dark to ivory through violet and orange, lightness rising evenly: for spectra on which nothing else is drawn."""

FREQUENCY_TICKS_MHZ = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0)
EDGE_NAMES = {
    "gauss_hermite": "Gauss-Hermite edge",
    "half_maximum": "Half-maximum edge",
    "half_rise": "Half-rise edge",
    "shared_profile": "Shared-profile edge",
}
NAMESPACE = "http://www.w3.org/2000/svg"
TIME_STEPS_S = (1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 10800, 21600, 43200, 86400)
WEAK_STRETCH = 0.75
"""Of pictures of spectra: weak bursts stand out from the quiet sky."""


@cache
def figure_style() -> str:
    """Style sheet of the figures, for pages and for files that are kept."""
    return (resources.files("bella.plotting") / "figure.css").read_text(encoding="utf-8")


def edge_name(edge: str) -> str:
    """Name of an edge definition as a reader sees it."""
    return EDGE_NAMES.get(edge, edge.replace("_", " "))


def edge_class(edge: str) -> str:
    """Class of an edge definition, or of its name, in `figure.css`."""
    known = {name: name for name in EDGE_NAMES} | {said: name for name, said in EDGE_NAMES.items()}
    return f"edge-{known.get(edge, 'another')}"


def number(value: float) -> str:
    """Coordinate with one decimal, no longer than it must be."""
    written = f"{value:.1f}".removesuffix(".0")
    return "0" if written == "-0" else written


def element(name: str, *content: str, **attributes: float | str | None) -> str:
    """One element; underscores in names of attributes stand for hyphens, and those that are None are left out."""
    written = "".join(
        f' {key.strip("_").replace("_", "-")}="{number(value) if isinstance(value, int | float) else escape(value)}"'
        for key, value in attributes.items()
        if value is not None
    )
    inside = "".join(content)
    return f"<{name}{written}>{inside}</{name}>" if inside else f"<{name}{written}/>"


def words(text: str, x: float, y: float, **attributes: float | str | None) -> str:
    """Text at a place."""
    return element("text", escape(text), x=x, y=y, **attributes)


def line(x1: float, y1: float, x2: float, y2: float, **attributes: float | str | None) -> str:
    """Straight line."""
    return element("line", x1=x1, y1=y1, x2=x2, y2=y2, **attributes)


def path(points: FloatArray, *, closed: bool = False, **attributes: float | str | None) -> str:
    """Path through points of shape (N, 2); a row that is not finite lifts the pen."""
    return element("path", d=path_data(points, closed=closed), **attributes)


def path_data(points: FloatArray, *, closed: bool = False) -> str:
    """What a path draws, as its attribute `d` says it."""
    parts: list[str] = []
    lifted = True
    for x, y in points:
        if not (math.isfinite(x) and math.isfinite(y)):
            lifted = True
            continue
        parts.append(f"{'M' if lifted else 'L'}{number(x)} {number(y)}")
        lifted = False
    return "".join(parts) + ("Z" if closed and parts else "")


def marks(places: FloatArray, index: int) -> Iterator[str]:
    """Markers at places of shape (N, 2), another one for each index, so that colour is never the only difference."""
    sides, turn = ((0, 0.0), (4, np.pi / 4), (3, np.pi / 2), (4, 0.0), (3, -np.pi / 2))[index % 5]
    angle = turn + 2 * np.pi * np.arange(sides) / max(sides, 1)
    for x, y in places[np.isfinite(places).all(axis=1)]:
        if sides:
            yield path(np.column_stack([x + 4 * np.cos(angle), y - 4 * np.sin(angle)]), closed=True)
        else:
            yield element("circle", cx=x, cy=y, r=3)


def figure(name: str, size: tuple[float, float], title: str, *content: str, **attributes: float | str | None) -> str:
    """Whole figure with its title, which a screen reader says.

    Parameters
    ----------
    name : str
        Class of the figure, and the stem of the ids in it.
    size : (float, float)
        Width and height of its coordinates.
    """
    return element(
        "svg",
        element("title", escape(title), id=f"{name}-said"),
        *content,
        xmlns=NAMESPACE,
        viewBox=f"0 0 {number(size[0])} {number(size[1])}",
        class_=f"figure {name}",
        role="group" if any("<a " in part for part in content) else "img",  # links in an image are out of reach
        aria_labelledby=f"{name}-said",
        **attributes,
    )


@dataclass(frozen=True)
class Scale:
    """Where values stand between two ends of an axis; times are seconds."""

    low: float
    high: float
    start: float
    end: float
    is_log: bool = False

    def __call__(self, value: npt.ArrayLike) -> FloatArray:
        """Places of values, clipped to a little beyond the ends."""
        values, ends = np.asarray(value, dtype=np.float64), np.array([self.low, self.high])
        if self.is_log:
            values, ends = np.log(values), np.log(ends)
        share = (values - ends[0]) / (ends[1] - ends[0])
        return np.asarray(self.start + np.clip(share, -1.0, 2.0) * (self.end - self.start))

    def at(self, value: float) -> float:
        """Place of one value, as `__call__` has it, in a twentieth of the time."""
        low, high = self.low, self.high
        if self.is_log:
            value, low, high = math.log(value), math.log(low), math.log(high)
        return self.start + min(max((value - low) / (high - low), -1.0), 2.0) * (self.end - self.start)

    def inside(self, value: float) -> float:
        """Place of one value, or of the end that is next to it."""
        return self.at(min(max(value, self.low), self.high))

    def holds(self, value: float) -> bool:
        """Whether a value is between the ends."""
        return self.low <= value <= self.high

    def among(self, values: Iterable[float]) -> list[float]:
        """Those of some values that are between the ends."""
        return [value for value in values if self.holds(value)]

    def ticks(self, most: int = 6) -> list[float]:
        """Round values between the ends."""
        step = round_step((self.high - self.low) / most)
        first = math.ceil(self.low / step)
        return [step * index for index in range(first, math.floor(self.high / step) + 1)]

    def time_ticks(self, most: int = 8) -> list[float]:
        """Seconds at which the clock shows something round."""
        length = self.high - self.low
        step = next((one for one in TIME_STEPS_S if length / one <= most), TIME_STEPS_S[-1])
        return [float(step * index) for index in range(math.ceil(self.low / step), math.floor(self.high / step) + 1)]


def grid(
    across: Scale, upward: Scale, across_ticks: Mapping[float, str], upward_ticks: Mapping[float, str], name: str
) -> Iterator[str]:
    """Lines of a panel with what is written beside them, and the name of the axis upward."""
    for tick, said in across_ticks.items():
        x = float(across(tick))
        yield line(x, upward.end, x, upward.start, class_="gridline")
        yield words(said, x, upward.start + 18, class_="tick", text_anchor="middle")
    for tick, said in upward_ticks.items():
        y = float(upward(tick))
        yield line(across.start, y, across.end, y, class_="gridline")
        yield words(said, across.start - 6, y + 4, class_="tick", text_anchor="end")
    yield words(name, across.start - 30, upward.end - 9, class_="axis-name")


def round_step(length: float) -> float:
    """1, 2, 2.5 or 5 times a power of ten, not below a length."""
    power = 10.0 ** math.floor(math.log10(length))
    return next(one * power for one in (1.0, 2.0, 2.5, 5.0, 10.0) if one * power >= length * (1 - 1e-9))


def time_of_day(seconds: float, step_s: float = 60.0) -> str:
    """Time of day of seconds since an epoch at midnight."""
    of_day = round(seconds % DAY_S)
    return f"{of_day // 3600:02d}:{of_day % 3600 // 60:02d}" + (f":{of_day % 60:02d}" if step_s < 60 else "")


def unix_s(time: npt.ArrayLike) -> FloatArray:
    """Times as seconds since 1970."""
    return np.asarray(time, dtype="datetime64[ns]").astype(np.int64) / 1e9


def colour_at(share: float, colours: Sequence[str] = VIRIDIS, stretch: float = 1.0) -> str:
    """Colour of a scale at a share from 0 to 1; `stretch` as that of a picture."""
    red, green, blue = _colours(np.array([min(max(share, 0.0), 1.0) ** stretch]), colours)[0]
    return f"#{red:02x}{green:02x}{blue:02x}"


def picture(share: FloatArray, colours: Sequence[str], stretch: float = 1.0, **attributes: float | str | None) -> str:
    """Picture of values from 0 to 1, shape (rows, columns), the first row on top; what is not finite is clear.

    With an exponent `stretch` below one, small values stand out.
    """
    from PIL import Image  # noqa: PLC0415 - only figures with spectra need it

    levels = 63
    known = np.isfinite(share)
    index = np.where(known, np.round(np.clip(np.nan_to_num(share), 0.0, 1.0) ** stretch * (levels - 1)), levels)
    image = Image.fromarray(index.astype(np.uint8), mode="P")
    image.putpalette([*_colours(np.linspace(0.0, 1.0, levels), colours).ravel().tolist(), 0, 0, 0])
    kept = io.BytesIO()
    image.save(kept, "PNG", transparency=levels)
    data = base64.b64encode(kept.getvalue()).decode("ascii")
    return element("image", href=f"data:image/png;base64,{data}", preserveAspectRatio="none", **attributes)


def _colours(share: FloatArray, colours: Sequence[str]) -> npt.NDArray[np.uint8]:
    corners = np.array([[int(one[i : i + 2], 16) for i in (1, 3, 5)] for one in colours], dtype=np.float64)
    places = np.linspace(0.0, 1.0, len(colours))
    mixed = np.column_stack([np.interp(share, places, corner) for corner in corners.T])
    return np.round(mixed).astype(np.uint8)
