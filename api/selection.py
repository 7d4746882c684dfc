"""Bursts of a query as their figures need them: on the list page, and as files."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from urllib.parse import urlencode

from api.links import linked
from api.queries import NEWEST_FIRST, BurstSelection
from bella.catalogue import BurstSummary, Catalogue
from bella.plotting import Estimate, Marked, footpoint_figure, longitude_figure, wind_figure
from bella.records import REAL_ORIGINS

MOST_MARKED = 1000
"""More bursts than these are not drawn: the newest of them are."""


@dataclass(frozen=True)
class Selection:
    """Bursts that a query finds, the newest first, as far as they are drawn."""

    bursts: list[Marked]
    total: int
    has_unreal: bool

    def figures(self, address: str = "") -> dict[str, str]:
        """Figures by name; none where there are fewer than two bursts. Sectors lead to parts of an address."""
        if len(self.bursts) < 2:
            return {}
        drawn = {"longitude": longitude_figure(self.bursts), "footpoints": footpoint_figure(self.bursts, address)}
        return drawn | {"wind": wind_figure(self.bursts)}


def selection_of(catalogue: Catalogue, wanted: BurstSelection) -> Selection:
    """Bursts that a query finds.

    Raises
    ------
    InputError
        If the query cannot be read.
    """
    query = replace(BurstSelection.query(wanted), sort=NEWEST_FIRST, limit=MOST_MARKED)
    page = catalogue.bursts(query)
    return Selection(
        [_marked(one) for one in page.bursts],
        page.total,
        any(one.burst.origin not in REAL_ORIGINS for one in page.bursts),
    )


def selection_query(asked: Mapping[str, object]) -> str:
    """Query of the address of a selection, without what only says how a list shows it."""
    kept = {name: value for name, value in asked.items() if value and name in BurstSelection.model_fields}
    return urlencode(kept, doseq=True)


def sector_address(asked: Mapping[str, object]) -> str:
    """Address of the list of a selection, to which bounds of the longitude are added."""
    rest = {name: value for name, value in asked.items() if name not in {"longitude_min", "longitude_max"}}
    query = selection_query(rest)
    return linked("/") + (f"?{query}" if query else "")


def _marked(summary: BurstSummary) -> Marked:
    burst, best = summary.burst, summary.preferred
    answer = best.answer if best else None
    said = f"{burst.burst_id}: {answer.sentence if answer else 'no answer'}"
    longitude = _estimate(answer.phi0_deg, answer.phi0_low_deg, answer.phi0_high_deg) if answer else None
    wind = _estimate(answer.v_sw_km_s, answer.v_sw_low_km_s, answer.v_sw_high_km_s) if answer else None
    return Marked(
        burst.start_utc, longitude, wind, answer.grade if answer else "D", said, linked(f"/bursts/{burst.burst_id}")
    )


def _estimate(value: float | None, low: float | None, high: float | None) -> Estimate | None:
    return None if value is None or low is None or high is None else Estimate(value, low, high)
