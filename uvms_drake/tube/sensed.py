"""The price of a contact that is felt: what errors of the force sensor add to d, and force to u.

With the measured wrench 𝔉_s in the law, τ = M ζ̇_des + b + Jᵀ𝔉_s, and the plant M ζ̇ + b + Jᵀ𝔉 = τ +
M d, what remains of the contact is an acceleration,

    ζ̇ − ζ̇_des = d + M⁻¹Jᵀ(𝔉_s − 𝔉),                                                       (1)

whatever the surface: its law, its place and its stiffness are in neither side. In axes of the tip,
Jᵀ(𝔉_s − 𝔉) = J_Eᵀ e, J_E the Jacobian of the tip's spatial velocity in its own axes and e the
sensor's error. M, with added mass, and J_E are functions of q alone, so the suprema below are over
the box of the joints: found on a grid and closer and closer to the worst of it, multiplied by
a declared factor, and called estimates.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from uvms_drake.model.euler import COMPLEX_STEP
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.tube.constraint_set import ConstraintSet
from uvms_drake.tube.estimate import largest_of
from uvms_drake.tube.joint_search import second_over_joints, supremum_over_joints
from uvms_drake.tube.push import Push
from uvms_drake.tube.row_gains import instant_gains, lagged_gains

SOURCES = ("the reading in rest", "normal force, late", "force aside, late", "the robot's motion")
"""Sources of the terms of (3)."""


def tip_jacobian_and_gain(model: UvmsModel, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns J_E (..., 6, 6+n) and M⁻¹J_Eᵀ (..., 6+n, 6) at joint angles (..., n), maybe complex.

    The latter takes a wrench of the tip in the tip's own axes, (force, torque), to an acceleration.
    """
    config = np.concatenate([np.zeros((*q.shape[:-1], 6), dtype=q.dtype), q], axis=-1)
    kinematics = model.kinematics(config)
    J_E = kinematics.J_links[..., -1, :, :]
    return J_E, np.linalg.solve(model.mass_matrix(kinematics), J_E.swapaxes(-1, -2))


@dataclass(frozen=True)
class FeltForce:
    """The forces of a class of walls on the tip, and what a sensor makes of them.

    A force is F_N n + 𝔣, n the same at all times, F_N the size of the normal force and 𝔣 the rest:
    friction, and what a normal off n makes of F_N; F_N and 𝔣 are each the sum of a slow part, which
    changes at no more than a rate, and of a ripple of no more than a size, as fast as it likes. The
    reading has a first-order lag, is held for a period, and is off by no more than `error` and
    `torque_error` however long the force stands still.
    """

    size: float
    """Largest ‖F_N n + 𝔣‖ [N]."""
    rate: float
    """Rate of F_N's slow part [N/s]."""
    ripple: float
    """Size of the rest of it [N]."""
    aside_rate: float
    """Rate of 𝔣's slow part [N/s]."""
    aside_ripple: float
    """Size of the rest of it [N]."""
    error: float
    """Bound of ‖F̂ − F‖ in rest: noise, bias, drift, tool [N]."""
    torque_error: float
    """Bound of the torque's, about the tip [N m]."""
    lag: float
    """T [s]."""
    period: float
    """h [s]."""
    tool_angle: float
    """Largest angle between n and the tip's x-axis [rad]."""

    @property
    def age(self) -> float:
        """T + h, the largest mean age of a reading [s]."""
        return self.lag + self.period


def by_source(force: FeltForce, A: "Sizes", known: float, late: float, *, turning: float,
              qdot: float, moving: float = 0.0, turned: float = 0.0, safety_factor: float = 1.0
              ) -> np.ndarray:
    """Returns the terms of (3) of rows with suprema A by source (number of `SOURCES`, ...).

    Args:
        force: The forces.
        A: Those of the rows' matrices.
        known: γ.
        late: γ′.
        turning: ω, how fast the tip's axes turn [rad/s].
        qdot: Bound of ‖q̇‖ [rad/s].
        moving: J̃‖𝔯‖, if the rows are under the filter by their velocity.
        turned: What Ȧ has beside the part by the joints, where the rows are turned.
        safety_factor: Factor of the suprema.
    """
    A_rate = A.by_joints * qdot + turned
    return np.array([safety_factor * part for part in (
        known * (A.force * force.error + A.torque * force.torque_error),
        known * A.normal * force.rate * force.age + late * A.normal * force.ripple,
        known * A.force * force.aside_rate * force.age + late * A.force * force.aside_ripple,
        known * (A.force * turning * force.size * force.age + moving / safety_factor
                 + force.age * A_rate * (force.ripple + force.aside_ripple)))])


def push_of(model: UvmsModel, declared: ConstraintSet, force: FeltForce, k: float, sigma: float, *,
            J_dot: float, safety_factor: float = 1.0, seed: int = 0) -> Push:
    """Returns what the errors of a force sensor do to the law `resolved`.

    By (1), δ = A(q)(F̂ − F) drives the rows, A = J_bM⁻¹J_Eᵀ in axes of the tip or the rows of
    M⁻¹J_Eᵀ. With the `Gains` γ of anything and γ′ of what a sensor misses, F̂ − F being an error in
    rest, a lagging slow part, at most its rate times T + h, and what the sensor misses of the
    ripples a, a′,

        |row| ≤ γ [‖A_f‖(ε_f + (ρ′ + ωF̄)(T + h)) + ‖A_f n‖ρ(T + h) + ‖A_τ‖ε_τ + J̃‖𝔯‖
                   + (T + h) Ȧ (a + a′)] + γ′(‖A_f n‖ a + ‖A_f‖ a′).                         (3)

    Ȧ = sup‖dA_f/dt‖ is the price of taking A out of the integral over what the sensor misses,
    ∫∫g(t − s)H(s, u)[A(s) − A(u)]F(u), H averaging over ages of T + h at most; J̃‖𝔯‖ that of
    taking J_b under the same filter, d/dt(J_b𝔯) = −kJ_b𝔯 + δ + J̇_b𝔯. The tip's axes, in which
    the sensor holds the force, turn at ω, and the rows of its position with them. The rows of Euler
    rates are E(𝔬) times those of the angular velocity, ‖E‖ = (1 − |sin θ|)^−½, and
    ‖∂E/∂φ‖ ≤ ‖E‖, ‖∂E/∂θ‖ = √(1 + sin²θ)/cos²θ at the largest θ.

    Args:
        model: The controller's.
        declared: The set that the suprema are over; A depends on q alone.
        force: The forces.
        k: Velocity gain [1/s].
        sigma: σ [1/s].
        J_dot: J̃, supremum of ‖J̇‖ [1/s].
        safety_factor: Factor of suprema, which are searched for.
        seed: Seed of the search.
    """
    sizes, box = sizes_over_joints(model, declared, force.tool_angle)
    worst = supremum_over_joints(sizes, *box, seed)
    found = suprema_of(worst)
    turning = declared.nu2 + safety_factor * found.turning * declared.qdot
    instant, missed = instant_gains(k, sigma), lagged_gains(k, sigma, force.lag, force.period)

    def parts(gain: str, A: Sizes, moving: float = 0.0, turned: float = 0.0) -> np.ndarray:
        """Returns the terms of (3) by source (number of `SOURCES`, ...)."""
        return by_source(force, A, getattr(instant, gain), getattr(missed, gain), turning=turning,
                         qdot=declared.qdot, moving=moving, turned=turned,
                         safety_factor=safety_factor)

    def through(A: Sizes) -> np.ndarray:
        """Returns what A e is at most: the input has the reading itself in it, besides (3)."""
        return np.asarray(safety_factor * (
            A.force * reading_off(force, turning) + A.torque * force.torque_error))

    r = np.sum(parts("error", found.zeta), axis=0)
    J_r, turned = J_dot * float(np.linalg.norm(r)), turning * float(found.position.force)
    sine = float(np.sin(declared.tip_pitch))
    euler = 1.0 / np.sqrt(1.0 - sine)
    euler_rate = euler * turning * np.hypot(euler, np.sqrt(1.0 + sine**2) / (1.0 - sine**2))
    position = parts("position", found.position, J_r, turned)
    depth = parts("position", found.depth, J_r, turned)
    speed = parts("velocity", found.depth, J_r, turned)
    orientation = parts("position", Sizes(*(euler * size for size in found.rotation)), J_r,
                        euler_rate * float(found.rotation.force))
    return Push(
        depth=float(np.sum(depth)), depth_speed=float(np.sum(speed)),
        position=float(np.sum(position)), orientation=float(np.sum(orientation)),
        tip_speed=float(np.sum(parts("velocity", found.position, J_r, turned))),
        r=r, p=np.sum(parts("position", found.zeta), axis=0),
        z=np.sum(parts("velocity", found.zeta), axis=0),
        u=np.sum(parts("input", found.rows), axis=0) + through(found.rows),
        w=np.sum(parts("input", found.zeta), axis=0) + through(found.zeta),
        check=lambda: (largest_of("what M⁻¹J_Eᵀ makes of forces", safety_factor * worst,
                                  second_over_joints(sizes, *box, seed)),),
        budget={name: dict(zip(SOURCES, map(float, each), strict=True)) for name, each in (
            ("depth", depth), ("depth_speed", speed), ("position", position))})


class Sizes(NamedTuple):
    """Suprema of norms of matrices A(q), one or several of them."""

    force: np.ndarray | float
    """Of the columns of the force, A_f."""
    normal: np.ndarray | float
    """Of A_f n."""
    torque: np.ndarray | float
    """Of the columns of the torque."""
    by_joints: np.ndarray | float
    """(Σᵢ‖∂A_f/∂qᵢ‖²)^½, which times ‖q̇‖ bounds ‖dA_f/dt‖."""


class Suprema(NamedTuple):
    """Those of the matrices of (3)."""

    turning: float
    """‖J_ω,q‖, of the tip's angular velocity by the joints' rates."""
    depth: Sizes
    """Of n·𝔭̇."""
    position: Sizes
    """Of the tip's velocity, in its axes."""
    rotation: Sizes
    """Of its angular velocity, likewise."""
    zeta: Sizes
    """Of ν₁, ν₂ and q̇, (3,) each."""
    rows: Sizes
    """Of each row of ζ̇ (6+n,)."""


def sizes_over_joints(model: UvmsModel, declared: ConstraintSet, tool_angle: float) -> tuple[
        Callable[[np.ndarray], np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """Returns the norms by the joints and n in the cone about the tip's x-axis, and their box."""
    size, num_joints = model.size, model.num_joints
    blocks = (slice(0, 3), slice(3, 6), slice(6, size))

    def matrices(q: np.ndarray, n: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
        """Returns the matrices (..., rows, 6), and J_ω,q (..., 3, n)."""
        J_E, gain = tip_jacobian_and_gain(model, q)
        at_tip = J_E @ gain
        return [n[..., None, :] @ at_tip[..., :3, :], at_tip[..., :3, :], at_tip[..., 3:, :],
                *(gain[..., block, :] for block in blocks),
                *(gain[..., i: i + 1, :] for i in range(size))], J_E[..., 3:, 6:]

    def sizes(at: np.ndarray) -> np.ndarray:
        q, (off, about) = at[:, :num_joints], at[:, num_joints:].T
        n = np.stack([np.cos(off), np.sin(off) * np.cos(about), np.sin(off) * np.sin(about)], -1)
        moved = q[:, None, :] + 1j * COMPLEX_STEP * np.eye(num_joints)
        here, turning = matrices(q, n)
        slopes = [each.imag / COMPLEX_STEP for each in matrices(moved, n[:, None])[0]]
        columns = [_norm(turning)]
        for A, slope in zip(here, slopes, strict=True):
            columns += [_norm(A[..., :3]), _norm(A[..., :3] @ n[..., None]), _norm(A[..., 3:]),
                        np.linalg.norm(_norm(slope[..., :3]), axis=-1)]
        return np.stack(columns, axis=-1)

    return sizes, (np.append(declared.q_lower, [0.0, 0.0]),
                   np.append(declared.q_upper, [tool_angle, 2.0 * np.pi]))


def suprema_of(worst: np.ndarray) -> Suprema:
    """Returns the suprema of `sizes_over_joints` by what they are of."""
    table = worst[1:].reshape(-1, 4).T
    return Suprema(float(worst[0]), *(Sizes(*table[:, part]) for part in (
        0, 1, 2, slice(3, 6), slice(6, None))))


def _norm(A: np.ndarray) -> np.ndarray:
    """Returns spectral norms (...) of matrices (..., r, c); zero if one has no rows or columns."""
    if 0 in A.shape[-2:]:
        return np.zeros(A.shape[:-2])
    out: np.ndarray = np.linalg.norm(A, 2, axis=(-2, -1))
    return out


def reading_off(force: FeltForce, turning: float) -> float:
    """Returns how far a reading is off the forces that it stands for, ε_f + ωF̄(T + h) [N].

    They are a mean of F in Σ_I over ages of T + h at most, which a plan has counted with. A reading
    is held in axes of the tip, which turn at ω meanwhile.
    """
    return force.error + turning * force.size * force.age


def reading_input(model: UvmsModel, lower: np.ndarray, upper: np.ndarray, force: float,
                  torque: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Returns what an error e of the reading itself makes of 𝔲 and τ, M⁻¹J_Eᵀe and J_Eᵀe (6+n,).

    In one array (2(6+n),), by two searches; the first is to be claimed, with a factor.

    Args:
        model: The controller's model.
        lower: Smallest joint angles (n,) [rad].
        upper: Largest joint angles (n,) [rad].
        force: Bound of the force's part of e, see `reading_off` [N].
        torque: Bound of the torque's [N m].
        seed: Seed of the search.
    """
    def sizes(q: np.ndarray) -> np.ndarray:
        J_E, gain = tip_jacobian_and_gain(model, q)
        rows = np.concatenate([gain, J_E.swapaxes(-1, -2)], axis=-2)
        size: np.ndarray = (force * np.linalg.norm(rows[..., :3], axis=-1)
                            + torque * np.linalg.norm(rows[..., 3:], axis=-1))
        return size

    return (supremum_over_joints(sizes, lower, upper, seed),
            second_over_joints(sizes, lower, upper, seed))


def contact_input_rest(model: UvmsModel, lower: np.ndarray, upper: np.ndarray, force: float,
                       joints: float, orientation: float, seed: int = 0
                       ) -> tuple[np.ndarray, np.ndarray]:
    """Returns by how much the contact's parts of 𝔲 and of τ may differ (6+n,) inside of the tube.

    In one array (2(6+n),), by two searches; the first is to be claimed, with a factor.

    The input for a contact force f in Σ_I is M⁻¹J_fᵀR_EW f, the force J_fᵀR_EW f. A plan counts
    them at the nominal pose. Row i, aᵢ(q)ᵀR_EW f, differs at the real pose by at most

        ‖f‖ (‖∂aᵢ/∂q‖ ‖q − q̄‖ + √2 ‖aᵢ‖ ‖𝔬 − 𝔬̄‖)                                             (2)

    to first order: the angle of the rotation between two attitudes is at most √2 times the norm of
    the difference of their Euler angles, since (φ̇, θ̇, ψ̇) ↦ ω has singular values √(1 ± |sin θ|), 1.
    The orientation's part is no larger for a finite difference; the joints' is for one as small as
    a tube.

    Args:
        model: The controller's.
        lower: Smallest joint angles (n,) [rad].
        upper: Largest joint angles (n,) [rad].
        force: Bound of ‖f‖ [N].
        joints: Bound of ‖q − q̄‖₂ [rad].
        orientation: Bound of ‖𝔬 − 𝔬̄‖₂ [rad].
        seed: Seed of the search.
    """
    n = len(lower)

    def rows(q: np.ndarray) -> np.ndarray:
        """Returns all aᵢ (..., 2(6+n), 3)."""
        J_E, gain = tip_jacobian_and_gain(model, q)
        return np.concatenate([gain, J_E.swapaxes(-1, -2)], axis=-2)[..., :3]

    def rest(q: np.ndarray) -> np.ndarray:
        size = np.linalg.norm(rows(q), axis=-1)
        turned: np.ndarray = np.sqrt(2.0) * orientation * size
        if n == 0:
            return force * turned
        moved = q[:, None, :] + 1j * COMPLEX_STEP * np.eye(n)
        slopes = rows(moved).imag / COMPLEX_STEP  # (m, n, 2(6+n), 3)
        by_joints = np.linalg.norm(slopes.swapaxes(1, 2), 2, axis=(-2, -1))
        return force * (by_joints * joints + turned)

    return (supremum_over_joints(rest, lower, upper, seed),
            second_over_joints(rest, lower, upper, seed))
