"""Tests of `uvms_drake.control.limits.safe_depth`."""

import numpy as np
import pytest

from uvms_drake.control.limits.safe_depth import SafeDepth, SafeDepthBetweenKnots
from uvms_drake.control.plan.plan import DynamicPlan
from uvms_drake.control.plan.points import Points, slopes
from uvms_drake.model.surface.surface_class import SurfaceClass

DIRECTION = np.array([0.6, 0.0, 0.8])
FACETS = SurfaceClass(DIRECTION, angle=0.2).facets
DEPTHS = np.array([0.3, 0.2, 0.1, 0.4])
NONE = np.full(4, np.inf)
H = 0.2


@pytest.fixture(scope="module")
def points(model, states) -> Points:
    config, zeta = np.split(states["free"], 2, axis=1)
    return Points(model, config, model.task_pose(config), zeta)


@pytest.mark.parametrize("limit", [
    SafeDepth(FACETS, DEPTHS), SafeDepthBetweenKnots(FACETS, DEPTHS, H)])
def test_slopes_are_those_of_complex_steps(limit, points):
    found, expected = limit.slopes(points), slopes(limit.values, points, limit.about)
    np.testing.assert_allclose(np.broadcast_to(found.y, expected.y.shape), expected.y, atol=1e-9)
    if limit.about == "speed":
        np.testing.assert_allclose(found.zeta, expected.zeta, atol=1e-9)


def test_values_are_depths_now_and_half_an_interval_later(model, points):
    depth = SafeDepth(FACETS, DEPTHS).values(points)
    between = SafeDepthBetweenKnots(FACETS, DEPTHS, H).values(points)
    still = np.zeros((1, 10))
    for k in range(len(depth)):
        plans = [DynamicPlan.from_accelerations(
            0.0, 1e-6, points.config[k], sign * points.zeta[k], still) for sign in (1, -1)]
        after, before = (model.task_pose(plan.config[1])[:3] for plan in plans)
        velocity = (after - before) / 2e-6
        assert between[k] == pytest.approx(depth[k] + 0.5 * H * FACETS @ velocity, abs=1e-8)
    np.testing.assert_allclose(depth, points.y[:, :3] @ FACETS.T, atol=1e-15)


def test_they_are_one_sided(points):
    assert np.all(SafeDepth(FACETS, NONE).excess(points) < 0.0)
    far = points.y - np.pad(100.0 * DIRECTION, (0, 7))
    deep = Points(points.model, points.config, far, points.zeta)
    assert np.all(SafeDepth(FACETS, DEPTHS).excess(deep) < 0.0)
    assert np.all(SafeDepthBetweenKnots(FACETS, NONE, H).excess(points) < 0.0)


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
