"""Damage is an error, never numbers: every file in a group is cut, changed and removed in turn."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from zarr.storage import ZipStore

from bella.exceptions import StoreError
from bella.store import file_of_group, open_group, open_tree, stage_group, verify_group
from tests.store.examples import files_of, posterior, repack, rewrite, spectra
from tests.store.test_roundtrip import NAME, published


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    root = tmp_path_factory.mktemp("whole")
    return root, published(posterior(), root)


@pytest.fixture
def root(whole: tuple[Path, str], tmp_path: Path) -> Path:
    return Path(shutil.copytree(whole[0], tmp_path / "store"))


def chunks(root: Path) -> dict[str, bytes]:
    found = {key: content for key, content in files_of(root / NAME).items() if not key.endswith("zarr.json")}
    assert len(found) == len(posterior().variables)
    return found


def with_changes(root: Path, **changes: bytes | None) -> None:
    """Put other content in place of files of the group, whose checksums agree with it; None for none."""
    files = {key: content for key, content in (files_of(root / NAME) | changes).items() if content is not None}
    repack(root / NAME, files)


def test_a_missing_chunk_is_damage_where_plain_xarray_reads_zeros(root: Path) -> None:
    with_changes(root, **{"modes/c/0": None})
    with xr.open_zarr(ZipStore(root / NAME, mode="r"), chunks=None) as plain:
        assert plain["modes"].values.tolist() == [0] * 5
    with pytest.raises(StoreError, match="lacks modes/c/0: restore it from a backup or localise the burst anew"):
        open_group(root, NAME)


def test_any_missing_chunk_is_damage(root: Path) -> None:
    whole = (root / NAME).read_bytes()
    for key in chunks(root):
        with_changes(root, **{key: None})
        with pytest.raises(StoreError, match="lacks "):
            open_group(root, NAME)
        rewrite(root / NAME, whole)
    xr.testing.assert_identical(open_group(root, NAME).load(), posterior())


@pytest.mark.parametrize("keep", [0.0, 0.01, 0.1, 0.5, 0.99])
def test_any_truncated_chunk_is_damage(root: Path, keep: float) -> None:
    for key, content in chunks(root).items():
        with_changes(root, **{key: content[: int(len(content) * keep)]})
        with pytest.raises(StoreError, match=r"is damaged|lacks "):
            open_group(root, NAME)
        with_changes(root, **{key: content})
    xr.testing.assert_identical(open_group(root, NAME).load(), posterior())


def test_a_truncated_shard_is_noticed_though_it_is_not_read(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bella.store.reading._READ_AT_ONCE_BYTES", 1000)
    key = "draws/c/0/0/0"
    content = files_of(root / NAME)[key]
    for length in (0, 1, 4, 16, 83, 84, 85, len(content) // 2, len(content) - 1):
        with_changes(root, **{key: content[:length]})
        with pytest.raises(StoreError, match=r"is damaged|lacks draws"):
            open_group(root, NAME)


def test_any_changed_byte_of_a_chunk_is_damage(root: Path) -> None:
    rng = np.random.default_rng(3)
    for key, content in chunks(root).items():
        for at in {0, len(content) - 1, *rng.integers(len(content), size=3).tolist()}:
            changed = bytearray(content)
            changed[at] ^= 0x10
            with_changes(root, **{key: bytes(changed)})
            with pytest.raises(StoreError, match="is damaged"):
                open_group(root, NAME)
        with_changes(root, **{key: content})
    xr.testing.assert_identical(open_group(root, NAME).load(), posterior())


def test_a_changed_byte_of_the_file_never_changes_what_is_read(root: Path, whole: tuple[Path, str]) -> None:
    content = (root / NAME).read_bytes()
    refused = 0
    for at in np.random.default_rng(4).integers(len(content), size=150):
        changed = bytearray(content)
        changed[at] ^= 1 << (at % 7)
        rewrite(root / NAME, bytes(changed))
        try:
            xr.testing.assert_identical(open_group(root, NAME, whole[1]), posterior())
        except StoreError as error:
            refused += "\n" not in str(error)
    assert refused > 60, "the rest is names, times, and metadata that stand there twice"


@pytest.mark.parametrize("keep", [0.0, 0.001, 0.3, 0.9, 0.999])
def test_a_file_that_is_cut_is_damage(root: Path, keep: float) -> None:
    content = (root / NAME).read_bytes()
    rewrite(root / NAME, content[: int(keep * len(content))])
    with pytest.raises(StoreError, match="is damaged"):
        open_group(root, NAME)
    with pytest.raises(StoreError, match="is damaged"):
        file_of_group(root, NAME, "zarr.json")


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b"{}", b"null", b'{"zarr_format": 3}', b"\xff"])
def test_a_broken_root_is_damage(root: Path, content: bytes) -> None:
    with_changes(root, **{"zarr.json": content})
    with pytest.raises(StoreError, match="is damaged"):
        open_group(root, NAME)


def test_another_group_under_the_name_is_noticed(root: Path, whole: tuple[Path, str]) -> None:
    other = published(posterior(seed=9), root, "T3-20120607-1929/other.zarr.zip")
    assert open_group(root, "T3-20120607-1929/other.zarr.zip", other)["draws"].shape == (5, 40, 4)
    with pytest.raises(StoreError, match="does not match its checksum in the catalogue"):
        open_group(root, "T3-20120607-1929/other.zarr.zip", whole[1])


def test_damage_between_writing_and_verifying_is_noticed(tmp_path: Path) -> None:
    staged = stage_group(posterior(), tmp_path)
    files = files_of(staged)
    repack(staged, files | {"x_rsun/c/0": b"\0" * len(files["x_rsun/c/0"])})
    with pytest.raises(StoreError, match="is damaged"):
        verify_group(staged, posterior())
    del files["x_rsun/c/0"]
    repack(staged, files)
    with pytest.raises(StoreError, match="lacks x_rsun/c/0"):
        verify_group(staged, posterior())


def test_damaged_spectra_are_refused(tmp_path: Path) -> None:
    published(spectra(), tmp_path)
    key = "WIND/intensity/c/0/0"
    with_changes(tmp_path, **{key: files_of(tmp_path / NAME)[key][:-1]})
    with pytest.raises(StoreError, match="is damaged"):
        open_tree(tmp_path, NAME)
    with_changes(tmp_path, **{key: None})
    with pytest.raises(StoreError, match="lacks WIND/intensity/c/0/0"):
        open_tree(tmp_path, NAME)


def test_a_missing_group_is_refused(root: Path) -> None:
    with pytest.raises(StoreError, match=r"absent\.zarr\.zip is not in the store .*: restore it"):
        open_group(root, "T3-20120607-1929/absent.zarr.zip")


@pytest.mark.parametrize("version", [2, "1", None, 1.5])
def test_a_format_of_a_later_version_is_refused(tmp_path: Path, version: object) -> None:
    staged = stage_group(posterior().assign_attrs(format_version=version), tmp_path)
    staged.rename(tmp_path / "later.zarr.zip")
    with pytest.raises(StoreError, match="upgrade bella-service"):
        open_group(tmp_path, "later.zarr.zip")


def test_a_zarr_of_a_later_version_is_refused(root: Path) -> None:
    known = json.loads(files_of(root / NAME)["zarr.json"])
    with_changes(root, **{"zarr.json": json.dumps(known | {"zarr_format": 4}).encode()})
    with pytest.raises(StoreError, match="upgrade bella-service"):
        open_group(root, NAME)
