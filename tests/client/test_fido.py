"""SunPy's Fido asks the service through an attribute that no other client answers to."""

from pathlib import Path

import pytest
from astropy.table import QTable
from astropy.time import Time

from bella.exceptions import InputError, UnreachableError
from tests.plotting.synthetic import BURST_ID

for needed in ("bs4", "drms", "zeep"):
    pytest.importorskip(needed, reason=f"sunpy.net needs {needed}: pip install 'sunpy[net]'")

from sunpy.net import Fido  # noqa: E402 - it cannot be imported without these
from sunpy.net import attrs as a  # noqa: E402

from bella.client import fido  # noqa: E402


@pytest.fixture
def asked(address: str, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.setenv(fido.SERVICE_VARIABLE, address)
    return address


def test_a_search_finds_the_bursts_of_a_time_with_one_client(asked: str) -> None:
    found = Fido.search(a.Time("2012-06-07", "2012-06-08"), a.bella.Catalogue("bursts"))
    assert list(found.keys()) == ["bella"]
    assert found["bella"]["burst_id"].tolist() == [BURST_ID]
    assert isinstance(found["bella"]["start_utc"], Time)


def test_the_service_may_be_named_in_the_search(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(fido.SERVICE_VARIABLE, "http://127.0.0.1:1")
    asked = (a.Time("2012-06-07", "2012-06-08"), a.bella.Catalogue.detections)
    assert len(Fido.search(*asked, a.bella.Service(address))["bella"]) == 3
    with pytest.raises(UnreachableError, match="does not answer"):
        Fido.search(*asked)


def test_an_unknown_catalogue_is_refused_with_those_there_are(asked: str) -> None:
    with pytest.raises(InputError, match="bursts, tracks, detections"):
        Fido.search(a.Time("2012-06-07", "2012-06-08"), a.bella.Catalogue("flares"))


def test_fetch_downloads_the_localisation_table_of_each_burst(asked: str, tmp_path: Path) -> None:
    found = Fido.search(a.Time("2012-06-07", "2012-06-09"), a.bella.Catalogue("bursts"))
    files = Fido.fetch(found, path=f"{tmp_path}/{{file}}", progress=False)
    assert not files.errors
    assert sorted(Path(one).name for one in files) == sorted(f"{one}.ecsv" for one in found["bella"]["burst_id"])
    table = QTable.read(tmp_path / f"{BURST_ID}.ecsv", format="ascii.ecsv")
    assert set(table["burst_id"]) == {BURST_ID}
