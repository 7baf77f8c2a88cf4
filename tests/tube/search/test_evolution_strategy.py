"""Tests of `uvms_drake.tube.search.evolution_strategy`, on functions whose maxima are known."""

import numpy as np
import pytest

from uvms_drake.tube.search.evolution_strategy import evolve


def test_a_narrow_bent_ridge_is_climbed_to_its_end():
    """Rosenbrock's function and a long ellipsoid, side by side: each search has its own."""
    def values(z: np.ndarray) -> np.ndarray:
        x, y = z[0, :, :-1], z[0, :, 1:]
        rosenbrock = np.sum(100.0 * (y - x**2) ** 2 + (1.0 - x) ** 2, axis=-1)
        ellipsoid = (z[1] - 2.0) ** 2 @ np.array([1.0, 10.0, 100.0, 1000.0])
        return -np.stack([rosenbrock, ellipsoid])

    best, where = evolve(values, np.zeros((2, 4)), 400, np.random.default_rng(0))
    np.testing.assert_allclose(where, [[1.0] * 4, [2.0] * 4], atol=1e-3)
    np.testing.assert_allclose(best, 0.0, atol=1e-5)
    np.testing.assert_allclose(best, values(np.repeat(where[:, None], 2, axis=1))[:, 0])


def test_a_linear_function_on_a_ball_is_maximised_on_its_boundary():
    slope = np.random.default_rng(1).normal(size=30)

    def values(z: np.ndarray) -> np.ndarray:
        return (z / np.maximum(1.0, np.linalg.norm(z, axis=-1, keepdims=True))) @ slope

    best, _ = evolve(values, np.zeros((1, 30)), 150, np.random.default_rng(0))
    assert best[0] == pytest.approx(np.linalg.norm(slope), rel=0.02)
    assert best[0] <= np.linalg.norm(slope)
