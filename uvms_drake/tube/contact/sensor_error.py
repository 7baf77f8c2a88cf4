"""Effect of the errors of the force sensor on the tube of the law `resolved`, and on its input.

With the measured wrench 𝔉_s in the law, the contact leaves of the error dynamics

    ζ̇ − ζ̇_des = d + M⁻¹Jᵀ(𝔉_s − 𝔉),                                                       (1)

for any surface: its law, its place and its stiffness are in neither side. In axes of the tip,
Jᵀ(𝔉_s − 𝔉) = J_Eᵀ e, J_E the Jacobian of the tip's spatial velocity in its own axes and e the
sensor's error. Suprema are those of `sensor_gains`, proven by `sensor_gains_proof` or estimated.
tube/contact/theory.md#error-of-the-force-sensor.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from uvms_drake.model.signals.sensor_actuator import ForceReading
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.tube.contact.sensor_gains import (
    OperatorNorms,
    Suprema,
    norm,
    tip_and_slopes,
    tip_jacobian_and_gain,
)
from uvms_drake.tube.contact.sensor_gains_proof import claimed_suprema
from uvms_drake.tube.estimates import CertificateSettings, Check, no_estimates
from uvms_drake.tube.row_gains import Gains, instant_gains, lagged_gains
from uvms_drake.tube.search.constraint_set import ConstraintSet
from uvms_drake.tube.search.joint_search import claimed_over_joints


@dataclass(frozen=True)
class SensorEffect:
    """Contribution of the errors of a sensor to the radii of the law `resolved`."""

    depth: float = 0.0
    """|n·𝔢_p| [m]."""
    depth_speed: float = 0.0
    """|n·𝔢̇_p| [m/s]."""
    position: float = 0.0
    """‖𝔢_p‖ [m]."""
    orientation: float = 0.0
    """‖𝔢_o‖ [rad]."""
    tip_speed: float = 0.0
    """‖𝔢̇_p‖ [m/s]."""
    r: np.ndarray = field(default_factory=lambda: np.zeros(3))
    """𝔯 of ν₁ [m/s], ν₂ and q̇ [rad/s] (3,), 2-norms; as the next two."""
    p: np.ndarray = field(default_factory=lambda: np.zeros(3))
    """𝔭₀ = J_x⁻¹𝔢_y, were J_x to stand still (3,) [m, rad]; its last is ‖𝔢_q‖."""
    z: np.ndarray = field(default_factory=lambda: np.zeros(3))
    """𝔯 − σ𝔭₀, the linear part of ζ − ζ̄ (3,) [m/s, rad/s]."""
    u: np.ndarray | float = 0.0
    """The linear part of uᵢ − ūᵢ, with the error of the reading (6+n,) [m/s² (3), rad/s² (3+n)]."""
    w: np.ndarray = field(default_factory=lambda: np.zeros(3))
    """The same of the blocks of ν₁, ν₂ and q̇ (3,), 2-norms."""
    by_force: tuple[float, float] = (0.0, 0.0)
    """‖A_f‖ of the row of n·𝔭̈, and of those of 𝔭̈ [1/kg]."""
    by_normal: tuple[float, float] = (0.0, 0.0)
    """|A_f n| of the same [1/kg]."""
    turning: float = 0.0
    """ω, angular speed of the tip's axes [rad/s]."""
    jacobian_rate: float = np.inf
    """J̃, bound of ‖J̇_b‖ of the tip's position [1/s]."""
    proven: bool = False
    """Whether all of it is proven but `u` and `w`."""
    check: Check = no_estimates
    """Function that returns the estimates it rests on."""
    budget: dict[str, dict[str, float]] = field(default_factory=dict)
    """Parts of `depth`, `position` [m] and `depth_speed` [m/s] by their source."""
    of_others: Callable[[Any, float, float], "SensorEffect"] | None = None
    """Function that returns the effect of other `MeasuredForceBounds`, of the same lag and period,
    at bounds of ‖ν₂‖ and ‖q̇‖ [rad/s], by the same suprema."""


SOURCES = ("static reading", "delay of normal force", "delay of tangential force", "robot motion")
"""Sources of the terms of (3)."""


@dataclass(frozen=True)
class MeasuredForceBounds:
    """Bounds of the forces of a class of walls on the tip, and of the errors of their readings.

    A force is F_N n + 𝔣, n the same at all times, F_N the size of the normal force and 𝔣 the rest:
    friction, and the part of F_N by a normal off n; F_N and 𝔣 are each the sum of a slow part, of
    bounded rate, and of a ripple of bounded size, arbitrarily fast. The reading has a first-order
    lag, is held for a period, and is off by no more than `error` and `torque_error` however long
    the force stands still.
    """

    size: float
    """Largest ‖F_N n + 𝔣‖ [N]."""
    rate: float
    """Largest rate of F_N's slow part [N/s]."""
    ripple: float
    """Size of F_N's ripple [N]."""
    tangential_rate: float
    """Largest rate of 𝔣's slow part [N/s]."""
    tangential_ripple: float
    """Size of 𝔣's ripple [N]."""
    tool_angle: float
    """Largest angle between n and the tip's x-axis [rad]."""
    reading: ForceReading
    """The measurement."""
    constant_apart: bool = False
    """Whether the part of the error that never changes counts as such, as in a hold."""

    @property
    def constant(self) -> float:
        """Part of `error` that never changes in axes of the tip, as that of the tare [N]."""
        return float(np.linalg.norm(self._constant[:3]))

    @property
    def error(self) -> float:
        """Bound of ‖F̂ − F‖ at rest: noise, bias, drift, tool, payload [N]."""
        changing = self.reading.error[:3] - self._constant[:3]
        return float(np.linalg.norm(changing)) + self.constant + self.reading.payload[0]

    @property
    def torque_error(self) -> float:
        """Bound of the error of the torque about the tip, at rest [N m]."""
        return float(np.linalg.norm(self.reading.error[3:])) + self.reading.payload[1]

    @property
    def lag(self) -> float:
        """T [s]."""
        return self.reading.lag

    @property
    def period(self) -> float:
        """H [s]."""
        return self.reading.period

    @property
    def _constant(self) -> np.ndarray:
        return self.reading.constant if self.constant_apart else np.zeros(6)

    @property
    def age(self) -> float:
        """T + h, the largest mean age of a reading [s]."""
        return self.lag + self.period


def by_source(force: MeasuredForceBounds, A: OperatorNorms, known: float, missed: float, *,
              turning: float, qdot: float, moving: float = 0.0, turned: float = 0.0,
              integral: float | None = None) -> np.ndarray:
    """Returns the terms of (3) of rows with suprema A by source (number of `SOURCES`, ...).

    An error that is constant in axes of the tip moves the rate of a row by the change of A alone.

    Args:
        force: Bounds of the forces.
        A: Norms of the rows' matrices.
        known: γ.
        missed: γ′.
        turning: ω, angular speed of the tip's axes [rad/s].
        qdot: Bound of ‖q̇‖ [rad/s].
        moving: J̃‖𝔯‖, if the rows are under the filter by their velocity.
        turned: Part of Ȧ that is not by the joints, where the rows turn.
        integral: Of the rate of a row, γ of the row itself; None for others.
    """
    A_rate = A.by_joints * qdot + turned
    constant = known * A.force * force.constant if integral is None else (
        integral * A_rate * force.constant)
    return np.array([
        known * (A.force * (force.error - force.constant) + A.torque * force.torque_error)
        + constant,
        known * A.normal * force.rate * force.age + missed * A.normal * force.ripple,
        known * A.force * force.tangential_rate * force.age
        + missed * A.force * force.tangential_ripple,
        known * (A.force * turning * force.size * force.age + moving
                 + force.age * A_rate * (force.ripple + force.tangential_ripple))])


def sensor_effect_of(model: UvmsModel, declared: ConstraintSet, force: MeasuredForceBounds,
                     k: float, sigma: float, *, safety_factor: float = 1.0, seed: int = 0
                     ) -> SensorEffect:
    """Returns the effect of a force sensor's errors on the law `resolved`.

    By (1), δ = A(q)(F̂ − F) drives the rows, A = J_bM⁻¹J_Eᵀ in axes of the tip or the rows of
    M⁻¹J_Eᵀ. With the `Gains` γ of any δ and γ′ of the part that a lagging sensor misses,

        |row| ≤ γ [‖A_f‖(ε_f + (ρ′ + ωF̄)(T + h)) + ‖A_f n‖ρ(T + h) + ‖A_τ‖ε_τ + J̃‖𝔯‖
                   + (T + h) Ȧ (a + a′)] + γ′(‖A_f n‖ a + ‖A_f‖ a′),                         (3)

    Ȧ = sup‖dA_f/dt‖ and J̃ = sup‖J̇_b‖; tube/contact/theory.md#error-of-the-force-sensor.

    Args:
        model: The controller's.
        declared: The set that the suprema are over; A depends on q alone.
        force: The forces.
        k: Velocity gain [1/s].
        sigma: σ [1/s].
        safety_factor: Factor of suprema, which are searched for.
        seed: Seed of the search.
    """
    claimed = claimed_suprema(
        model, declared, force.tool_angle, safety_factor=safety_factor, seed=seed)
    row_gains = instant_gains(k, sigma), lagged_gains(k, sigma, force.lag, force.period)

    def effect(force: MeasuredForceBounds, nu2: float, qdot: float) -> SensorEffect:
        return _effect_of(claimed.suprema, force, *row_gains, nu2=nu2, qdot=qdot,
                          tip_pitch=declared.tip_pitch)

    return replace(effect(force, declared.nu2, declared.qdot), proven=claimed.proven,
                   check=claimed.check, of_others=effect)


def _effect_of(found: Suprema, force: MeasuredForceBounds, instant: Gains, missed: Gains, *,
               nu2: float, qdot: float, tip_pitch: float) -> SensorEffect:
    """Returns the effect by suprema and gains, at bounds of ‖ν₂‖, ‖q̇‖ and the tip's pitch."""
    turning = nu2 + found.turning * qdot

    def parts(gain: str, A: OperatorNorms, moving: float = 0.0, turned: float = 0.0) -> np.ndarray:
        """Returns the terms of (3) by source (number of `SOURCES`, ...)."""
        return by_source(force, A, getattr(instant, gain), getattr(missed, gain), turning=turning,
                         qdot=qdot, moving=moving, turned=turned,
                         integral=instant.position if gain == "velocity" else None)

    def through(A: OperatorNorms) -> np.ndarray:
        """Returns the bound of A e: the input contains the reading itself, besides (3)."""
        return np.asarray(
            A.force * reading_off(force, turning) + A.torque * force.torque_error)

    # Rows that are under the filter by their velocity have J̃‖𝔯‖ in (3), 𝔯 the error of ζ.
    r = np.sum(parts("error", found.zeta), axis=0)
    size_r, turned = float(np.linalg.norm(r)), turning * float(found.position.force)
    J_rate = nu2 * found.linear + qdot * found.linear_by_joints
    J_r = size_r * J_rate
    # Rows of Euler rates are E(𝔬) times those of the angular velocity.
    sine = float(np.sin(tip_pitch))
    euler = 1.0 / np.sqrt(1.0 - sine)
    euler_rate = euler * turning * np.hypot(euler, np.sqrt(1.0 + sine**2) / (1.0 - sine**2))
    euler_r = size_r * (euler_rate * found.angular
                        + euler * qdot * found.angular_by_joints)
    position = parts("position", found.position, J_r, turned)
    depth = parts("position", found.depth, J_r, turned)
    speed = parts("velocity", found.depth, J_r, turned)
    orientation = parts("position", OperatorNorms(*(euler * size for size in found.rotation)),
                        euler_r, euler_rate * float(found.rotation.force))
    return SensorEffect(
        depth=float(np.sum(depth)), depth_speed=float(np.sum(speed)),
        position=float(np.sum(position)), orientation=float(np.sum(orientation)),
        tip_speed=float(np.sum(parts("velocity", found.position, J_r, turned))),
        r=r, p=np.sum(parts("position", found.zeta), axis=0),
        z=np.sum(parts("velocity", found.zeta), axis=0),
        u=np.sum(parts("input", found.rows), axis=0) + through(found.rows),
        w=np.sum(parts("input", found.zeta), axis=0) + through(found.zeta),
        by_force=(float(found.depth.force), float(found.position.force)),
        by_normal=(float(found.depth.normal), float(found.position.normal)),
        turning=turning, jacobian_rate=J_rate,
        budget={name: dict(zip(SOURCES, map(float, each), strict=True)) for name, each in (
            ("depth", depth), ("depth_speed", speed), ("position", position))})


def reading_off(force: MeasuredForceBounds, turning: float) -> float:
    """Returns the bound of the error of a reading, ε_f + ωF̄(T + h) [N].

    They are a mean of F in Σ_I over ages of T + h at most, which a plan has counted with. A reading
    is held in axes of the tip, which turn at ω meanwhile.
    """
    return force.error + turning * force.size * force.age


def reading_input(model: UvmsModel, declared: ConstraintSet, force: float, torque: float,
                  settings: CertificateSettings) -> tuple[np.ndarray, Check]:
    """Returns claims of the effect of a reading's error e on 𝔲 and τ, M⁻¹J_Eᵀe and J_Eᵀe (6+n,).

    In one array (2(6+n),), with their check.

    Args:
        model: The controller's model.
        declared: Set of the joint angles.
        force: Bound of the force's part of e, see `reading_off` [N].
        torque: Bound of the torque's [N m].
        settings: Factor and seed of the search.
    """
    def sizes(q: np.ndarray) -> np.ndarray:
        J_E, gain = tip_jacobian_and_gain(model, q)
        rows = np.concatenate([gain, J_E.swapaxes(-1, -2)], axis=-2)
        size: np.ndarray = (force * np.linalg.norm(rows[..., :3], axis=-1)
                            + torque * np.linalg.norm(rows[..., 3:], axis=-1))
        return size

    return claimed_over_joints("effect of a reading on u and τ", sizes, declared.q_lower,
                               declared.q_upper, settings.safety_factor, settings.seed)


def contact_input_remainder(
        model: UvmsModel, declared: ConstraintSet, force: float, joints: float,
        orientation: float, settings: CertificateSettings) -> tuple[np.ndarray, Check]:
    """Returns claims of the difference of the contact's parts of 𝔲 and τ in the tube (6+n,).

    In one array (2(6+n),), with their check.

    Row i, aᵢ(q)ᵀR_EW f, of the input for a contact force f in Σ_I differs at the real pose from the
    nominal one by at most, to first order,

        ‖f‖ (‖∂aᵢ/∂q‖ ‖q − q̄‖ + √2 ‖aᵢ‖ ‖𝔬 − 𝔬̄‖),                                            (2)

    tube/contact/theory.md#contact-input-at-the-real-pose.

    Args:
        model: The controller's.
        declared: Set of the joint angles.
        force: Bound of ‖f‖ [N].
        joints: Bound of ‖q − q̄‖₂ [rad].
        orientation: Bound of ‖𝔬 − 𝔬̄‖₂ [rad].
        settings: Factor and seed of the search.
    """
    def rows(J_E: np.ndarray, gain: np.ndarray) -> np.ndarray:
        """Returns all aᵢ (..., 2(6+n), 3)."""
        return np.concatenate([gain, J_E.swapaxes(-1, -2)], axis=-2)[..., :3]

    def row_change(q: np.ndarray) -> np.ndarray:
        J_E, gain, *slopes = tip_and_slopes(model, q)
        size = np.linalg.norm(rows(J_E, gain), axis=-1)
        by_joints = norm(rows(*slopes).swapaxes(1, 2))
        out: np.ndarray = force * (by_joints * joints + np.sqrt(2.0) * orientation * size)
        return out

    return claimed_over_joints("remainder of u in contact", row_change, declared.q_lower,
                               declared.q_upper, settings.safety_factor, settings.seed)


def ripple(time: np.ndarray, signal: np.ndarray, rate: float) -> float:
    """Returns the least a ≥ 0 with ‖f(t) − f(s)‖ ≤ 2a + ρ|t − s| for all instants s, t.

    Of one component it is the least amplitude in addition to a function with ‖ṡ‖ ≤ ρ, else a lower
    bound of that. Proof: tube/contact/theory.md#ripple-and-slow-part.

    Args:
        time: Instants (T,), ascending [s].
        signal: f (T, m).
        rate: ρ.
    """
    rises = (np.linalg.norm(signal[i:] - signal[i], axis=1) - rate * (time[i:] - time[i])
             for i in range(len(time)))
    return 0.5 * max((float(np.max(rise)) for rise in rises), default=0.0)
