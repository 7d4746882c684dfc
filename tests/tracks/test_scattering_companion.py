"""Sources behind the apparent ones: the published numbers of the model, and the spiral that follows from them."""

import math
from typing import Any

import numpy as np
import pytest
from bella.tracks.published import joint_track

from bella.exceptions import NoDataError
from bella.flags import APPARENT_SOURCE
from bella.heliosphere import DENSITY_MODELS, emission_range_rsun, spiral_longitude_deg
from bella.tracks import JointFit, JointModel, scattering_model
from bella.tracks.scattering import NONE
from bella.tracks.scattering_companion import corrected_spiral, scattering_companion
from tests.tracks.bursts import simulated, standard

LEBLANC = DENSITY_MODELS["leblanc"]
NAMES = {"fundamental": "kontar-2023-fundamental", "harmonic": "kontar-2023-harmonic"}
MHZ = np.geomspace(0.15, 2.0, 5)
NO_FIT = JointFit(JointModel(), np.datetime64("2012-06-07", "ns"), {}, {}, None, ("too_few_frequencies",))


def density(frequency_mhz: np.ndarray, range_rsun: np.ndarray, sd_rsun: float | None = 2.0) -> dict[str, Any]:
    """What the density companion says of positions."""
    rows = zip(frequency_mhz.tolist(), range_rsun.tolist(), strict=True)
    return {"rows": [{"frequency_mhz": f, "range_rsun": r, "range_sd_rsun": sd_rsun} for f, r in rows], "flags": []}


@pytest.fixture(scope="module")
def fit() -> JointFit:
    grid = simulated(standard(JointModel(), 30.0, 400.0), JointModel(), np.random.default_rng(1), 0.1)
    return joint_track(grid, 25.38, 1000, 1)[1]


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
    found = scattering_companion(density(np.array([frequency_mhz]), np.array([apparent])), NO_FIT)
    (row,) = found["rows"]
    assert (row["apparent_rsun"], row["apparent_sd_rsun"]) == (apparent, 2.0)
    assert row[word]["range_rsun"] == pytest.approx(emission)
    assert row[word]["range_sd_rsun"] == pytest.approx(2.0 * emission / apparent)
    assert row[word]["delay_s"] == pytest.approx(delay_s)
    assert found["apparent"] == APPARENT_SOURCE
    assert "10.3847/1538-4357/acf6c1" in found["source"]
    assert found["joint"] == {}


@pytest.mark.parametrize(("word", "harmonic"), [("fundamental", 1), ("harmonic", 2)])
def test_a_burst_in_the_wind_of_a_model_has_no_excess_once_corrected(word: str, harmonic: int) -> None:
    emitted = emission_range_rsun(MHZ, LEBLANC, harmonic)
    apparent = emitted * scattering_model(NAMES[word]).radius_factor(MHZ)
    for row in scattering_companion(density(MHZ, apparent), NO_FIT)["rows"]:
        excess = row[word]["excess"]
        assert excess["mean"] == pytest.approx(1.0, rel=1e-6)
        assert excess["q16"] < 1 < excess["q84"]


def test_a_source_at_150_solar_radii_is_explained_by_half_of_its_excess_density() -> None:
    """0.15 MHz as harmonic: 4.8 times the density of Leblanc et al. where it appears (Canizares et al. 2024)."""
    (row,) = scattering_companion(density(np.array([0.15]), np.array([150.0])), NO_FIT)["rows"]
    factor = np.exp(np.interp(np.log(0.15), np.log([0.128, 0.16]), np.log([127 / 85, 106 / 70])))
    assert row["harmonic"]["range_rsun"] == pytest.approx(150.0 / factor)
    assert 1.9 < row["harmonic"]["excess"]["mean"] < 2.2


def test_nothing_is_said_beyond_the_simulated_frequencies_nor_inside_the_sun() -> None:
    beyond, inside = scattering_companion(density(np.array([40.0, 1.0]), np.array([2.0, 1.2]), None), NO_FIT)["rows"]
    assert beyond["harmonic"] == {
        "range_rsun": None,
        "range_sd_rsun": None,
        "delay_s": None,
        "excess": {"mean": None, "q16": None, "q84": None},
    }
    assert 0 < inside["fundamental"]["range_rsun"] < 1
    assert inside["fundamental"]["excess"]["mean"] is None
    with pytest.raises(NoDataError, match="no positions"):
        scattering_companion({"flags": ["not_computed"], "reason": "no positions"}, NO_FIT)


def test_without_scattering_the_spiral_is_that_of_the_joint_fit(fit: JointFit) -> None:
    spiral = corrected_spiral(fit, scattering_model(NONE), MHZ)
    for name in ("phi0_deg", "v_sw_km_s"):
        assert spiral[name]["mean"] == pytest.approx(float(fit.draws[name].mean()), rel=1e-6)
        assert spiral[name]["q2_5"] == pytest.approx(fit.summary[name].q2_5, rel=0.03)


def test_a_corrected_spiral_goes_through_the_corrected_sources(fit: JointFit) -> None:
    model = scattering_model(NAMES["fundamental"])
    spiral = corrected_spiral(fit, model, MHZ)
    apparent = fit.model.range_rsun(fit.parameters, MHZ).mean(axis=0)
    line = spiral_longitude_deg(apparent, fit.summary["phi0_deg"].mean, fit.summary["v_sw_km_s"].mean, 25.38)
    inward = apparent / model.radius_factor(MHZ)
    there = spiral_longitude_deg(inward, spiral["phi0_deg"]["mean"], spiral["v_sw_km_s"]["mean"], 25.38)
    np.testing.assert_allclose(there, line, atol=1.5)
    assert spiral["v_sw_km_s"]["mean"] < fit.summary["v_sw_km_s"].mean / 2
    assert math.isclose(spiral["phi0_deg"]["sd"], fit.summary["phi0_deg"].sd, rel_tol=0.3)


def test_two_frequencies_make_no_spiral(fit: JointFit) -> None:
    assert corrected_spiral(fit, scattering_model(NAMES["harmonic"]), np.array([0.2, 0.5, 50.0])) == {}
    assert set(scattering_companion(density(MHZ, 20 / MHZ), fit)["joint"]) == set(NAMES)
