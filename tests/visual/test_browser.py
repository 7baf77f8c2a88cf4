"""Replay and report in a real browser without a window."""

import numpy as np
import pytest
import screenshots
from PIL import Image
from support.synthetic import synthetic_record

from uvms_drake.common.errors import RunFailed
from uvms_drake.report.figures import make_figures
from uvms_drake.report.html import format_report
from uvms_drake.report.replay import write_replay
from uvms_drake.station.diagram import setting_of
from uvms_drake.visual.scene import ZOOM, Scene
from uvms_drake.visual.stage import UP, open_meshcat

pytestmark = pytest.mark.slow

SIZE = (960, 600)
FIELD = np.deg2rad(75.0)
"""Meshcat's field of view, from top to bottom, at zoom 1."""

needs_browser = pytest.mark.skipif(
    screenshots.find_browser() is None,
    reason=f"none of {', '.join(screenshots.BROWSERS)} is installed")


@pytest.fixture(scope="module")
def record():
    return synthetic_record(4.0)


@pytest.fixture(scope="module")
def replay(record, tmp_path_factory):
    """The replay after its end: its picture, and the messages of the browser's console."""
    folder = tmp_path_factory.mktemp("replay")
    html, png = folder / "replay.html", folder / "replay.png"
    write_replay(record, html)
    asks = "setTimeout(() => console.log('duration ' + viewer.animator.duration), 1000)"
    text = html.read_text(encoding="utf-8")
    html.write_text(text.replace("</body>", f"<script>{asks}</script></body>"), encoding="utf-8")
    console = screenshots.take_screenshot(html, png, SIZE, seconds=7.0)
    with Image.open(png) as image:
        return np.asarray(image.convert("RGB"), dtype=int), console


def pixel(record, point):
    """Returns column and row of a point (3,) in Σ_I."""
    scene = Scene(open_meshcat(), setting_of(record.scenario, record.model))
    ahead = scene.target - scene.camera
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    ray = np.asarray(point) * UP - scene.camera
    scale = 0.5 * SIZE[1] * ZOOM / np.tan(0.5 * FIELD) / (ray @ ahead)
    return (round(0.5 * SIZE[0] + scale * (ray @ right)),
            round(0.5 * SIZE[1] - scale * (ray @ np.cross(right, ahead))))


def color(picture, record, point):
    """Returns the colour (3,) about a point in Σ_I."""
    column, row = pixel(record, point)
    return np.median(picture[row - 2: row + 3, column - 2: column + 3], axis=(0, 1))


def is_yellow(rgb):
    return bool(rgb[0] > 150 and rgb[1] > 100 and rgb[2] < 0.75 * rgb[1])


@needs_browser
def test_the_replay_says_nothing_on_the_console_but_its_duration(replay):
    (line,) = replay[1]
    assert float(line.split("duration ")[1].split('"')[0]) == pytest.approx(4.0, abs=0.041)


@needs_browser
def test_the_vehicle_of_the_replay_is_where_it_is_at_the_end_and_upright(record, replay):
    position = record.config[-1, :3]

    def at(x, y, z):
        return color(replay[0], record, position + [x, y, z])

    upper, lower = (0.35, -0.339), (0.0, 0.361)  # y and z of the starboard and the lower hull
    assert is_yellow(at(0.0, *upper))
    assert is_yellow(at(0.0, *lower))
    assert is_yellow(at(0.62, *upper))
    assert not is_yellow(at(0.62, *lower))  # There is the arm in place of a nose.
    assert not is_yellow(at(0.0, 0.35, -0.65))
    assert not is_yellow(at(0.0, 0.0, 0.65))


@needs_browser
def test_the_wall_and_the_force_can_be_seen(record, replay):
    picture = replay[0]
    beside = color(picture, record, [0.0, 0.62, -0.23])
    wall = color(picture, record, [0.0, 0.45, -0.23])
    assert np.all(wall > beside + 8)
    tip = record.chi[-1, :3]
    red = color(picture, record, tip + [0.12, 0.0, 0.0])
    assert red[0] > 1.3 * max(red[1:])


@needs_browser
def test_the_report_can_be_read(record, tmp_path):
    html, png = tmp_path / "report.html", tmp_path / "report.png"
    html.write_text(format_report(record, make_figures(record, tmp_path), None), encoding="utf-8")
    assert screenshots.take_screenshot(html, png, (1000, 2400), seconds=1.0) == []
    with Image.open(png) as image:
        picture = np.asarray(image.convert("L"))
    written = np.mean(picture < 128, axis=1)  # of each row
    assert np.mean(picture > 250) > 0.7
    assert np.count_nonzero(written) > 800
    assert np.max(np.diff(np.flatnonzero(written))) < 150


def test_without_a_browser_there_is_no_picture(tmp_path, monkeypatch):
    monkeypatch.setattr(screenshots, "find_browser", lambda: None)
    with pytest.raises(RunFailed, match="no browser found: one of chromium, "):
        screenshots.take_screenshot(tmp_path / "page.html", tmp_path / "page.png")
