"""How parameters and times are written down."""

import math

import numpy as np
import pytest

from bella.records import Moment, Parameter, finite


def test_a_gaussian_has_its_quantiles() -> None:
    found = Parameter.gaussian(10.0, 2.0)
    assert (found.mean, found.sd, found.q50, found.contraction) == (10.0, 2.0, 10.0, None)
    assert [found.q2_5, found.q16, found.q84, found.q97_5] == pytest.approx(
        [10 - 3.919928, 10 - 1.988916, 10 + 1.988916, 10 + 3.919928], abs=1e-5
    )


@pytest.mark.parametrize(("mean", "sd"), [(math.nan, 1.0), (1.0, math.inf)])
def test_a_parameter_that_is_not_known_is_empty(mean: float, sd: float) -> None:
    assert Parameter.gaussian(mean, sd) == Parameter()


def test_a_moment_is_so_many_seconds_later() -> None:
    found = Moment.after(np.datetime64("2012-06-07T23:59:59.5", "ns"), Parameter(mean=0.25, q16=-1.0, sd=3.0))
    assert found == Moment(mean="2012-06-07T23:59:59.750Z", q16="2012-06-07T23:59:58.500Z", sd=3.0)


def test_numbers_that_are_not_finite_are_none() -> None:
    assert [finite(value) for value in (np.float64(1.5), math.nan, -math.inf)] == [1.5, None, None]
    assert type(finite(np.float64(1.5))) is float
