"""PNG files appear whole or not at all."""

from pathlib import Path

import matplotlib.image
import pytest

from bella.plotting import TrackView, write_constellation_png, write_spectra_png
from tests.plotting.synthetic import synthetic_posterior, synthetic_spectra, synthetic_track_fit

EDGES = ("gauss_hermite", "half_maximum")


def tracks() -> list[TrackView]:
    return [TrackView(edge, synthetic_posterior(edge), synthetic_track_fit(edge)) for edge in EDGES]


def test_constellation_is_a_picture_with_both_track_colours(tmp_path: Path) -> None:
    path = tmp_path / "new" / "constellation.png"
    write_constellation_png(path, tracks())
    picture = matplotlib.image.imread(path)
    assert min(picture.shape[:2]) > 800
    for red, green, blue in ((0x1F, 0x7F, 0xC1), (0xD9, 0x5F, 0x02)):
        near = (abs(picture[..., :3] * 255 - [red, green, blue]) < 2).all(axis=-1)
        assert near.sum() > 500
    assert path.stat().st_size < 300_000


def test_spectra_are_a_picture(tmp_path: Path) -> None:
    path = tmp_path / "spectra.png"
    write_spectra_png(path, synthetic_spectra(), {edge: synthetic_posterior(edge) for edge in EDGES})
    assert matplotlib.image.imread(path).std() > 0.1


def test_nothing_is_left_beside_the_picture_and_an_old_one_is_replaced(tmp_path: Path) -> None:
    path = tmp_path / "constellation.png"
    path.write_bytes(b"old")
    write_constellation_png(path, tracks()[:1])
    assert [entry.name for entry in tmp_path.iterdir()] == ["constellation.png"]
    assert path.read_bytes().startswith(b"\x89PNG")


def test_a_failure_leaves_the_old_picture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "constellation.png"
    path.write_bytes(b"old")
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", lambda *_, **__: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        write_constellation_png(path, tracks()[:1])
    assert path.read_bytes() == b"old"
    assert len(list(tmp_path.iterdir())) == 1
