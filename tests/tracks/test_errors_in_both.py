"""Lines through points with errors in both coordinates: published numbers, and simulated points."""

import numpy as np
import pytest
from scipy.optimize import minimize

from bella.exceptions import InputError
from bella.tracks.errors_in_both import Points, fit_broken_line

PEARSON_X = np.array([0.0, 0.9, 1.8, 2.6, 3.3, 4.4, 5.2, 6.1, 6.5, 7.4])
PEARSON_Y = np.array([5.9, 5.4, 4.4, 4.6, 3.5, 3.7, 2.8, 2.8, 2.4, 1.5])
YORK_X_WEIGHT = np.array([1000.0, 1000.0, 500.0, 800.0, 200.0, 80.0, 60.0, 20.0, 1.8, 1.0])
YORK_Y_WEIGHT = np.array([1.0, 1.8, 4.0, 8.0, 20.0, 20.0, 70.0, 70.0, 100.0, 500.0])


def diagonal(x_variance: np.ndarray, y_variance: np.ndarray) -> np.ndarray:
    return np.stack([np.diag(pair) for pair in zip(x_variance, y_variance, strict=True)])


def scattered(true_x: np.ndarray, true_y: np.ndarray, covariance: np.ndarray, rng: np.random.Generator) -> Points:
    """Points about a curve, as measured."""
    noise = np.einsum("nij,nj->ni", np.linalg.cholesky(covariance), rng.standard_normal((true_x.size, 2)))
    x, y = true_x + noise[:, 0], true_y + noise[:, 1]
    order = np.argsort(x)
    return Points(x[order], y[order], covariance[order])


def test_pearsons_points_with_yorks_weights() -> None:
    """York 1966, Can. J. Phys. 44, 1079, doi:10.1139/p66-090; errors and chi2: York et al. 2004, table II."""
    line = fit_broken_line(Points(PEARSON_X, PEARSON_Y, diagonal(1 / YORK_X_WEIGHT, 1 / YORK_Y_WEIGHT)), 0)

    assert line is not None
    assert line.slope[0] == pytest.approx(-0.480533, abs=5e-7)
    assert line.value == pytest.approx(5.47991, abs=5e-6)
    assert line.slope_sd[0] == pytest.approx(0.0580, abs=5e-5)
    assert line.value_sd == pytest.approx(0.2950, abs=5e-5)
    assert line.chi2 / 8 == pytest.approx(1.4833, abs=5e-5)


def test_value_is_given_at_the_origin() -> None:
    points = Points(PEARSON_X, PEARSON_Y, diagonal(1 / YORK_X_WEIGHT, 1 / YORK_Y_WEIGHT))
    there, here = fit_broken_line(points, 0, 4.0), fit_broken_line(points, 0)

    assert there is not None
    assert here is not None
    assert there.value == pytest.approx(here.value + 4.0 * here.slope[0], rel=1e-7)
    assert there.value_sd < here.value_sd


def test_correlated_errors_against_a_brute_minimum() -> None:
    rng = np.random.default_rng(5)
    root = rng.normal(0, 1, (12, 2, 2)) + 1.5 * np.eye(2)
    covariance = np.einsum("nij,nkj->nik", root, root)
    x = np.linspace(0.0, 40.0, 12)
    points = scattered(x, 3.0 - 0.5 * x, covariance, rng)

    def badness(theta: np.ndarray) -> float:
        """Over value, slope and every true x."""
        miss = np.stack([points.x - theta[2:], points.y - theta[0] - theta[1] * theta[2:]], axis=-1)
        return float(np.einsum("ni,nij,nj->", miss, np.linalg.inv(points.covariance), miss))

    brute = minimize(badness, np.concatenate([[3.0, -0.5], points.x]), method="BFGS", options={"gtol": 1e-7})
    line = fit_broken_line(points, 0)

    assert line is not None
    assert [line.value, line.slope[0]] == pytest.approx(brute.x[:2], rel=1e-4)
    assert line.chi2 == pytest.approx(brute.fun, rel=1e-6)


def test_errors_in_x_do_not_flatten_the_slope() -> None:
    """Where least squares of y on x loses a quarter of it."""
    rng, x = np.random.default_rng(6), np.linspace(0.0, 20.0, 40)
    covariance = diagonal(np.full(40, 12.0), np.full(40, 1.0))
    samples = [scattered(x, -0.5 * x, covariance, rng) for _ in range(200)]
    lines = [fit_broken_line(points, 0) for points in samples]
    slopes = np.array([line.slope[0] for line in lines if line is not None])

    assert np.mean([np.polyfit(points.x, points.y, 1)[0] for points in samples]) > -0.4
    assert np.mean(slopes) == pytest.approx(-0.5, abs=0.01)
    assert np.mean([line.slope_sd[0] for line in lines if line is not None]) == pytest.approx(slopes.std(), rel=0.15)
    assert np.mean([line.chi2 for line in lines if line is not None]) == pytest.approx(38.0, abs=1.5)


def test_knot_and_slopes_of_a_broken_line_are_found() -> None:
    rng, x = np.random.default_rng(7), np.geomspace(12.0, 150.0, 80)
    covariance = np.broadcast_to(np.array([[1.0, 0.3], [0.3, 1.0]]), (80, 2, 2)).copy()
    points = scattered(x, 30 - 0.6 * np.minimum(x, 60) - 0.2 * np.maximum(x - 60, 0), covariance, rng)

    fits = [fit_broken_line(points, knots) for knots in range(4)]

    assert [fit is not None for fit in fits] == [True] * 4
    assert np.argmin([fit.bic for fit in fits if fit]) == 1
    assert fits[1] is not None
    assert fits[1].knot[0] == pytest.approx(60.0, abs=3.0)
    pull = (fits[1].slope - np.array([-0.6, -0.2])) / fits[1].slope_sd
    assert np.abs(pull).max() < 3
    assert fits[1].chi2 == pytest.approx(76.0, abs=3 * np.sqrt(2 * 76.0))


def test_too_few_points_for_so_many_segments() -> None:
    points = Points(PEARSON_X[:5], PEARSON_Y[:5], diagonal(np.full(5, 0.1), np.full(5, 0.1)))
    assert fit_broken_line(points, 1) is None
    assert fit_broken_line(points, 3) is None


@pytest.mark.parametrize(
    ("covariance", "y"),
    [
        (np.zeros((10, 2, 2)), PEARSON_Y),
        (np.full((10, 2, 2), 1.0), PEARSON_Y),
        (np.full((10, 2, 2), np.nan), PEARSON_Y),
        (np.broadcast_to(np.eye(2), (10, 2, 2)), np.full(10, np.nan)),
        (np.broadcast_to(np.eye(2), (10, 2, 2)), PEARSON_Y[:9]),
    ],
)
def test_unusable_points_are_refused(covariance: np.ndarray, y: np.ndarray) -> None:
    with pytest.raises(InputError, match="leave"):
        Points(PEARSON_X, y, covariance)
