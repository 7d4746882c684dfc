"""Commands of the operator: tokens, webhooks, retractions, origins and pruning."""

import json
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result
from typer.testing import CliRunner

from bella.catalogue import Catalogue
from bella.cli import app
from bella.exceptions import BellaError
from bella.records import Origin
from bella.settings import Settings
from bella.store.layout import STAGING
from tests.api.published import publish_event, publish_many, published, settings_of, synthetic_burst
from tests.pipeline.disks import small_disk_at
from tests.plotting.synthetic import BURST_ID

Command = Callable[..., Result]


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    made = settings_of(tmp_path / "home")
    made.store_root.mkdir(parents=True)
    Catalogue.open(made.catalogue_url, create=True).close()
    return made


@pytest.fixture
def bella(settings: Settings, monkeypatch: pytest.MonkeyPatch) -> Command:
    monkeypatch.setenv("BELLA_HOME", str(settings.home))
    monkeypatch.delenv("BELLA_DATABASE_URL", raising=False)

    def run(*arguments: str) -> Result:
        return CliRunner().invoke(app, [*arguments])

    return run


def fault_of(result: Result) -> BellaError:
    assert isinstance(result.exception, BellaError), result.output
    return result.exception


def test_a_token_is_shown_once_and_revoked_for_good(bella: Command, settings: Settings) -> None:
    made = json.loads(bella("token", "create", "--name", "Ann", "--json").output)
    with Catalogue.open(settings.catalogue_url) as catalogue:
        token = catalogue.token_of(made["token"])
        assert token is not None
        assert (token.token_id, token.name) == (made["token_id"], "Ann")
    listed = bella("token", "list", "--json").output
    assert made["token"] not in listed
    assert [one["name"] for one in json.loads(listed)] == ["Ann"]
    assert json.loads(listed)[0]["revoked_utc"] is None
    assert "is revoked" in bella("token", "revoke", made["token_id"]).output
    assert json.loads(bella("token", "list", "--json").output)[0]["revoked_utc"].endswith("Z")
    assert made["token_id"] in bella("token", "list").output
    words = bella("token", "create", "--name", "Bob").output.split()
    assert words[-1].startswith("bella_")


def test_a_token_that_is_not_there_and_a_bad_name_say_what_to_do(bella: Command) -> None:
    assert "bella token list" in str(fault_of(bella("token", "revoke", "none")))
    bad = fault_of(bella("token", "create", "--name", ""))
    assert (bad.exit_code, "--name must be one line" in str(bad)) == (2, True)


def test_a_webhook_is_added_listed_and_removed(bella: Command, settings: Settings) -> None:
    made = json.loads(bella("webhook", "add", "https://8.8.8.8/bella", "--tests", "--json").output)
    listed = bella("webhook", "list", "--json").output
    assert made["secret"] not in listed
    assert json.loads(listed) == [
        {
            "webhook_id": made["webhook_id"],
            "url": "https://8.8.8.8/bella",
            "tests": True,
            "waiting": 0,
            "failures": 0,
            "message": "",
        }
    ]
    with Catalogue.open(settings.catalogue_url) as catalogue:
        assert catalogue.webhooks()[0].secret == made["secret"]
    assert made["webhook_id"] in bella("webhook", "list").output
    assert "is removed" in bella("webhook", "remove", made["webhook_id"]).output
    assert json.loads(bella("webhook", "list", "--json").output) == []


@pytest.mark.parametrize("url", ["https://127.0.0.1/", "https://[::1]/", "http://8.8.8.8/", "https://10.0.0.1/"])
def test_a_webhook_on_a_private_address_is_refused_unless_it_is_allowed(
    bella: Command, url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    fault = fault_of(bella("webhook", "add", url))
    assert fault.exit_code == 2
    assert "BELLA_PRIVATE_WEBHOOKS=true" in str(fault)
    monkeypatch.setenv("BELLA_PRIVATE_WEBHOOKS", "true")
    assert bella("webhook", "add", url).exit_code == 0


def test_what_is_retracted_is_listed_only_when_asked_for(bella: Command, settings: Settings) -> None:
    with Catalogue.open(settings.catalogue_url) as catalogue:
        solution = published(settings, catalogue)
    said = bella("catalogue", "retract", BURST_ID, "--reason", "timed on interference")
    assert said.output.splitlines()[-1] == f"{BURST_ID}: retracted: timed on interference"
    assert json.loads(bella("catalogue", "list", "--json").output) == []
    (row,) = json.loads(bella("catalogue", "list", "--retracted", "--json").output)
    assert row["retracted"]["reason"] == "timed on interference"
    assert row["preferred"] is None
    assert row["solutions"] == [solution.solution_id]
    again = fault_of(bella("catalogue", "retract", BURST_ID, "--reason", "again"))
    assert "was retracted on" in str(again)
    assert (settings.store_root / solution.store_path).is_file()


def test_data_that_are_not_real_are_listed_only_when_asked_for(bella: Command, settings: Settings) -> None:
    with Catalogue.open(settings.catalogue_url) as catalogue:
        from dataclasses import replace

        published(settings, catalogue, burst=replace(synthetic_burst(burst_id="SIM-1"), origin=Origin.SIMULATED))
        published(settings, catalogue)
    for option, expected in (((), [BURST_ID]), (("--origin", "simulated"), ["SIM-1"])):
        rows = json.loads(bella("catalogue", "list", "--json", *option).output)
        assert [row["burst_id"] for row in rows] == expected
    rows = json.loads(bella("catalogue", "list", "--json", "--origin", "all").output)
    assert {row["origin"] for row in rows} == {"archive", "simulated"}
    assert "simulated data, not of the Sun" in bella("catalogue", "show", "SIM-1").output
    assert "give one of archive" in str(fault_of(bella("catalogue", "list", "--origin", "martian")))


def test_bursts_of_other_grades_are_neither_listed_nor_counted(bella: Command, settings: Settings) -> None:
    with Catalogue.open(settings.catalogue_url) as catalogue:
        grade = published(settings, catalogue).answer.grade
    others = "ABCD".replace(grade, "")
    assert bella("catalogue", "list", "--grade", grade).output.splitlines()[-1] == "1 of 1 bursts"
    assert bella("catalogue", "list", "--grade", others.lower()).output.splitlines()[-1] == "0 of 0 bursts"
    assert "give some of A, B, C, D" in str(fault_of(bella("catalogue", "list", "--grade", "AE")))


def test_bursts_are_listed_by_what_is_said_of_them(bella: Command, settings: Settings) -> None:
    with Catalogue.open(settings.catalogue_url) as catalogue:
        said = published(settings, catalogue).answer
        publish_many(settings, catalogue, 1)

    def listed(*options: str) -> list[str]:
        return [row["burst_id"] for row in json.loads(bella("catalogue", "list", "--json", *options).output)]

    both = listed()
    assert both == [*listed("--sort", "start")[::-1]]
    assert len(both) == 2
    numbers = {"longitude": said.phi0_deg, "wind": said.v_sw_km_s, "distance": 140.0}
    numbers |= {"area": said.area68_rsun2, "frequency": 1.0}
    for name, value in numbers.items():
        assert value is not None
        around = (f"--{name}-min", f"{value - 1}", f"--{name}-max", f"{value + 1}")
        assert BURST_ID in listed(*around), name
    assert listed("--longitude-min", f"{numbers['longitude'] + 1}", "--longitude-max", "-170") == []
    assert listed("--wind-min", f"{numbers['wind'] + 1}") == []
    assert listed("--area-max", f"{numbers['area'] - 1}") == []
    assert listed("--distance-min", "200") == listed("--frequency-min", "3") == listed("--latitude-min", "1") == []
    assert listed("--latitude-max", "1") == listed("--frequency-max", "0.1") == listed("--distance-max", "2") == []
    assert listed("--flag", "multimodal") == listed("--updated-since", "2012-01-01", "--flag", "multimodal") != []
    assert listed("--tier", "final", "--edge", "half_maximum", "--method", "posterior") == both
    assert listed("--updated-since", "2999-01-01") == listed("--method", "nuts") == []
    assert "--flag 'beauty': give one of" in str(fault_of(bella("catalogue", "list", "--flag", "beauty")))
    assert "sort: 'beauty' is not known" in str(fault_of(bella("catalogue", "list", "--sort", "beauty")))


def test_pruning_takes_the_draws_of_superseded_solutions_alone(bella: Command, settings: Settings) -> None:
    from bella.store import open_group, sweep

    with Catalogue.open(settings.catalogue_url) as catalogue:
        old = published(settings, catalogue)
        new = published(settings, catalogue, inputs_hash="b" * 64)
    before = open_group(settings.store_root, old.store_path).load()
    planned = json.loads(bella("prune", "--older-than", "0d", "--dry-run", "--json").output)
    assert planned == [{"solution_id": old.solution_id, "draws": before.sizes["draw"]}]
    assert "1 superseded solutions lost their draws" in bella("prune", "--older-than", "0h").output
    assert json.loads(bella("prune", "--older-than", "0d", "--json").output) == []
    with Catalogue.open(settings.catalogue_url) as catalogue:
        pruned, kept = catalogue.solution(old.solution_id), catalogue.solution(new.solution_id)
        sweep(settings.store_root, catalogue.referenced_paths(), 0.0)
    assert pruned.pruned_utc is not None
    assert (kept.pruned_utc, kept.store_path) == (None, new.store_path)
    after = open_group(settings.store_root, pruned.store_path)
    assert "draw" not in after.dims
    assert {"arrival_s", "x_rsun", "y_rsun"} <= set(after.variables)
    assert after.attrs == before.attrs
    assert (after["arrival_s"] == before["arrival_s"]).all()
    assert not (settings.store_root / old.store_path).exists()
    assert (settings.store_root / new.store_path).is_file()


def test_groups_of_older_versions_become_files_and_nothing_else_changes(bella: Command, settings: Settings) -> None:
    from bella.store import open_group, sweep

    with Catalogue.open(settings.catalogue_url) as catalogue:
        solutions = publish_event(settings, catalogue)
        before = catalogue.stored_groups()
        assert len(before) == 3
        for path in (one.store_path for one in before):
            folder = path.removesuffix(".zip")
            with zipfile.ZipFile(settings.store_root / path) as packed:
                packed.extractall(settings.store_root / folder)
            (settings.store_root / path).unlink()
            catalogue.note_packed(path, folder)
        assert catalogue.referenced_paths() == {one.store_path.removesuffix(".zip") for one in before}
        burst_id = solutions[0].burst_id
        assert catalogue.burst(burst_id).preferred.store_path.endswith(".zarr")
        fault = fault_of(bella("store", "verify"))
        assert (fault.exit_code, "3 of 3 groups are damaged" in str(fault)) == (1, True)
        assert "run `bella store pack` once" in bella("store", "verify", "--json").output
        said = bella("store", "pack").output.splitlines()[-1]
        assert said.startswith("3 of 3 groups were folders and are files now")
        assert catalogue.stored_groups() == before
        read_again = catalogue.burst(burst_id)
        assert read_again.preferred.store_path.endswith(".zip")
        assert str(read_again.burst.spectra_path).endswith(".zip")
        assert [catalogue.solution(one.solution_id) for one in solutions] == solutions
        assert "0 of 3 groups were folders" in bella("store", "pack").output
        assert "3 groups in " in bella("store", "verify").output
        assert open_group(settings.store_root, before[0].store_path, before[0].sha256).sizes["draw"] > 0
        swept = sweep(settings.store_root, catalogue.referenced_paths(), 0.0)
    assert set(swept) == {one.store_path.removesuffix(".zip") for one in before}


def test_packing_goes_on_after_a_kill_and_after_a_damaged_folder_was_restored(
    bella: Command, settings: Settings
) -> None:
    from bella.store import packed_folder, place_group

    with Catalogue.open(settings.catalogue_url) as catalogue:
        path = published(settings, catalogue).store_path
        folder = path.removesuffix(".zip")
        with zipfile.ZipFile(settings.store_root / path) as packed:
            packed.extractall(settings.store_root / folder)
        (settings.store_root / path).unlink()
        catalogue.note_packed(path, folder)
        part = max((settings.store_root / folder).rglob("c/**/*"), key=lambda one: one.is_file() and one.stat().st_size)
        whole = part.read_bytes()
        part.write_bytes(whole[:-5] + bytes(5))
        fault = fault_of(bella("store", "pack"))
        assert (fault.exit_code, "restore it from a backup" in str(fault)) == (1, True)
        assert catalogue.stored_groups()[0].store_path == folder
        part.write_bytes(whole)
        place_group(packed_folder(settings.store_root, folder), settings.store_root, path)  # and then it was killed
        assert "1 of 1 groups were folders" in bella("store", "pack").output
        assert catalogue.stored_groups()[0].store_path == path
    assert "1 groups in " in bella("store", "verify").output


def test_pruning_on_a_full_disk_changes_nothing_and_goes_on_with_room(
    bella: Command, settings: Settings, tmp_path: Path
) -> None:
    with Catalogue.open(settings.catalogue_url) as catalogue:
        old = published(settings, catalogue)
        published(settings, catalogue, inputs_hash="b" * 64)
        staging = settings.store_root / STAGING
        with small_disk_at(staging.with_name("full"), 8192) as full:
            shutil.rmtree(staging)
            staging.symlink_to(full)
            fault = fault_of(bella("prune", "--older-than", "0d"))
            assert (fault.exit_code, "No space left on device" in str(fault)) == (1, True)
            kept = catalogue.solution(old.solution_id)
            assert (kept.store_path, kept.pruned_utc) == (old.store_path, None)
            assert list(full.iterdir()) == []
            staging.unlink()
        assert "1 superseded solutions lost their draws" in bella("prune", "--older-than", "0d").output
        assert catalogue.solution(old.solution_id).pruned_utc is not None


@pytest.mark.parametrize("text", ["", "180", "-1d", "1.5d", "for ever"])
def test_a_duration_that_is_none_says_how_to_write_it(bella: Command, text: str) -> None:
    assert "write 180d, 12h or 26w" in str(fault_of(bella("prune", "--older-than", text)))
