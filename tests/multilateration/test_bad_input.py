"""An answer with flags or one clear line, for every method and option: never NaN, never a silent cut."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bella.exceptions import BellaError, InputError
from bella.multilateration import localise
from tests.multilateration.geometry import EVENT, FIVE, FOUR, grid_of, on_spiral, polar, table_of

CHOICES = [
    {"preset": "robust"},
    {"preset": "subluminal"},
    {"preset": "free-speed"},
    {"dimensions": 3},
    {"method": "tdoa"},
    {"method": "tdoa", "dimensions": 3},
]
NAMES = ["-".join(str(value) for value in choice.values()) for choice in CHOICES]
MAY_BE_MISSING = ("region", "mode_mean", "log_evidence", "clock_")


def answered(table: pd.DataFrame, **choice) -> str:
    """Flags of a solution whose numbers are finite, or the one line of its refusal."""
    try:
        solved = localise(table, draws=50, **choice)
    except BellaError as error:
        return refusal(error)
    for name, variable in solved.data_vars.items():
        if variable.dtype.kind == "f" and not str(name).startswith(MAY_BE_MISSING):
            assert np.isfinite(variable).all(), name
    return ";".join(np.unique(solved["flags"]))


def refusal(error: BellaError) -> str:
    """Text of an error that says what to do."""
    text = str(error)
    assert len(text.splitlines()) == 1
    assert isinstance(error, InputError) or "sigma_s" in text
    return text


SMALL = {1e-3: NAMES, 1e-9: ("subluminal", "3")}
"""Errors and choices of which each takes seconds."""

ERRORS = [
    pytest.param(
        choice, sigma_s, id=f"{sigma_s:g}-{name}", marks=[pytest.mark.acceptance] * (name in SMALL.get(sigma_s, ()))
    )
    for sigma_s in (1e-9, 1e-3, 1.0, 1e4, 86_400.0)
    for choice, name in zip(CHOICES, NAMES, strict=True)
]


@pytest.mark.parametrize(("choice", "sigma_s"), ERRORS)
def test_any_error_is_answered(choice, sigma_s) -> None:
    answered(table_of(grid_of(on_spiral(75), FOUR, sigma_s)), **choice)


@pytest.mark.parametrize("choice", CHOICES, ids=NAMES)
def test_odd_receivers_are_answered(choice) -> None:
    source = on_spiral(75)
    one_place = answered(table_of(grid_of(source, EVENT[[0, 0, 0, 0]], 20.0)), **choice)
    assert "not_constrained" in one_place or "use the method posterior" in one_place
    two_places = answered(table_of(grid_of(source, EVENT[[0, 0, 1, 2]], 20.0)), **choice)
    assert two_places
    on_one_line = np.array([polar(r, 20.0) for r in (60.0, 120.0, 180.0, 215.0)])
    assert answered(table_of(grid_of(source, on_one_line, 20.0)), **choice)
    answered(table_of(grid_of(FOUR[0], FOUR, 20.0)), **choice)
    answered(table_of(grid_of(source, 90 * FOUR, 20.0)), **choice)


@pytest.mark.parametrize("choice", CHOICES, ids=NAMES)
def test_delays_beyond_light_time_are_answered(choice) -> None:
    table = table_of(grid_of(on_spiral(75), FOUR, 20.0))
    late = table.assign(arrival_utc=table["arrival_utc"] + pd.to_timedelta(3000.0 * np.arange(4), unit="s"))
    said = answered(late, **choice)
    assert any(
        word in said
        for word in ("inconsistent", "no position explains", "no_exact_root", "bad_arrival", "use the method posterior")
    )


@given(
    st.lists(st.tuples(st.floats(1, 300), st.floats(-180, 180), st.floats(-90, 90)), min_size=4, max_size=5),
    st.lists(st.floats(-5000, 5000), min_size=5, max_size=5),
    st.floats(5, 1e5),
    st.sampled_from(CHOICES),
)
@settings(max_examples=24, deadline=None)
def test_no_table_gives_nan(places, arrivals, sigma_s, choice) -> None:
    receivers = np.array(
        [polar(r, a) * np.cos(np.radians(b)) + [0, 0, r * np.sin(np.radians(b))] for r, a, b in places]
    )
    table = table_of(grid_of(np.zeros(3), receivers, sigma_s))
    moved = table["arrival_utc"].min() + pd.to_timedelta(arrivals[: len(places)], unit="s")
    answered(table.assign(arrival_utc=moved), **choice)


@pytest.mark.parametrize("count", [0, 1, 2])
@pytest.mark.parametrize("choice", CHOICES, ids=NAMES)
def test_too_few_receivers_are_refused(choice, count) -> None:
    table = table_of(grid_of(on_spiral(75), FIVE, 20.0)).head(count)
    with pytest.raises(InputError, match=r"3 or more spacecraft|has 0 rows"):
        localise(table, **choice)


def test_missing_numbers_are_refused_with_row_and_column() -> None:
    table = table_of(grid_of(on_spiral(75), FIVE, 20.0))
    for column in ("sigma_s", "delay_sd_s", "x_rsun"):
        broken = table.astype({column: object})
        broken.loc[2, column] = "none"
        with pytest.raises(InputError, match=f"row 3, column {column}: 'none' is not a number"):
            localise(broken)
    shared = table.assign(offset_sd_s=5.0)
    shared = pd.concat([shared, shared.assign(frequency_mhz=0.5, offset_sd_s=6.0)], ignore_index=True)
    with pytest.raises(InputError, match=r"row 6, column offset_sd_s: .* all its channels share it"):
        localise(shared)


def test_thousands_of_rows_are_answered() -> None:
    rng = np.random.default_rng(1)
    sources = np.c_[rng.normal(0, 60, (800, 2)), np.zeros(800)]
    grid = grid_of(sources, FOUR, 30.0, noise=rng.standard_normal((800, 4)))
    solved = localise(table_of(grid).head(3_200), draws=20)

    assert solved.sizes["frequency"] == 800
    assert np.isfinite(solved["x_rsun"]).all()
