"""The tube of the law `tip first`: one loop for each row of its outputs y = (η, s).

By (R) of `control.laws.tip_first` each row obeys ë + (k + σ)ė + kσe = δ, δ = J_y D with D = d, to
which a contact that is felt adds M⁻¹Jᵀ(𝔉_s − 𝔉): nothing of f, M or the surface is in it. So

    ‖e_b‖ ≤ γ_e ‖δ_b‖∞,    ‖ė_b‖ ≤ γ_ė ‖δ_b‖∞,    ‖w_b‖ ≤ γ_w ‖δ_b‖∞,    w = −(K + Σ)ė − KΣe,  (1)

for blocks b of rows with the same gains, γ the L₁ norms of `row_gains`. The blocks are the
vehicle's position and attitude, and the tip's position. Of J_yŴ the vehicle's rows are Ŵ turned
and, for the Euler angles, stretched by (1 − |sin θ|)^−½ at most; the tip's are rows of J_xŴ, whose
bounds are proven. Unlike under `resolved` an error of the vehicle is none of the tip.

*What the joints do about it* is J_sq⁻¹e_s less what the vehicle needs. Where the arm is near a
singular posture that would be much, were e_s anything in its ball. But with the tip's loop G and
J_s = [J_sv J_sq], e_s = G∗(J_s D) is J_s(t)(G∗D) but for what J_s changes meanwhile, so

    J_sq⁻¹e_s = x_q,  ‖x_q‖ ≤ γ_e‖D_q‖ + ‖J_sq⁻¹J_sv‖ γ_e‖D_v‖ + ‖J_sq⁻¹‖ J̃ m_e‖D‖,       (2)

m_e = ∫t|g|dt, J̃ = sup‖J̇‖, and alike for ė and w: joints that are pushed hard move themselves, not
the tip. `tip_first_image` has the rest.
"""

from typing import NamedTuple

import numpy as np

from uvms_drake.control.laws.tip_first import TipFirst
from uvms_drake.control.laws.tip_rows import tip_rows
from uvms_drake.control.limits import TubeRadii
from uvms_drake.tube.conditions import Condition
from uvms_drake.tube.constant_check import checked_constants
from uvms_drake.tube.estimate import Check, largest_of, no_estimates, together
from uvms_drake.tube.joint_search import second_over_joints, supremum_over_joints
from uvms_drake.tube.law_tube import Basis, LawTube
from uvms_drake.tube.row_gains import Gains, instant_gains, lagged_gains, moments
from uvms_drake.tube.sensed import (
    SOURCES,
    Sizes,
    Suprema,
    by_source,
    reading_input,
    reading_off,
    sizes_over_joints,
    suprema_of,
)
from uvms_drake.tube.tip_first_image import Arm, BlockBounds, arm_of, tip_first_image

VEHICLE, ATTITUDE, TIP, DEPTH, JOINTS = "vehicle", "attitude", "position", "depth", "joints"
"""The blocks by their names in the budget; `DEPTH` is the row n·e_p, `JOINTS` x_q of (2)."""
AT_ONCE = Gains(1.0, 1.0, 1.0, 1.0)
"""Gains from D to D itself."""
Parts = dict[str, np.ndarray]
"""Bounds (3,) of e, ė and w by source."""


class _Loop(NamedTuple):
    """The gains of a loop."""

    known: Gains
    """From any δ."""
    late: Gains
    """From a force to what comes of its being felt late."""


def tip_first_law_tube(law: TipFirst, basis: Basis) -> LawTube:
    """Returns the tube of the law `tip first`; see the module."""
    model, settings = basis.model, basis.settings
    rows = tip_rows(model, tuple(law.rows))
    conditions = [Condition(f"rows of the tip's task, {name} is not among them", 1.0, "<=", 0.0)
                  for i, name in enumerate("xyz") if i not in rows]
    conditions += [Condition(f"undriven {name}, of which no bound is known", 1.0, "<=", 0.0)
                   for name in law.undriven]
    conditions += [Condition(f"{key}.observer, with which (1) is another loop [1/s]",
                             getattr(law, key).observer, "<=", 0.0)
                   for key in ("vehicle", "tip") if getattr(law, key).observer > 0.0]
    arm = arm_of(model, basis.declared, rows, settings)
    conditions.append(Condition(
        "arm, smallest singular value of J_sq, estimated", arm.regular, ">", 0.0))
    if not all(condition.holds for condition in conditions):
        return LawTube(TubeRadii(), tuple(conditions))

    vehicle, tip = (_loop(gains.k, gains.sigma, basis) for gains in (law.vehicle, law.tip))
    pushes = _Pushes(basis)
    stretch, weights = _stretch(basis.declared.pitch), basis.weights
    tip_norm = basis.row_norm("position")
    table: dict[str, Parts] = {
        VEHICLE: pushes.of(vehicle, float(np.max(weights[:3])), VEHICLE),
        ATTITUDE: pushes.of(vehicle, stretch * float(np.max(weights[3:6])), ATTITUDE),
        TIP: pushes.of(tip, tip_norm, TIP), DEPTH: pushes.of(tip, tip_norm, DEPTH),
        JOINTS: _in_joints(law, basis, arm, tip, pushes)}
    sums = {name: np.sum(list(parts.values()), axis=0) for name, parts in table.items()}
    size = model.size
    image = tip_first_image(
        model, basis.declared, rows, [BlockBounds(where, *map(float, sums[name])) for name, where
                                      in ((VEHICLE, np.arange(3)), (ATTITUDE, np.arange(3, 6)),
                                          (JOINTS, np.arange(6, size)))],
        basis.u_limit, settings, forces=basis.forces, largest_rate=basis.largest_rate)
    position, attitude = float(sums[TIP][0]), float(sums[ATTITUDE][0])
    felt = basis.contact is not None
    tube = TubeRadii(
        e=float(np.linalg.norm([position, image.orientation, image.joints])), position=position,
        orientation=image.orientation, joints=image.joints,
        z=float(np.linalg.norm([image.nu1, image.nu2, image.qdot])), nu1=image.nu1, nu2=image.nu2,
        qdot=image.qdot, tip_speed=float(sums[TIP][1]), roll=attitude, pitch=attitude,
        depth=float(sums[DEPTH][0]) if felt else None,
        depth_speed=float(sums[DEPTH][1]) if felt else None, u=image.u + pushes.reading[:size],
        tau=None if image.tau is None else image.tau + pushes.reading[size:])
    budget = {name: {source: float(value[0]) for source, value in parts.items()}
              for name, parts in table.items()}
    if felt:
        budget["depth_speed"] = {source: float(value[1]) for source, value in table[DEPTH].items()}
    else:
        del budget[DEPTH]
    return LawTube(tube, tuple(conditions), budget, tuple(vars(tube)),
                   together(arm.check, pushes.check, image.check, lambda: checked_constants(
                       model, basis.declared, (basis.constants["J_dot_max"],), settings.seed)))


def _loop(k: float, sigma: float, basis: Basis) -> _Loop:
    """Returns the loop of rows with these gains."""
    known, contact = instant_gains(k, sigma), basis.contact
    return _Loop(known, known if contact is None else lagged_gains(
        k, sigma, contact.lag, contact.period))


def _stretch(angle: float) -> float:
    """Returns (1 − sin θ)^−½, the norm of what makes Euler rates of an angular velocity."""
    return float((1.0 - np.sin(angle)) ** -0.5)


def _in_joints(law: TipFirst, basis: Basis, arm: Arm, tip: _Loop, pushes: "_Pushes") -> Parts:
    """Returns the bounds of x_q by source, by (2)."""
    J_dot, weights = basis.value("J_dot_max"), basis.weights
    lost = J_dot / arm.regular * np.array(moments(law.tip.k, law.tip.sigma)[:3])
    carried = arm.carried * float(np.max(weights[:6]))
    out = {"d": basis.d_bound * ((float(np.max(weights[6:])) + carried) * np.array(tip.known[:3])
                                 + lost)}
    if basis.contact is None:
        return out
    own, moved = (pushes.felt(tip, pushes.zeta(blocks)) for blocks in ([2], [0, 1]))
    whole = pushes.felt(_Loop(AT_ONCE, Gains(*(2.0 * gain for gain in AT_ONCE))),
                        pushes.zeta([0, 1, 2]))
    return out | {source: own[source] + arm.carried * moved[source] + lost * whole[source]
                  for source in SOURCES}


class _Pushes:
    """What pushes the rows: d, and what a force sensor is off by, see (3) of `sensed`.

    Without J̃‖𝔯‖ in (3): here the rows themselves are driven by A(q)(F̂ − F).

    Args:
        basis: The data.
    """

    reading: np.ndarray
    """What the error of the reading adds to u and τ (2(6+n),), see `reading_input`."""
    check: Check = no_estimates

    def __init__(self, basis: Basis):
        self._basis, contact = basis, basis.contact
        self._found: Suprema | None = None
        self.reading = np.zeros(2 * basis.model.size)
        if contact is None:
            return
        declared, settings = basis.declared, basis.settings
        sizes, box = sizes_over_joints(basis.model, declared, contact.tool_angle)
        worst = supremum_over_joints(sizes, *box, settings.seed)
        found = self._found = suprema_of(worst)
        factor = settings.safety_factor
        self._turning = declared.nu2 + factor * found.turning * declared.qdot
        each, second = reading_input(
            basis.model, declared.q_lower, declared.q_upper,
            reading_off(contact, self._turning), contact.torque_error, settings.seed)
        self.reading = factor * each
        self.check = lambda: (
            largest_of("what M⁻¹J_Eᵀ makes of forces", factor * worst,
                       second_over_joints(sizes, *box, settings.seed)),
            largest_of("what a reading adds to u and τ", factor * each, second))
        stretch, sine = _stretch(declared.pitch), np.sin(declared.pitch)
        turning = stretch * np.hypot(stretch, np.sqrt(1.0 + sine**2) / (1.0 - sine**2))
        vehicle, attitude = self.zeta([0]), self.zeta([1])
        tip_turned = self._turning * float(found.position.force)
        self._rows: dict[str, tuple[Sizes, float]] = {
            VEHICLE: (vehicle, declared.nu2 * float(vehicle.force)),
            ATTITUDE: (Sizes(*(stretch * size for size in attitude)),
                       float(declared.nu2 * turning * attitude.force)),
            TIP: (found.position, tip_turned), DEPTH: (found.depth, tip_turned)}
        """Suprema of A of each block, and how fast its axes turn A."""

    def zeta(self, blocks: list[int]) -> Sizes:
        """Returns suprema of the rows of ν₁, ν₂ and q̇ (0, 1, 2) of M⁻¹J_Eᵀ, some of them."""
        assert self._found is not None
        return Sizes(*(float(np.linalg.norm(np.asarray(size)[blocks]))
                       for size in self._found.zeta))

    def of(self, loop: _Loop, norm: float, name: str) -> Parts:
        """Returns the bounds of a block by source.

        Args:
            loop: Its loop.
            norm: Bound of ‖J_bŴ‖.
            name: Of the block.
        """
        by_d = {"d": self._basis.d_bound * norm * np.array(loop.known[:3])}
        return by_d if self._found is None else by_d | self.felt(loop, *self._rows[name])

    def felt(self, loop: _Loop, A: Sizes, turned: float = 0.0) -> Parts:
        """Returns what the sensor's errors make of rows with suprema A, by source."""
        contact, basis = self._basis.contact, self._basis
        assert contact is not None
        terms = np.array([
            by_source(contact, A, known, late, turning=self._turning, qdot=basis.declared.qdot,
                      turned=turned, safety_factor=basis.settings.safety_factor)
            for known, late in zip(loop.known[:3], loop.late[:3], strict=True)])
        return dict(zip(SOURCES, terms.T, strict=True))
