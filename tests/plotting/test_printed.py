"""Files of figures appear whole or not at all."""

from pathlib import Path

import pytest
from matplotlib.figure import Figure

from bella.plotting import MapView, TrackView, constellation_figure, write_figure
from bella.plotting.printed import save_png
from tests.plotting.reading import of_class, parsed
from tests.plotting.synthetic import synthetic_posterior, synthetic_track_fit
from tests.plotting.test_constellation import UTC


def test_a_figure_of_a_page_is_a_file_with_its_caption(tmp_path: Path) -> None:
    path = tmp_path / "new" / "constellation.svg"
    track = TrackView("half_maximum", synthetic_posterior("half_maximum"), synthetic_track_fit("half_maximum"))
    write_figure(path, constellation_figure([track], UTC, MapView()), "A track")
    root = parsed(path.read_text(encoding="utf-8"))
    assert root[0].text == "A track"
    assert len(of_class(root, "track edge-half_maximum")) == 1
    assert path.stat().st_size < 300_000
    assert path.stat().st_mode & 0o777 == 0o644


def test_nothing_is_left_beside_the_picture_and_an_old_one_is_replaced(tmp_path: Path) -> None:
    png, svg = tmp_path / "figure.png", tmp_path / "figure.svg"
    for path in (png, svg):
        path.write_bytes(b"old")
    save_png(Figure(), png)
    write_figure(svg, "<svg></svg>", "said")
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["figure.png", "figure.svg"]
    assert png.read_bytes().startswith(b"\x89PNG")
    assert svg.read_text().endswith("</svg>")


def test_a_failure_leaves_the_old_picture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    png, svg = tmp_path / "figure.png", tmp_path / "figure.svg"
    for path in (png, svg):
        path.write_bytes(b"old")
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", lambda *_, **__: 1 / 0)
    monkeypatch.setattr("pathlib.Path.chmod", lambda *_, **__: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        save_png(Figure(), png)
    with pytest.raises(ZeroDivisionError):
        write_figure(svg, "<svg></svg>", "said")
    assert {path.read_bytes() for path in tmp_path.iterdir()} == {b"old"}
    assert len(list(tmp_path.iterdir())) == 2
