"""Distance, speed and residuals against frequency."""

import numpy as np
import pytest

from bella.plotting import evolution_figure, residual_figure
from bella.plotting.evolution import HEIGHT
from tests.plotting.reading import of_class, parsed, points, texts
from tests.plotting.synthetic import synthetic_posterior, synthetic_track_fit


def quantity(middle: float, sd: float) -> dict[str, float]:
    return {"q16": middle - sd, "q50": middle, "q84": middle + sd}


def test_positions_have_their_errors_and_the_joint_fit_its_bands() -> None:
    profile = [
        {"frequency_mhz": f, "range_rsun": quantity(30 / f, 3.0), "beam_speed_c": quantity(0.3, 0.1)}
        for f in (0.2, 0.5, 1.0)
    ]
    fit = synthetic_track_fit() | {"joint": {"profile": profile}}
    root = parsed(evolution_figure(synthetic_posterior(), fit))
    errors, dots = of_class(root, "error"), of_class(root, "dot")
    assert len(errors) == len(dots) == 40
    for bar, dot in zip(errors, dots, strict=True):
        assert float(bar.get("y2")) <= float(dot.get("cy")) <= float(bar.get("y1")) or bar.get("y1") == bar.get("y2")
    heights = [float(one.get("cy")) for one in dots]
    assert heights == sorted(heights)  # farther out at lower frequencies: up is far
    distance, speed = (points(one) for one in of_class(root, "band"))
    assert distance[0, 0] < speed[0, 0]
    lower, upper = speed[:3, 1], speed[3:, 1]
    assert (upper < lower).all()
    assert "not fitted" not in "".join(root.itertext())


def test_without_a_joint_fit_the_speed_is_said_not_to_be_fitted() -> None:
    root = parsed(evolution_figure(synthetic_posterior(), {}))
    assert of_class(root, "band") == []
    assert "not fitted" in texts(root, "tick")


def test_residuals_stand_above_and_below_zero_by_spacecraft() -> None:
    posterior = synthetic_posterior(frequencies=np.array([0.2, 0.5, 1.0]))
    values = np.array([[5.0, -5.0, np.nan], [1.0, -1.0, 0.0], [2.0, -2.0, 0.0]])
    root = parsed(residual_figure(posterior.assign(residual_s=(("frequency", "observatory"), values))))
    marks = of_class(root, "series s0")[0]
    heights = [float(one.get("cy")) for one in marks]
    middle = (24.0 + HEIGHT - 44.0) / 2
    assert heights[0] < heights[2] < heights[1] < middle
    below = of_class(root, "series s1")[0]
    assert all(points(one)[:, 1].mean() > middle for one in below)
    assert len(of_class(root, "series s2")[0]) == 2
    assert heights[0] - middle == pytest.approx(-(points(below[0])[:, 1].mean() - middle), abs=0.5)
