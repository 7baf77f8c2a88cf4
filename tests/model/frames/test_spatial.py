"""Tests of `uvms_drake.model.frames.spatial`."""

import numpy as np
import pytest

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


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(seed=1)


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
