"""The models of scattering against what else is published about them."""

import numpy as np
import pytest

from bella.exceptions import InputError
from bella.heliosphere import DENSITY_MODELS, emission_frequency_mhz, emission_range_rsun
from bella.tracks import corrected_source, density_excess, inferred_density_cm3, scattering_model
from bella.tracks.scattering import TABLE, _models

FUNDAMENTAL, HARMONIC = "kontar-2023-fundamental", "kontar-2023-harmonic"
MHZ = np.array([0.15, 0.5, 1.0, 2.0, 10.0])


def apparent_rsun(name: str, frequency_mhz: np.ndarray) -> np.ndarray:
    """Where a burst in the wind that was simulated appears; the fundamental leaves at 1.1 of the plasma frequency."""
    model = scattering_model(name)
    shift = 1.1 if model.harmonic == 1 else 1.0
    emitted = emission_range_rsun(frequency_mhz / shift, DENSITY_MODELS["parker"], model.harmonic)
    return np.asarray(emitted * model.radius_factor(frequency_mhz))


def test_without_a_model_the_source_is_the_apparent_one() -> None:
    source = corrected_source(
        np.array([20.0, 60.0]), np.array([3.0, 9.0]), np.array([0.5, 100.0]), scattering_model("none")
    )

    np.testing.assert_array_equal(source.range_rsun, [20.0, 60.0])
    np.testing.assert_array_equal(source.emission_s, [3.0, 9.0])
    assert (source.label, source.source) == ("apparent source", "")


@pytest.mark.parametrize("name", [FUNDAMENTAL, HARMONIC])
def test_a_correction_undoes_the_shift_and_says_whose_it_is(name: str) -> None:
    model = scattering_model(name)
    source = corrected_source(apparent_rsun(name, MHZ), 100.0 + model.delay_s(MHZ), MHZ, model)

    shift = 1.1 if model.harmonic == 1 else 1.0
    expected = emission_range_rsun(MHZ / shift, DENSITY_MODELS["parker"], model.harmonic)
    np.testing.assert_allclose(source.range_rsun, expected)
    np.testing.assert_allclose(source.emission_s, 100.0)
    assert source.label == f"source corrected for scattering ({name})"
    assert "10.3847/1538-4357/acf6c1" in source.source


def test_sources_appear_outside_and_late_and_more_so_at_low_frequencies() -> None:
    for name in (FUNDAMENTAL, HARMONIC):
        model = scattering_model(name)
        assert (model.radius_factor(MHZ) > 1.1).all()
        assert (np.diff(model.delay_s(MHZ)) < 0).all()
        assert (np.diff(apparent_rsun(name, MHZ)) < 0).all()
    assert (scattering_model(FUNDAMENTAL).radius_factor(MHZ) > scattering_model(HARMONIC).radius_factor(MHZ)).all()


def test_fundamental_and_harmonic_appear_at_the_same_place() -> None:
    """As Kontar et al. 2023 conclude, though they are emitted at distances that differ by 1.7."""
    both = apparent_rsun(FUNDAMENTAL, MHZ) / apparent_rsun(HARMONIC, MHZ)
    np.testing.assert_allclose(both, 1.0, atol=0.25)


def test_emission_of_a_corrected_burst_is_where_its_authors_have_it() -> None:
    """2020-07-21, 0.9 MHz: 9.6 solar radii as fundamental, 15.8 as harmonic (Clarkson et al. 2025, figure 4)."""
    at = np.array([0.9])
    for name, expected in ((FUNDAMENTAL, 9.6), (HARMONIC, 15.8)):
        apparent = apparent_rsun(name, at)
        source = corrected_source(apparent, np.zeros(1), at, scattering_model(name))
        assert source.range_rsun[0] == pytest.approx(expected, abs=0.2)


def test_emission_distances_of_the_table_belong_to_its_density_model() -> None:
    from importlib.resources import files

    import pandas as pd

    with (files("bella.tracks") / TABLE).open() as table:
        rows = pd.read_csv(table, comment="#")
    for harmonic, shift in ((1, 1.1), (2, 1.0)):
        part = rows[rows["harmonic"] == harmonic]
        expected = shift * emission_frequency_mhz(part["emission_rsun"].to_numpy(), DENSITY_MODELS["parker"], harmonic)
        np.testing.assert_allclose(part["frequency_mhz"], expected, rtol=0.006)


def test_simulated_frequencies_give_simulated_numbers() -> None:
    model = scattering_model(FUNDAMENTAL)
    at = np.array([0.288, 1.94])
    np.testing.assert_allclose(model.radius_factor(at), [59.6 / 25, 14.3 / 5.5])
    np.testing.assert_allclose(model.delay_s(at), [214.0, 27.4])


@pytest.mark.parametrize("frequency", [0.05, 40.0])
def test_nothing_is_said_where_nothing_was_simulated(frequency: float) -> None:
    model = scattering_model(HARMONIC)
    assert np.isnan(model.radius_factor(np.array([frequency]))).all()
    assert np.isnan(model.delay_s(np.array([frequency]))).all()


def test_unknown_model_and_shapes_are_refused() -> None:
    with pytest.raises(InputError, match="use one of none, kontar-2023-fundamental, kontar-2023-harmonic"):
        scattering_model("isotropic")
    with pytest.raises(InputError, match="differ in shape"):
        corrected_source(np.zeros(2), np.zeros(3), np.zeros(2), scattering_model("none"))
    assert list(_models()) == ["none", FUNDAMENTAL, HARMONIC]


@pytest.mark.parametrize("harmonic", [1, 2])
@pytest.mark.parametrize("name", ["leblanc", "saito", "parker", "newkirk"])
def test_a_source_where_the_model_has_it_has_no_excess(name: str, harmonic: int) -> None:
    frequency = np.array([3.0, 5.0, 30.0]) if name != "newkirk" else np.array([40.0, 60.0])
    distance = emission_range_rsun(frequency, DENSITY_MODELS[name], harmonic)

    rows = density_excess(frequency, distance)

    chosen = rows[(rows["model"] == name) & (rows["harmonic"] == harmonic)]
    np.testing.assert_allclose(chosen["excess"], 1.0, rtol=1e-6)


def test_excess_of_the_published_burst() -> None:
    """2 MHz at 10, and 0.15 MHz at 150 solar radii: some five times Leblanc's density even as harmonic."""
    rows = density_excess(np.array([2.0, 0.15]), np.array([10.0, 150.0]), np.array([2.0, 20.0]))

    excess = rows.set_index(["model", "harmonic", "frequency_mhz"])["excess"]
    assert excess["leblanc", 2, 0.15] == pytest.approx(69.8 / 14.675, rel=0.002)
    assert excess["leblanc", 2, 2.0] == pytest.approx(12405 / 3790.0, rel=0.001)
    assert excess["leblanc", 1, 0.15] == pytest.approx(4 * excess["leblanc", 2, 0.15])
    assert np.isnan(excess["newkirk", 1, 0.15])
    assert len(rows) == 2 * 2 * len(DENSITY_MODELS)
    assert (rows["excess_low"] < rows["excess"])[rows["excess"].notna()].all()
    assert (rows["excess_high"] > rows["excess"])[rows["excess_high"].notna()].all()


def test_density_of_a_frequency() -> None:
    assert inferred_density_cm3(np.array([8.97866e-3]), 1)[0] == pytest.approx(1.0, rel=1e-5)
    assert inferred_density_cm3(np.array([8.97866e-3]), 2)[0] == pytest.approx(0.25, rel=1e-5)


def test_no_density_below_the_surface_and_no_mixed_shapes() -> None:
    assert density_excess(np.array([1.0]), np.array([0.5]))["excess"].isna().all()
    with pytest.raises(InputError, match="differ in shape"):
        density_excess(np.zeros(2), np.zeros(3))
