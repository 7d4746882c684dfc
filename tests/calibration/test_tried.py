"""Which simulated bursts a real answer is like, and the sentence about them."""

import subprocess
import sys

import pytest

from bella.calibration.found_table import ALL, published_rows
from bella.calibration.tried import Answered, tried
from bella.records import Origin


def test_an_answer_has_rows_of_its_edge_and_of_its_grade_and_says_their_shares() -> None:
    found = tried(Answered(3, "shared_profile", "final", "A"))
    assert found is not None
    expected = [
        one
        for one in published_rows()
        if (one.stratum, one.fleet, one.tier) == (ALL, "2012", "final")
        and (one.edge, one.grade) in {("shared_profile", ALL), (ALL, "A")}
        and one.bursts >= 10  # fewer say nothing
    ]
    assert set(found.rows) == set(expected)
    assert {one.grade for one in found.rows} == {ALL, "A"}
    longitudes = [one for one in found.rows if one.quantity == "phi0"]
    for one in longitudes:
        assert f"{one.bursts} " in found.sentence
        assert f"{100 * (one.cover68 or 0):.0f} % ({100 * (one.cover68_low or 0):.0f} to" in found.sentence
    assert "three spacecraft" in found.stratum


def test_a_preliminary_answer_is_of_two_spacecraft_also_when_more_have_come() -> None:
    assert (
        tried(Answered(2, "half_rise", "preliminary", "D"))
        == tried(Answered(3, "half_rise", "preliminary", "D"))
        is not None
    )


@pytest.mark.parametrize(
    ("spacecraft", "edge", "more"),
    [
        (3, "gauss_hermite", {}),
        (4, "half_rise", {}),
        (1, "shared_profile", {}),
        (3, "shared_profile", {"preset": "paper"}),
        (3, "shared_profile", {"method": "nuts"}),
        (3, "shared_profile", {"origin": Origin.SUBMISSION}),
    ],
)
def test_what_was_not_tried_or_hardly_has_no_sentence(spacecraft: int, edge: str, more: dict[str, object]) -> None:
    assert tried(Answered(spacecraft, edge, "final", "B", **more)) is None  # type: ignore[arg-type]


def test_reading_the_table_imports_nothing_that_fits() -> None:
    code = (
        "import sys, bella.calibration.tried; "
        "rooms = ('bella.multilateration', 'bella.tracks', 'bella.bursts'); "
        "print([one for one in sys.modules if one.startswith(rooms)])"
    )
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert said.strip() == "[]"
