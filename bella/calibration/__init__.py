"""Does a posterior mean what it says? Coverage and simulation-based calibration of the localisation, per geometry.

:func:`run_stratum` is the door to the localisation alone. Behind it: `strata` (which cases, declared as a table),
`truths` (sources and arrival times drawn from the model, or wrong on purpose), `ranks` (uniformity and its band),
`coverage` (how often a region holds its source), `study` (truth against posterior), `verdict` (one row per stratum, and
what passes) and `page` (the report). :func:`bella.calibration.found.find_all` is the door to bursts that go through the
whole pipeline; `found_table` and `found_page` report on them, and `tried` says which of them a real answer is like. The
service reads the last: what fits is imported when it is first asked for.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
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

_IMPORTED_FROM = {
    "bella.calibration.page": ("calibration_page",),
    "bella.calibration.strata": ("STRATA", "Misfit", "Stratum", "find_strata"),
    "bella.calibration.study": ("Comparison", "check_sources", "run_stratum"),
    "bella.calibration.verdict": ("Verdict", "failing", "judge", "parse_verdicts", "verdict_table"),
}


def __getattr__(name: str) -> Any:
    for module, names in _IMPORTED_FROM.items():
        if name in names:
            return getattr(import_module(module), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
