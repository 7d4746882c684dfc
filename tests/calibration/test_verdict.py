"""Verdicts, the table that keeps them, and the page."""

from dataclasses import replace
from functools import lru_cache

import pytest

from bella.calibration import calibration_page, failing, find_strata, judge, parse_verdicts, run_stratum, verdict_table
from bella.calibration.verdict import Verdict
from bella.exceptions import InputError


@lru_cache
def verdicts() -> list[Verdict]:
    strata = find_strata(["wide", "four-subluminal", "sigma-halved"])
    return judge([run_stratum(stratum, 100, 2, lambda _: None) for stratum in strata], 2)


def test_p_values_of_the_whole_run_are_counted() -> None:
    # x, y, emission, speed and density in each of three strata, two tests each
    assert {one.tests for one in verdicts()} == {3 * 5 * 2}


def test_table_is_read_back_as_it_was() -> None:
    assert parse_verdicts(verdict_table(verdicts())) == verdicts()


@pytest.mark.parametrize("text", ["", "a,b\n1,2\n", "stratum\nwide\n", "WHOLE"])
def test_other_tables_are_refused(text: str) -> None:
    text = text.replace("WHOLE", verdict_table(verdicts()).replace("True", "maybe"))
    with pytest.raises(InputError, match="not a calibration table"):
        parse_verdicts(text)


def test_only_declared_strata_can_fail_a_run() -> None:
    assert not verdicts()[-1].passed
    assert failing(verdicts()) == []
    broken = [replace(verdicts()[0], passed=False), *verdicts()[1:]]
    assert failing(broken) == ["wide"]


def test_page_has_a_row_for_every_stratum_and_says_what_passes() -> None:
    page = calibration_page(verdicts(), table="numbers.csv", figure="curves.png")
    rows = [line.split(" | ") for line in page.splitlines() if line.startswith(("| wide", "| four-", "| sigma-"))]
    assert [row[-1] for row in rows] == ["passes |", "passes |", "**fails** |"]
    assert "**2 of 2 cases pass.**" in page
    assert "(numbers.csv)" in page
    assert "(curves.png)" in page
    assert f"{verdicts()[0].cover68:.3f}" in rows[0][6]


def test_page_of_misfits_alone() -> None:
    page = calibration_page(verdicts()[-1:], table="t", figure="f")
    assert "Where the model is the truth" not in page
    assert "true error twice the stated one" in page
