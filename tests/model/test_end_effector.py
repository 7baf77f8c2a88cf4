"""Tests of the chain: its links, and the end-effector with the force on it."""

import numpy as np
import pytest
from pydrake.math import RollPitchYaw, RotationMatrix

from uvms_drake.model.end_effector import (
    complex_step,
    force_in_tip,
    force_of_tip,
    pose_rate_matrix,
    pose_rate_matrix_rate,
    tip_force,
    tip_force_gradients,
)
from uvms_drake.model.frames.spatial import cross_motion, times
from uvms_drake.model.links import Links, read_links
from uvms_drake.model.surface.law import check_surface
from uvms_drake.model.surface.plane import UnilateralPlane
from uvms_drake.model.surface.spring import BilateralSpring

SPRING = BilateralSpring(stiffness=np.diag([9.0, 8.0, 7.0, 3.0, 2.0, 1.0]) + np.ones((6, 6)))
PLANE = UnilateralPlane(stiffness=500.0, dissipation=2.0)


def displaced(chi: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Returns χ after a motion s in axes of Σ_E, to second order, with Drake's rotations."""
    R = RollPitchYaw(chi[3:]).ToRotationMatrix()
    turn = RotationMatrix(RollPitchYaw(s[3:]))
    return np.concatenate([chi[:3] + R.matrix() @ s[:3], RollPitchYaw(R @ turn).vector()])


def matrix(chi: np.ndarray) -> np.ndarray:
    return pose_rate_matrix(RollPitchYaw(chi[3:]).ToRotationMatrix().matrix(), chi[3:])


@pytest.fixture(params=range(3))
def chi(request) -> np.ndarray:
    """A pose inside of the plane."""
    rng = np.random.default_rng(request.param)
    return np.concatenate([[0.004], rng.normal(size=2), rng.uniform(-1.2, 1.2, size=3)])


def test_the_matrix_gives_the_rate_of_the_pose(chi, derivative):
    for direction in np.eye(6):
        np.testing.assert_allclose(
            matrix(chi) @ direction, derivative(lambda s, d=direction: displaced(chi, s * d)),
            atol=1e-9)


def test_a_complex_step_moves_pose_and_matrix_alike(chi, derivative):
    direction = np.array([0.3, -0.2, 0.5, 0.7, -0.4, 0.6])
    moved, A_moved = complex_step(chi, matrix(chi), direction)
    np.testing.assert_allclose(
        moved.imag / 1e-30, derivative(lambda s: displaced(chi, s * direction), 1e-4), atol=1e-7)
    np.testing.assert_allclose(
        A_moved.imag / 1e-30, derivative(lambda s: matrix(displaced(chi, s * direction)), 1e-4),
        atol=1e-6)


def test_the_rate_of_the_matrix_is_its_derivative_along_the_motion(chi):
    stack = np.stack([chi, 0.5 * chi])
    A, V_E = np.stack([matrix(one) for one in stack]), np.linspace(-0.4, 0.6, 12).reshape(2, 6)
    _, moved = complex_step(stack, A, V_E)
    np.testing.assert_allclose(
        pose_rate_matrix_rate(A, V_E[:, 3:]), moved.imag / 1e-30, atol=1e-13)


def test_a_force_goes_into_the_axes_of_the_tip_and_back(chi):
    force = np.array([3.0, -2.0, 5.0, 0.7, -0.4, 0.6])
    np.testing.assert_allclose(force_in_tip(chi, force), force @ matrix(chi), atol=1e-13)
    np.testing.assert_allclose(force_of_tip(chi, force_in_tip(chi, force)), force, atol=1e-13)


@pytest.mark.parametrize("surface", [SPRING, PLANE], ids=["spring", "plane"])
def test_the_gradients_are_those_of_differences(chi, surface, derivative):
    law, V_E = check_surface(surface), np.linspace(-0.2, 0.3, 6)
    by_velocity, by_motion = tip_force_gradients(law, chi, matrix(chi), V_E)
    for direction in np.eye(6):
        velocity = derivative(
            lambda s, d=direction: tip_force(law, chi, matrix(chi), V_E + s * d), 1e-4)

        def moved(s, d=direction):
            there = displaced(chi, s * d)
            return tip_force(law, there, matrix(there), V_E)

        scale = np.max(np.abs(by_motion))
        np.testing.assert_allclose(times(by_velocity, direction), velocity, atol=1e-7 * scale)
        np.testing.assert_allclose(
            times(by_motion, direction), derivative(moved, 1e-5), atol=1e-6 * scale)


@pytest.fixture(scope="module")
def links(uvms) -> Links:
    return read_links(uvms)


@pytest.fixture
def motion() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Velocities, accelerations and gravity of the links, three times."""
    rng = np.random.default_rng(1)
    return rng.normal(size=(3, 5, 6)), rng.normal(size=(3, 5, 6)), rng.normal(size=(3, 5, 3))


def test_welded_bodies_are_dragged_by_the_velocities_of_their_own_points(links, uvms):
    """The power that drag takes from a link is that of every point, its velocity from Drake."""
    plant, rng = uvms.plant, np.random.default_rng(2)
    context = plant.CreateDefaultContext()
    plant.SetVelocities(context, rng.normal(size=plant.num_velocities()))
    frames = [uvms.vehicle.body_frame(),
              *(joint.child_body().body_frame() for joint in uvms.joints[:-1]), uvms.tip]
    W = plant.world_frame()
    V = np.array([np.concatenate([velocity.translational(), velocity.rotational()]) for velocity in
                  (frame.CalcSpatialVelocity(context, W, frame) for frame in frames)])
    zero, still = np.zeros((5, 6)), np.zeros((5, 3))
    power = np.sum(V * links.links_force(V, zero, still))  # V ×* I V does not have any.
    expected = 0.0
    for name, body in uvms.hydrodynamics.bodies.items():
        B = plant.GetBodyByName(name).body_frame()
        velocity = B.CalcSpatialVelocity(context, W, B)
        for drag in body.drag:
            v = np.concatenate([
                velocity.Shift(np.asarray(drag.point)).translational(), velocity.rotational()])
            expected += np.sum((drag.linear + drag.quadratic * np.abs(v)) * v**2)
    assert power == pytest.approx(expected, rel=1e-10)


def test_the_gradients_of_the_links_are_those_of_differences(links, motion, derivative):
    """N: A changes by δV × V. K: gravity turns against the link."""
    V, A, g = motion
    N, K = links.force_gradients(V, g)
    rng = np.random.default_rng(3)
    for direction in rng.normal(size=(5, 6)):
        by_velocity = derivative(lambda s, d=direction: links.links_force(
            V + s * d, A + s * cross_motion(np.broadcast_to(d, V.shape), V), g), 1e-5)
        np.testing.assert_allclose(times(N, direction), by_velocity, rtol=1e-6, atol=1e-6)

        def turned(s, d=direction):
            return links.links_force(V, A, g @ _turn(s * d[3:]))  # Rᵀ g

        np.testing.assert_allclose(times(K, direction), derivative(turned), rtol=1e-6, atol=1e-6)


def _turn(vector: np.ndarray) -> np.ndarray:
    """Returns the rotation by the angle ‖vector‖ about it, by the series of exp S."""
    S = np.array([[0.0, -vector[2], vector[1]], [vector[2], 0.0, -vector[0]],
                  [-vector[1], vector[0], 0.0]])
    return np.eye(3) + S + S @ S / 2.0 + S @ S @ S / 6.0 + S @ S @ S @ S / 24.0
