"""Outlines of what was found in a day: in their place, labelled, and never on top of what they show."""

from itertools import pairwise
from pathlib import Path

import matplotlib.image
import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.dates import date2num
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.text import Annotation, Text

from bella.bursts.detection import DETECTION_COLUMNS, detect_bursts
from bella.exceptions import InputError
from bella.plotting import write_spectrum_png
from bella.plotting.boxes import BOX_STYLES, spread
from bella.plotting.day import _day_figure
from tests.plotting.test_day import day
from tests.spectra.real_day import stereo

MIDNIGHT = pd.Timestamp("2022-03-01")


def found(*bursts: tuple[float, str, str], observatory: str = "SOLO") -> pd.DataFrame:
    """Detections of ten minutes between 0.8 and 8 MHz that begin so many minutes after midnight."""
    rows = [
        {
            "observatory": observatory,
            "start_utc": MIDNIGHT + pd.Timedelta(minutes=minute),
            "peak_utc": MIDNIGHT + pd.Timedelta(minutes=minute + 2),
            "end_utc": MIDNIGHT + pd.Timedelta(minutes=minute + 10),
            "f_low_mhz": 0.8,
            "f_high_mhz": 8.0,
            "score": 10.0 + minute,
            "tier": tier,
            "reason": reason,
        }
        for minute, tier, reason in bursts
    ]
    return pd.DataFrame(rows, columns=list(DETECTION_COLUMNS))


def drawn(detections: pd.DataFrame) -> tuple[Figure, Axes]:
    figure = _day_figure(day(), detections)
    figure.draw_without_rendering()
    return figure, figure.axes[0]


def boxes(axes: Axes) -> list[Rectangle]:
    return [patch for patch in axes.patches if isinstance(patch, Rectangle)]


def labels(axes: Axes) -> list[Annotation]:
    return [text for text in axes.texts if isinstance(text, Annotation) and text.get_visible()]


def test_a_box_encloses_its_burst_with_a_little_room() -> None:
    _, axes = drawn(found((60, "catalogued", "")))
    (box,) = boxes(axes)
    start, end = date2num([MIDNIGHT + pd.Timedelta(minutes=60), MIDNIGHT + pd.Timedelta(minutes=70)])

    assert not box.get_fill()
    assert start - 3 / 1440 < box.get_x() < start
    assert end < box.get_x() + box.get_width() < end + 3 / 1440
    assert 0.7 < box.get_y() < 0.8
    assert 8.0 < box.get_y() + box.get_height() < 9.0


def test_labels_say_when_and_what_was_refused_says_why() -> None:
    _, axes = drawn(
        found((60, "localisable", ""), (90, "catalogued", "group"), (200, "rejected", "few_channels_above_0.8_mhz"))
    )

    assert [text.get_text() for text in labels(axes)] == ["01:00", "01:30", "few channels\nabove 0.8 MHz\n03:20"]
    assert [box.get_linestyle() == "-" for box in boxes(axes)] == [True, True, False]
    legend = axes.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["burst, localisable", "burst", "no burst"]


@pytest.mark.parametrize("count", [2, 12, 40])
def test_labels_never_overlap_one_another_nor_the_spectrum(count: int) -> None:
    minutes = np.sort(np.random.default_rng(count).uniform(100.0, 118.0, count))
    kinds = [(float(m), "rejected", "no_drift") if i % 4 == 0 else (float(m), "catalogued", "") for i, m in
             enumerate(minutes)]  # fmt: skip
    figure, axes = drawn(found(*kinds))
    extents = [Text.get_window_extent(label) for label in labels(axes)]
    spectrum = axes.get_window_extent()

    assert len(extents) == count
    assert all(left.x1 <= right.x0 + 0.5 for left, right in pairwise(extents))
    assert all(extent.y0 > spectrum.y1 for extent in extents)
    assert extents[0].x0 >= spectrum.x0 - 0.5
    assert extents[-1].x1 <= spectrum.x1 + 0.5
    assert max(extent.y1 for extent in extents) < figure.bbox.y1


def test_where_there_is_no_room_for_all_bursts_keep_their_labels() -> None:
    many = [(m, "rejected" if m % 2 else "catalogued", "no_drift") for m in range(10, 94)]
    _, axes = drawn(found(*many))

    assert sum("no drift" not in label.get_text() for label in labels(axes)) == 42
    assert len(boxes(axes)) == 84


def test_outlines_are_seen_and_leave_the_burst_alone(tmp_path: Path) -> None:
    outline = np.array(to_rgb(BOX_STYLES["catalogued"].outline))
    outlined, bright = [], []
    for table in (found(), found((60, "catalogued", ""))):
        write_spectrum_png(tmp_path / "day.png", day(), table)
        picture = matplotlib.image.imread(tmp_path / "day.png")[..., :3]
        outlined.append(int((np.abs(picture - outline) < 0.02).all(axis=-1).sum()))
        bright.append(int(((picture[..., 0] > 0.9) & (picture[..., 2] < 0.85)).sum()))

    assert outlined[0] == 0
    assert outlined[1] > 500
    assert bright[1] > 0.95 * bright[0] > 1000


@pytest.mark.parametrize(
    "table",
    [found(), found((60, "catalogued", ""), observatory="WIND"), found((900, "catalogued", ""))],
    ids=["empty", "another spacecraft", "another time"],
)
def test_what_does_not_belong_leaves_the_day_as_it_is(table: pd.DataFrame) -> None:
    plain, other = _day_figure(day(), None), _day_figure(day(), table)

    assert len(other.axes[0].get_children()) == len(plain.axes[0].get_children())
    assert other.get_figheight() == plain.get_figheight()


def test_a_table_with_too_few_columns_leaves_no_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="detection table has no column 'tier'"):
        write_spectrum_png(tmp_path / "day.png", day(), found((60, "catalogued", "")).drop(columns="tier"))
    assert list(tmp_path.iterdir()) == []


def test_a_burst_that_reaches_over_the_end_is_cut_there() -> None:
    _, axes = drawn(found((-5, "catalogued", ""), (235, "catalogued", "")))
    left, right = axes.get_xlim()

    assert boxes(axes)[0].get_x() == pytest.approx(left)
    assert boxes(axes)[1].get_x() + boxes(axes)[1].get_width() == pytest.approx(right)


def test_a_spectrum_without_data_still_shows_where_its_bursts_were() -> None:
    empty = day()
    empty["intensity"][:] = np.nan
    assert len(boxes(_day_figure(empty, found((60, "catalogued", ""))).axes[0])) == 1


def test_the_bursts_of_a_real_day_are_outlined(reference_files: Path) -> None:
    spectrum = stereo(reference_files, "ahead")
    table = detect_bursts(spectrum)
    axes = _day_figure(spectrum, table).axes[0]

    assert len(boxes(axes)) == len(table) > 5
    assert any(label.get_text() == "11:46" for label in labels(axes))


@given(
    st.lists(st.tuples(st.floats(0.0, 100.0), st.floats(0.5, 6.0)), min_size=1, max_size=15),
)
def test_spread_places_keep_apart_in_order_and_inside(pairs: list[tuple[float, float]]) -> None:
    wanted, width = (np.array(column) for column in zip(*sorted(pairs), strict=True))
    place = spread(wanted, width, 100.0)

    assert (np.diff(place) >= 0.5 * (width[1:] + width[:-1]) - 1e-9).all()
    assert place[0] >= 0.5 * width[0] - 1e-9
    assert place[-1] <= 100.0 - 0.5 * width[-1] + 1e-9


def test_places_that_are_apart_already_stay() -> None:
    np.testing.assert_allclose(spread(np.array([10.0, 50.0, 90.0]), np.full(3, 8.0), 100.0), [10.0, 50.0, 90.0])
    np.testing.assert_allclose(spread(np.array([50.0, 50.0]), np.full(2, 8.0), 100.0), [46.0, 54.0])
