import os
import stat
import time
from pathlib import Path

import pytest

from bella.exceptions import NoDataError, StoreError
from bella.store import file_of_group, open_group, place_group, stage_group, sweep, write_group
from bella.store.layout import age_s
from tests.store.examples import files_of, posterior
from tests.store.test_roundtrip import NAME, published

ESCAPES = [
    "../outside.zarr.zip",
    "T3-1/../../outside.zarr.zip",
    "/etc/outside.zarr.zip",
    "T3-1/./a.zarr.zip",
    "T3-1//a.zarr.zip",
    ".staging/a.zarr.zip",
    "T3-1/.a.zarr.zip",
    "",
    ".",
    "T3-1/a",
    "T3-1\\a.zarr.zip",
    "T3-1/a\0.zarr.zip",
    "T3-1/a b.zarr.zip",
    "a.zarr/",
]


@pytest.mark.parametrize("path", ESCAPES)
def test_no_path_leads_out_of_the_store(tmp_path: Path, path: str) -> None:
    root = tmp_path / "store"
    staged = stage_group(posterior(), root)
    with pytest.raises(StoreError, match="is not a path of a group in the store: give one as"):
        place_group(staged, root, path)
    with pytest.raises(StoreError, match="is not a path of a group"):
        open_group(root, path)
    with pytest.raises(StoreError, match="is not a path of a group"):
        file_of_group(root, path, "zarr.json")
    assert staged.exists()


def test_a_link_out_of_the_store_is_not_followed(tmp_path: Path) -> None:
    published(posterior(), tmp_path / "elsewhere")
    (tmp_path / "store").mkdir()
    (tmp_path / "store" / "T3-20120607-1929").symlink_to(tmp_path / "elsewhere" / "T3-20120607-1929")
    with pytest.raises(StoreError, match="is not a path of a group"):
        open_group(tmp_path / "store", NAME)


def test_a_name_is_used_once(tmp_path: Path) -> None:
    published(posterior(seed=1), tmp_path)
    second = stage_group(posterior(seed=2), tmp_path)
    with pytest.raises(StoreError, match="never replaced: place it under a new name"):
        place_group(second, tmp_path, NAME)
    assert open_group(tmp_path, NAME)["draws"].equals(posterior(seed=1)["draws"])
    assert second.exists()


def test_a_staged_group_that_is_gone_cannot_be_placed(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="could not be placed"):
        place_group(tmp_path / ".staging" / "gone.zarr.zip", tmp_path, NAME)


def test_files_of_a_group_are_read_only_and_flushed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    flushed: set[str] = set()
    fsync = os.fsync

    def noting(descriptor: int) -> None:
        flushed.add(str(Path(f"/proc/self/fd/{descriptor}").readlink()))
        fsync(descriptor)

    monkeypatch.setattr(os, "fsync", noting)
    staged = stage_group(posterior(), tmp_path)
    assert {str(staged), str(staged.parent)} <= flushed
    assert stat.S_IMODE(staged.stat().st_mode) == 0o444
    flushed.clear()
    place_group(staged, tmp_path, NAME)
    assert {str(tmp_path), str((tmp_path / NAME).parent), str(staged.parent)} <= flushed


def test_files_of_a_group_are_found_by_key(tmp_path: Path) -> None:
    published(posterior(), tmp_path)
    assert files_of(tmp_path / NAME) == {key: file_of_group(tmp_path, NAME, key) for key in files_of(tmp_path / NAME)}
    assert len(file_of_group(tmp_path, NAME, "draws/c/0/0/0")) > 0
    with pytest.raises(StoreError, match="is not in the store"):
        file_of_group(tmp_path, "T3-20120607-1929/absent.zarr.zip", "zarr.json")


@pytest.mark.parametrize(
    "key", ["", ".", "draws", "absent", "../other.zarr/zarr.json", "/etc/passwd", "a\0b", "x" * 5000, "../../secret"]
)
def test_no_other_file_is_found(tmp_path: Path, key: str) -> None:
    published(posterior(), tmp_path)
    published(posterior(), tmp_path, "T3-20120607-1929/other.zarr.zip")
    (tmp_path / "secret").touch()
    with pytest.raises(NoDataError, match="begin with its zarr"):
        file_of_group(tmp_path, NAME, key)


def age(group: Path, seconds: float) -> None:
    then = time.time() - seconds
    os.utime(group, (then, then))


def test_only_orphans_are_swept(tmp_path: Path) -> None:
    published(posterior(), tmp_path)
    published(posterior(), tmp_path, "T3-20120607-1929/orphan.zarr.zip")
    staged = stage_group(posterior(), tmp_path)
    removed = sweep(tmp_path, {NAME}, older_than_s=0.0)
    assert removed == [f".staging/{staged.name}", "T3-20120607-1929/orphan.zarr.zip"]
    assert open_group(tmp_path, NAME)["draws"].shape == (5, 40, 4)
    assert sorted(one.name for one in tmp_path.rglob("*.zarr.zip")) == [Path(NAME).name]
    assert list((tmp_path / ".staging").iterdir()) == []
    assert sweep(tmp_path, {NAME}, older_than_s=0.0) == []


def test_what_a_live_writer_is_at_is_spared(tmp_path: Path) -> None:
    published(posterior(), tmp_path)
    staged = stage_group(posterior(), tmp_path)
    assert sweep(tmp_path, set(), older_than_s=3600.0) == []
    age(staged, 7200.0)
    staged.chmod(0o644)
    assert sweep(tmp_path, set(), older_than_s=3600.0) == []


def test_placing_makes_a_group_young_again(tmp_path: Path) -> None:
    staged = stage_group(posterior(), tmp_path)
    age(staged, 7200.0)
    place_group(staged, tmp_path, NAME)
    assert sweep(tmp_path, set(), older_than_s=3600.0) == []


def test_leftovers_of_a_sweep_that_was_killed_are_swept(tmp_path: Path) -> None:
    leftover = tmp_path / ".staging" / "abc.swept"
    (leftover / "draws").mkdir(parents=True)
    assert sweep(tmp_path, set(), older_than_s=0.0) == [".staging/abc.swept"]
    assert not leftover.exists()


def test_a_store_that_is_not_there_yet_has_nothing_to_sweep(tmp_path: Path) -> None:
    assert sweep(tmp_path / "store", set(), older_than_s=0.0) == []


def test_a_group_another_sweep_took_first_is_not_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    published(posterior(), tmp_path)

    def taken(group: Path, _now: float) -> float:
        group.rename(tmp_path / "taken")
        return 1e9

    monkeypatch.setattr("bella.store.layout.age_s", taken)
    assert sweep(tmp_path, set(), older_than_s=0.0) == []


def test_folders_of_older_versions_that_nothing_refers_to_are_swept(tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / "T3-1").mkdir(exist_ok=True)
        write_group(posterior(), tmp_path / "T3-1" / f"{name}.zarr")
    assert sweep(tmp_path, {"T3-1/a.zarr"}, older_than_s=0.0) == ["T3-1/b.zarr"]
    assert [one.name for one in (tmp_path / "T3-1").iterdir()] == ["a.zarr"]


def test_what_a_live_run_works_on_is_spared_whatever_its_age(tmp_path: Path) -> None:
    published(posterior(), tmp_path)
    published(posterior(), tmp_path, "T3-20130101-0000/orphan.zarr.zip")
    removed = sweep(tmp_path, set(), older_than_s=0.0, in_use={"T3-20120607-1929"})
    assert removed == ["T3-20130101-0000/orphan.zarr.zip"]
    assert open_group(tmp_path, NAME)["draws"].shape == (5, 40, 4)


def test_a_group_is_as_old_as_the_file_in_it_that_was_written_last(tmp_path: Path) -> None:
    group = tmp_path / "group.zarr"
    (group / "draws").mkdir(parents=True)
    file = group / "draws" / "c0"
    file.touch()
    now = time.time()
    os.utime(file, (now + 900, now + 900))
    assert age_s(group, now + 1000) == pytest.approx(100, abs=1)
