"""Scattering of sources: the models against what else is published about them, and what they make of a track."""

from importlib.resources import files
from typing import Any

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from bella.exceptions import InputError
from bella.flags import APPARENT_SOURCE
from bella.heliosphere import (
    DENSITY_MODELS,
    emission_frequency_mhz,
    emission_range_rsun,
    spiral_longitude_deg,
)
from bella.records import JointTrack, Moment, Parameter
from bella.tracks.fit import TrackFit
from bella.tracks.likelihood import Evidence, Likelihood
from bella.tracks.model import Rows, Track, TrackModel
from bella.tracks.scattering import (
    TABLE,
    apparent_over_true,
    corrected_spiral,
    density_companion,
    density_excess,
    scattering_companion,
    scattering_models,
)

LEBLANC = DENSITY_MODELS["leblanc"]
HARMONIC_OF = {"fundamental": 1, "harmonic": 2}
SHIFT = {"fundamental": 1.1, "harmonic": 1.0}
"""The fundamental leaves at 1.1 of the plasma frequency."""

MHZ = np.array([0.15, 0.5, 1.0, 2.0, 10.0])
BAND_MHZ = np.geomspace(0.15, 2.0, 40)
EPOCH = np.datetime64("2012-06-07T19:00", "ns")


def emitted_rsun(word: str, frequency_mhz: np.ndarray) -> np.ndarray:
    """Where a burst in the wind that was simulated is emitted."""
    return emission_range_rsun(frequency_mhz / SHIFT[word], DENSITY_MODELS["parker"], HARMONIC_OF[word])


def apparent_rsun(word: str, frequency_mhz: np.ndarray) -> np.ndarray:
    return np.asarray(emitted_rsun(word, frequency_mhz) * scattering_models()[word].radius_factor(frequency_mhz))


def solution(range_rsun: np.ndarray, frequency_mhz: np.ndarray, sd_rsun: float = 2.0) -> xr.Dataset:
    """Positions at 117 degrees with round errors."""
    angle = np.radians(117.0)
    columns = {"x_rsun": range_rsun * np.cos(angle), "y_rsun": range_rsun * np.sin(angle)}
    for pair, value in (("xx", sd_rsun**2), ("xy", 0.0), ("yy", sd_rsun**2)):
        columns[f"cov_{pair}_rsun2"] = np.full(range_rsun.shape, value)
    return xr.Dataset({name: ("frequency", values) for name, values in columns.items()}, {"frequency": frequency_mhz})


def track_fit_of(phi0_deg: np.ndarray, z: np.ndarray) -> TrackFit:
    """A fit whose draws are given."""
    empty = JointTrack(
        model="drawn",
        rotation_period_d=25.38,
        epoch_utc="2012-06-07T19:00:00.000Z",
        phi0_deg=Parameter(),
        v_sw_km_s=Parameter(),
        beam_speed_c=Parameter(),
        release_utc=Moment(),
    )
    track = Track(TrackModel(), (float(BAND_MHZ[0]), float(BAND_MHZ[-1])))
    draws = {"phi0_deg": phi0_deg} if phi0_deg.size else {}
    nothing = Evidence(Rows(np.empty(0), np.empty(0), np.empty((0, 3))), np.empty(0), np.empty((0, 0)), np.empty(0), ())
    return TrackFit(empty, Likelihood(track, nothing), EPOCH, draws, z)


@pytest.fixture(scope="module")
def fit() -> TrackFit:
    """500 spirals about one at 30 degrees with a wind of 400 km/s."""
    rng = np.random.default_rng(1)
    size = Track(TrackModel(), (0.15, 2.0)).size
    return track_fit_of(30.0 + 2.0 * rng.standard_normal(500), 0.2 * rng.standard_normal((500, size)))


NO_FIT = track_fit_of(np.empty(0), np.empty((0, 0)))


@pytest.mark.parametrize("word", HARMONIC_OF)
def test_sources_appear_outside_and_late_and_more_so_at_low_frequencies(word: str) -> None:
    model = scattering_models()[word]
    assert (model.radius_factor(MHZ) > 1.1).all()
    assert (np.diff(model.delay_s(MHZ)) < 0).all()
    assert (np.diff(apparent_rsun(word, MHZ)) < 0).all()


def test_fundamental_and_harmonic_appear_at_the_same_place() -> None:
    """As Kontar et al. 2023 conclude, though they are emitted at distances that differ by 1.7."""
    both = apparent_rsun("fundamental", MHZ) / apparent_rsun("harmonic", MHZ)
    np.testing.assert_allclose(both, 1.0, atol=0.25)
    factor = [model.radius_factor(MHZ) for model in scattering_models().values()]
    assert (factor[0] > factor[1]).all()


@pytest.mark.parametrize(("word", "expected"), [("fundamental", 9.6), ("harmonic", 15.8)])
def test_emission_of_a_corrected_burst_is_where_its_authors_have_it(word: str, expected: float) -> None:
    """2020-07-21, 0.9 MHz (Clarkson et al. 2025, figure 4)."""
    at = np.array([0.9])
    (row,) = scattering_companion(solution(apparent_rsun(word, at), at), NO_FIT)["rows"]
    assert row[word]["range_rsun"] == pytest.approx(expected, abs=0.2)


@pytest.mark.parametrize("word", HARMONIC_OF)
def test_emission_distances_of_the_table_belong_to_its_density_model(word: str) -> None:
    with (files("bella.tracks") / TABLE).open() as table:
        rows = pd.read_csv(table, comment="#")
    part = rows[rows["harmonic"] == HARMONIC_OF[word]]
    parker = DENSITY_MODELS["parker"]
    expected = SHIFT[word] * emission_frequency_mhz(part["emission_rsun"].to_numpy(), parker, HARMONIC_OF[word])
    np.testing.assert_allclose(part["frequency_mhz"], expected, rtol=0.006)


def test_simulated_frequencies_give_simulated_numbers() -> None:
    model = scattering_models()["fundamental"]
    at = np.array([0.288, 1.94])
    np.testing.assert_allclose(model.radius_factor(at), [59.6 / 25, 14.3 / 5.5])
    np.testing.assert_allclose(model.delay_s(at), [214.0, 27.4])
    between = np.sqrt(0.288 * 0.52)
    assert model.delay_s(np.array([between]))[0] == pytest.approx(np.sqrt(214.0 * 114.0))


@pytest.mark.parametrize("frequency", [0.05, 40.0])
def test_nothing_is_said_where_nothing_was_simulated(frequency: float) -> None:
    model = scattering_models()["harmonic"]
    assert np.isnan(model.radius_factor(np.array([frequency]))).all()
    assert np.isnan(model.delay_s(np.array([frequency]))).all()


@pytest.mark.parametrize("harmonic", [1, 2])
@pytest.mark.parametrize("name", ["leblanc", "saito", "parker", "newkirk"])
def test_a_source_where_the_model_has_it_has_no_excess(name: str, harmonic: int) -> None:
    model = DENSITY_MODELS[name]
    frequency = np.array([3.0, 5.0, 30.0]) if name != "newkirk" else np.array([40.0, 60.0])
    distance = emission_range_rsun(frequency, model, harmonic)
    np.testing.assert_allclose(density_excess(frequency, distance, harmonic, model), 1.0, rtol=1e-6)


def test_excess_of_the_published_burst() -> None:
    """2 MHz at 10, and 0.15 MHz at 150 solar radii: some five times Leblanc's density even as harmonic."""
    frequency, distance = np.array([2.0, 0.15]), np.array([10.0, 150.0])

    excess = density_excess(frequency, distance, 2)

    assert excess[1] == pytest.approx(69.8 / 14.675, rel=0.002)
    assert excess[0] == pytest.approx(12405 / 3790.0, rel=0.001)
    np.testing.assert_allclose(density_excess(frequency, distance, 1), 4 * excess)
    assert np.isnan(density_excess(frequency, distance, 1, DENSITY_MODELS["newkirk"])[1])


def test_no_density_below_the_surface_and_no_mixed_shapes() -> None:
    assert np.isnan(density_excess(np.array([1.0]), np.array([0.5]), 1)).all()
    with pytest.raises(InputError, match="differ in shape"):
        density_excess(np.zeros(2), np.zeros(3), 1)


def test_density_companion_is_one_where_the_model_puts_the_source() -> None:
    rows = density_companion(solution(emission_range_rsun(BAND_MHZ, LEBLANC), BAND_MHZ))["rows"]
    assert len(rows) == 5
    assert (rows[0]["frequency_mhz"], rows[-1]["frequency_mhz"]) == (0.15, 2.0)
    for row in rows:
        assert row["range_sd_rsun"] == pytest.approx(2.0)
        assert row["fundamental"]["mean"] == row["fundamental"]["q50"] == pytest.approx(1.0, rel=1e-6)
        assert row["harmonic"]["mean"] == pytest.approx(0.25, rel=1e-6)
    # errors of 2 solar radii where the density falls with the square of the distance
    inner, outer = rows[0]["fundamental"]["q16"], rows[0]["fundamental"]["q84"]
    assert inner == pytest.approx((1 - 2 / rows[0]["range_rsun"]) ** 2, rel=0.02)
    assert outer == pytest.approx((1 + 2 / rows[0]["range_rsun"]) ** 2, rel=0.02)


def test_a_source_inside_the_sun_has_no_density() -> None:
    (row,) = density_companion(solution(np.array([0.5]), np.array([1.0])))["rows"]
    assert row["fundamental"]["mean"] is None


def test_a_solution_without_positions_is_refused_in_words() -> None:
    nothing = solution(np.empty(0), np.empty(0))
    for companion in (density_companion, lambda posterior: scattering_companion(posterior, NO_FIT)):
        with pytest.raises(InputError, match="no positions"):
            companion(nothing)


@pytest.mark.parametrize(
    ("word", "frequency_mhz", "apparent", "emission", "delay_s"),
    [
        ("fundamental", 0.167, 86.0, 40.0, 394.0),
        ("fundamental", 1.94, 14.3, 5.5, 27.4),
        ("harmonic", 0.16, 106.0, 70.0, 209.0),
    ],
)
def test_simulated_sources_are_put_back_where_they_were_emitted(
    word: str, frequency_mhz: float, apparent: float, emission: float, delay_s: float
) -> None:
    """Kontar et al. 2023, doi:10.3847/1538-4357/acf6c1, nominal turbulence."""
    found = scattering_companion(solution(np.array([apparent]), np.array([frequency_mhz])), NO_FIT)
    (row,) = found["rows"]
    assert (row["apparent_rsun"], row["apparent_sd_rsun"]) == (pytest.approx(apparent), pytest.approx(2.0))
    assert row[word]["range_rsun"] == pytest.approx(emission)
    assert row[word]["range_sd_rsun"] == pytest.approx(2.0 * emission / apparent)
    assert row[word]["delay_s"] == pytest.approx(delay_s)
    assert found["apparent"] == APPARENT_SOURCE
    assert "10.3847/1538-4357/acf6c1" in found["source"]
    assert found["model"] == "kontar-2023-fundamental, kontar-2023-harmonic"
    assert found["joint"] == {}


@pytest.mark.parametrize("word", HARMONIC_OF)
def test_a_burst_in_the_wind_of_a_model_has_no_excess_once_corrected(word: str) -> None:
    emitted = emission_range_rsun(BAND_MHZ, LEBLANC, HARMONIC_OF[word])
    apparent = emitted * scattering_models()[word].radius_factor(BAND_MHZ)
    for row in scattering_companion(solution(apparent, BAND_MHZ), NO_FIT)["rows"]:
        excess = row[word]["excess"]
        assert excess["mean"] == pytest.approx(1.0, rel=1e-6)
        assert excess["q16"] < excess["q50"] < excess["q84"]


def test_a_source_at_150_solar_radii_is_explained_by_half_of_its_excess_density() -> None:
    """0.15 MHz as harmonic: 4.8 times the density of Leblanc et al. where it appears (Canizares et al. 2024)."""
    (row,) = scattering_companion(solution(np.array([150.0]), np.array([0.15])), NO_FIT)["rows"]
    factor = np.exp(np.interp(np.log(0.15), np.log([0.128, 0.16]), np.log([127 / 85, 106 / 70])))
    assert row["harmonic"]["range_rsun"] == pytest.approx(150.0 / factor)
    assert 1.9 < row["harmonic"]["excess"]["mean"] < 2.2


def test_rows_are_empty_beyond_the_simulated_frequencies_and_inside_the_sun() -> None:
    posterior = solution(np.array([2.0, 1.2, np.nan]), np.array([40.0, 1.0, 0.9]))
    beyond, inside = scattering_companion(posterior, NO_FIT)["rows"]
    nothing: dict[str, Any] = dict.fromkeys(("mean", "q16", "q50", "q84"))
    assert beyond["harmonic"] == {"range_rsun": None, "range_sd_rsun": None, "delay_s": None, "excess": nothing}
    assert 0 < inside["fundamental"]["range_rsun"] < 1
    assert inside["fundamental"]["excess"]["mean"] is None


@pytest.mark.parametrize("word", HARMONIC_OF)
def test_a_corrected_spiral_goes_through_the_corrected_sources(fit: TrackFit, word: str) -> None:
    """Draw by draw, with the distances of the fit at three frequencies and numpy's own line."""
    model, at = scattering_models()[word], np.array([0.2, 0.6, 1.8])
    spiral = corrected_spiral(fit, model, at)

    apparent = fit.track.range_rsun(fit.z, fit.track.basis(at))
    wind_km_s = 400.0 / fit.track.slowness(fit.z)
    longitude = spiral_longitude_deg(apparent, fit.draws["phi0_deg"][:, None], wind_km_s, 25.38)
    lines = [
        np.polyfit(r / model.radius_factor(at) - 1.0, line, 1) for r, line in zip(apparent, longitude, strict=True)
    ]
    turn = 360 / 25.38 / 86400 * 695_700
    for name, expected in (("phi0_deg", [line[1] for line in lines]), ("v_sw_km_s", [-turn / s for s, _ in lines])):
        assert spiral[name]["mean"] == pytest.approx(np.mean(expected), rel=1e-6)
        assert spiral[name]["q16"] == pytest.approx(np.quantile(expected, 0.16), rel=0.02)
    assert spiral["v_sw_km_s"]["q50"] < 400.0 / 1.2
    assert spiral["rotation_period_d"] == 25.38


def test_a_corrected_longitude_stays_within_half_a_turn() -> None:
    """Draws at 185 degrees, as a fit across the far side has them."""
    at_far_side = track_fit_of(np.full(3, 185.0), np.zeros((3, Track(TrackModel(), (0.15, 2.0)).size)))
    spiral = corrected_spiral(at_far_side, scattering_models()["harmonic"], BAND_MHZ)
    assert -180 < spiral["phi0_deg"]["q50"] < -170


def test_two_frequencies_make_no_spiral(fit: TrackFit) -> None:
    assert corrected_spiral(fit, scattering_models()["harmonic"], np.array([0.2, 0.5, 50.0])) == {}
    companion = scattering_companion(solution(20 / BAND_MHZ, BAND_MHZ), fit)
    assert set(companion["joint"]) == set(HARMONIC_OF)


@pytest.mark.parametrize("word", HARMONIC_OF)
def test_the_ratio_of_winds_is_that_of_the_spirals(word: str) -> None:
    """Sources of the simulations on a spiral of 400 km/s appear on one that is faster by the ratio."""
    true = emitted_rsun(word, BAND_MHZ)
    longitude = spiral_longitude_deg(true, 30.0, 400.0)
    slope, _ = np.polyfit(true, apparent_rsun(word, BAND_MHZ), 1)
    assert scattering_models()[word].wind_ratio((0.15, 2.0)) == pytest.approx(slope, rel=0.02)
    turned = np.polyfit(apparent_rsun(word, BAND_MHZ), longitude, 1)[0]
    v_apparent = -360 / 25.38 / 86400 * 695_700 / turned
    assert v_apparent == pytest.approx(400.0 * slope, rel=0.02)


def test_ratio_of_winds_over_harmonics_and_turbulence() -> None:
    """Two sources of each table by hand: 86 to 14.3 over 40 to 5.5, and 106 to 14.4 over 70 to 7.7 solar radii."""
    fundamental, harmonic = (86 - 14.3) / (40 - 5.5), (106 - 14.4) / (70 - 7.7)
    mean, sd = apparent_over_true((0.16, 2.0))
    assert mean == pytest.approx((fundamental + harmonic) / 2, rel=0.03)
    turbulence = 0.17 * np.sqrt((fundamental**2 + harmonic**2) / 2)
    assert sd == pytest.approx(np.hypot(abs(fundamental - harmonic) / 2, turbulence), rel=0.05)
    assert apparent_over_true() == pytest.approx((mean, sd), rel=0.02)


def test_ratio_of_winds_counts_the_simulated_part_of_a_band() -> None:
    assert apparent_over_true((0.01, 2.0))[0] == pytest.approx(apparent_over_true((0.088, 2.0))[0], rel=0.03)
    with pytest.raises(InputError, match="no scattering was simulated from 30 to 80 MHz"):
        apparent_over_true((30.0, 80.0))
