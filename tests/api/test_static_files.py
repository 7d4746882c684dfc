"""Files of the pages: compressed once, for good where a version is named, never from outside of their folder."""

import gzip

import pytest
from fastapi.testclient import TestClient

from api.app import create_app
from bella.settings import Settings


@pytest.mark.parametrize("name", ["bella.css", "figure.css", "page.js", "favicon.svg"])
def test_a_file_is_sent_compressed_or_plain_and_not_again(client: TestClient, name: str) -> None:
    packed = client.get(f"/static/{name}", headers={"Accept-Encoding": "gzip"})
    plain = client.get(f"/static/{name}", headers={"Accept-Encoding": "identity"})
    assert packed.headers["content-encoding"] == "gzip"
    assert "content-encoding" not in plain.headers
    assert packed.content == plain.content
    assert packed.headers["etag"] == plain.headers["etag"]
    assert "Accept-Encoding" in packed.headers["vary"]
    assert int(packed.headers["content-length"]) <= len(gzip.compress(plain.content, 9))
    again = client.get(f"/static/{name}", headers={"If-None-Match": plain.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")
    head = client.head(f"/static/{name}")
    assert (head.status_code, head.content, head.headers["etag"]) == (200, b"", plain.headers["etag"])


def test_files_are_kept_for_good_under_the_address_of_a_version(client: TestClient) -> None:
    assert client.get("/static/bella.css").headers["cache-control"] == "no-cache"
    assert "immutable" in client.get("/static/bella.css?v=1").headers["cache-control"]


@pytest.mark.parametrize("name", ["none.css", "..%2Fapp.py", "../app.py", ""])
def test_there_are_no_other_files(client: TestClient, name: str) -> None:
    assert client.get(f"/static/{name}").status_code == 404


def test_files_do_not_need_a_catalogue(tmp_path_factory: pytest.TempPathFactory) -> None:
    home = tmp_path_factory.mktemp("none")
    with TestClient(create_app(Settings(home=home, database_url=None))) as reader:
        assert reader.get("/static/page.js").status_code == 200
