"""Models with laws beside the one without, and what wave directions and a measured wind add."""

from dataclasses import replace

import numpy as np
import pytest

from bella.exceptions import InputError, NoDataError
from bella.records import JointTrack, Parameter
from bella.tracks import fit_track, measured_wind
from bella.tracks.compare import COMPARED, _weight, compare_models, fused_companion, models_companion
from bella.tracks.directions import DirectionTerms
from bella.tracks.likelihood import Likelihood, evidence_of
from bella.tracks.model import Track, TrackModel
from tests.tracks.foreign import FREQUENCY_MHZ, THREE, Burst


def towards(burst: Burst, turned_deg: float, sigma_deg: float = 1.0) -> DirectionTerms:
    """Directions of the second spacecraft at some frequencies, all turned alike."""
    some = np.arange(0, FREQUENCY_MHZ.size, 6)
    sight = burst.source_rsun[some] - THREE[1]
    angle = np.arctan2(sight[:, 1], sight[:, 0]) + np.radians(turned_deg)
    unit = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    place = np.tile(THREE[1], (some.size, 1))
    return DirectionTerms(FREQUENCY_MHZ[some], place, unit, np.full(some.size, sigma_deg), 0.0, ("B",) * some.size)


def test_a_beam_that_slows_is_preferred_where_it_slows() -> None:
    """Of laws with a power law for the distance; noise is small, so that the times can tell."""
    for slowing, speed in ((0.0, 0.15), (0.45, 0.4)):
        grid = Burst(slowing=slowing, beam_speed_c=speed).arrivals(
            np.random.default_rng(3), sigma_s=1.0, shape=0.01, offset_s=0.5
        )
        ranked = compare_models(fit_track(grid, draws=500), grid)
        share = {one.fit.record.model: one.probability for one in ranked}
        constant = sum(p for name, p in share.items() if "constant speed" in name)
        slow = sum(p for name, p in share.items() if "slows down" in name)

        assert len({one.fit.record.model for one in ranked}) == len(COMPARED) + 1
        assert sum(share.values()) == pytest.approx(1.0)
        assert (slow > 20 * constant) == (slowing > 0), (slowing, share)


def test_models_are_averaged_by_their_probability() -> None:
    grid = Burst(phi0_deg=-170.0).arrivals(np.random.default_rng(4))
    fit = fit_track(grid, draws=500)
    found = models_companion(fit, grid)
    mean = found["phi0_deg"]["q50"]

    assert abs((mean + 170.0 + 180) % 360 - 180) < 12.0
    assert found["rows"][0]["log_bayes_factor"] == 0.0
    assert {"name", "probability", "phi0_deg", "v_sw_km_s", "beam_speed_c", "winds", "flags"} <= set(found["rows"][0])
    broken = next(row for row in found["rows"] if row["winds"])
    assert broken["winds"][0]["to_rsun"] == broken["winds"][1]["from_rsun"]
    assert broken["winds"][1]["to_rsun"] is None


def test_directions_narrow_the_longitude_and_wrong_ones_are_found_out() -> None:
    burst = Burst()
    grid = burst.arrivals(np.random.default_rng(5), sigma_s=60.0)
    fit = fit_track(grid, draws=1000)
    right, wrong = (fused_companion(fit, grid, towards(burst, turn), None) for turn in (0.0, 25.0))

    assert right["ingredients"][0]["name"] == "wave_directions"
    assert right["ingredients"][0]["sd_ratio"]["phi0_deg"] < 0.9
    assert right["ingredients"][0]["tension"] < 3.0
    assert abs(right["phi0_deg"]["q50"] - 30.0) < 3 * right["phi0_deg"]["sd"]
    assert wrong["ingredients"][0]["tension"] > 3.0
    assert "ingredients_disagree" in wrong["flags"]
    assert "ingredients_disagree" not in right["flags"]


@pytest.mark.parametrize("turned_deg", [0.0, 5.0, 170.0])
@pytest.mark.parametrize("shared_deg", [0.0, 3.0])
def test_the_gradient_with_directions_is_that_of_the_density(turned_deg: float, shared_deg: float) -> None:
    burst, rng = Burst(), np.random.default_rng(8)
    evidence, terms = evidence_of(burst.arrivals(rng)), towards(burst, turned_deg)
    track = Track(TrackModel("free", "slowing", knots_rsun=(25.0,)), (0.16, 1.9))
    likelihood = Likelihood(track, evidence, replace(terms, shared_deg=shared_deg))
    phi0, z = rng.uniform(-3, 3, 4), 0.5 * rng.standard_normal((4, track.size))
    _, gradient = likelihood.normal_equations(likelihood.residual_s(phi0, z), phi0, z)
    steps = 1e-5 * np.eye(track.size)
    ends = [[likelihood.log_density(phi0, z + side * step) for step in steps] for side in (1, -1)]
    expected = (np.array(ends[0]) - np.array(ends[1])).T / 2e-5

    assert np.abs(gradient - expected).max(axis=0) == pytest.approx(0.0, abs=2e-4 * np.abs(expected).max())


def test_a_measured_wind_narrows_the_wind_and_a_wrong_one_is_found_out() -> None:
    grid = Burst(v_sw_km_s=430.0).arrivals(np.random.default_rng(6), sigma_s=2.0, shape=0.02, offset_s=0.5)
    fit = fit_track(grid, draws=1000)
    right, wrong = (fused_companion(fit, grid, None, measured_wind(speed, 15.0)) for speed in (430.0, 900.0))

    assert right["ingredients"][0]["sd_ratio"]["v_sw_km_s"] < 0.6
    assert right["v_sw_km_s"]["q50"] == pytest.approx(430.0, abs=30.0)
    assert wrong["ingredients"][0]["tension"] > 3.0


def test_what_moves_a_number_without_narrowing_it_counts_as_a_gain_of_three_tenths() -> None:
    fit = fit_track(Burst().arrivals(np.random.default_rng(7)), draws=200)

    def record(middle: float, sd: float) -> JointTrack:
        number = Parameter(q16=middle - sd, q50=middle, q84=middle + sd, sd=sd)
        return fit.record.model_copy(
            update={"phi0_deg": number, "v_sw_km_s": Parameter(q16=300, q50=400, q84=500, sd=99)}
        )

    def tension(moved: float, sd: float) -> float:
        after, before = (replace(fit, record=record(*one)) for one in ((moved, sd), (0.0, 1.0)))
        return float(_weight("wind_prior", after, before)["tension"])

    assert tension(0.6, 1.0) == pytest.approx(0.6 / 0.3)
    assert tension(0.6, 0.8) == pytest.approx(0.6 / 0.6)


def test_there_must_be_something_to_add_and_to_add_to() -> None:
    grid = Burst().arrivals(np.random.default_rng(7))
    fit = fit_track(grid, draws=200)
    with pytest.raises(InputError, match="neither wave directions nor a measured wind"):
        fused_companion(fit, grid, None, None)
    few = grid.take(np.array([0, 1, 2]))
    nothing = fit_track(few, draws=200)
    with pytest.raises(NoDataError, match="add frequencies"):
        models_companion(nothing, few)
    with pytest.raises(NoDataError, match="add frequencies"):
        fused_companion(nothing, few, None, measured_wind(400.0, 20.0))
