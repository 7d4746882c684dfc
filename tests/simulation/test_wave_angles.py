"""Simulated wave directions: of the source where a burst is received, of nothing elsewhere, and in the files."""

from datetime import date
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from bella.simulation.archive_days import write_spectra
from bella.simulation.burst import SimulatedBurst, source_position_rsun
from bella.simulation.day import observe_day
from bella.simulation.instruments import instruments
from bella.simulation.sky import Sky
from bella.spacecraft import position_hee
from bella.spectra import open_spectra
from bella.tracks.directions import wave_directions

DAY = date(2012, 6, 7)
RELEASE = np.datetime64("2012-06-07T19:20", "ns")
WINDOW = RELEASE - np.timedelta64(20, "m"), RELEASE + np.timedelta64(60, "m")
BURST = SimulatedBurst(RELEASE, phi0_deg=20.0, f_low_mhz=0.3, f_high_mhz=5.0, contrast=30.0)


@pytest.fixture(scope="module")
def received() -> xr.Dataset:
    """One burst on a day of STEREO-A's HFR."""
    (instrument,) = instruments("STA_L3_WAV_HFR", DAY)
    return observe_day(instrument, [Sky(DAY, (BURST,), (), {})], DAY, np.random.default_rng(2))


def test_directions_point_to_the_source_within_their_scatter(received: xr.Dataset) -> None:
    table = wave_directions(received, WINDOW)
    place = position_hee("STEREO-A", np.array([RELEASE]), RELEASE)[0]
    x, y, _ = (source_position_rsun(BURST, table["frequency_mhz"].to_numpy()) - place).T
    away = (table["longitude_deg"] - np.degrees(np.arctan2(y, x)) + 180) % 360 - 180
    assert len(table) > 50
    assert table["frequency_mhz"].between(0.29, 5.01).all()
    assert abs(away.median()) < 0.5
    assert away.std() < 2.5
    assert abs(table["latitude_deg"].median()) < 1.0
    assert not table.attrs["turned"], "angles are those towards the source"


def test_a_quiet_day_has_no_directions(received: xr.Dataset) -> None:
    before = WINDOW[0] - np.timedelta64(5, "h"), WINDOW[0] - np.timedelta64(4, "h")
    assert len(wave_directions(received, before)) == 0


def test_angles_survive_the_file(received: xr.Dataset, tmp_path: Path) -> None:
    (read,) = open_spectra(write_spectra([received], "STA_L3_WAV_HFR", DAY, tmp_path))
    for name in ("wave_colatitude_hee_deg", "wave_azimuth_hee_deg"):
        np.testing.assert_allclose(read[name], received[name], rtol=1e-6)


def test_the_lfr_has_none() -> None:
    (instrument,) = instruments("STA_L3_WAV_LFR", DAY)
    assert "wave_azimuth_hee_deg" not in observe_day(instrument, [], DAY, np.random.default_rng(2))
