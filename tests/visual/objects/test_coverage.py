"""Tests of `uvms_drake.visual.objects.coverage`: places and colours of the dots."""

import numpy as np
import pytest

from uvms_drake.model.surface.plane import UnilateralPlane
from uvms_drake.visual.objects.coverage import COLORS, Coverage, color_of, palette
from uvms_drake.visual.stage import VANISHED, Stage

WALL = UnilateralPlane(normal=np.array([-1.0, 0.0, 0.0]), stiffness=1000.0).checked()
SCALE = 15.0  # N


class Canvas:
    """A Meshcat that keeps the colour, place and scales of every path."""

    def __init__(self):
        self.colors, self.places, self.scales = {}, {}, {}

    def SetObject(self, path, shape, color=None):
        if color is not None:
            self.colors[path.removesuffix("/size/dot")] = (color.r(), color.g(), color.b())

    def SetTransform(self, path, pose, time_in_recording=None):
        self.places[path] = pose.translation()

    def SetProperty(self, path, name, value, time_in_recording=None):
        self.scales.setdefault(path.removesuffix("/size"), []).append((time_in_recording, value[0]))

    def Delete(self, path):
        assert path == "paint"

    def painted(self):
        """Returns (colour, place) of every dot that is seen in the end."""
        return [(palette().index(pytest.approx(self.colors[dot])), self.places[dot])
                for dot, scales in self.scales.items() if scales[-1][1] != VANISHED]


def coverage_of(*touches):
    """Paints, 40 ms after each other, (y [m], force [N])."""
    canvas = Canvas()
    stage = Stage(canvas)
    coverage = Coverage(stage, "paint", "legend", SCALE, WALL.normal)
    for i, (y, force) in enumerate(touches):
        stage.begin(0.04 * i)
        if i == 0:
            coverage.clear()
        chi = np.array([0.001 * max(force, 0.0), y, 0.2, 0.0, 0.0, 0.0])
        coverage.show(chi, np.array([force, 5.0, 0.0, 0.0, 0.0, 0.0]), WALL)
    return canvas


def test_colours_are_ranges_of_one_width_of_the_force_and_differ():
    width = SCALE / COLORS
    assert [color_of(width * (c + 0.5), SCALE) for c in range(COLORS)] == list(range(COLORS))
    assert [color_of(force, SCALE) for force in (-3.0, 99.0)] == [0, COLORS - 1]
    assert len(set(palette())) == COLORS


def test_a_slide_is_a_row_of_dots_on_the_surface():
    ways = np.arange(0.0, 0.1, 0.001)
    painted = coverage_of(*((y, 10.0) for y in ways)).painted()
    assert {color for color, _ in painted} == {color_of(10.0, SCALE)}
    places = np.array([place for _, place in painted])
    assert places[:, 0] == pytest.approx(0.0, abs=1e-9), "not as deep as the tip is"
    assert np.ptp(places[:, 1]) == pytest.approx(0.1, abs=Coverage.RADIUS + 0.001)
    assert np.diff(np.sort(places[:, 1])) == pytest.approx(Coverage.RADIUS, abs=0.0011)


def test_a_place_that_is_held_has_the_last_colour_alone():
    canvas = coverage_of((0.0, 4.0), (0.0, 8.0), (0.0005, 12.0))
    painted = canvas.painted()
    assert [color for color, _ in painted] == [color_of(12.0, SCALE)]


def test_nothing_is_painted_off_the_wall():
    assert coverage_of((0.0, 0.0), (0.1, 1.0), (0.2, -4.0)).painted() == []


def test_in_a_recording_a_dot_is_there_from_its_touch_to_the_next_one():
    scales = coverage_of((0.0, 0.0), (0.0, 4.0), (0.0, 4.0), (0.0, 12.0)).scales["paint/1"]
    times, sizes = zip(*scales, strict=True)
    assert times == pytest.approx((0.0, 0.04, 0.08, 0.12))
    assert sizes == pytest.approx((VANISHED, 1.0, 1.0, VANISHED))
