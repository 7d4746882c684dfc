"""Spectra on the clock of the Sun: what left the Sun together is drawn together."""

from pathlib import Path

import matplotlib.image
import numpy as np
import pandas as pd
import pytest
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import to_hex
from matplotlib.container import ErrorbarContainer
from matplotlib.dates import date2num
from matplotlib.figure import Figure

from bella.exceptions import InputError
from bella.plotting import write_aligned_png
from bella.plotting.aligned import EVOLUTION, FLAGGED, MOST_EDGES, _aligned_figure, _on_sun_clock

RELEASE = np.datetime64("2012-06-07T19:20:00", "ns")
LIGHT_S = {"WIND": 500.0, "STEREO-A": 480.0, "SOLO": 180.0}
CHANNELS_MHZ = np.geomspace(0.2, 8.0, 60)


def heard_utc(observatory: str, frequency_mhz: np.ndarray) -> np.ndarray:
    """From a source at the Sun: as late as light needs."""
    after_s = 300.0 / frequency_mhz + LIGHT_S[observatory]
    return RELEASE + np.rint(after_s * 1e9).astype("timedelta64[ns]")


def spectrum(observatory: str) -> xr.Dataset:
    seconds = np.arange(-900.0, 5400.0, 30.0)
    late = seconds[:, None] - (heard_utc(observatory, CHANNELS_MHZ) - RELEASE) / np.timedelta64(1, "s")
    burst = 20.0 * np.where(late > 0, np.exp(-late / 300.0), 0.0)
    noise = np.random.default_rng(len(observatory)).normal(0.0, 0.2, burst.shape)
    attributes = {"observatory": observatory, "receiver": "simulated", "quantity": "db_over_background"}
    return xr.Dataset(
        {"intensity": (("time", "frequency"), (burst + noise).astype(np.float32))},
        coords={"time": RELEASE + (seconds * 1e9).astype("timedelta64[ns]"), "frequency": CHANNELS_MHZ},
        attrs=attributes | {"integration_s": 30.0, "source_files": "none"},
    )


def spectra() -> dict[str, xr.Dataset]:
    return {name: spectrum(name) for name in LIGHT_S}


def arrivals(frequency_mhz: np.ndarray = CHANNELS_MHZ[::6]) -> pd.DataFrame:
    parts = [
        pd.DataFrame(
            {
                "observatory": name,
                "frequency_mhz": frequency_mhz,
                "arrival_utc": heard_utc(name, frequency_mhz),
                "sigma_s": 20.0,
                "edge": "half_maximum",
                "flag": ["bad_arrival"] + [""] * (len(frequency_mhz) - 1),
            }
        )
        for name in LIGHT_S
    ]
    return pd.concat(parts, ignore_index=True)


def evolution() -> pd.DataFrame:
    return arrivals(np.geomspace(0.2, 8.0, 40)).drop(columns=["edge", "flag"])


def drawn(spectra_: dict[str, xr.Dataset], table: pd.DataFrame, curve: pd.DataFrame | None = None) -> Figure:
    curve = evolution().iloc[:0] if curve is None else curve
    return _aligned_figure(_on_sun_clock(spectra_, table, LIGHT_S, curve))


def markers(axes: Axes, label: str) -> ErrorbarContainer:
    (bars,) = [one for one in axes.containers if isinstance(one, ErrorbarContainer) and one.get_label() == label]
    return bars


def test_edges_of_a_source_at_the_sun_are_below_one_another() -> None:
    figure = drawn(spectra(), arrivals())
    places = [markers(axes, "Half-maximum edge").lines[0].get_xdata() for axes in figure.axes]

    assert [axes.get_title("left") for axes in figure.axes] == list(LIGHT_S)
    expected = date2num(RELEASE) + 300.0 / CHANNELS_MHZ[::6][1:] / 86400.0
    for place in places:
        np.testing.assert_allclose(np.asarray(place, dtype=float), expected, atol=0.01 / 86400.0)


def test_spectra_are_as_early_as_their_edges() -> None:
    figure = drawn(spectra(), arrivals())
    for axes in figure.axes:
        (mesh,) = [child for child in axes.get_children() if isinstance(child, QuadMesh)]
        level = np.asarray(mesh.get_array())
        edges = np.asarray(mesh.get_coordinates())[0, :, 0]
        row = int(np.searchsorted(CHANNELS_MHZ, 0.5))
        brightest = edges[int(np.nanargmax(level[row]))]
        onset = date2num(RELEASE) + 300.0 / CHANNELS_MHZ[row] / 86400.0
        assert abs(brightest - onset) * 86400.0 < 61.0


def test_a_flux_without_its_background_is_dark_where_it_is_zero_and_not_empty() -> None:
    given = {name: one for name, one in spectra().items() if name == "WIND"}
    given["WIND"]["intensity"][:] = np.maximum(given["WIND"]["intensity"] - 1.0, 0.0)
    given["WIND"]["intensity"][60:62] = np.nan
    given["WIND"].attrs["quantity"] = "relative_flux"
    (mesh,) = [one for one in drawn(given, arrivals()).axes[0].get_children() if isinstance(one, QuadMesh)]
    level = np.ma.filled(np.ma.masked_invalid(mesh.get_array()), np.nan)

    assert np.nanmin(level) == 0.0
    assert np.isnan(level).all(axis=0).sum() == 2
    np.testing.assert_allclose(np.nanmax(level, axis=1), 18.0, atol=1e-4)


def test_bars_are_one_sigma_to_either_side_and_flagged_edges_hollow() -> None:
    axes = drawn(spectra(), arrivals()).axes[0]
    flagged, good = markers(axes, "Half-maximum edge, flagged"), markers(axes, "Half-maximum edge")
    (bars,) = good.lines[2]
    length_s = [np.ptp(segment[:, 0]) * 86400.0 for segment in bars.get_segments()]

    np.testing.assert_allclose(length_s, 40.0, atol=0.01)
    assert flagged.lines[0].get_markerfacecolor() == "none"
    assert to_hex(flagged.lines[0].get_color()) == FLAGGED
    assert len(np.atleast_1d(flagged.lines[0].get_xdata())) == 1
    assert good.lines[0].get_markerfacecolor() != "none"


def test_the_curve_is_drawn_where_there_is_one() -> None:
    figure = drawn(spectra(), arrivals(), evolution()[lambda table: table["observatory"] != "SOLO"])
    curves = [[line for line in axes.lines if line.get_label() == "t(f)"] for axes in figure.axes]

    assert [len(lines) for lines in curves] == [1, 1, 0]
    assert to_hex(curves[0][0].get_color()) == EVOLUTION.colour
    np.testing.assert_allclose(np.asarray(curves[0][0].get_ydata()), np.geomspace(0.2, 8.0, 40))


def test_the_window_is_around_the_edges_and_within_the_spectra() -> None:
    figure = drawn(spectra(), arrivals())
    left, right = (date2num(RELEASE) + np.array([300.0 / 8.0, 300.0 / 0.2]) / 86400.0).tolist()
    shown = figure.axes[0].get_xlim()

    assert left - 0.02 < shown[0] < left
    assert right < shown[1] < right + 0.02


def test_many_edges_are_thinned_over_the_whole_band() -> None:
    many = np.geomspace(0.2, 8.0, 700)
    frequency = np.asarray(markers(drawn(spectra(), arrivals(many)).axes[1], "Half-maximum edge").lines[0].get_ydata())

    assert MOST_EDGES - 5 <= frequency.size <= MOST_EDGES
    assert frequency.max() / frequency.min() > 39


@pytest.mark.parametrize("case", ["no arrivals", "no data", "one spacecraft", "edges elsewhere", "edges without time"])
def test_odd_input_is_drawn(tmp_path: Path, case: str) -> None:
    given, table = spectra(), arrivals()
    if case == "no arrivals":
        table = table.iloc[:0]
    elif case == "no data":
        given = {name: one.assign(intensity=one["intensity"] * np.nan) for name, one in given.items()}
    elif case == "one spacecraft":
        given = {"SOLO": given["SOLO"]}
    elif case == "edges elsewhere":
        table["arrival_utc"] += pd.Timedelta(days=3)
    else:
        table["arrival_utc"], table["sigma_s"] = pd.NaT, np.nan
    write_aligned_png(tmp_path / "new" / "aligned.png", given, table, LIGHT_S, evolution())

    assert [entry.name for entry in (tmp_path / "new").iterdir()] == ["aligned.png"]
    assert matplotlib.image.imread(tmp_path / "new" / "aligned.png").std() > 0.05


def test_the_day_is_that_of_what_is_shown() -> None:
    long = spectrum("WIND")
    time = np.concatenate([[RELEASE - np.timedelta64(1, "D")], long["time"].to_numpy()[1:]])
    axes = drawn({"WIND": long.assign_coords(time=time)}, arrivals()).axes[0]

    assert axes.get_xlabel().endswith("Sun, 2012-06-07")


def test_edges_elsewhere_do_not_move_the_window() -> None:
    late = arrivals().assign(arrival_utc=lambda table: table["arrival_utc"] + pd.Timedelta(days=3))
    left, right = drawn(spectra(), late).axes[0].get_xlim()

    assert (right - left) * 86400.0 == pytest.approx(6300.0 - 30.0 + 320.0)


def test_what_is_missing_is_named_and_leaves_no_file(tmp_path: Path) -> None:
    path = tmp_path / "aligned.png"
    with pytest.raises(InputError, match="no spectrum"):
        write_aligned_png(path, {}, arrivals(), LIGHT_S)
    with pytest.raises(InputError, match="light time from the Sun to SOLO"):
        write_aligned_png(path, spectra(), arrivals(), {"WIND": 500.0, "STEREO-A": 480.0})
    with pytest.raises(InputError, match="arrival table has no column 'flag'"):
        write_aligned_png(path, spectra(), arrivals().drop(columns="flag"), LIGHT_S)
    with pytest.raises(InputError, match="no column 'sigma_s'"):
        write_aligned_png(path, spectra(), arrivals(), LIGHT_S, evolution().drop(columns="sigma_s"))
    assert list(tmp_path.iterdir()) == []
