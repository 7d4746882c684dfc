"""Real days from spectra to positions: 2020-07-21, 2012-06-07 and 2010-01-17, through every step of the chain."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from bella.arrivals import arrival_grid, check_arrivals, locate_receivers
from bella.bursts import EVENT, fit_time_evolution, half_maximum_arrivals, published_arrivals, spectrum_edges
from bella.bursts.association import AssociatedBurst, associate
from bella.bursts.detection import search
from bella.bursts.event import REFERENCE_UTC
from bella.bursts.timing import (
    TimedBurst,
    arrival_table,
    burst_spectrum,
    shared_frequencies_mhz,
    time_burst,
    why_not_timed,
)
from bella.flags import LOCALISABLE
from bella.heliosphere.scattering import NO_DELAY
from bella.multilateration import localise
from bella.records import JointTrack
from bella.spectra import combine_receivers, event_spectra, open_spectra
from bella.tracks import fit_track
from bella.units import C_RSUN_S
from tests.spectra import real_day_2020

FAR_SIDE_DEG = -155.0
"""HEE longitude of the burst of 2020-07-21T06:20 by its intensities at four spacecraft (Clarkson et al. 2025)."""

SHALLOW_MHZ = np.array([1.0, 1.4])
TRACK_MHZ = np.geomspace(0.25, 2.0, 20)
METHODS = ("half_rise", "half_maximum")

TABLE_MHZ = np.array([2.0, 1.5, 1.0, 0.8, 0.6, 0.4, 0.3, 0.2])
TABLE_RANGE_RSUN = np.array([15.0, 20.0, 29.0, 36.0, 48.0, 68.0, 87.0, 122.0])
TABLE_LONGITUDE_DEG = np.array([31.0, 23.0, 15.0, 12.0, 10.0, 9.0, 11.0, 17.0])
"""Track of 2012-06-07 from half of what the published figure shows, Wind's amplitudes too (independent reduction)."""


class Received(NamedTuple):
    """A day at several spacecraft."""

    spectra: dict[str, xr.Dataset]
    bursts: dict[str, AssociatedBurst]

    def timed(self, burst_id: str, edge: str = "half_rise") -> TimedBurst:
        """The burst at all spacecraft that received it."""
        members = self.bursts[burst_id].members
        return time_burst([burst_spectrum(member.searched, member.candidate) for member in members], edge)

    def arrivals(self, burst_id: str, edge: str, frequency_mhz: np.ndarray) -> pd.DataFrame:
        """Arrival table at common frequencies."""
        return arrival_table(self.timed(burst_id, edge), frequency_mhz)


def received(*spectra: xr.Dataset) -> Received:
    by_name = {str(one.attrs["observatory"]): one for one in spectra}
    bursts = associate([search(one) for one in spectra])
    return Received(by_name, {burst.burst_id: burst for burst in bursts})


@pytest.fixture(scope="module")
def day_2020(reference_files: Path) -> Received:
    """2020-07-21 at Wind, STEREO-A and PSP."""
    return received(*(one(reference_files) for one in (real_day_2020.wind, real_day_2020.stereo_a, real_day_2020.psp)))


@pytest.fixture(scope="module")
def event_2012() -> Received:
    """The built-in event."""
    return received(*(event_spectra()[name].to_dataset() for name in EVENT.observatories))


def placed(arrivals: pd.DataFrame) -> tuple[np.ndarray, np.ndarray]:
    """Distance in solar radii and HEE longitude in degrees at each frequency, descending."""
    solution = localise(arrivals, draws=500, delay=NO_DELAY).sortby("frequency", ascending=False)
    x, y = solution["x_rsun"].to_numpy(), solution["y_rsun"].to_numpy()
    return np.hypot(x, y), np.degrees(np.arctan2(y, x))


def longitudes_beside(arrivals: pd.DataFrame, longitude_deg: float) -> np.ndarray:
    """Draws of the longitude less a given one, within half a turn, shape (frequencies, draws)."""
    draws = localise(arrivals, draws=4000, delay=NO_DELAY)["draws"]
    x, y = (draws.sel(parameter=name).to_numpy() for name in ("x_rsun", "y_rsun"))
    return (np.degrees(np.arctan2(y, x)) - longitude_deg + 180.0) % 360.0 - 180.0


def joint_of(arrivals: pd.DataFrame) -> JointTrack:
    return fit_track(arrival_grid(locate_receivers(check_arrivals(arrivals))), draws=1000).record


# 2020-07-21


def scatter_s(edges: pd.DataFrame) -> tuple[int, float]:
    """Number of good edges of RAD1 and the root mean square of their residuals about a robust curve."""
    good = edges[(edges["flag"] == "") & edges["frequency_mhz"].between(0.14, 1.05)]
    first = good["arrival_utc"].min()
    arrival_s = (good["arrival_utc"] - first).dt.total_seconds().to_numpy()
    frequency_mhz = good["frequency_mhz"].to_numpy()
    curve = fit_time_evolution(frequency_mhz, arrival_s, good["sigma_s"].to_numpy())
    return len(good), float(np.sqrt(np.mean((arrival_s - curve.arrival_s(frequency_mhz)) ** 2)))


def test_what_wind_interpolated_is_told_without_the_flag_of_the_archive(day_2020: Received) -> None:
    wind = day_2020.spectra["WIND"]
    rad1 = wind.isel(frequency=wind["frequency"].to_numpy() < 1.05)

    assert int((~rad1["interpolated"].astype(bool)).sum()) == pytest.approx(30, abs=1)
    assert not wind["interpolated"].sel(frequency=slice(1.06, None)).any()


@pytest.mark.parametrize("burst_id", ["T3-20200721-0253", "T3-20200721-0703"])
def test_wind_scatters_less_at_the_times_of_its_visits(day_2020: Received, burst_id: str) -> None:
    (member,) = [one for one in day_2020.bursts[burst_id].members if one.searched.observatory == "WIND"]
    over = member.searched.over
    stamped = member.searched._replace(over=over.drop_vars("sample_time"))
    edges, of_minutes = (spectrum_edges(burst_spectrum(one, member.candidate)) for one in (member.searched, stamped))

    assert scatter_s(edges)[1] < 0.85 * scatter_s(of_minutes)[1]
    assert scatter_s(edges)[0] >= scatter_s(of_minutes)[0] - 2


def test_the_burst_of_02_54_runs_out_on_the_far_side(day_2020: Received) -> None:
    """Earlier by hand: 19 to 77 solar radii, 171 to 148 degrees."""
    timed = day_2020.timed("T3-20200721-0253", "shared_profile")
    range_rsun, longitude_deg = placed(arrival_table(timed, np.geomspace(0.34, 2.0, 6)))

    assert why_not_timed(timed, day_2020.bursts["T3-20200721-0253"].observatories) == ""
    assert range_rsun[:2].mean() < 60.0 < range_rsun[-3:].mean()
    assert (np.abs(longitude_deg[1:] - 155.0) < 40.0).all()


@pytest.mark.parametrize("edge", ["shared_profile", "half_rise"])
def test_one_spiral_through_the_burst_of_02_54(day_2020: Received, edge: str) -> None:
    """SEMP places it at 184 degrees with Solar Orbiter (Zhang et al. 2019), a prototype of this fit at 171 to 180."""
    fit = joint_of(day_2020.arrivals("T3-20200721-0253", edge, TRACK_MHZ))
    away = ((fit.phi0_deg.q50 or 0.0) - 175.0 + 180.0) % 360.0 - 180.0

    assert abs(away) < 8.0 + 2.0 * (fit.phi0_deg.sd or 0.0)
    assert (fit.phi0_deg.sd or 0.0) < 20.0
    assert 250.0 < (fit.v_sw_km_s.q50 or 0.0) < 700.0


def test_the_burst_of_06_20_is_not_offered_as_placed(day_2020: Received) -> None:
    burst = day_2020.bursts["T3-20200721-0623"]

    assert burst.reason == "not localisable: group"
    timed = day_2020.timed(burst.burst_id, "half_rise")
    assert "do not drift downwards" in why_not_timed(timed, burst.observatories)


@pytest.mark.parametrize(("method", "least_deg"), [("half_rise", 20.0), ("half_maximum", 25.0)])
def test_placed_all_the_same_it_is_on_the_far_side_and_known_badly(
    day_2020: Received, method: str, least_deg: float
) -> None:
    """All three spacecraft are on one side of it, within 90 degrees."""
    beside_deg = longitudes_beside(day_2020.arrivals("T3-20200721-0623", method, SHALLOW_MHZ), FAR_SIDE_DEG)
    low, middle, high = np.quantile(beside_deg, [0.025, 0.5, 0.975], axis=1)

    assert (low < 0.0).all()
    assert (high > 0.0).all()
    assert (high - low > least_deg).all()
    assert (np.abs(middle + FAR_SIDE_DEG) > 130.0).all()


@pytest.mark.parametrize("edge", ["half_rise", "half_maximum"])
def test_one_spiral_through_the_group_of_06_20_is_flagged(day_2020: Received, edge: str) -> None:
    fit = joint_of(day_2020.arrivals("T3-20200721-0623", edge, TRACK_MHZ))

    assert {"poor_fit", "components_differ", "edges_differ", "several_tracks", "beam_speed_unlikely"} & set(fit.flags)


# 2012-06-07


def test_the_event_of_2012_is_one_localisable_burst(event_2012: Received) -> None:
    (burst,) = event_2012.bursts.values()

    assert burst.tier == LOCALISABLE
    assert set(burst.observatories) == set(EVENT.observatories)
    assert abs((burst.start_utc - pd.Timestamp(EVENT.start_utc)).total_seconds()) < 180.0


def test_half_of_what_the_figure_shows_gives_the_track_of_an_independent_reduction() -> None:
    parts = []
    for name in EVENT.observatories:
        spectrum = event_spectra()[name].to_dataset().assign_attrs(power_exponent=1.0)
        edges = spectrum_edges(spectrum, "half_maximum")
        edges = edges[edges["frequency_mhz"].between(0.18, 2.0)]
        arrival_s = (edges["arrival_utc"].to_numpy() - REFERENCE_UTC) / np.timedelta64(1, "s")
        curve = fit_time_evolution(edges["frequency_mhz"].to_numpy(), arrival_s, np.ones(len(edges)))
        at = REFERENCE_UTC + np.rint(curve.arrival_s(TABLE_MHZ) * 1e9).astype("timedelta64[ns]")
        parts.append(pd.DataFrame({"observatory": name, "frequency_mhz": TABLE_MHZ, "arrival_utc": at}))
    table = check_arrivals(pd.concat(parts, ignore_index=True).assign(sigma_s=10.0, edge="half_maximum", flag=""))
    range_rsun, longitude_deg = placed(table)

    np.testing.assert_allclose(range_rsun, TABLE_RANGE_RSUN, rtol=0.08)
    np.testing.assert_allclose(longitude_deg, TABLE_LONGITUDE_DEG, atol=10.0)
    np.testing.assert_allclose(longitude_deg[2:7], TABLE_LONGITUDE_DEG[2:7], atol=3.0)


def test_the_chain_places_the_event_where_its_half_maxima_do(event_2012: Received) -> None:
    (burst_id,) = event_2012.bursts
    timed = event_2012.timed(burst_id, "half_maximum")
    frequency_mhz = TABLE_MHZ[1:]
    found = placed(arrival_table(timed, frequency_mhz))
    expected = placed(half_maximum_arrivals(frequency_mhz))

    assert shared_frequencies_mhz(timed)[[0, -1]] == pytest.approx([0.15, 1.98], abs=0.03)
    np.testing.assert_allclose(found[0][:-1], expected[0][:-1], atol=4.0)
    np.testing.assert_allclose(found[1], expected[1], atol=12.0)


def offsets_s(found: pd.DataFrame, other: pd.DataFrame) -> pd.DataFrame:
    """How much later an edge is than another, s: a row per frequency, descending, a column per spacecraft."""
    both = found.merge(other, on=["observatory", "frequency_mhz"], suffixes=("", "_other"))
    both["later_s"] = (both["arrival_utc"] - both["arrival_utc_other"]).dt.total_seconds()
    return both.pivot_table(index="frequency_mhz", columns="observatory", values="later_s").sort_index(ascending=False)


def test_the_track_of_the_paper_lies_apart_by_what_its_edges_are_earlier() -> None:
    """Only what edges are earlier at STEREO than at Wind moves the source, and by the light's way in that time.

    A source at a small angle to Wind's direction recedes from Wind's ray as it moves out: its way to a STEREO
    spacecraft at an angle a from it grows by -cos a per step, that to Wind falls by 1.
    """
    frequency_mhz = np.array([1.0, 0.8, 0.6, 0.4])
    published, half = published_arrivals(frequency_mhz), half_maximum_arrivals(frequency_mhz)
    later_s = offsets_s(published, half)
    assert (later_s < -15.0).to_numpy().all()

    (range_paper, longitude_paper), (range_half, longitude_half) = placed(published), placed(half)
    stereo_less_wind_s = later_s[["STEREO-A", "STEREO-B"]].mean(axis=1) - later_s["WIND"]
    growth = 1.0 - np.cos(np.radians(116.7)) * np.cos(np.radians(longitude_half))
    expected_rsun = C_RSUN_S * stereo_less_wind_s.to_numpy() / growth

    np.testing.assert_allclose(range_paper - range_half, expected_rsun, rtol=0.35)
    assert (range_paper < range_half).all()
    # across, a step to the west is nearer to STEREO-A by the sine of its angle, and farther from STEREO-B
    a_less_b_s = (later_s["STEREO-A"] - later_s["STEREO-B"]).to_numpy()
    west_rsun = -C_RSUN_S * a_less_b_s / (2.0 * np.sin(np.radians(116.7)))
    y_paper, y_half = (
        distance * np.sin(np.radians(angle))
        for distance, angle in ((range_paper, longitude_paper), (range_half, longitude_half))
    )
    np.testing.assert_allclose(y_paper - y_half, west_rsun, atol=1.0)


# 2010-01-17, with the readers


def test_readers_and_search_agree_on_2010_01_17(reference_files: Path) -> None:
    rad1, rad2, _ = open_spectra(reference_files / "semp/wi_h1_wav_20100117_v01.cdf")
    stereo = open_spectra(reference_files / "semp/stereo_level2_swaves_20100117_v01.cdf")
    day = received(combine_receivers(rad1, rad2), *stereo)
    group = [one for name, one in day.bursts.items() if name in {"T3-20100117-0357", "T3-20100117-0358"}]

    assert {one.reason for one in group} == {"not localisable: group"}
    assert day.bursts["T3-20100117-1146"].reason == "not localisable: received by 2 of 3 spacecraft"
