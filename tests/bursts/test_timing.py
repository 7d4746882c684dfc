"""From the spectra of a burst to its arrival times: near the truth, with honest errors, or with a reason."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from bella.bursts.detection import Candidate, Searched, search
from bella.bursts.timing import (
    EDGES,
    FEWEST_EDGES,
    HALF_RISE,
    SHARED,
    TimedBurst,
    arrival_frame,
    arrival_table,
    arrivals_at,
    burst_spectrum,
    candidate_near,
    channel_arrivals,
    shared_frequencies_mhz,
    time_burst,
    why_not_timed,
)
from bella.exceptions import InputError, NoDataError
from bella.heliosphere.scattering import NO_DELAY
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
Received = dict[str, tuple[xr.Dataset, Searched, Candidate]]


def spectrum(name: str, *bursts: SimulatedBurst) -> xr.Dataset:
    cadence = CADENCES_S[name]
    receiver = Receiver(name, "HFR", CHANNELS_MHZ, cadence, cadence, np.zeros(CHANNELS_MHZ.size))
    return observe(receiver, bursts, START, STOP, np.random.default_rng(7))


@pytest.fixture(scope="module")
def received() -> Received:
    """The burst at three spacecraft, with a brighter one seventy minutes later."""
    found = {}
    for name in CADENCES_S:
        one = spectrum(name, BURST, LATER)
        searched = search(one)
        found[name] = (one, searched, candidate_near(searched, RELEASE + np.timedelta64(9, "m")))
    return found


def parts(received: Received) -> list[xr.Dataset]:
    return [burst_spectrum(*one[1:]) for one in received.values()]


@pytest.fixture(scope="module")
def timed(received: Received) -> TimedBurst:
    return time_burst(parts(received))


def off_s(timed: TimedBurst, table: pd.DataFrame) -> pd.Series:
    """How much later than the truth the times of a table are, less the same error at all spacecraft."""
    late = (table["arrival_utc"] - pd.Timestamp(RELEASE)).dt.total_seconds()
    true = [float(arrival_s(BURST, np.array([row.frequency_mhz]), row.observatory)[0]) for row in table.itertuples()]
    off = late - np.array(true)
    return off - off.groupby(table["frequency_mhz"]).transform("mean")


@pytest.mark.parametrize("edge", EDGES[:3])
def test_differences_between_spacecraft_are_true_within_their_errors(received: Received, edge: str) -> None:
    timed = time_burst(parts(received), edge)
    table = arrival_table(timed, np.geomspace(0.25, 2.0, 9))
    off = off_s(timed, table)
    sigma = np.sqrt(table["sigma_s"] ** 2 + table["shape_sd_s"] ** 2 + table["offset_sd_s"] ** 2)

    assert timed.edge == edge
    assert np.abs(off).max() < 8.0
    assert np.sqrt(np.mean((off / sigma) ** 2)) < 1.5


def test_the_shared_profile_is_near_the_truth(timed: TimedBurst) -> None:
    table = arrival_table(timed, np.geomspace(0.3, 2.0, 9))
    assert np.sqrt(np.mean(off_s(timed, table) ** 2)) < 1.5


def test_a_receiver_whose_clock_is_known_has_hardly_any_offset(timed: TimedBurst) -> None:
    assert timed.noise.offset_s.max() < 0.2


def test_two_spacecraft_and_one_are_timed_by_their_flanks(received: Received) -> None:
    for number in (1, 2):
        timed = time_burst(parts(received)[:number], SHARED)
        table = arrival_table(timed, shared_frequencies_mhz(timed, 6))
        assert (timed.edge, table["observatory"].nunique()) == (HALF_RISE, number)
        assert (table["edge"] == HALF_RISE).all()


def test_channels_are_no_more_than_asked_for_and_in_the_band(timed: TimedBurst) -> None:
    table = channel_arrivals(timed, most=30)
    assert table.groupby("observatory").size().max() == 10
    assert table["frequency_mhz"].between(0.15, 2.0).all()


def test_the_burst_that_was_asked_for_is_timed_and_not_the_brighter_one_after_it(timed: TimedBurst) -> None:
    good = timed.edges[timed.edges["flag"] == ""]
    assert len(good) > 120
    assert (good["arrival_utc"] < pd.Timestamp(RELEASE) + pd.Timedelta(minutes=55)).all()


def test_the_table_places_the_source_where_it_was(timed: TimedBurst) -> None:
    frequency_mhz = shared_frequencies_mhz(timed, 12)
    table = arrival_table(timed, frequency_mhz)

    assert why_not_timed(timed, list(CADENCES_S)) == ""
    assert (table["edge"] == SHARED).all()
    assert table.groupby("frequency_mhz")["observatory"].nunique().eq(3).all()
    assert (table["offset_sd_s"] > 0).all()
    solved = localise(table, draws=10, delay=NO_DELAY)
    source = source_position_rsun(BURST, solved["frequency"].to_numpy())
    np.testing.assert_allclose(solved["x_rsun"], source[:, 0], atol=6.0)
    np.testing.assert_allclose(solved["y_rsun"], source[:, 1], atol=6.0)


def test_the_covariance_has_the_variances_of_the_table_less_what_all_spacecraft_share(timed: TimedBurst) -> None:
    rows = arrivals_at(timed, np.geomspace(0.3, 1.5, 5))
    table, covariance = arrival_frame(timed, rows), rows.covariance_s2()

    assert np.linalg.eigvalsh(covariance).min() > 0
    variance = (table["sigma_s"] ** 2 + table["shape_sd_s"] ** 2 + table["offset_sd_s"] ** 2).to_numpy()
    first, other = 0, 5  # the same frequency at two spacecraft
    difference = covariance[first, first] + covariance[other, other] - 2 * covariance[first, other]
    assert variance[first] + variance[other] == pytest.approx(difference, rel=0.15)


def test_interpolated_channels_are_never_timed(received: Received) -> None:
    one, _, _ = received["WIND"]
    flags = np.arange(CHANNELS_MHZ.size) % 3 > 0
    flagged = one.assign(interpolated=("frequency", flags))
    searched = search(flagged)

    one_part = burst_spectrum(searched, candidate_near(searched, RELEASE + np.timedelta64(9, "m")))

    assert set(time_burst([one_part]).edges["frequency_mhz"]) <= set(CHANNELS_MHZ[~flags])


def test_fewer_spacecraft_or_no_shared_band_are_reasons(timed: TimedBurst) -> None:
    noise = timed.noise
    two = replace(timed, noise=noise.take(np.flatnonzero(noise.observatory != "STEREO-B")))
    assert f"fewer than {FEWEST_EDGES} good edges at STEREO-B" in why_not_timed(two, list(CADENCES_S))
    high = (noise.observatory == "WIND") == (noise.frequency_mhz > 1.2)
    apart = replace(timed, noise=noise.take(np.flatnonzero(high)))
    assert "share no band" in why_not_timed(apart, list(CADENCES_S))
    assert shared_frequencies_mhz(apart).size == 0
    with pytest.raises(InputError, match="no spacecraft has enough edges"):
        arrival_table(apart, shared_frequencies_mhz(apart))


def test_times_that_do_not_drift_are_a_reason(timed: TimedBurst) -> None:
    backwards = replace(timed, noise=replace(timed.noise, arrival_s=-timed.noise.arrival_s))
    assert "do not drift downwards" in why_not_timed(backwards, list(CADENCES_S))


def test_silence_is_no_burst() -> None:
    quiet = search(spectrum("WIND"))
    with pytest.raises(NoDataError, match="shows no rise within 15 min of 2012-06-09"):
        candidate_near(quiet, np.datetime64("2012-06-09T00:00:00", "ns"))


def test_no_edge_at_all_is_said(received: Received) -> None:
    silent = [part.assign(intensity=0.0 * part["intensity"]) for part in parts(received)]
    with pytest.raises(NoDataError, match="no channel of any spacecraft has an edge"):
        time_burst(silent)
