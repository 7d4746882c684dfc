from pathlib import Path

import h5py
import numpy as np
import pytest

from bella.spacecraft.encode import SOURCE_NAMES, TOLERANCE_KM, Orbit, encode, read_source, thin, to_dataset
from bella.spacecraft.ephemeris import REFERENCE, _ecliptic_km

SOURCE = "ephemeris/huxt_ephemeris_subset.h5"
DAY_MS = 86_400_000
PROMISE_KM = 100.0


def circle(days: int, period_d: float) -> Orbit:
    time_ms = np.arange(0, days * DAY_MS, DAY_MS // 8)
    angle = 2.0 * np.pi * time_ms / DAY_MS / period_d
    return Orbit(time_ms, 1.5e8 * np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=-1))


@pytest.mark.parametrize("body", SOURCE_NAMES)
def test_every_position_of_the_dense_source_is_met(body: str, reference_files: Path) -> None:
    orbit = read_source(reference_files / SOURCE, body)
    found_km = _ecliptic_km(body, REFERENCE + (orbit.time_ms * 1_000_000).astype("timedelta64[ns]"))

    assert np.linalg.norm(found_km - orbit.position_km, axis=1).max() < PROMISE_KM


def test_the_source_is_read_as_its_columns_say(reference_files: Path) -> None:
    with h5py.File(reference_files / SOURCE) as source:
        julian_day, radius_km = source["STA/HAE/time"][:], source["STA/HAE/radius"][:]

    orbit = read_source(reference_files / SOURCE, "STEREO-A")

    np.testing.assert_allclose(orbit.time_ms / DAY_MS + 2_451_544.5, julian_day, atol=1e-8, rtol=0.0)
    np.testing.assert_allclose(np.linalg.norm(orbit.position_km, axis=1), radius_km, rtol=1e-12)


def test_the_packaged_table_is_what_the_source_gives(reference_files: Path, tmp_path: Path) -> None:
    encode(reference_files / SOURCE, tmp_path / "again.nc")

    packaged = Path(__file__).parents[2] / "bella" / "spacecraft" / "ephemeris.nc"
    assert packaged.stat().st_size < 1_000_000
    with h5py.File(packaged) as ours, h5py.File(tmp_path / "again.nc") as again:
        np.testing.assert_array_equal(ours["time"][:], again["time"][:])
        np.testing.assert_array_equal(ours["position"][:], again["position"][:])


def test_a_smooth_orbit_needs_few_nodes() -> None:
    orbit = circle(700, period_d=365.0)

    assert len(thin(orbit).time_ms) < len(orbit.time_ms) / 20


def test_a_jump_is_surrounded_by_nodes() -> None:
    orbit = circle(700, period_d=365.0)
    orbit.position_km[2800:, 0] += 24_000.0

    kept = thin(orbit)

    jump_ms = orbit.time_ms[2800]
    assert {orbit.time_ms[2799], jump_ms} <= set(kept.time_ms.tolist())
    table = to_dataset({"EARTH": kept})
    assert table["position"].dtype == np.int32
    assert table.attrs["tolerance_km"] == TOLERANCE_KM
