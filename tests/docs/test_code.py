"""Code in README and in the pages of the documentation is run, and its commands exist."""

import doctest
import gc
import importlib.util
import re
import shutil
import textwrap
from datetime import date
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest
from typer.main import get_command
from typer.testing import CliRunner

from bella.arrivals import arrivals_csv
from bella.bursts import published_arrivals
from bella.cli import app
from bella.pipeline.release import Wanted, make_release
from bella.settings import Settings
from bella.simulation.archive_days import simulate_days
from bella.spectra import open_spectra

mpl.use("Agg")
ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
MADE = {DOCS / "_build", DOCS / "gallery"}
PAGES = [path for path in sorted(DOCS.rglob("*.md")) if not MADE & set(path.parents)]
SERVICE = "http://127.0.0.1:8000"
OPTIONAL = {"hapiclient": "hapiclient", "sunpy.net": "zeep"}
"""What an example may import that the tests can do without, and the package to look for."""

NOT_RUN = re.compile(r"<!-- not run: [^>]+ -->\s*\Z")


def blocks(page: Path, language: str) -> list[str]:
    """Blocks of code of a page, but for those that say why they cannot be run."""
    text = page.read_text(encoding="utf-8")
    found = re.finditer(rf"^( *)```{language}\n(.*?)^ *```$", text, flags=re.MULTILINE | re.DOTALL)
    return [textwrap.dedent(one[2]) for one in found if not NOT_RUN.search(text[: one.start()])]


def can_run(block: str) -> bool:
    """Whether the optional packages that a block imports are here."""
    return all(importlib.util.find_spec(needed) for used, needed in OPTIONAL.items() if f"from {used}" in block)


def put_files(page: Path, home: Settings) -> None:
    """Put the files that a page reads into the working folder."""
    if page.name == "python.md":  # its results are printed on the page
        Path("arrivals.csv").write_text(arrivals_csv(published_arrivals(np.array([0.25, 0.5, 1.0]))))
    elif page.name == "spectra.md":
        simulate_days(Path("archive"), [date(2010, 1, 17)], 1, ["WI_H1_WAV"])
        file = next(Path("archive").rglob("*.cdf"))
        shutil.copy(file, ".")
        Path("my-spectra").mkdir()
        open_spectra(file)[1].to_netcdf("my-spectra/wind.nc", engine="h5netcdf")
    elif page.name == "releases.md":
        Path("releases").mkdir()
        make_release(home, Wanted("2026.1"), Path("releases"))
    else:
        shutil.copy(DOCS / "examples" / "arrivals.csv", ".")


def name(page: Path) -> str:
    return str(page.relative_to(ROOT))


# the downloader of SunPy leaves an event loop open
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("page", [page for page in PAGES if blocks(page, "python")], ids=name)
def test_python_of_a_page_runs(
    page: Path, address: str, filled: Settings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    put_files(page, filled)
    whole = "\n".join(one for one in blocks(page, "python") if can_run(one)).replace(SERVICE, address)
    if ">>> " in whole:
        options = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS
        test = doctest.DocTestParser().get_doctest(whole, {}, page.name, str(page), 0)
        assert doctest.DocTestRunner(optionflags=options).run(test).failed == 0
    else:
        exec(compile(whole, str(page), "exec"), {})
    plt.close("all")
    gc.collect()  # what is left open belongs to this test, and not to the next one


def commands(page: Path) -> list[list[str]]:
    """Words of every ``bella ...`` in the blocks of shell commands of a page."""
    lines = "\n".join(blocks(page, "sh")).replace("\\\n", " ").splitlines()
    return [line.split(" #")[0].strip().removesuffix("&").split()[1:] for line in lines if line.startswith("bella ")]


@pytest.mark.parametrize("page", [page for page in [ROOT / "README.md", *PAGES] if commands(page)], ids=name)
def test_commands_of_a_page_exist(page: Path) -> None:
    for words in commands(page):
        command, rest = get_command(app), list(words)
        while hasattr(command, "commands"):
            assert rest[0] in command.commands, f"bella {' '.join(words)}"
            command = command.commands[rest.pop(0)]
        known = {option for one in command.params for option in [*one.opts, *one.secondary_opts]}
        options = {word.partition("=")[0] for word in rest if word.startswith("--")}
        assert options <= known, f"bella {' '.join(words)}"
        needed = {one.opts[0] for one in command.params if one.required and one.opts[0].startswith("--")}
        assert needed <= options, f"bella {' '.join(words)}"


def test_commands_of_the_tutorial_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copy(DOCS / "examples" / "arrivals.csv", tmp_path)
    monkeypatch.chdir(tmp_path)
    for words in commands(DOCS / "tutorial.md"):
        done = CliRunner().invoke(app, words)
        assert done.exit_code == 0, done.output
    assert {path.name for path in tmp_path.iterdir()} >= {"localisations.csv", "draws.zarr", "track.json"}


def test_every_page_can_be_reached() -> None:
    reached, waiting = set(), [DOCS / "index.md"]
    while waiting:
        page = waiting.pop()
        reached.add(page)
        for tree in re.findall(r"```\{toctree\}\n(.*?)```", page.read_text(encoding="utf-8"), flags=re.DOTALL):
            names = [re.sub(r".*<(.+)>", r"\1", line) for line in tree.splitlines() if line and line[0] != ":"]
            waiting += [page.parent / f"{one}.md" for one in names if not one.startswith("gallery")]
    assert reached == set(PAGES)


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_pages_name_examples_that_exist(page: Path) -> None:
    for example in re.findall(r"gallery/(plot_\w+)", page.read_text(encoding="utf-8")):
        assert (DOCS / "examples" / f"{example}.py").is_file(), example


def test_every_quirk_stands_in_its_page() -> None:
    spec = importlib.util.spec_from_file_location("tables", DOCS / "tables.py")
    assert spec is not None
    assert spec.loader is not None
    tables = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tables)
    page = tables.with_tables((DOCS / "quirks.md").read_text(encoding="utf-8"))
    assert "| `stereo_minutes` | STEREO-B | 2006-10-27 to 2014-10-01 | A minute averages" in page
    assert "<!-- table" not in page
