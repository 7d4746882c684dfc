"""What is not a catalogue of this version is refused with what to do, and left as it was."""

import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import pytest
from alembic.script import ScriptDirectory
from sqlalchemy import create_engine, event, make_url, text

from bella.catalogue import BurstQuery, Catalogue
from bella.catalogue.engine import reading
from bella.catalogue.schema import REVISION_TABLE, migration_config
from bella.exceptions import BellaError, BusyError, InputError, StoreError, UnreachableError
from tests.catalogue.examples import localisation, publication

NEWEST = ScriptDirectory.from_config(migration_config()).get_current_head()


def execute(database_url: str, statement: str) -> None:
    engine = create_engine(database_url)
    with engine.begin() as connection:
        connection.execute(text(statement))
    engine.dispose()


def test_a_new_catalogue_is_empty_and_at_the_newest_revision(database_url: str) -> None:
    with Catalogue.open(database_url, create=True) as catalogue:
        catalogue.ping()
        assert catalogue.revision() == NEWEST
        assert catalogue.bursts(BurstQuery()).bursts == ()


def test_what_was_published_is_there_after_opening_again(database_url: str) -> None:
    with Catalogue.open(database_url, create=True) as catalogue:
        solution = catalogue.publish(publication())
    for create in (True, False):
        with Catalogue.open(database_url, create=create) as catalogue:
            assert catalogue.solution(solution.solution_id) == solution


def test_an_empty_database_is_not_a_catalogue_yet(database_url: str, tmp_path: Path) -> None:
    (tmp_path / "catalogue.sqlite").touch()
    with pytest.raises(StoreError, match="is empty: `bella run` brings it"):
        Catalogue.open(database_url)


def test_a_missing_file_is_not_made_by_reading(sqlite_url: str, tmp_path: Path) -> None:
    with pytest.raises(StoreError, match=r"no catalogue at .*catalogue\.sqlite: `bella run` makes one"):
        Catalogue.open(sqlite_url)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("create", [True, False])
def test_a_file_that_is_not_a_database_is_left_alone(sqlite_url: str, tmp_path: Path, create: bool) -> None:
    file = tmp_path / "catalogue.sqlite"
    file.write_text("observatory,frequency_mhz,arrival_utc\n")
    with pytest.raises(StoreError, match="is not a BELLA catalogue; move it away or set BELLA_DATABASE_URL"):
        Catalogue.open(sqlite_url, create=create)
    assert [path.name for path in tmp_path.iterdir()] == ["catalogue.sqlite"]
    assert file.read_text() == "observatory,frequency_mhz,arrival_utc\n"


@pytest.mark.parametrize("create", [True, False])
def test_the_database_of_something_else_is_left_alone(sqlite_url: str, tmp_path: Path, create: bool) -> None:
    file = tmp_path / "catalogue.sqlite"
    other = sqlite3.connect(file)
    other.execute("CREATE TABLE alembic_version (version_num TEXT)")
    other.commit()
    other.close()
    before = file.read_bytes()
    with pytest.raises(StoreError, match="is not a BELLA catalogue; move it away or set BELLA_DATABASE_URL"):
        Catalogue.open(sqlite_url, create=create)
    assert file.read_bytes() == before


def test_the_server_database_of_something_else_is_left_alone(postgres_url: str) -> None:
    execute(postgres_url, "CREATE TABLE flow_run (id INTEGER)")
    with pytest.raises(StoreError, match="is not a BELLA catalogue"):
        Catalogue.open(postgres_url, create=True)
    execute(postgres_url, "INSERT INTO flow_run VALUES (1)")
    with pytest.raises(StoreError, match="is not a BELLA catalogue"):
        Catalogue.open(postgres_url)


@pytest.mark.parametrize("create", [True, False])
def test_a_newer_catalogue_is_refused(catalogue: Catalogue, catalogue_url: str, create: bool) -> None:
    catalogue.close()
    execute(catalogue_url, f"UPDATE {REVISION_TABLE} SET version_num = '9999'")
    with pytest.raises(StoreError, match=r"newer version \(revision 9999\): upgrade the package or restore"):
        Catalogue.open(catalogue_url, create=create)
    execute(catalogue_url, f"UPDATE {REVISION_TABLE} SET version_num = '{NEWEST}'")
    Catalogue.open(catalogue_url).close()


def damage(file: Path, at: slice) -> None:
    content = bytearray(file.read_bytes())
    length = len(content[at])
    content[at] = b"\xa5" * length
    file.write_bytes(content)


@pytest.mark.parametrize("at", [slice(100, 4096), slice(4096, 12288), slice(16, 100)])
def test_a_damaged_file_is_refused_and_not_touched(sqlite_url: str, tmp_path: Path, at: slice) -> None:
    with Catalogue.open(sqlite_url, create=True) as catalogue:
        catalogue.publish(publication())
    file = tmp_path / "catalogue.sqlite"
    damage(file, at)
    before = file.read_bytes()
    for create in (True, False):
        with pytest.raises(StoreError, match=r"damaged|is not a BELLA catalogue|refused"):
            Catalogue.open(sqlite_url, create=create)
    assert file.read_bytes() == before


def test_damage_inside_is_found_by_the_next_process(
    sqlite_url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with Catalogue.open(sqlite_url, create=True) as catalogue:
        solution_id = catalogue.publish(publication()).solution_id
    with closing(sqlite3.connect(tmp_path / "catalogue.sqlite")) as known:
        (page,) = known.execute("SELECT rootpage FROM sqlite_master WHERE name = 'localisation'").fetchone()
    damage(tmp_path / "catalogue.sqlite", slice(4096 * (page - 1), 4096 * page))
    Catalogue.open(sqlite_url, create=True).close()  # this process has checked the file already
    monkeypatch.setattr("bella.catalogue.schema._SOUND_FILES", set())
    with pytest.raises(StoreError, match="is damaged"):
        Catalogue.open(sqlite_url, create=True)
    with Catalogue.open(sqlite_url) as reader, pytest.raises(StoreError, match="is damaged"):  # does not read it all
        reader.localisations(solution_id)


def test_a_truncated_file_is_refused(sqlite_url: str, tmp_path: Path) -> None:
    with Catalogue.open(sqlite_url, create=True) as catalogue:
        catalogue.publish(publication())
    file = tmp_path / "catalogue.sqlite"
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    with pytest.raises(StoreError, match="damaged"):
        Catalogue.open(sqlite_url, create=True)


def test_a_folder_in_place_of_the_file_is_refused(sqlite_url: str, tmp_path: Path) -> None:
    (tmp_path / "catalogue.sqlite").mkdir()
    with pytest.raises(StoreError, match="cannot be used"):
        Catalogue.open(sqlite_url, create=True)


def test_a_home_that_cannot_be_made_is_refused(tmp_path: Path) -> None:
    (tmp_path / "home").touch()
    with pytest.raises(StoreError, match="cannot be made"):
        Catalogue.open(f"sqlite:///{tmp_path / 'home' / 'catalogue.sqlite'}", create=True)


def test_a_server_that_is_not_there_is_unreachable_and_its_password_is_not_told() -> None:
    url = "postgresql://bella:sesame@127.0.0.1:1/catalogue?application_name=sesame"
    with pytest.raises(UnreachableError, match="cannot be reached") as caught:
        Catalogue.open(url)
    assert caught.value.retriable
    assert "sesame" not in str(caught.value)
    assert "bella:***@127.0.0.1" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_database_that_is_not_there_is_unreachable(postgres_url: str) -> None:
    absent = make_url(postgres_url).set(database="absent").render_as_string(hide_password=False)
    with pytest.raises(UnreachableError, match="absent"):
        Catalogue.open(absent)


@pytest.mark.parametrize(
    "url", ["", "sesame", "mysql://bella:sesame@host/db", "sqlite://", "sqlite:///:memory:", "postgresql://h:sesame/"]
)
def test_a_wrong_url_is_bad_input_and_not_repeated(url: str) -> None:
    with pytest.raises(InputError, match="give sqlite:////path") as caught:
        Catalogue.open(url)
    assert "sesame" not in str(caught.value)


def test_a_locked_file_is_busy(sqlite_url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    Catalogue.open(sqlite_url, create=True).close()
    monkeypatch.setattr("bella.catalogue.engine._BUSY_TIMEOUT_S", 0)
    rival = sqlite3.connect(make_url(sqlite_url).database or "", isolation_level=None)
    rival.execute("BEGIN IMMEDIATE")
    with Catalogue.open(sqlite_url) as impatient:
        with pytest.raises(BusyError, match="another process is writing"):
            impatient.publish(publication())
        rival.execute("ROLLBACK")
        rival.close()
        assert impatient.publish(publication()).version == 1


def test_reading_goes_on_while_another_process_writes(sqlite_url: str) -> None:
    with Catalogue.open(sqlite_url, create=True) as catalogue:
        writer = sqlite3.connect(make_url(sqlite_url).database or "", isolation_level=None)
        writer.execute("BEGIN IMMEDIATE")
        writer.execute("DELETE FROM burst")
        assert catalogue.bursts(BurstQuery()).total == 0
        writer.execute("ROLLBACK")
        writer.close()


def test_every_refusal_is_one_line(sqlite_url: str, tmp_path: Path) -> None:
    (tmp_path / "catalogue.sqlite").write_bytes(b"SQLite format 3\0" + b"\xff" * 5000)
    with pytest.raises(BellaError) as caught:
        Catalogue.open(sqlite_url, create=True)
    assert "\n" not in str(caught.value)


def test_a_full_disk_is_told_and_nothing_is_half_written(sqlite_url: str) -> None:
    with Catalogue.open(sqlite_url, create=True) as catalogue:
        event.listen(
            catalogue._engine, "connect", lambda connection, _: connection.execute("PRAGMA max_page_count = 1")
        )
        catalogue.close()
        many = tuple(localisation(0.1 + 0.01 * number, flags="x" * 500) for number in range(500))
        with pytest.raises(StoreError, match=r"cannot be used .*full.*: check the disk"):
            catalogue.publish(publication(localisations=many))
        assert catalogue.bursts(BurstQuery()).total == 0


def test_a_row_another_session_holds_is_busy(postgres_url: str) -> None:
    with Catalogue.open(postgres_url, create=True) as catalogue:
        catalogue.publish(publication("h1"))
    impatient = make_url(postgres_url).update_query_dict({"options": "-c lock_timeout=50"})
    holder = create_engine(postgres_url)
    with holder.begin() as connection, Catalogue.open(impatient.render_as_string(hide_password=False)) as catalogue:
        connection.execute(text("SELECT * FROM burst FOR UPDATE"))
        with pytest.raises(BusyError, match=r"is busy \(.*\): try again"):
            catalogue.publish(publication("h2"))
        connection.rollback()
    holder.dispose()


HANG_UP = (
    "SELECT pg_terminate_backend(pid) FROM pg_stat_activity "
    "WHERE datname = current_database() AND pid <> pg_backend_pid()"
)


def test_a_server_that_hangs_up_is_unreachable_once_and_then_called_again(postgres_url: str) -> None:
    def hang_up_while_reading(catalogue: Catalogue) -> None:
        with reading(catalogue._engine) as connection:
            execute(postgres_url, HANG_UP)
            connection.execute(text("SELECT 1"))

    with Catalogue.open(postgres_url, create=True) as catalogue:
        with pytest.raises(UnreachableError, match="cannot be reached"):
            hang_up_while_reading(catalogue)
        execute(postgres_url, HANG_UP)
        catalogue.ping()


def test_an_installation_without_migrations_says_so(sqlite_url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bella.catalogue.schema.find_spec", lambda _: None)
    with pytest.raises(StoreError, match="`migrations` is missing: install bella-service again"):
        Catalogue.open(sqlite_url, create=True)


def test_opening_twice_in_a_process_keeps_its_locks(sqlite_url: str, tmp_path: Path) -> None:
    """A handle closed on the file would drop them; another process would then take away a log that is in use."""
    with Catalogue.open(sqlite_url, create=True) as first:
        first.submit("ann", "0" * 64, "S-1")
        Catalogue.open(sqlite_url).close()
        code = f"from bella.catalogue import Catalogue; Catalogue.open({sqlite_url!r}).close()"
        subprocess.run([sys.executable, "-c", code], check=True)
        assert (tmp_path / "catalogue.sqlite-wal").exists()
        first.submit("ann", "1" * 64, "S-2")
    with Catalogue.open(sqlite_url) as again:
        assert [one.sha256 for one in again.pending_submissions()] == ["0" * 64, "1" * 64]


def test_a_server_that_was_started_again_is_asked_again(postgres_url: str) -> None:
    others = "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE datname = '{}' AND pid <> pg_backend_pid()"
    name, server = make_url(postgres_url).database, make_url(postgres_url).set(database="postgres")
    elsewhere = server.render_as_string(hide_password=False)
    with Catalogue.open(postgres_url, create=True) as catalogue:
        before = catalogue.state()
        assert catalogue.state() == before
        execute(elsewhere, others.format(name))
        assert catalogue.state() != before, "what was kept is not trusted"
        execute(elsewhere, f'ALTER DATABASE "{name}" ALLOW_CONNECTIONS false')
        execute(elsewhere, others.format(name))
        with pytest.raises(UnreachableError):
            catalogue.state()
        execute(elsewhere, f'ALTER DATABASE "{name}" ALLOW_CONNECTIONS true')
        assert catalogue.state()
