"""docker-compose.yml and the Dockerfiles, as far as they can be held to account without a container engine."""

import os
import re
import shutil
import subprocess
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
import yaml
from typer.testing import CliRunner

import bella
from bella.cli import app
from bella.settings import Settings
from tests.service_processes.compose import FILE, ROOT, VARIABLE, composed, interpolated, services
from tests.service_processes.postgres import statements_at_first_start

SCALE = ROOT / "docker-compose.scale.yml"
SERVICES = sorted(services())
OURS = ("prefect", "fetcher", "worker", "api")
READERS = ("fetcher", "worker", "api")
DOCKERFILES = {"flows": ROOT / "flows" / "Dockerfile", "api": ROOT / "api" / "Dockerfile"}
FIELDS = {f"BELLA_{name.upper()}" for name in Settings.model_fields}
PASSWORD = {"BELLA_DB_PASSWORD": "aPasswordOfATest"}


def client() -> list[str]:
    """A compose client: of both kinds, the one that is here."""
    for command in (["docker", "compose"], ["docker-compose"]):
        version = [*command, "version"]
        if shutil.which(command[0]) and not subprocess.run(version, capture_output=True, check=False).returncode:
            return command
    pytest.skip("neither `docker compose` nor docker-compose is installed")


def config(**variables: str) -> "subprocess.CompletedProcess[str]":
    environment = {name: value for name, value in os.environ.items() if not name.startswith("BELLA_")} | variables
    command = [*client(), "--file", str(FILE), "config"]
    return subprocess.run(command, env=environment, cwd="/", capture_output=True, text=True, check=False)


def stages(dockerfile: Path) -> list[list[str]]:
    """Instructions of each stage; comments are left out, continued lines joined."""
    text = re.sub(r"^#.*\n", "", dockerfile.read_text(encoding="utf-8"), flags=re.MULTILINE)
    lines = [line for line in re.sub(r"\s*\\\n\s*", " ", text).splitlines() if line]
    starts = [row for row, line in enumerate(lines) if line.startswith("FROM ")]
    return [lines[start:stop] for start, stop in zip(starts, [*starts[1:], len(lines)], strict=True)]


def test_client_accepts_the_file() -> None:
    checked = config(**PASSWORD)
    assert checked.returncode == 0, checked.stderr


def test_client_accepts_more_machines_beside_it() -> None:
    both = ["--file", str(FILE), "--file", str(SCALE)]
    environment = {name: value for name, value in os.environ.items() if not name.startswith("BELLA_")} | PASSWORD
    command = [*client(), *both, "config"]
    done = subprocess.run(command, env=environment, cwd="/", capture_output=True, text=True, check=True)
    merged = yaml.safe_load(done.stdout)["services"]
    address = merged["worker"]["environment"]["BELLA_DASK"]
    assert address in merged["compute"]["command"]
    assert urlsplit(address).hostname == "scheduler"
    assert str(urlsplit(address).port) in merged["scheduler"]["command"]
    for name in ("scheduler", "compute"):
        assert merged[name]["image"] == merged["worker"]["image"]
        assert (merged[name]["read_only"], merged[name]["cap_drop"]) == (True, ["ALL"])
        assert merged[name]["security_opt"] == ["no-new-privileges:true"]
        assert merged[name]["user"] == merged["worker"]["user"]
        assert list(merged[name]["networks"]) == ["inside"]
        assert find_spec(merged[name]["command"][2]) is not None
    compute = yaml.safe_load(SCALE.read_text(encoding="utf-8"))["services"]["compute"]
    assert set(compute["volumes"]) <= set(services()["worker"]["volumes"])


def test_client_asks_for_the_password() -> None:
    refused = config()
    assert refused.returncode != 0
    assert "set it in .env" in refused.stderr


@pytest.mark.parametrize("name", SERVICES)
def test_service_comes_back_and_says_how_it_is(name: str) -> None:
    service = services()[name]
    assert service["restart"] == "unless-stopped"
    assert service["healthcheck"]["test"][0] == "CMD"
    assert {"interval", "timeout", "retries", "start_period"} <= set(service["healthcheck"])


@pytest.mark.parametrize("name", SERVICES)
def test_service_may_do_no_more_than_it_needs(name: str) -> None:
    service = services()[name]
    assert str(service["user"]).split(":")[0] not in {"root", "0"}
    assert service["read_only"] is True
    assert "/tmp" in service["tmpfs"]
    assert service["cap_drop"] == ["ALL"]
    assert "no-new-privileges:true" in service["security_opt"]
    assert "privileged" not in service


@pytest.mark.parametrize("name", SERVICES)
def test_image_has_a_tag_that_stays(name: str) -> None:
    image, _, tag = services()[name]["image"].rpartition(":")
    assert re.fullmatch(r"[\d.]+(-\w+)?", tag), f"{image}: {tag!r}"
    if name in OURS:
        assert tag == bella.__version__


@pytest.mark.parametrize("name", SERVICES)
def test_service_waits_until_what_it_needs_is_healthy(name: str) -> None:
    needed: dict[str, Any] = services()[name].get("depends_on", {})
    assert set(needed) <= set(services())
    assert all(rule == {"condition": "service_healthy"} for rule in needed.values())
    assert (name == "database") == (needed == {})


def test_commands_can_be_run() -> None:
    for name in ("prefect", "worker", "api"):
        python, minus_m, module, *_ = services()[name]["command"]
        assert (python, minus_m) == ("python", "-m")
        assert find_spec(module) is not None
    bella_command, *words = services()["fetcher"]["command"]
    assert bella_command == "bella"
    assert CliRunner().invoke(app, [*words, "--from", "2012-06-07"]).exception is not None
    assert CliRunner().invoke(app, [words[0], "--help"]).exit_code == 0


@pytest.mark.parametrize("name", READERS)
def test_every_setting_is_passed_on_and_nothing_else(name: str) -> None:
    given = {variable for variable in services()[name]["environment"] if variable.startswith("BELLA_")}
    assert given == FIELDS


def test_all_read_the_same_settings() -> None:
    fetcher, *others = ({field: services()[name]["environment"][field] for field in FIELDS} for name in READERS)
    assert others == [fetcher, fetcher]


def test_api_may_change_the_incoming_tables_only() -> None:
    mounts = dict(mount.split(":", 1) for mount in services()["api"]["volumes"])
    assert mounts == {
        "home": "/var/lib/bella:ro",
        "incoming": f"/var/lib/bella/{Settings().incoming_root.name}",
        "mirror": f"/var/lib/bella/{Settings().mirror_root.name}:ro",
    }
    assert set(composed()["volumes"]) == {"database", *mounts}


def test_fetcher_alone_changes_the_mirror_and_may_change_nothing_else() -> None:
    mirror = f"/var/lib/bella/{Settings().mirror_root.name}"
    assert services()["fetcher"]["volumes"] == [f"mirror:{mirror}"]
    assert f"mirror:{mirror}:ro" in services()["worker"]["volumes"]
    given = services()["fetcher"]["environment"]
    for name in ("BELLA_IN_SITU", "BELLA_REGIONS", "BELLA_EVENTS"):
        assert interpolated(given[name], {}).startswith(f"{mirror}/")
    extension = Settings(home=Path("/var/lib/bella")).ephemeris_extension
    assert extension.is_relative_to(mirror)
    assert int(interpolated(given["BELLA_RECENT_DAYS"], {})) > 125  # the last data come after four months


def test_api_listens_on_this_machine_only_unless_told_otherwise() -> None:
    published = {name: service["ports"] for name, service in services().items() if "ports" in service}
    assert list(published) == ["api"]
    assert [interpolated(port, {}) for port in published["api"]] == ["127.0.0.1:8000:8000"]
    assert composed()["networks"]["inside"] == {"internal": True}
    assert [name for name in SERVICES if services()[name]["networks"] != ["inside"]] == ["api", "fetcher"]


def test_nothing_calls_home() -> None:
    for name in OURS:
        assert services()[name]["environment"]["DO_NOT_TRACK"] == "1"
    for name in ("prefect", "worker"):
        assert services()[name]["environment"]["PREFECT_SERVER_ANALYTICS_ENABLED"] == "false"


def test_prefect_keeps_its_tables_in_a_database_that_is_made_at_first_start() -> None:
    url = services()["prefect"]["environment"]["PREFECT_API_DATABASE_CONNECTION_URL"]
    assert url.startswith("postgresql+asyncpg://")
    assert statements_at_first_start() == [f"CREATE DATABASE {url.rsplit('/', 1)[1]}"]
    assert find_spec("asyncpg") is not None


def test_no_secret_stands_in_the_file() -> None:
    text = FILE.read_text(encoding="utf-8")
    assert re.findall(r"://\w+:(?!\$\{BELLA_DB_PASSWORD:\?)[^/]*@", text) == []
    assert services()["database"]["environment"]["POSTGRES_PASSWORD"].startswith("${BELLA_DB_PASSWORD:?")


def test_example_of_env_names_every_variable_with_its_default() -> None:
    text = (ROOT / ".env.example").read_text(encoding="utf-8")
    named = dict(re.findall(r"^(?:# )?(BELLA_\w+)=(.*)$", text, flags=re.MULTILINE))
    left_open = {name for name, value in services()["worker"]["environment"].items() if value is None}
    filled_in = {match["name"]: match["word"] or "" for match in VARIABLE.finditer(FILE.read_text(encoding="utf-8"))}
    assert set(named) == left_open | set(filled_in)
    for name in left_open:
        field = name.removeprefix("BELLA_").lower()
        default = Settings.model_fields[field].default
        stated = getattr(Settings(**{field: named[name]}), field) if default is not None else named[name] or None
        assert stated == default
    assert named["BELLA_DB_PASSWORD"] == ""
    defaults = {name: word for name, word in filled_in.items() if name != "BELLA_DB_PASSWORD"}
    assert {name: named[name] for name in defaults} == defaults


@pytest.mark.parametrize("room", DOCKERFILES)
def test_dockerfile_installs_the_lock_and_ends_as_an_ordinary_user(room: str) -> None:
    build, final = stages(DOCKERFILES[room])
    assert re.fullmatch(r"FROM python:3\.\d+-slim-\w+ AS build", build[0])
    assert f"{final[0]} AS build" == build[0]
    assert any("--require-hashes" in line and "runtime.txt" in line for line in build)
    users = [line.split()[1] for line in final if line.startswith("USER ")]
    assert users == [services()["worker"]["user"]] == [services()["api"]["user"]] == [services()["fetcher"]["user"]]
    assert "http" not in " ".join([*build, *final])


def test_both_dockerfiles_build_in_the_same_way() -> None:
    (flows, _), (api, _) = (stages(path) for path in DOCKERFILES.values())
    assert flows == api


@pytest.mark.parametrize("room", DOCKERFILES)
def test_what_is_copied_exists_and_is_not_ignored(room: str) -> None:
    lines = (ROOT / ".dockerignore").read_text(encoding="utf-8").splitlines()
    let_in = {line.removeprefix("!") for line in lines if line.startswith("!")}
    copies = [line.split()[1:-1] for line in stages(DOCKERFILES[room])[0] if line.startswith("COPY ")]
    copied = {source for sources in copies for source in sources}
    assert copied == let_in
    assert "*" in lines
    assert [source for source in copied if not (ROOT / source).exists()] == []


def test_images_run_what_compose_runs() -> None:
    for room, name in (("flows", "worker"), ("api", "api")):
        command = next(line for line in stages(DOCKERFILES[room])[1] if line.startswith("CMD "))
        assert re.findall(r'"([^"]*)"', command) == [str(word) for word in services()[name]["command"]]
