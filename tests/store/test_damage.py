"""Damage is an error, never numbers: every file of a group is cut, changed and removed in turn."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from bella.exceptions import StoreError
from bella.store import open_group, open_tree, stage_group, verify_group
from tests.store.examples import posterior, spectra
from tests.store.test_roundtrip import NAME, published


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    root = tmp_path_factory.mktemp("whole")
    return root, published(posterior(), root)


@pytest.fixture
def root(whole: tuple[Path, str], tmp_path: Path) -> Path:
    return Path(shutil.copytree(whole[0], tmp_path / "store"))


def rewrite(file: Path, content: bytes) -> None:
    file.chmod(0o644)
    file.write_bytes(content)


def chunks(root: Path) -> list[Path]:
    found = sorted(one for one in (root / NAME).rglob("*") if one.is_file() and one.name != "zarr.json")
    assert len(found) == len(posterior().variables)
    return found


def test_a_missing_chunk_is_damage_where_plain_xarray_reads_zeros(root: Path) -> None:
    (root / NAME / "modes" / "c" / "0").unlink()
    with xr.open_zarr(root / NAME, chunks=None) as plain:
        assert plain["modes"].values.tolist() == [0] * 5
    with pytest.raises(StoreError, match="lacks modes/c/0: restore it from a backup or localise the burst anew"):
        open_group(root, NAME)


def test_any_missing_chunk_is_damage(root: Path) -> None:
    for file in chunks(root):
        content = file.read_bytes()
        file.unlink()
        with pytest.raises(StoreError, match="lacks "):
            open_group(root, NAME)
        file.write_bytes(content)
    xr.testing.assert_identical(open_group(root, NAME).load(), posterior())


@pytest.mark.parametrize("keep", [0.0, 0.01, 0.1, 0.5, 0.99])
def test_any_truncated_chunk_is_damage(root: Path, keep: float) -> None:
    for file in chunks(root):
        content = file.read_bytes()
        rewrite(file, content[: int(len(content) * keep)])
        with pytest.raises(StoreError, match=r"is damaged|lacks "):
            open_group(root, NAME)
        rewrite(file, content)
    xr.testing.assert_identical(open_group(root, NAME).load(), posterior())


def test_a_truncated_shard_is_noticed_though_it_is_not_read(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bella.store.reading._READ_AT_ONCE_BYTES", 1000)
    shard = root / NAME / "draws" / "c" / "0" / "0" / "0"
    content = shard.read_bytes()
    for length in (0, 1, 4, 16, 83, 84, 85, len(content) // 2, len(content) - 1):
        rewrite(shard, content[:length])
        with pytest.raises(StoreError, match=r"is damaged|lacks draws"):
            open_group(root, NAME)


def test_any_changed_byte_of_a_chunk_is_damage(root: Path) -> None:
    rng = np.random.default_rng(3)
    for file in chunks(root):
        content = file.read_bytes()
        for at in {0, len(content) - 1, *rng.integers(len(content), size=3).tolist()}:
            changed = bytearray(content)
            changed[at] ^= 0x10
            rewrite(file, bytes(changed))
            with pytest.raises(StoreError, match="is damaged"):
                open_group(root, NAME)
        rewrite(file, content)
    xr.testing.assert_identical(open_group(root, NAME).load(), posterior())


def test_changed_metadata_never_change_what_is_read(root: Path, whole: tuple[Path, str]) -> None:
    file = root / NAME / "zarr.json"
    content = file.read_bytes()
    refused = 0
    for at in np.random.default_rng(4).integers(len(content), size=150):
        changed = bytearray(content)
        changed[at] ^= 1 << (at % 7)
        rewrite(file, bytes(changed))
        try:
            xr.testing.assert_identical(open_group(root, NAME, whole[1]), posterior())
        except StoreError as error:
            refused += "\n" not in str(error)
    assert refused > 100


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b"{}", b"null", b'{"zarr_format": 3}', b"\xff"])
def test_a_broken_root_is_damage(root: Path, content: bytes) -> None:
    rewrite(root / NAME / "zarr.json", content)
    with pytest.raises(StoreError, match="is damaged"):
        open_group(root, NAME)


def test_another_group_under_the_name_is_noticed(root: Path, whole: tuple[Path, str]) -> None:
    other = published(posterior(seed=9), root, "T3-20120607-1929/other.zarr")
    assert open_group(root, "T3-20120607-1929/other.zarr", other)["draws"].shape == (5, 40, 4)
    with pytest.raises(StoreError, match="does not match its checksum in the catalogue"):
        open_group(root, "T3-20120607-1929/other.zarr", whole[1])


def test_damage_between_writing_and_verifying_is_noticed(tmp_path: Path) -> None:
    staged = stage_group(posterior(), tmp_path)
    file = staged / "x_rsun" / "c" / "0"
    content = file.read_bytes()
    rewrite(file, b"\0" * len(content))
    with pytest.raises(StoreError, match="is damaged"):
        verify_group(staged, posterior())
    file.unlink()
    with pytest.raises(StoreError, match="lacks x_rsun/c/0"):
        verify_group(staged, posterior())


def test_damaged_spectra_are_refused(tmp_path: Path) -> None:
    published(spectra(), tmp_path)
    file = tmp_path / NAME / "WIND" / "intensity" / "c" / "0" / "0"
    rewrite(file, file.read_bytes()[:-1])
    with pytest.raises(StoreError, match="is damaged"):
        open_tree(tmp_path, NAME)
    file.unlink()
    with pytest.raises(StoreError, match="lacks WIND/intensity/c/0/0"):
        open_tree(tmp_path, NAME)


def test_a_missing_group_is_refused(root: Path) -> None:
    with pytest.raises(StoreError, match=r"absent\.zarr is not in the store .*: restore it from a backup or localise"):
        open_group(root, "T3-20120607-1929/absent.zarr")


@pytest.mark.parametrize("version", [2, "1", None, 1.5])
def test_a_format_of_a_later_version_is_refused(tmp_path: Path, version: object) -> None:
    staged = stage_group(posterior().assign_attrs(format_version=version), tmp_path)
    staged.rename(tmp_path / "later.zarr")
    with pytest.raises(StoreError, match="upgrade bella-service"):
        open_group(tmp_path, "later.zarr")


def test_a_zarr_of_a_later_version_is_refused(root: Path) -> None:
    file = root / NAME / "zarr.json"
    rewrite(file, json.dumps(json.loads(file.read_text()) | {"zarr_format": 4}).encode())
    with pytest.raises(StoreError, match="upgrade bella-service"):
        open_group(root, NAME)
