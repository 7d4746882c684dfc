"""Time the exact posterior against PyMC on the same data in the same run, and the whole pipeline."""

import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from rich.console import Console
from rich.table import Table

from benchmarks import day, detection, edges, history, solar_wind, spectra, tracks
from benchmarks.localisation import engines

IMPORTS = {"bella": "500 ms", "bella.cli": "500 ms", "bella.multilateration": ""}


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


def main() -> None:
    """Print the table."""
    table = Table(title=f"Python {platform.python_version()}, {os.cpu_count()} cores, {platform.machine()}")
    for name in ("what", "measured", "target"):
        table.add_column(name, justify="left" if name == "what" else "right")
    rooms = (spectra, edges, detection, solar_wind, day)
    measured = (row for room in rooms for row in room.rows())
    rows = [*engines(), *tracks.engines(), *measured, *commands()]
    for row in rows:
        table.add_row(*row)
    Console(width=100).print(table)
    for line in history.note(rows):
        print(line)


if __name__ == "__main__":
    main()
