"""Wave directions from the files of a day to a solution: found with the burst, crossed, fused with its times."""

from collections.abc import Callable
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from bella.arrivals import locate_receivers
from bella.bursts.timing import burst_spectrum, time_burst
from bella.catalogue import Series
from bella.multilateration import localise
from bella.pipeline.burst import BurstOutcome, Choice
from bella.pipeline.day import FoundBurst, FoundDay, _channel_tables, search_day, timed_burst
from bella.pipeline.inputs import BurstInput
from bella.pipeline.run import begin_found
from bella.pipeline.surroundings import surroundings_of
from bella.pipeline.tracks import Timing, burst_directions
from bella.settings import Settings
from bella.simulation.archive_days import simulate_days
from tests.pipeline.examples import files_of, whole_track

DAY, SEED = date(2012, 6, 5), 1
PHI0_DEG = -79.2
"""Of the burst that is released at 16:28:52."""

EDGE = "half_rise"


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> FoundDay:
    root = tmp_path_factory.mktemp("archive")
    stereo = [f"ST{side}_L3_WAV_{band}" for side in "AB" for band in ("LFR", "HFR")]
    simulate_days(root, [DAY], SEED, ("WI_L2_WAV_RAD1", "WI_L2_WAV_RAD2", *stereo))
    return search_day(files_of(DAY, sorted(root.rglob("*.cdf"))), ())


@pytest.fixture(scope="module")
def given(found: FoundDay) -> BurstInput:
    (burst,) = [one for one in found.bursts if one.edges and one.found.start_utc.hour == 16]
    return timed_burst(found.files, burst)


def beside(given: BurstInput, directions: pd.DataFrame | None) -> dict[str, Any]:
    """Track of the burst with these directions."""
    arrivals, settings = locate_receivers(given.arrivals[EDGE]), Settings(draws=1000)
    posterior = localise(arrivals, draws=50)
    timing = Timing(arrivals, locate_receivers(given.channel_arrivals[EDGE]), directions)
    around = surroundings_of(given.burst.start_utc, settings)
    return whole_track(posterior, timing, Series(EDGE, "posterior", "default", 2), settings, around)[0]


@pytest.fixture(scope="module")
def track(given: BurstInput) -> dict[str, Any]:
    return beside(given, given.directions)


def test_a_found_burst_brings_the_directions_of_its_files(given: BurstInput) -> None:
    assert given.directions is not None
    assert given.directions.groupby("observatory").size().between(25, 45).all()
    assert set(given.directions["observatory"]) == {"STEREO-A", "STEREO-B"}
    inside = given.directions["frequency_mhz"].between(given.burst.f_low_mhz, given.burst.f_high_mhz)
    assert inside.all()


def test_directions_cross_where_the_arrival_times_say(track: dict[str, Any]) -> None:
    rows = track["companions"]["triangulation"]["rows"]
    assert len(rows) >= 3
    joint = track["joint"]
    ln_f, ln_r = zip(
        *((np.log(at["frequency_mhz"]), np.log(at["range_rsun"]["q50"])) for at in joint["profile"]), strict=True
    )
    for row in rows:
        expected = np.exp(np.interp(np.log(row["frequency_mhz"]), ln_f, ln_r))
        assert abs(row["range_rsun"] - expected) < 3 * row["range_sd_rsun"]


def test_the_fused_fit_holds_the_truth_and_says_what_directions_add(track: dict[str, Any]) -> None:
    fused, joint = track["companions"]["fused"], track["joint"]
    (directions,) = fused["ingredients"]
    assert directions["name"] == "wave_directions"
    assert fused["phi0_deg"]["q2_5"] < PHI0_DEG < fused["phi0_deg"]["q97_5"]
    # the fit without directions is the joint fit itself: the same times with the same noise
    for name in ("phi0_deg", "v_sw_km_s"):
        width, without = (one[name]["q84"] - one[name]["q16"] for one in (fused, joint))
        assert directions["sd_ratio"][name] == pytest.approx(width / without)
    assert directions["sd_ratio"]["phi0_deg"] < 1.1
    assert "ingredients_disagree" not in fused["flags"]


def test_a_burst_of_arrival_times_alone_says_so(given: BurstInput) -> None:
    companions = beside(given, None)["companions"]
    for name, words in (("triangulation", "no wave directions"), ("fused", "neither wave directions nor")):
        assert companions[name]["flags"] == ["not_computed"]
        assert words in companions[name]["reason"]


def test_spectra_without_a_record_of_the_burst_have_no_directions_and_end_nothing(found: FoundDay) -> None:
    (burst,) = [one for one in found.bursts if one.edges and one.found.start_utc.hour == 16]
    spectra = [one.searched.over for one in burst.found.members]
    start = burst.found.start_utc.to_datetime64()
    window = (start - np.timedelta64(9, "D"), start - np.timedelta64(8, "D"))
    assert burst_directions(spectra, window, (0.3, 1.0)).empty


def test_wave_vectors_that_point_from_the_source_are_turned_towards_it(found: FoundDay, given: BurstInput) -> None:
    (burst,) = [one for one in found.bursts if one.edges and one.found.start_utc.hour == 16]
    spectra = [one.searched.over for one in burst.found.members]
    assert given.directions is not None
    start = burst.found.start_utc.to_datetime64()
    window = (start - np.timedelta64(30, "m"), start + np.timedelta64(60, "m"))
    band = (given.burst.f_low_mhz, given.burst.f_high_mhz)
    towards = burst_directions(spectra, window, band)
    away = burst_directions([reversed_waves(one) for one in spectra], window, band)
    assert len(towards) > 20
    pd.testing.assert_frame_equal(away, towards, rtol=1e-4)


def reversed_waves(over: xr.Dataset) -> xr.Dataset:
    """Spectra whose wave vectors have the opposite sign."""
    turned = {name: (over[name] + 180.0) % 360.0 for name in over if str(name).startswith("wave_azimuth")}
    return over.assign(turned | {name: 180.0 - over[name] for name in over if str(name).startswith("wave_colatitude")})


def test_a_burst_is_passed_on_with_its_own_part_of_the_spectra(found: FoundDay) -> None:
    whole = {str(one.attrs["observatory"]): one.sizes["time"] for one in found.spectra}
    for one in found.bursts:
        parts = {member.searched.observatory: member.searched.over.sizes["time"] for member in one.found.members}
        assert all(bool(size) == bool(one.edges) and size < 0.3 * whole[name] for name, size in parts.items())
        assert all(member.searched.grid.excess_db.size == 0 for member in one.found.members)


def test_an_edge_without_channels_is_fitted_by_its_table(found: FoundDay) -> None:
    (burst,) = [one for one in found.bursts if one.edges and one.found.start_utc.hour == 16]
    members = [member for member in burst.found.members if member.fits]
    timed = time_burst([burst_spectrum(member.searched, member.candidate) for member in members], EDGE)
    without = replace(timed, noise=timed.noise.take(np.arange(3)))
    assert _channel_tables({EDGE: timed, "half_maximum": without}, members).keys() == {EDGE}


def changed(found: FoundDay, change: Callable[[xr.Dataset], xr.Dataset]) -> FoundBurst:
    """The burst, with other spectra of what is the same in its detections."""
    (one,) = [one for one in found.bursts if one.edges and one.found.start_utc.hour == 16]
    members = tuple(
        replace(member, searched=member.searched._replace(over=change(member.searched.over)))
        for member in one.found.members
    )
    return replace(one, found=replace(one.found, members=members))


def silent(over: xr.Dataset) -> xr.Dataset:
    """Wind with no signal."""
    return over.assign(intensity=0.0 * over["intensity"]) if over.attrs["observatory"] == "WIND" else over


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (silent, "good edges at WIND"),
        (lambda over: over.isel(time=slice(0, 0)), "no record"),
    ],
)
def test_a_burst_whose_edges_do_not_place_it_is_a_reason(
    found: FoundDay, tmp_path: Path, change: Callable[[xr.Dataset], xr.Dataset], said: str
) -> None:
    one = changed(found, change)
    done = begin_found(found.files, one, Choice(), Settings(home=tmp_path), "run")
    assert isinstance(done, BurstOutcome)
    assert (done.burst_id, done.outcomes) == (one.burst_id, ())
    assert said in done.reason
    assert not (tmp_path / "catalogue.sqlite").exists()
