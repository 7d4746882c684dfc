"""Run the command line as a user does: as a process, in folders of its own."""

import os
import subprocess
import sys
from collections.abc import Mapping
from contextlib import chdir, redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from io import StringIO
from pathlib import Path
from unittest import mock

import pytest
import structlog

from bella.cli import main
from tests.waiting import PATIENCE_S

BELLA = str(Path(sys.executable).with_name("bella"))
KEPT = ("PATH", "LANG", "LC_ALL", *(name for name in os.environ if name.startswith("OPENBLAS_")))
"""With other linear algebra, numbers differ in their last digits, and so results are new."""


@dataclass(frozen=True)
class Sandbox:
    """Folders of a user who has nothing yet.

    Attributes
    ----------
    home : Path
        The product's home folder.
    elsewhere : tuple of Path
        Working, user and temporary folder: nothing may be written there.
    variables : mapping of str to str
        Environment variables that this user has set.
    """

    home: Path
    elsewhere: tuple[Path, Path, Path]
    variables: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def within(cls, folder: Path, **variables: str) -> "Sandbox":
        elsewhere = (folder / "work", folder / "user", folder / "temporary")
        for path in elsewhere:
            path.mkdir(parents=True)
        return cls(folder / "bella-home", elsewhere, variables)

    @property
    def environment(self) -> dict[str, str]:
        kept = {name: os.environ[name] for name in KEPT if name in os.environ}
        _, user, temporary = self.elsewhere
        own = {"HOME": str(user), "TMPDIR": str(temporary), "BELLA_HOME": str(self.home), "COLUMNS": "120"}
        return kept | own | dict(self.variables)

    def run(self, *command: str, code: int | None = 0, **environment: str) -> subprocess.CompletedProcess[str]:
        """Run a command to its end and, unless `code` is None, expect that exit status."""
        done = subprocess.run(
            command,
            cwd=self.elsewhere[0],
            env=self.environment | environment,
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            check=False,
        )
        if code is not None:
            assert done.returncode == code, f"exit {done.returncode}\n{done.stdout}\n{done.stderr}"
        return done

    def bella(self, *arguments: str, code: int | None = 0) -> subprocess.CompletedProcess[str]:
        """Run ``bella`` with arguments."""
        return self.run(BELLA, *arguments, code=code)

    def here(self, *arguments: str, code: int = 0) -> subprocess.CompletedProcess[str]:
        """Run ``bella`` in this process, which spares a start."""
        configured = structlog.get_config()
        with (
            mock.patch.dict(os.environ, self.environment, clear=True),
            mock.patch.object(sys, "argv", ["bella", *arguments]),
            chdir(self.elsewhere[0]),
            redirect_stdout(StringIO()) as stdout,
            redirect_stderr(StringIO()) as stderr,
            pytest.raises(SystemExit) as ended,
        ):
            main()
        structlog.configure(**configured)
        assert ended.value.code == code, f"exit {ended.value.code}\n{stdout.getvalue()}\n{stderr.getvalue()}"
        return subprocess.CompletedProcess(arguments, code, stdout.getvalue(), stderr.getvalue())

    def files_elsewhere(self) -> list[Path]:
        """Files outside the home folder."""
        return [path for folder in self.elsewhere for path in folder.rglob("*") if path.is_file()]
