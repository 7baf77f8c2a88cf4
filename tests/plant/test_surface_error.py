"""`model.surface_error`: where the simulated surface is, and how stiff."""

import numpy as np
import pytest
from pydrake.common.eigen_geometry import AngleAxis

from uvms_drake.model.frames.euler import euler_angles, rotation_matrix
from uvms_drake.model.surface.law import check_surface
from uvms_drake.model.surface.plane import UnilateralPlane
from uvms_drake.model.surface.spring import BilateralSpring
from uvms_drake.plant.surface import (
    SurfaceError,
    displaced,
    rotation_by,
)

OFF = SurfaceError(stiffness=1.3, shift=np.array([0.02, -0.01, 0.03]),
                   turn=np.array([0.3, -0.2, 0.4]))
PLANE = UnilateralPlane(point=np.array([1.0, 0.5, -0.2]), normal=np.array([-0.8, 0.0, 0.6]))


@pytest.fixture(scope="module")
def spring():
    """A spring with a stiffness that couples everything, away from zero attitude."""
    root = np.random.default_rng(0).normal(size=(6, 6)) * np.repeat([10.0, 1.0], 3)[:, None]
    return BilateralSpring(stiffness=root @ root.T + np.eye(6),
                           equilibrium=np.array([1.0, 2.0, 3.0, 0.3, -0.4, 0.9]))


def carried(chi, point):
    """Returns χ of a tip that is moved along with the surface, about a point of it."""
    R = AngleAxis(np.linalg.norm(OFF.turn), OFF.turn / np.linalg.norm(OFF.turn)).rotation()
    return np.concatenate([point + OFF.shift + R @ (chi[:3] - point),
                           euler_angles(R @ rotation_matrix(chi[3:]))])


def test_a_rotation_vector_is_an_axis_times_an_angle():
    for turn in (OFF.turn, np.array([0.0, 0.0, 0.5 * np.pi]), np.array([0.0, 1e-9, 0.0])):
        angle = np.linalg.norm(turn)
        np.testing.assert_allclose(
            rotation_by(turn), AngleAxis(angle, turn / angle).rotation(), atol=1e-15)
    np.testing.assert_array_equal(rotation_by(np.zeros(3)), np.eye(3))


def test_a_plane_pushes_a_tip_that_is_carried_along_as_before_but_for_its_stiffness():
    chi, speed = np.array([1.05, 0.9, -0.4, 0.0, 0.0, 0.0]), np.array([0.1, 0.2, -0.05])
    R = rotation_by(OFF.turn)
    old, new = (check_surface(config) for config in (PLANE, displaced(PLANE, OFF)))
    before = old.force(chi, np.concatenate([speed, np.zeros(3)]))
    after = new.force(carried(chi, PLANE.point), np.concatenate([R @ speed, np.zeros(3)]))
    assert np.linalg.norm(before) > 10.0
    np.testing.assert_allclose(after[:3], 1.3 * R @ before[:3], rtol=1e-12)


def test_a_spring_that_is_carried_along_with_the_tip_keeps_its_energy(spring):
    """Up to a third power of the stretch, as Euler angles are no vector."""
    new = displaced(spring, OFF)
    np.testing.assert_allclose(
        new.equilibrium, carried(spring.equilibrium, spring.equilibrium[:3]), atol=1e-14)
    for stretch in 1e-5 * np.random.default_rng(1).normal(size=(10, 6)):
        moved = carried(spring.equilibrium + stretch, spring.equilibrium[:3]) - new.equilibrium
        assert moved @ new.stiffness @ moved == pytest.approx(
            1.3 * stretch @ spring.stiffness @ stretch, rel=1e-3)
    check_surface(new)  # It is symmetric and positive definite.
