"""Enclosures of the links' Jacobians and of M's second derivatives over boxes of joints.

For columns of any matrix T in place of ζ, ζ = T z, and in axes of link k, Xₖ taking twists from
link to link, sₖ the screw of joint k in axes of the link before, tₖ its row of T,

    Jₖ = Xₖ(qₖ)(Jₖ₋₁ + sₖ tₖ),    ∂Jₖ/∂qᵢ = −cᵢ × Bᵢ,    ∂²Jₖ/∂qᵢ∂qⱼ = −cᵢ × ∂Jₖ/∂qⱼ,  j ≤ i,

Bᵢ = Xₖ…Xᵢ Jᵢ₋₁, cᵢ = Xₖ…Xᵢ sᵢ. Where T makes M the unit matrix at a box's centre, radii stay small.
Pairs (i, j), j ≤ i, are in the order of `np.tril_indices`. Proof:
tube/contact/theory.md#enclosures-of-link-jacobians-and-inertia.
"""

from typing import NamedTuple

import numpy as np

from uvms_drake.model.frames.spatial import cross
from uvms_drake.model.uvms_model import UvmsModel, beyond_columns
from uvms_drake.tube.contact.enclosure import (
    Enclosure,
    carrying,
    concatenated,
    crossing,
    exactly,
    sine_and_cosine,
)


class Link(NamedTuple):
    """A link beyond k joints, over m boxes of them; in its own axes."""

    J: Enclosure
    """Jacobian JₖT (m, 6, 6+n)."""
    turns: Enclosure
    """Matrices −cᵢ× of these joints (m, k, 6, 6)."""
    first: Enclosure
    """First derivatives of JₖT by them (m, k, 6, 6+n)."""


def links_in_boxes(model: UvmsModel, centre: np.ndarray, half: np.ndarray, T: np.ndarray
                   ) -> tuple[Enclosure, list[Link]]:
    """Returns J_E (m, 6, 6+n) in columns of ζ, and all links but the vehicle in those of T.

    Args:
        model: Any serial arm.
        centre: Joints in the middle of the boxes (m, n) [rad, m].
        half: Half-widths of the boxes (m, n) [rad, m].
        T: Columns in place of ζ (m, 6+n, 6+n).
    """
    count, size = len(centre), model.size
    vehicle = _carry(exactly(np.tile(model.links.X_BV, (count, 1, 1))))
    J_E, J = vehicle, vehicle @ T[:, :6]
    carried = exactly(np.zeros((count, 6, 0)))  # Bᵢ, side by side.
    links = []
    for k in range(model.num_joints):
        # The columns of J_E are the vehicle's and the screws cᵢ.
        screw = exactly(np.tile(_screw(model, k)[:, None], (count, 1, 1)))
        moved = _carry(_step(model, k, centre, half)) @ concatenated(
            J_E, screw, carried, J, axis=-1)
        J_E, carried = moved[..., :7 + k], moved[..., 7 + k:]
        J = carried[..., -size:] + J_E[..., -1:] @ T[:, 6 + k, None]
        turns = _turns(J_E)
        links.append(Link(J, turns, turns @ carried.reshape(count, 6, k + 1, size).swapaxes(1, 2)))
    return J_E, links


def second_of_tip(J_E: Enclosure) -> Enclosure:
    """Returns ∂²J_E/∂qᵢ∂qⱼ (m, n(n+1)/2, 6, 6+n) of J_E (m, 6, 6+n)."""
    n = J_E.mid.shape[-1] - 6
    beyond = beyond_columns(n)[:, None]
    turns = _turns(J_E)
    first = turns @ Enclosure(J_E.mid[:, None] * beyond, J_E.rad[:, None] * beyond)
    i, j = np.tril_indices(n)
    return turns[:, i] @ first[:, j]


def second_of_links(links: list[Link]) -> list[Enclosure]:
    """Returns ∂²JₖT/∂qᵢ∂qⱼ (m, n−i, 6, i+1, 6+n) by joint i, of links beyond it and all j ≤ i."""
    count, n, _, size = links[-1].first.mid.shape
    out = []
    for i in range(n):
        turns = concatenated(*(link.turns[:, i, None] for link in links[i:]), axis=1)
        out.append((turns @ _first(links, i)).reshape(count, n - i, 6, i + 1, size))
    return out


def second_of_inertia(model: UvmsModel, links: list[Link], second: list[Enclosure]) -> Enclosure:
    """Returns ∂²TᵀMT/∂qᵢ∂qⱼ (m, n(n+1)/2, 6+n, 6+n), TᵀMT = Σ JₖᵀIₖJₖ of all links, and motors.

    Args:
        model: Any serial arm.
        links: The links.
        second: Their second derivatives.
    """
    # All links, one above the other: Jᵢⱼᵀ I J + Jⱼᵀ I Jᵢ, and the transposes.
    count, n, _, size = links[-1].first.mid.shape
    inertia = model.links.inertia[1:]
    I_J = inertia @ concatenated(*(link.J[:, None] for link in links), axis=1)
    out = []
    for i, two in enumerate(second):
        one = _first(links, i)
        I_J_i = inertia[i:] @ one[..., -size:]
        half = (two.reshape(count, 6 * (n - i), -1).T @ I_J[:, i:].reshape(count, -1, size)
                + one.reshape(count, 6 * (n - i), -1).T @ I_J_i.reshape(count, -1, size))
        out.append(half.reshape(count, i + 1, size, size))
    halves = concatenated(*out, axis=1)
    return halves + halves.T


def _first(links: list[Link], i: int) -> Enclosure:
    """Returns ∂JₖT/∂qⱼ of all links beyond joint i (m, n−i, 6, (i+1)(6+n)), j ≤ i side by side."""
    count, _, _, size = links[-1].first.mid.shape
    each = (link.first[:, :i + 1].swapaxes(1, 2)[:, None] for link in links[i:])
    return concatenated(*each, axis=1).reshape(count, len(links) - i, 6, (i + 1) * size)


def _turns(J_E: Enclosure) -> Enclosure:
    """Returns −cᵢ× (m, k, 6, 6) of the screws in the columns of J_E (m, 6, 6+k)."""
    across = carrying(J_E[..., 6:].T)
    return Enclosure(-across.mid, across.rad)


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
