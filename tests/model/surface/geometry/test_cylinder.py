"""A hull or a pipe, from outside and from inside."""

import numpy as np
import pytest
from support.shapes import R

from uvms_drake.model.surface.geometry import Cylinder, Plane

AXIS, NORMAL = R @ [0.0, 0.0, 1.0], R @ [-1.0, 0.0, 0.0]
POINT = np.array([0.4, -0.2, 1.3])


@pytest.mark.parametrize("inside", [False, True])
def test_the_depth_is_the_distance_from_the_axis_less_the_radius(inside):
    shape = Cylinder(POINT, NORMAL, AXIS, 0.3, inside).checked()
    center = POINT + (0.3 if inside else -0.3) * NORMAL
    points = POINT + np.random.default_rng(0).normal(scale=0.3, size=(200, 3))
    distance = np.linalg.norm(np.cross(points - center, AXIS), axis=1)
    depth, gradient = shape.depth_and_gradient(points)
    np.testing.assert_allclose(depth, distance - 0.3 if inside else 0.3 - distance, atol=1e-14)
    outward = points - center - ((points - center) @ AXIS)[:, None] * AXIS
    outward /= distance[:, None]
    np.testing.assert_allclose(gradient, outward if inside else -outward, atol=1e-12)


@pytest.mark.parametrize("radius", [1e3, 1e6, 1e9])
@pytest.mark.parametrize("inside", [False, True])
def test_a_huge_one_is_a_plane_but_for_the_curvature(radius, inside):
    shape = Cylinder(POINT, NORMAL, AXIS, radius, inside)
    plane = Plane(POINT, NORMAL)
    points = POINT + np.random.default_rng(1).normal(scale=0.3, size=(200, 3))
    across = (points - POINT) @ np.cross(AXIS, NORMAL)
    sagitta = (1.0 if inside else -1.0) * across**2 / (2.0 * radius)
    np.testing.assert_allclose(shape.depth(points) - plane.depth(points), sagitta,
                               atol=3.0 / radius**2 + 1e-15)


@pytest.mark.parametrize("inside", [False, True])
def test_on_its_axis_it_has_a_way_in(inside):
    """In the middle of a pipe, where a tip may well be."""
    shape = Cylinder(POINT, NORMAL, AXIS, 0.3, inside)
    on_axis = POINT + (0.3 if inside else -0.3) * NORMAL + 0.7 * AXIS
    for point in (on_axis, on_axis + 1e-30j * NORMAL):
        depth, gradient = shape.depth_and_gradient(point)
        assert depth.real == pytest.approx(-0.3 if inside else 0.3)
        assert np.linalg.norm(gradient.real) == pytest.approx(1.0)
        assert np.all(np.isfinite(gradient))
