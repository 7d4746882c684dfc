"""The spectra show what was measured, and the edges where they were timed."""

import base64
import io
from xml.etree import ElementTree as ET

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from PIL import Image

from bella.plotting import SpectraView, spectra_figure
from bella.plotting.spectra import MAX_CHANNELS, MAX_RECORDS, burst_panels, timed_edges
from tests.plotting.reading import SVG, of_class, parsed, points, texts
from tests.plotting.synthetic import REFERENCE, synthetic_posterior, synthetic_spectra

EDGES = ("gauss_hermite", "half_maximum")
START_S = np.datetime64(REFERENCE.removesuffix("Z")).astype("datetime64[s]").astype(float)


@pytest.fixture(scope="module")
def figure() -> ET.Element:
    return drawn(SpectraView())


def drawn(look: SpectraView) -> ET.Element:
    return parsed(spectra_figure(synthetic_spectra(), {edge: synthetic_posterior(edge) for edge in EDGES}, look))


def listed(root: ET.Element, name: str) -> list[float]:
    return [float(one) for one in root.get(f"data-{name}", "").split(",")]


def times_of(root: ET.Element, line: ET.Element) -> np.ndarray:
    """Seconds since 1970 of the corners of a line, by what the figure says of itself."""
    (left, right), (first, last) = listed(root, "across"), listed(root, "time")
    return first + (points(line)[:, 0] - left) / (right - left) * (last - first)


def frequencies_of(root: ET.Element, line: ET.Element, row: int) -> np.ndarray:
    low, high = listed(root, "band")
    return high * (low / high) ** (
        (points(line)[:, 1] - listed(root, "tops")[row]) / float(root.get("data-height", ""))
    )


def picture(root: ET.Element, row: int) -> np.ndarray:
    """Levels of the picture of a panel; 63 is no data."""
    images = root.findall(f".//{SVG}image")
    data = images[row].get("href", "").partition(",")[2]
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(data))))


def test_there_is_a_panel_for_each_spacecraft_from_top_to_bottom(figure: ET.Element) -> None:
    assert texts(figure, "panel-name") == ["WIND", "STEREO-A", "STEREO-B"]
    assert figure.get("data-names") == "WIND,STEREO-A,STEREO-B"
    assert listed(figure, "tops") == sorted(listed(figure, "tops"))
    assert len(figure.findall(f".//{SVG}image")) == 3
    assert len(of_class(figure, "edge-line")) == 6


def test_edges_stand_at_their_arrival_times(figure: ET.Element) -> None:
    posterior = synthetic_posterior("gauss_hermite")
    line = of_class(figure, "edge-line edge-gauss_hermite")[0]
    expected = np.interp(
        frequencies_of(figure, line, 0), posterior["frequency"], posterior["arrival_s"].sel(observatory="WIND")
    )
    np.testing.assert_allclose(times_of(figure, line) - START_S, expected, atol=4.0)  # a pixel is some seconds


def test_a_shifted_spectrum_takes_its_edges_with_it(figure: ET.Element) -> None:
    shifted = drawn(SpectraView(clock="sun", shift_s={"WIND": -500.0}))
    for row, seconds in ((0, -500.0), (1, 0.0)):
        before, after = (of_class(one, "edge-line edge-gauss_hermite")[row] for one in (figure, shifted))
        moved = times_of(shifted, after) - times_of(figure, before)
        np.testing.assert_allclose(moved, seconds, atol=8.0)
    assert "less the light time" in texts(shifted, "axis-name")[0]


def test_brightness_is_where_the_burst_was(figure: ET.Element) -> None:
    levels = picture(figure, 0).astype(float)
    (first, last), (low, high) = listed(figure, "time"), listed(figure, "band")
    posterior = synthetic_posterior("gauss_hermite").sel(observatory="WIND")
    row = levels.shape[0] // 2
    frequency = high * (low / high) ** ((row + 0.5) / levels.shape[0])
    edge = START_S + np.interp(frequency, posterior["frequency"], posterior["arrival_s"])
    column = int((edge - first) / (last - first) * levels.shape[1])
    assert levels[row, column + 10 : column + 40].mean() > 3 * max(levels[row, : column - 30].mean(), 1.0)


def test_zoom_shows_the_time_and_the_band_that_are_asked_for() -> None:
    look = SpectraView(span_s=(START_S + 600, START_S + 900), band_mhz=(0.4, 0.8), frequency_mhz=0.5)
    root = drawn(look)
    assert listed(root, "time") == pytest.approx([START_S + 600, START_S + 900])
    assert listed(root, "band") == pytest.approx([0.4, 0.8])
    marks = [float(one.get("y1", "")) for one in of_class(root, "frequency")]
    share = (marks[0] - listed(root, "tops")[0]) / float(root.get("data-height", ""))
    assert 0.8 * 0.5**share == pytest.approx(0.5, rel=0.01)


def test_an_arrival_table_gives_the_same_edges_as_the_posterior() -> None:
    posterior = synthetic_posterior()
    start = pd.Timestamp(REFERENCE).tz_localize(None)
    stacked = posterior[["arrival_s", "sigma_s"]].to_dataframe().reset_index()
    table = pd.DataFrame(
        {
            "observatory": stacked["observatory"],
            "frequency_mhz": stacked["frequency"],
            "arrival_utc": start + pd.to_timedelta(stacked["arrival_s"], unit="s"),
            "sigma_s": stacked["sigma_s"],
        }
    ).sample(frac=1.0, random_state=2)
    given, found = timed_edges(posterior), timed_edges(table)
    assert set(given) == set(found)
    for name, edge in given.items():
        np.testing.assert_allclose(found[name].frequency_mhz, edge.frequency_mhz)
        assert np.abs(found[name].time - edge.time).max() < np.timedelta64(1, "us")


def test_channels_that_were_not_heard_have_no_edge() -> None:
    posterior = synthetic_posterior().copy(deep=True)
    posterior["arrival_s"][:20, 0] = np.nan
    assert len(timed_edges(posterior)["WIND"].time) == 180
    assert len(timed_edges(posterior)["STEREO-A"].time) == 200


def test_a_long_spectrum_is_thinned_without_losing_its_peak() -> None:
    time = np.datetime64("2012-06-07", "ns") + np.arange(5000) * np.timedelta64(10, "s")
    intensity = np.zeros((5000, 700), np.float32)
    intensity[1234, 345] = 7.0
    spectrum = xr.Dataset(
        {"intensity": (("time", "frequency"), intensity)},
        {"time": time, "frequency": np.geomspace(0.1, 16, 700)},
        {"quantity": "db_over_background"},
    )
    (panel,) = burst_panels(xr.DataTree.from_dict({"/SOLO": spectrum}))
    assert panel.time.size <= MAX_RECORDS
    assert panel.frequency_mhz.size <= MAX_CHANNELS
    assert np.max(panel.intensity) == 7.0


def test_no_data_is_clear() -> None:
    spectra = synthetic_spectra().copy(deep=True)
    whole = parsed(spectra_figure(spectra, {}, SpectraView()))
    spectra["WIND"]["intensity"][10:20] = np.nan
    gap = parsed(spectra_figure(spectra, {}, SpectraView()))
    count = [int((picture(one, 0) == 63).sum()) for one in (whole, gap)]
    assert count[1] > count[0] + 500
    assert (picture(gap, 1) == picture(whole, 1)).all()


def test_tiny_fluxes_keep_their_shades() -> None:
    spectra = synthetic_spectra()["WIND"].to_dataset()
    spectra["intensity"] = spectra["intensity"] * 1e-18
    root = parsed(spectra_figure(xr.DataTree.from_dict({"/WIND": spectra}), {}, SpectraView()))
    assert len(np.unique(picture(root, 0))) > 30


def test_an_empty_tree_is_an_empty_figure() -> None:
    root = parsed(spectra_figure(xr.DataTree(), {}, SpectraView()))
    assert texts(root, "panel-name") == []
