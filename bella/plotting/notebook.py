"""Figures of a notebook, in the style of the pages: arrival times, detections, positions and a track."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from bella.plotting.constellation import MapView, constellation_caption, constellation_figure
from bella.plotting.export import Caption, exported, write_figure
from bella.plotting.geometry import TrackView
from bella.plotting.svg import (
    FREQUENCY_TICKS_MHZ,
    Scale,
    element,
    figure,
    grid,
    line,
    marks,
    path,
    time_of_day,
    unix_s,
    words,
)
from bella.records import JointTrack, Parameter
from bella.units import FloatArray

ERRORS = ("sigma_s", "shape_sd_s", "offset_sd_s", "delay_sd_s")
SIZE = (620.0, 330.0)
LEFT, RIGHT, TOP, BOTTOM = 52.0, 14.0, 34.0, 44.0
MARGIN_SHARE, LEAST_SPAN_S = 0.05, 10.0
COLOURS = 5
"""Of series, in `figure.css`."""

CIRCLE_SD = {percent: float(np.sqrt(-2.0 * np.log(1.0 - percent / 100))) for percent in (68, 95)}
"""Radius of the circle that holds so much of a Gaussian in a plane, in standard deviations."""

OUTLINE_POINTS = 48


@dataclass(frozen=True)
class Figure:
    """A figure that a notebook shows.

    Attributes
    ----------
    svg : str
        As the functions of this package draw it.
    caption : str
        What it shows.
    """

    svg: str
    caption: str

    def _repr_html_(self) -> str:
        drawn = exported(self.svg, Caption(self.caption)).decode()
        return f'<div style="overflow-x: auto">{drawn}</div>'

    def save(self, path: str | Path) -> None:
        """Write it with its caption as SVG, PNG or PDF, by the end of the name.

        Raises
        ------
        InputError
            If the name ends otherwise.
        """
        write_figure(Path(path), self.svg, Caption(self.caption))


def arrivals_figure(frame: pd.DataFrame) -> Figure:
    """Frequency against arrival time with its whole error, one series per spacecraft."""
    stated = frame.reindex(columns=list(ERRORS), fill_value=0.0).to_numpy(dtype=float)
    frame = frame.assign(error_s=np.sqrt((stated**2).sum(axis=1)))
    seconds, sigma = unix_s(frame["arrival_utc"]), frame["error_s"].to_numpy()
    across, upward = _scales(seconds - sigma, seconds + sigma, frame["frequency_mhz"].to_numpy(dtype=float))
    parts = _axes(across, upward, seconds)
    for index, (name, rows) in enumerate(frame.groupby("observatory", sort=False)):
        ordered = rows.sort_values("frequency_mhz")
        y = upward(ordered["frequency_mhz"])
        middle, error = unix_s(ordered["arrival_utc"]), ordered["error_s"].to_numpy()
        places = np.column_stack([across(middle), y])
        bars = [line(*ends) for ends in zip(across(middle - error), y, across(middle + error), y, strict=True)]
        parts += [element("g", *bars, path(places), *marks(places, index), class_=_series(index))]
        parts += _legend(index, str(name))
    caption = "Time of arrival at each frequency and spacecraft, with one standard deviation of all its errors."
    return Figure(figure("arrivals", SIZE, "Arrival times of each spacecraft.", *parts), caption)


def detections_figure(frame: pd.DataFrame) -> Figure:
    """Box of time and frequency of each detection, one colour per spacecraft."""
    begin, end = unix_s(frame["start_utc"]), unix_s(frame["end_utc"])
    low, high = (frame[name].to_numpy(dtype=float) for name in ("f_low_mhz", "f_high_mhz"))
    across, upward = _scales(begin, end, np.concatenate([low, high]))
    parts = _axes(across, upward, begin)
    x, y, right, base = across(begin), upward(high), across(end), upward(low)
    for index, name in enumerate(dict.fromkeys(frame["observatory"])):
        own = np.flatnonzero(frame["observatory"] == name)
        boxes = [element("rect", x=x[i], y=y[i], width=right[i] - x[i], height=base[i] - y[i]) for i in own]
        # side by side: boxes of two spacecraft may be the same
        corners = np.column_stack([x[own] + 8.0 + 12.0 * index, base[own] - 8.0])
        parts += [element("g", *boxes, *marks(corners, index), class_=_series(index)), *_legend(index, str(name))]
    caption = "Time and frequencies of each detection."
    return Figure(figure("detections", SIZE, "Detections of each spacecraft.", *parts), caption)


def positions_figure(posterior: xr.Dataset) -> Figure:
    """Positions by frequency with their regions on the map of the ecliptic, and the receivers."""
    utc = np.datetime64(str(posterior.attrs["reference_time"]).removesuffix("Z"), "ns")
    return _map([TrackView("", posterior, {})], utc)


def track_figure(record: JointTrack, draws: xr.Dataset) -> Figure:
    """Sources of the profile of a track and its spiral on the map of the ecliptic; sectors where there is no profile.

    Parameters
    ----------
    draws : xarray.Dataset
        ``joint_draws`` of the fit, or empty.
    """
    posterior = _profile(record)
    fit = {"joint": record.model_dump(mode="json")}
    utc = np.datetime64(record.epoch_utc.removesuffix("Z"), "ns")
    if posterior is None:
        return _map([], utc, MapView(sectors=record.phi0_68))
    return _map([TrackView("", xr.merge([posterior, draws]), fit)], utc)


def _map(tracks: Sequence[TrackView], utc: np.datetime64, look: MapView | None = None) -> Figure:
    return Figure(constellation_figure(tracks, utc, look or MapView()), constellation_caption("hee"))


def _profile(record: JointTrack) -> xr.Dataset | None:
    """Profile of a track as a posterior of positions: Gaussian in distance and longitude."""
    known = [one for one in record.profile if None not in {one.range_rsun.q50, one.longitude_deg.q50}]
    if not known:
        return None
    distance, along = _middle_and_sd([one.range_rsun for one in known])
    longitude, across = (np.radians(one) for one in _middle_and_sd([one.longitude_deg for one in known]))
    outward = np.array([np.cos(longitude), np.sin(longitude)])
    aside = np.array([-outward[1], outward[0]])
    covariance = np.einsum("if,jf,f->ijf", outward, outward, along**2)
    covariance += np.einsum("if,jf,f->ijf", aside, aside, (distance * across) ** 2)
    x, y = distance * outward
    angle = np.linspace(0.0, 2.0 * np.pi, OUTLINE_POINTS)
    outlines = {}
    for percent, radius in CIRCLE_SD.items():
        far = distance[:, None] + radius * along[:, None] * np.cos(angle)
        turned = longitude[:, None] + radius * across[:, None] * np.sin(angle)
        outlines[f"region{percent}"] = np.stack([far * np.cos(turned), far * np.sin(turned)], axis=-1)
    numbers = {
        "x_rsun": x,
        "y_rsun": y,
        "cov_xx_rsun2": covariance[0, 0],
        "cov_xy_rsun2": covariance[0, 1],
        "cov_yy_rsun2": covariance[1, 1],
        "area68_rsun2": np.pi * CIRCLE_SD[68] ** 2 * along * distance * across,
    }
    return xr.Dataset(
        {name: ("frequency", values) for name, values in numbers.items()}
        | {name: (("frequency", "vertex", "xy"), values) for name, values in outlines.items()}
        | {"receiver_rsun": (("frequency", "observatory", "xyz"), np.empty((len(known), 0, 3)))},
        coords={"frequency": [one.frequency_mhz for one in known], "observatory": np.array([], dtype=str)},
    )


def _middle_and_sd(values: Sequence[Parameter]) -> tuple[FloatArray, FloatArray]:
    """Medians and half the 68 % intervals."""
    low, middle, high = (np.array([getattr(one, end) for one in values], dtype=float) for end in ("q16", "q50", "q84"))
    return middle, np.nan_to_num((high - low) / 2.0)


def _scales(begin_s: FloatArray, end_s: FloatArray, frequency_mhz: FloatArray) -> tuple[Scale, Scale]:
    """Scales of times since 1970 and of frequencies, of a figure that may have neither."""
    if not len(begin_s):
        begin_s, end_s, frequency_mhz = np.zeros(1), np.full(1, LEAST_SPAN_S), np.array(FREQUENCY_TICKS_MHZ)
    first, last = float(np.nanmin(begin_s)), float(np.nanmax(end_s))
    margin = max(MARGIN_SHARE * (last - first), LEAST_SPAN_S / 2)
    across = Scale(first - margin, last + margin, LEFT, SIZE[0] - RIGHT)
    band = float(np.nanmin(frequency_mhz)) / 1.1, float(np.nanmax(frequency_mhz)) * 1.1
    return across, Scale(*band, SIZE[1] - BOTTOM, TOP, is_log=True)


def _axes(across: Scale, upward: Scale, times_s: FloatArray) -> list[str]:
    times = across.time_ticks(6) if len(times_s) else []
    step_s = times[1] - times[0] if len(times) > 1 else 1.0
    frequencies = {one: f"{one:g}" for one in upward.among(FREQUENCY_TICKS_MHZ)}
    parts = [*grid(across, upward, {one: time_of_day(one, step_s) for one in times}, frequencies, "MHz")]
    if len(times_s):
        day = np.datetime64(int(np.nanmin(times_s)), "s").astype("datetime64[D]")
        middle = (across.start + across.end) / 2
        parts.append(words(f"UTC, {day}", middle, SIZE[1] - 8, class_="axis-name", text_anchor="middle"))
    return parts


def _series(index: int) -> str:
    return f"series s{index % COLOURS}"


def _legend(index: int, name: str) -> Iterator[str]:
    x = LEFT + 40.0 + 120.0 * index
    yield element("g", *marks(np.array([[x, 14.0]]), index), class_=_series(index))
    yield words(name, x + 10, 18.0, class_="tick")
