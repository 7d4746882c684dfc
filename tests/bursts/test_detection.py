"""Bursts in the spectrum of one spacecraft: what must be found, what must not, and what may not matter."""

from collections.abc import Callable
from datetime import date
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from bella.bursts.detection import DETECTION_COLUMNS, GAP, GROUP, TOO_LONG, detect_bursts
from bella.exceptions import InputError
from bella.simulation.archive_days import sky_of
from bella.simulation.nuisances import (
    CalibrationColumn,
    InterferenceLine,
    JovianArc,
    Nuisance,
    ParticleHits,
    Patches,
    TypeTwoLane,
)
from bella.simulation.sky import Gain, Sky
from bella.spectra import combine_receivers, join_days, over_background
from benchmarks.detection import mirrored, spectrum_of
from tests.bursts.recorded import DAY, accepted, burst_at, recorded, sky, starts
from tests.spectra import real_day, real_day_2020

Opener = Callable[[Path], xr.Dataset]
BURSTS = (burst_at(5.0), burst_at(14.0, contrast=30.0), burst_at(20.0, f_high_mhz=5.0))
ARCS = (JovianArc(40_000.0, (2.0, 10.0), 500.0, 100.0, 8.0), JovianArc(42_500.0, (2.2, 9.0), -300.0, 150.0, 3.0))
DAY_OF_ARCS = date(2021, 2, 8)
NUISANCES: dict[str, tuple[Nuisance, ...]] = {
    "jovian_arcs": ARCS,
    "kilometric": (Patches("kilometric", 30_000.0, 42_000.0, (0.08, 0.6), 200.0, 30, 3),),
    "type_ii_lane": (TypeTwoLane(20_000.0, 50_000.0, (0.3, 9.0), 0.08, 6.0, 1500.0),),
    "calibration": (CalibrationColumn(40_000.0, 40_090.0, 50.0), CalibrationColumn(60_000.0, 60_060.0, 20.0)),
    "interference": (InterferenceLine(20_000.0, 40_000.0, (2.9, 3.1), 8.0, 900.0),),
    "particle_hits": (ParticleHits(20_000.0, 50_000.0, 0.01, 3.0, 5),),
}
TROUBLED: dict[str, Sky] = {name: sky(nuisances=some) for name, some in NUISANCES.items()} | {
    "gap": sky(gaps_s=((40_000.0, 42_000.0),)),
    "gain_up": sky(gain=Gain(0.5, 1.5, 40_000.0)),
    "gain_down": sky(gain=Gain(0.5, -1.5, 40_000.0)),
}


@pytest.fixture(scope="module")
def wind() -> xr.Dataset:
    """A day with three bursts, in power."""
    return recorded("WIND", sky(BURSTS))


@pytest.fixture(scope="module")
def stereo() -> xr.Dataset:
    """The same in dB by the minute."""
    return recorded("STEREO-A", sky(BURSTS))


def has_onset(table: pd.DataFrame, stamp: str) -> bool:
    """Whether there is an onset within a minute and a half of a time."""
    return bool((abs(table["start_utc"] - pd.Timestamp(stamp)) < pd.Timedelta(90, "s")).any())


def assert_same_bursts(found: pd.DataFrame, expected: pd.DataFrame) -> None:
    """The tables say the same but for rounding."""
    pd.testing.assert_frame_equal(found, expected, rtol=1e-3)


@pytest.mark.parametrize("observatory", ["WIND", "STEREO-A", "SOLO"])
def test_bright_bursts_are_found_once_at_their_time_and_nothing_else(observatory: str) -> None:
    found = accepted(recorded(observatory, sky(BURSTS)))

    assert len(found) == len(BURSTS)
    assert found["isolated"].all()
    for (_, row), burst in zip(found.iterrows(), BURSTS, strict=True):
        # light takes at most 9 min to the fleet of that day, the beam less than 3 min to 5 MHz
        assert 0 < (row["start_utc"] - pd.Timestamp(burst.release_utc)).total_seconds() < 720
        assert row["start_utc"] <= row["peak_utc"] < row["end_utc"]
        assert row["f_low_mhz"] < 0.5
        assert row["f_high_mhz"] == pytest.approx(burst.f_high_mhz, rel=0.45)


@pytest.mark.parametrize("observatory", ["WIND", "STEREO-A"])
@pytest.mark.parametrize("trouble", TROUBLED)
def test_no_nuisance_is_taken_for_a_burst(observatory: str, trouble: str) -> None:
    assert accepted(recorded(observatory, TROUBLED[trouble])).empty


def test_what_lasts_too_long_at_one_frequency_is_refused_with_that_reason() -> None:
    what = sky_of(DAY_OF_ARCS, 55)  # the first with several arcs that last too long
    arcs = [one for one in what.conditions["STEREO-A"].nuisances if one.kind == "jovian_arc"]
    table = detect_bursts(spectrum_of("STEREO-A", DAY_OF_ARCS, [what], 1))
    long = table[table["reason"] == TOO_LONG]

    assert len(long) >= 1
    assert set(long["tier"]) == {"rejected"}
    for start_s in (long["start_utc"] - pd.Timestamp(DAY_OF_ARCS)).dt.total_seconds():
        assert any(arc.start_s < start_s < arc.stop_s for arc in arcs)


@pytest.mark.parametrize("trouble", [name for name in TROUBLED if name != "gap"])
def test_a_burst_is_found_among_nuisances(trouble: str) -> None:
    what = TROUBLED[trouble]
    conditions = what.conditions["WIND"]
    found = accepted(recorded("WIND", sky([burst_at(17.0)], conditions.nuisances, conditions.gaps_s, conditions.gain)))

    assert starts(found)[0][:3] == "17:"
    assert len(found) == 1


def test_bursts_minutes_apart_are_a_group() -> None:
    found = accepted(recorded("WIND", sky([burst_at(5.0), burst_at(5.15, contrast=60.0)])))

    assert len(found) >= 1
    assert set(found["reason"]) == {GROUP}
    assert not found["isolated"].any()


def test_a_gap_in_the_flank_is_told() -> None:
    found = accepted(recorded("STEREO-A", sky([burst_at(5.0)], gaps_s=((18_600.0, 18_900.0),))))

    assert list(found["reason"]) == [GAP]


def test_wavering_of_a_bright_burst_is_no_second_burst(stereo: xr.Dataset) -> None:
    waver = np.where(np.arange(stereo.sizes["time"]) % 2, 1.0, 0.75)[:, None]  # as a spinning antenna may give
    wavering = stereo.assign(intensity=(stereo["intensity"] * waver).astype(np.float32))

    assert accepted(wavering)["isolated"].all()


@pytest.mark.parametrize("minutes", [1, 37, 719])
def test_moving_the_day_moves_the_table(wind: xr.Dataset, minutes: int) -> None:
    apart = np.timedelta64(minutes * 60, "s")
    sample_time = (("time", "frequency"), wind["sample_time"].to_numpy() + apart)
    moved = wind.assign_coords(time=wind["time"] + apart).assign(sample_time=sample_time)
    found, expected = detect_bursts(moved), detect_bursts(wind)
    for column in ("start_utc", "peak_utc", "end_utc"):
        expected[column] += apart

    assert_same_bursts(found, expected)


def test_gain_does_not_matter(wind: xr.Dataset) -> None:
    louder = wind.assign(intensity=wind["intensity"] * 10.0)

    assert_same_bursts(detect_bursts(louder), detect_bursts(wind))


def test_quantity_does_not_matter(wind: xr.Dataset) -> None:
    found, expected = detect_bursts(over_background(wind)), detect_bursts(wind)

    # the background of what is over background already is nearly, not quite, zero
    kept = ["observatory", "start_utc", "tier", "reason"]
    pd.testing.assert_frame_equal(found[kept], expected[kept])
    # peaks of channels differ by 0.03 dB, and which is the highest is chance
    np.testing.assert_allclose(found["peak_db"], expected["peak_db"], atol=0.1)
    np.testing.assert_allclose(found["score"], expected["score"], rtol=0.05)


def test_dead_channels_do_not_matter(stereo: xr.Dataset) -> None:
    dead = stereo.isel(frequency=slice(5, None, 12)).assign_coords(
        frequency=stereo["frequency"].to_numpy()[5::12] * 1.0001
    )
    dead = dead.assign(intensity=dead["intensity"] * np.nan)
    whole = xr.concat([stereo, dead], "frequency", data_vars="minimal").sortby("frequency")

    assert_same_bursts(detect_bursts(whole), detect_bursts(stereo))


def test_interpolated_channels_do_not_matter(stereo: xr.Dataset) -> None:
    flag = np.zeros(stereo.sizes["frequency"], dtype=np.int8)
    flag[3::7] = 1
    filled = stereo.assign(interpolated=("frequency", flag))
    filled["intensity"] = filled["intensity"].where(flag == 0, 40.0)

    assert_same_bursts(detect_bursts(filled), detect_bursts(stereo.isel(frequency=np.flatnonzero(flag == 0))))


def test_a_burst_across_midnight_is_found_once() -> None:
    evening = sky([burst_at(23.97)])
    morning = DAY.replace(day=DAY.day + 1)
    days = join_days([recorded("STEREO-A", evening), recorded("STEREO-A", evening, morning)])
    found = accepted(days)

    assert len(found) == 1
    assert starts(found)[0][:3] in {"23:", "00:"}
    assert found["end_utc"].iloc[0] > pd.Timestamp(morning)


def test_a_clipped_burst_is_still_one(wind: xr.Dataset) -> None:
    quiet = wind["intensity"].median("time")
    clipped = wind.assign(intensity=np.minimum(wind["intensity"], 6.0 * quiet).astype(np.float32))
    found, whole = accepted(clipped), accepted(wind)

    assert len(found) == len(whole)
    assert (found["start_utc"] - whole["start_utc"]).abs().max() <= pd.Timedelta(minutes=2)


@pytest.mark.parametrize("observatory", ["WIND", "STEREO-A"])
def test_bursts_backwards_are_none(observatory: str) -> None:
    assert accepted(mirrored(recorded(observatory, sky(BURSTS)))).empty


@pytest.mark.parametrize(
    "part",
    [
        {"time": slice(0, 2)},
        {"time": slice(0, 1)},
        {"frequency": slice(100, 101)},
        {"frequency": slice(100, 103)},
        {"time": slice(400, 430)},
    ],
    ids=["two_records", "one_record", "one_channel", "three_channels", "half_an_hour"],
)
def test_too_little_to_search_gives_an_empty_table(stereo: xr.Dataset, part: dict[str, slice]) -> None:
    table = accepted(stereo.isel(part))

    assert table.empty
    assert dict(table.dtypes.astype(str)) == DETECTION_COLUMNS


@pytest.mark.parametrize("value", [np.nan, 0.0, -5.0, 3.0])
def test_a_day_of_one_value_gives_an_empty_table(stereo: xr.Dataset, value: float) -> None:
    table = detect_bursts(stereo.assign(intensity=xr.full_like(stereo["intensity"], value)))

    assert table.empty
    assert dict(table.dtypes.astype(str)) == DETECTION_COLUMNS


def test_a_day_of_interpolated_channels_only_gives_an_empty_table(stereo: xr.Dataset) -> None:
    flag = np.ones(stereo.sizes["frequency"], dtype=np.int8)

    assert detect_bursts(stereo.assign(interpolated=("frequency", flag))).empty


def test_an_unknown_quantity_is_refused(stereo: xr.Dataset) -> None:
    with pytest.raises(InputError, match="cannot be turned into dB"):
        detect_bursts(stereo.assign_attrs(quantity="counts"))


@pytest.fixture(scope="module")
def days_2010(reference_files: Path) -> dict[str, xr.Dataset]:
    """2010-01-17."""
    wind = combine_receivers(real_day.wind(reference_files, "RAD1"), real_day.wind(reference_files, "RAD2"))
    sides = {f"STEREO-{side[0].upper()}": real_day.stereo(reference_files, side) for side in ("ahead", "behind")}
    return {"WIND": wind, **sides}


def test_bursts_of_2010_01_17(days_2010: dict[str, xr.Dataset]) -> None:
    found = {name: accepted(one) for name, one in days_2010.items()}

    assert has_onset(found["STEREO-B"], "2010-01-17T03:58")
    assert has_onset(found["WIND"], "2010-01-17T03:58")
    assert has_onset(found["STEREO-A"], "2010-01-17T11:46")
    assert not any(start.startswith("11:") for start in starts(found["STEREO-B"]))
    assert max(map(len, found.values())) <= 8


@pytest.mark.parametrize("observatory", ["WIND", "STEREO-A", "STEREO-B"])
def test_2010_01_17_backwards_has_no_burst(days_2010: dict[str, xr.Dataset], observatory: str) -> None:
    assert accepted(mirrored(days_2010[observatory])).empty


@pytest.mark.parametrize(
    ("opened", "onsets"),
    [
        (real_day_2020.wind, ("02:55", "07:05", "07:23")),
        (real_day_2020.stereo_a, ("02:54", "06:25", "07:04", "07:21")),
        (real_day_2020.psp, ("02:53", "06:23", "07:03", "07:20")),
    ],
    ids=["wind", "stereo_a", "psp"],
)
def test_bursts_of_2020_07_21(reference_files: Path, opened: Opener, onsets: tuple[str, ...]) -> None:
    found = accepted(opened(reference_files))

    assert [onset for onset in onsets if not has_onset(found, f"2020-07-21T{onset}")] == []
    assert len(found) <= 12
