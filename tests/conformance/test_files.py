"""Files that are served, checked by what reads them elsewhere: votlint, astropy, cdflib, tfcat."""

import io
import json
import shutil
import subprocess
import warnings
from pathlib import Path
from typing import Any

import cdflib
import httpx
import numpy as np
import pytest
from astropy.io.votable import validate
from cdflib.xarray import cdf_to_xarray, xarray_to_cdf

from tests.plotting.synthetic import BURST_ID

TABLES = {
    "bursts": "bursts",
    "tracks": "tracks",
    "localisations": "localisations",
    "track": f"bursts/{BURST_ID}/track",
    "arrivals": f"bursts/{BURST_ID}/arrivals",
    "detections": "detections?start=2012-06-07&stop=2012-06-08",
}


def fetched(address: str, path: str, name: str, folder: Path) -> Path:
    reply = httpx.get(f"{address}/api/v1/{path}{'&' if '?' in path else '?'}format={name}")
    assert reply.status_code == 200, reply.text
    file = folder / f"table.{name}"
    file.write_bytes(reply.content)
    return file


@pytest.mark.parametrize("path", TABLES.values(), ids=TABLES)
def test_votlint_finds_nothing_in_a_votable(address: str, path: str, tmp_path: Path) -> None:
    if shutil.which("stilts") is None:
        pytest.skip("votlint is not installed: it comes with stilts (apt-get install stilts)")
    file = fetched(address, path, "votable", tmp_path)
    found = subprocess.run(["stilts", "votlint", f"votable={file}"], capture_output=True, text=True, check=False)
    assert (found.returncode, found.stdout, found.stderr) == (0, "", "")


@pytest.mark.parametrize("path", TABLES.values(), ids=TABLES)
def test_astropy_finds_nothing_in_a_votable(address: str, path: str, tmp_path: Path) -> None:
    file = fetched(address, path, "votable", tmp_path)
    said = io.StringIO()
    assert validate(str(file), output=said), said.getvalue()


@pytest.mark.parametrize("path", TABLES.values(), ids=TABLES)
def test_a_cdf_follows_the_istp_guidelines(address: str, path: str, tmp_path: Path) -> None:
    file = fetched(address, path, "cdf", tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read = cdf_to_xarray(str(file), to_datetime=False, fillval_to_nan=False)
    # read and written again, every breach of the guidelines is an error
    xarray_to_cdf(read, str(tmp_path / "again.cdf"), istp=True, terminate_on_warning=True)
    described = cdflib.CDF(file)
    for name in described.cdf_info().zVariables:
        attributes = described.varattsget(name)
        assert {"CATDESC", "FIELDNAM", "FILLVAL", "FORMAT", "UNITS", "VAR_TYPE"} <= attributes.keys(), name
        assert name == "Epoch" or attributes["DEPEND_0"] == "Epoch"


@pytest.mark.parametrize("path", [TABLES["arrivals"], TABLES["detections"]], ids=["arrivals", "detections"])
def test_tfcat_is_read_and_sound(address: str, path: str, tmp_path: Path) -> None:
    tfcat = pytest.importorskip("tfcat", reason="tfcat is not installed: pip install tfcat")
    whose = f"{path}{'&' if '?' in path else '?'}observatory=STEREO-A"
    # never tfcat.validate: it fetches the schema from the network without checking who answers
    text = fetched(address, whose, "tfcat", tmp_path).read_text()
    made = tfcat.loads(text)
    assert made.crs["properties"]["ref_position_id"] == "stereo-a"
    assert len(made.features) > 0
    for feature in made.features:
        assert not feature.errors()
        low_t, low_f, high_t, high_f = feature["bbox"]
        assert low_t < high_t
        assert low_f < high_f
        assert set(feature.properties) == set(made.fields)
    assert made.crs["properties"]["time_coords_id"] == "unix"
    assert made.crs["properties"]["spectral_coords"] == {"type": "frequency", "unit": "MHz"}
    for plain in json.loads(text)["features"]:  # the reader above rounds coordinates to six decimals
        assert_is_sound(plain["geometry"], plain["bbox"])


def assert_is_sound(geometry: Any, bbox: list[float]) -> None:
    """The box is that of all points, and a ring is closed and anticlockwise."""
    points = np.array(geometry["coordinates"], dtype=float).reshape(-1, 2)
    np.testing.assert_array_equal([*points.min(axis=0), *points.max(axis=0)], bbox)
    if geometry["type"] == "Polygon":
        (ring,) = np.array(geometry["coordinates"])
        np.testing.assert_array_equal(ring[0], ring[-1])
        from_first = ring - ring[0]  # unix times are large: their products would lose the area
        x, y = from_first[:, 0], from_first[:, 1]
        assert np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]) > 0


def test_tfcat_of_several_spacecraft_asks_for_one(address: str) -> None:
    reply = httpx.get(f"{address}/api/v1/detections?start=2012-06-07&stop=2012-06-08&format=tfcat")
    assert reply.status_code == 422
    assert "observatory=" in reply.json()["detail"]
