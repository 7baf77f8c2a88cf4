"""A flat wall."""

import numpy as np
import pytest
from support.surfaces import NORMALS

from uvms_drake.model.surface.geometry import Plane


@pytest.mark.parametrize("normal", [*NORMALS, *np.eye(3), *-np.eye(3)])
def test_the_depth_is_against_the_normal(normal):
    point = np.array([2.0, -0.3, 1.1])
    shape = Plane(point, normal).checked()
    points = np.random.default_rng(0).normal(size=(50, 3))
    np.testing.assert_allclose(shape.depth(points), (point - points) @ normal, atol=1e-14)


def test_a_tilted_plane_is_as_far_off_a_direction_as_it_is_tilted():
    for tilt in (1e-9, 0.1, 3.0):
        shape = Plane(normal=np.array([-np.cos(tilt), 0.0, np.sin(tilt)]))
        spread = shape.spread(np.array([1.0, 0.0, 0.0]), np.zeros(3), 5.0)
        assert spread == (pytest.approx(tilt, rel=1e-6), 1.0, 0.0)
