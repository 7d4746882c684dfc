"""docker-compose.yml as the tests read it: what a service runs, with which variables, and how its health is asked."""

import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import yaml

ROOT = Path(__file__).parents[2]
FILE = ROOT / "docker-compose.yml"
VARIABLE = re.compile(r"\$\{(?P<name>\w+)(?:(?P<rule>:?[-?])(?P<word>[^}]*))?\}")


@cache
def composed() -> dict[str, Any]:
    """Content of the file, with its variables still in it."""
    content: dict[str, Any] = yaml.safe_load(FILE.read_text(encoding="utf-8"))
    return content


def services() -> dict[str, dict[str, Any]]:
    found: dict[str, dict[str, Any]] = composed()["services"]
    return found


def interpolated(text: str, variables: Mapping[str, str]) -> str:
    """Text with its variables filled in; one that must be set, and is not, is an error."""

    def value(match: re.Match[str]) -> str:
        name, rule, word = match["name"], match["rule"] or "", match["word"] or ""
        given = variables.get(name, "")
        if not given and "?" in rule:
            raise KeyError(f"{name}: {word}")
        return given or word

    return VARIABLE.sub(value, text)


@dataclass(frozen=True)
class Places:
    """Where a test puts what the services find at other places in their containers.

    Attributes
    ----------
    moved : mapping of str to str
        Text that stands in the file, and what stands there in its place.
    variables : mapping of str to str
        What an operator writes into .env.
    """

    moved: Mapping[str, str]
    variables: Mapping[str, str]

    def command(self, service: str, port: int | None = None) -> list[str]:
        """Command of a service, for this machine: on the loopback, on a free port, with this interpreter."""
        words = [str(word) for word in services()[service]["command"]]
        for option, value in (("--host", "127.0.0.1"), ("--port", str(port))):
            if option in words:
                words[words.index(option) + 1] = value
        return [_program(words[0]), *words[1:]]

    def environment(self, service: str) -> dict[str, str]:
        """Variables of a service; those the file leaves open come from `variables`, or are not set."""
        given = services()[service]["environment"]
        filled = {name: self.variables.get(name) if value is None else str(value) for name, value in given.items()}
        return {name: self._here(value) for name, value in filled.items() if value is not None}

    def health_check(self, service: str, port: int | None = None) -> list[str]:
        """Command that asks for the health of a service."""
        how, program, *words = services()[service]["healthcheck"]["test"]
        assert how == "CMD"
        return [_program(program), *(re.sub(r"127\.0\.0\.1:\d+", f"127.0.0.1:{port}", word) for word in words)]

    def _here(self, value: str) -> str:
        value = interpolated(value, self.variables)
        for there, here in self.moved.items():
            value = value.replace(there, here)
        return value


def _program(name: str) -> str:
    return sys.executable if name == "python" else str(Path(sys.executable).with_name(name))
