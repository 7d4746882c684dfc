"""Figures for the screen cost no plotting library."""

import subprocess
import sys

from bella.plotting import plotly_script, plotly_version


def test_the_room_is_imported_without_matplotlib_and_plotly() -> None:
    code = "import sys, bella.plotting; print(sorted({'matplotlib', 'plotly'} & set(sys.modules)))"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"


def test_the_drawing_script_is_there() -> None:
    assert plotly_script().stat().st_size > 1_000_000
    assert plotly_version().count(".") >= 1
