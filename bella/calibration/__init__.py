"""Does a posterior mean what it says? Coverage and simulation-based calibration of the localisation, per geometry.

:func:`run_stratum` is the door to the localisation alone. Behind it: `strata` (which cases, declared as a table),
`truths` (sources and arrival times drawn from the model, or wrong on purpose), `ranks` (uniformity and its band),
`coverage` (how often a region holds its source), `study` (truth against posterior), `verdict` (one row per stratum, and
what passes) and `page` (the report). :func:`bella.calibration.found.find_all` is the door to bursts that go through the
whole pipeline; `found_table` and `found_page` report on them.
"""

from bella.calibration.page import calibration_page
from bella.calibration.strata import STRATA, Misfit, Stratum, find_strata
from bella.calibration.study import Comparison, check_sources, run_stratum
from bella.calibration.verdict import Verdict, failing, judge, parse_verdicts, verdict_table

__all__ = [
    "STRATA",
    "Comparison",
    "Misfit",
    "Stratum",
    "Verdict",
    "calibration_page",
    "check_sources",
    "failing",
    "find_strata",
    "judge",
    "parse_verdicts",
    "run_stratum",
    "verdict_table",
]
