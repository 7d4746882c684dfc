"""Figures as files to keep: SVG, PNG and PDF of one drawing, with its caption and how to cite it below.

A file has plain colours in place of the variables of the pages, so that every program shows it alike.
"""

import os
import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from html import escape
from pathlib import Path
from textwrap import wrap
from typing import Any, Literal, get_args

from bella.exceptions import InputError, require_extra
from bella.plotting.svg import NAMESPACE, element, figure_style, number, words
from bella.records import REAL_ORIGINS, Origin

Kind = Literal["svg", "png", "pdf"]
Theme = Literal["light", "dark"]
KINDS: tuple[Kind, ...] = get_args(Kind)
MEDIA_TYPES: dict[Kind, str] = {"svg": "image/svg+xml", "png": "image/png", "pdf": "application/pdf"}

FONT = "DejaVu Sans"
"""Comes with matplotlib, so that a picture looks the same on every machine."""

TEXT_SIZE, LINE_HEIGHT, MARGIN = 11.0, 16.0, 12.0
CHARACTER_WIDTH = 0.56
"""Of the mean letter of a caption, as a share of its size; a little more than that of the font."""

LEAST_CHARACTERS = 24
POINTS_PER_PIXEL, PIXEL_RATIO = 0.75, 2.0
AT_RULE = re.compile(r"@media[^{]*\{(?:[^{}]*\{[^{}]*\})*[^{}]*\}")
PAGE = """#set document(title: sys.inputs.title, description: sys.inputs.caption, author: "BELLA service")
#set page(width: auto, height: auto, margin: 0pt)
#image("figure.svg", width: float(sys.inputs.width) * 1pt)
"""


@dataclass(frozen=True)
class Caption:
    """What stands below a figure that is kept.

    Attributes
    ----------
    text : str
        What is shown.
    source : str
        Of what, and how it is cited.
    warning : str
        What nobody may overlook, such as that the data are simulated; empty for none.
    """

    text: str
    source: str = ""
    warning: str = ""

    def __str__(self) -> str:
        return " ".join(one for one in (self.warning, self.text, self.source) if one)


def exported(drawn: str, caption: Caption, kind: Kind = "svg", theme: Theme = "light") -> bytes:
    """A figure as a file of its own.

    Parameters
    ----------
    drawn : str
        SVG, as the functions of this package draw it.
    theme : str
        Colours for a light or for a dark ground.

    Raises
    ------
    MissingExtraError
        If a PNG or a PDF is asked for, and the package that makes them is not installed.
    """
    text = _standing_alone(drawn, caption, theme)
    if kind == "svg":
        return text.encode()
    require_extra("typst")
    import typst  # noqa: PLC0415 - a large library, for those who ask for it

    width, _ = _size(text)
    return bytes(
        typst.compile(
            {"main.typ": PAGE.encode(), "figure.svg": text.encode()},
            format=kind,
            ppi=72.0 / POINTS_PER_PIXEL * PIXEL_RATIO,
            font_paths=_fonts(),
            sys_inputs={
                "title": _title(drawn),
                "caption": str(caption),
                "width": f"{width * POINTS_PER_PIXEL:.2f}",
            },
        )
    )


def origin_warning(origin: Origin) -> str:
    """Warning of a figure of data that are not of the Sun; empty for real ones."""
    return "" if origin in REAL_ORIGINS else f"{origin.capitalize()} data, not a burst of the Sun."


def write_figure(path: Path, drawn: str, caption: Caption) -> None:
    """Write a figure with its caption, whole or not at all.

    Parameters
    ----------
    path : Path
        SVG, PNG or PDF by the end of its name. Its folder is made when it does not exist.

    Raises
    ------
    InputError
        If its name ends otherwise.
    """
    kind = kind_of(path)
    made = exported(drawn, caption, kind)
    with whole_file(path) as staged:
        staged.write_bytes(made)


def kind_of(path: Path) -> Kind:
    """Kind of a figure by the end of its name.

    Raises
    ------
    InputError
        If it is none.
    """
    found = next((kind for kind in KINDS if path.suffix.lower() == f".{kind}"), None)
    if found is None:
        raise InputError(f"{path.name} ends with none of .svg, .png and .pdf: name the figure after its kind")
    return found


def write_whole(path: Path, text: str) -> None:
    """Write a text; see :func:`whole_file`."""
    with whole_file(path) as staged:
        staged.write_text(text, encoding="utf-8")


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Name beside a file, to write under; it is renamed at the end, so that the file appears whole or not at all.

    Parameters
    ----------
    path : Path
        Its folder is made when it does not exist.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(suffix=path.suffix, prefix=f".{path.stem}-", dir=path.parent)
    os.close(handle)
    staged = Path(name)
    try:
        yield staged
        staged.chmod(0o644)
        staged.replace(path)
    finally:
        staged.unlink(missing_ok=True)


@cache
def style_of(theme: Theme) -> str:
    """Style sheet of one theme without variables and without rules for screens."""
    whole = figure_style()
    colours = _variables(whole.split("@media")[0])
    if theme == "dark":
        colours |= _variables(next(one for one in AT_RULE.findall(whole) if "scheme: dark" in one))
    plain = re.sub(r":root\s*\{[^}]*\}", "", AT_RULE.sub("", whole))
    plain = re.sub(r"var\((--[\w-]+)\)", lambda found: colours[found[1]], plain)
    return re.sub(r"font-family:[^;]*;", f'font-family: "{FONT}", sans-serif;', plain).strip()


def _variables(rules: str) -> dict[str, str]:
    return dict(re.findall(r"(--[\w-]+):\s*([^;]+);", rules))


def _standing_alone(drawn: str, caption: Caption, theme: Theme) -> str:
    """SVG on a ground of its own, with its style, its caption below, and no links: those are of a page."""
    width, height = _size(drawn)
    below = list(_lines(caption, width, height))
    whole = height + LINE_HEIGHT * len(below) + (1.5 * MARGIN if below else 0.0)
    inner = re.sub(r"<(/?)a\b(?: href=\"[^\"]*\")?", r"<\1g", drawn)
    return element(
        "svg",
        element("title", _title(drawn)),
        element("desc", escape(str(caption))),
        element("style", style_of(theme)),
        element("rect", x=0, y=0, width=width, height=whole, class_="sky"),
        inner.replace("<svg ", f'<svg width="{number(width)}" height="{number(height)}" ', 1),  # clips what it draws
        _stamp(caption, width, height),
        *below,
        xmlns=NAMESPACE,
        width=width,
        height=whole,
        viewBox=f"0 0 {number(width)} {number(whole)}",
        class_="figure",
    )


def _lines(caption: Caption, width: float, top: float) -> list[str]:
    most = max(LEAST_CHARACTERS, int((width - 2 * MARGIN) / (CHARACTER_WIDTH * TEXT_SIZE)))
    paragraphs = ((caption.warning, "caption warning"), (caption.text, "caption"), (caption.source, "caption source"))
    lines = [
        (line, kind)
        for text, kind in paragraphs
        for line in wrap(text.replace(" %", "\N{NO-BREAK SPACE}%"), most, break_on_hyphens=False)
    ]
    return [
        words(line, MARGIN, top + MARGIN + LINE_HEIGHT * (index + 0.5), class_=kind)
        for index, (line, kind) in enumerate(lines)
    ]


def _stamp(caption: Caption, width: float, height: float) -> str:
    """First words of the warning across the figure: a picture may lose its caption."""
    if not caption.warning:
        return ""
    x, y = width / 2, height / 2
    place = f"rotate(-24 {number(x)} {number(y)})"
    said = " ".join(caption.warning.split()[:2]).rstrip(",.:")
    return words(said.upper(), x, y, class_="stamp", text_anchor="middle", transform=place)


def _size(drawn: str) -> tuple[float, float]:
    width, height = re.findall(r'viewBox="0 0 ([\d.]+) ([\d.]+)"', drawn)[0]
    return float(width), float(height)


def _title(drawn: str) -> str:
    return str(re.findall(r"<title[^>]*>([^<]*)</title>", drawn)[0])


@cache
def _fonts() -> Any:
    """Fonts of the pictures, and none of the machine."""
    require_extra("matplotlib")
    import matplotlib as mpl  # noqa: PLC0415
    import typst  # noqa: PLC0415

    folder = Path(mpl.get_data_path()) / "fonts" / "ttf"
    return typst.Fonts(include_system_fonts=False, include_embedded_fonts=False, font_paths=[folder])
