"""Figures as a query of an address asks for them: of one burst, and of all bursts that a query finds."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any
from urllib.parse import urlencode

import numpy as np
from pydantic import Field, ValidationError, field_validator

from api.links import linked
from api.queries import CHOICES, NEWEST_FIRST, BurstSelection, SolutionChoice, chosen
from api.service import Service
from bella.catalogue import BurstPoint, BurstSummary, Catalogue, Solution
from bella.exceptions import InputError
from bella.pipeline import page_figures
from bella.pipeline.page_figures import AnswerData, FirstLook
from bella.plotting import Estimate, MapView, Marked, SpectraView, footpoint_figure, longitude_figure, wind_figure
from bella.plotting.constellation import Frame, View
from bella.plotting.geometry import receiver_positions
from bella.plotting.spectra import Clock
from bella.records import REAL_ORIGINS
from bella.spacecraft import position
from bella.times import parse_utc
from bella.units import C_RSUN_S

MOST_MARKED = 1000
"""More bursts than these are not drawn: the newest of them are."""


class BurstView(SolutionChoice):
    """What of a burst is looked at, and from where."""

    view: View = Field("track", description="Map: what the track needs, or the whole fleet.")
    frame: Frame = Field("hee", description="Whose longitudes the grid of the map shows.")
    clock: Clock = Field("spacecraft", description="Spectra: as received, or as light left the Sun or came to Earth.")
    all: bool = Field(False, description="True: with the other answers.")
    frequency: float | None = Field(None, gt=0, le=1000, description="MHz, whose regions stand out.")
    t: str | None = Field(None, description="Spectra: two UTC times with a comma between them.")
    f: str | None = Field(None, description="Spectra: two frequencies in MHz with a comma between them.")

    @field_validator("t")
    @classmethod
    def _two_times(cls, text: str | None) -> str | None:
        cls._span(text)
        return text

    @field_validator("f")
    @classmethod
    def _two_frequencies(cls, text: str | None) -> str | None:
        cls._band(text)
        return text

    @property
    def span_s(self) -> tuple[float, float] | None:
        """Time of the spectra, seconds since 1970."""
        return self._span(self.t)

    @property
    def band_mhz(self) -> tuple[float, float] | None:
        """Frequencies of the spectra."""
        return self._band(self.f)

    @staticmethod
    def _span(text: str | None) -> tuple[float, float] | None:
        if not text:
            return None
        ends = [parse_utc(one, "t") for one in text.split(",")]
        first, last = (one.timestamp() for one in ends if one) if len(ends) == 2 else (0.0, 0.0)
        if not 1.0 <= last - first <= 2 * 86_400.0:
            raise ValueError("give two times, the first one earlier, a second to two days apart")
        return first, last

    @staticmethod
    def _band(text: str | None) -> tuple[float, float] | None:
        if not text:
            return None
        ends = [float(one) for one in text.split(",")]
        if len(ends) != 2 or not 1e-3 <= ends[0] < 0.999 * ends[1] <= 1e3:
            raise ValueError("give two frequencies in MHz, the lower one first")
        return ends[0], ends[1]

    @classmethod
    def lenient(cls, query: Mapping[str, str]) -> "BurstView":
        """View of the query of a page, without what cannot be read: a link that was cut short still shows the burst."""
        given = {name: value for name, value in query.items() if name in cls.model_fields and value != ""}
        try:
            return cls.model_validate(given)
        except (ValidationError, InputError) as error:
            faults = {str(one["loc"][0]) for one in error.errors()} if isinstance(error, ValidationError) else {"t"}
            return cls.lenient({name: value for name, value in given.items() if name not in faults})


@dataclass(frozen=True)
class Looked:
    """A burst as it is looked at: the answer that is shown, and the others."""

    service: Service
    catalogue: Catalogue
    summary: BurstSummary
    view: BurstView

    @cached_property
    def shown(self) -> Solution | None:
        """The answer that is shown; None where the burst has none.

        Raises
        ------
        NoDataError
            If the burst has no such series or version.
        """
        burst_id = self.summary.burst.burst_id
        known = self.summary.solutions if self.view.version is None else self.catalogue.versions(burst_id)
        is_asked = any((self.view.edge, self.view.method, self.view.preset, self.view.version))
        return chosen(known, self.view, burst_id) if known or is_asked else None

    @property
    def others(self) -> list[Solution]:
        """Newest version of every other series."""
        return [one for one in self.summary.solutions if self.shown and one.series != self.shown.series]

    @cached_property
    def track(self) -> dict[str, Any]:
        """Track fit of the answer that is shown."""
        return self.catalogue.track_fit(self.shown.solution_id) if self.shown else {}

    @cached_property
    def answer(self) -> AnswerData | None:
        """The same with its posterior and its track; None where the burst has no answer."""
        return self._answered(self.shown, self.track) if self.shown else None

    def _answered(self, solution: Solution, track: dict[str, Any]) -> AnswerData:
        return AnswerData(solution, self.service.posterior(solution), track)

    @cached_property
    def first(self) -> FirstLook | None:
        """What was drawn of the answer when it was published; None where that is not kept, or no longer what it was."""
        return self.service.first_look(self.summary.burst, self.shown) if self.shown else None

    @property
    def _as_drawn(self) -> dict[str, str]:
        """Figures that were drawn, where the view is the one of which they were."""
        is_first = not self.view.model_dump(exclude_defaults=True, exclude=set(CHOICES) | {"theme"})
        return self.first.figures if self.first and is_first else {}

    @cached_property
    def _answers(self) -> list[AnswerData]:
        """Those that are drawn, the one that is shown first."""
        others = self.others if self.view.all else []
        rest = [self._answered(one, self.catalogue.track_fit(one.solution_id)) for one in others]
        return [self.answer, *rest] if self.answer else []

    def tags(self) -> list[object]:
        """What a figure depends on, for its entity tag."""
        return [self.shown and self.shown.store_sha256, self.view.model_dump_json(), self.summary.burst.updated_utc]

    def channels(self) -> list[float]:
        """Frequencies of the answer that is shown, MHz, ascending."""
        if self.first:
            return self.first.channels_mhz
        return page_figures.channels_of(self.answer) if self.answer else []

    def constellation(self) -> str:
        """Map with the track."""
        view, drawn = self.view, self._as_drawn.get("constellation")
        look = MapView(view=view.view, frame=view.frame, frequency_mhz=view.frequency)
        return drawn or page_figures.constellation(self.summary.burst, self._answers, look)

    def spectra(self) -> str:
        """Spectra with the edges that were timed.

        Raises
        ------
        NoDataError
            If no spectra were kept.
        """
        if drawn := self._as_drawn.get("spectra"):
            return drawn
        burst = self.summary.burst
        tree = self.service.spectra(burst.burst_id, burst.spectra_path)
        look = SpectraView(
            clock=self.view.clock,
            shift_s=self._shift_s(),
            span_s=self.view.span_s,
            band_mhz=self.view.band_mhz,
            frequency_mhz=self.view.frequency,
        )
        return page_figures.spectra(tree, self._answers, look)

    def _shift_s(self) -> dict[str, float]:
        """Seconds from the clock of each spacecraft to the one that is asked for."""
        if self.view.clock == "spacecraft":
            return {}
        burst = self.summary.burst
        utc = np.datetime64(burst.start_utc.replace(tzinfo=None), "ns")
        group = self.answer.posterior if self.answer else None
        measured = receiver_positions(group) if group is not None and "receiver_rsun" in group else {}
        where = measured or page_figures.places_of(burst.observatories, utc)
        to_earth = float(np.linalg.norm(position("EARTH", utc)[0])) if self.view.clock == "earth" else 0.0
        return {name: (to_earth - float(np.linalg.norm(one))) / C_RSUN_S for name, one in where.items()}

    def evolution(self) -> str | None:
        """Distance and beam speed against frequency; None where there are no positions."""
        if self.first:
            return self.first.figures.get("evolution")
        return page_figures.evolution(self.answer) if self.answer else None

    def residuals(self) -> str | None:
        """Residuals of the arrival times; None where they are not known."""
        if self.first:
            return self.first.figures.get("residuals")
        return page_figures.residuals(self.answer) if self.answer else None


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
    page = catalogue.points(query)
    has_unreal = any(one.origin not in REAL_ORIGINS for one in page.points)
    return Selection([_marked(one) for one in page.points], page.total, has_unreal)


def selection_query(asked: Mapping[str, object]) -> str:
    """Query of the address of a selection, without what only says how a list shows it."""
    kept = {name: value for name, value in asked.items() if value and name in BurstSelection.model_fields}
    return urlencode(kept, doseq=True)


def sector_address(asked: Mapping[str, object]) -> str:
    """Address of the list of a selection, to which bounds of the longitude are added."""
    rest = {name: value for name, value in asked.items() if name not in {"longitude_min", "longitude_max"}}
    query = selection_query(rest)
    return linked("/") + (f"?{query}" if query else "")


def _marked(point: BurstPoint) -> Marked:
    answer = point.answer
    said = f"{point.burst_id}: {answer.sentence if answer else 'no answer'}"
    longitude = _estimate(answer.phi0_deg, answer.phi0_low_deg, answer.phi0_high_deg) if answer else None
    wind = _estimate(answer.v_sw_km_s, answer.v_sw_low_km_s, answer.v_sw_high_km_s) if answer else None
    return Marked(
        point.start_utc, longitude, wind, answer.grade if answer else "D", said, linked(f"/bursts/{point.burst_id}")
    )


def _estimate(value: float | None, low: float | None, high: float | None) -> Estimate | None:
    return None if value is None or low is None or high is None else Estimate(value, low, high)
