"""Time the exact posterior against PyMC on the same data in the same run, in the plane, in space, and as a map."""

import statistics
import time
from collections.abc import Callable
from contextlib import suppress

import numpy as np

from bella.arrivals import ArrivalGrid, arrival_grid, locate_receivers
from bella.bursts import published_arrivals
from bella.exceptions import ConvergenceError
from bella.multilateration import uncertainty_map
from bella.multilateration.cells import divide
from bella.multilateration.nuts import sample_frequency
from bella.multilateration.posterior import BATCH, Recipe, draw, exact_posterior, moments_of
from bella.multilateration.priors import Preset, Priors, apply_sigma_rule, find_preset
from bella.multilateration.problems import IntArray, Problems, problems_of
from bella.multilateration.tdoa import tdoa_posterior
from bella.units import AU_RSUN, C_RSUN_S

Row = tuple[str, str, str]

DRAWS = 4000
REPEATS = 7
HUNDRED = 100
SAMPLED = 5
FAR_APART = 116.0


def seconds(
    work: Callable[[], object], repeats: int = REPEATS, clock: Callable[[], float] = time.process_time
) -> float:
    """Median CPU time of a piece of work after one warm-up, s: what else runs on the machine counts little."""
    work()
    times = []
    for _ in range(repeats):
        begin = clock()
        work()
        times.append(clock() - begin)
    return statistics.median(times)


def in_the_plane() -> list[Row]:
    """Exact posterior and PyMC on the frequencies of the built-in burst."""
    rows = []
    for name, target in (("bella-2024", "2 ms"), ("paper", "5 ms")):
        preset = find_preset(name)
        grid = apply_sigma_rule(arrival_grid(locate_receivers(published_arrivals())), preset)
        some = grid.take(every(grid, BATCH[2]))
        problems = problems_of(some, preset.priors, 2, preset.noise, preset.delay)
        moments_s = seconds(lambda problems=problems: moments_of(problems, divide(problems))) / BATCH[2]
        drawn_s = seconds(lambda problems=problems: moments_and_draws(problems)) / BATCH[2]
        sampled_s, first_s = sampled(some, preset)
        speed = f"speed {preset.priors.v_sd_c:g} c"
        rows += [
            (f"{speed}: moments and evidence, per frequency", ms(moments_s), "1 ms"),
            (f"{speed}: the same with {DRAWS} draws", ms(drawn_s), target),
            (f"{speed}: PyMC with nutpie, {DRAWS} draws, two cores", ms(sampled_s), ""),
            (f"{speed}: its compilation, once per process", f"{first_s:.1f} s", ""),
            (f"{speed}: ratio PyMC / exact", f"{sampled_s / drawn_s:.0f}", ""),
        ]
    return rows


SHARP_S = {"3 s": (3.0, 3.0, 3.0), "9 s": (9.0, 9.0, 9.0), "5, 120 and 5 s": (5.0, 120.0, 5.0)}
"""Timing errors of the three receivers in the rows that have a directional delay."""


def with_a_delay() -> list[Row]:
    """Everything a solution holds of a frequency, with correlated errors and a directional delay, beside PyMC."""
    preset = find_preset("default")
    distance_rsun = np.linspace(15, 150, 25)
    angle = np.radians(30 - 0.28 * distance_rsun)
    source = distance_rsun[:, None] * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    receivers, rows = fleet(FAR_APART), []
    for name, sigma_s in SHARP_S.items():
        shape = (distance_rsun.size, len(receivers))
        measured = np.zeros((*shape, *shape))
        place = np.arange(shape[0])
        measured[place, :, place] = np.outer(sigma_s, sigma_s) * (0.8 * np.eye(3) + 0.2)
        grid = ArrivalGrid(
            60 / distance_rsun[::-1],
            ("A", "B", "C"),
            np.linalg.norm(source[::-1, None] - receivers, axis=2) / C_RSUN_S,
            np.broadcast_to(sigma_s, shape),
            np.broadcast_to(receivers, (*shape, 3)),
            np.datetime64("2012-06-07T19:00:00", "ns"),
            "none",
            measured_s2=measured,
        )
        recipe = Recipe("posterior", preset, 2, DRAWS, 1)
        exact_s = seconds(lambda grid=grid, recipe=recipe: exact_posterior(grid, recipe, lambda _: None)) / shape[0]
        problems = problems_of(grid, preset.priors, 2, preset.noise, preset.delay)
        hundred = problems.at(np.arange(HUNDRED) % shape[0])
        moments_s = seconds(lambda problems=hundred: moments_of(problems, divide(problems)))
        cells = divide(problems)
        draws_s = seconds(lambda: draw(problems, cells, DRAWS, np.random.default_rng(1))) / shape[0]  # noqa: B023
        rows += [
            (f"errors of {name}, delay: draws, regions, modes", ms(exact_s), "5 ms" if "120" in name else "3 ms"),
            (f"errors of {name}, delay: moments of 100 frequencies", ms(moments_s), "10 ms"),
            (f"errors of {name}, delay: {DRAWS} draws alone", ms(draws_s), "1 ms"),
        ]
        if "120" not in name:
            sampled_s, _ = sampled(grid, preset)
            rows.append((f"errors of {name}, delay: ratio PyMC / exact", f"{sampled_s / exact_s:.0f}", ""))
    return rows


def whole_bursts() -> list[Row]:
    """Everything a solution holds, for a burst of 100 and of 200 frequencies, and by time differences."""
    preset = find_preset("bella-2024")
    grid = apply_sigma_rule(arrival_grid(locate_receivers(published_arrivals())), preset)
    exact, tdoa = (Recipe(name, preset, 2, DRAWS, 1) for name in ("posterior", "tdoa"))
    hundred = grid.take(every(grid, 100))
    hundred_s = seconds(lambda: exact_posterior(hundred, exact, lambda _: None))
    burst_s = seconds(lambda: exact_posterior(grid, exact, lambda _: None))
    tdoa_s = seconds(lambda: tdoa_posterior(grid, tdoa, lambda _: None))
    normals_s = seconds(lambda: np.random.default_rng(1).standard_normal((4, DRAWS)))
    return [
        ("burst of 100 frequencies: draws, regions, modes", f"{hundred_s:.2f} s", "0.3 s"),
        ("burst of 200 frequencies: draws, regions, modes", f"{burst_s:.2f} s", "1 s"),
        ("the same by time differences", f"{tdoa_s:.2f} s", ""),
        (f"{4 * DRAWS} normal deviates, the floor of drawing", ms(normals_s), ""),
    ]


def in_space() -> list[Row]:
    """A source anywhere, four receivers, one of them 30 degrees out of the ecliptic plane."""
    receivers = np.vstack([fleet(FAR_APART), AU_RSUN * np.array([0.33, 0.28, 0.25])])
    distance = np.linalg.norm(np.array([73.8, 13.5, 10.0]) - receivers, axis=1)
    grid = ArrivalGrid(
        np.ones(1),
        ("A", "B", "C", "D"),
        distance[None] / C_RSUN_S,
        np.array([[60.0, 38.0, 38.0, 16.0]]),
        receivers[None],
        np.datetime64("2012-06-07T19:00:00", "ns"),
        "none",
    )
    problems = problems_of(grid, Priors(), 3)
    exact_s = seconds(lambda: moments_and_draws(problems))
    sampled_s, _ = sampled(grid, find_preset("default"), 3)
    return [
        (f"in space, {DRAWS} draws", ms(exact_s), "40 ms"),
        ("in space: ratio PyMC / exact", f"{sampled_s / exact_s:.0f}", ""),
    ]


def maps() -> list[Row]:
    """Uncertainty map of 500 x 500 nodes."""
    receivers = dict(zip("ABC", fleet(FAR_APART), strict=True))

    def _map(*, exact: bool) -> object:
        return uncertainty_map(receivers, 38.0, Priors(), size=500, exact=exact)

    # the exact map is the work of two processes
    closed_s, exact_s = (seconds(lambda kind=kind: _map(exact=kind), 1, time.perf_counter) for kind in (False, True))
    return [
        ("map of 500 x 500, closed form, with its check on 41 x 41 exact nodes", f"{closed_s:.1f} s", ""),
        ("map of 500 x 500, exact, two cores", f"{exact_s:.0f} s", "30 s"),
    ]


def fleet(separation_deg: float) -> np.ndarray:
    """Three receivers at 1 au, at 0 and +- a separation."""
    angle = np.radians([0.0, separation_deg, -separation_deg])
    return AU_RSUN * np.stack([np.cos(angle), np.sin(angle), np.zeros(3)], axis=1)


def _sample(grid: ArrivalGrid, row: int, recipe: Recipe) -> None:
    """Sample one frequency; chains that disagree have cost their time all the same."""
    with suppress(ConvergenceError):
        sample_frequency(grid, row, recipe)


def sampled(grid: ArrivalGrid, preset: Preset, dimensions: int = 2) -> tuple[float, float]:
    """Duration of sampling one frequency with PyMC once it is compiled, and with its compilation, s."""
    some = grid.take(every(grid, min(SAMPLED, grid.frequency_mhz.size)))
    recipe = Recipe("nuts", preset, dimensions, DRAWS, 1)
    begin = time.process_time()
    _sample(some, 0, recipe)
    first_s = time.process_time() - begin
    rows = range(some.frequency_mhz.size)
    return seconds(lambda: [_sample(some, row, recipe) for row in rows], 3) / len(rows), first_s


def every(grid: ArrivalGrid, number: int) -> IntArray:
    """Indices of frequencies spread evenly over those of a grid."""
    return np.linspace(0, grid.frequency_mhz.size - 1, number).astype(np.intp)


def moments_and_draws(problems: Problems) -> None:
    """The posterior of each problem, and draws from it."""
    cells = divide(problems)
    moments_of(problems, cells)
    draw(problems, cells, DRAWS, np.random.default_rng(1))


def ms(duration_s: float) -> str:
    """Duration in ms, for the table."""
    return f"{duration_s * 1e3:.2f} ms"


def engines() -> list[Row]:
    """All rows of the localisation."""
    return [*in_the_plane(), *with_a_delay(), *whole_bursts(), *in_space(), *maps()]
