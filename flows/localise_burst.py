"""Localise one burst with every definition of its edge, publish the solutions, draw the figures."""

from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import pandas as pd
import structlog
import xarray as xr
from prefect import flow, task
from prefect.artifacts import create_table_artifact
from prefect.cache_policies import NO_CACHE
from prefect.client.schemas.objects import State, TaskRun
from prefect.runtime import flow_run
from prefect.tasks import Task

import bella
from bella.answer import wind_gap
from bella.arrivals import locate_receivers
from bella.bursts.event import EVENT
from bella.catalogue import Catalogue, Lease, Series, Solution, edge_rank
from bella.exceptions import BellaError
from bella.multilateration import localise
from bella.plotting import (
    TrackView,
    edge_name,
    write_constellation_png,
    write_density_png,
    write_polar_fit_png,
    write_spectra_png,
)
from bella.settings import FIT_FIGURES, WIND_FIGURE, Settings
from bella.store import open_group, sweep
from flows.inputs import BurstInput, load_burst
from flows.progress import counter
from flows.publication import Draft, inputs_hash, publish, store_spectra
from flows.solar_wind import Surroundings, draw_wind, has_wind, surroundings_of
from flows.tracks import Timing, fitted_track

log = structlog.get_logger(__name__)

STAGE = "localise"
P = ParamSpec("P")
R = TypeVar("R")


@dataclass(frozen=True)
class Choice:
    """How a burst is localised."""

    method: str
    preset: str
    dimensions: int


@dataclass(frozen=True)
class Outcome:
    """What a run has to say about one solution."""

    solution: Solution
    new: bool
    track: dict[str, Any]


def run_name() -> str:
    """Name of the run of the flow, under which it holds leases and logs."""
    return str(flow_run.get_id() or "local")


def is_retriable(_task: Task[..., Any], _run: TaskRun, state: State[Any]) -> bool:
    """Try again only where the class of the error says that trying again can help."""
    error = state.result(raise_on_failure=False, _sync=True)  # type: ignore[call-overload]
    return isinstance(error, BellaError) and error.retriable


def coarse(name: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Declare a task that retries what is retriable, and whose arguments and results stay in memory."""
    declare: Callable[[Callable[P, R]], Callable[P, R]] = task(
        name=name, retries=2, retry_delay_seconds=[5, 30], retry_condition_fn=is_retriable, cache_policy=NO_CACHE
    )
    return declare


@coarse("load")
def load(subject: str, settings: Settings) -> BurstInput:
    """Load a burst: the built-in event by its date, or a table that was handed in by its checksum."""
    return load_burst(subject, settings.incoming_root)


@coarse("arrivals")
def place(arrivals: pd.DataFrame) -> pd.DataFrame:
    """Put the position of its receiver beside every arrival time."""
    return locate_receivers(arrivals)


@coarse("localise")
def solve(arrivals: pd.DataFrame, burst_id: str, series: Series, settings: Settings) -> xr.Dataset:
    """Compute the posterior of every frequency."""
    total = arrivals["frequency_mhz"].nunique()
    posterior = localise(
        arrivals,
        preset=series.preset,
        method=series.method,
        dimensions=series.dimensions,
        draws=settings.draws,
        seed=settings.seed,
        advance=counter(f"localise {edge_name(series.edge)}", total),
    )
    return posterior.assign_attrs(burst_id=burst_id)


@coarse("fit")
def fit(
    posterior: xr.Dataset, timing: Timing, series: Series, settings: Settings, around: Surroundings
) -> tuple[dict[str, Any], xr.Dataset]:
    """Fit the spiral of the field line to the track, by every method."""
    return fitted_track(posterior, timing, series, settings, around)


@coarse("publish")
def record(draft: Draft, settings: Settings) -> Solution:
    """Make the solution visible in store and catalogue."""
    with closing(Catalogue.open(settings.catalogue_url)) as catalogue:
        return publish(draft, catalogue, settings)


@coarse("figures")
def draw(given: BurstInput, outcomes: list[Outcome], settings: Settings, around: Surroundings) -> None:
    """Draw the constellation, the fits of each solution and, where there are any, its wind and the spectra."""
    constellation, *others = figure_paths(given, outcomes, settings)
    views = [
        TrackView(
            edge_name(outcome.solution.series.edge),
            open_group(settings.store_root, outcome.solution.store_path),
            outcome.track,
        )
        for outcome in outcomes
    ]
    advance = counter("figures", 1 + len(others))
    write_constellation_png(constellation, views)
    advance(1)
    for outcome, view in zip(outcomes, views, strict=True):
        polar_fit, density = fit_figures(outcome.solution, settings)
        write_polar_fit_png(polar_fit, view.posterior, view.track_fit | view.track_fit.get("companions", {}))
        write_density_png(density, view.posterior)
        if has_wind(view.track_fit):
            draw_wind(wind_figure(outcome.solution, settings), view.posterior, view.track_fit, around)
        advance(2 + has_wind(view.track_fit))
    if given.spectra is not None:
        named = {edge_name(edge): table for edge, table in given.channel_edges.items()}
        write_spectra_png(others[-1], given.spectra, named)
        advance(1)


def figure_paths(given: BurstInput, outcomes: list[Outcome], settings: Settings) -> list[Path]:
    """Files of the figures of a run; each method and preset has a constellation of its own, the spectra are last."""
    series, folder = outcomes[0].solution.series, settings.figures_root / given.burst.burst_id
    constellation = folder / f"constellation-{series.method}-{series.preset}.png"
    fits = [path for outcome in outcomes for path in fit_figures(outcome.solution, settings)]
    fits += [wind_figure(one.solution, settings) for one in outcomes if has_wind(one.track)]
    return [constellation, *fits, *([folder / "spectra.png"] if given.spectra is not None else [])]


def fit_figures(solution: Solution, settings: Settings) -> list[Path]:
    """Files of the figures of one solution, in the order of their names in `Settings`."""
    return [settings.fit_figure(solution.burst_id, solution.solution_id, name) for name in FIT_FIGURES]


def wind_figure(solution: Solution, settings: Settings) -> Path:
    """File of the map of the wind of one solution, which is drawn where the wind was measured."""
    return settings.fit_figure(solution.burst_id, solution.solution_id, WIND_FIGURE)


def is_drawn(figure: Path, outcomes: list[Outcome]) -> bool:
    """Tell whether a figure was drawn after the solutions it shows; not so where a run was killed before it drew."""
    newest = max(outcome.solution.created_utc for outcome in outcomes)
    return figure.is_file() and figure.stat().st_mtime >= newest.timestamp()


@flow(name="localise-burst", validate_parameters=False)
def localise_burst(
    subject: str = EVENT.name, preset: str = "default", method: str = "posterior", dimensions: int = 2
) -> list[Outcome]:
    """Localise one burst with every definition of its edge, and publish what is new.

    Parameters
    ----------
    subject : str
        Date of the built-in event, or checksum of an arrival table that was handed in.
    preset, method : str
        Names of `bella.multilateration.PRESETS` and `METHODS`.
    dimensions : int

    Returns
    -------
    list of Outcome
        One per definition of the edge.

    Raises
    ------
    BellaError
        What went wrong, in one line.
    """
    settings = Settings()
    run_id = run_name()
    with (
        structlog.contextvars.bound_contextvars(run_id=run_id, subject=subject),
        closing(Catalogue.open(settings.catalogue_url, create=True)) as catalogue,
        catalogue.lease(STAGE, subject, run_id, settings.lease_s) as lease,
    ):
        sweep(settings.store_root, catalogue.referenced_paths(), settings.lease_s)
        given = load(subject, settings)
        return localise_given(given, Choice(method, preset, dimensions), catalogue, settings, lease)


def localise_given(
    given: BurstInput, choice: Choice, catalogue: Catalogue, settings: Settings, lease: Lease
) -> list[Outcome]:
    """Localise a burst with every definition of its edge, publish what is new, and draw it.

    Parameters
    ----------
    given : BurstInput
    choice : Choice
    catalogue : Catalogue
    settings : Settings
    lease : Lease
        Held on the burst or its subject; it is renewed before each solution.

    Returns
    -------
    list of Outcome
        One per definition of the edge.

    Raises
    ------
    BellaError
        What went wrong, in one line.
    """
    spectra_path = store_spectra(given.spectra, given.burst, catalogue, settings)
    around = surroundings_of(given.burst.start_utc, settings)
    burst = replace(given.burst, spectra_path=spectra_path)
    given = replace(given, burst=burst, sources=(*given.sources, *around.sources()))
    outcomes = []
    # the edge that the rule prefers comes first: what is published after it leaves the choice as it is
    for edge in sorted(given.arrivals, key=edge_rank):
        lease.renew(settings.lease_s)
        series = Series(edge, choice.method, choice.preset, choice.dimensions)
        outcomes.append(_outcome(given, series, catalogue, settings, around))
    if not all(is_drawn(figure, outcomes) for figure in figure_paths(given, outcomes, settings)):
        draw(given, outcomes, settings, around)
    # a later one of these may have become the preferred solution
    outcomes = [replace(one, solution=catalogue.solution(one.solution.solution_id)) for one in outcomes]
    create_table_artifact(key=given.burst.burst_id.lower(), table=[summary_row(one) for one in outcomes])
    return outcomes


def _outcome(
    given: BurstInput, series: Series, catalogue: Catalogue, settings: Settings, around: Surroundings
) -> Outcome:
    """Solution of one series: the one that is there if its inputs are the same, else a new version."""
    arrivals = place(given.arrivals[series.edge])
    channels = given.channel_arrivals.get(series.edge)
    is_first = series.edge == next(iter(given.arrivals))
    timing = Timing(arrivals, None if channels is None else place(channels), given.directions, is_first)
    checksum = inputs_hash(timing, given.sources, series, settings)
    bound = log.bind(burst_id=given.burst.burst_id, edge=series.edge, preset=series.preset)
    same = catalogue.find_solution(given.burst.burst_id, series, checksum, bella.__version__)
    if same is not None:
        bound.info("nothing new", solution_id=same.solution_id)
        return Outcome(same, new=False, track=catalogue.track_fit(same.solution_id))
    posterior = solve(arrivals, given.burst.burst_id, series, settings)
    track, posterior = fit(posterior, timing, series, settings, around)
    if given.published_track:
        track["published"] = dict(given.published_track)
    solution = record(Draft(given.burst, series, checksum, posterior, track, given.sources), settings)
    bound.info("published", solution_id=solution.solution_id)
    return Outcome(solution, new=True, track=track)


def summary_row(outcome: Outcome) -> dict[str, Any]:
    """One line of the summary table of a run."""
    solution, line = outcome.solution, outcome.track["two_step"]
    answer = solution.answer
    return {
        "solution": solution.solution_id,
        "new": outcome.new,
        "preferred": solution.preferred,
        "grade": answer.grade,
        "sentence": answer.sentence,
        "phi0_deg": answer.phi0_deg,
        "phi0_68_deg": [answer.phi0_low_deg, answer.phi0_high_deg],
        "v_sw_km_s": answer.v_sw_km_s,
        "v_sw_68_km_s": [answer.v_sw_low_km_s, answer.v_sw_high_km_s],
        "two_step_phi0_deg": line["phi0_deg"]["q50"],
        "two_step_v_sw_km_s": None if wind_gap(line) else line["v_sw_km_s"]["q50"],
        "rotation_period_d": line["rotation_period_d"],
        "flags": ", ".join(solution.flags),
    }
