"""Light curves with their edges: each in its place, and honest about what is missing."""

from pathlib import Path

import matplotlib.image
import numpy as np
import pandas as pd
import pytest
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.dates import date2num
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from bella.bursts import spectrum_edges
from bella.exceptions import InputError
from bella.plotting import write_light_curves_png
from bella.plotting.light_curves import _light_curves_figure
from bella.plotting.palette import INK, track_style
from bella.plotting.printed import FLAGGED
from bella.simulation import Receiver, SimulatedBurst, observe

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


def panels(figure: Figure) -> np.ndarray:
    return np.array(figure.axes).reshape(-1, 2)


def curves(axes: Axes) -> list[Line2D]:
    return [line for line in axes.lines if line.get_drawstyle() == "steps-mid"]


def edges(axes: Axes) -> list[Line2D]:
    return [line for line in axes.lines if "edge" in str(line.get_label())]


def words(axes: Axes) -> list[str]:
    return [text.get_text() for text in axes.texts]


def test_a_row_per_frequency_and_a_column_per_spacecraft() -> None:
    places = panels(_light_curves_figure(SPECTRA, ARRIVALS, ROWS_MHZ))

    assert places.shape == (2, 2)
    assert [axes.get_title() for axes in places[0]] == ["WIND", "STEREO-A"]
    assert [axes.get_ylabel() for axes in places[:, 0]] == ["2 MHz", "0.5 MHz"]
    assert all(to_hex(curve.get_color()) == INK for axes in places.flat for curve in curves(axes))


def test_the_light_curve_crosses_one_half_at_its_half_maximum_edge() -> None:
    for axes in panels(_light_curves_figure(SPECTRA, ARRIVALS, ROWS_MHZ)).flat:
        (curve,), (edge,) = curves(axes), edges(axes)
        day, power = np.asarray(curve.get_xdata(), dtype=float), np.asarray(curve.get_ydata())
        at_edge = np.interp(float(np.asarray(edge.get_xdata())[0]), day, power)

        assert power.max() == pytest.approx(1.0)
        assert at_edge == pytest.approx(0.5, abs=1e-3)


def test_samples_are_where_the_sweep_took_them() -> None:
    axes = panels(_light_curves_figure(SPECTRA, ARRIVALS, [4.0]))[0, 1]
    record = date2num(SPECTRA["STEREO-A"]["time"].to_numpy()[0])
    late_s = (float(np.asarray(curves(axes)[0].get_xdata())[0]) - record) * 86400.0

    assert late_s == pytest.approx(17.0, abs=0.01)


def test_the_band_is_one_sigma_to_either_side_and_the_text_says_so() -> None:
    axes = panels(_light_curves_figure(SPECTRA, ARRIVALS, [0.5]))[0, 0]
    (band,) = axes.patches
    channel = CHANNELS_MHZ[int(np.abs(np.log(CHANNELS_MHZ / 0.5)).argmin())]
    row = ARRIVALS[(ARRIVALS["observatory"] == "WIND") & np.isclose(ARRIVALS["frequency_mhz"], channel)].iloc[0]

    assert row["sigma_s"] > 10.0
    assert band.get_width() * 86400.0 == pytest.approx(2 * row["sigma_s"], abs=0.01)
    assert words(axes) == [f"{row['arrival_utc'].round('s'):%H:%M:%S} ± {row['sigma_s']:.0f} s"]


def test_panels_of_a_row_are_as_long_and_begin_as_much_before_their_edges() -> None:
    for left, right in panels(_light_curves_figure(SPECTRA, ARRIVALS, ROWS_MHZ)):
        before = [float(np.asarray(edges(axes)[0].get_xdata())[0]) - axes.get_xlim()[0] for axes in (left, right)]

        assert np.ptp(left.get_xlim()) == pytest.approx(np.ptp(right.get_xlim()), rel=1e-6)
        assert before[0] == pytest.approx(before[1], rel=1e-6)
        assert len(left.get_xticks()) >= 3


def test_flagged_edges_are_grey_and_named_and_every_definition_has_its_colour() -> None:
    other = ARRIVALS.assign(edge="gauss_hermite", flag="bad_arrival")
    figure = _light_curves_figure(SPECTRA, pd.concat([ARRIVALS, other]), [0.5])
    good, flagged = edges(panels(figure)[0, 0])
    (legend,) = figure.legends

    assert to_hex(good.get_color()) == track_style("half_maximum", 0).colour
    assert (to_hex(flagged.get_color()), flagged.get_linestyle()) == (FLAGGED, "--")
    assert words(panels(figure)[0, 0])[1].endswith("s, bad arrival")
    assert [text.get_text() for text in legend.get_texts()] == ["Half-maximum edge", "Gauss-Hermite edge, flagged"]


def test_a_channel_without_an_edge_says_why_and_is_drawn_around_the_edge_of_the_others() -> None:
    lost = ARRIVALS.copy()
    at_wind = lost["observatory"] == "WIND"
    lost.loc[at_wind, ["arrival_utc", "sigma_s", "flag"]] = [pd.NaT, np.nan, "no_flank"]
    left, right = panels(_light_curves_figure(SPECTRA, lost, [0.5]))[0]

    assert edges(left) == []
    assert words(left) == ["no flank"]
    assert left.get_xlim() == pytest.approx(right.get_xlim())


def test_what_a_spacecraft_does_not_receive_is_left_empty() -> None:
    known = SPECTRA["WIND"].assign(interpolated=("frequency", CHANNELS_MHZ > 1.0))
    places = panels(_light_curves_figure(SPECTRA | {"WIND": known}, ARRIVALS, [2.0, 14.0]))

    assert words(places[0, 0]) == ["no channel near 2 MHz"]
    assert len(curves(places[0, 1])) == 1
    assert [words(axes) for axes in places[1]] == [["no channel near 14 MHz"]] * 2


@pytest.mark.parametrize("case", ["no arrivals", "no data", "one spacecraft", "edges elsewhere"])
def test_odd_input_is_drawn(tmp_path: Path, case: str) -> None:
    given, table = dict(SPECTRA), ARRIVALS.copy()
    if case == "no arrivals":
        table = table.iloc[:0]
    elif case == "no data":
        given = {name: one.assign(intensity=one["intensity"] * np.nan) for name, one in given.items()}
    elif case == "one spacecraft":
        given = {"WIND": given["WIND"]}
    else:
        table["arrival_utc"] += pd.Timedelta(days=3)
    write_light_curves_png(tmp_path / "new" / "curves.png", given, table, ROWS_MHZ)

    assert [entry.name for entry in (tmp_path / "new").iterdir()] == ["curves.png"]
    assert matplotlib.image.imread(tmp_path / "new" / "curves.png")[..., :3].min() < 0.3


def test_without_an_edge_in_its_time_a_light_curve_is_drawn_around_its_maximum() -> None:
    late = ARRIVALS.assign(arrival_utc=ARRIVALS["arrival_utc"] + pd.Timedelta(days=3))
    for axes in panels(_light_curves_figure(SPECTRA, late, ROWS_MHZ)).flat:
        (curve,) = curves(axes)
        brightest = np.asarray(curve.get_xdata(), dtype=float)[int(np.asarray(curve.get_ydata()).argmax())]
        assert axes.get_xlim()[0] < brightest < axes.get_xlim()[1]


def test_what_is_missing_is_named_and_leaves_no_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no light curve"):
        write_light_curves_png(tmp_path / "curves.png", {}, ARRIVALS, ROWS_MHZ)
    with pytest.raises(InputError, match="no light curve"):
        write_light_curves_png(tmp_path / "curves.png", SPECTRA, ARRIVALS, [])
    with pytest.raises(InputError, match="arrival table has no column 'sigma_s'"):
        write_light_curves_png(tmp_path / "curves.png", SPECTRA, ARRIVALS.drop(columns="sigma_s"), ROWS_MHZ)
    assert list(tmp_path.iterdir()) == []
