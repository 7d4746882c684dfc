"""The picture of a day as all spacecraft heard it."""

from datetime import date
from pathlib import Path

import matplotlib.image
import numpy as np
import pandas as pd
import pytest
import xarray as xr

from bella.exceptions import InputError, NoDataError
from bella.plotting import write_day_png
from bella.plotting.boxes import BOX_COLUMNS
from bella.spectra import over_background
from tests.plotting.test_day import GREY, day, share

DAY = date(2022, 3, 1)
EMPTY = pd.DataFrame(columns=list(BOX_COLUMNS))
BOX = np.array([0x7D, 0xFF, 0xB0]) / 255.0


def found(observatory: str, start: str, tier: str = "localisable") -> pd.DataFrame:
    onset = pd.Timestamp(f"2022-03-{start}")
    row = (observatory, onset, onset + pd.Timedelta(minutes=20), 0.5, 12.0, 30.0, tier, "")
    return pd.DataFrame([row], columns=list(BOX_COLUMNS))


def height(path: Path) -> int:
    return int(matplotlib.image.imread(path).shape[0])


def green(path: Path) -> float:
    return share(path, lambda picture: (np.abs(picture - BOX) < 0.08).all(axis=-1))


def test_each_spacecraft_has_a_panel_with_its_own_boxes(tmp_path: Path) -> None:
    one, two = tmp_path / "days" / "one.png", tmp_path / "days" / "two.png"
    write_day_png(one, DAY, [day()], found("SOLO", "01 01:00"))
    write_day_png(two, DAY, [day(), day(observatory="PSP")], found("SOLO", "01 01:00"))

    assert sorted(entry.name for entry in one.parent.iterdir()) == ["one.png", "two.png"]
    assert height(two) > 1.5 * height(one)
    assert green(one) > 0.0
    assert 0.3 < green(two) / green(one) < 0.8, "the box is in one panel of the two"


def test_only_the_day_is_shown(tmp_path: Path) -> None:
    before = day()
    before = before.assign_coords(time=before["time"] - np.timedelta64(2, "h"))
    write_day_png(
        tmp_path / "day.png", DAY, [before], pd.concat([found("SOLO", "01 01:00"), found("SOLO", "02 01:00")])
    )
    write_day_png(tmp_path / "none.png", DAY, [before], found("SOLO", "02 01:00"))

    assert green(tmp_path / "day.png") > green(tmp_path / "none.png") == 0.0
    assert share(tmp_path / "day.png", lambda picture: (np.abs(picture - GREY) < 0.02).all(axis=-1)) > 0.5
    with pytest.raises(NoDataError, match="2022-03-03"):
        write_day_png(tmp_path / "other.png", date(2022, 3, 3), [before], EMPTY)


def test_a_background_is_taken_away_once_and_also_where_decibels_were_published(tmp_path: Path) -> None:
    raw, over = tmp_path / "raw.png", tmp_path / "over.png"
    write_day_png(raw, DAY, [day()], EMPTY)
    write_day_png(over, DAY, [over_background(day())], EMPTY)

    assert raw.read_bytes() == over.read_bytes()
    lifted = over_background(day()).drop_vars("noise_db")
    lifted["intensity"] += 3.0
    write_day_png(tmp_path / "lifted.png", DAY, [lifted], EMPTY)
    dark = [share(path, lambda picture: picture.max(axis=-1) < 0.2) for path in (over, tmp_path / "lifted.png")]
    assert dark[1] > 0.8 * dark[0] > 0.0, "three decibels everywhere are background"


def test_a_whole_day_at_a_fine_cadence_is_a_small_file(tmp_path: Path) -> None:
    level = np.random.default_rng(2).normal(0.0, 1.0, (12_000, 150)).astype(np.float32)
    time = np.datetime64(DAY, "ns") + np.arange(12_000) * np.timedelta64(7, "s")
    fine = xr.Dataset(
        {"intensity": (("time", "frequency"), level)},
        coords={"time": time, "frequency": np.geomspace(0.02, 16.0, 150)},
        attrs=day().attrs | {"quantity": "db_over_background"},
    )
    write_day_png(tmp_path / "day.png", DAY, [fine], EMPTY)

    assert (tmp_path / "day.png").stat().st_size < 500_000


def test_what_cannot_be_drawn_leaves_the_figure_before_it(tmp_path: Path) -> None:
    path = tmp_path / "day.png"
    write_day_png(path, DAY, [day()], EMPTY)
    before = path.read_bytes()

    with pytest.raises(InputError, match="counts"):
        write_day_png(path, DAY, [day(quantity="counts")], EMPTY)
    with pytest.raises(InputError, match="score"):
        write_day_png(path, DAY, [day()], EMPTY.drop(columns="score"))

    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]
