"""Files years apart in one command, with little memory."""

import os
import resource
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.spectra.written import write_wind_60s

MOST_BYTES = 2500 << 20
"""One array of the minutes of all years would take 4500 MiB."""


def limited() -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MOST_BYTES, MOST_BYTES))


@pytest.fixture
def files(tmp_path: Path) -> list[str]:
    """Two hours of noise each, nineteen years apart."""
    paths = []
    for day in ("1999-06-07", "2018-01-18"):
        utc = np.datetime64(f"{day}T00:00:30", "ns") + np.arange(120) * np.timedelta64(60, "s")
        values = np.random.default_rng(1).gamma(200.0, 1e-17, (120, 64))
        path = tmp_path / f"wi_wa_rad1_l2_60s_{day.replace('-', '')}_v01.dat"
        paths.append(str(write_wind_60s(path, utc, np.linspace(20.0, 1040.0, 64), values, 2)))
    return paths


def bella(*arguments: str) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, "-m", "bella.cli", *arguments]
    one_thread = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    return subprocess.run(command, capture_output=True, text=True, env=one_thread, preexec_fn=limited, check=False)


def test_they_are_searched_in_pieces(files: list[str], tmp_path: Path) -> None:
    done = bella("detect", *files, "--output", str(tmp_path / "d.csv"), "--figures", str(tmp_path / "figures"))

    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "no burst found"
    assert sorted(path.name for path in (tmp_path / "figures").iterdir()) == ["1999-06-07.svg", "2018-01-18.svg"]


def test_edges_are_read_in_the_piece_of_their_time(files: list[str], tmp_path: Path) -> None:
    done = bella("arrivals", *files, "--around", "2018-01-18T01:00", "--output", str(tmp_path / "a.csv"))

    assert done.returncode == 1
    assert "Not used, of 1999-06-07 to 1999-06-07: wi_wa_rad1_l2_60s_19990607_v01.dat" in done.stderr
    assert "no spacecraft shows a burst around 2018-01-18T01:00" in done.stderr
