"""Tests of `uvms_drake.model.frames`: Euler angles and spatial vectors, by Drake and by hand."""

import numpy as np
import pytest
from pydrake.math import RollPitchYaw, RotationMatrix

from uvms_drake.model.frames.euler import (
    euler_angles,
    inverse_rate_matrix,
    pose_difference,
    rate_matrix,
    rotated,
    rotated_back,
    rotation_matrix,
    wrap_angle,
)
from uvms_drake.model.frames.spatial import (
    block_diagonal,
    cross,
    cross_force,
    cross_motion,
    force_matrix,
    motion_matrix,
    skew,
    times,
)

COMPLEX_STEP = 1e-30


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(seed=2)


@pytest.fixture
def attitudes(rng) -> np.ndarray:
    """Euler angles (20, 3) over the whole range, but 0.1 rad from the singularity."""
    limit = np.array([np.pi, np.pi / 2 - 0.1, np.pi])
    return rng.uniform(-limit, limit, size=(20, 3))


def test_rotation_matrix_agrees_with_drake(attitudes):
    R = rotation_matrix(attitudes)
    for one, rpy in zip(R, attitudes, strict=True):
        np.testing.assert_allclose(
            one, RollPitchYaw(rpy).ToRotationMatrix().matrix(), atol=1e-15)


def test_plain_numbers_turn_as_the_matrix_does(attitudes):
    v = np.array([1.0, -2.0, 3.0])
    for rpy, R in zip(attitudes, rotation_matrix(attitudes), strict=True):
        np.testing.assert_allclose(rotated(rpy, v), R @ v, atol=1e-14)
        np.testing.assert_allclose(rotated_back(rpy, v), v @ R, atol=1e-14)


def test_euler_angles_agree_with_drake(attitudes):
    for rpy in attitudes:
        R_AB = RollPitchYaw(rpy).ToRotationMatrix()
        expected = RollPitchYaw(RotationMatrix(R_AB.matrix())).vector()
        np.testing.assert_allclose(euler_angles(R_AB.matrix()), expected, atol=1e-12)


def test_the_inverse_of_the_rate_matrix_is_one_and_exists_at_the_singularity(attitudes):
    np.testing.assert_allclose(
        inverse_rate_matrix(attitudes) @ rate_matrix(attitudes),
        np.broadcast_to(np.eye(3), (20, 3, 3)), atol=1e-12)
    nose_up = np.array([0.4, np.pi / 2, 0.1])
    for rates in np.eye(3):
        R_dot = rotation_matrix(nose_up + 1j * COMPLEX_STEP * rates).imag / COMPLEX_STEP
        S = rotation_matrix(nose_up).T @ R_dot
        np.testing.assert_allclose(
            inverse_rate_matrix(nose_up) @ rates, [S[2, 1], S[0, 2], S[1, 0]], atol=1e-15)


def test_pitch_is_found_at_the_singularity():
    for pitch in (-np.pi / 2, np.pi / 2):
        angles = euler_angles(rotation_matrix(np.array([0.0, pitch, 0.0])))
        assert np.all(np.isfinite(angles))
        assert angles[1] == pytest.approx(pitch, abs=1e-12)


def test_rate_matrix_agrees_with_drake(attitudes, rng):
    for rpy in attitudes:
        w_B = rng.normal(size=3)
        expected = RollPitchYaw(rpy).CalcRpyDtFromAngularVelocityInChild(w_B)
        np.testing.assert_allclose(rate_matrix(rpy) @ w_B, expected, rtol=1e-12, atol=1e-12)


def test_euler_accelerations_agree_with_drake(attitudes, rng):
    """The second derivative of the angles is T ω̇_B + Ṫ ω_B."""
    for rpy in attitudes:
        w, alpha = rng.normal(size=(2, 3))
        rpy_dot = rate_matrix(rpy) @ w
        expected = RollPitchYaw(rpy).CalcRpyDDtFromAngularAccelInChild(rpy_dot, alpha)
        rate = rate_matrix(rpy + 1j * COMPLEX_STEP * rpy_dot).imag / COMPLEX_STEP
        actual = rate_matrix(rpy) @ alpha + rate @ w
        np.testing.assert_allclose(actual, expected, rtol=1e-10, atol=1e-10)


def test_a_complex_step_passes_through_euler_angles(attitudes, rng):
    direction = rng.normal(size=attitudes.shape)
    angles = euler_angles(rotation_matrix(attitudes + 1j * COMPLEX_STEP * direction))
    np.testing.assert_allclose(angles.real, attitudes, atol=1e-13)
    np.testing.assert_allclose(angles.imag / COMPLEX_STEP, direction, atol=1e-10)


def test_wrap_angle_stays_on_the_circle_and_in_its_range(rng):
    angle = np.concatenate([rng.uniform(-50.0, 50.0, size=200), [np.pi, -np.pi, 0.0, 3 * np.pi]])
    wrapped = wrap_angle(angle)
    assert np.all((wrapped >= -np.pi) & (wrapped < np.pi))
    np.testing.assert_allclose(np.exp(1j * wrapped), np.exp(1j * angle), atol=1e-12)
    np.testing.assert_array_equal(wrap_angle(angle + 3e-20j), wrapped + 3e-20j)


def test_the_difference_of_euler_angles_is_the_shorter_one():
    y, y_nominal = np.zeros(10), np.zeros(10)
    y[3:6], y_nominal[3:6] = [3.1, -3.1, 0.2], [-3.1, 3.1, 0.1]
    y[9], y_nominal[9] = 3.1, -3.1  # A joint angle is no angle modulo 2π.
    expected = np.zeros(10)
    expected[3:6] = 6.2 - 2 * np.pi, 2 * np.pi - 6.2, 0.1
    expected[9] = 6.2
    np.testing.assert_allclose(pose_difference(y, y_nominal), expected, atol=1e-12)


def _se3(V: np.ndarray) -> np.ndarray:
    """Returns the 4×4 matrix of a motion (v, ω), written out by hand."""
    (vx, vy, vz), (wx, wy, wz) = V[:3], V[3:]
    return np.array([[0, -wz, wy, vx], [wz, 0, -wx, vy], [-wy, wx, 0, vz], [0, 0, 0, 0]])


def test_skew_and_cross_are_the_vector_product(rng):
    a, b = rng.normal(size=(2, 5, 4, 3))
    np.testing.assert_allclose(cross(a, b), np.cross(a, b), atol=1e-15)
    np.testing.assert_allclose(
        np.einsum("...ij,...j->...i", skew(a), b), np.cross(a, b), atol=1e-15)


def test_motion_product_is_the_commutator_of_se3(rng):
    for V, W in rng.normal(size=(10, 2, 6)):
        commutator = _se3(V) @ _se3(W) - _se3(W) @ _se3(V)
        np.testing.assert_allclose(_se3(cross_motion(V, W)), commutator, atol=1e-14)


def test_force_product_is_dual_to_the_motion_product(rng):
    """Power is a scalar, so no rate of carrying both along changes it: (V×W)·F + W·(V×*F) = 0."""
    V, W, F = rng.normal(size=(3, 10, 6))
    power = np.sum(cross_motion(V, W) * F + W * cross_force(V, F), axis=-1)
    np.testing.assert_allclose(power, 0.0, atol=1e-14)


def test_force_product_gives_the_gyroscopic_moment_of_newton_and_euler(rng):
    """A body about its centre of mass: V ×* (m v, I ω) = (m ω×v, ω×Iω)."""
    v, w = rng.normal(size=(2, 3))
    mass, inertia = 3.7, np.diag([1.0, 2.0, 4.5])
    F = cross_force(np.concatenate([v, w]), np.concatenate([mass * v, inertia @ w]))
    np.testing.assert_allclose(F[:3], mass * np.cross(w, v), atol=1e-14)
    np.testing.assert_allclose(F[3:], np.cross(w, inertia @ w), atol=1e-14)


def test_the_matrices_are_those_of_the_products(rng):
    V, W, F = rng.normal(size=(3, 7, 5, 6))
    np.testing.assert_allclose(times(motion_matrix(V), W), cross_motion(V, W), atol=1e-14)
    np.testing.assert_allclose(times(force_matrix(F), V), cross_force(V, F), atol=1e-14)
    np.testing.assert_allclose(
        times(-np.swapaxes(motion_matrix(V), -1, -2), F), cross_force(V, F), atol=1e-14)


def test_a_block_diagonal_matrix_acts_on_each_half(rng):
    A, B, x = rng.normal(size=(4, 3, 3)), rng.normal(size=(4, 3, 3)), rng.normal(size=(4, 6))
    expected = np.concatenate([np.einsum("mij,mj->mi", A, x[:, :3]),
                               np.einsum("mij,mj->mi", B, x[:, 3:])], axis=1)
    np.testing.assert_allclose(times(block_diagonal(A, B), x), expected, atol=1e-14)
    np.testing.assert_array_equal(block_diagonal(1j * A, 1j * B), 1j * block_diagonal(A, B))
