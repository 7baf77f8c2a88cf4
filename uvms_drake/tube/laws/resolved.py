"""Tube of the law `resolved` on the dynamics ζ̇ = f(𝔮, ζ) + u + d, ‖Ŵ⁻¹d‖₂ ≤ d̃.

Ŵ is diagonal with a largest entry of 1: ‖d‖₂ ≤ d̃, and a proof for this ball holds. Theorem:
tube/theory.md#tube-of-the-law-resolved.

Given a nominal state (𝔮̄, ζ̄), a nominal input ū and errors (𝔢_y, 𝔯), the real state and input
follow by algebra, and with 𝔭 = J_x(𝔮)⁻¹𝔢_y the largest parts are linear,

    ζ − ζ̄ = 𝔯 − σ𝔭 + remainder,    u − ū = −(k + σ)𝔯 + σ²𝔭 + remainder.                    (1)

The linear parts are d through filters, bounded by their L₁ norms (`joint_rate_radius`,
`input_gain`), for the 𝔭₀ of a constant J_x; `preimage_shift` bounds 𝔭 − 𝔭₀. The remainders, and ω
and α of that shift, are estimates of suprema: found by `ascent`, multiplied by a declared factor,
and searched for again by `second_search`. See
tube/theory.md#image-of-the-tube-under-the-law-resolved.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from uvms_drake.control.laws.resolved import Resolved
from uvms_drake.control.limits import TubeRadii
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.tube import row_gains
from uvms_drake.tube.conditions import Condition
from uvms_drake.tube.contact.hold import HoldLaw, TipBounds
from uvms_drake.tube.contact.sensor_error import MeasuredForceBounds, SensorEffect, sensor_effect_of
from uvms_drake.tube.contact.tip_motion import TipAcceleration
from uvms_drake.tube.estimates import Check, together
from uvms_drake.tube.law_tube import PROVEN, WEIGHTED, Basis, LawTube, register_tube
from uvms_drake.tube.laws.resolved_remainders import RemainderProblem, turning
from uvms_drake.tube.search.ascent import first_order
from uvms_drake.tube.search.constraint_set import ConstraintSet
from uvms_drake.tube.search.joint_search import claimed_over_joints
from uvms_drake.tube.search.search_problem import Part, norm_problem
from uvms_drake.tube.search.second_search import claimed

PATIENCE = 2
"""Factor of the steps of the search for ω, which is cheaper than that for remainders."""


class TubeImage(NamedTuple):
    """Largest deviation of the real from the nominal, per channel."""

    radii: TubeRadii
    """Its `nu1`, `nu2`, `qdot`, `roll`, `pitch`, `u`, and `tau`, τ = M(𝔮)𝔲, if it is needed."""
    omega: float
    """Bound ω of ‖J_x⁻¹J̇_x‖₂ [1/s]."""
    check: Check
    """Function that returns its estimates."""


@dataclass(frozen=True)
class _Errors:
    """Sets of (𝔢_y, 𝔯), as sums of ellipsoids."""

    radii: tuple[float, float, float, float]
    """Radii of 𝔢_p, 𝔢_o, Ŵ⁻¹𝔢_q and Ŵ⁻¹𝔯."""
    weights: np.ndarray
    """Diagonal of Ŵ (6+n,)."""
    shift: float
    """Shift of 𝔭, in the vehicle's components: the joints' rows of J_x⁻¹J̇_x are zero."""
    sensor_effect: SensorEffect
    """Additional effect of a sensed contact, besides 𝔢_p and 𝔢_o."""

    def of_blocks(self) -> list[Part]:
        """Returns the parts of (𝔢_y, 𝔯): a ball for each block."""
        size = len(self.weights)
        axes = np.diag(np.concatenate([np.ones(6), self.weights[6:], self.weights]))
        blocks = (slice(0, 3), slice(3, 6), slice(6, size), slice(size, 2 * size))
        return _filled([*zip((axes[:, block] for block in blocks), self.radii, strict=True),
                        *self._sensor_parts((0.0, 0.0, float(self.sensor_effect.p[2])))])

    def of_preimage(self) -> list[Part]:
        """Returns the parts of (𝔭, 𝔯): of 𝔭₀, δ and Ŵ⁻¹𝔯."""
        size = len(self.weights)
        *_, radius, r = self.radii
        eye = np.eye(2 * size)
        axes = eye * np.tile(self.weights, 2)
        return _filled([(axes[:, :size], radius), (eye[:, :6], self.shift), (axes[:, size:], r),
                        *self._sensor_parts(tuple(self.sensor_effect.p))])

    def _sensor_parts(self, p: tuple[float, ...]) -> list[Part]:
        """Returns balls in the blocks of 𝔢_y or 𝔭, of radii `p`, and of 𝔯, of the sensor's."""
        size = len(self.weights)
        eye, blocks = np.eye(2 * size), _blocks(size)
        return [*((eye[:, block], float(radius)) for block, radius in zip(blocks, p, strict=True)),
                *((eye[:, size:][:, block], float(radius))
                  for block, radius in zip(blocks, self.sensor_effect.r, strict=True))]


def _filled(parts: list[Part]) -> list[Part]:
    return [(matrix, radius) for matrix, radius in parts if radius > 0.0 and matrix.shape[1] > 0]


def _blocks(size: int) -> tuple[slice, slice, slice]:
    """Returns the components of ν₁, ν₂ and q̇."""
    return slice(0, 3), slice(3, 6), slice(6, size)


def tube_image(model: ContactModel, constraint_set: ConstraintSet, u_limits: np.ndarray, *,
               d_bound: float, gains: tuple[float, float], k: float, sigma: float,
               samples: int, safety_factor: float, seed: int,
               weights: np.ndarray | float = 1.0, sensor_effect: SensorEffect | None = None,
               largest_rate: np.ndarray | float = np.inf, forces: bool = True) -> TubeImage:
    """Returns the deviations over the constraint set; infinite if σ ≤ ω.

    Args:
        model: The prediction model.
        constraint_set: Set of nominal and real states.
        u_limits: |ūᵢ| (6+n,).
        d_bound: d̃ [m/s², rad/s²].
        gains: Bounds of the norms of the position rows and the orientation rows of J_x Ŵ.
        k: Velocity gain [1/s].
        sigma: σ [1/s].
        samples: Number of nominal states from the worst of which the ascent starts.
        safety_factor: Factor of estimated suprema.
        seed: Seed of the searches.
        weights: Diagonal of Ŵ (6+n,), at most 1; 1 for a ball.
        sensor_effect: Effect of the errors of a force sensor, if the contact is sensed.
        largest_rate: Bounds of |ζ̄̇ᵢ| (6+n,), in addition to those by |ūᵢ|.
        forces: True if τ is needed.
    """
    sensor_effect, size = sensor_effect or SensorEffect(), model.size
    weights = weights * np.ones(size)
    # The growth rate of J_x⁻¹, and so the distance of 𝔭 from 𝔭₀.
    x = norm_problem(model, constraint_set, turning).draw(samples, np.random.default_rng(seed))

    def largest_turning(name: str, weights: np.ndarray) -> tuple[float, Check]:
        problem = norm_problem(model, constraint_set, turning, weights)
        claim, check = claimed(
            problem, [name], x, first_order(problem, x), safety_factor, seed, PATIENCE)
        return float(claim[0]), check

    omega, check = largest_turning("ω", np.ones(size))
    alpha = omega
    if np.any(weights != 1.0):
        alpha, of_alpha = largest_turning("α", weights)
        check = together(check, of_alpha)
    shift = row_gains.preimage_shift(k, sigma, d_bound, omega, alpha)
    if np.any(sensor_effect.p):  # ‖J_x⁻¹J̇_x𝔭₀‖ ≤ ω‖𝔭₀‖
        drift = omega * float(np.linalg.norm(sensor_effect.p))
        shift += drift / (sigma - omega) if omega < sigma else np.inf
    if not np.isfinite(shift):
        none = np.full(size, np.inf)
        return TubeImage(TubeRadii(z=np.inf, nu1=np.inf, nu2=np.inf, qdot=np.inf, roll=np.inf,
                                   pitch=np.inf, u=none, tau=none if forces else None),
                         omega, check)

    # The remainders, each over the set of errors in which it is smaller.
    radius = d_bound / (k * sigma)
    errors = _Errors((gains[0] * radius + sensor_effect.position,
                      gains[1] * radius + sensor_effect.orientation, radius, d_bound / k),
                     weights, shift, sensor_effect)
    problems = [RemainderProblem(model, constraint_set, errors.of_blocks(), u_limits, k, sigma,
                                 forces=forces, largest_rate=largest_rate)]
    if np.any(weights != 1.0) or np.any(sensor_effect.p):
        problems.append(replace(problems[0], parts=errors.of_preimage(), preimage=True))
    names = [f"remainder of {name}" for name in (
        "ν₁", "ν₂", "φ", "θ", *(f"{name}[{i}]" for name in ("u", "τ") for i in range(size)))]
    values = [first_order(each, x) for each in problems]
    if len(problems) == 1:  # Their proven bounds are hardly larger.
        values[0][:, 2:4] = 0.0
    smaller = np.argmin([np.max(each, axis=0) for each in values], axis=0)
    claims, checks = zip(*(claimed(problem, names, x, each * (smaller == i), safety_factor, seed)
                           for i, (problem, each) in enumerate(zip(
                               problems, values, strict=True))), strict=True)
    remainders = np.sum(claims, axis=0)
    roll, pitch = map(float, remainders[2:4]) if len(problems) > 1 else row_gains.attitude_radii(
        constraint_set, model.R_WT, errors.radii[1], errors.radii[2], model.num_joints)

    # The linear parts by their filters, with the shift δ of 𝔭; the remainders by search.
    d_of = [d_bound * float(np.max(weights[block], initial=0.0)) for block in _blocks(size)]
    z = np.array([row_gains.joint_rate_radius(k, sigma, d) for d in d_of]) + sensor_effect.z
    u, extra = row_gains.input_gain(k, sigma) * d_bound, sigma**2 * shift
    tau = None
    if forces:
        inertia, of_inertia = _inertia(model, constraint_set, weights, safety_factor, seed)
        checks += (of_inertia,)
        weighted, plain = inertia[:, :2].T
        tau = (remainders[4 + size:] + weighted * u + plain * extra
               + inertia[:, 2:] @ sensor_effect.w)
    nu1, nu2 = (float(remainders[i] + z[i] + sigma * shift) for i in (0, 1))
    return TubeImage(
        TubeRadii(z=float(np.linalg.norm([nu1, nu2, float(z[2])])), nu1=nu1, nu2=nu2,
                  qdot=float(z[2]), roll=roll, pitch=pitch, tau=tau,
                  u=remainders[4: 4 + size] + weights * u + extra + sensor_effect.u),
        omega, together(check, *checks))


def _inertia(model: ContactModel, declared: ConstraintSet, weights: np.ndarray,
             safety_factor: float, seed: int) -> tuple[np.ndarray, Check]:
    """Returns the largest norms of each row of MŴ, M and its columns of ν₁, ν₂, q̇ (6+n, 5)."""
    size = model.size

    def norms(q: np.ndarray) -> np.ndarray:
        config = np.concatenate([np.zeros((len(q), 6)), q], axis=1)
        M = model.mass_matrix(model.kinematics(config))
        parts = [M * weights, M, *(M[:, :, block] for block in _blocks(size))]
        return np.concatenate([np.linalg.norm(part, axis=2) for part in parts], axis=1)

    claim, check = claimed_over_joints(
        "rows of M", norms, declared.q_lower, declared.q_upper, safety_factor, seed)
    return claim.reshape(5, size).T, check


ESTIMATED = ("z", "nu1", "nu2", "u", "tau", "between_knots")
"""Estimated radii of `resolved` in a ball of disturbances."""


def resolved_constants(law: Resolved, weights: np.ndarray) -> tuple[str, ...]:
    """Returns the names of the constants of the law `resolved`: norms of the rows of J_xŴ."""
    return tuple(name if np.all(weights == 1.0) else WEIGHTED[name] for name in PROVEN.values())


def resolved_task_radius(law: Resolved, basis: Basis) -> float:
    """Returns the bound of ‖𝔢_y‖ under the law `resolved`."""
    return row_gains.resolved_tube(law.k, law.sigma, basis.d_bound, basis.row_norm("task")).e


@register_tube(Resolved, resolved_constants)
def resolved_law_tube(law: Resolved, basis: Basis) -> LawTube:
    """Returns the tube of the law `resolved`; see `resolved_tube` and `tube_image`.

    With a sensed contact, the effects of d and of the sensor's errors add up.
    """
    # The rows under d alone, and the additional effect of the force sensor.
    k, sigma, d, settings = law.k, law.sigma, basis.d_bound, basis.settings
    gains = basis.row_norm("position"), basis.row_norm("orientation")
    position, orientation = (row_gains.resolved_tube(k, sigma, d, each).e for each in gains)
    sensor_effect = SensorEffect() if basis.contact is None else sensor_effect_of(
        basis.model, basis.declared, basis.contact, k, sigma,
        safety_factor=settings.safety_factor, seed=settings.seed)
    image = tube_image(
        basis.model, basis.declared, basis.u_limit, d_bound=d, weights=basis.weights, gains=gains,
        k=k, sigma=sigma, samples=settings.tube_samples, safety_factor=settings.safety_factor,
        seed=settings.seed, sensor_effect=sensor_effect, largest_rate=basis.largest_rate,
        forces=basis.forces)

    # Both parts of each radius add up; along n the sensor's part is smaller than in all directions.
    tip_speed = 2.0 * sigma * position
    sensor_norm = float(np.linalg.norm(
        [sensor_effect.position, sensor_effect.orientation, sensor_effect.p[2]]))
    tube = replace(
        image.radii, e=resolved_task_radius(law, basis) + sensor_norm,
        position=position + sensor_effect.position,
        orientation=orientation + sensor_effect.orientation,
        joints=row_gains.resolved_tube(k, sigma, d, float(np.max(basis.weights[6:], initial=0.0))).e
        + float(sensor_effect.p[2]), tip_speed=tip_speed + sensor_effect.tip_speed)
    if basis.contact is not None:
        tube = replace(tube, depth=position + sensor_effect.depth,
                       depth_speed=tip_speed + sensor_effect.depth_speed)
    by_d = {"depth": position, "depth_speed": tip_speed, "position": position}
    budget = {name: {"d": by_d[name], **parts} for name, parts in sensor_effect.budget.items()}

    # Radii that are searched for, besides those with a proof.
    condition = Condition("σ, above ω = sup‖J_x⁻¹J̇_x‖", sigma, ">", image.omega,
                          theorem="tube/theory.md#image-of-the-tube-under-the-law-resolved",
                          topic="σ")
    estimated: tuple[str, ...] = ESTIMATED
    if np.any(basis.weights != 1.0) or np.any(sensor_effect.p):
        estimated += ("roll", "pitch")
    if basis.contact is not None and not sensor_effect.proven:
        estimated = tuple(vars(tube))
    check = together(image.check, sensor_effect.check)
    of_others = sensor_effect.of_others
    if of_others is None:
        return LawTube(tube, (condition,), budget, estimated, check)

    def in_hold(force: MeasuredForceBounds, nu2: float, qdot: float) -> TipBounds:
        """Returns the radii for other forces, with the same remainders.

        d moves the tip's rows like the sensor does, by the gain of a rate and with J̃‖𝔯‖.
        """
        effect = of_others(force, nu2, qdot)
        more = effect.z - sensor_effect.z
        assert tube.nu2 is not None and tube.qdot is not None
        by_d = min(tip_speed, row_gains.joint_rate_radius(
            k, sigma, d * gains[0] + effect.jacobian_rate * d / k))
        return TipBounds(position + effect.depth, position + effect.position,
                         by_d + effect.depth_speed, by_d + effect.tip_speed,
                         tube.nu2 + float(more[1]), tube.qdot + float(more[2]))

    # The rows turn with J under the filter of k: J̃‖𝔯‖ is an acceleration of its own.
    turned = sensor_effect.jacobian_rate * (float(np.linalg.norm(sensor_effect.r)) + d / k)
    along = TipAcceleration(sensor_effect.by_force, sensor_effect.by_normal,
                            sensor_effect.turning, d * gains[0] + turned)
    return LawTube(tube, (condition,), budget, estimated, check,
                   HoldLaw(in_hold, k, sigma), along)
