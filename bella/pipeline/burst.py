"""One burst: localise it with every definition of its edge, publish what is new, compare, draw it.

The edge that the rule prefers is published first, and what other methods say of the tracks follows under the same ids:
neither the preferred solution nor its grade depends on that. A run that was killed in between is made up for by the
next, which finds what is missing.

Only an error of the science says that a burst is not localisable. A full disk, a lost database or a lost lease ends the
work and is raised, so that it is tried again.
"""

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from typing import Any, TypeVar

import numpy as np
import pandas as pd
import structlog
import xarray as xr

import bella
from bella.answer import read_track, wind_gap
from bella.arrivals import MIN_OBSERVATORIES, ArrivalGrid, arrival_grid, locate_receivers
from bella.catalogue import Catalogue, Lease, Series, Solution, SolutionTimes, edge_rank
from bella.exceptions import ConvergenceError, InputError, NoDataError, NotPlacedError
from bella.flags import APPARENT_SOURCE
from bella.multilateration import localise
from bella.multilateration.priors import apply_sigma_rule, find_preset
from bella.pipeline.day import PRELIMINARY_EDGES
from bella.pipeline.draw import Drawn, draw_burst
from bella.pipeline.inputs import BurstInput
from bella.pipeline.progress import counter
from bella.pipeline.publication import Draft, inputs_hash, publish, store_spectra
from bella.pipeline.surroundings import Surroundings, surroundings_of
from bella.pipeline.tracks import Fitted, Timing, companions, fitted_track
from bella.records import JointTrack, PreliminaryLevel, Track
from bella.settings import Settings
from bella.tracks import fit_preliminary, level_of

log = structlog.get_logger(__name__)

STAGE = "localise"
SCIENCE_ERRORS = (InputError, NoDataError, ConvergenceError)
"""What says that a burst cannot be localised, raised by a computation; of anything else the burst is not to blame."""

PRELIMINARY, FINAL = "preliminary", "final"
T = TypeVar("T")


@dataclass(frozen=True)
class Choice:
    """How a burst is localised."""

    method: str = "posterior"
    preset: str = "default"
    dimensions: int = 2


@dataclass(frozen=True)
class Outcome:
    """What a run has to say about one solution."""

    solution: Solution
    new: bool
    track: dict[str, Any]


@dataclass(frozen=True)
class BurstOutcome:
    """What became of a burst: its solutions, or the reason why there are none."""

    burst_id: str
    outcomes: tuple[Outcome, ...] = ()
    reason: str = ""

    @property
    def is_final(self) -> bool:
        """Whether its solutions have positions."""
        return any(one.solution.answer.tier == FINAL for one in self.outcomes)

    def published(self) -> tuple[Outcome, ...]:
        """Its solutions; NotPlacedError where there are none."""
        if self.reason:
            raise NotPlacedError(self.reason)
        return self.outcomes


@dataclass(frozen=True)
class Begun:
    """A burst whose first solution is published, and what its others need.

    Attributes
    ----------
    given : BurstInput
        With its spectra in the store, once a solution is published.
    outcomes : tuple of Outcome
        Solutions that are published.
    fitted : mapping of str to Fitted
        Fits of those that are new, by solution.
    refused : mapping of str to str
        Edges that give no solution, and why.
    """

    given: BurstInput
    choice: Choice
    around: Surroundings
    begun_utc: datetime
    outcomes: tuple[Outcome, ...] = ()
    fitted: Mapping[str, Fitted] = field(default_factory=dict)
    refused: Mapping[str, str] = field(default_factory=dict)


def process_burst(given: BurstInput, choice: Choice, settings: Settings, run_id: str) -> BurstOutcome:
    """Localise a burst: :func:`begin_burst`, and :func:`continue_burst` to its end, with no other run in between."""
    with _at_work(given.burst.burst_id, settings, run_id) as (catalogue, lease):
        done = _begin(given, choice, catalogue, settings, lease)
        while isinstance(done, Begun):
            done = _Work(done, catalogue, settings, lease).next_step()
    return done


def begin_burst(given: BurstInput, choice: Choice, settings: Settings, run_id: str) -> Begun | BurstOutcome:
    """Publish the first solution of a burst that has a track: that of the edge that the rule prefers, if it can be.

    Parameters
    ----------
    given : BurstInput
        Received by two spacecraft: a preliminary track is published.

    Returns
    -------
    Begun or BurstOutcome
        The latter, with a reason, where no edge gives a solution.

    Raises
    ------
    BusyError
        If another run is at work on the burst, or has taken it over.
    StoreError, UnreachableError, OSError
        If store or catalogue cannot be used: nothing is said of the burst.
    """
    with _at_work(given.burst.burst_id, settings, run_id) as (catalogue, lease):
        return _begin(given, choice, catalogue, settings, lease)


def _begin(
    given: BurstInput, choice: Choice, catalogue: Catalogue, settings: Settings, lease: Lease
) -> Begun | BurstOutcome:
    begun_utc = datetime.now(UTC)
    around = surroundings_of(given.burst.start_utc, settings)
    burst = replace(given.burst, origin=given.origin)
    work = _Work(Begun(replace(given, burst=burst), choice, around, begun_utc), catalogue, settings, lease)
    begun = work.first() if len(burst.observatories) >= MIN_OBSERVATORIES else work.preliminary()
    return begun if begun.outcomes else BurstOutcome(burst.burst_id, reason=next(iter(begun.refused.values())))


def continue_burst(begun: Begun, settings: Settings, run_id: str) -> Begun | BurstOutcome:
    """Do the next step of a burst: one more solution, what other methods say of one, or in the end its figures.

    Each takes a few seconds, so that work which is more urgent soon finds a worker.

    Returns
    -------
    Begun or BurstOutcome
        The latter where nothing is left to be done.

    Raises
    ------
    BusyError, StoreError, UnreachableError, OSError
        As :func:`begin_burst`; what is published stays, and a later run does the rest.
    """
    with _at_work(begun.given.burst.burst_id, settings, run_id) as (catalogue, lease):
        return _Work(begun, catalogue, settings, lease).next_step()


@contextmanager
def _at_work(burst_id: str, settings: Settings, run_id: str) -> Iterator[tuple[Catalogue, Lease]]:
    """Catalogue, and the lease of a burst: where that is lost, nothing is published any more."""
    with (
        structlog.contextvars.bound_contextvars(run_id=run_id, burst_id=burst_id),
        closing(Catalogue.open(settings.catalogue_url, create=True)) as catalogue,
        catalogue.lease(STAGE, burst_id, run_id, settings.lease_s) as lease,
    ):
        yield catalogue, lease


def computed(compute: Callable[[], T]) -> T:
    """Result of a computation; an error of the science becomes the reason why a burst is not localised.

    Parameters
    ----------
    compute : callable
        Reads and writes nothing.

    Raises
    ------
    NotPlacedError
        With the message of the error.
    """
    try:
        return compute()
    except SCIENCE_ERRORS as error:
        raise NotPlacedError(str(error)) from error


@dataclass
class _Work:
    """A burst being localised, with all that is needed for it."""

    begun: Begun
    catalogue: Catalogue
    settings: Settings
    lease: Lease

    @property
    def given(self) -> BurstInput:
        return self.begun.given

    def first(self) -> Begun:
        """With solutions of edges, the one first that the rule prefers, until one has a track."""
        edges = self._edges_left()
        while edges and not any(one.solution.answer.has_track for one in self.begun.outcomes):
            self._try(edges.pop(0), self._final)
        return self.begun

    def preliminary(self) -> Begun:
        """With the preliminary track of a burst that two spacecraft received, unless a final answer is there."""
        edges = [name for name in PRELIMINARY_EDGES if name in self.given.arrivals] or list(self.given.arrivals)
        self._try(edges[0], lambda edge: self._preliminary(edge, edges[1:]))
        return self.begun

    def next_step(self) -> Begun | BurstOutcome:
        """After one more edge, else one more comparison with other methods, else the figures, which come last."""
        # a preliminary track stands alone
        edges = self._edges_left() if self.begun.outcomes[0].solution.answer.tier == FINAL else []
        waiting = [one for one in self.begun.outcomes if one.track.get("companions_pending")]
        if edges:
            self._try(edges[0], self._final)
        elif waiting:
            self._compare(waiting[0])
        else:
            return self._drawn()
        return self.begun

    def _compare(self, outcome: Outcome) -> None:
        solution, timing = outcome.solution, self._timing(outcome.solution.series.edge)
        fitted = self.begun.fitted.get(solution.solution_id) or self._fitted(timing, solution.series)
        beside = companions(fitted, timing, self.settings.seed, self.begun.around)
        done = replace(outcome, track=self.catalogue.add_companions(solution.solution_id, beside, self.lease))
        outcomes = tuple(done if one is outcome else one for one in self.begun.outcomes)
        fits = {name: one for name, one in self.begun.fitted.items() if name != solution.solution_id}
        self.begun = replace(self.begun, outcomes=outcomes, fitted=fits)

    def _drawn(self) -> BurstOutcome:
        begun = self.begun
        draw_burst(begun.given, [Drawn(one.solution, one.track) for one in begun.outcomes], self.settings, begun.around)
        # a later one of these may have become the preferred solution
        last = [replace(one, solution=self.catalogue.solution(one.solution.solution_id)) for one in begun.outcomes]
        return BurstOutcome(begun.given.burst.burst_id, tuple(last))

    def _edges_left(self) -> list[str]:
        # the edge that the rule prefers comes first: what is published after it leaves the choice as it is
        done = {one.solution.series.edge for one in self.begun.outcomes} | set(self.begun.refused)
        return sorted(set(self.given.arrivals) - done, key=edge_rank)

    def _try(self, edge: str, solve: Callable[[str], Outcome]) -> None:
        """Take note of the solution of an edge; one that cannot be computed does not stop the others."""
        try:
            outcome = solve(edge)
        except NotPlacedError as error:
            log.warning("edge gives no solution", edge=edge, reason=str(error))
            self.begun = replace(self.begun, refused={**self.begun.refused, edge: str(error)})
        else:
            self.begun = replace(self.begun, outcomes=(*self.begun.outcomes, outcome))

    def _series(self, edge: str) -> Series:
        choice = self.begun.choice
        return Series(edge, choice.method, choice.preset, choice.dimensions)

    def _final(self, edge: str) -> Outcome:
        """Solution of one series: the one that is there if its inputs are the same, else a new version."""
        series, timing = self._series(edge), self._timing(edge)
        checksum = inputs_hash(timing, self.begun.around.sources(), series, self.settings)
        if (same := self._same(series, checksum)) is not None:
            return same
        burst_id = self.given.burst.burst_id
        fitted = self._fitted(timing, series)
        track = fitted.track.model_dump(mode="json")
        level = preliminary_level(self.catalogue, burst_id, fitted.track)
        if level is not None:
            track["preliminary"] = level.model_dump(mode="json")
        if self.given.published_track:
            track["published"] = dict(self.given.published_track)
        done = self._published(series, checksum, fitted.drawn, track)
        self.begun = replace(self.begun, fitted={**self.begun.fitted, done.solution.solution_id: fitted})
        return done

    def _fitted(self, timing: Timing, series: Series) -> Fitted:
        burst_id = self.given.burst.burst_id
        posterior = computed(lambda: _posterior(timing.arrivals, burst_id, series, self.settings))
        return computed(lambda: fitted_track(posterior, timing, series, self.settings))

    def _preliminary(self, edge: str, others: Sequence[str]) -> Outcome:
        series, timing = self._series(edge), self._timing(edge)
        burst_id, second = self.given.burst.burst_id, [self._timing(name) for name in others]
        final = [one for one in _versions(self.catalogue, burst_id) if one.answer.tier == FINAL]
        if final:
            raise NotPlacedError(f"two spacecraft give no more than {final[0].solution_id}, which stands")
        around = self.begun.around.sources()
        parts = [inputs_hash(one, around, series, self.settings) for one in (timing, *second)]
        checksum = hashlib.sha256(" ".join([PRELIMINARY, *parts]).encode()).hexdigest()
        if (same := self._same(series, checksum)) is not None:
            return same
        joint = computed(lambda: fit_preliminary(*(_grid(one, series) for one in (timing, *second[:1]))))
        track = Track(remark=APPARENT_SOURCE, rotation_period_d=joint.rotation_period_d, joint=joint)
        circle = circle_dataset(joint, burst_id, edge)
        return self._published(series, checksum, circle, track.model_dump(mode="json"))

    def _timing(self, edge: str) -> Timing:
        channels = self.given.channel_arrivals.get(edge)
        located = None if channels is None else locate_receivers(channels)
        is_first = edge == next(iter(self.given.arrivals))
        measured_in = self.given.sources if self.given.is_timed else ()
        arrivals = locate_receivers(self.given.arrivals[edge])
        return Timing(arrivals, located, self.given.directions, is_first, measured_in)

    def _same(self, series: Series, checksum: str) -> Outcome | None:
        same = self.catalogue.find_solution(self.given.burst.burst_id, series, checksum, bella.__version__)
        if same is None:
            return None
        log.info("nothing new", solution_id=same.solution_id, edge=series.edge, preset=series.preset)
        return Outcome(same, new=False, track=self.catalogue.track_fit(same.solution_id))

    def _published(self, series: Series, checksum: str, posterior: xr.Dataset, track: dict[str, Any]) -> Outcome:
        given = self.given
        if given.burst.spectra_path is None and given.spectra is not None:
            path = store_spectra(given.spectra, given.burst, self.catalogue, self.settings)
            given = replace(given, burst=replace(given.burst, spectra_path=path))
            self.begun = replace(self.begun, given=given)
        sources = (*given.sources, *self.begun.around.sources())
        draft = Draft(given.burst, series, checksum, posterior, track, sources)
        solution = publish(draft, self.catalogue, self.settings, self.lease)
        came = given.received
        times = SolutionTimes(
            given.burst.end_utc,
            came.seen_utc,
            came.fetched_utc,
            self.begun.begun_utc,
            datetime.now(UTC),
            given.origin,
        )
        self.catalogue.operation.record_times(solution.solution_id, times)
        log.info("published", solution_id=solution.solution_id, edge=series.edge, preset=series.preset)
        return Outcome(solution, new=True, track=track)


def _posterior(arrivals: pd.DataFrame, burst_id: str, series: Series, settings: Settings) -> xr.Dataset:
    """Posterior of the source at every frequency."""
    posterior = localise(
        arrivals,
        preset=series.preset,
        method=series.method,
        dimensions=series.dimensions,
        draws=settings.draws,
        seed=settings.seed,
        advance=counter(f"localise {series.edge}", arrivals["frequency_mhz"].nunique()),
    )
    return posterior.assign_attrs(burst_id=burst_id)


def _grid(timing: Timing, series: Series) -> ArrivalGrid:
    """Arrival times of two spacecraft, as a preliminary fit takes them."""
    table = timing.arrivals if timing.channels is None else timing.channels
    return apply_sigma_rule(arrival_grid(table, received_by=1), find_preset(series.preset))


def circle_dataset(joint: JointTrack, burst_id: str, edge: str) -> xr.Dataset:
    """Posterior of the longitude of a preliminary track, for the store.

    Parameters
    ----------
    joint : JointTrack
        Of tier "preliminary".

    Returns
    -------
    xarray.Dataset
        ``probability`` (longitude) of equal parts of the circle, at their centres.
    """
    number = len(joint.phi0_probability)
    centre = (np.arange(number) + 0.5) * 360.0 / number - 180.0
    return xr.Dataset(
        {"probability": ("longitude", np.array(joint.phi0_probability), {"units": "1"})},
        {"longitude": ("longitude", centre, {"units": "deg", "long_name": "HEE longitude of the spiral at 1 R_sun"})},
        {
            "tier": joint.tier,
            "burst_id": burst_id,
            "edge": edge,
            "model": joint.model,
            "frame": "HEE",
            "reference_time": joint.epoch_utc,
            "comment": APPARENT_SOURCE,
        },
    )


def preliminary_level(catalogue: Catalogue, burst_id: str, track: Track) -> PreliminaryLevel | None:
    """Where a final longitude is in the preliminary posterior of the same burst.

    Parameters
    ----------
    track : Track
        The final one.

    Returns
    -------
    PreliminaryLevel or None
        None where there was no preliminary track, or the final one has no longitude.
    """
    longitude = track.joint.phi0_deg.q50
    earlier = [one for one in _versions(catalogue, burst_id) if one.answer.tier == PRELIMINARY]
    if longitude is None or not earlier:
        return None
    last = max(earlier, key=lambda one: one.version)
    known = read_track(catalogue.track_fit(last.solution_id))
    if known is None:
        return None
    return PreliminaryLevel(solution_id=last.solution_id, phi0_deg=longitude, level=level_of(known.joint, longitude))


def _versions(catalogue: Catalogue, burst_id: str) -> tuple[Solution, ...]:
    try:
        return catalogue.versions(burst_id)
    except NoDataError:
        return ()


def summary_row(outcome: Outcome) -> dict[str, Any]:
    """One line of the summary table of a run."""
    solution, line = outcome.solution, outcome.track.get("two_step") or {}
    answer = solution.answer
    return {
        "solution": solution.solution_id,
        "new": outcome.new,
        "preferred": solution.preferred,
        "tier": answer.tier,
        "grade": answer.grade,
        "sentence": answer.sentence,
        "phi0_deg": answer.phi0_deg,
        "phi0_68_deg": [answer.phi0_low_deg, answer.phi0_high_deg],
        "v_sw_km_s": answer.v_sw_km_s,
        "v_sw_68_km_s": [answer.v_sw_low_km_s, answer.v_sw_high_km_s],
        "two_step_phi0_deg": line["phi0_deg"]["q50"] if line else None,
        "two_step_v_sw_km_s": None if not line or wind_gap(line) else line["v_sw_km_s"]["q50"],
        "rotation_period_d": outcome.track.get("rotation_period_d"),
        "flags": ", ".join(solution.flags),
    }


def summary_table(outcomes: Sequence[Outcome]) -> list[dict[str, Any]]:
    """Lines of the summary table of a run."""
    return [summary_row(one) for one in outcomes]
