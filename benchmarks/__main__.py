"""Time the exact posterior against PyMC on the same data in the same run, and the whole pipeline."""

import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from rich.console import Console
from rich.table import Table

from bella.arrivals import ArrivalGrid, arrival_grid, locate_receivers
from bella.bursts import published_arrivals
from bella.multilateration.cells import divide
from bella.multilateration.draws import draw
from bella.multilateration.exact import exact_posterior
from bella.multilateration.likelihood import IntArray, Problems, problems_of
from bella.multilateration.moments import moments_of
from bella.multilateration.nuts import sample_frequency
from bella.multilateration.priors import apply_sigma_rule, find_preset
from bella.multilateration.solution import Recipe

DRAWS = 4000
REPEATS = 7
SAMPLED = 5
IMPORTS = {"bella": "500 ms", "bella.cli": "500 ms", "bella.multilateration": ""}


def seconds(work: Callable[[], object], repeats: int = REPEATS) -> float:
    """Median duration of a piece of work after one warm-up, s."""
    work()
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        work()
        times.append(time.perf_counter() - begin)
    return statistics.median(times)


def engines() -> list[tuple[str, str, str]]:
    """Exact posterior and PyMC on the frequencies of the built-in burst."""
    preset = find_preset("bella-2024")
    grid = apply_sigma_rule(arrival_grid(locate_receivers(published_arrivals())), preset)
    some = grid.take(_every(grid, SAMPLED))
    exact = Recipe("posterior", preset, 2, DRAWS, 1)
    burst_s = seconds(lambda: exact_posterior(grid, exact, lambda _: None))
    problems = problems_of(some, preset.priors, 2)
    drawn_s = seconds(lambda: _moments_and_draws(problems)) / SAMPLED
    sampler = Recipe("nuts", preset, 2, DRAWS, 1)
    begin = time.perf_counter()
    sample_frequency(some, 0, sampler)
    first_s = time.perf_counter() - begin
    sampled_s = seconds(lambda: [sample_frequency(some, row, sampler) for row in range(SAMPLED)]) / SAMPLED
    return [
        ("exact posterior with 4000 draws, per frequency", _ms(drawn_s), "3 ms"),
        ("the same with regions and modes, per frequency of a burst", _ms(burst_s / 200), ""),
        ("burst of 200 frequencies, everything", f"{burst_s:.2f} s", "1 s"),
        ("PyMC with nutpie, 4000 draws, two cores; per frequency", _ms(sampled_s), ""),
        ("the same with its compilation, once per process", f"{first_s:.1f} s", ""),
        ("ratio PyMC / exact, draws alone", f"{sampled_s / drawn_s:.0f}", ""),
    ]


def _every(grid: ArrivalGrid, number: int) -> IntArray:
    """Indices of frequencies spread evenly over those of a grid."""
    return np.linspace(0, grid.frequency_mhz.size - 1, number).astype(np.intp)


def _moments_and_draws(problems: Problems) -> None:
    cells = divide(problems)
    moments_of(problems, cells)
    draw(problems, cells, DRAWS, np.random.default_rng(1))


def commands() -> list[tuple[str, str, str]]:
    """Whole commands as a user starts them."""
    bella = str(Path(sys.executable).with_name("bella"))
    with tempfile.TemporaryDirectory() as home:
        first_s = _run([bella, "run", "--home", home])
        warm_s = statistics.median(_run([bella, "run", "--home", home]) for _ in range(3))
    timed = "import time; begin = time.perf_counter(); import {}; print(time.perf_counter() - begin)"
    import_s = {name: _printed(timed.format(name)) for name in IMPORTS}
    return [
        ("bella run, first time in a new home", f"{first_s:.1f} s", ""),
        ("bella run, warm", f"{warm_s:.1f} s", "60 s"),
        *((f"import {name}", f"{import_s[name] * 1e3:.0f} ms", target) for name, target in IMPORTS.items()),
    ]


def _printed(code: str) -> float:
    """Median of the number that a fresh interpreter prints."""
    command = [sys.executable, "-c", code]
    return statistics.median(
        float(subprocess.run(command, check=True, capture_output=True, text=True).stdout) for _ in range(5)
    )


def _run(command: list[str]) -> float:
    begin = time.perf_counter()
    subprocess.run(command, check=True, capture_output=True)
    return time.perf_counter() - begin


def _ms(duration_s: float) -> str:
    return f"{duration_s * 1e3:.2f} ms"


def main() -> None:
    """Print the table."""
    table = Table(title=f"Python {platform.python_version()}, {os.cpu_count()} cores, {platform.machine()}")
    for name in ("what", "measured", "target"):
        table.add_column(name, justify="left" if name == "what" else "right")
    for row in (*engines(), *commands()):
        table.add_row(*row)
    Console(width=100).print(table)


if __name__ == "__main__":
    main()
