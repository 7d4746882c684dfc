"""The report on a calibration run as a page of Markdown."""

from collections.abc import Sequence

from bella.calibration.coverage import SURE, TARGETS, Coverage
from bella.calibration.ranks import bins_of
from bella.calibration.strata import NEARER_RECEIVERS
from bella.calibration.study import DRAWS
from bella.calibration.verdict import SMALLEST_P, Verdict

INTRODUCTION = """# Calibration of the localisation

Does a 68 % region hold the source in 68 % of all cases? Sources, speeds and errors are drawn from the model of each
case below, and the arrival times that follow are localised with the exact posterior as it is published. Made by
`bella calibrate --sources {sources} --seed {seed}` of BELLA {version}; all numbers are in
[{table}]({table}).

**{passed} of {declared} cases pass.** A case passes if

- none of its p-values, times the {tests} of the run (Bonferroni), is below {smallest_p:g}. They test whether the rank
  of the truth among {draws} draws of its posterior is uniform (simulation-based calibration, Talts et al. 2018,
  [arXiv:1804.06788](https://arxiv.org/abs/1804.06788)), by Kolmogorov-Smirnov and by chi-squared in {bins} bins, for
  every coordinate, the emission time, the speed, and the density at the position (Modrák et al. 2025,
  [doi:10.1214/23-BA1404](https://doi.org/10.1214/23-BA1404)), which sees regions of wrong size or shape; and
- its highest-density regions hold the source in a share of cases within the targets, {targets},
  widened to where chance alone takes true regions in {sure} of {odds} runs with this number of sources:
{accepted}
"""

DECLARED = """
## Where the model is the truth

Receivers: one at the Earth and one on either side of it at the separation, all at 1 au; then
{nearer}
(out of the ecliptic only where the source is in space). In brackets binomial 95 % intervals. Smallest p: of the ranks
of this case, before Bonferroni. Draws: effective share of the draws of one posterior, smallest and mean.
"""

HEADER = """
| case | receivers | separation | sigma | source in | {last} | 68 % region | 95 % region | smallest p | draws | |
|---|---|---|---|---|---|---|---|---|---|---|
"""

DEPARTING = """
## Where it is not

The truth departs from the model on purpose. What fails here says that the checks see such a departure, and the
coverage says what it costs. Sources on Parker spirals obey the model of the arrival times and are only spread
otherwise than the prior says. A delay that is not declared goes into the emission time before it moves the position.
A bad arrival time among four leaves three, which fit some place whichever one is taken out: the preset `robust` then
spreads over several places, which helps and does not cure.
"""

FIGURE = """
## P-P curves

Share of truths below each quantile of their posterior, less the quantile. Grey: where the whole curve of a calibrated
posterior stays with a probability of 95 % (Säilynoja et al. 2022,
[doi:10.1007/s11222-022-10090-6](https://doi.org/10.1007/s11222-022-10090-6)); each curve leaves it in one case of 20.

![P-P curves of every case]({figure})

"""


def calibration_page(verdicts: Sequence[Verdict], *, table: str, figure: str) -> str:
    """Report on a run.

    Parameters
    ----------
    verdicts : sequence of Verdict
        At least one.
    table, figure : str
        Names of the files beside the page that hold the numbers and the P-P curves.

    Returns
    -------
    str
        Markdown.
    """
    declared = [one for one in verdicts if not one.misfit]
    departing = [one for one in verdicts if one.misfit]
    parts = [_introduction(verdicts[0], declared, table)]
    if declared:
        parts += [DECLARED.format(nearer=_nearer()), _rows(declared, "model")]
    if departing:
        parts += [DEPARTING, _rows(departing, "what is wrong")]
    return "".join([*parts, FIGURE.format(figure=figure)])


def _introduction(first: Verdict, declared: Sequence[Verdict], table: str) -> str:
    accepted = {level: Coverage(level, 0, first.sources).accepted for level in TARGETS}
    odds = round(1 / (1 - SURE))
    return INTRODUCTION.format(
        sources=first.sources,
        seed=first.seed,
        version=first.bella_version,
        table=table,
        passed=sum(one.passed for one in declared),
        declared=len(declared),
        tests=first.tests,
        smallest_p=SMALLEST_P,
        draws=DRAWS,
        bins=bins_of(first.sources),
        accepted="\n".join(
            f"  - {low:.3f} to {high:.3f} for the {100 * level:g} % region" for level, (low, high) in accepted.items()
        ),
        targets=" and ".join(f"{low:g} to {high:g}" for low, high in TARGETS.values()),
        sure=odds - 1,
        odds=odds,
    )


def _nearer() -> str:
    return " and ".join(
        f"one at {au:g} au, longitude {east:g}°, latitude {north:g}°" for au, east, north in NEARER_RECEIVERS
    )


def _rows(verdicts: Sequence[Verdict], last: str) -> str:
    return HEADER.format(last=last) + "".join(_row(one) for one in verdicts)


def _row(verdict: Verdict) -> str:
    cells = (
        verdict.stratum,
        f"{verdict.receivers}",
        f"{verdict.separation_deg:g}°",
        f"{verdict.sigma_s:g} s",
        "space" if verdict.dimensions == 3 else "ecliptic",
        f"{verdict.misfit}; {verdict.model}" if verdict.misfit else verdict.model,
        f"{verdict.cover68:.3f} ({verdict.cover68_low:.3f}-{verdict.cover68_high:.3f})",
        f"{verdict.cover95:.3f} ({verdict.cover95_low:.3f}-{verdict.cover95_high:.3f})",
        f"{verdict.smallest_p:.2g} ({verdict.smallest_p_of})",
        f"{100 * verdict.ess_share_least:.0f}, {100 * verdict.ess_share_mean:.0f} %",
        "passes" if verdict.passed else "**fails**",
    )
    return f"| {' | '.join(cells)} |\n"
