"""The door: from a table to a labelled solution, and what is refused there."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import bella
from bella.arrivals import REQUIRED, check_arrivals
from bella.bursts import published_arrivals
from bella.exceptions import InputError
from bella.flags import LOCALISATION_FLAGS
from bella.multilateration import METHODS, PRESETS, localise
from bella.multilateration.checks import flags_of
from bella.multilateration.priors import CADENCE_S
from tests.multilateration.geometry import CADENCE_S as CADENCE_ROUNDED_S
from tests.multilateration.geometry import EVENT, FIVE, PLAIN, first, grid_of, moments, on_spiral, table_of

PER_FREQUENCY = [
    "x_rsun",
    "y_rsun",
    "z_rsun",
    "cov_xx_rsun2",
    "cov_xy_rsun2",
    "cov_yy_rsun2",
    "mode_x_rsun",
    "mode_y_rsun",
    "area68_rsun2",
    "area95_rsun2",
    "modes",
    "emission_s",
    "emission_sd_s",
    "v_over_c",
    "v_over_c_sd",
    "contraction_x",
    "contraction_y",
    "contraction_v",
    "log_evidence",
    "draw_ess",
    "misfit",
    "flags",
]


@pytest.fixture(scope="module")
def burst() -> pd.DataFrame:
    return check_arrivals(published_arrivals(np.array([1.0, 0.2, 0.5])))


@pytest.fixture(scope="module")
def solution(burst) -> xr.Dataset:
    return localise(burst, draws=400, seed=5)


def test_the_solution_is_complete(solution) -> None:
    assert solution["draws"].dims == ("frequency", "draw", "parameter")
    assert solution["draws"].dtype == np.float32
    assert solution["draws"].shape == (3, 400, 4)
    assert solution["parameter"].to_numpy().tolist() == ["x_rsun", "y_rsun", "emission_s", "v_over_c"]
    assert solution["frequency"].to_numpy().tolist() == [0.2, 0.5, 1.0]
    assert solution["observatory"].to_numpy().tolist() == burst_names()
    for name in PER_FREQUENCY:
        assert solution[name].dims == ("frequency",), name
    for name in ("region68", "region95"):
        assert solution[name].dims == ("frequency", "vertex", "axis")
    assert solution["receiver_rsun"].dims == ("frequency", "observatory", "xyz")


def burst_names() -> list[str]:
    return list(dict.fromkeys(published_arrivals()["observatory"]))


def test_every_variable_says_what_it_is_and_every_number_is_finite(solution) -> None:
    for name, variable in solution.data_vars.items():
        assert variable.attrs["long_name"], name
        assert variable.attrs["units"], name
        if variable.dtype.kind == "f" and not str(name).startswith(("region", "mode_mean", "clock_offset")):
            assert np.isfinite(variable).all(), name


def test_the_recipe_is_stored(solution) -> None:
    expected = {
        "frame": "HEE",
        "method": "posterior",
        "preset": "default",
        "edge": "gauss_hermite",
        "dimensions": 2,
        "seed": 5,
        "v_prior_sd_over_c": 0.001,
        "format_version": 1,
        "bella_version": bella.__version__,
        "Conventions": "CF-1.11",
    }
    assert {name: solution.attrs[name] for name in expected} == expected
    # <r^2> / 2 of exp(-(r / 300)^4 / 2) in the plane is 300^2 / sqrt(2 pi)
    assert solution.attrs["position_prior_sd_rsun"] == pytest.approx(300 / (2 * np.pi) ** 0.25, abs=0.01)
    assert (solution.attrs["tau_rsun"], solution.attrs["position_prior_power"]) == (300.0, 4.0)
    assert (solution.attrs["kappa_prior"], solution.attrs["kappa_prior_sd"]) == (0.11, 0.10)
    assert solution.attrs["reference_time"].endswith("Z")


def test_arrivals_and_reference_time_give_the_table_back(burst, solution) -> None:
    reference = np.datetime64(solution.attrs["reference_time"].removesuffix("Z"), "ns")
    for _, row in burst.iterrows():
        at = solution.sel(frequency=row["frequency_mhz"], observatory=row["observatory"])
        seconds = (np.datetime64(row["arrival_utc"], "ns") - reference) / np.timedelta64(1, "s")
        assert float(at["arrival_s"]) == pytest.approx(seconds, abs=1e-6)
        assert float(at["sigma_s"]) == row["sigma_s"]


def test_draws_agree_with_the_summary(solution) -> None:
    mean = solution["draws"].mean("draw").astype(float)
    sd = np.sqrt(solution["cov_xx_rsun2"])

    assert float(abs((mean.sel(parameter="x_rsun") - solution["x_rsun"]) / sd).max()) < 4.5 / np.sqrt(360)
    emission = (mean.sel(parameter="emission_s") - solution["emission_s"]) / solution["emission_sd_s"]
    assert float(abs(emission).max()) < 4.5 / np.sqrt(360)
    np.testing.assert_allclose(solution["contraction_x"], sd / solution.attrs["position_prior_sd_rsun"])


def test_three_spacecraft_do_not_measure_the_speed_and_five_do() -> None:
    assert first(grid_of(on_spiral(75), EVENT, 7.0))["flags"].item() == "speed_not_constrained"
    # five at 7 s: the narrow prior still rules; it takes sharper times to beat 0.001 c
    assert "speed_not_constrained" not in first(grid_of(on_spiral(75), FIVE, 0.1))["flags"].item()


def test_through_the_table_the_answer_is_that_of_the_engine() -> None:
    grid = grid_of([on_spiral(75), on_spiral(20)], EVENT, CADENCE_ROUNDED_S)
    solved = localise(table_of(grid), preset=PLAIN, draws=10)

    np.testing.assert_allclose(solved["x_rsun"], moments(grid).mean[:, 0], atol=1e-5)
    np.testing.assert_allclose(solved["emission_sd_s"], moments(grid).emission_sd_s, rtol=1e-6)


def test_presets_set_the_timing_errors(burst) -> None:
    paper, code = (localise(burst, preset=name, draws=10) for name in ("paper", "bella-2024"))

    assert paper["sigma_s"].sel(observatory="WIND").to_numpy().tolist() == [CADENCE_S["WIND"]] * 3
    assert paper["sigma_s"].sel(observatory="STEREO-A").to_numpy().tolist() == [38.05] * 3
    assert paper.attrs["v_prior_sd_over_c"] == 0.1
    assert (code["sigma_s"] == 30.0).all()
    assert code.attrs["sigma_rule"] == "30 s for every receiver"
    assert len({preset.rule for preset in PRESETS.values()}) == 3


def test_a_receiver_that_is_missing_at_a_frequency_stays_missing() -> None:
    grid = grid_of([on_spiral(75), on_spiral(40)], FIVE, 10.0)
    table = table_of(grid)
    received = table[~((table["observatory"] == "R3") & (table["frequency_mhz"] < 0.5))]
    solved = localise(received, preset="bella-2024", draws=10)

    assert np.isnan(solved["arrival_s"].sel(observatory="R3").values).tolist() == [True, False]
    assert np.isnan(solved["sigma_s"].sel(observatory="R3").values).tolist() == [True, False]
    whole = localise(table, preset="bella-2024", draws=10)
    assert float(solved["x_rsun"][1]) == pytest.approx(float(whole["x_rsun"][1]), abs=1e-6)
    assert float(solved["area68_rsun2"][0]) > float(whole["area68_rsun2"][0])


def test_the_same_seed_gives_the_same_draws(burst, solution) -> None:
    np.testing.assert_array_equal(localise(burst, draws=400, seed=5)["draws"], solution["draws"])
    assert not np.array_equal(localise(burst, draws=400, seed=6)["draws"], solution["draws"])


@pytest.mark.parametrize(
    ("choice", "reason"),
    [
        ({"preset": "best"}, "preset 'best' is not known; choose one of default, paper, bella-2024"),
        ({"method": "guess"}, "method 'guess' is not known; choose one of posterior, nuts, tdoa"),
        ({"dimensions": 4}, "4 dimensions are not supported"),
        ({"dimensions": 0}, "0 dimensions are not supported"),
        ({"draws": 0}, "0 draws are too few"),
    ],
)
def test_unknown_choices_are_refused(burst, choice, reason) -> None:
    with pytest.raises(InputError, match=f"^{reason}"):
        localise(burst, **choice)


def test_a_cadence_that_is_not_known_is_refused() -> None:
    with pytest.raises(InputError, match="'paper' has no cadence for R0; use --preset default"):
        localise(table_of(grid_of(on_spiral(75), EVENT, 7.0)), preset="paper")


def test_an_unchecked_table_is_checked(burst) -> None:
    raw = published_arrivals(np.array([0.2, 0.5, 1.0]))[list(REQUIRED)]
    np.testing.assert_array_equal(localise(raw, draws=10)["x_rsun"], localise(burst, draws=10)["x_rsun"])
    with pytest.raises(InputError, match="column sigma_s is missing"):
        localise(raw.drop(columns="sigma_s"))


def test_every_flag_that_can_be_raised_is_documented(solution) -> None:
    bad = solution.assign(
        contraction_v=solution["contraction_v"] * 0 + 1,
        above_c_probability=solution["contraction_v"] * 0 + 0.99,
        contraction_x=solution["contraction_x"] * 0 + 1,
        contraction_y=solution["contraction_x"] * 0 + 1,
        contraction_z=solution["contraction_x"] * 0 + 1,
        cov_xz_rsun2=solution["cov_xy_rsun2"],
        cov_yz_rsun2=solution["cov_xy_rsun2"],
        cov_zz_rsun2=solution["cov_yy_rsun2"],
        bad_probability=solution["bad_probability"] * 0 + 0.6,
        cov_xx_rsun2=solution["cov_xx_rsun2"] * 0 + 1e6,
        modes=solution["modes"] * 0 + 2,
        misfit=solution["misfit"] * 0 + 1e6,
        draw_ess=solution["draw_ess"] * 0,
        prior_pull_x_rsun=solution["contraction_x"] * 0 + 1e4,
        prior_pull_z_rsun=solution["contraction_x"] * 0,
    ).assign_attrs(clock_offset="A is late")
    raised = flags_of(bad, ["two_roots;no_exact_root"] * 3)[0].split(";")

    assert len(raised) == len(LOCALISATION_FLAGS)
    assert set(raised) == set(LOCALISATION_FLAGS)


def test_the_methods_are_three() -> None:
    assert list(METHODS) == ["posterior", "nuts", "tdoa"]
