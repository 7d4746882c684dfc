"""The picture of a day as all spacecraft received it."""

import base64
import io
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from PIL import Image

from bella.exceptions import InputError, NoDataError
from bella.plotting import day_figure, zoomed_day
from bella.plotting.days import BOX_COLUMNS, LEFT, RIGHT, WIDTH
from bella.spectra import over_background
from tests.plotting.reading import SVG, of_class, parsed, texts

DAY = date(2022, 3, 1)
EMPTY = pd.DataFrame(columns=list(BOX_COLUMNS))


def day(**changes: object) -> xr.Dataset:
    """Four hours of noise with a burst at 01:00 and a gap from 02:00 to 03:00."""
    minutes = np.delete(np.arange(240), slice(120, 180))
    level = np.random.default_rng(5).normal(0.0, 0.3, (180, 30))
    level[60:75] += 15.0
    attributes = {"observatory": "SOLO", "receiver": "HFR", "quantity": "psd_v2_hz", "integration_s": 60.0}
    return xr.Dataset(
        {"intensity": (("time", "frequency"), (1e-17 * 10.0 ** (level / 10.0)).astype(np.float32))},
        coords={
            "time": np.datetime64("2022-03-01", "ns") + minutes * np.timedelta64(60, "s"),
            "frequency": np.geomspace(0.4, 16.0, 30),
        },
        attrs=attributes | {"source_files": "none", **changes},
    )


def write_day_svg(path: Path, *drawn: Any) -> None:
    """Keep the figure of a day."""
    path.parent.mkdir(exist_ok=True)
    path.write_text(day_figure(*drawn), encoding="utf-8")


def found(observatory: str, start: str, tier: str = "localisable", burst_id: str = "T3-x") -> pd.DataFrame:
    onset = pd.Timestamp(f"2022-03-{start}")
    row = (observatory, onset, onset + pd.Timedelta(minutes=20), 0.5, 12.0, 30.0, tier, "", burst_id)
    return pd.DataFrame([row], columns=[*BOX_COLUMNS, "burst_id"])


def height(path: Path) -> float:
    return float(parsed(path.read_text()).get("viewBox", "").split()[3])


def green(path: Path) -> int:
    """Boxes of localised bursts."""
    return len(of_class(parsed(path.read_text()), "box localised"))


def levels(path: Path) -> np.ndarray:
    """Levels of the picture of the first panel; 63 is no data."""
    image = parsed(path.read_text()).find(f".//{SVG}image")
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(image.get("href", "").partition(",")[2]))))


def test_each_spacecraft_has_a_panel_with_its_own_boxes(tmp_path: Path) -> None:
    one, two = tmp_path / "days" / "one.svg", tmp_path / "days" / "two.svg"
    write_day_svg(one, DAY, [day()], found("SOLO", "01 01:00"))
    write_day_svg(two, DAY, [day(), day(observatory="PSP")], found("PSP", "01 01:00"))

    assert sorted(entry.name for entry in one.parent.iterdir()) == ["one.svg", "two.svg"]
    assert height(two) > 1.5 * height(one)
    assert green(one) == green(two) == 1
    root = parsed(two.read_text())
    assert texts(root, "panel-name") == ["SOLO", "PSP"]
    (box,) = of_class(root, "box")
    top = float(of_class(root, "no-data")[1].get("y", ""))
    assert float(box.get("y", "")) >= top - 2, "the box is in the panel of its spacecraft"
    share = np.log(16.0 * 1.05 / 0.5) / np.log(16.0 * 1.05 / (0.4 / 1.05))
    bottom = float(box.get("y", "")) + float(box.get("height", ""))
    assert bottom == pytest.approx(top + 150.0 * share + 2, abs=0.5), "and reaches to its lowest frequency"


def test_a_box_stands_at_its_time_and_leads_to_its_burst(tmp_path: Path) -> None:
    write_day_svg(tmp_path / "day.svg", DAY, [day()], found("SOLO", "01 06:00"))
    root = parsed((tmp_path / "day.svg").read_text())
    (link,) = root.iter(f"{SVG}a")
    assert link.get("href") == "#T3-x"
    box, panel = of_class(root, "box")[0], of_class(root, "no-data")[0]
    share = (float(box.get("x", "")) - float(panel.get("x", ""))) / float(panel.get("width", ""))
    assert share == pytest.approx(0.25, abs=1e-3)
    assert float(box.get("width", "")) / float(panel.get("width", "")) == pytest.approx(20 / 1440, abs=1e-3)
    assert texts(root, "onset-label") == ["06:00"]
    write_day_svg(tmp_path / "none.svg", DAY, [day()], found("SOLO", "01 06:00", "rejected", ""))
    assert len(of_class(parsed((tmp_path / "none.svg").read_text()), "box rejected")) == 1
    assert green(tmp_path / "none.svg") == 0


def test_only_the_day_is_shown(tmp_path: Path) -> None:
    before = day()
    before = before.assign_coords(time=before["time"] - np.timedelta64(2, "h"))
    both = pd.concat([found("SOLO", "01 01:00"), found("SOLO", "02 01:00")])
    write_day_svg(tmp_path / "day.svg", DAY, [before], both)

    assert green(tmp_path / "day.svg") == 1
    assert (levels(tmp_path / "day.svg") == 63).mean() > 0.5
    with pytest.raises(NoDataError, match="2022-03-03"):
        write_day_svg(tmp_path / "other.svg", date(2022, 3, 3), [before], EMPTY)


def test_a_background_is_taken_away_once_and_also_where_decibels_were_published(tmp_path: Path) -> None:
    raw, over, lifted = (tmp_path / f"{name}.svg" for name in ("raw", "over", "lifted"))
    write_day_svg(raw, DAY, [day()], EMPTY)
    write_day_svg(over, DAY, [over_background(day())], EMPTY)
    assert (levels(raw) == levels(over)).all()
    higher = over_background(day()).drop_vars("noise_db")
    higher["intensity"] += 3.0
    write_day_svg(lifted, DAY, [higher], EMPTY)
    dark = [((levels(path) < 12).sum() / (levels(path) < 63).sum()) for path in (over, lifted)]
    assert dark[1] > 0.8 * dark[0] > 0.0, "three decibels everywhere are background"


@pytest.mark.parametrize("cadence_s", [7, 60, 240])
def test_a_whole_day_is_a_small_file_with_gaps_where_there_is_no_data(tmp_path: Path, cadence_s: int) -> None:
    count = 86_400 // cadence_s
    level = np.random.default_rng(2).normal(0.0, 1.0, (count, 150)).astype(np.float32)
    level[count // 4 : count // 2] = np.nan
    time = np.datetime64(DAY, "ns") + np.arange(count) * np.timedelta64(cadence_s, "s")
    fine = xr.Dataset(
        {"intensity": (("time", "frequency"), level)},
        coords={"time": time, "frequency": np.geomspace(0.02, 16.0, 150)},
        attrs=day().attrs | {"quantity": "db_over_background"},
    )
    write_day_svg(tmp_path / "day.svg", DAY, [fine], EMPTY)
    assert (tmp_path / "day.svg").stat().st_size < 90_000
    empty = (levels(tmp_path / "day.svg") == 63).all(axis=0)
    assert empty[190:350].all()
    assert not empty[:170].any()
    assert not empty[370:].any()


def test_what_cannot_be_drawn_leaves_the_figure_before_it(tmp_path: Path) -> None:
    path = tmp_path / "day.svg"
    write_day_svg(path, DAY, [day()], EMPTY)
    before = path.read_bytes()

    with pytest.raises(InputError, match="counts"):
        write_day_svg(path, DAY, [day(quantity="counts")], EMPTY)
    with pytest.raises(InputError, match="score"):
        write_day_svg(path, DAY, [day()], EMPTY.drop(columns="score"))

    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_a_thousand_onsets_are_all_there_and_hide_no_spectrum(tmp_path: Path) -> None:
    few, many = tmp_path / "few.svg", tmp_path / "many.svg"
    times = pd.date_range("2022-03-01T00:10", periods=1000, freq="80s")
    tiers = ["localisable", "catalogued", "rejected", "localisable"] * 250
    table = pd.concat(
        [found("SOLO", "01 01:00", tier, f"T3-{n}") for n, tier in enumerate(tiers)], ignore_index=True
    ).assign(start_utc=times, end_utc=times + pd.Timedelta(seconds=60))
    write_day_svg(few, DAY, [day()], table.iloc[:1])
    write_day_svg(many, DAY, [day()], table)
    assert many.stat().st_size < few.stat().st_size + 50_000
    paths = {one.get("class"): one.get("d") for one in of_class(parsed(many.read_text()), "box")}
    counts = {name: drawn.count("M") for name, drawn in paths.items()}
    assert counts == {"box localised": 500, "box burst": 250, "box rejected": 250}
    (rect,) = of_class(parsed(few.read_text()), "box")
    assert paths["box localised"].startswith(f"M{rect.get('x')} ")
    assert paths["box localised"].count("v8") == 500
    assert float(rect.get("height")) > 5 * 8


def hour_labels(root: Any) -> dict[str, float]:
    """Places of the labels of the time axis."""
    (group,) = of_class(root, "hours")
    return {str(one.text): float(one.get("x")) for one in group.iter(f"{SVG}text")}


def test_a_part_of_a_day_shows_its_hours_over_the_whole_width() -> None:
    table = pd.concat([found("SOLO", "01 03:00"), found("SOLO", "01 07:30", burst_id="T3-y")])
    whole = day_figure(DAY, [day(), day(observatory="PSP")], table)
    root = parsed(zoomed_day(whole, 6 * 3600.0, 9 * 3600.0))
    for pane in of_class(root, "pane"):
        left, top, width, height = (float(one) for one in pane.get("viewBox").split())
        assert (top, height) == (float(pane.get("y")), float(pane.get("height")))
        per_day = WIDTH - LEFT - RIGHT
        assert left == pytest.approx(LEFT + per_day / 4, abs=0.1)
        assert width == pytest.approx(per_day / 8, abs=0.1)
        assert pane.get("preserveAspectRatio") == "none"
    assert texts(root, "onset-label") == ["07:30"], "that of 03:00 is not in this part"
    assert float(of_class(root, "onset-label")[0].get("x")) == pytest.approx((LEFT + WIDTH - RIGHT) / 2, abs=0.5)
    labels = hour_labels(root)
    assert labels["06:00"] == pytest.approx(LEFT)
    assert labels["07:30"] == pytest.approx((LEFT + WIDTH - RIGHT) / 2, abs=0.1)
    assert labels["09:00"] == pytest.approx(WIDTH - RIGHT)
    (drawn,) = of_class(root, "figure day")
    assert drawn.get("data-time") == "21600,32400"


def test_a_whole_day_ends_at_24() -> None:
    labels = hour_labels(parsed(day_figure(DAY, [day()], EMPTY)))
    assert (labels["00:00"], labels["24:00"]) == (LEFT, WIDTH - RIGHT)
    assert labels["12:00"] == pytest.approx((LEFT + WIDTH - RIGHT) / 2)
