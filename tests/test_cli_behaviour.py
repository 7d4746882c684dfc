"""How every command behaves: what is printed last, what is quiet, what is refused before anything starts."""

import json
import math
import os
import re
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from api import serve as server
from bella.catalogue import Catalogue
from bella.cli import app
from bella.cli.options import delay_option
from bella.exceptions import BusyError, InputError
from bella.pipeline.workers import prepare
from bella.settings import Settings
from bella.spacecraft import position_hee
from bella.units import C_RSUN_S
from flows import serve as worker
from tests.api.published import settings_of

SOURCE_RSUN = np.array([30.0, 40.0, 0.0])
START = np.datetime64("2012-06-07T19:30:00", "ms")


@pytest.fixture
def table(tmp_path: Path) -> Path:
    """Arrival times of a source at 53 degrees west, as light takes them."""
    rows = ["observatory,frequency_mhz,arrival_utc,sigma_s,edge"]
    for name in ("WIND", "STEREO-A", "STEREO-B"):
        apart_rsun = np.linalg.norm(position_hee(name, np.array([START]), START)[0] - SOURCE_RSUN)
        arrival = START + np.timedelta64(round(1000 * apart_rsun / C_RSUN_S), "ms")
        rows += [f"{name},{mhz},{arrival}Z,5,peak" for mhz in (0.5, 0.6)]
    path = tmp_path / "arrivals.csv"
    path.write_text("\n".join(rows) + "\n")
    return path


def localised(table: Path, *more: str) -> str:
    output = table.with_name("places.csv")
    done = CliRunner().invoke(app, ["localise", str(table), "--output", str(output), "--kappa", "none", *more])
    assert done.exit_code == 0, done.output
    return done.stdout


def test_localise_ends_with_where_the_source_was_west_positive(table: Path) -> None:
    text = localised(table)
    found = pd.read_csv(table.with_name("places.csv"), comment="#").set_index("frequency_mhz").loc[0.6]
    distance, longitude = (
        math.hypot(found["x_rsun"], found["y_rsun"]),
        math.degrees(math.atan2(found["y_rsun"], found["x_rsun"])),
    )
    assert longitude == pytest.approx(53.13, abs=3.0), "the source of the table"
    last = text.splitlines()[-1]
    assert f"from {distance:.0f} R_sun and longitude {longitude:.0f}" in last
    assert re.search(rf"0\.600 +{distance:.1f} +\+{longitude:.1f}", text)


def test_quiet_prints_the_answer_alone(table: Path) -> None:
    whole = localised(table).splitlines()
    assert len(whole) > 4
    assert localised(table, "--quiet").splitlines() == [whole[-1]]
    assert localised(table).splitlines() == whole, "the next command is not quiet"


def test_json_of_localise_has_all_that_the_file_has(table: Path) -> None:
    said = json.loads(localised(table, "--json"))
    rows = said["localisations"]
    written = pd.read_csv(table.with_name("places.csv"), comment="#")
    assert set(written.columns) <= {*rows[0], *said["header"]}
    assert [row["x_rsun"] for row in rows] == pytest.approx(written["x_rsun"].tolist(), abs=1e-3)


def test_a_port_in_use_is_named_before_anything_starts(tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        done = CliRunner().invoke(app, ["serve", "--port", str(port), "--home", str(tmp_path / "home")])
    assert isinstance(done.exception, BusyError)
    assert str(done.exception) == f"port {port} of 127.0.0.1 is used by another program; name another --port"
    assert not (tmp_path / "home").exists()


@pytest.mark.parametrize(
    "main",
    [lambda: CliRunner().invoke(app, ["serve"], catch_exceptions=False), worker.main, lambda: prepare(Settings())],
)
def test_a_home_that_is_no_folder_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, main: Callable[[], object]
) -> None:
    (tmp_path / "home").write_text("")
    monkeypatch.setenv("BELLA_HOME", str(tmp_path / "home"))
    with pytest.raises(InputError, match=rf"^folder {tmp_path}/home.*; repair it, or name another home"):
        main()


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [("BELLA_LEASE_S", "-1", "greater than 0"), ("BELLA_DATABASE_URL", "foo", "not the URL of a database")],
)
def test_the_server_starts_with_no_setting_that_is_wrong(
    monkeypatch: pytest.MonkeyPatch, name: str, value: str, words: str
) -> None:
    monkeypatch.setenv(name, value)
    with pytest.raises(InputError, match=f"^{name} is .*{words}"):
        server.main([])


def test_the_server_is_refused_a_port_that_there_is_not(capsys: pytest.CaptureFixture[str]) -> None:
    for port in ("0", "65536", "x"):
        with pytest.raises(SystemExit):
            server.main(["--port", port])
        assert f"argument --port: invalid port value: '{port}'" in capsys.readouterr().err


def test_a_reader_who_leaves_is_no_failure() -> None:
    reading, writing = os.pipe()
    os.close(reading)
    try:
        done = subprocess.run(
            [sys.executable, "-m", "bella.cli", "formats"], stdout=writing, stderr=subprocess.PIPE, check=False
        )
    finally:
        os.close(writing)
    assert (done.returncode, done.stderr) == (0, b"")


def test_status_has_how_long_each_run_took(tmp_path: Path) -> None:
    settings = settings_of(tmp_path / "home")
    settings.home.mkdir(parents=True, exist_ok=True)
    with (
        Catalogue.open(settings.catalogue_url, create=True) as catalogue,
        catalogue.lease("days", "2012-06-07", "run", 60.0),
    ):
        pass
    text = CliRunner().invoke(app, ["status", "--json", "--home", str(settings.home)]).stdout
    (run,) = json.loads(text)["runs"]
    assert (run["stage"], run["subject"], run["started_utc"][-1]) == ("days", "2012-06-07", "Z")
    assert run["duration_s"] >= 0


@pytest.mark.parametrize("text", ["2.1,0.1", "-2.1,0.1", "0.1,2.1", "0.1,-0.1", "nan,0.1", "0.1"])
def test_delays_of_another_unit_are_refused(text: str) -> None:
    with pytest.raises(InputError, match="--kappa"):
        delay_option(text)
