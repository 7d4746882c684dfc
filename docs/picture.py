"""Photograph the page of the built-in burst for README and the front page: ``make picture``, after ``make demo``."""

import io
import shutil
import socket
import subprocess
import sys
from pathlib import Path

from PIL import Image
from playwright.sync_api import sync_playwright

PAGE = Path(__file__).with_name("burst.png")
SIZE = {"width": 1280, "height": 860}
READY_MS = 60_000


def main() -> None:
    """Serve the home folder, photograph the page, and write it small."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
    server = subprocess.Popen([str(Path(sys.executable).with_name("bella")), "serve", "--port", port])
    try:
        with sync_playwright() as browsers:
            browser = browsers.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
            page = browser.new_page(viewport=SIZE)
            while True:
                try:
                    page.goto(f"http://127.0.0.1:{port}/bursts/T3-20120607-1929", timeout=READY_MS)
                    break
                except Exception as error:
                    if "ERR_CONNECTION_REFUSED" not in str(error):
                        raise
                    page.wait_for_timeout(500)
            page.wait_for_load_state("networkidle", timeout=READY_MS)
            shot = Image.open(io.BytesIO(page.screenshot()))
            browser.close()
        shot.convert("RGB").save(PAGE, optimize=True)
    finally:
        server.terminate()
        server.wait()


if __name__ == "__main__":
    main()
