"""Makes the pictures of approach, contact and hold from a finished run.

    uvms-drake run && python examples/screenshots.py out/girona500_contact

It needs a Chromium on the path. The pictures go to the run's folder; `--output` names another one,
`--times` other instants.
"""

import argparse
import tempfile
from pathlib import Path

from PIL import Image

from uvms_drake.report.replay import write_still
from uvms_drake.station.record import load_record
from uvms_drake.visual.browser import take_screenshot

NAMES = ("approach", "contact", "hold")
SIZE = (1200, 720)  # pixels
CONTROLS = 20  # pixels, height of Meshcat's bar at the top, which is cut off


def main() -> None:
    """Makes the pictures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, metavar="DIR", help="where 'run' has written")
    parser.add_argument("--output", type=Path, metavar="DIR", help="default: the run's folder")
    parser.add_argument("--times", type=float, nargs=3, default=[0.6, 2.4, 15.0], metavar="S")
    arguments = parser.parse_args()
    record = load_record(arguments.folder)
    output = arguments.output or arguments.folder
    output.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        html = Path(folder) / "still.html"
        for name, time in zip(NAMES, arguments.times, strict=True):
            write_still(record, time, html)
            png = output / f"{name}.png"
            take_screenshot(html, png, SIZE)
            with Image.open(png) as image:
                image.convert("RGB").crop((0, CONTROLS, *SIZE)).save(png, optimize=True)
            print(f"{png}: t = {time:g} s, {png.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
