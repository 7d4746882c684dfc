"""Edges of the channels as an arrival table: their own errors, no outliers, no more rows than asked for."""

from functools import cache

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from bella.bursts.channel_arrivals import MOST_ROWS, OUTLIER_SD, channel_arrivals
from bella.bursts.timing import TimedBurst, timed_burst
from bella.bursts.widths import rise_half_width_s
from bella.exceptions import InputError
from tests.bursts.test_timing import CADENCES_S, spectrum

START = np.datetime64("2012-06-07T03:00", "ns")
CHANNELS_MHZ = np.geomspace(0.1, 4.0, 40)


def edges(names: tuple[str, ...] = tuple(CADENCES_S), frequency_mhz: np.ndarray = CHANNELS_MHZ) -> pd.DataFrame:
    """Edges on a curve of 1/f, with errors of 12 s."""
    late = np.rint(100e9 / frequency_mhz).astype("timedelta64[ns]")
    columns = {"frequency_mhz": frequency_mhz, "arrival_utc": START + late, "sigma_s": 12.0, "edge": "half_rise"}
    return pd.concat([pd.DataFrame({"observatory": name, **columns, "flag": ""}) for name in names], ignore_index=True)


@cache
def spectra() -> dict[str, xr.Dataset]:
    return {name: spectrum(name) for name in CADENCES_S}


def timed(table: pd.DataFrame) -> TimedBurst:
    return timed_burst(table, spectra())


def test_channels_keep_their_own_times_and_errors_within_the_band() -> None:
    given = edges()
    table = channel_arrivals(timed(given))

    inside = given[given["frequency_mhz"].between(0.15, 2.0)].reset_index(drop=True)
    pd.testing.assert_frame_equal(
        table[["observatory", "frequency_mhz", "arrival_utc"]], inside[["observatory", "frequency_mhz", "arrival_utc"]]
    )
    floor = 0.1 * np.array([rise_half_width_s(one) for one in table["frequency_mhz"]])
    np.testing.assert_allclose(table["sigma_s"], np.maximum(12.0, floor))
    assert (table["offset_sd_s"] == 2.0).all()


def test_an_error_is_never_below_a_tenth_of_the_rise() -> None:
    table = channel_arrivals(timed(edges().assign(sigma_s=0.01)))
    np.testing.assert_allclose(table["sigma_s"], [0.1 * rise_half_width_s(one) for one in table["frequency_mhz"]])


@pytest.mark.parametrize(("away_sd", "kept"), [(OUTLIER_SD - 0.6, True), (OUTLIER_SD + 0.6, False)])
def test_only_edges_far_from_the_curve_are_left_out(away_sd: float, kept: bool) -> None:
    moved = edges()
    moved.loc[20, "arrival_utc"] += np.timedelta64(int(away_sd * 12e9), "ns")
    table = channel_arrivals(timed(moved))
    found = table[(table["observatory"] == "WIND") & (table["frequency_mhz"] == moved.loc[20, "frequency_mhz"])]
    assert len(found) == kept
    assert table["observatory"].value_counts()["STEREO-A"] == table["observatory"].value_counts()["WIND"] + (not kept)


def test_errors_grow_where_the_edges_of_a_spacecraft_scatter_by_more() -> None:
    scattered, here = edges(), np.arange(40, 80)
    noise_s = 3 * 12.0 * np.random.default_rng(2).standard_normal(here.size)
    scattered.loc[here, "arrival_utc"] += np.rint(noise_s * 1e9).astype("timedelta64[ns]")
    sigma = channel_arrivals(timed(scattered)).groupby("observatory")["sigma_s"].median()
    assert 2.0 < sigma["STEREO-A"] / sigma["WIND"] < 4.0
    assert sigma["STEREO-B"] == sigma["WIND"]


def test_flagged_channels_take_no_part() -> None:
    given = edges()
    given.loc[20, "flag"] = "edges_disagree"
    assert len(channel_arrivals(timed(given))) == len(channel_arrivals(timed(edges()))) - 1


def test_rows_are_bounded_and_still_span_the_band() -> None:
    many = edges(frequency_mhz=np.geomspace(0.15, 2.0, 200))
    table = channel_arrivals(timed(many))
    assert len(table) <= MOST_ROWS
    for _, rows in table.groupby("observatory"):
        assert len(rows) > 35
        assert (rows["frequency_mhz"].min(), rows["frequency_mhz"].max()) == pytest.approx((0.15, 2.0))
        assert np.diff(np.log(np.sort(rows["frequency_mhz"]))).max() < 2.5 * np.log(2.0 / 0.15) / 40


def test_fewer_than_three_spacecraft_in_the_band_are_refused() -> None:
    above = edges(("WIND",), np.geomspace(3.0, 8.0, 12))
    with pytest.raises(InputError, match="only STEREO-A, STEREO-B"):
        channel_arrivals(timed(pd.concat([above, edges(("STEREO-A", "STEREO-B"))], ignore_index=True)))
