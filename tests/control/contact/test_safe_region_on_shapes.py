"""Safe region on hulls, pipes and bumpy walls with friction, for walls of their class."""

import numpy as np
import pytest
from support.safe_cone import free_distance
from support.shapes import in_ball_of, near, surfaces
from support.walls import SurfaceClass

from uvms_drake.control.contact.safe_region import apex

ALL = surfaces(dissipation=1.7, friction=0.3, creep=0.004)
REACH, LARGEST, NOISE = 0.03, 15.0, 0.5  # m, N, N


@pytest.mark.parametrize("surface", ALL.values(), ids=ALL)
def test_what_a_reading_makes_safe_is_safe(surface):
    """Readings of tips that move, slide and feel noise, and every point of their cones in reach."""
    rng, readings, deepest = np.random.default_rng(0), 0, 0.0
    for _ in range(6):
        center = near(surface.geometry, 1, rng, depths=(0.0, 0.005))[0]
        _, direction = surface.geometry.depth_and_gradient(center)
        direction = direction / np.linalg.norm(direction) + 0.05 * rng.normal(size=3)
        direction /= np.linalg.norm(direction)
        bounds = surface.membership(direction, center, REACH)
        walls = SurfaceClass(
            direction, bounds.stiffness, bounds.angle, bounds.dissipation, bounds.friction)
        points = in_ball_of(center, REACH, 200, rng)
        velocities = rng.normal(scale=0.05, size=(200, 3))
        force = surface.force(*(np.pad(x, ((0, 0), (0, 3))) for x in (points, velocities)))[:, :3]
        force = force + in_ball_of(np.zeros(3), NOISE, 200, rng)
        at = apex(walls, points[:, None], velocities[:, None], force, LARGEST, NOISE)
        others = in_ball_of(center, REACH, 2000, rng)
        static = surface.static_force(np.pad(others, ((0, 0), (0, 3))))
        safe = free_distance(walls, at[:, None], others) >= 0.0
        assert np.all((static <= LARGEST) | ~safe)
        readings += np.count_nonzero(np.any(safe, axis=1))
        deepest = max(deepest, float(np.max(np.where(safe, static, 0.0))))
    assert readings > 100
    assert deepest > 3.0
