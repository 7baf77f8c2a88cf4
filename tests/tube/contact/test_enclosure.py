"""Tests of `tube.contact.enclosure`: what members give is within what enclosures give."""

import numpy as np
import pytest

from uvms_drake.model.frames.spatial import cross_motion
from uvms_drake.tube.contact.enclosure import (
    Enclosure,
    carrying,
    crossing,
    inverse,
    sine_and_cosine,
)

ROUNDING = 1e-12


def enclosure(rng: np.random.Generator, *shape: int, radius: float = 0.3) -> Enclosure:
    return Enclosure(rng.normal(size=shape), radius * rng.uniform(size=shape))


def members(rng: np.random.Generator, A: Enclosure) -> np.ndarray:
    """Returns members of it (60, ...), most entries at an end."""
    inside = np.clip(rng.uniform(-2.0, 2.0, (60, *A.mid.shape)), -1.0, 1.0)
    return A.mid + A.rad * inside


def assert_within(values: np.ndarray, A: Enclosure, share: float = 0.0) -> None:
    """Checks that values are members, and that some of them come near an end."""
    off = np.abs(values - A.mid)
    assert np.all(off <= A.rad + ROUNDING)
    assert np.max(off / np.maximum(A.rad, ROUNDING)) > share


def test_sums_products_and_cross_products_hold_those_of_all_members():
    rng = np.random.default_rng(1)
    A, B = enclosure(rng, 4, 3, 2), enclosure(rng, 4, 2, 5)
    a, b = members(rng, A), members(rng, B)
    assert_within(a @ b, A @ B, 0.5)
    assert_within(a + a[::-1], A + A, 0.9)
    assert_within(a - a[::-1], A - A, 0.9)
    assert_within(a.swapaxes(-1, -2), A.T, 0.9)
    assert_within(a @ B.mid, A @ B.mid, 0.5)
    assert_within(A.mid @ b, A.mid @ B, 0.5)
    V, W = enclosure(rng, 6), enclosure(rng, 6, 3)
    v, w = members(rng, V), members(rng, W)
    assert_within(np.stack([cross_motion(v, w[..., i]) for i in range(3)], axis=-1),
                  carrying(V) @ W, 0.3)
    P, Q = enclosure(rng, 3), enclosure(rng, 3, 1)
    p, q = members(rng, P), members(rng, Q)
    assert_within(np.cross(p, q[..., 0]), (crossing(P) @ Q)[..., 0], 0.5)


@pytest.mark.parametrize("half", [0.0, 1e-3, 0.4, 1.5, 4.0])
def test_sine_and_cosine_hold_those_of_all_angles(half):
    rng = np.random.default_rng(2)
    centre = rng.uniform(-4.0, 4.0, 50)
    angles = centre + half * np.linspace(-1.0, 1.0, 201)[:, None]
    for of, found in zip((np.sin, np.cos), sine_and_cosine(centre, np.full(50, half)),
                         strict=True):
        assert_within(of(angles), found, 0.9 if half else -1.0)


def test_an_inverse_holds_those_of_all_members_and_knows_where_there_may_be_none():
    rng = np.random.default_rng(3)
    A = Enclosure(np.eye(4) + 0.3 * rng.normal(size=(5, 4, 4)), 0.01 * rng.uniform(size=(5, 4, 4)))
    found = inverse(A)
    assert np.all(np.isfinite(found.rad))
    assert_within(np.linalg.inv(members(rng, A)), found, 0.3)
    # [1] ± 0.9 has inverses up to 10; [1] ± 1 has none at an end.
    assert inverse(Enclosure(np.ones((1, 1)), np.full((1, 1), 0.9))).rad == pytest.approx(9.0)
    assert np.all(inverse(Enclosure(np.ones((1, 1)), np.ones((1, 1)))).rad == np.inf)
    wide = np.array([[0.0, 2.0], [2.0, 0.0]])  # of a spectral radius of 2: (I − Z)⁻¹ is negative
    assert np.all(inverse(Enclosure(np.eye(2), wide)).rad == np.inf)
