"""Tests of `uvms_drake.report.signals`: where a surface begins, and how steep its force is."""

import numpy as np
import pytest

from uvms_drake.model.surface.contact_laws import Linear
from uvms_drake.model.surface.geometry import Cylinder, Plane
from uvms_drake.model.surface.plane import UnilateralPlane
from uvms_drake.model.surface.shaped_surface import ShapedSurface
from uvms_drake.report.signals import surface_depth, surface_slope

NORTH = np.array([1.0, 0.0, 0.0])
TILT = 0.2
ASLANT = np.array([-np.cos(TILT), 0.0, np.sin(TILT)])
"""Normal of a plane that is 0.2 rad off the direction."""


def tips(count=40):
    """Returns poses (count, 6) about the origin, on both sides of x = 0.05."""
    rng = np.random.default_rng(3)
    return rng.uniform(-0.2, 0.2, (count, 6))


def test_along_n_a_tilted_plane_begins_where_its_equation_says():
    chi, point = tips(), np.array([0.05, 0.3, 0.1])
    surface = ShapedSurface(Plane(point, ASLANT)).checked()
    distance = (point - chi[:, :3]) @ ASLANT / (NORTH @ ASLANT)
    np.testing.assert_allclose(
        surface_depth(surface, chi, NORTH), chi[:, 0] + distance, atol=1e-8)


def test_along_n_a_hull_begins_where_the_ray_enters_it():
    hull = ShapedSurface(Cylinder(
        point=np.array([0.1, 0.0, 0.0]), normal=-NORTH, radius=0.3)).checked()
    chi = tips()
    chi[:, 0] = np.minimum(chi[:, 0], 0.05)
    found = surface_depth(hull, chi, NORTH)
    inside = hull.penetration(np.column_stack([found + 1e-6, chi[:, 1:]]))
    outside = hull.penetration(np.column_stack([found - 1e-6, chi[:, 1:]]))
    assert np.all(inside > 0.0)
    assert np.all(outside == 0.0)


def test_a_surface_that_is_too_far_is_nowhere():
    far = ShapedSurface(Plane(np.array([0.9, 0.0, 0.0]), -NORTH)).checked()
    assert np.all(np.isnan(surface_depth(far, tips(), NORTH)))
    behind = ShapedSurface(Plane(np.array([-0.9, 0.0, 0.0]), -NORTH)).checked()
    assert np.all(np.isnan(surface_depth(behind, tips(), NORTH)))


def test_the_slope_along_n_is_that_of_the_law_times_the_cosine_of_the_tilt():
    surface = ShapedSurface(Plane(np.array([0.05, 0.0, 0.0]), ASLANT),
                            Linear(stiffness=700.0, transition=0.002)).checked()
    chi = tips()
    slope, depth = surface_slope(surface, chi, NORTH), surface.penetration(chi)
    np.testing.assert_allclose(slope[depth > 0.003], 700.0 * np.cos(TILT), rtol=1e-6)
    assert np.all(np.isnan(slope[depth == 0.0]))
    assert np.count_nonzero(depth > 0.003) > 5 < np.count_nonzero(depth == 0.0)


@pytest.mark.parametrize("stiffness", [500.0, 1500.0])
def test_the_slope_of_a_plane_that_is_known_is_its_stiffness(stiffness):
    plane = UnilateralPlane(stiffness=stiffness, transition=0.002).checked()
    chi = tips()
    chi[:, 0] = plane.anchor[0] + 0.02
    np.testing.assert_allclose(surface_slope(plane, chi, -plane.normal), stiffness, rtol=1e-6)
