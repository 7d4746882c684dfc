"""``bella formats`` as a user meets it."""

import json

from typer.testing import CliRunner

from bella.cli import app
from bella.spectra import PRODUCTS


def test_formats_lists_every_product() -> None:
    shown = CliRunner().invoke(app, ["formats"], env={"COLUMNS": "80"})

    assert shown.exit_code == 0
    assert all(product.naming in shown.output for product in PRODUCTS)
    assert max(map(len, shown.output.splitlines())) <= 80


def test_formats_as_json_tells_what_was_tried_on_the_archive() -> None:
    rows = json.loads(CliRunner().invoke(app, ["formats", "--json"]).output)

    assert set(rows[0]) == {"name", "mission", "naming", "cadence", "quantity", "verified"}
    verified = {row["name"] for row in rows if row["verified"]}
    assert verified == {"Wind/WAVES H1", "Wind/WAVES RAD1 L3 DF", "STEREO/WAVES level 2", "Dynamic spectrum"}
    assert len(rows) == len({row["name"] for row in rows}) == len(PRODUCTS)
