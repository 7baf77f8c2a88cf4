"""Tests of `uvms_drake.control.limits.approach_speed`."""

import numpy as np
import pytest

from uvms_drake.control.limits import TubeRadii, resolved_radii
from uvms_drake.control.limits.approach_speed import ContactSpeed, ToolAngle
from uvms_drake.control.plan.points import Points, slopes
from uvms_drake.model.frames.euler import rotation_matrix
from uvms_drake.model.surface.surface_class import SurfaceClass
from uvms_drake.model.uvms_model import configuration_rate

DIRECTION = np.array([0.6, 0.0, 0.8])
AXES = SurfaceClass(DIRECTION).axes
LIMITS = [ContactSpeed(AXES, 0.1, 0.2), ToolAngle(DIRECTION, 0.3)]
TUBE = resolved_radii(TubeRadii(position=0.01, orientation=0.02, tip_speed=0.04, depth_speed=0.03))


@pytest.fixture(scope="module")
def points(model, states) -> Points:
    config, zeta = np.split(states["free"], 2, axis=1)
    return Points(model, config, model.task_pose(config), zeta)


@pytest.mark.parametrize("limit", LIMITS)
def test_slopes_are_those_of_complex_steps(limit, points):
    found, expected = limit.slopes(points), slopes(limit.values, points, limit.about)
    np.testing.assert_allclose(found.y, expected.y, atol=1e-9)
    if limit.about == "speed":
        np.testing.assert_allclose(found.zeta, expected.zeta, atol=1e-9)


def test_the_speeds_are_differences_of_places(model, points):
    step = 1e-6
    forward, backward = (model.task_pose(points.config + sign * step * configuration_rate(
        points.config, points.zeta))[:, :3] for sign in (1.0, -1.0))
    expected = (forward - backward) / (2.0 * step) @ AXES.T
    np.testing.assert_allclose(LIMITS[0].values(points), expected, atol=1e-8)


def test_the_cosine_is_that_of_the_tools_axis(points):
    axis = rotation_matrix(points.y[:, 3:6])[:, :, 0]
    np.testing.assert_allclose(LIMITS[1].values(points)[:, 0], axis @ DIRECTION, atol=1e-12)


def test_the_speeds_lose_their_own_radii_and_are_unknown_without():
    assert LIMITS[0].tube_takes(TUBE) == pytest.approx([0.03, 0.04, 0.04])
    assert LIMITS[0].tube_takes(resolved_radii(TubeRadii())) is None


def test_the_cosine_changes_by_no_more_than_the_tube_takes_of_it(model):
    """Attitudes at the bound, and Euler angles that are off by the radius, to first order."""
    limit, rng = LIMITS[1], np.random.default_rng(0)
    y = np.zeros((20_000, 10))
    y[:, 3:6] = rng.uniform([-0.5, -1.3, -0.4], [0.5, 0.2, 0.4], (20_000, 3))
    off = rng.normal(size=(20_000, 3))
    off *= TUBE.orientation / np.linalg.norm(off, axis=1, keepdims=True)
    moved = y + np.pad(off, ((0, 0), (3, 4)))
    values, others = (limit.values(Points(model, each, each))[:, 0] for each in (y, moved))
    inside = (values >= np.cos(limit.bound)) & (others >= np.cos(limit.bound))
    change = np.max(np.abs(values - others)[inside])
    taken = float(limit.tube_takes(TUBE)[0])
    assert 0.5 * taken < change <= taken


def test_bars_say_what_they_show(points):
    """Two of three speeds share one; of the angle it is the angle, not its cosine."""
    speeds, tool = LIMITS
    assert speeds.bars == ["tip along n  ≤ 0.1 m/s", "tip across n  ≤ 0.2 m/s"]
    along, *across = np.abs(speeds.values(points)).T
    np.testing.assert_allclose(speeds.bar_lengths(points).T,
                               [along / 0.1, np.max(across, axis=0) / 0.2])
    assert tool.bars == ["tool off n  ≤ 0.3 rad"]
    turned = np.zeros(10)
    turned[4] = 0.15 - np.arccos(DIRECTION[0])  # the axis of the tool, 0.15 rad off n
    at = Points(points.model, turned, turned, turned)
    assert tool.bar_lengths(at) == pytest.approx([0.5])
