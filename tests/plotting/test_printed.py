"""Files of figures appear whole or not at all."""

from pathlib import Path

import pytest
from matplotlib.figure import Figure

from bella.plotting import Caption, write_figure
from bella.plotting.printed import save_png
from bella.plotting.svg import figure

EMPTY = figure("empty", (10, 10), "nothing")


def test_nothing_is_left_beside_the_picture_and_an_old_one_is_replaced(tmp_path: Path) -> None:
    png, svg = tmp_path / "figure.png", tmp_path / "figure.svg"
    for path in (png, svg):
        path.write_bytes(b"old")
    save_png(Figure(), png)
    write_figure(svg, EMPTY, Caption("said"))
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
        write_figure(svg, EMPTY, Caption("said"))
    assert {path.read_bytes() for path in tmp_path.iterdir()} == {b"old"}
    assert len(list(tmp_path.iterdir())) == 2
