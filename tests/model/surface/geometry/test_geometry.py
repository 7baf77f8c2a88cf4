"""Properties of all shapes."""

import numpy as np
import pytest
from support.shapes import SHAPES, R, in_ball_of, near, turned

from uvms_drake.model.surface.geometry.relief import Relief

every_shape = pytest.mark.parametrize("shape", list(map(turned, SHAPES.values())), ids=SHAPES)


@every_shape
def test_lengths_and_depth_are_coordinates(shape):
    rng = np.random.default_rng(0)
    lengths, depth = rng.uniform(-0.3, 0.3, (50, 4, 2)), rng.uniform(-0.1, 0.1, (50, 4))
    points = shape.point_at(lengths, depth)
    np.testing.assert_allclose(shape.depth(points), depth, atol=1e-14)
    np.testing.assert_allclose(shape.local_lengths(shape.local(points)), lengths, atol=1e-14)


@every_shape
def test_the_first_length_is_along_the_tangent_and_the_point_is_where_all_are_zero(shape):
    np.testing.assert_allclose(shape.axes @ shape.axes.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(shape.axes) == pytest.approx(1.0)
    np.testing.assert_array_equal(shape.axes[2], -shape.normal)
    if not isinstance(shape, Relief):
        np.testing.assert_array_equal(shape.point_at(np.zeros(2), 0.0), shape.point)


@every_shape
def test_the_gradient_is_that_of_the_depth(shape):
    rng, h = np.random.default_rng(1), 1e-6
    points = near(shape, 100, rng)
    depth, gradient = shape.depth_and_gradient(points)
    np.testing.assert_array_equal(depth, shape.depth(points))
    finite = np.stack([shape.depth(points + h * e) - shape.depth(points - h * e)
                       for e in np.eye(3)], axis=-1) / (2.0 * h)
    np.testing.assert_allclose(gradient, finite, atol=1e-8)
    complex_step = np.stack([shape.depth(points + 1e-30j * e).imag for e in np.eye(3)], -1) / 1e-30
    np.testing.assert_allclose(gradient, complex_step, atol=1e-13)


@every_shape
def test_a_step_in_along_the_normal_is_the_depth_where_it_is_a_distance(shape):
    points = near(shape, 100, np.random.default_rng(2), depths=(0.0, 0.0))
    _, gradient = shape.depth_and_gradient(points)
    size = np.linalg.norm(gradient, axis=1)
    assert np.all(size >= 1.0 - 1e-12)
    if shape.is_distance:
        np.testing.assert_allclose(shape.depth(points + 0.02 * gradient), 0.02, atol=1e-15)
    else:
        assert np.max(size) > 1.0005


@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)
def test_a_shape_that_is_moved_has_the_same_depths(shape):
    points = near(shape, 100, np.random.default_rng(3))
    depth, gradient = shape.depth_and_gradient(points)
    moved_depth, moved_gradient = turned(shape).depth_and_gradient(points @ R.T + [2.0, -0.3, 1.1])
    np.testing.assert_allclose(moved_depth, depth, atol=1e-14)
    np.testing.assert_allclose(moved_gradient, gradient @ R.T, atol=1e-13)


@every_shape
def test_a_patch_lies_on_the_surface_about_the_place_below_a_point(shape):
    center = near(shape, 1, np.random.default_rng(4), depths=(-0.05, -0.05))[0]
    points = shape.patch(center, 0.4, 21)
    assert points.shape == (21, 21, 3)
    np.testing.assert_allclose(shape.depth(points), 0.0, atol=1e-15)
    assert np.linalg.norm(points[10, 10] - center) == pytest.approx(0.05, rel=0.01)
    for axis in (0, 1):
        steps = np.linalg.norm(np.diff(points, axis=axis), axis=-1)
        np.testing.assert_allclose(steps, 0.02, rtol=0.03)


@every_shape
@pytest.mark.parametrize("reach", [0.02, 0.15])
def test_within_a_reach_the_normal_turns_and_stretches_by_no_more_than_is_said(shape, reach):
    rng = np.random.default_rng(5)
    for _ in range(20):
        center = near(shape, 1, rng)[0]
        _, gradient = shape.depth_and_gradient(in_ball_of(center, reach, 2000, rng))
        direction = rng.normal(size=3)
        direction /= np.linalg.norm(direction)
        size = np.linalg.norm(gradient, axis=1)
        angle = np.arccos(np.clip(gradient @ direction / size, -1.0, 1.0))
        spread = shape.spread(direction, center, reach)
        assert np.max(angle) <= spread.angle + 1e-12
        assert np.max(size) <= spread.stretch + 1e-12
        if shape.is_distance:
            assert np.max(angle) >= 0.97 * spread.angle
