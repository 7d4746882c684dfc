"""``bella formats`` as a user meets it."""

import json

from typer.testing import CliRunner

from bella.cli import app
from bella.spectra import PRODUCTS, quirks


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


def test_quirks_are_listed_for_people_and_machines() -> None:
    shown = CliRunner().invoke(app, ["formats", "--quirks"], env={"COLUMNS": "100"})
    rows = json.loads(CliRunner().invoke(app, ["formats", "--quirks", "--json"]).output)

    assert shown.exit_code == 0
    assert len(rows) == len(quirks())
    assert {"solo_hfr_five_then_fifty", "wind_rad1_list_mode", "stereo_minutes", "psp_times_on_tt"} <= {
        row["name"] for row in rows
    }
    assert all({"observatory", "first", "last", "effect", "handling", "source"} <= set(row) for row in rows)
