"""What is written is what is read, byte for byte, also by plain xarray."""

import warnings
from errno import ENOSPC
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from bella.exceptions import StoreError
from bella.store import (
    content_sha256,
    copy_group,
    open_group,
    open_tree,
    packed_folder,
    place_group,
    rounded_draws,
    stage_group,
    verify_group,
    write_group,
)
from tests.store.examples import files_of, posterior, spectra

NAME = "T3-20120607-1929/half_maximum-posterior-default-2d-3f9c2a1b.zarr.zip"


def published(group: xr.Dataset | xr.DataTree, root: Path, name: str = NAME) -> str:
    staged = stage_group(group, root)
    sha256 = verify_group(staged, group)
    assert place_group(staged, root, name) == name
    return sha256


@pytest.fixture
def root(tmp_path: Path) -> Path:
    return tmp_path / "home" / "store"


def test_a_posterior_comes_back_the_same(root: Path) -> None:
    given_posterior = posterior()
    sha256 = published(given_posterior, root)
    found = open_group(root, NAME, sha256)
    xr.testing.assert_identical(found, given_posterior)
    assert {name: found[name].dtype.kind for name in found.data_vars} == {
        **{name: given_posterior[name].dtype.kind for name in given_posterior.data_vars},
        "flags": "T",
    }
    assert content_sha256(found) == content_sha256(given_posterior) == sha256


def test_spectra_come_back_the_same(root: Path) -> None:
    sha256 = published(spectra(), root)
    found = open_tree(root, NAME, sha256)
    xr.testing.assert_identical(found, spectra())
    assert content_sha256(found) == content_sha256(spectra()) == sha256
    assert found["WIND"]["time"].values[1] == np.datetime64("2012-06-07T19:01:00")


def test_metadata_are_written_without_spaces(root: Path) -> None:
    published(posterior(), root)
    written = [content for key, content in files_of(root / NAME).items() if key.endswith("zarr.json")]
    assert len(written) == len(posterior().variables) + 1
    assert all(b"\n" not in one for one in written)


def test_plain_xarray_reads_it_without_a_word(root: Path) -> None:
    published(posterior(), root)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with xr.open_zarr(f"zip://::{root / NAME}", chunks=None) as found:
            xr.testing.assert_identical(found.load(), posterior())
            assert found["flags"].values[1] == "two_modes;speed_not_constrained"
            assert found["modes"].values[0] == 0
            assert np.isnan(found["never_determined"].values).all()
            assert (found["zero"].values == 0).all()


def test_writing_warns_of_nothing(root: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        published(posterior(), root)


def test_many_frequencies_are_few_chunks_and_one_is_read_alone(root: Path) -> None:
    published(posterior(frequencies=5), root)
    many = (
        posterior(frequencies=5)
        .isel(frequency=np.arange(200) % 5)
        .assign_coords(frequency=np.geomspace(0.15, 2.0, 200))
    )
    published(many, root, "T3-20120607-1929/many.zarr.zip")
    few, more = (len(files_of(root / name)) for name in (NAME, "T3-20120607-1929/many.zarr.zip"))
    assert few == more <= 2 * len(many.variables) + 1
    draws = open_group(root, "T3-20120607-1929/many.zarr.zip")["draws"]
    assert draws.encoding["chunks"] == (10, 40, 1)
    assert draws.encoding["shards"] == (200, 40, 4)
    np.testing.assert_array_equal(draws[137], many["draws"][137])
    published(many.isel(frequency=slice(0, 37)), root, "T3-20120607-1929/prime.zarr.zip")
    prime = open_group(root, "T3-20120607-1929/prime.zarr.zip")["draws"]
    assert prime.encoding["chunks"] == (1, 40, 1)  # a shard holds whole chunks
    np.testing.assert_array_equal(prime, many["draws"][:37])


def test_large_variables_stay_on_disk_until_they_are_used(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    published(posterior(), root)
    monkeypatch.setattr("bella.store.reading._READ_AT_ONCE_BYTES", 1000)
    found = open_group(root, NAME)
    assert not found["draws"].variable._in_memory
    assert found["x_rsun"].variable._in_memory
    np.testing.assert_array_equal(found["draws"], posterior()["draws"])


def test_the_checksum_does_not_depend_on_compression_or_chunks(root: Path, tmp_path: Path) -> None:
    sha256 = published(posterior(), root)
    text = {name: posterior()[name].astype(object) for name in ("flags", "parameter", "axis")}
    other = tmp_path / "other.zarr.zip"
    encoding = {"draws": {"chunks": (2, 3, 4), "compressors": None}, "x_rsun": {"dtype": ">f8"}}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        posterior().assign(text).to_zarr(other, zarr_format=3, encoding=encoding)
    with xr.open_zarr(other, chunks=None) as found:
        assert content_sha256(found) == sha256


def scattered(sd: np.ndarray, draws: int = 4000) -> xr.Dataset:
    """Posterior of which draws have these standard deviations by frequency and parameter."""
    values = 300 + np.random.default_rng(3).normal(size=(len(sd), draws, 4)) * sd[:, None, :]
    group = posterior(frequencies=5).isel(frequency=np.arange(len(sd)) % 5).drop_vars(["draws", "frequency"])
    return group.assign(draws=(("frequency", "draw", "parameter"), values.astype("float32"), {"units": "1"}))


def test_rounding_draws_moves_each_by_less_than_a_thirtieth_of_its_scatter() -> None:
    sd = np.geomspace(0.01, 100, 20).reshape(5, 4)
    exact = scattered(sd)
    kept = rounded_draws(exact)
    moved = (kept["draws"] - exact["draws"]).astype(float) / xr.DataArray(sd, dims=("frequency", "parameter"))
    assert 1 / 200 < float(abs(moved).max("draw").min()) <= float(abs(moved).max()) < 1 / 30
    assert float(abs(moved.mean("draw")).max()) < 1e-3
    assert kept["draws"].attrs == {"units": "1"}
    assert kept["draws"].dims == exact["draws"].dims
    assert kept["draws"].dtype == np.float32
    xr.testing.assert_identical(kept.drop_vars("draws"), exact.drop_vars("draws"))
    xr.testing.assert_identical(rounded_draws(kept), kept)


def test_rounding_leaves_what_does_not_scatter() -> None:
    exact = scattered(np.zeros((2, 4)))
    exact["draws"][1, 7, 2] = np.nan
    np.testing.assert_array_equal(rounded_draws(exact)["draws"], exact["draws"])
    xr.testing.assert_identical(rounded_draws(spectra()["WIND"].to_dataset()), spectra()["WIND"].to_dataset())


def test_four_thousand_draws_of_forty_frequencies_fit_into_a_megabyte(root: Path) -> None:
    published(rounded_draws(scattered(np.ones((40, 4)) * [5, 5, 10, 1e-3])), root)
    assert (root / NAME).stat().st_size < 1_000_000


def changes() -> dict[str, xr.Dataset]:
    base = posterior()
    one_bit = base.copy(deep=True)
    one_bit["draws"].values.view("uint32")[3, 7, 1] ^= 1
    return {
        "one bit": one_bit,
        "sign of zero": base.assign(zero=("frequency", np.full(5, -0.0))),
        "type": base.assign(zero=base["zero"].astype("float32")),
        "name": base.rename(zero="nought"),
        "dimension": base.assign(zero=("nought", np.zeros(5))),
        "attribute": base.assign_attrs(seed=1),
        "units": base.assign(x_rsun=base["x_rsun"].assign_attrs(units="au")),
        "flag": base.assign(flags=base["flags"].str.replace("two", "2")),
        "missing": base.drop_vars("modes"),
        "more": base.assign(more=1),
    }


@pytest.mark.parametrize("change", sorted(changes()))
def test_verifying_notices_any_difference(root: Path, change: str) -> None:
    staged = stage_group(posterior(), root)
    with pytest.raises(StoreError, match="differs from what was given in "):
        verify_group(staged, changes()[change])
    assert content_sha256(changes()[change]) != content_sha256(posterior())


@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    values=arrays.arrays(
        st.sampled_from([np.float32, np.float64, np.int16, np.int64, np.bool_, np.dtype(">f8"), np.uint8]),
        arrays.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=4),
    ),
    text=st.text(st.characters(blacklist_categories=["Cs"]), max_size=8),
)
def test_any_numbers_and_text_come_back(
    tmp_path_factory: pytest.TempPathFactory, values: np.ndarray, text: str
) -> None:
    root = tmp_path_factory.mktemp("store")
    dims = [f"d{axis}" for axis in range(values.ndim)]
    group = xr.Dataset({"draws": (dims, values), "text": ("t", np.array([text, ""], dtype=object))}, attrs={"t": text})
    staged = stage_group(group, root)
    sha256 = verify_group(staged, group)
    place_group(staged, root, "a.zarr.zip")
    found = open_group(root, "a.zarr.zip", sha256)
    assert found["draws"].dtype == values.dtype.newbyteorder("=")
    np.testing.assert_array_equal(found["draws"].values, values)
    assert found["text"].values.tolist() == [text, ""]


def test_encodings_from_elsewhere_do_not_change_what_is_kept(root: Path) -> None:
    packed = posterior()
    packed["x_rsun"].encoding = {"dtype": "int16", "scale_factor": 0.5, "_FillValue": -1}
    packed["arrival"].encoding = {"units": "hours since 2012-06-07", "dtype": "int32"}
    sha256 = published(packed, root)
    xr.testing.assert_identical(open_group(root, NAME, sha256), posterior())


def test_what_cannot_be_written_leaves_nothing(root: Path) -> None:
    with pytest.raises(StoreError, match="could not be written") as caught:
        stage_group(posterior().assign_attrs(catalogue=object()), root)
    assert "\n" not in str(caught.value)
    assert list((root / ".staging").iterdir()) == []


def test_a_group_outside_a_store_is_a_folder_that_plain_xarray_opens(tmp_path: Path) -> None:
    write_group(posterior(), tmp_path / "draws.zarr")
    with xr.open_zarr(tmp_path / "draws.zarr", chunks=None) as found:
        xr.testing.assert_identical(found.load(), posterior())
    with pytest.raises(StoreError, match="is there already"):
        write_group(posterior(seed=2), tmp_path / "draws.zarr")
    with pytest.raises(StoreError, match="could not be written"):
        write_group(posterior().assign_attrs(catalogue=object()), tmp_path / "other.zarr")
    assert [one.name for one in tmp_path.iterdir() if one.name != ".staging"] == ["draws.zarr"]


def test_a_disk_that_fills_up_leaves_nothing_of_a_group_outside_a_store(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_folder: Path) -> None:
        raise OSError(ENOSPC, "No space left on device")

    monkeypatch.setattr("bella.store.writing.flush_tree", full)
    with pytest.raises(StoreError, match="No space left on device"):
        write_group(posterior(), tmp_path / "draws.zarr")
    assert list(tmp_path.iterdir()) == []


def test_a_copy_is_compared_with_its_checksum(root: Path, tmp_path: Path) -> None:
    sha256 = published(posterior(), root)
    copy_group(root, NAME, sha256, tmp_path / "one")
    xr.testing.assert_identical(open_group(tmp_path / "one", NAME), posterior())
    with pytest.raises(StoreError, match="does not match its checksum"):
        copy_group(root, NAME, "0" * 64, tmp_path / "two")
    with pytest.raises(StoreError, match="is not in the store"):
        copy_group(tmp_path, NAME, sha256, tmp_path / "three")


def test_folders_of_older_versions_are_packed_without_a_change(tmp_path: Path) -> None:
    write_group(posterior(), tmp_path / "old.zarr")
    with pytest.raises(StoreError, match=r"old\.zarr is a folder, .*run `bella store pack` once"):
        open_group(tmp_path, "old.zarr")
    place_group(packed_folder(tmp_path, "old.zarr"), tmp_path, "new.zarr.zip")
    xr.testing.assert_identical(open_group(tmp_path, "new.zarr.zip", content_sha256(posterior())), posterior())
    with pytest.raises(StoreError, match=r"gone\.zarr is not in the store"):
        packed_folder(tmp_path, "gone.zarr")
    with pytest.raises(StoreError, match="is not a path of a group"):
        packed_folder(tmp_path, "../old.zarr")


def test_a_root_that_cannot_be_made_is_refused(tmp_path: Path) -> None:
    (tmp_path / "store").touch()
    with pytest.raises(StoreError, match="could not be written"):
        stage_group(posterior(), tmp_path / "store")
