"""A light installation: what an extra brings and is not there is named in one line."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from bella.exceptions import EXTRA_OF

PYPROJECT = Path(__file__).parents[1] / "pyproject.toml"
BLOCKED = "import sys; sys.modules[{package!r}] = None; "


def run_without(package: str, code: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", BLOCKED.format(package=package) + code], capture_output=True, text=True, check=False
    )


@pytest.mark.parametrize(
    ("package", "arguments"),
    [("sqlalchemy", ["catalogue", "list"]), ("fastapi", ["serve", "--port", "65501"]), ("prefect", ["run"])],
)
def test_a_command_without_its_packages_is_one_line(package: str, arguments: list[str], tmp_path: str) -> None:
    done = run_without(
        package, f"from bella.cli import main; sys.argv[1:] = {[*arguments, '--home', str(tmp_path)]!r}; main()"
    )
    lines = [line for line in done.stderr.splitlines() if line.startswith("bella: ")]
    assert done.returncode == 1
    assert lines == [f"bella: the package {package} is not installed: pip install 'bella-service[{EXTRA_OF[package]}]'"]
    assert "Traceback" not in done.stderr


USES = {
    "zarr": "import bella.store",
    "matplotlib": "from bella.plotting.export import _fonts; _fonts()",
    "pymc": "from bella.multilateration import nuts; nuts._library('pymc')",
    "pyarrow": "from bella.formats.binary import parquet; parquet(None)",
    "radiospectra": "from bella.spectra import to_radiospectra; to_radiospectra(None)",
}
TRIED = """
import sys
sys.modules.update(dict.fromkeys({uses}))
for code in {uses}.values():
    try:
        exec(code)
    except Exception as error:
        print(type(error).__name__, error)
"""


def test_a_function_without_its_package_names_the_extra() -> None:
    code = TRIED.format(uses=USES)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    for package, line in zip(USES, done.stdout.splitlines(), strict=True):
        assert line.startswith("MissingExtraError"), line
        assert line.endswith(f"pip install 'bella-service[{EXTRA_OF[package]}]'"), line


def test_the_extra_that_is_named_brings_the_package() -> None:
    extras = tomllib.loads(PYPROJECT.read_text())["project"]["optional-dependencies"]
    for package, extra in EXTRA_OF.items():
        assert package in {re.split(r"[^\w-]", one)[0] for one in extras[extra]}, package
