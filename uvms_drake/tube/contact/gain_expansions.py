"""Expansions of the tip's Jacobian and of the gains S over G about the centres of boxes of joints.

G = M⁻¹J_Eᵀ, S = J_EG. Values and first derivatives are at the centres, by plain arithmetic; second
ones are enclosed over the boxes. Proof:
tube/contact/theory.md#operator-norms-over-boxes-of-joints.
"""

from typing import NamedTuple

import numpy as np

from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.tube.contact.enclosure import (
    Enclosure,
    Link,
    concatenated,
    crossing,
    exactly,
    inverse,
    links_in_boxes,
    second_of_inertia,
    second_of_links,
    second_of_tip,
)
from uvms_drake.tube.contact.sensor_gains import tip_slopes


class Expansion(NamedTuple):
    """A matrix A over m boxes of joints; see the module."""

    value: np.ndarray
    """A at the centres (m, r, c)."""
    first: np.ndarray
    """∂ᵢA there (m, n, r, c)."""
    second: np.ndarray
    """Largest |∂ᵢ∂ⱼA| in the boxes (m, n(n+1)/2, r, c), of the pairs j ≤ i."""

    def part(self, rows: slice, columns: slice = slice(None)) -> "Expansion":
        """Returns some rows and columns of it."""
        return Expansion(*(each[..., rows, columns] for each in self))


class Expansions(NamedTuple):
    """Matrices over m boxes of joints."""

    J_E: Expansion
    """Jacobian of the tip (m, 6, 6+n), in its axes."""
    in_vehicle: tuple[Enclosure, Enclosure]
    """∂ᵢJ_v in axes of the vehicle (m, n, 3, 6+n), at the centres and in the boxes."""
    gains: Expansion
    """S over G (m, 6+6+n, 6)."""


def expansions(model: UvmsModel, centre: np.ndarray, half: np.ndarray) -> Expansions:
    """Returns the matrices over boxes.

    Args:
        model: The controller's.
        centre: Centres of the boxes (m, n) [rad].
        half: Half of their widths (m, n) [rad].
    """
    # At the centres, in columns T in which M is the unit matrix.
    kinematics = model.kinematics(np.concatenate([np.zeros((len(centre), 6)), centre], axis=1))
    J = kinematics.J_links[:, -1]
    J_by = tip_slopes(J)
    root = np.linalg.cholesky(model.mass_matrix(kinematics))
    T = np.linalg.inv(root).swapaxes(-1, -2)
    T_link = T[:, None]
    M_by = T_link.swapaxes(-1, -2) @ model.mass_matrix_rates(kinematics) @ T_link
    # In the boxes.
    J_box, links = links_in_boxes(model, centre, half, T)
    return Expansions(
        Expansion(J, J_by, second_of_tip(J_box).largest),
        (_slopes_in_vehicle(exactly(J)), _slopes_in_vehicle(J_box)),
        Expansion(*_gains(J @ T, J_by @ T_link, M_by, T),
                  _second_of_gains(model, half, links, M_by, T)))


def _slopes_in_vehicle(J: Enclosure) -> Enclosure:
    """Returns ∂ᵢJ_v (m, n, 3, 6+n) in axes of the vehicle, of J_E.

    By joint i the tip is moved by lᵢ, its lever's end, and the levers of joints j turn:
    [0, −S(lᵢ), a_min × l_max] with a, l of the axes, the two of i and j.
    """
    n = J.mid.shape[-1] - 6
    levers, axes = J[:, :3, 6:].T, J[:, 3:, 6:].T
    turned = crossing(axes)[:, :, None] @ levers[:, None, ..., None]
    i, j = np.indices((n, n))
    joints = turned[..., 0][:, np.minimum(i, j), np.maximum(i, j)].swapaxes(2, 3)
    vehicle = crossing(levers)
    return concatenated(exactly(np.zeros_like(vehicle.mid)), vehicle, joints, axis=-1)


def _gains(J: np.ndarray, J_by: np.ndarray, M_by: np.ndarray, T: np.ndarray
           ) -> tuple[np.ndarray, np.ndarray]:
    """Returns S over G (m, 6+6+n, 6), and its derivatives, where TᵀMT is the unit matrix.

    Args:
        J: J_E T (m, 6, 6+n).
        J_by: Its derivatives (m, n, 6, 6+n).
        M_by: Those of TᵀMT (m, n, 6+n, 6+n).
        T: Columns in place of ζ (m, 6+n, 6+n).
    """
    G = J.swapaxes(-1, -2)
    S_by = J_by @ G[:, None]
    M_G = M_by @ G[:, None]
    S_by = S_by + S_by.swapaxes(-1, -2) - J[:, None] @ M_G
    return (np.concatenate([J @ G, T @ G], axis=-2),
            np.concatenate([S_by, T[:, None] @ (J_by.swapaxes(-1, -2) - M_G)], axis=-2))


def _second_of_gains(model: UvmsModel, half: np.ndarray, links: list[Link], M_by: np.ndarray,
                     T: np.ndarray) -> np.ndarray:
    """Returns the largest |∂ᵢ∂ⱼ| (m, n(n+1)/2, 6+6+n, 6) of S over G in the boxes.

    Args:
        model: The controller's.
        half: Half of the boxes' widths (m, n) [rad].
        links: Links in the boxes.
        M_by: ∂TᵀMT/∂qᵢ at the centres, where TᵀMT is the unit matrix (m, n, 6+n, 6+n).
        T: Columns in place of ζ (m, 6+n, 6+n).
    """
    count, n, size = *half.shape, model.size
    i, j = np.tril_indices(n)
    # J_E and M with their derivatives.
    second = second_of_links(links)
    J, J_by = links[-1].J, links[-1].first
    J_two = concatenated(*(each[:, -1].swapaxes(1, 2) for each in second), axis=1)
    M_two = second_of_inertia(model, links, second)
    moved = half[:, None, None] @ M_two.largest.reshape(count, len(i), -1)[:, pair_of(n)]
    M_one = Enclosure(M_by, moved.reshape(M_by.shape))
    M = Enclosure(np.tile(np.eye(size), (count, 1, 1)),
                  np.sum(half[..., None, None] * M_one.largest, axis=1))

    # G, Gⱼ and their products: of matrices one above the other, as one.
    def above(A: Enclosure) -> Enclosure:
        return A.reshape(count, -1, size)

    def in_pairs(A: Enclosure) -> Enclosure:
        """Returns AᵢGⱼ + AⱼGᵢ (m, n(n+1)/2, r, 6)."""
        each = (above(A) @ G_by.T).reshape(count, n, -1, n, 6).swapaxes(2, 3)
        return each[:, i, j] + each[:, j, i]

    M_inverse = inverse(M)
    G = M_inverse @ J.T
    G_by = above(J_by - (above(M_one) @ G).reshape(count, n, size, 6).T) @ M_inverse.T
    N = J_two - ((above(M_two) @ G).reshape(count, len(i), size, 6) + in_pairs(M_one)).T
    S_two = (above(J_two) @ G).reshape(count, len(i), 6, 6) + in_pairs(J_by)
    gains = (above(N) @ concatenated(G, (T @ M_inverse).T, axis=-1)).reshape(
        count, len(i), 6, 6 + size)
    S_two = gains[..., :6] + S_two.T
    return concatenated(S_two, gains[..., 6:], axis=-1).T.largest


def pair_of(n: int) -> np.ndarray:
    """Returns the index (n, n) of the pair of i and j, in any order, among all pairs j ≤ i."""
    i, j = np.indices((n, n))
    high, low = np.maximum(i, j), np.minimum(i, j)
    out: np.ndarray = high * (high + 1) // 2 + low
    return out
