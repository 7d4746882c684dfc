"""The table that goes on where the packaged one ends, asked from a service on the loopback."""

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from bella.cli import app
from bella.exceptions import InputError, NoDataError, StoreError, UnreachableError
from bella.settings import Settings
from bella.spacecraft import coverage, extend_with, position_hee
from bella.spacecraft.encode import REFERENCE_UTC
from bella.spacecraft.ephemeris import _ecliptic_km, packaged_coverage
from bella.spacecraft.horizons import fetch_orbit, parse_vectors, vectors_query
from bella.spacecraft.update import extend_table
from tests.spacecraft.horizons_server import MOVED, PATH, SIGNATURE, Answer, continued_km, horizons, vectors

RECORDED = (Path(__file__).parent / "horizons_earth.txt").read_text()
START, STOP = (np.datetime64(t, "ns") for t in ("2026-08-16", "2026-11-01"))
LATER = np.datetime64("2026-10-10T05:17", "ns")
NO_MORE = SIGNATURE + 'No ephemeris for target "STEREO-A (spacecraft)" after A.D. {} 00:00:00.0000 TDB\n'


@pytest.fixture(autouse=True)
def _packaged_table_again() -> Iterator[None]:
    yield
    extend_with(None)


def extended(path: Path, answer: Answer, bodies: tuple[str, ...] = ("STEREO-A",)) -> list:
    with horizons(answer) as (url, _):
        return extend_table(path, bodies, STOP, lambda body, start, stop: fetch_orbit(url, body, start, stop))


def command(*arguments: str, home: Path, url: str) -> tuple[int, str]:
    done = CliRunner().invoke(
        app, [*arguments, "--home", str(home)], env={"COLUMNS": "120", "BELLA_HORIZONS_URL": url, "BELLA_HOME": ""}
    )
    return done.exit_code, done.output if done.exception is None else str(done.exception)


def test_an_answer_that_was_written_down_is_where_the_table_has_earth() -> None:
    orbit = parse_vectors(RECORDED, "EARTH")
    utc = REFERENCE_UTC + orbit.time_ms.astype("timedelta64[ms]")

    # TT is 66.184 s ahead of UTC before July 2012, and TDB within 2 ms of TT
    assert abs(utc[0] - np.datetime64("2012-06-05T23:58:53.816")) <= np.timedelta64(2, "ms")
    assert len(utc) == 8
    assert np.linalg.norm(orbit.position_km - _ecliptic_km("EARTH", utc), axis=1).max() < 60.0


def test_the_query_asks_for_geometric_vectors_in_the_ecliptic() -> None:
    with horizons(vectors) as (url, queries):
        fetch_orbit(url, "STEREO-A", START, STOP)

    assert queries == [{name: value.strip("'") for name, value in vectors_query("STEREO-A", START, STOP).items()}]
    assert {
        "COMMAND": "-234",
        "CENTER": "500@10",
        "START_TIME": "2026-08-16 00:00",
        "VEC_CORR": "NONE",
    }.items() <= queries[0].items()


def test_positions_go_on_after_the_end_and_stay_as_they_were_before(tmp_path: Path) -> None:
    end = coverage("STEREO-A").stop
    before = np.arange(end - np.timedelta64(20, "D"), end, np.timedelta64(1, "h"))
    old = position_hee("STEREO-A", before, before[0])

    (outcome,) = extended(tmp_path / "home" / "ephemeris.nc", vectors)
    extend_with(tmp_path / "home" / "ephemeris.nc")

    assert outcome.stop == coverage("STEREO-A").stop > np.datetime64("2026-10-31")
    assert 10 < outcome.nodes < 200
    assert outcome.step_km < 5.0
    np.testing.assert_array_equal(position_hee("STEREO-A", before, before[0]), old)
    after = np.arange(end, outcome.stop, np.timedelta64(7, "h"))
    assert np.linalg.norm(_ecliptic_km("STEREO-A", after) - continued_km("STEREO-A", after), axis=1).max() < 30.0
    assert [path.name for path in (tmp_path / "home").iterdir()] == ["ephemeris.nc"]


def test_the_end_of_the_service_is_taken_where_it_comes_earlier(tmp_path: Path) -> None:
    def ends_in_october(query: dict[str, str]) -> tuple[int, str]:
        return vectors(query) if query["STOP_TIME"] < "2026-10-02" else (200, NO_MORE.format("2026-OCT-01"))

    (outcome,) = extended(tmp_path / "e.nc", ends_in_october)

    assert str(outcome.stop)[:10] == "2026-09-30"


def test_a_body_without_more_is_told_and_the_others_are_written(tmp_path: Path) -> None:
    def no_more_stereo(query: dict[str, str]) -> tuple[int, str]:
        return (200, NO_MORE.format("2026-AUG-17")) if query["COMMAND"] == "-234" else vectors(query)

    stereo, ace = extended(tmp_path / "e.nc", no_more_stereo, ("STEREO-A", "ACE"))

    assert (stereo.nodes, stereo.remark) == (0, "Horizons has STEREO-A only to 2026-08-17: ask again when it has more")
    assert ace.nodes > 0
    with pytest.raises(NoDataError, match="only to 2026-08-17"):
        extended(tmp_path / "e.nc", no_more_stereo)


def test_a_second_update_keeps_the_bodies_of_the_first(tmp_path: Path) -> None:
    extended(tmp_path / "e.nc", vectors)
    extended(tmp_path / "e.nc", vectors, ("ACE",))
    extend_with(tmp_path / "e.nc")

    for body in ("STEREO-A", "ACE"):
        assert coverage(body).stop > LATER > packaged_coverage(body).stop


def test_what_is_known_far_enough_is_not_asked_for(tmp_path: Path) -> None:
    (outcome,) = extended(tmp_path / "e.nc", lambda _: (500, ""), ("PSP",))

    assert outcome.remark == "known that far already"
    assert not (tmp_path / "e.nc").exists()


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        ((503, "busy"), "status 503"),
        ((200, ""), "no table of vectors"),
        ((200, "<html>maintenance</html>"), "no table of vectors"),
        ((200, RECORDED.replace("Ecliptic of J2000.0", "ICRF")), "no table of vectors"),
        ((200, RECORDED.replace("KM-S", "AU-D")), "no table of vectors"),
        ((200, RECORDED.replace("      X,", "     VX,")), "columns JDTDB, X, Y, Z"),
        ((200, RECORDED.replace("2456085.000000000", "n.a.")), "a line is not numbers"),
        ((200, RECORDED.replace("2456085.000000000", "2456099.0")), "not in order of time"),
        ((200, RECORDED.replace("E+07,", "E+17,")), "km from the Sun"),
        ((200, RECORDED[: RECORDED.index("$$EOE")]), "no table of vectors"),
        ((200, RECORDED), "does not reach across"),
    ],
)
def test_an_answer_that_cannot_be_used_leaves_the_table_alone(
    tmp_path: Path, answer: tuple[int, str], message: str
) -> None:
    extended(tmp_path / "e.nc", vectors, ("ACE",))
    before = (tmp_path / "e.nc").read_bytes()

    with pytest.raises(UnreachableError, match=message) as error:
        extended(tmp_path / "e.nc", lambda _: answer)

    assert "\n" not in str(error.value)
    assert (tmp_path / "e.nc").read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["e.nc"]


def test_the_trajectory_of_another_body_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UnreachableError, match=r"STEREO-A is \d+ km from where the packaged ephemeris has it"):
        extended(tmp_path / "e.nc", lambda query: vectors(query | {"COMMAND": "-92"}))


def test_a_body_the_service_does_not_know_is_told() -> None:
    with horizons(lambda _: (200, f"{SIGNATURE}No matches found.\n")) as (url, _), pytest.raises(NoDataError) as error:
        fetch_orbit(url, "PSP", START, STOP)
    assert "Horizons on PSP: No matches found." in str(error.value)


def test_a_service_that_has_moved_is_followed() -> None:
    with horizons(vectors) as (url, queries):
        fetch_orbit(url.replace(PATH, MOVED), "PSP", START, STOP)
    assert len(queries) == 1


def test_an_address_that_is_none_is_refused() -> None:
    with pytest.raises(InputError, match="BELLA_HORIZONS_URL"):
        fetch_orbit("file:///etc/hostname", "PSP", START, STOP)


def test_a_damaged_table_is_told_and_the_next_update_replaces_it(tmp_path: Path) -> None:
    (tmp_path / "e.nc").write_bytes(b"not a table")
    extend_with(tmp_path / "e.nc")
    with pytest.raises(StoreError, match="remove it, then bella update-ephemeris"):
        coverage("STEREO-A")

    extended(tmp_path / "e.nc", vectors)
    extend_with(tmp_path / "e.nc")

    assert coverage("STEREO-A").stop > LATER


def test_the_commands_work_together(tmp_path: Path) -> None:
    with horizons(vectors) as (url, _):
        arguments = ("update-ephemeris", "--until", "2026-11-01", "--bodies", "STEREO-A,ACE", "--json")
        code, text = command(*arguments, home=tmp_path, url=url)
    assert code == 0, text
    assert [row["body"] for row in json.loads(text) if row["nodes"]] == ["STEREO-A", "ACE"]

    code, text = command("ephemeris", "2026-10-10", "--frame", "heeq", "--json", home=tmp_path, url=url)

    rows = {
        row["observatory"]: row for row in json.loads(text[text.index("[\n") :])
    }  # after a remark on standard error
    assert 0.94 * 215.0 < rows["STEREO-A"]["range_rsun"] < 0.97 * 215.1
    assert {row["frame"] for row in rows.values()} == {"heeq"}
    assert Settings(home=tmp_path).ephemeris_extension.is_file()


def test_no_network_and_an_unknown_body_are_one_line(tmp_path: Path) -> None:
    with horizons(vectors) as (url, _):
        pass
    code, text = command("update-ephemeris", home=tmp_path, url=url)
    assert code == 1
    assert text.startswith(f"no answer from {url}")
    assert "check the network" in text

    for name in ("JUICE", "STEREO-B"):
        code, text = command("update-ephemeris", "--bodies", name, home=tmp_path, url=url)
        assert code == 1
        assert text == f"no trajectory of '{name}' to ask for: choose from EARTH, ACE, STEREO-A, PSP, SOLO"
