"""Colours, markers and names that the screen figures and the printed ones share.

Track colours are a blue and an orange that stay apart under the common forms of colour blindness, and every track has
a marker of its own, so that colour is never the only difference.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class TrackStyle:
    """How one track is drawn: its name in `figure.css`, a colour, the same colour as numbers, and a marker."""

    name: str
    colour: str
    rgb: tuple[int, int, int]
    printed_marker: str

    def shade_rgba(self, opacity: float) -> tuple[float, float, float, float]:
        """Colour with an opacity between 0 and 1, as matplotlib takes it."""
        red, green, blue = (part / 255.0 for part in self.rgb)
        return red, green, blue, opacity


def _style(name: str, colour: str, printed_marker: str) -> TrackStyle:
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return TrackStyle(name, colour, (red, green, blue), printed_marker)


TRACK_STYLES = (
    _style("gauss_hermite", "#1f7fc1", "o"),
    _style("half_maximum", "#d95f02", "D"),
    _style("half_rise", "#11936b", "s"),
    _style("shared_profile", "#b8508f", "^"),
    _style("another", "#7a6a1c", "P"),
)

EDGE_NAMES = {
    "gauss_hermite": "Gauss-Hermite edge",
    "half_maximum": "Half-maximum edge",
    "half_rise": "Half-rise edge",
    "shared_profile": "Shared-profile edge",
}

INK = "#22303c"
FAINT = "rgba(110,125,140,0.35)"
SUN = "#f5b301"
SPACECRAFT = "#5b6b7a"
FREQUENCY_SCALE = "Viridis"
INTENSITY_SCALE = [(0.0, "#12161d"), (0.35, "#3d454f"), (0.7, "#9a9a94"), (1.0, "#fbf5e4")]
"""Dark to ivory without a hue of its own, so that the coloured edges stand out on it."""

BRIGHTNESS_SCALE = [(0.0, "#10131c"), (0.3, "#3b2f6b"), (0.55, "#a8446a"), (0.8, "#f0964a"), (1.0, "#fdf4c9")]
"""Dark to ivory through violet and orange, lightness rising evenly: for spectra on which nothing else is drawn."""

FREQUENCY_TICKS_MHZ = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0)


def track_style(edge: str, index: int) -> TrackStyle:
    """Style of a track: a known definition of the edge looks the same in every figure, others take what is left.

    Parameters
    ----------
    edge : str
        Definition of the edge, or its name.
    index : int
        Place of the track in its figure.
    """
    known = [*EDGE_NAMES, *EDGE_NAMES.values()]
    if edge in known:
        return TRACK_STYLES[known.index(edge) % len(EDGE_NAMES)]
    others = TRACK_STYLES[len(EDGE_NAMES) :]
    return others[index % len(others)]


def edge_name(edge: str) -> str:
    """Name of an edge definition as a reader sees it."""
    return EDGE_NAMES.get(edge, edge.replace("_", " "))
