"""Figures of a burst as a query of an address asks for them: which answer, of what part, on whose clock."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import xarray as xr
from pydantic import Field, ValidationError, field_validator

from api.queries import SolutionChoice, chosen
from api.service import Service
from bella.catalogue import BurstSummary, Catalogue, Solution
from bella.exceptions import InputError, NoDataError
from bella.plotting import (
    MapView,
    SpectraView,
    TrackView,
    constellation_figure,
    edge_name,
    evolution_figure,
    residual_figure,
    spectra_figure,
)
from bella.plotting.constellation import Frame, View
from bella.plotting.geometry import receiver_positions
from bella.plotting.spectra import Clock
from bella.records import Interval
from bella.spacecraft import position
from bella.times import parse_utc
from bella.units import C_RSUN_S, FloatArray


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
    def posterior(self) -> xr.Dataset | None:
        """Posterior of the answer that is shown; None where it has no positions."""
        return self._posterior(self.shown) if self.shown else None

    def _posterior(self, solution: Solution) -> xr.Dataset | None:
        group = self.service.posterior(solution)
        return group if "region68" in group and "x_rsun" in group else None

    def tags(self) -> tuple[list[Solution], list[object]]:
        """What a figure depends on, for its entity tag."""
        solutions = [*([self.shown] if self.shown else []), *(self.others if self.view.all else [])]
        return solutions, [self.view.model_dump_json(), self.summary.burst.spectra_path]

    def constellation(self) -> str:
        """Map with the track."""
        burst = self.summary.burst
        wanted = [self.shown, *(self.others if self.view.all else [])] if self.shown else []
        tracks = [
            TrackView(edge_name(one.series.edge), group, self.catalogue.track_fit(one.solution_id))
            for one in wanted
            if one and (group := self._posterior(one)) is not None
        ]
        utc = np.datetime64(burst.start_utc.replace(tzinfo=None), "ns")
        is_placed = bool(tracks) and self.posterior is not None
        sectors = (self.track.get("joint") or {}).get("phi0_68", ())
        look = MapView(
            view=self.view.view,
            frame=self.view.frame,
            frequency_mhz=self.view.frequency,
            sectors=() if is_placed else [Interval(**one) for one in sectors],
            receivers={} if is_placed else places_of(burst.observatories, utc),
        )
        return constellation_figure(tracks, utc, look)

    def spectra(self) -> str:
        """Spectra with the edges that were timed.

        Raises
        ------
        NoDataError
            If no spectra were kept.
        """
        burst = self.summary.burst
        tree = self.service.spectra(burst.burst_id, burst.spectra_path)
        wanted = [self.shown, *(self.others if self.view.all else [])] if self.shown else []
        edges = {one.series.edge: self.service.posterior(one) for one in reversed(wanted) if one}
        look = SpectraView(
            clock=self.view.clock,
            shift_s=self._shift_s(),
            span_s=self.view.span_s,
            band_mhz=self.view.band_mhz,
            frequency_mhz=self.view.frequency,
        )
        return spectra_figure(tree, edges, look)

    def _shift_s(self) -> dict[str, float]:
        """Seconds from the clock of each spacecraft to the one that is asked for."""
        if self.view.clock == "spacecraft":
            return {}
        burst = self.summary.burst
        utc = np.datetime64(burst.start_utc.replace(tzinfo=None), "ns")
        group = self.service.posterior(self.shown) if self.shown else None
        where = receiver_positions(group) if group is not None and "receiver_rsun" in group else {}
        where = where or places_of(burst.observatories, utc)
        to_earth = float(np.linalg.norm(position("EARTH", utc)[0])) if self.view.clock == "earth" else 0.0
        return {name: (to_earth - float(np.linalg.norm(one))) / C_RSUN_S for name, one in where.items()}

    def evolution(self) -> str | None:
        """Distance and beam speed against frequency; None where there are no positions."""
        return evolution_figure(self.posterior, self.track) if self.posterior is not None and self.shown else None

    def residuals(self) -> str | None:
        """Residuals of the arrival times; None where they are not known."""
        known = self.posterior is not None and "residual_s" in self.posterior
        return residual_figure(self.posterior) if known and self.posterior is not None else None


def places_of(names: tuple[str, ...], utc: np.datetime64) -> dict[str, FloatArray]:
    """Where those spacecraft were whose positions are known, HEE."""
    found = {}
    for name in names:
        try:
            found[name] = position(name, utc)[0]
        except (InputError, NoDataError):
            continue
    return found
