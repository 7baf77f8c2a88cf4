"""Tests of the limits of a sensed contact: speeds, tool's angle, safe depth."""

import numpy as np
import pytest

from uvms_drake.control.limits import TubeRadii, resolved_radii
from uvms_drake.control.limits.pose import ToolAngle
from uvms_drake.control.limits.speeds import ContactSpeed, SafeDepth, SafeDepthBetweenKnots
from uvms_drake.control.plan.plan import Plan
from uvms_drake.control.plan.points import Points
from uvms_drake.model.frames.euler import rotation_matrix
from uvms_drake.model.surface.surface_class import SurfaceClass
from uvms_drake.model.uvms_model import configuration_rate

DIRECTION = np.array([0.6, 0.0, 0.8])
AXES = SurfaceClass(DIRECTION).axes
SPEEDS, TOOL = ContactSpeed(AXES, 0.1, 0.2), ToolAngle(DIRECTION, 0.3)
TUBE = resolved_radii(TubeRadii(position=0.01, orientation=0.02, tip_speed=0.04, depth_speed=0.03))
FACETS = SurfaceClass(DIRECTION, angle=0.2).facets
DEPTHS = np.array([0.3, 0.2, 0.1, 0.4])
NONE = np.full(4, np.inf)
H = 0.2


@pytest.fixture(scope="module")
def points(model, states) -> Points:
    config, zeta = np.split(states["free"], 2, axis=1)
    return Points(model, config, model.task_pose(config), zeta)


def test_the_speeds_are_differences_of_places(model, points):
    step = 1e-6
    forward, backward = (model.task_pose(points.config + sign * step * configuration_rate(
        points.config, points.zeta))[:, :3] for sign in (1.0, -1.0))
    expected = (forward - backward) / (2.0 * step) @ AXES.T
    np.testing.assert_allclose(SPEEDS.values(points), expected, atol=1e-8)


def test_the_cosine_is_that_of_the_tools_axis(points):
    axis = rotation_matrix(points.y[:, 3:6])[:, :, 0]
    np.testing.assert_allclose(TOOL.values(points)[:, 0], axis @ DIRECTION, atol=1e-12)


def test_the_cosine_changes_by_no_more_than_the_tube_takes_of_it(model):
    """Attitudes at the bound, and Euler angles that are off by the radius, to first order."""
    limit, rng = TOOL, np.random.default_rng(0)
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


def test_the_bar_of_the_tool_shows_its_angle_not_the_cosine(points):
    turned = np.zeros(10)
    turned[4] = 0.15 - np.arccos(DIRECTION[0])  # the axis of the tool, 0.15 rad off n
    at = Points(points.model, turned, turned, turned)
    assert TOOL.bar_lengths(at) == pytest.approx([0.5])


def test_values_are_depths_now_and_half_an_interval_later(model, points):
    depth = SafeDepth(FACETS, DEPTHS).values(points)
    between = SafeDepthBetweenKnots(FACETS, DEPTHS, H).values(points)
    still = np.zeros((1, 10))
    for k in range(len(depth)):
        plans = [Plan.from_accelerations(
            0.0, 1e-6, points.config[k], sign * points.zeta[k], still) for sign in (1, -1)]
        after, before = (model.task_pose(plan.config[1])[:3] for plan in plans)
        velocity = (after - before) / 2e-6
        assert between[k] == pytest.approx(depth[k] + 0.5 * H * FACETS @ velocity, abs=1e-8)
    np.testing.assert_allclose(depth, points.y[:, :3] @ FACETS.T, atol=1e-15)


def test_a_parabola_lies_below_the_largest_of_its_control_points():
    """Its values at both ends and x + ½hẋ; a third derivative j adds (2/81)h³j at most."""
    rng, t = np.random.default_rng(0), np.linspace(0.0, H, 101)
    for _ in range(200):
        x, v, a, j = rng.uniform(-1.0, 1.0, 4)
        parabola = x + v * t + 0.5 * a * t**2
        assert np.max(parabola) <= max(x, x + 0.5 * H * v, parabola[-1]) + 1e-12
        cubic = parabola + j * t**3 / 6.0
        beyond = np.max(cubic) - max(x, x + 0.5 * H * v, cubic[-1])
        assert beyond <= 2.0 / 81.0 * H**3 * abs(j) + 1e-12
    bend = t**2 * (t - H) / 6.0
    assert np.max(np.abs(bend)) == pytest.approx(2.0 / 81.0 * H**3, rel=1e-3)
