"""The spectra show what was measured, and the edges where they were timed."""

import json
from typing import Any

import numpy as np
import pandas as pd
import plotly.graph_objects as go
import pytest
import xarray as xr

from bella.plotting import spectra_figure
from bella.plotting.spectra import MAX_CHANNELS, MAX_RECORDS, timed_edges
from tests.plotting.synthetic import REFERENCE, synthetic_posterior, synthetic_spectra

EDGES = ("gauss_hermite", "half_maximum")


@pytest.fixture(scope="module")
def figure() -> dict[str, Any]:
    return spectra_figure(synthetic_spectra(), {edge: synthetic_posterior(edge) for edge in EDGES})


def role(figure: dict[str, Any], name: str) -> list[dict[str, Any]]:
    return [trace for trace in figure["data"] if trace["meta"]["role"] == name]


def test_it_is_a_plotly_figure_that_any_json_reader_takes(figure: dict[str, Any]) -> None:
    text = json.dumps(figure, allow_nan=False)
    assert len(text) < 200_000
    assert len(go.Figure(json.loads(text)).data) == 3 + 2 * 3


def test_panels_share_time_and_frequency(figure: dict[str, Any]) -> None:
    panels = role(figure, "spectrum")
    assert [panel["name"] for panel in panels] == ["WIND", "STEREO-A", "STEREO-B"]
    assert [panel["yaxis"] for panel in panels] == ["y", "y2", "y3"]
    assert {panel["xaxis"] for panel in panels} == {"x"}
    layout = figure["layout"]
    assert layout["yaxis2"]["matches"] == layout["yaxis3"]["matches"] == "y"
    assert {layout[axis]["type"] for axis in ("yaxis", "yaxis2", "yaxis3")} == {"log"}
    domains = [layout[axis]["domain"] for axis in ("yaxis3", "yaxis2", "yaxis")]
    assert [end for domain in domains for end in domain] == sorted(end for domain in domains for end in domain)


def test_intensity_is_frequency_by_time(figure: dict[str, Any]) -> None:
    for panel in role(figure, "spectrum"):
        assert np.shape(panel["z"]) == (len(panel["y"]), len(panel["x"]))
        assert panel["zmin"] < panel["zmax"]


def test_each_edge_is_drawn_in_each_panel_and_once_in_the_legend(figure: dict[str, Any]) -> None:
    edges = role(figure, "edge")
    assert sorted((edge["legendgroup"], edge["yaxis"]) for edge in edges) == sorted(
        (name, axis) for name in EDGES for axis in ("y", "y2", "y3")
    )
    assert [edge["legendgroup"] for edge in edges if edge["showlegend"]] == list(EDGES)


def test_edges_stand_at_their_arrival_times(figure: dict[str, Any]) -> None:
    posterior = synthetic_posterior("gauss_hermite")
    drawn = next(edge for edge in role(figure, "edge") if edge["yaxis"] == "y")
    late = (np.array(drawn["x"], "datetime64[ms]") - np.datetime64(REFERENCE.removesuffix("Z"))) / np.timedelta64(
        1, "s"
    )
    expected = np.interp(drawn["y"], posterior["frequency"], posterior["arrival_s"].sel(observatory="WIND"))
    np.testing.assert_allclose(late, expected, atol=0.05)
    assert set(drawn["customdata"]) == {30.0}


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
    (panel,) = role(spectra_figure(xr.DataTree.from_dict({"/SOLO": spectrum}), {}), "spectrum")
    assert len(panel["x"]) <= MAX_RECORDS
    assert len(panel["y"]) <= MAX_CHANNELS
    assert np.max(panel["z"]) == 7.0


def test_no_data_is_none() -> None:
    spectra = synthetic_spectra().copy(deep=True)
    spectra["WIND"]["intensity"][3, 2] = np.nan
    figure = spectra_figure(spectra, {})
    json.dumps(figure, allow_nan=False)
    assert role(figure, "spectrum")[0]["z"][2][3] is None


def test_tiny_fluxes_keep_their_digits() -> None:
    spectra = synthetic_spectra()["WIND"].to_dataset()
    spectra["intensity"] = spectra["intensity"] * 1e-18
    (panel,) = role(spectra_figure(xr.DataTree.from_dict({"/WIND": spectra}), {}), "spectrum")
    assert 0 < np.max(panel["z"]) < 1e-17
    assert len(np.unique(panel["z"])) > 100


def test_an_empty_tree_is_an_empty_figure() -> None:
    figure = spectra_figure(xr.DataTree(), {})
    assert figure["data"] == []
    go.Figure(figure)
