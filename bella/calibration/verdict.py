"""One row per stratum: its numbers, whether it passes, and the table that keeps them."""

from collections.abc import Sequence
from dataclasses import dataclass

import bella
from bella.calibration.ranks import uniformity
from bella.calibration.rows import parse_rows, rows_csv
from bella.calibration.study import Comparison
from bella.multilateration.regions import LEVELS

SMALLEST_P = 0.001
"""Smallest p-value that passes, after Bonferroni."""
TESTS_PER_QUANTITY = 2


@dataclass(frozen=True)
class Verdict:
    """What was measured in one stratum; the columns of the table.

    Attributes
    ----------
    stratum, model, misfit : str
        Name, what was fitted, and how the truth departs from it; empty where it does not.
    separation_deg, sigma_s, v_sd_c, v_max_c, bad_probability, offset_sd_s : float
        As in :class:`bella.calibration.Stratum` and its priors and noise.
    cover68, cover95 : float
        Shares of sources inside their regions, with binomial 95 % intervals `_low` and `_high`.
    smallest_p : float
        Smallest p-value of all ranks, before Bonferroni.
    smallest_p_of : str
        Quantity that has it.
    tests : int
        Number of p-values of the whole run, by which each is multiplied.
    ess_share_least, ess_share_mean : float
        Effective share of draws.
    """

    stratum: str
    model: str
    misfit: str
    receivers: int
    separation_deg: float
    sigma_s: float
    dimensions: int
    v_sd_c: float
    v_max_c: float
    bad_probability: float
    offset_sd_s: float
    sources: int
    cover68: float
    cover68_low: float
    cover68_high: float
    cover95: float
    cover95_low: float
    cover95_high: float
    smallest_p: float
    smallest_p_of: str
    tests: int
    ess_share_least: float
    ess_share_mean: float
    passed: bool
    seed: int
    bella_version: str


def judge(comparisons: Sequence[Comparison], seed: int) -> list[Verdict]:
    """Judge the strata of a run.

    A stratum passes if no p-value of its ranks, times the number of p-values of the run, is below `SMALLEST_P`, and the
    coverage of both levels is among the accepted shares (:attr:`bella.calibration.coverage.Coverage.accepted`).

    Parameters
    ----------
    seed : int
        Of the run.
    """
    tests = TESTS_PER_QUANTITY * sum(len(one.ranks) for one in comparisons)
    return [_verdict(one, tests, seed) for one in comparisons]


def _verdict(comparison: Comparison, tests: int, seed: int) -> Verdict:
    stratum, coverage = comparison.stratum, comparison.coverage
    p_values = {name: uniformity(ranks).smallest for name, ranks in comparison.ranks.items()}
    worst = min(p_values, key=lambda name: p_values[name])
    passed = p_values[worst] * tests >= SMALLEST_P and all(one.passes for one in coverage.values())
    inner, outer = (coverage[level] for level in LEVELS)
    return Verdict(
        stratum=stratum.name,
        model=stratum.model,
        misfit=stratum.misfit.what if stratum.misfit else "",
        receivers=stratum.receivers,
        separation_deg=stratum.separation_deg,
        sigma_s=stratum.sigma_s,
        dimensions=stratum.dimensions,
        v_sd_c=stratum.priors.v_sd_c,
        v_max_c=stratum.priors.v_max_c,
        bad_probability=stratum.noise.bad_probability,
        offset_sd_s=stratum.offset_sd_s,
        sources=comparison.sources,
        cover68=inner.share,
        cover68_low=inner.interval[0],
        cover68_high=inner.interval[1],
        cover95=outer.share,
        cover95_low=outer.interval[0],
        cover95_high=outer.interval[1],
        smallest_p=p_values[worst],
        smallest_p_of=worst,
        tests=tests,
        ess_share_least=float(comparison.effective_share.min()),
        ess_share_mean=float(comparison.effective_share.mean()),
        passed=bool(passed),
        seed=seed,
        bella_version=bella.__version__,
    )


def failing(verdicts: Sequence[Verdict]) -> list[str]:
    """Names of strata that do not pass although truth and fitted model are the same."""
    return [one.stratum for one in verdicts if not one.passed and not one.misfit]


def verdict_table(verdicts: Sequence[Verdict]) -> str:
    """Verdicts as CSV, numbers written so that they are read back as they were."""
    return rows_csv(verdicts, Verdict)


def parse_verdicts(text: str) -> list[Verdict]:
    """Verdicts of a table that :func:`verdict_table` wrote.

    Raises
    ------
    InputError
        If it is not such a table.
    """
    return parse_rows(text, Verdict)
