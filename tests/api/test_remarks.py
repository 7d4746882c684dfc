"""Remarks on the page follow from the numbers they are about."""

from typing import Any

import pytest

from api.remarks import edge_remark


def joint(phi0_deg: float, sd: float = 3.0) -> dict[str, Any]:
    return {"joint": {"phi0_deg": {"mean": phi0_deg, "sd": sd}, "v_sw_km_s": {"mean": 400.0, "sd": 50.0}}}


@pytest.mark.parametrize(
    ("longitudes", "verdict"),
    [
        ((30.0, 28.0), "up to 2° apart, within what their errors allow"),
        ((30.0, 10.0), "up to 20° apart, more than their errors allow"),
        ((179.0, -179.0), "up to 2° apart, within what their errors allow"),
        ((30.0, 29.0, 0.0), "up to 30° apart, more than their errors allow"),
    ],
)
def test_the_difference_of_edges_is_held_against_their_errors(longitudes: tuple[float, ...], verdict: str) -> None:
    assert verdict in edge_remark({f"edge {n}": joint(one) for n, one in enumerate(longitudes)})


def test_one_edge_is_nothing_to_remark_on() -> None:
    assert edge_remark({"edge": joint(30.0)}) == ""
