"""Pictures of HTML files by a browser without a window."""

import shutil
import subprocess
import tempfile
from pathlib import Path

from uvms_drake.common.errors import RunFailed

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")


def find_browser() -> str | None:
    """Returns the path of a Chromium, if there is one."""
    return next((path for name in BROWSERS if (path := shutil.which(name))), None)


def take_screenshot(html: Path, png: Path, size: tuple[int, int] = (1280, 720),
                    seconds: float = 3.0) -> list[str]:
    """Writes the picture of a page and returns what the page said on the browser's console.

    Args:
        html: The page.
        png: The picture.
        size: Width and height [pixels].
        seconds: For how long the page runs before [s of its own time].

    Raises:
        RunFailed: There is no browser, or it did not write the picture.
    """
    browser = find_browser()
    if browser is None:
        raise RunFailed(f"no browser found: one of {', '.join(BROWSERS)} is needed")
    png.unlink(missing_ok=True)
    with tempfile.TemporaryDirectory() as profile:
        done = subprocess.run(
            [browser, "--headless", "--no-sandbox", "--use-angle=swiftshader",
             "--enable-unsafe-swiftshader", "--hide-scrollbars", "--enable-logging=stderr", "--v=0",
             f"--user-data-dir={profile}", f"--window-size={size[0]},{size[1]}",
             f"--virtual-time-budget={round(1e3 * seconds)}", f"--screenshot={png.resolve()}",
             html.resolve().as_uri()],
            capture_output=True, text=True, check=False, timeout=120.0)
    if not png.is_file():
        raise RunFailed(f"{browser} wrote no picture of {html}")
    return [line.split("CONSOLE", 1)[1] for line in done.stderr.splitlines() if "CONSOLE" in line]
