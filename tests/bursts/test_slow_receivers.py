"""Bursts in spectra of receivers that look less often than every minute."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from bella.bursts.detection import search
from bella.bursts.matched_filter import FREQUENCY_MHZ, channel_match, over_quiet, search_grid
from bella.simulation.day import observe_day
from bella.simulation.instruments import instruments
from bella.simulation.sky import Sky
from bella.spectra.assembly import Origin, assemble
from tests.bursts.recorded import DAY, accepted, burst_at, sky, starts

CADENCES_S = (60.0, 90.0, 100.0, 120.0, 150.0, 180.0, 183.0, 240.0)


def slow(what: Sky, cadence_s: float, seed: int = 1) -> xr.Dataset:
    """Key parameters of a day with another cadence."""
    (known,) = instruments("WI_K0_WAV", DAY)
    receiver = replace(known.receiver, cadence_s=cadence_s, integration_s=cadence_s)
    return observe_day(replace(known, receiver=receiver), [what], DAY, np.random.default_rng(seed))


@pytest.mark.parametrize("cadence_s", CADENCES_S)
@pytest.mark.parametrize("contrast", [60.0, 20.0])
def test_isolated_bursts_are_found_at_every_cadence(cadence_s: float, contrast: float) -> None:
    hours = (3.0, 9.0, 15.0)
    found = accepted(slow(sky([burst_at(hour, contrast=contrast) for hour in hours]), cadence_s))

    assert len(found) == 3
    for hour, onset in zip(hours, sorted(found["start_utc"]), strict=True):
        late_s = (onset - np.datetime64(DAY, "ns")).total_seconds() - hour * 3600.0 - 500.0  # of light
        assert abs(late_s) < 60.0 + cadence_s
    assert found["isolated"].all()
    assert not found["reason"].str.contains("gap").any()


@pytest.mark.parametrize("seed", [3, 4])
@pytest.mark.parametrize("cadence_s", [180.0, 240.0])
def test_noise_alone_is_no_burst(cadence_s: float, seed: int) -> None:
    searched = search(slow(sky(), cadence_s, seed))

    assert searched.not_searchable == ""
    assert searched.found == ()


@pytest.mark.parametrize("cadence_s", [60, 120, 180, 300])
def test_minutes_that_share_a_sample_share_its_noise(cadence_s: int) -> None:
    time = np.datetime64(DAY, "ns") + np.arange(0, 86_400 * 2, cadence_s) * np.timedelta64(10**9, "ns")
    decibel = np.random.default_rng(7).normal(0.0, 1.0, (time.size, FREQUENCY_MHZ.size)).astype(np.float32)
    origin = Origin("WIND", "X", "db_over_background", "x.cdf")
    grid = search_grid(over_quiet(assemble(origin, time, FREQUENCY_MHZ, decibel)))

    match = channel_match(grid.excess_db, grid.noise_db, grid.revisit)

    assert np.median(grid.revisit) == pytest.approx(cadence_s / 60)
    # where pulses last for minutes, low in frequency, it shows most: without it 1.3 to 1.9 instead of one
    assert 0.85 < np.nanstd(match[:, :20]) < 1.05
    assert 0.85 < np.nanstd(match[:, 40:]) < 1.05


def test_a_hole_in_a_slow_spectrum_stays_a_hole() -> None:
    whole = slow(sky(), 180.0)
    time = whole["time"].to_numpy()
    kept = np.flatnonzero((time < time[200]) | (time > time[230]))

    grid = search_grid(over_quiet(whole.isel(time=kept)))

    empty = np.isnan(grid.excess_db).all(axis=1)
    assert 30 * 3 - 6 <= empty.sum() <= 31 * 3


def test_a_burst_every_few_hours_keeps_its_onset() -> None:
    found = accepted(slow(sky([burst_at(5.0)]), 180.0))

    assert starts(found)[0] in {"05:06", "05:07", "05:08", "05:09", "05:10", "05:11"}


def test_the_flux_at_1_au_of_a_burst_is_in_its_row() -> None:
    spectrum = slow(sky([burst_at(5.0)]), 60.0)
    minute = (spectrum["time"].to_numpy() - np.datetime64(DAY, "ns")) / np.timedelta64(60, "s")
    sfu = np.where(np.abs(minute - 313.0) < 2.0, 42.0, np.where(minute > 600.0, 99.0, np.nan))
    spectrum["flux_sfu_1au"] = ("time", "frequency"), np.repeat(sfu[:, None], spectrum.sizes["frequency"], axis=1)

    assert accepted(spectrum)["flux_sfu_1au"].tolist() == [42.0]
    assert accepted(spectrum.drop_vars("flux_sfu_1au"))["flux_sfu_1au"].isna().all()
