"""Dynamics of a vehicle whose arm moves as it was logged, linear in the parameters.

The arm's motion is known, so that link k has, in axes of B, the velocity ν + bₖ and the
acceleration ν̇ + ν × bₖ + aₖ with bₖ = Σ sⱼq̇ⱼ and aₖ = Σ (sⱼq̈ⱼ + bⱼ × sⱼq̇ⱼ) over its joints. With
Iₖ its inertia in axes of B, I = Σ Iₖ, and h a row of drag that meets the velocity v = hᵀν + o,

    I ν̇ + ν ×* I ν + L ν + e − G g_B + Σ h (d₁ + d₂|v|) v = τ,                                 (1)
    L = Σ ((· ×* Iₖbₖ) − Iₖ(bₖ×) − (bₖ×)ᵀIₖ),   e = Σ (Iₖaₖ + bₖ ×* Iₖbₖ),   G = Σ XₖᵀWₖR_LB.

It is the vehicle's part of `UvmsModel.inverse_dynamics`. M, L, e, G and d are linear in inertia,
weight and drag of the links, and these in the parameters.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from uvms_drake.model.frames.spatial import (
    cross_force,
    cross_motion,
    force_matrix,
    motion_matrix,
    times,
)
from uvms_drake.model.links import Links
from uvms_drake.model.uvms_model import UvmsModel


class ArmMotion(NamedTuple):
    """Motion of the links as seen from the vehicle, at each sample of a log (T)."""

    X: np.ndarray
    """(T, n+1, 6, 6) velocity of link k in its axes by one in B."""
    R_BL: np.ndarray
    """(T, n+1, 3, 3) attitude of the links in B."""
    b: np.ndarray
    """(T, n+1, 6) bₖ."""
    a: np.ndarray
    """(T, n+1, 6) aₖ."""


class Composite(NamedTuple):
    """Inertia and weight of all links together in (1), at each sample (T) or at all alike (1)."""

    inertia: np.ndarray
    """I (T, 6, 6)."""
    by_velocity: np.ndarray
    """L (T, 6, 6)."""
    bias: np.ndarray
    """e (T, 6)."""
    weight: np.ndarray
    """G (T, 6, 3)."""


class Change(NamedTuple):
    """Derivatives of a `Composite` by some parameters."""

    which: np.ndarray
    """Indices of the parameters (p,)."""
    composite: Composite
    """Each term with the parameters in front (p, T or 1, ...)."""


class VehicleDynamics(NamedTuple):
    """The terms of (1) at each sample of a log, and their changes by P parameters."""

    composite: Composite
    """Inertia and weight."""
    rows: np.ndarray
    """h (T, r, 6)."""
    offsets: np.ndarray
    """o (T, r)."""
    drag: np.ndarray
    """d₁ and d₂ (2, r)."""
    changes: tuple[Change, ...]
    """Derivatives of `composite`, those that are alike at all samples first."""
    drag_changes: np.ndarray
    """Derivatives of `drag` by the parameters (P, 2, r)."""

    def at(self, index: np.ndarray) -> "VehicleDynamics":
        """Returns the terms at samples (W,)."""
        return self._replace(
            composite=Composite(*(x if len(x) == 1 else x[index] for x in self.composite)),
            rows=self.rows[index], offsets=self.offsets[index],
            changes=tuple(change._replace(composite=Composite(*(
                x if x.shape[1] == 1 else x[:, index] for x in change.composite)))
                for change in self.changes))

    def only(self, kept: np.ndarray) -> "VehicleDynamics":
        """Returns the terms with changes by some parameters alone, indices (p,) in their order."""
        changes = []
        for which, composite in self.changes:
            old = np.flatnonzero(np.isin(which, kept))
            changes.append(Change(np.searchsorted(kept, which[old]),
                                  Composite(*(x[old] for x in composite))))
        return self._replace(changes=tuple(changes), drag_changes=self.drag_changes[kept])

    def with_parameters(self, theta: np.ndarray) -> "VehicleDynamics":
        """Returns the dynamics at parameters (P,) that have changed by θ."""
        moved = self.composite
        for which, change in self.changes:
            moved = Composite(*(x + np.tensordot(theta[which], dx, 1)
                                for x, dx in zip(moved, change, strict=True)))
        return self._replace(composite=moved,
                             drag=self.drag + np.tensordot(theta, self.drag_changes, 1))

    def force(self, nu: np.ndarray, g_B: np.ndarray) -> np.ndarray:
        """Returns the left-hand side of (1) but for I ν̇ (W, C, 6), at ν and g_B (W, C, ·)."""
        M, L, e, G = self.composite
        v = nu @ self.rows.swapaxes(-1, -2) + self.offsets[:, None]
        drag = ((self.drag[0] + self.drag[1] * np.abs(v)) * v) @ self.rows
        momentum = nu @ M
        return (cross_force(nu, momentum) + nu @ L.swapaxes(-1, -2) + e[:, None]
                - g_B @ G.swapaxes(-1, -2) + drag)

    def regressor(self, nu: np.ndarray, nu_dot: np.ndarray, g_B: np.ndarray) -> np.ndarray:
        """Returns Y (W, P, 6), the derivatives of the left-hand side of (1) by the parameters.

        Args:
            nu: ν (W, 6).
            nu_dot: ν̇ (W, 6).
            g_B: Gravity in B (W, 3) [m/s²].
        """
        v = times(self.rows, nu) + self.offsets
        drag = np.stack([v, np.abs(v) * v], axis=1)
        Y: np.ndarray = (self.drag_changes[:, 0] * drag[:, None, 0]
                         + self.drag_changes[:, 1] * drag[:, None, 1]) @ self.rows
        for which, (M, L, e, G) in self.changes:
            Y[:, which] += (times(M, nu_dot) + cross_force(nu, times(M, nu)) + times(L, nu) + e
                            - times(G, g_B)).swapaxes(0, 1)
        return Y


def arm_motion(model: UvmsModel, q: np.ndarray, q_dot: np.ndarray, q_ddot: np.ndarray
               ) -> ArmMotion:
    """Returns the motion of the links for joint angles, rates and accelerations (T, n)."""
    at = model.kinematics(np.concatenate([np.zeros((len(q), 6)), q], axis=1))
    n = model.num_joints
    moves = (np.arange(n) < np.arange(n + 1)[:, None]).astype(float)
    b = moves @ (at.screw * q_dot[..., None])
    turned = cross_motion(b[:, 1:], at.screw) * q_dot[..., None]
    a = moves @ (at.screw * q_ddot[..., None] + turned)
    return ArmMotion(at.J_links[..., :6], at.R_BL, b, a)


def composite_of(inertia: np.ndarray, weight: np.ndarray, motion: ArmMotion) -> Composite:
    """Returns the terms of (1) for inertias (n+1, 6, 6) and weights (n+1, 6, 3) of the links."""
    X, R_BL, b, a = motion
    X_T = X.swapaxes(-1, -2)
    M = X_T @ inertia @ X
    momentum, carried = times(M, b), M @ motion_matrix(b)
    L = force_matrix(momentum) - carried - carried.swapaxes(-1, -2)
    e = times(M, a) + cross_force(b, momentum)
    G = X_T @ weight @ R_BL.swapaxes(-1, -2)
    return Composite(*(np.sum(each, axis=1) for each in (M, L, e, G)))


def vehicle_dynamics(base: Links, ends: Sequence[Links], unit: float, motion: ArmMotion
                     ) -> VehicleDynamics:
    """Returns the dynamics of a robot, with changes by parameters.

    Args:
        base: Its links.
        ends: Links where each parameter is larger by `unit`.
        unit: See `ends`.
        motion: Of the arm.
    """
    first = ArmMotion(*(each[:1] for each in motion))
    terms: tuple[list[tuple[int, Composite]], list[tuple[int, Composite]]] = [], []
    for k, end in enumerate(ends):
        inertia, weight = ((getattr(end, name) - getattr(base, name)) / unit
                           for name in ("inertia", "weight"))
        # A change of the vehicle alone acts at all samples alike.
        moving = bool(np.any(inertia[1:]) or np.any(weight[1:]))
        if moving or np.any(inertia) or np.any(weight):
            terms[moving].append((k, composite_of(inertia, weight, motion if moving else first)))
    changes = tuple(Change(np.array([k for k, _ in some]), Composite(*(
        np.stack(each) for each in zip(*(term for _, term in some), strict=True))))
        for some in terms if some)
    samples, points = len(motion.b), base.drag_points.T
    stacked = motion.X.reshape(samples, -1, 6)
    velocity = times(motion.X, motion.b).reshape(samples, -1)
    return VehicleDynamics(
        composite_of(base.inertia, base.weight, motion), points @ stacked, velocity @ points.T,
        np.array([base.drag_linear, base.drag_quadratic]), changes,
        np.array([[end.drag_linear - base.drag_linear, end.drag_quadratic - base.drag_quadratic]
                  for end in ends]).reshape(len(ends), 2, -1) / unit)
