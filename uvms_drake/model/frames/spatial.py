"""Spatial (6D) algebra in Fossen's order: motion (v, ω), force (f, n), linear part first.

Stacks of any leading shape; complex numbers pass through.
"""

import numpy as np

_YZX, _ZXY = np.array([1, 2, 0]), np.array([2, 0, 1])

# The matrices are linear in their vectors: S(a) = Σ aᵢ _SKEW[i], V× = Σ Vᵢ _MOTION[i] and
# (· ×* F) = Σ Fᵢ _FORCE[i]. One product with all of them is the fastest way to a stack.
_skew = np.zeros((3, 3, 3))
_skew[[0, 1, 2], _ZXY, _YZX], _skew[[0, 1, 2], _YZX, _ZXY] = 1.0, -1.0
_motion = np.zeros((6, 6, 6))
_motion[3:, :3, :3] = _motion[3:, 3:, 3:] = _motion[:3, :3, 3:] = _skew
_SKEW, _MOTION = _skew.reshape(3, 9), _motion.reshape(6, 36)
_FORCE = -_motion.transpose(1, 2, 0).reshape(6, 36)


def times(A: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Returns A x (..., r) of stacks of matrices (..., r, c) and vectors (..., c)."""
    return (A @ x[..., None])[..., 0]


def block_diagonal(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Returns blkdiag(first, second) (..., 6, 6) of two stacks of 3×3 matrices of one type."""
    out = np.zeros((*first.shape[:-2], 6, 6), dtype=first.dtype)
    out[..., :3, :3] = first
    out[..., 3:, 3:] = second
    return out


def skew(a: np.ndarray) -> np.ndarray:
    """Returns S(a) (..., 3, 3) with S(a) b = a × b."""
    return (a @ _SKEW).reshape(*a.shape, 3)


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Returns a × b (..., 3); several times faster than `np.cross` on small stacks.

    With a' = (y, z, x) of a and products by component, a b' − a' b is (z, x, y) of a × b.
    """
    return (a * b.take(_YZX, -1) - a.take(_YZX, -1) * b).take(_YZX, -1)


def motion_matrix(V: np.ndarray) -> np.ndarray:
    """Returns V× (..., 6, 6) = [S(ω) S(v); 0 S(ω)], the matrix of `cross_motion`.

    That of `cross_force` is its negative transpose.
    """
    return (V @ _MOTION).reshape(*V.shape, 6)


def force_matrix(F: np.ndarray) -> np.ndarray:
    """Returns (· ×* F) (..., 6, 6), the matrix that takes V to V ×* F."""
    return (F @ _FORCE).reshape(*F.shape, 6)


def cross_motion(V: np.ndarray, W: np.ndarray) -> np.ndarray:
    """Returns V × W (..., 6), the rate of the motion vector W carried along with velocity V.

    (v, ω) × (a, b) = (ω × a + v × b, ω × b) (Featherstone 2008, eq. 2.31).
    """
    return times(motion_matrix(V), W)


def cross_force(V: np.ndarray, F: np.ndarray) -> np.ndarray:
    """Returns V ×* F (..., 6), the rate of the force vector F carried along with velocity V.

    (v, ω) ×* (f, n) = (ω × f, v × f + ω × n) (Featherstone 2008, eq. 2.32).
    """
    return -(F[..., None, :] @ motion_matrix(V))[..., 0, :]


def in_ball(rng: np.random.Generator, count: int, size: int, radius: float) -> np.ndarray:
    """Returns (count, size) points of a ball, uniform, half of them on its surface."""
    if size == 0:
        return np.zeros((count, 0))
    direction = rng.normal(size=(count, size))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    scale = rng.uniform(size=(count, 1)) ** (1.0 / size)
    scale[rng.uniform(size=count) < 0.5] = 1.0
    return radius * scale * direction
