"""Makes the pictures of approach, contact and hold from a finished run.

    uvms-drake run && python examples/screenshots.py out/girona500_contact

It needs a Chromium on the path. The pictures go to the run's folder; `--output` names another one,
`--times` other instants, and `--close` brings the camera near the end-effector.
"""

import argparse
import shutil
import subprocess
import tempfile
from pathlib import Path

from PIL import Image

import uvms_drake as uv
from uvms_drake.report.replay import frame_indices, moment_of, scene_of

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
NAMES = ("approach", "contact", "hold")
SIZE = (1200, 720)  # pixels
CONTROLS = 20  # pixels, height of Meshcat's bar at the top, which is cut off


def main() -> None:
    """Makes the pictures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, metavar="DIR", help="folder of a finished run")
    parser.add_argument("--output", type=Path, metavar="DIR", help="default: the run's folder")
    parser.add_argument("--times", type=float, nargs=3, default=[3.0, 6.9, 12.0], metavar="S")
    parser.add_argument("--close", action="store_true", help="close to the end-effector")
    arguments = parser.parse_args()
    record = uv.load_record(arguments.folder)
    output = arguments.output or arguments.folder
    output.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        html = Path(folder) / "still.html"
        for name, time in zip(NAMES, arguments.times, strict=True):
            write_still(record, time, html, close=arguments.close)
            png = output / f"{name}.png"
            take_screenshot(html, png, SIZE)
            with Image.open(png) as image:
                image.convert("RGB").crop((0, CONTROLS, *SIZE)).save(png, optimize=True)
            print(f"{png}: t = {time:g} s, {png.stat().st_size / 1000:.0f} kB")


def write_still(record: uv.Record, time: float, path: Path, *, close: bool = False) -> None:
    """Writes the picture of a run at `time` [s], with the trail up to there.

    `close` brings the camera near the end-effector.
    """
    meshcat = uv.open_meshcat()
    scene = scene_of(record, meshcat)
    so_far = record.time[record.time <= time + 1e-9]
    for i in frame_indices(so_far, record.scenario.visual.rate):
        scene.show(moment_of(record, i), record.time[i])
    if close:
        scene.look_closely(record.chi[i, :3])
    path.write_text(meshcat.StaticHtml(), encoding="utf-8")


def find_browser() -> str | None:
    """Returns the path of a Chromium, if there is one."""
    return next((path for name in BROWSERS if (path := shutil.which(name))), None)


def take_screenshot(html: Path, png: Path, size: tuple[int, int] = (1280, 720),
                    seconds: float = 3.0) -> list[str]:
    """Writes the picture of a page and returns the messages on the browser's console.

    Args:
        html: The page.
        png: The picture.
        size: Width and height [pixels].
        seconds: Time that the page runs before [s of its own time].

    Raises:
        RunFailed: There is no browser, or it did not write the picture.
    """
    browser = find_browser()
    if browser is None:
        raise uv.RunFailed(f"no browser found: one of {', '.join(BROWSERS)} is needed")
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
        raise uv.RunFailed(f"{browser} wrote no picture of {html}")
    return [line.split("CONSOLE", 1)[1] for line in done.stderr.splitlines() if "CONSOLE" in line]


if __name__ == "__main__":
    main()
