"""A release holds what the catalogue says, is whole or not there, and changes of it are found."""

import fcntl
import hashlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from datetime import UTC, date, datetime, timedelta
from pathlib import Path
from typing import Any

import jsonschema
import mlcroissant
import numpy as np
import pyarrow.parquet as pq
import pytest
import xarray as xr
from astropy.table import Table

import bella.pipeline.release
from bella.catalogue import Catalogue, Detection, SearchedDay
from bella.exceptions import BellaError, BusyError, InputError, NoDataError, StoreError
from bella.formats import ARRIVALS, BURSTS, LOCALISATIONS, SCHEMAS
from bella.formats.binary import from_arrow
from bella.formats.record_table import plain_rows
from bella.formats.release import Release, datacite
from bella.pipeline.release import Wanted, make_release, verify_release
from bella.records import DayAnswer, Origin
from bella.settings import Settings
from bella.store import open_group
from tests.api.published import ONSET, publish_event, publish_many, published, synthetic_burst
from tests.fixtures_postgres import postgres_database
from tests.linked_events.published import link_flare
from tests.pipeline.disks import small_disk_at
from tests.plotting.synthetic import BURST_ID

REPOSITORY = Path(__file__).parents[2]
DETECTION = Detection(
    "WIND", ONSET, ONSET, ONSET + timedelta(minutes=20), 0.2, 8.0, 9.5, 0.2, 12.5, 40, True, "localisable", "", BURST_ID
)
SIMULATED = "SIM-20120701-0000"
LABEL = Wanted("2026.1", creators=("Doe, Jane", "Some Institute"), publisher="Some Institute", doi="10.5281/zenodo.1")


def filled(settings: Settings) -> Settings:
    """Two real bursts in June and one in July, a simulated one, a retracted one, two searched days."""
    july = synthetic_burst(burst_id="T3-20120701-1200", start=datetime(2012, 7, 1, 12, tzinfo=UTC))
    wrong = synthetic_burst(burst_id="T3-20120702-1200", start=datetime(2012, 7, 2, 12, tzinfo=UTC))
    few = np.array([0.25, 0.5])
    with Catalogue.open(settings.catalogue_url, create=True) as catalogue:
        publish_event(settings, catalogue)
        publish_many(settings, catalogue, 1)
        published(settings, catalogue, burst=july, frequencies=few)
        published(settings, catalogue, burst=wrong, frequencies=few)
        simulated = replace(july, burst_id=SIMULATED, origin=Origin.SIMULATED)
        published(settings, catalogue, burst=simulated, frequencies=few)
        catalogue.retract(wrong.burst_id, "interference")
        received = [DETECTION, replace(DETECTION, observatory="STEREO-A")]
        catalogue.record_day(SearchedDay(ONSET.date(), "h", "0.1", ("WIND", "STEREO-A"), DayAnswer.LOCALISED), received)
        silent = SearchedDay(date(2012, 7, 1), "h", "0.1", ("WIND",), DayAnswer.NOT_SEARCHABLE, "one hour is missing")
        catalogue.record_day(silent, [])
        link_flare(catalogue, BURST_ID, ONSET)
    return settings


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Settings:
    return filled(Settings(home=tmp_path_factory.mktemp("home"), database_url=None))


@pytest.fixture(scope="module")
def frozen(home: Settings, tmp_path_factory: pytest.TempPathFactory) -> Path:
    parent = tmp_path_factory.mktemp("releases")
    return parent / make_release(home, LABEL, parent).name


@pytest.fixture
def copied(frozen: Path, tmp_path: Path) -> Path:
    copy = shutil.copytree(frozen, tmp_path / frozen.name)
    for path in copy.rglob("*"):
        path.chmod(0o755)
    return copy


def rows_of(folder: Path, name: str, month: str = "2012-06") -> list[dict[str, Any]]:
    return plain_rows(from_arrow(SCHEMAS[name], pq.read_table(folder / name / f"{month}.parquet")))


@pytest.mark.parametrize("backend", ["sqlite", "postgresql"])
def test_every_number_is_that_of_the_catalogue(backend: str, tmp_path: Path) -> None:
    if backend == "sqlite":
        assert_holds_the_catalogue(filled(Settings(home=tmp_path / "home", database_url=None)), tmp_path)
        return
    with postgres_database() as url:
        assert_holds_the_catalogue(filled(Settings(home=tmp_path / "home", database_url=url)), tmp_path)


def assert_holds_the_catalogue(settings: Settings, parent: Path) -> None:
    release = make_release(settings, LABEL, parent)
    folder = parent / release.name
    assert verify_release(folder) == release
    assert release.rows["bursts"] == release.rows["tracks"] == release.posteriors == 3
    assert (release.rows["days"], release.rows["detections"]) == (2, 2)
    assert (release.first_onset_utc, release.last_onset_utc) == ("2012-06-07T19:29:15Z", "2012-07-01T12:00:00Z")
    localisations, arrivals = rows_of(folder, "localisations"), rows_of(folder, "arrivals")
    with Catalogue.open(settings.catalogue_url) as catalogue:
        for row in rows_of(folder, "bursts"):
            assert_is_the_burst(row, catalogue, settings, localisations, arrivals)
    assert [one["answer"] for month in ("2012-06", "2012-07") for one in rows_of(folder, "days", month)] == [
        "localised",
        "not searchable",
    ]
    assert rows_of(folder, "days", "2012-07")[0]["reason"] == "one hour is missing"
    assert [one["observatory"] for one in rows_of(folder, "detections")] == ["STEREO-A", "WIND"]
    (flare,) = rows_of(folder, "events")
    assert (flare["event_id"], flare["burst_id"], flare["delay_s"], flare["peak_utc"]) == (
        "DONKI:F",
        BURST_ID,
        -120.0,
        None,
    )
    assert flare["phi0_deg"] == rows_of(folder, "bursts")[0]["phi0_deg"]
    (stored,) = (folder / "posteriors" / BURST_ID).iterdir()
    with xr.open_zarr(f"zip://::{stored}", consolidated=True) as copy:
        expected = open_group(settings.store_root, f"{BURST_ID}/{stored.name}")
        xr.testing.assert_identical(copy.load(), expected.load())


def assert_is_the_burst(
    row: dict[str, Any],
    catalogue: Catalogue,
    settings: Settings,
    localisations: list[dict[str, Any]],
    arrivals: list[dict[str, Any]],
) -> None:
    summary = catalogue.burst(row["burst_id"])
    solution = summary.preferred
    assert solution is not None
    assert row["solution_id"] == solution.solution_id
    assert row["phi0_low_deg"] == solution.answer.phi0_low_deg
    assert row["sentence"] == solution.answer.sentence
    expected = catalogue.localisations(solution.solution_id)
    own = [one for one in localisations if one["burst_id"] == row["burst_id"]]
    assert [(one["frequency_mhz"], one["x_rsun"], one["cov_xy_rsun2"], one["log_evidence"]) for one in own] == [
        (one.frequency_mhz, one.x_rsun, one.cov_xy_rsun2, one.log_evidence) for one in expected
    ]
    posterior = open_group(settings.store_root, solution.store_path)
    times = [one for one in arrivals if one["burst_id"] == row["burst_id"]]
    assert len(times) == posterior["arrival_s"].size
    assert [one["sigma_s"] for one in times] == posterior["sigma_s"].to_numpy().T.ravel().tolist()
    assert {one["edge"] for one in times} == {solution.series.edge}


def test_tables_of_months_are_read_as_one_and_votables_say_the_same(frozen: Path) -> None:
    assert sorted(one.name for one in (frozen / "bursts").iterdir()) == ["2012-06.parquet", "2012-07.parquet"]
    bursts = pq.read_table(frozen / "bursts")
    assert bursts["burst_id"].to_pylist() == [BURST_ID, "T3-20120608-1929", "T3-20120701-1200"]
    assert bursts.schema.field("phi0_deg").metadata[b"unit"] == b"deg"
    assert bursts.schema.metadata[b"release"] == b"2026.1"
    beside = Table.read(frozen / "bursts.vot")
    assert beside["phi0_deg"].tolist() == bursts["phi0_deg"].to_pylist()
    assert str(beside["phi0_deg"].unit) == "deg"
    assert pq.ParquetFile(frozen / "bursts" / "2012-06.parquet").metadata.row_group(0).column(0).compression == "ZSTD"


def test_votlint_finds_nothing(frozen: Path) -> None:
    if shutil.which("stilts") is None:
        pytest.skip("votlint is not installed: it comes with stilts (apt-get install stilts)")
    for name in ("bursts.vot", "tracks.vot", "events.vot"):
        found = subprocess.run(
            ["stilts", "votlint", f"votable={frozen / name}"], capture_output=True, text=True, check=False
        )
        assert (found.returncode, found.stdout, found.stderr) == (0, "", "")


def test_croissant_is_valid_and_its_records_are_those_of_the_tables(
    frozen: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(frozen)
    dataset = mlcroissant.Dataset("croissant.json")
    assert not dataset.metadata.ctx.issues.errors
    assert not dataset.metadata.ctx.issues.warnings
    assert {one.name for one in dataset.metadata.record_sets} == set(SCHEMAS)
    bursts = list(dataset.records("bursts"))
    assert [one["bursts/burst_id"].decode() for one in bursts] == pq.read_table("bursts")["burst_id"].to_pylist()
    assert [one["bursts/f_low_mhz"] for one in bursts] == [0.15] * 3
    sums = {one.id: one.sha256 for one in dataset.metadata.distribution if getattr(one, "sha256", None)}
    listed = dict(line.split("  ")[::-1] for line in Path("SHA256SUMS").read_text().splitlines())
    assert sums == {name: listed[name] for name in ("bursts.vot", "tracks.vot", "events.vot", "calibration.csv")}


def test_datacite_has_what_a_doi_needs(frozen: Path) -> None:
    made = json.loads((frozen / "datacite.json").read_text())
    assert_is_datacite(made)
    assert made["doi"] == "10.5281/zenodo.1"
    assert made["creators"] == [
        {"name": "Doe, Jane", "nameType": "Personal", "familyName": "Doe", "givenName": "Jane"},
        {"name": "Some Institute", "nameType": "Organizational"},
    ]
    assert {"date": "2012-06-07/2012-07-01", "dateType": "Collected"}.items() <= made["dates"][1].items()
    assert made["rightsList"][0]["rightsIdentifier"] == "CC-BY-4.0"
    release = Release.model_validate_json((frozen / "release.json").read_text())
    without = datacite(release.model_copy(update={"doi": None}))
    assert_is_datacite(without)
    assert "doi" not in without


def assert_is_datacite(made: dict[str, Any]) -> None:
    """The properties that the schema of DataCite 4.6 requires, its words, and no property that it does not know."""
    words = {
        "alternateIdentifiers": {"alternateIdentifier", "alternateIdentifierType"},
        "creators": {"name", "nameType", "familyName", "givenName"},
        "dates": {"date", "dateType", "dateInformation"},
        "descriptions": {"description", "descriptionType"},
        "relatedIdentifiers": {"relatedIdentifier", "relatedIdentifierType", "relationType"},
        "rightsList": {"rights", "rightsUri", "rightsIdentifier", "rightsIdentifierScheme", "schemeUri"},
        "subjects": {"subject"},
        "titles": {"title"},
    }
    plain = {"doi", "formats", "language", "publicationYear", "publisher", "schemaVersion", "types", "version"}
    assert made.keys() <= words.keys() | plain
    for name, known in words.items():
        assert made[name], name
        assert all(one and one.keys() <= known for one in made[name]), name
    assert made["schemaVersion"] == "http://datacite.org/schema/kernel-4"
    assert made["types"]["resourceTypeGeneral"] == "Dataset"
    assert made["publisher"].keys() == {"name"}
    assert re.fullmatch(r"\d{4}", made["publicationYear"])
    assert {one["dateType"] for one in made["dates"]} <= {"Created", "Collected", "Issued"}
    assert {one["nameType"] for one in made["creators"]} <= {"Personal", "Organizational"}
    assert {one["descriptionType"] for one in made["descriptions"]} == {"Abstract"}
    (related,) = made["relatedIdentifiers"]
    assert related["relationType"] == "IsDescribedBy"
    assert re.fullmatch(r"10\.\d{4,9}/\S+", related["relatedIdentifier"])


@pytest.mark.parametrize("name", sorted(set(SCHEMAS) - {"events"}))
def test_rows_follow_the_schema_of_the_columns(frozen: Path, name: str) -> None:
    schema = json.loads((frozen / "columns.schema.json").read_text())
    row = rows_of(frozen, name)[0]
    one = {"$defs": schema["$defs"], "$ref": f"#/$defs/{name}"}
    jsonschema.validate(row, one)
    for column in SCHEMAS[name].columns:
        described = schema["$defs"][name]["properties"][column.name]
        assert (described.get("unit", ""), described["ucd"]) == (column.unit, column.ucd)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(row | {"invented": 1}, one)


def test_the_page_asks_nobody_for_anything_and_says_what_is_there(frozen: Path) -> None:
    page = (frozen / "index.html").read_text()
    assert not re.search(r"<(script|img|link|iframe)|\ssrc=|url\(|@import", page)
    for expected in ("Doe, Jane; Some Institute (", "10.5281/zenodo.1", "CC-BY-4.0", "apparent source", "solRad2"):
        assert expected in page
    local = re.findall(r'href="(?!http)([^"#]+)"', page)
    assert local
    assert all((frozen / name).is_file() for name in local)


def test_the_calibration_is_that_of_the_code(frozen: Path) -> None:
    assert (frozen / "calibration.csv").read_bytes() == (REPOSITORY / "bella/calibration/found.csv").read_bytes()


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"first": date(2012, 6, 8)}, ["T3-20120608-1929", "T3-20120701-1200"]),
        ({"last": date(2012, 6, 8)}, [BURST_ID, "T3-20120608-1929"]),
        ({"origins": (Origin.SIMULATED,)}, [SIMULATED]),
    ],
    ids=["from", "to", "origin"],
)
def test_days_and_origins_choose(home: Settings, change: dict[str, Any], expected: list[str], tmp_path: Path) -> None:
    release = make_release(home, replace(LABEL, posteriors=False, **change), tmp_path)
    folder = tmp_path / release.name
    assert pq.read_table(folder / "bursts")["burst_id"].to_pylist() == expected
    assert set(pq.read_table(folder / "arrivals")["burst_id"].to_pylist()) == set(expected)
    days = {"first": ["2012-07-01"], "last": ["2012-06-07"], "origins": []}[next(iter(change))]
    found = [row["day_utc"][:10] for path in (folder / "days").glob("*") for row in rows_of(folder, "days", path.stem)]
    assert found == days
    assert not (folder / "posteriors").exists()
    assert verify_release(folder).posteriors == 0


def test_pieces_are_small_and_make_the_whole(
    frozen: Path, home: Settings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bella.pipeline.release, "PIECE_ROWS", 2)
    folder = tmp_path / make_release(home, LABEL, tmp_path).name
    for name in ("localisations", "bursts"):
        number = len(rows_of(frozen, name))
        assert pq.ParquetFile(folder / name / "2012-06.parquet").metadata.num_row_groups == (number + 1) // 2
    assert number == 2, "a table that ends with a piece"
    assert rows_of(folder, "localisations") == rows_of(frozen, "localisations")
    assert rows_of(folder, "arrivals") == rows_of(frozen, "arrivals")


@pytest.mark.parametrize("backend", ["sqlite", "postgresql"])
def test_what_is_published_meanwhile_is_not_seen(backend: str, tmp_path: Path) -> None:
    if backend == "sqlite":
        assert_is_frozen(Settings(home=tmp_path / "home", database_url=None))
        return
    with postgres_database() as url:
        assert_is_frozen(Settings(home=tmp_path / "home", database_url=url))


def assert_is_frozen(settings: Settings) -> None:
    later = synthetic_burst(burst_id="T3-20120710-1200", start=datetime(2012, 7, 10, 12, tzinfo=UTC))
    with (
        Catalogue.open(settings.catalogue_url, create=True) as catalogue,
        Catalogue.open(settings.catalogue_url) as other,
    ):
        publish_event(settings, catalogue)
        with catalogue.snapshot():
            published(settings, other, burst=later, frequencies=np.array([0.5, 1.0]))
            assert catalogue.bursts().total == 1
            assert len(catalogue.days().days) == 0
            assert other.bursts().total == 2
        assert catalogue.bursts().total == 2


def damage_byte(folder: Path) -> str:
    path = folder / "localisations" / "2012-06.parquet"
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    return "localisations/2012-06.parquet is changed"


def damage_posterior(folder: Path) -> str:
    file = min((folder / "posteriors").rglob("*.zarr.zip"))
    file.write_bytes(file.read_bytes()[:-1])
    return f"{file.relative_to(folder).as_posix()} is changed"


def remove_one(folder: Path) -> str:
    (folder / "tracks.vot").unlink()
    return "tracks.vot is missing"


def add_one(folder: Path) -> str:
    (folder / "bursts" / "2013-01.parquet").write_bytes(b"")
    return "bursts/2013-01.parquet is not listed"


def forget_a_month(folder: Path) -> str:
    (folder / "bursts" / "2012-07.parquet").unlink()
    bella.pipeline.release._write_sums(folder)
    return "bursts has 2 rows, and not 3"


def another_number(folder: Path) -> str:
    path = folder / "bursts.vot"
    path.write_text(path.read_text().replace("<TD>0.15</TD>", "<TD>0.16</TD>", 1))
    bella.pipeline.release._write_sums(folder)
    return "column f_low_mhz is not that of the Parquet"


def another_time(folder: Path) -> str:
    path = folder / "bursts.vot"
    path.write_text(path.read_text().replace("19:29:15.000", "19:29:16.000", 1))
    bella.pipeline.release._write_sums(folder)
    return "column start_utc is not that of the Parquet"


def no_posteriors(folder: Path) -> str:
    shutil.rmtree(folder / "posteriors" / BURST_ID)
    bella.pipeline.release._write_sums(folder)
    return "2 posteriors, and not 3"


def broken_record(folder: Path) -> str:
    (folder / "release.json").write_text("{")
    bella.pipeline.release._write_sums(folder)
    return "is damaged"


@pytest.mark.parametrize(
    "damage",
    [
        damage_byte,
        damage_posterior,
        remove_one,
        add_one,
        forget_a_month,
        another_number,
        another_time,
        no_posteriors,
        broken_record,
    ],
)
def test_a_change_is_found(copied: Path, damage: Callable[[Path], str]) -> None:
    verify_release(copied)
    expected = damage(copied)
    with pytest.raises(StoreError, match=re.escape(expected)) as found:
        verify_release(copied)
    assert "\n" not in str(found.value)


def test_the_usual_tool_checks_the_sums(frozen: Path) -> None:
    done = subprocess.run(["sha256sum", "--check", "--quiet", "SHA256SUMS"], cwd=frozen, check=False)
    assert done.returncode == 0


def test_a_folder_that_is_no_release_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is not a release"):
        verify_release(tmp_path)


def names_in(folder: Path) -> list[str]:
    return sorted(one.name for one in folder.iterdir())


def test_a_release_is_never_changed(home: Settings, frozen: Path) -> None:
    before = {path: path.stat().st_mtime_ns for path in frozen.rglob("*")}
    with pytest.raises(InputError, match="exists, and a release is never changed"):
        make_release(home, LABEL, frozen.parent)
    assert {path: path.stat().st_mtime_ns for path in frozen.rglob("*")} == before
    assert not any(path.stat().st_mode & 0o222 for path in frozen.rglob("*") if path.is_file())


def test_bad_input_is_one_line_and_leaves_nothing(home: Settings, tmp_path: Path) -> None:
    cases: list[tuple[Callable[[], Any], type[BellaError], str]] = [
        (lambda: make_release(home, LABEL, tmp_path / "nowhere"), InputError, "does not exist"),
        (
            lambda: make_release(home, replace(LABEL, first=date(2020, 1, 1)), tmp_path),
            NoDataError,
            "no burst from 2020",
        ),
        (lambda: replace(LABEL, label="../up"), InputError, "write it like 2026.1"),
        (lambda: replace(LABEL, licence="my own"), InputError, "spdx.org"),
        (lambda: replace(LABEL, doi="https://doi.org/10.5281/1"), InputError, "10.5281/zenodo"),
        (lambda: replace(LABEL, first=date(2020, 1, 2), last=date(2020, 1, 1)), InputError, "exchange them"),
    ]
    for call, kind, said in cases:
        with pytest.raises(kind, match=re.escape(said)) as found:
            call()
        assert "\n" not in str(found.value)
    assert names_in(tmp_path) == []


def test_a_damaged_posterior_stops_it(tmp_path: Path) -> None:
    settings = filled(Settings(home=tmp_path / "home", database_url=None))
    with Catalogue.open(settings.catalogue_url) as catalogue:
        answer = catalogue.burst(BURST_ID).preferred
    assert answer is not None
    file = settings.store_root / answer.store_path
    file.chmod(0o644)
    file.write_bytes(b"nothing of the kind" * 40)
    (tmp_path / "out").mkdir()
    with pytest.raises(StoreError, match="restore it from a backup"):
        make_release(settings, LABEL, tmp_path / "out")
    assert names_in(tmp_path / "out") == []


def test_what_reads_back_differently_is_no_release(
    home: Settings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    writing = bella.pipeline.release.arrow_table

    def falsified(table: Any) -> Any:
        if table.schema is LOCALISATIONS:
            table.data["x_rsun"][0] = np.nextafter(table.data["x_rsun"][0], np.inf)
        return writing(table)

    digest = bella.pipeline.release._digest
    monkeypatch.setattr(bella.pipeline.release, "arrow_table", falsified)
    given: list[str] = []
    monkeypatch.setattr(bella.pipeline.release, "record_table", lambda *all_: keep(given, digest, *all_))
    monkeypatch.setattr(bella.pipeline.release, "_digest", lambda table: given.pop(0) if given else digest(table))
    with pytest.raises(StoreError, match="differs from the catalogue"):
        make_release(home, LABEL, tmp_path)
    assert names_in(tmp_path) == []


def keep(given: list[str], digest: Callable[[Any], str], *arguments: Any) -> Any:
    """Table of records, whose checksum is taken before anybody can change it."""
    from bella.formats import record_table

    table = record_table(*arguments)
    given.append(digest(table))
    return table


KILLED = """
import os, signal, sys
from pathlib import Path
import bella.pipeline.release as release
from bella.settings import Settings
step, home, parent = sys.argv[1:]
whole = getattr(release, step)
def killed(*arguments, **options):
    whole(*arguments, **options)
    os.kill(os.getpid(), signal.SIGKILL)
setattr(release, step, killed)
release.make_release(Settings(home=Path(home), database_url=None), release.Wanted("2026.1"), Path(parent))
"""


@pytest.mark.parametrize("step", ["copy_group", "flush_tree"])
def test_a_killed_run_leaves_no_release_and_the_next_makes_one(home: Settings, step: str, tmp_path: Path) -> None:
    command = [sys.executable, "-c", KILLED, step, str(home.home), str(tmp_path)]
    assert subprocess.run(command, cwd=REPOSITORY, check=False).returncode == -signal.SIGKILL
    assert names_in(tmp_path) == [".bella-2026.1.staging"]
    release = make_release(home, LABEL, tmp_path)
    assert names_in(tmp_path) == ["bella-2026.1"]
    assert verify_release(tmp_path / "bella-2026.1") == release


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    with small_disk_at(tmp_path / "disk", 80 * 1024) as place:
        yield place


@pytest.mark.parametrize("posteriors", [True, False], ids=["in a posterior", "in a table or a text"])
def test_a_full_disk_leaves_nothing(home: Settings, small_disk: Path, *, posteriors: bool) -> None:
    with pytest.raises(StoreError, match=r"No space left on device.*free the disk or name another folder") as found:
        make_release(home, replace(LABEL, posteriors=posteriors), small_disk)
    assert "\n" not in str(found.value)
    assert names_in(small_disk) == []


def test_two_processes_do_not_make_the_same_release(home: Settings, tmp_path: Path) -> None:
    staging = tmp_path / ".bella-2026.1.staging"
    staging.mkdir()
    (staging / "half.parquet").write_bytes(b"half")
    handle = os.open(staging, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        with pytest.raises(BusyError, match="another process is making"):
            make_release(home, LABEL, tmp_path)
        assert (staging / "half.parquet").exists()
    finally:
        os.close(handle)
    make_release(home, LABEL, tmp_path)
    assert names_in(tmp_path) == ["bella-2026.1"]


def test_a_release_that_was_made_a_moment_ago_is_not_replaced(
    home: Settings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    take = fcntl.flock

    def too_late(handle: int, how: int) -> None:
        (tmp_path / ".bella-2026.1.staging").rename(tmp_path / "bella-2026.1")
        take(handle, how)

    monkeypatch.setattr("fcntl.flock", too_late)
    with pytest.raises(InputError, match="a release is never changed"):
        make_release(home, LABEL, tmp_path)
    assert names_in(tmp_path) == ["bella-2026.1"]


def test_a_burst_whose_only_solution_was_retracted_has_no_track(tmp_path: Path) -> None:
    settings = Settings(home=tmp_path / "home", database_url=None)
    with Catalogue.open(settings.catalogue_url, create=True) as catalogue:
        publish_many(settings, catalogue, 1)
        catalogue.retract(published(settings, catalogue, frequencies=np.array([0.25])).solution_id, "a wrong edge")
    release = make_release(settings, LABEL, tmp_path)
    assert (release.rows["bursts"], release.rows["tracks"], release.posteriors) == (2, 1, 1)
    assert verify_release(tmp_path / release.name) == release


def test_columns_of_another_version_are_named(frozen: Path) -> None:
    with pytest.raises(InputError, match="not those of this version"):
        from_arrow(ARRIVALS, pq.read_table(frozen / BURSTS.name / "2012-07.parquet"))


def test_a_release_from_before_there_were_events_is_still_whole(copied: Path) -> None:
    shutil.rmtree(copied / "events")
    (copied / "events.vot").unlink()
    record = json.loads((copied / "release.json").read_text())
    del record["rows"]["events"]
    (copied / "release.json").write_text(json.dumps(record))
    names = [one for one in copied.rglob("*") if one.is_file() and one.name != "SHA256SUMS"]
    lines = [f"{hashlib.sha256(one.read_bytes()).hexdigest()}  {one.relative_to(copied)}\n" for one in names]
    (copied / "SHA256SUMS").write_text("".join(lines))
    assert "events" not in verify_release(copied).rows
