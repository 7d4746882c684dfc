"""The drawing script of the pages: the file that the installed plotly package brings along."""

from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

from bella.exceptions import StoreError


def plotly_script() -> Path:
    """Path of ``plotly.min.js`` in the installed plotly package, found without importing it.

    Returns
    -------
    Path

    Raises
    ------
    StoreError
        If the package has no such file.
    """
    spec = find_spec("plotly")
    folder = Path(spec.origin).parent if spec and spec.origin else Path()
    script = folder / "package_data" / "plotly.min.js"
    if not script.is_file():
        raise StoreError("the drawing script plotly.min.js is not installed: install the package plotly again")
    return script


def plotly_version() -> str:
    """Version of the installed plotly package; part of the script's address, so that browsers may keep it."""
    return version("plotly")
