"""Tests of `uvms_drake.model.coordinates`."""

import numpy as np
import pytest

from uvms_drake.model.coordinates import Coordinates
from uvms_drake.model.frames.euler import rate_matrix, rotation_matrix


@pytest.fixture(scope="module")
def coordinates(uvms) -> Coordinates:
    return Coordinates(uvms)


@pytest.fixture(scope="module")
def states() -> np.ndarray:
    """States (𝔮, ζ) (10, 20) with any attitude, but 0.1 rad from the singularity."""
    states = np.random.default_rng(seed=3).normal(size=(10, 20))
    limit = np.array([np.pi, np.pi / 2 - 0.1, np.pi])
    states[:, 3:6] = np.random.default_rng(seed=4).uniform(-limit, limit, size=(10, 3))
    return states


def test_round_trip_from_the_papers_order(coordinates, states):
    for state in states:
        there = coordinates.to_drake(state)
        assert there.shape == (coordinates.num_positions + coordinates.num_velocities,)
        np.testing.assert_allclose(coordinates.from_drake(there), state, atol=1e-12)


def test_the_pose_is_that_of_the_vehicle(uvms, coordinates, states):
    context = uvms.plant.CreateDefaultContext()
    for state in states:
        uvms.plant.SetPositionsAndVelocities(context, coordinates.to_drake(state))
        X_WB = uvms.vehicle.EvalPoseInWorld(context)
        np.testing.assert_allclose(X_WB.translation(), state[:3], atol=1e-15)
        np.testing.assert_allclose(
            X_WB.rotation().matrix(), rotation_matrix(state[3:6]), atol=1e-14)


def test_zeta_is_the_vehicles_velocity_in_its_own_axes(uvms, coordinates, states):
    context = uvms.plant.CreateDefaultContext()
    frame_B, frame_W = uvms.vehicle.body_frame(), uvms.plant.world_frame()
    for state in states:
        uvms.plant.SetPositionsAndVelocities(context, coordinates.to_drake(state))
        V_WB_B = frame_B.CalcSpatialVelocity(context, frame_W, frame_B)
        np.testing.assert_allclose(V_WB_B.translational(), state[10:13], atol=1e-13)
        np.testing.assert_allclose(V_WB_B.rotational(), state[13:16], atol=1e-13)


def test_the_map_of_velocities_is_orthogonal(coordinates, states):
    for state in states:
        drake_state = coordinates.to_drake(state)
        T = np.column_stack(
            [coordinates.vector_to_drake(drake_state, column) for column in np.eye(10)])
        np.testing.assert_allclose(T.T @ T, np.eye(10), atol=1e-14)
        np.testing.assert_allclose(
            T @ state[10:], drake_state[coordinates.num_positions:], atol=1e-14)


def test_configuration_moves_with_zeta(uvms, coordinates, states):
    """d𝔮/dt = (R ν₁, T ν₂, q̇), by finite differences along Drake's own q̇."""
    context = uvms.plant.CreateDefaultContext()
    h = 1e-6
    for state in states:
        x = coordinates.to_drake(state)
        uvms.plant.SetPositionsAndVelocities(context, x)
        step = np.zeros_like(x)
        step[: coordinates.num_positions] = h * uvms.plant.MapVelocityToQDot(
            context, x[coordinates.num_positions:])
        difference = coordinates.from_drake(x + step) - coordinates.from_drake(x - step)
        rpy, zeta = state[3:6], state[10:]
        expected = np.concatenate(
            [rotation_matrix(rpy) @ zeta[:3], rate_matrix(rpy) @ zeta[3:6], zeta[6:]])
        np.testing.assert_allclose(difference[:10] / (2 * h), expected, rtol=1e-6, atol=1e-7)


def test_a_drifted_quaternion_changes_nothing(coordinates, states):
    """An integrator lets the quaternion's norm drift."""
    x = coordinates.to_drake(states[0])
    drifted = x.copy()
    drifted[:4] *= 1.001
    np.testing.assert_allclose(
        coordinates.from_drake(drifted), coordinates.from_drake(x), atol=1e-13)
    np.testing.assert_allclose(
        coordinates.vector_to_drake(drifted, states[1, :10]),
        coordinates.vector_to_drake(x, states[1, :10]), atol=1e-13)


def test_the_acceleration_is_the_rate_of_zeta(uvms, coordinates, states):
    """By finite differences along (q̇, v̇), while the vehicle turns."""
    context = uvms.plant.CreateDefaultContext()
    v_dot = np.random.default_rng(seed=6).normal(size=10)
    h = 1e-6
    for state in states:
        x = coordinates.to_drake(state)
        uvms.plant.SetPositionsAndVelocities(context, x)
        q_dot = uvms.plant.MapVelocityToQDot(context, x[coordinates.num_positions:])
        step = h * np.concatenate([q_dot, v_dot])
        difference = coordinates.from_drake(x + step) - coordinates.from_drake(x - step)
        np.testing.assert_allclose(coordinates.acceleration_from_drake(x, v_dot),
                                   difference[10:] / (2 * h), rtol=1e-6, atol=1e-7)
