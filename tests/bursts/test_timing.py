"""From the spectra of a burst to its arrival times: near the truth, with honest errors, or with a reason."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from bella.bursts.detection import Candidate, Searched, search
from bella.bursts.timing import (
    FEWEST_EDGES,
    TimedBurst,
    arrival_covariance,
    arrival_table,
    burst_edges,
    candidate_near,
    shared_frequencies_mhz,
    timed_burst,
    why_not_timed,
)
from bella.exceptions import InputError, NoDataError
from bella.multilateration import localise
from bella.simulation import Receiver, SimulatedBurst, observe
from bella.simulation.burst import arrival_s, source_position_rsun

RELEASE = np.datetime64("2012-06-07T03:00:00", "ns")
START, STOP = RELEASE - np.timedelta64(3, "h"), RELEASE + np.timedelta64(4, "h")
CHANNELS_MHZ = np.geomspace(0.12, 13.0, 90)
BURST = SimulatedBurst(
    RELEASE, density_factor=3.0, contrast=60.0, f_low_mhz=0.18, f_high_mhz=12.0, width_factor=1.2, taper=0.2
)
LATER = replace(BURST, release_utc=RELEASE + np.timedelta64(70, "m"), contrast=300.0)
CADENCES_S = {"WIND": 60.0, "STEREO-A": 38.0, "STEREO-B": 38.0}
Heard = dict[str, tuple[xr.Dataset, Searched, Candidate]]


def spectrum(name: str, *bursts: SimulatedBurst) -> xr.Dataset:
    cadence = CADENCES_S[name]
    receiver = Receiver(name, "HFR", CHANNELS_MHZ, cadence, cadence, np.zeros(CHANNELS_MHZ.size))
    return observe(receiver, bursts, START, STOP, np.random.default_rng(7))


@pytest.fixture(scope="module")
def heard() -> Heard:
    """The burst at three spacecraft, with a brighter one seventy minutes later."""
    found = {}
    for name in CADENCES_S:
        one = spectrum(name, BURST, LATER)
        searched = search(one)
        found[name] = (one, searched, candidate_near(searched, RELEASE + np.timedelta64(9, "m")))
    return found


@pytest.fixture(scope="module")
def timed(heard: Heard) -> TimedBurst:
    edges = pd.concat([burst_edges(*one[1:]) for one in heard.values()], ignore_index=True)
    return timed_burst(edges, {name: one[0] for name, one in heard.items()})


def test_the_curve_of_each_spacecraft_is_the_truth_within_its_errors(timed: TimedBurst) -> None:
    frequency_mhz = np.geomspace(0.25, 2.0, 9)
    for name, curve in timed.evolutions.items():
        released_s = (RELEASE - timed.reference_utc) / np.timedelta64(1, "s")
        off = curve.arrival_s(frequency_mhz) - released_s - arrival_s(BURST, frequency_mhz, name)
        sigma = np.sqrt(np.diag(curve.covariance_s2(frequency_mhz)) + timed.offsets_s[name] ** 2)
        assert np.abs(off).max() < 8.0, name
        assert np.abs(off / sigma).max() < 3.5, name


def test_the_burst_that_was_asked_for_is_timed_and_not_the_brighter_one_after_it(timed: TimedBurst) -> None:
    good = timed.edges[timed.edges["flag"] == ""]
    assert len(good) > 120
    assert (good["arrival_utc"] < pd.Timestamp(RELEASE) + pd.Timedelta(minutes=55)).all()


def test_the_table_places_the_source_where_it_was(timed: TimedBurst) -> None:
    frequency_mhz = shared_frequencies_mhz(timed, 12)
    table = arrival_table(timed, frequency_mhz)

    assert why_not_timed(timed, list(timed.evolutions)) == ""
    assert (table["edge"] == "half_rise").all()
    assert table.groupby("frequency_mhz")["observatory"].nunique().eq(3).all()
    assert (table["offset_sd_s"] > 0).all()
    solved = localise(table, draws=10)
    source = source_position_rsun(BURST, solved["frequency"].to_numpy())
    np.testing.assert_allclose(solved["x_rsun"], source[:, 0], atol=6.0)
    np.testing.assert_allclose(solved["y_rsun"], source[:, 1], atol=6.0)


def test_the_covariance_is_that_of_the_table_and_of_one_curve(timed: TimedBurst) -> None:
    frequency_mhz = shared_frequencies_mhz(timed, 12)
    table, covariance = arrival_table(timed, frequency_mhz), arrival_covariance(timed, frequency_mhz)["covariance_s2"]
    for name in timed.evolutions:
        matrix = covariance.sel(observatory=name).to_numpy()
        rows = table[table["observatory"] == name]
        stated = rows["sigma_s"].to_numpy() ** 2 + rows["offset_sd_s"].to_numpy() ** 2
        np.testing.assert_allclose(np.diag(matrix), stated, rtol=1e-9)
        np.testing.assert_allclose(matrix, matrix.T, rtol=1e-9)
        assert np.linalg.matrix_rank(matrix, tol=1e-6 * matrix.max()) <= 6


def test_interpolated_channels_are_never_timed(heard: Heard) -> None:
    one, _, _ = heard["WIND"]
    flags = np.arange(CHANNELS_MHZ.size) % 3 > 0
    flagged = one.assign(interpolated=("frequency", flags))
    searched = search(flagged)

    edges = burst_edges(searched, candidate_near(searched, RELEASE + np.timedelta64(9, "m")))

    assert set(edges["frequency_mhz"]) <= set(CHANNELS_MHZ[~flags])


def test_fewer_spacecraft_or_no_shared_band_are_reasons(timed: TimedBurst) -> None:
    two = replace(timed, evolutions={name: timed.evolutions[name] for name in ("WIND", "STEREO-A")})
    assert f"fewer than {FEWEST_EDGES} good edges at STEREO-B" in why_not_timed(two, list(CADENCES_S))
    apart = replace(timed, bands_mhz=timed.bands_mhz | {"WIND": (3.0, 9.0)})
    assert "share no band" in why_not_timed(apart, list(CADENCES_S))
    assert shared_frequencies_mhz(apart).size == 0
    with pytest.raises(InputError, match="no spacecraft has enough edges"):
        arrival_table(apart, shared_frequencies_mhz(apart))


def test_silence_is_no_burst() -> None:
    quiet = search(spectrum("WIND"))
    with pytest.raises(NoDataError, match="shows no rise within 15 min of 2012-06-09"):
        candidate_near(quiet, np.datetime64("2012-06-09T00:00:00", "ns"))


def test_no_edge_at_all_is_said(timed: TimedBurst) -> None:
    nothing = timed.edges.assign(flag="no_signal")
    with pytest.raises(NoDataError, match="no channel of any spacecraft has an edge"):
        timed_burst(nothing, {})
