"""Shapes: properties of all, and each by itself: relief, weld, hull or pipe, plane."""

from dataclasses import replace

import numpy as np
import pytest
from support.shapes import SHAPES, R, in_ball_of, near, turned

from uvms_drake.model.surface.geometry import Bead, Cylinder, Plane
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


BUMPY, BEAD = SHAPES["bumpy"], turned(Bead(height=0.003, width=0.03))
AXIS, NORMAL = R @ [0.0, 0.0, 1.0], R @ [-1.0, 0.0, 0.0]
POINT = np.array([0.4, -0.2, 1.3])


def heights(shape):
    """Returns a square of heights (801, 801), sides of 40 times the shortest wavelength."""
    line = np.linspace(-20.0, 20.0, 801) * shape.wavelength
    return shape.relief(np.stack(np.meshgrid(line, line), axis=-1)), line[1] - line[0]


@pytest.mark.parametrize("seed", range(3))
def test_height_slope_and_curvature_are_within_what_is_declared(seed):
    shape = replace(BUMPY, seed=seed)
    (height, slope), step = heights(shape)
    assert 0.5 * shape.amplitude < np.max(np.abs(height)) <= shape.amplitude
    steepest = np.max(np.linalg.norm(slope, axis=-1))
    assert 0.5 * shape.slope < steepest <= shape.slope
    turn = np.linalg.norm(np.diff(slope, axis=0), axis=-1) / step
    assert 0.3 * shape.curvature < np.max(turn) <= shape.curvature


def test_no_wave_is_shorter_than_declared_or_longer_than_four_times_that():
    """By Fourier: all of the height's power is between the two."""
    (height, _), step = heights(BUMPY)
    window = np.hanning(801)
    power = np.abs(np.fft.fft2(height * window * window[:, None]))**2
    frequency = np.fft.fftfreq(801, step)
    wavelength = 1.0 / np.maximum(np.hypot(frequency, frequency[:, None]), 1e-9)
    outside = (wavelength < 0.9 * BUMPY.wavelength) | (wavelength > 4.8 * BUMPY.wavelength)
    assert np.sum(power[outside]) < 1e-3 * np.sum(power)


def test_the_profile_is_a_smooth_ridge_of_that_height_and_width():
    aside = np.linspace(-0.05, 0.05, 20_001)
    height, slope = BEAD.relief(aside[:, None] * [0.0, 1.0])
    slope = slope[:, 1]
    assert np.max(height) == BEAD.height == height[10_000]
    assert np.all(height[np.abs(aside) >= 0.015] == 0.0)
    assert np.ptp(aside[height >= 0.0015]) == pytest.approx(0.3641 * 0.03, rel=1e-3)
    assert np.gradient(height, aside) == pytest.approx(slope, abs=1e-4)
    assert np.max(np.abs(slope)) == pytest.approx(BEAD.slope, rel=1e-6)
    assert np.max(np.abs(np.gradient(slope, aside))) == pytest.approx(BEAD.curvature, rel=1e-4)


def test_the_weld_runs_along_the_axis():
    along = BEAD.point + np.linspace(-1.0, 1.0, 5)[:, None] * BEAD.axis
    depth, gradient = BEAD.depth_and_gradient(along)
    assert depth == pytest.approx(np.full(5, 0.003))
    assert gradient == pytest.approx(np.tile(-BEAD.normal, (5, 1)))
    beside = along + 0.02 * R @ np.array([0.0, 1.0, 0.0])
    assert BEAD.depth(beside) == pytest.approx(np.zeros(5), abs=1e-12)


@pytest.mark.parametrize("inside", [False, True])
def test_the_depth_is_the_distance_from_the_axis_less_the_radius(inside):
    shape = Cylinder(POINT, NORMAL, AXIS, 0.3, inside)
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


def test_a_tilted_plane_is_as_far_off_a_direction_as_it_is_tilted():
    for tilt in (1e-9, 0.1, 3.0):
        shape = Plane(normal=np.array([-np.cos(tilt), 0.0, np.sin(tilt)]))
        spread = shape.spread(np.array([1.0, 0.0, 0.0]), np.zeros(3), 5.0)
        assert spread == (pytest.approx(tilt, rel=1e-6), 1.0, 0.0)
