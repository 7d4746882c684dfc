"""What a sample is, a snapshot or a mean of a minute, and how well its time is known, in the error of an edge."""

from dataclasses import replace
from functools import cache

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from bella.bursts import spectrum_edges
from bella.bursts.noise import OFFSET_S
from bella.bursts.timing import HALF_RISE, time_burst
from bella.simulation import Receiver, observe
from bella.simulation.burst import arrival_s
from bella.simulation.light_curves import PulseLaw
from bella.spectra import combine_receivers
from bella.spectra.minutes import mean_time_sd_s
from bella.spectra.stereo import SWEEP_S, by_minute
from tests.bursts.recorded import burst_at

CHANNELS_MHZ = np.geomspace(0.3, 6.0, 24)
DWELL_S = 0.12
BURST = replace(burst_at(5.0), pulse=PulseLaw("emg", 35.0, -0.77, decay_s=140.0))
RELEASE = BURST.release_utc.astype("datetime64[ns]")
SEEDS = range(16)
SECOND = np.timedelta64(10**9, "ns")


def seconds(value: float) -> np.timedelta64:
    return np.timedelta64(round(value * 1e9), "ns")


def snapshots(seed: int, cadence_s: float) -> xr.Dataset:
    """A burst by a receiver that dwells 0.12 s on each channel, once in a cadence, begun at a random time."""
    random = np.random.default_rng(seed)
    receiver = Receiver("STEREO-A", "HFR", CHANNELS_MHZ, cadence_s, DWELL_S, np.zeros(CHANNELS_MHZ.size))
    start = RELEASE - seconds(1800.0 + random.uniform(0.0, 60.0))
    return observe(receiver, [BURST], start, start + seconds(7200.0), random)


def minutes(spectrum: xr.Dataset, seed: int) -> xr.Dataset:
    """Averages of a minute of what was seen, as the archive has them."""
    start = RELEASE - seconds(1700.0 + np.random.default_rng(seed).uniform(0.0, 60.0))
    row = ((spectrum["time"].to_numpy() - start) / SECOND // 60.0).astype(int)
    count = 100
    inside = (row >= 0) & (row < count)
    power = np.zeros((count, CHANNELS_MHZ.size))
    np.add.at(power, row[inside], 10.0 ** (spectrum["intensity"].to_numpy()[inside] / 10.0))
    mean = power / np.bincount(row[inside], minlength=count)[:, None]
    time = start + np.arange(count) * 60 * SECOND + 30 * SECOND
    averaged = spectrum.isel(time=slice(0, count)).drop_vars("sample_offset_s").assign_coords(time=time)
    averaged["intensity"] = (("time", "frequency"), 10.0 * np.log10(mean).astype(np.float32))
    return averaged.assign_attrs(integration_s=60.0)


Edges = list[pd.DataFrame]


@cache
def edges_of_snapshots(cadence_s: float) -> tuple[Edges, Edges]:
    """Of snapshots that are known to be such, and of the same taken for means."""
    known = [snapshots(seed, cadence_s) for seed in SEEDS]
    taken_for_means = [one.assign_attrs(integration_s=cadence_s) for one in known]
    return [spectrum_edges(one) for one in known], [spectrum_edges(one) for one in taken_for_means]


@cache
def edges_of_minutes() -> tuple[Edges, Edges]:
    """Of averages that are known to be of one or two sweeps, and of the same taken for means of a minute."""
    averaged = [minutes(snapshots(seed, SWEEP_S), seed) for seed in SEEDS]
    return [spectrum_edges(by_minute(one)) for one in averaged], [spectrum_edges(one) for one in averaged]


def errors(timed: Edges, band_mhz: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Errors of the edges in a band, s and in their stated sigmas."""
    truth_s = arrival_s(BURST, CHANNELS_MHZ, "STEREO-A")
    off, pull = [], []
    for edges in timed:
        found = (edges["flag"] == "").to_numpy() & edges["frequency_mhz"].between(*band_mhz).to_numpy()
        error_s = (edges["arrival_utc"].to_numpy() - RELEASE) / SECOND - truth_s
        off.append(error_s[found])
        pull.append((error_s / edges["sigma_s"].to_numpy())[found])
    return np.concatenate(off), np.concatenate(pull)


@pytest.mark.parametrize("cadence_s", [17.0, 38.05])
@pytest.mark.parametrize("band_mhz", [(0.3, 1.0), (1.0, 3.0)])
def test_snapshots_are_timed_without_bias_when_they_are_known_to_be_snapshots(
    cadence_s: float, band_mhz: tuple[float, float]
) -> None:
    known, taken_for_means = edges_of_snapshots(cadence_s)
    off, pull = errors(known, band_mhz)
    before, _ = errors(taken_for_means, band_mhz)

    assert abs(np.median(off)) < 3.0  # the rise is not resolved, and that of a typical burst is too slow
    assert abs(np.median(off)) <= abs(np.median(before))
    assert pull.std() < 1.7


@pytest.mark.parametrize("band_mhz", [(0.3, 1.0), (1.0, 2.0)])
def test_averages_of_one_or_two_sweeps_are_no_means_of_a_minute(band_mhz: tuple[float, float]) -> None:
    known, taken_for_means = edges_of_minutes()
    _, unaware = errors(taken_for_means, band_mhz)
    _, pull = errors(known, band_mhz)

    assert unaware.std() > 1.4
    assert 0.6 < pull.std() < 1.4


def test_errors_of_sample_times_are_smooth_along_frequency() -> None:
    one = by_minute(minutes(snapshots(1, SWEEP_S), 1))
    noise, known = (time_burst([spectrum], HALF_RISE).noise for spectrum in (one, one.drop_vars("sample_time_sd_s")))

    assert (noise.shape_sd_s >= 5.68).all()
    assert np.median(known.shape_sd_s) < 4.0
    np.testing.assert_allclose(noise.offset_s, OFFSET_S)


@pytest.mark.parametrize(
    ("revisit_s", "sd_s"), [(38.05, 5.68), (45.8, 7.9), (91.6, 17.32), (183.3, 17.32), (60.0, 17.32)]
)
def test_spread_of_mean_times_in_a_minute(revisit_s: float, sd_s: float) -> None:
    begin = np.random.default_rng(5).uniform(0.0, revisit_s, 200_000)
    times = begin[:, None] + revisit_s * np.arange(3)
    inside = times < 60.0
    mean_s = np.where(inside, times, 0.0).sum(axis=1)[inside[:, 0]] / inside.sum(axis=1)[inside[:, 0]]

    assert mean_time_sd_s(revisit_s) == pytest.approx(sd_s, abs=0.02)
    assert mean_time_sd_s(revisit_s) == pytest.approx(mean_s.std(), rel=0.01)


def test_receivers_side_by_side_keep_their_integration_times() -> None:
    low, high = (snapshots(3, 38.05).isel(frequency=part) for part in (slice(0, 12), slice(12, 24)))
    both = combine_receivers(low.assign_attrs(receiver="LFR", integration_s=38.05), high)
    apart = [spectrum_edges(one) for one in (low.assign_attrs(integration_s=38.05), high)]

    np.testing.assert_allclose(both["channel_integration_s"], [38.05] * 12 + [DWELL_S] * 12)
    assert spectrum_edges(both)["arrival_utc"].tolist() == [utc for one in apart for utc in one["arrival_utc"]]
