"""Figures for the screen cost no plotting library."""

import subprocess
import sys


def test_the_room_is_imported_without_matplotlib() -> None:
    code = "import sys, bella.plotting; print(sorted({'matplotlib', 'PIL'} & set(sys.modules)))"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"
