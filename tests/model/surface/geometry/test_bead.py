"""Tests of a plate with a weld on it."""

import numpy as np
import pytest
from support.shapes import R, in_ball_of, near, turned

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.model.surface.geometry import Bead
from uvms_drake.model.surface.law import check_surface
from uvms_drake.model.surface.shaped_surface import ShapedSurface

BEAD = turned(Bead(height=0.003, width=0.03))


def test_the_profile_is_a_smooth_ridge_of_that_height_and_width():
    aside = np.linspace(-0.05, 0.05, 20_001)
    height, slope = BEAD.profile(aside)
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


def test_lengths_depth_and_gradient_belong_together():
    rng, h = np.random.default_rng(0), 1e-6
    lengths, depth = rng.uniform(-0.02, 0.02, (200, 2)), rng.uniform(-0.01, 0.03, 200)
    points = BEAD.point_at(lengths, depth)
    assert BEAD.depth(points) == pytest.approx(depth, abs=1e-14)
    assert BEAD.local_lengths(BEAD.local(points)) == pytest.approx(lengths, abs=1e-14)
    _, gradient = BEAD.depth_and_gradient(points)
    finite = np.stack([BEAD.depth(points + h * e) - BEAD.depth(points - h * e)
                       for e in np.eye(3)], axis=-1) / (2.0 * h)
    assert gradient == pytest.approx(finite, abs=1e-7)
    check_surface(ShapedSurface(BEAD))


def test_the_spread_bounds_what_is_near():
    rng = np.random.default_rng(1)
    center = near(BEAD, 1, rng, half=0.01)[0]
    spread = BEAD.spread(-BEAD.normal, center, 0.02)
    _, gradient = BEAD.depth_and_gradient(in_ball_of(center, 0.02, 20_000, rng))
    size = np.linalg.norm(gradient, axis=1)
    angles = np.arccos(gradient @ -BEAD.normal / size)
    assert 0.99 * spread.angle < np.max(angles) <= spread.angle
    assert 0.99 * spread.stretch < np.max(size) <= spread.stretch


@pytest.mark.parametrize(("bead", "message"), [
    (Bead(height=0.0), r"^height = 0\.0: must be positive$"),
    (Bead(width=-1.0), r"^width = -1\.0: must be positive$"),
    (Bead(height=0.003, width=0.01),
     r"^height = 0\.003: must be at most 0\.00245 m, a slope of 1")])
def test_bad_parameters_are_named(bead, message):
    with pytest.raises(InvalidParameter, match=message):
        bead.checked()
