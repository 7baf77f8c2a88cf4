"""Enclosures of the links' Jacobians and of M, with two derivatives, over boxes of joints.

For columns of any matrix T in place of ζ, ζ = T z, and in axes of link k, Xₖ taking twists from
link to link, sₖ the screw of joint k in axes of the link before, tₖ its row of T,

    Jₖ = Xₖ(qₖ)(Jₖ₋₁ + sₖ tₖ),    ∂Jₖ/∂qᵢ = −cᵢ × Bᵢ,    ∂²Jₖ/∂qᵢ∂qⱼ = cᵢ × (cⱼ × Bⱼ),  j ≤ i,

Bᵢ = Xₖ…Xᵢ Jᵢ₋₁, cᵢ = Xₖ…Xᵢ sᵢ. Where T makes M the unit matrix at a box's centre, radii stay small.
Proof: tube/contact/theory.md#enclosures-of-link-jacobians-and-inertia.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from uvms_drake.model.frames.spatial import cross
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.tube.contact.enclosure import (
    Enclosure,
    concatenated,
    crossing,
    exactly,
    sine_and_cosine,
)


class Expansion(NamedTuple):
    """A matrix over boxes, with its derivatives by the joints."""

    value: Enclosure
    """Matrix (m, r, c)."""
    first: Enclosure
    """First derivatives ∂/∂qᵢ (m, n, r, c)."""
    second: Enclosure
    """Second derivatives ∂²/∂qᵢ∂qⱼ (m, n, n, r, c)."""

    def part(self, rows: slice, columns: slice = slice(None)) -> "Expansion":
        """Returns some rows and columns of it."""
        return Expansion(*(each[..., rows, columns] for each in self))


def link_jacobians(model: UvmsModel, centre: np.ndarray, half: np.ndarray, T: np.ndarray
                   ) -> Iterator[Expansion]:
    """Yields JₖT (m, 6, 6+n) of every link, the tip's last.

    Args:
        model: Any serial arm.
        centre: Joints in the middle of the boxes (m, n) [rad, m].
        half: Half-widths of the boxes (m, n) [rad, m].
        T: Columns in place of ζ (m, 6+n, 6+n).
    """
    links, n, count = model.links, model.num_joints, len(centre)
    J = _carry(exactly(np.tile(links.X_BV, (count, 1, 1)))) @ exactly(T[:, :6])
    screws = exactly(np.zeros((count, 0, 6, 1)))  # cᵢ of the joints before the link
    carried = exactly(np.zeros((count, 0, 6, model.size)))  # Bᵢ
    for k in range(n + 1):
        if k > 0:
            X = _carry(_step(model, k - 1, centre, half))[:, None]
            screw = exactly(np.tile(_screw(model, k - 1)[:, None], (count, 1, 1, 1)))
            screws = X @ concatenated(screws, screw, axis=1)
            carried = X @ concatenated(carried, J[:, None], axis=1)
            J = carried[:, -1] + screws[:, -1] @ exactly(T[:, 5 + k, None, :])
        yield Expansion(J, *_derivatives(screws, carried, n))


def inertia_of(model: UvmsModel, links: list[Expansion], T: np.ndarray) -> Expansion:
    """Returns TᵀMT (m, 6+n, 6+n) = Σ JₖᵀIₖJₖ of all links' Jacobians, and of the motors."""
    motors = np.concatenate([np.zeros(6), model.links.rotor_inertia])
    value = exactly(T.swapaxes(-1, -2) @ (motors[:, None] * T))
    first = second = exactly(np.zeros((1, 1, 1)))
    for J, inertia in zip(links, model.links.inertia, strict=True):
        I_J, I_J_by = exactly(inertia) @ J.value, exactly(inertia) @ J.first
        one = J.first.T @ I_J[:, None]
        two = J.second.T @ I_J[:, None, None]
        mixed = J.first[:, :, None].T @ I_J_by[:, None]
        value = value + J.value.T @ I_J
        first = first + one + one.T
        second = second + two + two.T + mixed + mixed.T
    return Expansion(value, first, second)


def _derivatives(screws: Enclosure, carried: Enclosure, n: int) -> tuple[Enclosure, Enclosure]:
    """Returns the derivatives of a link's Jacobian by n joints, of which the first k move it."""
    count, k = screws.mid.shape[:2]
    rate = screws.cross_motion(carried)
    twice = screws[:, :, None].cross_motion(rate[:, None])
    i, j = np.indices((k, k))
    order = (slice(None), np.maximum(i, j), np.minimum(i, j))
    first, second = (
        [np.zeros((count, *(n,) * axes, *carried.mid.shape[2:])) for _ in range(2)]
        for axes in (1, 2))
    first[0][:, :k], first[1][:, :k] = -rate.mid, rate.rad
    second[0][:, :k, :k], second[1][:, :k, :k] = twice.mid[order], twice.rad[order]
    return Enclosure(*first), Enclosure(*second)


def _step(model: UvmsModel, j: int, centre: np.ndarray, half: np.ndarray) -> Enclosure:
    """Returns the pose (m, 4, 4) of link j + 1 in the link before."""
    fixed, by_sin, by_cos, by_length = model.links.step[:, j]
    middle, reach = centre[:, j, None, None], half[:, j, None, None]
    if model.slides[j]:
        return Enclosure(fixed + middle * by_length, reach * np.abs(by_length))
    sine, cosine = sine_and_cosine(middle, reach)
    return Enclosure(fixed + sine.mid * by_sin + cosine.mid * by_cos,
                     sine.rad * np.abs(by_sin) + cosine.rad * np.abs(by_cos))


def _screw(model: UvmsModel, j: int) -> np.ndarray:
    """Returns the screw (6,) of joint j in axes of the link before."""
    axis, point = model.links.joint_axis[j, :3].T
    return np.concatenate([axis, np.zeros(3)] if model.slides[j] else [cross(point, axis), axis])


def _carry(pose: Enclosure) -> Enclosure:
    """Returns X = [Rᵀ −RᵀS(p); 0 Rᵀ], which takes twists to axes of a frame of a pose (R, p)."""
    R_T, p = pose[:, :3, :3].T, pose[:, :3, 3]
    none, lever = exactly(np.zeros_like(R_T.mid)), R_T @ crossing(p)
    minus = Enclosure(-lever.mid, lever.rad)
    return concatenated(concatenated(R_T, minus, axis=-1), concatenated(none, R_T, axis=-1),
                        axis=-2)
