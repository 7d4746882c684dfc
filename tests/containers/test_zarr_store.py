"""Zarr stores of users come whole out of the process that reads them."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from bella.containers import zarr_groups

VERSIONS = pytest.mark.parametrize("version", [2, 3])


@pytest.fixture
def many_kinds() -> xr.Dataset:
    """Times, numbers, truth, text and single values, some of them missing."""
    return xr.Dataset(
        {
            "whole": ("x", np.array([1, -2, 3], "i2"), {"units": "1", "valid_range": [-5, 5], "scale": 2.5}),
            "single": ("x", np.array([0.5, np.nan, 2.0], ">f4")),
            "is_good": ("x", np.array([True, False, True])),
            "name": ("x", np.array(["one", "zwölf", ""], dtype=object)),
            "scalar": ((), 7.25),
            "area": (("x", "y"), np.arange(6.0).reshape(3, 2)),
        },
        coords={"x": pd.date_range("2012-06-07T19:30:00.25", periods=3, freq="7s"), "y": [0.1, 0.2]},
        attrs={"observatory": "WIND", "numbers": [1, 2], "nothing": None},
    )


@VERSIONS
def test_what_was_written_is_read(tmp_path: Path, many_kinds: xr.Dataset, version: int) -> None:
    path = tmp_path / "all.zarr"
    xr.DataTree.from_dict({"/": many_kinds, "/inner": many_kinds[["area"]] + 1}).to_zarr(
        path, zarr_format=version, consolidated=False
    )

    groups = zarr_groups(path)

    assert list(groups) == ["", "/inner"]
    xr.testing.assert_identical(groups[""].load(), many_kinds.assign(single=many_kinds["single"].astype("<f4")))
    np.testing.assert_array_equal(groups["/inner"]["area"], many_kinds["area"] + 1)
    assert groups[""]["area"].encoding["chunks"] == [3, 2]


def test_shards_count_as_chunks(tmp_path: Path) -> None:
    values = xr.Dataset({"area": (("x", "y"), np.zeros((8, 8)))})
    values.to_zarr(
        tmp_path / "s.zarr", zarr_format=3, consolidated=False, encoding={"area": {"shards": (8, 4), "chunks": (2, 2)}}
    )

    assert zarr_groups(tmp_path / "s.zarr")[""]["area"].encoding["chunks"] == [8, 4]


def test_a_store_that_was_written_anew_is_read_anew(tmp_path: Path, many_kinds: xr.Dataset) -> None:
    path = tmp_path / "all.zarr"
    for factor in (1.0, 2.0):
        (many_kinds[["area"]] * factor).to_zarr(path, mode="w", consolidated=False)
        np.testing.assert_array_equal(zarr_groups(path)[""]["area"], factor * many_kinds["area"])
