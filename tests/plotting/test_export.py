"""Figures as files: the same drawing as SVG, PNG and PDF, with its caption, in plain colours."""

import io
import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from bella.exceptions import InputError
from bella.plotting import (
    Caption,
    MapView,
    TrackView,
    constellation_figure,
    exported,
    kind_of,
    origin_warning,
    write_figure,
)
from bella.plotting.export import style_of
from bella.plotting.svg import element, figure, figure_style
from bella.records import Origin
from tests.plotting.reading import of_class, parsed, texts
from tests.plotting.synthetic import synthetic_posterior, synthetic_track_fit
from tests.plotting.test_constellation import UTC

CAPTION = Caption("What & where it was. " * 12, "Cite: <somewhere>.")
FAKE = Caption("What it shows.", "Source.", "Simulated data, not a burst of the Sun.")


@pytest.fixture(scope="module")
def drawn() -> str:
    edge = "half_maximum"
    track = TrackView(edge, synthetic_posterior(edge), synthetic_track_fit(edge))
    return constellation_figure([track], UTC, MapView())


def pixels(made: bytes) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(made)).convert("RGB")).astype(int)


def square(**more: str) -> str:
    return figure("square", (100, 100), "A square", element("rect", x=0, y=0, width=100, height=100, **more))


def test_a_kept_figure_is_whole_with_its_caption_below_it(drawn: str, tmp_path: Path) -> None:
    path = tmp_path / "new" / "constellation.svg"
    write_figure(path, drawn, CAPTION)
    root = parsed(path.read_text(encoding="utf-8"))
    assert len(of_class(root, "track edge-half_maximum")) == 1
    assert " ".join(texts(root, "caption")) == f"{CAPTION.text.strip()} {CAPTION.source}"
    lines = of_class(root, "caption")
    height = float(root.get("viewBox").split()[3])
    assert all(560 < float(one.get("y")) < height for one in lines)
    assert max(len(one.text) for one in lines) * 0.5 * 11 < 620
    assert float(root.get("height")) == height
    assert path.stat().st_size < 300_000
    assert path.stat().st_mode & 0o777 == 0o644


def test_a_kept_figure_has_plain_colours_and_no_links() -> None:
    for theme, ink in (("light", "#1d2935"), ("dark", "#e4eaf0")):
        style = style_of(theme)
        assert "var(" not in style
        assert "@media" not in style
        assert ink in style
    linked = figure("f", (10, 10), "t", element("a", element("title", "b"), href="/bursts/x"))
    assert "href" not in exported(linked, CAPTION).decode()
    assert len(re.findall(r"<g>", exported(linked, CAPTION).decode())) == 1


def test_every_colour_of_the_pages_is_known() -> None:
    known, used = (set(re.findall(pattern, figure_style())) for pattern in (r"(--[\w-]+):", r"var\((--[\w-]+)\)"))
    assert used <= known


def test_a_png_shows_the_colours_of_its_theme_twice_as_fine() -> None:
    bright, dark = (pixels(exported(square(class_="sky"), Caption(""), "png", theme)) for theme in ("light", "dark"))
    assert bright.shape == (200, 200, 3)
    assert bright[100, 100].tolist() == [0xFF, 0xFF, 0xFF]
    assert dark[100, 100].tolist() == [0x18, 0x21, 0x2B]
    band = pixels(exported(square(class_="band edge-half_rise"), Caption(""), "png"))[100, 100]
    assert band == pytest.approx([255 - 0.2 * (255 - part) for part in (0x11, 0x93, 0x6B)], abs=2)


def test_text_and_caption_are_seen_in_a_png(drawn: str) -> None:
    made = pixels(exported(drawn, CAPTION, "png"))
    below = made[1130:]
    assert (below.min(axis=2) < 90).sum() > 1000
    assert made.shape[1] == 1240


def test_what_is_drawn_beyond_the_figure_does_not_reach_into_the_caption() -> None:
    wide = figure("f", (100, 100), "t", element("rect", x=0, y=0, width=100, height=400, fill="#ff0000"))
    made = pixels(exported(wide, Caption("x"), "png"))
    assert made[150, 100].tolist() == [255, 0, 0]
    assert made[-4, 100].tolist() == [255, 255, 255]


def test_a_pdf_has_its_text_and_says_what_it_is(drawn: str) -> None:
    made = exported(drawn, CAPTION, "pdf")
    assert made.startswith(b"%PDF-")
    assert b"/ToUnicode" in made
    assert b"DejaVuSans" in made
    assert b"Map of the inner heliosphere" in made


def test_simulated_data_are_marked_across_the_figure() -> None:
    root = parsed(exported(square(), FAKE).decode())
    assert texts(root, "stamp") == ["SIMULATED DATA"]
    assert texts(root, "caption warning")
    plain, marked = (pixels(exported(square(class_="sky"), one, "png"))[:200] for one in (CAPTION, FAKE))
    assert np.unique(plain) == [255]
    assert (marked.min(axis=2) < 250).sum() > 100
    assert [origin_warning(one) != "" for one in (Origin.ARCHIVE, Origin.EVENT, Origin.SIMULATED, Origin.TEST)] == [
        False,
        False,
        True,
        True,
    ]


@pytest.mark.parametrize(("name", "begins"), [("f.svg", b"<svg "), ("f.png", b"\x89PNG"), ("f.PDF", b"%PDF-")])
def test_a_file_is_of_the_kind_of_its_name_and_replaces_an_old_one_whole(
    tmp_path: Path, name: str, begins: bytes
) -> None:
    path = tmp_path / "new" / name
    path.parent.mkdir()
    path.write_bytes(b"old")
    write_figure(path, square(), CAPTION)
    assert path.read_bytes().startswith(begins)
    assert [entry.name for entry in path.parent.iterdir()] == [name]


def test_a_failure_leaves_the_old_picture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "figure.png"
    path.write_bytes(b"old")
    monkeypatch.setattr("pathlib.Path.chmod", lambda *_, **__: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        write_figure(path, square(), CAPTION)
    assert [entry.read_bytes() for entry in tmp_path.iterdir()] == [b"old"]


def test_a_name_of_another_kind_is_refused() -> None:
    with pytest.raises(InputError, match="jpg ends with none of"):
        kind_of(Path("figure.jpg"))
