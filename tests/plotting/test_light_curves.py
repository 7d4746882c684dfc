"""Light curves with their edges: each in its place, and honest about what is missing."""

from xml.etree import ElementTree as ET

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from bella.bursts import spectrum_edges
from bella.exceptions import InputError
from bella.plotting import light_curves_figure, shared_profile_figure
from bella.plotting.light_curves import (
    BEFORE_SHARE,
    GAP_X,
    GAP_Y,
    LEFT,
    PANEL_HEIGHT,
    PANEL_WIDTH,
    PROFILE_HEIGHT,
    TOP,
    steps,
)
from bella.plotting.svg import Scale
from bella.simulation import Receiver, SimulatedBurst, observe
from tests.plotting.reading import SVG, of_class, parsed, points, texts
from tests.plotting.synthetic import synthetic_samples

RELEASE = np.datetime64("2012-06-07T19:20:00", "ns")
CHANNELS_MHZ = np.geomspace(0.2, 4.0, 30)
ROWS_MHZ = [2.0, 0.5]


def observed() -> dict[str, xr.Dataset]:
    """A burst at two spacecraft whose receivers sweep differently."""
    burst = SimulatedBurst(RELEASE, density_factor=4.0)
    ends = RELEASE + np.array([-10, 80]) * np.timedelta64(60, "s")
    sweeps = {"WIND": (60.0, np.zeros(30)), "STEREO-A": (38.0, np.linspace(-17.0, 17.0, 30))}
    return {
        name: observe(
            Receiver(name, "HFR", CHANNELS_MHZ, cadence, 1.0, offset, 0.02), [burst], *ends, np.random.default_rng(4)
        )
        for name, (cadence, offset) in sweeps.items()
    }


SPECTRA = observed()
ARRIVALS = pd.concat([spectrum_edges(one, "half_maximum") for one in SPECTRA.values()], ignore_index=True)


def drawn(table: pd.DataFrame = ARRIVALS, rows: list[float] | None = None, **spectra: xr.Dataset) -> ET.Element:
    return parsed(light_curves_figure(SPECTRA | spectra, table, rows or ROWS_MHZ))


def lines(root: ET.Element) -> list[ET.Element]:
    """Edges in their panels, not those of the key."""
    return [one.find(f"{SVG}line") for one in root.findall(f"{SVG}g")]


def row_of(name: str, frequency_mhz: float, table: pd.DataFrame = ARRIVALS) -> pd.Series:
    own = table[table["observatory"] == name]
    return own.iloc[int(np.abs(np.log(own["frequency_mhz"] / frequency_mhz)).to_numpy().argmin())]


def test_a_row_per_frequency_and_a_column_per_spacecraft() -> None:
    root = drawn()
    assert texts(root, "panel-name") == ["2 MHz", "0.5 MHz", "WIND", "STEREO-A"]
    frames = [(float(one.get("x")), float(one.get("y"))) for one in of_class(root, "frame")]
    across = [LEFT, LEFT + PANEL_WIDTH + GAP_X]
    assert frames == [(x, y) for y in (TOP, TOP + PANEL_HEIGHT + GAP_Y) for x in across]
    assert len(of_class(root, "light-curve")) == 4


def test_the_light_curve_crosses_one_half_at_its_half_maximum_edge() -> None:
    root = drawn()
    for curve, edge, middle in zip(
        of_class(root, "light-curve"), lines(root), of_class(root, "gridline dashed"), strict=True
    ):
        corners, x = points(curve), float(edge.get("x1"))
        centres = corners.reshape(-1, 2, 2).mean(axis=1) if len(corners) % 2 == 0 else None
        if centres is None:
            centres = corners[1:].reshape(-1, 2, 2).mean(axis=1)
        assert np.interp(x, centres[:, 0], centres[:, 1]) == pytest.approx(float(middle.get("y1")), abs=12.0)
        assert corners[:, 1].min() == pytest.approx(float(edge.get("y1")) + PANEL_HEIGHT * 0.14 / 1.2, abs=0.2)


def test_each_sample_lasts_from_half_way_to_half_way() -> None:
    across, upward = Scale(0.0, 30.0, 0.0, 300.0), Scale(0.0, 1.0, 100.0, 0.0)
    held = steps(np.array([0.0, 10.0, 20.0]), np.array([0.1, 0.5, 1.0]), across, upward)
    np.testing.assert_allclose(held[:, 0], [0, 50, 50, 150, 150, 200])
    np.testing.assert_allclose(held[:, 1], [90, 90, 50, 50, 0, 0])


def test_samples_are_where_the_sweep_took_them() -> None:
    late = SPECTRA["STEREO-A"].copy()
    late["sample_offset_s"] = ("frequency", np.full(30, 60.0))
    early, moved = (
        points(of_class(drawn(rows=[0.5], **{"STEREO-A": one}), "light-curve")[1])
        for one in (late.assign(sample_offset_s=("frequency", np.full(30, 0.0))), late)
    )
    per_s = PANEL_WIDTH / (240.0 + 420.0 / 0.5)
    first = [one[:, 0][one[:, 1] < one[:, 1].max() - 50][0] for one in (early, moved)]
    assert first[1] - first[0] == pytest.approx(60.0 * per_s, abs=0.3)


def test_the_band_is_one_sigma_to_either_side_and_the_text_says_so() -> None:
    root = drawn(rows=[0.5])
    row, band, edge = row_of("WIND", 0.507), of_class(root, "sigma")[0], lines(root)[0]
    per_s = PANEL_WIDTH / (240.0 + 420.0 / 0.5)
    assert float(band.get("width")) == pytest.approx(2 * row["sigma_s"] * per_s, abs=0.2)
    assert float(band.get("x")) + float(band.get("width")) / 2 == pytest.approx(float(edge.get("x1")), abs=0.2)
    assert texts(root, "edge-said")[0] == f"{row['arrival_utc'].round('s'):%H:%M:%S} ± {row['sigma_s']:.0f} s"


def test_panels_of_a_row_begin_as_much_before_their_edges() -> None:
    for edge, frame in zip(lines(drawn()), of_class(drawn(), "frame"), strict=True):
        assert float(edge.get("x1")) - float(frame.get("x")) == pytest.approx(BEFORE_SHARE * PANEL_WIDTH, abs=0.2)


def test_times_of_the_axis_are_those_of_the_synthetic_samples() -> None:
    root = drawn(rows=[0.5])
    said = [(float(one.get("x")), one.text) for one in of_class(root, "tick") if ":" in (one.text or "")]
    row, edge = row_of("WIND", 0.507), lines(root)[0]
    per_s = PANEL_WIDTH / (240.0 + 420.0 / 0.5)
    for x, text in said[:2]:
        moment = pd.Timestamp(f"2012-06-07T{text}")
        apart = (moment - row["arrival_utc"].tz_localize(None)).total_seconds()
        assert x - float(edge.get("x1")) == pytest.approx(apart * per_s, abs=0.3)
    assert texts(root, "axis-name") == ["Power over its maximum against UTC, 2012-06-07"]


def test_flagged_edges_are_grey_and_named_and_every_definition_has_its_colour() -> None:
    other = ARRIVALS.assign(edge="gauss_hermite", flag="bad_arrival")
    root = drawn(pd.concat([ARRIVALS, other]), [0.5])
    assert [one.get("class") for one in lines(root)[:2]] == ["edge edge-half_maximum", "edge flagged"]
    assert texts(root, "edge-said")[1].endswith("s, bad arrival")
    titles = [one.find(f"{SVG}title").text for one in root.findall(f"{SVG}g")]
    assert titles[:2] == ["Half-maximum edge", "Gauss-Hermite edge, flagged"]
    assert {"Half-maximum edge", "Gauss-Hermite edge"} <= set(texts(root, "tick"))


def test_a_channel_without_an_edge_says_why_and_is_drawn_around_the_edge_of_the_others() -> None:
    lost = ARRIVALS.copy()
    at_wind = lost["observatory"] == "WIND"
    lost.loc[at_wind, ["arrival_utc", "sigma_s", "flag"]] = [pd.NaT, np.nan, "no_flank"]
    root = drawn(lost, [0.5])
    assert len(lines(root)) == 1
    assert texts(root, "edge-said")[0] == "no flank"
    ticks = [one.text for one in of_class(root, "tick") if ":" in (one.text or "")]
    assert ticks[: len(ticks) // 2] == ticks[len(ticks) // 2 :]


def test_what_a_spacecraft_does_not_receive_is_left_empty() -> None:
    known = SPECTRA["WIND"].assign(interpolated=("frequency", CHANNELS_MHZ > 1.0))
    root = drawn(rows=[2.0, 14.0], WIND=known)
    empty = [one for one in texts(root, "tick") if one.startswith("no channel")]
    assert empty == ["no channel near 2 MHz", "no channel near 14 MHz", "no channel near 14 MHz"]
    assert len(of_class(root, "light-curve")) == 1


@pytest.mark.parametrize("case", ["no arrivals", "no data", "one spacecraft", "edges elsewhere"])
def test_odd_input_is_drawn(case: str) -> None:
    given, table, curves = dict(SPECTRA), ARRIVALS.copy(), 4
    if case == "no arrivals":
        table = table.iloc[:0]
    elif case == "no data":
        given = {name: one.assign(intensity=one["intensity"] * np.nan) for name, one in given.items()}
        curves = 0
    elif case == "one spacecraft":
        given, curves = {"WIND": given["WIND"]}, 2
    else:
        table["arrival_utc"] += pd.Timedelta(days=3)
    root = parsed(light_curves_figure(given, table, ROWS_MHZ))
    assert len(of_class(root, "light-curve")) == curves
    assert texts(root, "tick").count("no data") == (4 if case == "no data" else 0)
    for curve in of_class(root, "light-curve"):
        assert np.ptp(points(curve)[:, 1]) > 50, "drawn around its maximum where no edge is in its time"


def test_what_is_missing_is_named() -> None:
    with pytest.raises(InputError, match="no light curve"):
        light_curves_figure({}, ARRIVALS, ROWS_MHZ)
    with pytest.raises(InputError, match="no light curve"):
        light_curves_figure(SPECTRA, ARRIVALS, [])
    with pytest.raises(InputError, match="arrival table has no column 'sigma_s'"):
        light_curves_figure(SPECTRA, ARRIVALS.drop(columns="sigma_s"), ROWS_MHZ)


def placed(path: ET.Element) -> np.ndarray:
    """Where the marks of a path begin."""
    return np.array(
        [[float(n) for n in one.split("h")[0].split("m")[0].split()] for one in path.get("d").split("M")[1:]]
    )


def test_samples_are_in_the_band_of_their_frequency_and_their_residuals_below() -> None:
    root = parsed(shared_profile_figure(synthetic_samples()))
    assert len(texts(root, "panel-name")) == 4
    paths = [one for one in of_class(root, "samples s0")[:-1] if one.get("d")]
    assert len(paths) == 4  # the highest and the lowest band, height and residual
    high, residual = placed(paths[0]), placed(paths[1])
    assert len(high) == 3, "what is outside of the panel is left out"
    assert (high[:, 0] < LEFT + PANEL_WIDTH).all()
    assert (placed(paths[2])[:, 0] > LEFT + 3 * PANEL_WIDTH).all()
    middle = LEFT + PANEL_WIDTH * 4.0 / 7.5
    assert high[1, 0] == pytest.approx(middle, abs=0.1)
    assert high[0, 1] > high[1, 1] > high[2, 1]
    assert (high[:, 1] < TOP + PROFILE_HEIGHT).all()
    assert np.ptp(residual[:, 1]) < 0.11
    off = placed(next(one for one in of_class(root, "samples s1")[1:] if one.get("d")))
    assert off[0, 1] < residual[0, 1], "above the profile is up"


def test_without_samples_there_is_no_profile() -> None:
    with pytest.raises(InputError, match="fit a shared profile first"):
        shared_profile_figure(synthetic_samples().iloc[:0])
    with pytest.raises(InputError, match="no column 'widths'"):
        shared_profile_figure(synthetic_samples().drop(columns="widths"))
