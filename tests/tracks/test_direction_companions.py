"""The fit that takes in wave directions."""

import numpy as np
import pandas as pd
import pytest

from bella.exceptions import InputError
from bella.heliosphere import spiral_position_rsun
from bella.tracks import Ingredients, JointModel, JointOptions, check_directions, direction_terms
from bella.tracks.direction_companions import fused_companion
from bella.tracks.joint_directions import DirectionTerms
from tests.tracks.bursts import FREQUENCY_MHZ, simulated, standard

EPOCH = np.datetime64("2012-06-07T19:00", "ns")
PHI0_DEG, WIND_KM_S, ROTATION_D = 30.0, 400.0, 25.38
PLACES = {"A": (215.0, 0.0, 0.0), "B": (-97.0, 192.0, 0.0), "C": (-97.0, -192.0, 0.0)}


def source_rsun(frequency_mhz: np.ndarray) -> np.ndarray:
    return spiral_position_rsun(40.0 * 0.55 / frequency_mhz, PHI0_DEG, WIND_KM_S, ROTATION_D)


def directions(
    names: tuple[str, ...] = ("A", "B"), frequency_mhz: np.ndarray = FREQUENCY_MHZ, off_deg: float = 0.0
) -> tuple[pd.DataFrame, DirectionTerms]:
    """Directions that point at the spiral, turned by an angle."""
    parts = []
    for name in names:
        x, y, _ = (source_rsun(frequency_mhz) - np.array(PLACES[name])).T
        place = dict(zip(("x_rsun", "y_rsun", "z_rsun"), PLACES[name], strict=True))
        parts.append(
            pd.DataFrame(
                {"frequency_mhz": frequency_mhz, "longitude_deg": np.degrees(np.arctan2(y, x)) + off_deg}
            ).assign(observatory=name, latitude_deg=0.0, sigma_deg=2.0, **place)
        )
    table = check_directions(pd.concat(parts, ignore_index=True))
    return table, direction_terms(table, table.iloc[:0], EPOCH, 3.0)


def test_directions_that_agree_narrow_the_joint_fit_and_those_that_do_not_are_told() -> None:
    grid = simulated(standard(JointModel(), PHI0_DEG, WIND_KM_S), JointModel(), np.random.default_rng(4))
    said = {}
    for off_deg in (0.0, 40.0):
        known = Ingredients(grid, 0.0, directions(frequency_mhz=FREQUENCY_MHZ[::4], off_deg=off_deg)[1])
        said[off_deg] = fused_companion(known, ROTATION_D, JointOptions(draws=1000))
    by_name = {one["name"]: one for one in said[0.0]["ingredients"]}
    assert by_name["wave_directions"]["sd_ratio"]["phi0_deg"] < 0.97
    assert "ingredients_disagree" not in said[0.0]["flags"]
    assert "ingredients_disagree" in said[40.0]["flags"]
    with pytest.raises(InputError, match="neither wave directions nor a measured wind"):
        fused_companion(Ingredients(grid, 0.0), ROTATION_D, JointOptions())
