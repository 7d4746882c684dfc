"""One dynamic spectrum as a PNG: what a spacecraft received, in dB over the background, as for a look at a day."""

from pathlib import Path

import numpy as np
import numpy.typing as npt
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, PowerNorm
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter

from bella.plotting.palette import BRIGHTNESS_SCALE, FREQUENCY_TICKS_MHZ
from bella.plotting.printed import save_png
from bella.spectra import over_background
from bella.units import FloatArray

MOST_RECORDS = 2880
GAP_RECORDS = 1.5
"""A record reaches no farther than this many usual steps; what is between records farther apart stays grey."""

WIDEST_CHANNEL = 1.35
"""A channel reaches no farther than to this times, or one over this, its own frequency: bands apart stay apart."""

WEAK_STRETCH = 0.6
"""Exponent of the colour scale: below one, weak bursts stand out from the quiet sky."""

LOW_TICKS_MHZ = (0.003, 0.005, 0.01)
HOURS = ("%Y", "%b", "%d %b", "%H:%M", "%H:%M", "%H:%M:%S")
LEAST_HIGHEST_DB, MOST_HIGHEST_DB = 6.0, 25.0
BRIGHTEST_SHARE = 0.997
NO_DATA = "#aab3bb"


def write_spectrum_png(path: Path, spectrum: xr.Dataset) -> None:
    """Write the dynamic spectrum of one spacecraft as a PNG; the file appears whole or not at all.

    Parameters
    ----------
    path : Path
        Its folder is made when it does not exist.
    spectrum : xarray.Dataset
        A dynamic spectrum of any quantity; shown is dB over its background. Channels that were not measured are left
        out, and gaps are grey.

    Raises
    ------
    InputError
        If the quantity of the spectrum is not known.
    """
    over = _drawn(over_background(spectrum))
    intensity = over["intensity"].to_numpy().T.astype(np.float64)
    figure = Figure(figsize=(10.0, 4.2), layout="constrained")
    axes = figure.add_subplot(facecolor=NO_DATA)
    frequency_edges, intensity = _cells(*_channel_limits(over["frequency"].to_numpy().astype(np.float64)), intensity)
    time_edges, across = _cells(*_record_limits(over["time"].to_numpy()), intensity.T)
    mesh = axes.pcolormesh(
        time_edges.astype("datetime64[ns]"),
        frequency_edges,
        across.T,
        cmap=LinearSegmentedColormap.from_list("brightness", BRIGHTNESS_SCALE),
        norm=PowerNorm(WEAK_STRETCH, 0.0, _highest_db(intensity), clip=True),
        rasterized=True,
    )
    figure.colorbar(mesh, ax=axes, pad=0.01, aspect=28, extend="max", label="dB over background")
    _finish(axes, over, (float(frequency_edges[0]), float(frequency_edges[-1])))
    save_png(figure, path)


def _drawn(over: xr.Dataset) -> xr.Dataset:
    """What was measured, in no more records than can be told apart on paper."""
    kept = over[["intensity"]]
    if "interpolated" in over:
        kept = kept.isel(frequency=~over["interpolated"].to_numpy().astype(bool))
    together = -(-kept.sizes["time"] // MOST_RECORDS)
    thinned = kept if together == 1 else kept.coarsen(time=together, boundary="pad").mean()
    return thinned.assign_attrs(over.attrs)


def _channel_limits(frequency_mhz: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Where channels begin and end, MHz: half-way to the neighbour, and as far on the side without one."""
    ratio = np.sqrt(frequency_mhz[1:] / frequency_mhz[:-1]) if frequency_mhz.size > 1 else np.array([WIDEST_CHANNEL])
    down, up = np.append(ratio[0], ratio), np.append(ratio, ratio[-1])
    if frequency_mhz.size == 1:
        down = up = ratio
    return frequency_mhz / np.minimum(down, WIDEST_CHANNEL), frequency_mhz * np.minimum(up, WIDEST_CHANNEL)


def _record_limits(time: npt.NDArray[np.datetime64]) -> tuple[FloatArray, FloatArray]:
    """Where records begin and end, ns."""
    centre_ns = time.astype("datetime64[ns]").astype(np.int64).astype(np.float64)
    reach_ns = 0.5 * GAP_RECORDS * np.median(np.diff(centre_ns))
    between = 0.5 * (centre_ns[:-1] + centre_ns[1:])
    lower = np.maximum(np.concatenate([[-np.inf], between]), centre_ns - reach_ns)
    return lower, np.minimum(np.concatenate([between, [np.inf]]), centre_ns + reach_ns)


def _cells(lower: FloatArray, upper: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Edges of cells that fill the axis, and their values: an empty cell where there is a gap along the first axis."""
    before_gap = np.flatnonzero(lower[1:] - upper[:-1] > 1e-6 * (upper - lower)[1:])
    edges = np.sort(np.concatenate([lower, upper[before_gap], upper[-1:]]))
    return edges, np.insert(values, before_gap + 1, np.nan, axis=0)


def _highest_db(intensity: FloatArray) -> float:
    finite = intensity[np.isfinite(intensity)]
    brightest = float(np.quantile(finite, BRIGHTEST_SHARE)) if finite.size else 0.0
    return min(max(brightest, LEAST_HIGHEST_DB), MOST_HIGHEST_DB)


def _finish(axes: Axes, over: xr.Dataset, band: tuple[float, float]) -> None:
    time = over["time"].to_numpy()
    axes.set_yscale("log")
    axes.set_ylim(band)
    ticks = [tick for tick in (*LOW_TICKS_MHZ, *FREQUENCY_TICKS_MHZ) if band[0] <= tick <= band[1]]
    axes.yaxis.set_major_locator(FixedLocator(ticks))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
    locator = AutoDateLocator(minticks=6, maxticks=13)  # type: ignore[no-untyped-call]
    axes.xaxis.set_major_locator(locator)
    hours = ConciseDateFormatter(  # type: ignore[no-untyped-call]
        locator, formats=HOURS, zero_formats=HOURS, show_offset=False
    )
    axes.xaxis.set_major_formatter(hours)
    axes.set_ylabel("Frequency (MHz)")
    axes.set_xlabel("UTC")
    first, last = (str(moment.astype("datetime64[D]")) for moment in time[[0, -1]])
    day = first if first == last else f"{first} to {last}"
    axes.set_title(f"{over.attrs['observatory']}  {over.attrs['receiver']}  {day}", loc="left", fontsize=11)
    channels = f"{over.sizes['frequency']} channels, {float(over.attrs['integration_s']):g} s"
    axes.set_title(channels, loc="right", fontsize=8, color="0.4")
