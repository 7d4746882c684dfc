"""Spectra that lack something, through the command line: an answer that holds the truth, or one line; never a tight
wrong one."""

import json
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner, Result

from bella.bursts.timing import spectrum_edges
from bella.cli import app
from bella.exceptions import BellaError
from bella.simulation.strata import SimulatedCase, isolated_burst
from bella.spectra.background import over_background
from bella.units import within_half_turn_deg

FARTHEST_SIGMAS = 3.5
"""No answer may be so many of its own standard deviations off."""

MEDIAN_SIGMAS = 2.5
FEW = ("--frequencies", "12")
SATURATED = [("clipped", "2021", 0), ("clipped", "2012", 3)]
BAD = [*SATURATED, ("midnight", "2012", 0), ("gaps", "2012", 0), ("low missing", "2021", 0)]


@dataclass(frozen=True)
class Files:
    """A simulated burst as files, one for each spacecraft."""

    case: SimulatedCase
    folder: Path

    def of(self, *names: str) -> list[str]:
        return [str(self.folder / f"{name}.nc") for name in names or self.case.datasets]

    def timed(self, *options: str, names: tuple[str, ...] = ()) -> Path:
        """Arrival table of the burst."""
        table = self.folder / f"{'-'.join([*options, *names])}.csv"
        if not table.exists():
            around = ("--around", str(self.case.around_utc))
            done = bella("arrivals", *self.of(*names), *around, *(options or FEW), "--output", str(table))
            assert done.exit_code == 0, done.output
        return table


def bella(*arguments: str) -> Result:
    return CliRunner().invoke(app, list(arguments), env={"COLUMNS": "200"})


def refused(done: Result) -> str:
    """The one line that a user reads."""
    assert isinstance(done.exception, BellaError), (done.exception, done.output)
    assert done.exception.exit_code in {1, 2}
    message = str(done.exception)
    assert "\n" not in message
    return message


@contextmanager
def files_of(stratum: str, fleet: str, seed: int, factory: pytest.TempPathFactory) -> Iterator[Files]:
    case, folder = isolated_burst(stratum, fleet, seed), factory.mktemp("spectra")
    for name, spectrum in case.spectra.items():
        spectrum.to_netcdf(folder / f"{name}.nc", engine="h5netcdf")
    yield Files(case, folder)


def case_of(case: tuple[str, str, int]) -> Any:
    """The second of two that are alike takes longer than `make test` has time for."""
    marks = [pytest.mark.acceptance] * (case == SATURATED[0])
    return pytest.param(case, id=" ".join(map(str, case)), marks=marks)


@pytest.fixture(scope="module", params=map(case_of, BAD))
def bad(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Files]:
    with files_of(*request.param, tmp_path_factory) as files:
        yield files


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Files]:
    with files_of("midnight", "2012", 0, tmp_path_factory) as files:
        yield files


def assert_places_hold(places: Path, case: SimulatedCase) -> None:
    """The truth is where the regions say, or the rows say that they know nothing."""
    found = pd.read_csv(places, comment="#", keep_default_na=False)
    truth = case.truth(next(iter(case.datasets)), found["frequency_mhz"].to_numpy())
    off = (found[["x_rsun", "y_rsun"]].to_numpy() - truth[["x_rsun", "y_rsun"]].to_numpy())[..., None]
    xx, xy, yy = (found[f"cov_{name}_rsun2"].to_numpy() for name in ("xx", "xy", "yy"))
    covariance = np.stack([np.stack([xx, xy], -1), np.stack([xy, yy], -1)], -2)
    sigmas = np.sqrt((off * np.linalg.solve(covariance, off)).sum(axis=(1, 2)))
    claims = ~found["flags"].str.contains("multimodal|not_constrained;|inconsistent").to_numpy()
    assert not claims.any() or np.median(sigmas[claims]) < MEDIAN_SIGMAS


def assert_track_holds(track: dict[str, Any], case: SimulatedCase) -> None:
    joint = track["joint"]
    median = joint["phi0_deg"]["q50"]
    if median is None or {"not_one_source", "several_tracks"} & set(joint["flags"]):
        return  # regions, or no number to be used
    off = abs(within_half_turn_deg(median - case.burst.phi0_deg))
    assert off < FARTHEST_SIGMAS * 0.5 * (joint["phi0_deg"]["q84"] - joint["phi0_deg"]["q16"])


def test_what_is_answered_holds_the_truth(bad: Files, tmp_path: Path) -> None:
    table, places, track = bad.timed(), tmp_path / "places.csv", tmp_path / "track.json"
    refused = "timing needs 3 or more spacecraft|no source explains the arrival times"
    for command, output in (("fit-track", track), ("localise", places)):
        done = bella(command, str(table), "--output", str(output))
        if done.exit_code:  # a spacecraft has no times where its receiver was cut off in all channels
            assert bad.case.stratum == "clipped", done.exception
            assert re.search(refused, str(done.exception))
    if track.exists():
        assert_track_holds(json.loads(track.read_text()), bad.case)
    if places.exists():
        assert_places_hold(places, bad.case)


@pytest.mark.parametrize("case", SATURATED, ids=lambda one: " ".join(map(str, one)))
def test_saturated_channels_are_named_and_have_no_time(case: tuple[str, str, int]) -> None:
    simulated, cut = isolated_burst(*case), []
    for name, conditions in simulated.drawn.conditions.items():
        spectrum = over_background(simulated.spectra[name])
        found = spectrum_edges(spectrum.sel(frequency=slice(0.25, 1.0)))
        peak = simulated.truth(name, found["frequency_mhz"].to_numpy())["peak_over_background"].to_numpy()
        cut += found["flag"][peak > 1.1 * conditions.clip].tolist()
    assert len(cut) > 5
    assert cut.count("saturated") > 0.9 * len(cut)


def test_a_burst_that_is_all_but_cut_off_by_midnight_is_one_line(tmp_path_factory: pytest.TempPathFactory) -> None:
    with files_of("midnight", "2012", 1, tmp_path_factory) as files:
        output = files.folder / "arrivals.csv"
        done = bella("arrivals", *files.of(), "--around", str(files.case.around_utc), "--output", str(output))
        assert "widen the band or the time" in refused(done)
        assert not output.exists()


@pytest.mark.parametrize("number", [1, 2])
def test_too_few_spacecraft_are_a_line_or_regions(good: Files, tmp_path: Path, number: int) -> None:
    table = good.timed(names=tuple(good.case.datasets)[:number])
    assert "3 or more spacecraft" in refused(bella("localise", str(table), "--output", str(tmp_path / "places.csv")))
    done = bella("fit-track", str(table), "--output", str(tmp_path / "track.json"))
    if number == 1:
        assert "spacecraft" in refused(done)
        return
    track = json.loads((tmp_path / "track.json").read_text())
    assert track["joint"]["tier"] == "preliminary"
    assert_track_holds(track, good.case)


def test_four_frequencies_are_answered_or_refused(good: Files, tmp_path: Path) -> None:
    table, track = good.timed("--frequencies", "4"), tmp_path / "track.json"
    done = bella("fit-track", str(table), "--output", str(track))
    assert done.exit_code == 0, done.output
    assert_track_holds(json.loads(track.read_text()), good.case)


def identical_times(text: pd.DataFrame) -> pd.DataFrame:
    return text.assign(arrival_utc=text["arrival_utc"].iloc[0])


def errors_of_zero(text: pd.DataFrame) -> pd.DataFrame:
    return text.assign(sigma_s=0.0)


def test_identical_times_are_no_track_to_be_used(good: Files, tmp_path: Path) -> None:
    table, track = changed(good, tmp_path, identical_times), tmp_path / "track.json"
    assert bella("fit-track", str(table), "--output", str(track)).exit_code == 0
    joint = json.loads(track.read_text())["joint"]
    assert {"not_one_source", "poor_fit", "beam_speed_unlikely", "clock_offset"} & set(joint["flags"])


@pytest.mark.parametrize("command", ["localise", "fit-track"])
def test_errors_of_zero_are_refused(good: Files, tmp_path: Path, command: str) -> None:
    table = changed(good, tmp_path, errors_of_zero)
    assert "sigma_s" in refused(bella(command, str(table), "--output", str(tmp_path / "out")))


def changed(files: Files, folder: Path, change: Callable[[pd.DataFrame], pd.DataFrame]) -> Path:
    """Arrival table with a change, and its heading as it was."""
    text, table = files.timed().read_text(), folder / "arrivals.csv"
    heading = "".join(line for line in text.splitlines(keepends=True) if line.startswith("#"))
    frame = change(pd.read_csv(StringIO(text), comment="#", keep_default_na=False, dtype=str))
    table.write_text(heading + frame.to_csv(index=False))
    return table
