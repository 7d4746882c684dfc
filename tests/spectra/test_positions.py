"""Positions inside the files of spectra: kept with the spectrum, held against the ephemeris, used where it ends."""

from datetime import date
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from bella.exceptions import NoDataError
from bella.simulation import archive_files
from bella.simulation.archive_days import write_spectra
from bella.spacecraft import hee_to, position
from bella.spectra import combine_receivers, fill_in_positions, join_days, open_spectra, receiver_position
from bella.spectra.assembly import Origin, assemble
from bella.spectra.positions import DISAGREEMENT_FLAG, EARTH_RADIUS_KM, positions_at, with_positions
from bella.units import R_SUN_KM
from tests.spectra import written

SECOND = np.timedelta64(10**9, "ns")
START = np.datetime64("2021-11-20T00:00:11", "ns")
UTC = START + np.arange(100) * 38 * SECOND
NOON = START + 1800 * SECOND


def spectrum(utc: np.ndarray = UTC, observatory: str = "STEREO-A", receiver: str = "HFR") -> xr.Dataset:
    mhz = np.array([1.0, 2.0]) if receiver == "HFR" else np.array([0.05, 0.1])
    origin = Origin(observatory, receiver, "flux_w_m2_hz", f"{receiver}.cdf")
    return assemble(origin, utc, mhz, np.ones((utc.size, 2), dtype=np.float32))


def placed(
    utc: np.ndarray = UTC, observatory: str = "STEREO-A", frame: str = "hee", receiver: str = "HFR"
) -> xr.Dataset:
    where_km = position("STEREO-A", utc, frame) * R_SUN_KM
    return with_positions(spectrum(utc, observatory, receiver), utc, where_km, frame)


def distance_km(found: np.ndarray | None, utc: np.datetime64 = NOON) -> float:
    """From STEREO-A."""
    assert found is not None
    return float(np.linalg.norm(found - position("STEREO-A", utc)[0]) * R_SUN_KM)


@pytest.mark.parametrize("name", ["sta_l3_wav_hfr_20211120_v01.cdf", "stb_l3_wav_lfr_20211120_v01.cdf"])
def test_stereo_l3_keeps_positions(tmp_path: Path, name: str) -> None:
    where_km = np.array([1.4e8, 2e7, -3e6]) + np.arange(1, 101)[:, None] * 1000.0
    where_km[4] = archive_files.FILL
    beside = archive_files.Beside(position_km=where_km)
    flux = np.ones((100, 319), dtype=np.float32)

    (read,) = open_spectra(
        archive_files.write_stereo_l3(tmp_path / name, UTC, np.linspace(125e3, 16e6, 319), flux, beside)
    )

    assert read["position_km"].attrs["frame"] == "hee"
    np.testing.assert_allclose(np.delete(read["position_km"].to_numpy(), 4, axis=0), np.delete(where_km, 4, axis=0))
    np.testing.assert_allclose(read["position_km"][4], [1.4e8 + 5e3, 2e7 + 5e3, -3e6 + 5e3])


def test_solar_orbiter_is_where_it_was_at_the_centre_of_the_sweep(tmp_path: Path) -> None:
    velocity_km_s = np.array([20.0, -30.0, 5.0])
    where_km = np.arange(100)[:, None] * 38 * velocity_km_s + [7e7, 1e7, 3e6]
    elapsed_s = np.broadcast_to(np.linspace(0.0, 16.0, 50), (100, 50))
    ones, path = np.ones((100, 50)), tmp_path / "solo_L3_rpw-hfr-surv-flux_20211120_V01.cdf"
    sweeps = archive_files.Sweeps(UTC, elapsed_s, where_km)

    (read,) = open_spectra(archive_files.write_solo_l3(path, sweeps, np.linspace(425, 16325, 50), ones, ones * 0))

    assert read["position_km"].attrs["frame"] == "hci"
    np.testing.assert_allclose(read["position_km"], where_km + 8.0 * velocity_km_s, rtol=1e-12)


@pytest.mark.parametrize(
    ("unit", "factor_km"), [("km", 1.0), ("[km]", 1.0), ("m", 1e-3), ("AU", 149597870.7), ("R", 0)]
)
def test_positions_are_in_the_unit_that_the_file_states(tmp_path: Path, unit: str, factor_km: float) -> None:
    path = tmp_path / "sta_l3_wav_hfr_20211120_v01.cdf"
    variables: list[archive_files.Variable] = [
        ("Epoch", archive_files.TT2000, archive_files.tt2000(UTC), True, {}),
        ("FREQUENCY", archive_files.REAL4, np.array([1e6, 2e6], dtype=np.float32), False, {"UNITS": "Hz"}),
        ("PSD_FLUX", archive_files.REAL4, np.ones((100, 2), dtype=np.float32), True, {}),
        ("SC_POS_HEE", archive_files.REAL8, np.ones((100, 3)), True, {"UNITS": unit}),
    ]

    (read,) = open_spectra(archive_files.write_cdf(path, path.stem, variables))

    if factor_km:
        np.testing.assert_allclose(read["position_km"], factor_km)
    else:
        assert "position_km" not in read
        assert read.attrs["left_out"] == "SC_POS_HEE"


def test_positions_that_do_not_fit_the_records_are_left_out(tmp_path: Path) -> None:
    path, flux = tmp_path / "sta_l3_wav_hfr_20211120_v01.cdf", np.ones((100, 2), dtype=np.float32)
    beside = archive_files.Beside(position_km=np.ones((99, 3)))
    archive_files.write_stereo_l3(path, UTC, np.array([1e6, 2e6]), flux, beside)

    (read,) = open_spectra(path)

    assert "position_km" not in read
    assert read.sizes["time"] == 100


@pytest.mark.parametrize(
    ("dataset", "observatory"), [("STA_L3_WAV_HFR", "STEREO-A"), ("SOLO_L3_RPW-HFR-SURV-FLUX", "SOLO")]
)
def test_simulated_files_say_where_the_ephemeris_has_the_spacecraft(
    tmp_path: Path, dataset: str, observatory: str
) -> None:
    path = write_spectra([spectrum(observatory=observatory)], dataset, date(2021, 11, 20), tmp_path)

    (read,) = open_spectra(path)

    found = receiver_position(read, NOON).position_rsun
    np.testing.assert_allclose(found, position(observatory, NOON)[0], atol=10.0 / R_SUN_KM)


def test_outside_the_ephemeris_nothing_is_written(tmp_path: Path) -> None:
    late = UTC + np.timedelta64(10_000, "D")
    path = write_spectra([spectrum(late, "SOLO")], "SOLO_L3_RPW-HFR-SURV-FLUX", date(2049, 4, 7), tmp_path)

    (read,) = open_spectra(path)

    assert "position_km" not in read


@pytest.mark.parametrize("frame", ["hee", "heeq", "hci", "carrington"])
def test_any_frame_becomes_hee(frame: str) -> None:
    assert distance_km(receiver_position(placed(frame=frame), NOON).position_rsun) < 1.0


def test_wind_is_placed_from_earth(tmp_path: Path) -> None:
    utc = np.datetime64("2012-06-07T00:00:30", "ns") + np.arange(100) * 60 * SECOND
    path = tmp_path / "wi_wa_rad1_l2_60s_20120607_v01.dat"

    (read,) = open_spectra(written.write_wind_60s(path, utc, np.array([20.0, 24.0]), np.ones((100, 2)), 2))

    found, earth = receiver_position(read, utc[50]).position_rsun, position("EARTH", utc[[50, 51]])
    sunward, dusk, north = np.array([200.0, -30.0, 5.0]) * EARTH_RADIUS_KM / R_SUN_KM
    np.testing.assert_allclose(np.linalg.norm(earth[0] - found), np.linalg.norm([sunward, dusk, north]), rtol=1e-9)
    assert earth[0, 0] - found[0] == pytest.approx(sunward)
    # dusk is the side of Earth away from where it goes
    ahead = hee_to("hci", earth[1:], utc[51]) - hee_to("hci", earth[:1], utc[50])
    assert hee_to("hci", found[None] - [[earth[0, 0] - sunward, 0.0, 0.0]], utc[50])[0] @ ahead[0] > 0.0


def test_a_position_far_from_the_ephemeris_gives_way_to_it() -> None:
    moved = placed()
    moved["position_km"] = moved["position_km"] + [0.0, 60_000.0, 0.0]
    moved["position_km"].attrs.update(frame="hee")

    found = receiver_position(moved, NOON)

    assert found.source == "ephemeris"
    assert found.flag == DISAGREEMENT_FLAG
    assert found.difference_km == pytest.approx(60_000.0, abs=1.0)
    assert distance_km(found.position_rsun) < 1.0


def test_a_position_near_the_ephemeris_is_preferred() -> None:
    moved = placed()
    moved["position_km"] = moved["position_km"] + [0.0, 40_000.0, 0.0]
    moved["position_km"].attrs.update(frame="hee")

    found = receiver_position(moved, NOON)

    assert (found.source, found.flag) == ("file", "")
    assert distance_km(found.position_rsun) == pytest.approx(40_000.0, abs=1.0)


def test_an_arrival_table_has_the_positions_of_the_files_that_agree_with_the_ephemeris() -> None:
    near, far = placed(), placed(observatory="SOLO")
    rows = pd.DataFrame({"observatory": ["STEREO-A", "SOLO", "JUICE"]})
    rows[["x_rsun", "y_rsun", "z_rsun"]] = np.nan
    lost = spectrum(observatory="JUICE")

    table, remarks = fill_in_positions(rows, {"STEREO-A": near, "SOLO": far, "JUICE": lost}, NOON)

    assert distance_km(table.loc[0, ["x_rsun", "y_rsun", "z_rsun"]].to_numpy(float)) < 1.0
    assert table.loc[1:, "x_rsun"].isna().all()
    assert rows["x_rsun"].isna().all(), "the table that was given stays"
    assert [remark.split(":")[0] for remark in remarks] == ["SOLO", "Without a position"]


def test_a_frame_that_is_not_what_it_says_is_flagged() -> None:
    mistaken = placed(frame="heeq")
    mistaken["position_km"].attrs["frame"] = "hee"

    assert receiver_position(mistaken, NOON).flag == DISAGREEMENT_FLAG


def test_a_spacecraft_unknown_to_the_ephemeris_is_where_its_file_says() -> None:
    assert distance_km(receiver_position(placed(observatory="JUICE", frame="hci"), NOON).position_rsun) < 1.0


def test_without_earth_only_hee_is_known() -> None:
    late = UTC + np.timedelta64(20_000, "D")
    where_km = np.full((100, 3), 1e8)
    in_hee = with_positions(spectrum(late), late, where_km, "hee")

    found = receiver_position(in_hee, late[50]).position_rsun
    np.testing.assert_allclose(found, where_km[0] / R_SUN_KM)
    with pytest.raises(NoDataError, match="EARTH"):
        receiver_position(with_positions(spectrum(late), late, where_km, "hci"), late[50])


def test_without_a_position_the_ephemeris_answers() -> None:
    assert receiver_position(spectrum(), NOON).source == "ephemeris"
    assert receiver_position(placed(), NOON + 7200 * SECOND).source == "ephemeris"
    nowhere = np.full((100, 3), np.nan)
    assert "position_km" not in with_positions(spectrum(), UTC, nowhere, "hee")
    with pytest.raises(NoDataError, match="give its spectrum the variable 'position_km'"):
        receiver_position(spectrum(observatory="JUICE"), NOON)


def test_positions_are_on_lines_between_what_is_known_and_not_far_from_it() -> None:
    known = START + np.array([7200, 0, 1200, 1200]) * SECOND
    where_km = np.array([[9.0, 9.0, 9.0], [0.0, 0.0, 0.0], [12.0, 0.0, 6.0], [99.0, 99.0, 99.0]])
    time = START + np.array([600, 1200, 4000, 5600]) * SECOND

    found = positions_at(time, known, where_km)

    np.testing.assert_allclose(found[:2], [[6.0, 0.0, 3.0], [12.0, 0.0, 6.0]])
    assert np.isnan(found[2]).all()
    assert np.isfinite(found[3]).all()


def test_positions_survive_receivers_days_and_selection() -> None:
    low = placed(UTC + 5 * SECOND, receiver="LFR")
    high, bare = placed(), spectrum(UTC + np.timedelta64(1, "D"))
    tomorrow = placed(UTC + np.timedelta64(1, "D"), receiver="HFR")

    both, days, half = combine_receivers(low, high), join_days([tomorrow, high]), join_days([high, bare])

    for one in (both, days, combine_receivers(high, spectrum(UTC, receiver="LFR"))):
        assert one["position_km"].dims == ("time", "axis")
        expected_km = position("STEREO-A", one["time"].to_numpy()) * R_SUN_KM
        np.testing.assert_allclose(one["position_km"], expected_km, atol=10.0)
    assert "axis" not in both["intensity"].dims
    assert distance_km(receiver_position(half, NOON).position_rsun) < 1.0
    assert np.isnan(half["position_km"][-1]).all()
    assert distance_km(receiver_position(days.isel(time=slice(30, 60)).sel(frequency=[1.0]), NOON).position_rsun) < 1.0


def test_of_two_frames_the_first_stays() -> None:
    joined = join_days([placed(), placed(UTC + np.timedelta64(1, "D"), frame="hci")])

    assert joined["position_km"].attrs["frame"] == "hee"
    np.testing.assert_array_equal(np.isfinite(joined["position_km"]).all("axis"), np.arange(200) < 100)


def test_positions_stay_through_a_netcdf_file(tmp_path: Path) -> None:
    placed().to_netcdf(tmp_path / "s.nc", engine="h5netcdf")

    (read,) = open_spectra(tmp_path / "s.nc")

    assert distance_km(receiver_position(read, NOON).position_rsun) < 1.0
