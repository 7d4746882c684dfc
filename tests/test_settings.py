"""Settings: each documented, each set by its environment variable."""

from pathlib import Path

import pytest
from pydantic import ValidationError

from bella.exceptions import InputError
from bella.settings import Settings, read_settings

FIELDS = list(Settings.model_fields)


@pytest.mark.parametrize("name", FIELDS)
def test_every_setting_says_what_it_is(name) -> None:
    description = Settings.model_fields[name].description

    assert description
    assert description.endswith(".")
    assert len(description) > 20


@pytest.mark.parametrize("name", FIELDS)
def test_every_setting_has_an_environment_variable(name, monkeypatch) -> None:
    default = getattr(Settings(), name)
    monkeypatch.setenv(f"BELLA_{name.upper()}", "/elsewhere/7" if name == "root_path" else _other(default))

    value = getattr(Settings(), name)
    assert value != default
    assert str(value) in {"/elsewhere/7", "7", "7.0", "True"}


def _other(default: object) -> str:
    """Text of a value that is not the default."""
    if isinstance(default, bool):
        return "1"
    return "/elsewhere/7" if isinstance(default, Path | None) else "7"


def test_the_catalogue_is_a_file_in_the_home_folder_unless_a_database_is_named(monkeypatch, tmp_path) -> None:
    monkeypatch.delenv("BELLA_DATABASE_URL", raising=False)
    monkeypatch.chdir(tmp_path)

    assert Settings(home=Path("here")).catalogue_url == f"sqlite:///{tmp_path.resolve()}/here/catalogue.sqlite"
    assert Settings(home=tmp_path, database_url="").catalogue_url.startswith("sqlite:///")
    url = "postgresql+psycopg://user@host/bella"
    monkeypatch.setenv("BELLA_DATABASE_URL", url)
    assert Settings(home=tmp_path).catalogue_url == url


def test_an_empty_variable_names_no_folder(monkeypatch) -> None:
    monkeypatch.setenv("BELLA_IN_SITU", "")
    monkeypatch.setenv("BELLA_REGIONS", "")
    assert (Settings().in_situ, Settings().regions) == (None, None)


def test_everything_is_kept_below_the_home_folder(tmp_path) -> None:
    settings = Settings(home=tmp_path)
    roots = [settings.store_root, settings.figures_root, settings.incoming_root, settings.cache_root]

    assert all(root.parent == tmp_path for root in roots)
    assert len(set(roots)) == len(roots)


@pytest.mark.parametrize(
    ("name", "value"),
    [("draws", 0), ("draws", "many"), ("lease_s", -1), ("max_pending_submissions", 0), ("schedule_s", 0)],
)
def test_senseless_values_are_refused(name, value) -> None:
    with pytest.raises(ValidationError, match=name):
        Settings(**{name: value})


def test_foreign_variables_do_no_harm(monkeypatch) -> None:
    for name in ("BELLA_REFERENCE_FILES", "BELLA_PORT", "BELLA_DB_PASSWORD", "BELLA_HOMEPAGE", "OTHER_RECNT_DAYS"):
        monkeypatch.setenv(name, "/nowhere")
    assert read_settings().draws > 0


def test_a_setting_whose_name_is_misspelt_is_not_passed_over(monkeypatch) -> None:
    monkeypatch.setenv("BELLA_RECNT_DAYS", "3")
    with pytest.raises(
        InputError, match=r"^BELLA_RECNT_DAYS is no setting: BELLA_RECENT_DAYS is; correct or unset it$"
    ):
        read_settings()


@pytest.mark.parametrize(("name", "value"), [("BELLA_DRAWS", "abc"), ("BELLA_RECENT_DAYS", "-1")])
def test_a_wrong_variable_is_named_in_one_line(monkeypatch, name: str, value: str) -> None:
    monkeypatch.setenv(name, value)
    with pytest.raises(InputError, match=f"^{name} is '{value}': .*; correct or unset it$"):
        read_settings()
