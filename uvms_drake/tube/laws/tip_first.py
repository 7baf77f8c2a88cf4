"""Tube of the law `tip first`: one loop for each row of its outputs y = (η, s).

Each row obeys ë + (k + σ)ė + kσe = δ, δ = J_y D, and with the gains γ of the loop

    ‖e_b‖ ≤ γ_e ‖δ_b‖∞,    ‖ė_b‖ ≤ γ_ė ‖δ_b‖∞,    ‖w_b‖ ≤ γ_w ‖δ_b‖∞,    w = −(K + Σ)ė − KΣe,  (1)
    ‖J_sq⁻¹e_s‖ ≤ γ_e‖D_q‖ + ‖J_sq⁻¹J_sv‖ γ_e‖D_v‖ + ‖J_sq⁻¹‖ J̃ m_e‖D‖,                   (2)

for blocks b of rows with the same gains: the vehicle's position and attitude, the tip's position,
and the joints. Each radius is the sum of gain × bound of all sources. Of commands that act late
there is no tube. See tube/theory.md#tube-of-the-law-tip-first.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from uvms_drake.control.laws.outputs import tip_rows
from uvms_drake.control.laws.tip_first import TipFirst
from uvms_drake.control.limits import TubeRadii
from uvms_drake.tube.conditions import Condition, assumption
from uvms_drake.tube.constants import checked_constants
from uvms_drake.tube.contact.hold import HoldLaw, TipBounds
from uvms_drake.tube.contact.sensor_error import (
    SOURCES,
    MeasuredForceBounds,
    by_source,
    reading_input,
    reading_off,
)
from uvms_drake.tube.contact.sensor_gains import OperatorNorms, Suprema
from uvms_drake.tube.contact.sensor_gains_proof import claimed_suprema
from uvms_drake.tube.contact.tip_motion import TipAcceleration
from uvms_drake.tube.estimates import Check, no_estimates, together
from uvms_drake.tube.law_tube import PROVEN, WEIGHTED, Basis, LawTube, register_tube
from uvms_drake.tube.laws.tip_first_image import (
    Arm,
    arm_of,
    block_bounds,
    tip_first_image,
)
from uvms_drake.tube.row_gains import instant_gains, lagged_gains, moments

VEHICLE, ATTITUDE, TIP, DEPTH, JOINTS = "vehicle", "attitude", "position", "depth", "joints"
"""The blocks by their names in the budget; `DEPTH` is the row n·e_p, `JOINTS` x_q of (2)."""
Parts = dict[str, np.ndarray]
"""Bounds (4,) of e, ė, w and ë by source."""


E, RATE, W, ACCELERATION = range(4)
"""Columns of gains and bounds of e, ė, w and ë."""


class LoopGains(NamedTuple):
    """Gains of a loop, to e, ė, w and ë (4,)."""

    known: np.ndarray
    """Gains from any δ."""
    missed: np.ndarray
    """Gains from a force to the effect of its delayed measurement."""
    moment: np.ndarray
    """First moments ∫t|g|."""


def loop_gains(k: float, sigma: float, basis: Basis) -> LoopGains:
    """Returns the gains of a row with k and σ; see `lagged_gains`."""
    # ë is the feedback, and the disturbance.
    gains, moment, contact = instant_gains(k, sigma)[:3], moments(k, sigma)[:3], basis.contact
    known = np.array([*gains, 1.0 + gains[W]])
    missed = 2.0 * known
    if contact is not None:
        missed[:3] = lagged_gains(k, sigma, contact.lag, contact.period)[:3]
    return LoopGains(known, missed, np.array([*moment, moment[W]]))


class DisturbanceInputs:
    """Disturbance inputs of the rows: d, and the force sensor's error, see (3) of `sensor_error`.

    Without J̃‖𝔯‖ in (3): here the rows themselves are driven by A(q)(F̂ − F).

    Args:
        basis: The data.
    """

    reading: np.ndarray
    """Contribution of the error of the reading to u and τ (2(6+n),), see `reading_input`."""
    check: Check = no_estimates
    turning = 0.0
    """ω, angular speed of the tip's axes [rad/s]."""

    def __init__(self, basis: Basis):
        self._basis, contact = basis, basis.contact
        self._found: Suprema | None = None
        self.reading = np.zeros(2 * basis.model.size)
        if contact is None:
            return
        declared, settings = basis.declared, basis.settings
        claimed = claimed_suprema(basis.model, declared, contact.tool_angle,
                                  safety_factor=settings.safety_factor, seed=settings.seed)
        self._found = found = claimed.suprema
        self.turning = declared.nu2 + found.turning * declared.qdot
        self.reading, check = reading_input(
            basis.model, declared, reading_off(contact, self.turning), contact.torque_error,
            settings)
        self.check = together(claimed.check, check)
        stretch, sine = euler_stretch(declared.pitch), np.sin(declared.pitch)
        turning = stretch * np.hypot(stretch, np.sqrt(1.0 + sine**2) / (1.0 - sine**2))
        vehicle, attitude = self.zeta([0]), self.zeta([1])
        tip_turned = self.turning * float(found.position.force)
        self._rows: dict[str, tuple[OperatorNorms, float]] = {
            VEHICLE: (vehicle, declared.nu2 * float(vehicle.force)),
            ATTITUDE: (OperatorNorms(*(stretch * size for size in attitude)),
                       float(declared.nu2 * turning * attitude.force)),
            TIP: (found.position, tip_turned), DEPTH: (found.depth, tip_turned)}
        """Suprema of A of each block, and the rate of A by the turn of its axes."""

    @property
    def norms(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """‖A_f‖, then |A_f n|, of the row of n·𝔭̈ and of those of 𝔭̈ [1/kg]."""
        along, whole = self._rows[DEPTH][0], self._rows[TIP][0]
        return ((float(along.force), float(whole.force)),
                (float(along.normal), float(whole.normal)))

    def zeta(self, blocks: list[int]) -> OperatorNorms:
        """Returns suprema of some of the rows of ν₁, ν₂ and q̇ (0, 1, 2) of M⁻¹J_Eᵀ."""
        assert self._found is not None
        return OperatorNorms(*(float(np.linalg.norm(np.asarray(size)[blocks]))
                       for size in self._found.zeta))

    def of(self, loop: LoopGains, norm: float, name: str) -> Parts:
        """Returns the bounds of a block by source.

        Args:
            loop: Gains of its loop.
            norm: Bound of ‖J_bŴ‖.
            name: Name of the block.
        """
        by_d = {"d": self._basis.d_bound * norm * loop.known}
        return by_d if self._found is None else by_d | self.sensor_parts(loop, *self._rows[name])

    def sensor_parts(self, loop: LoopGains, A: OperatorNorms, turned: float = 0.0) -> Parts:
        """Returns the effect of the sensor's errors on rows with suprema A, by source."""
        contact, basis = self._basis.contact, self._basis
        assert contact is not None
        return _sensor_parts(contact, loop, A, self.turning, basis.declared.qdot, turned)

    def for_other(self, force: MeasuredForceBounds, nu2: float, qdot: float, loop: LoopGains,
                  name: str) -> Parts:
        """Returns the effect on a block of the tip's rows for other forces, by source.

        Args:
            force: The forces, of the same sensor.
            nu2: Bound of ‖ν₂‖ [rad/s].
            qdot: Bound of ‖q̇‖ [rad/s].
            loop: Gains of the tip's loop.
            name: Name of the block.
        """
        assert self._found is not None
        turning = nu2 + self._found.turning * qdot
        turned = turning * float(self._found.position.force)
        return _sensor_parts(force, loop, self._rows[name][0], turning, qdot, turned)


def _sensor_parts(force: MeasuredForceBounds, loop: LoopGains, A: OperatorNorms, turning: float,
                  qdot: float, turned: float) -> Parts:
    """Returns the effect of a sensor's errors on rows with suprema A, by source."""
    terms = np.array([
        by_source(force, A, known, missed, turning=turning, qdot=qdot, turned=turned,
                  integral=float(loop.known[E]) if column == RATE else None)
        for column, (known, missed) in enumerate(zip(loop.known, loop.missed, strict=True))])
    return dict(zip(SOURCES, terms.T, strict=True))


def in_joints(basis: Basis, arm: Arm, tip: LoopGains, inputs: DisturbanceInputs) -> Parts:
    """Returns the bounds of x_q by source, by (2)."""
    J_dot, weights = basis.value("J_dot_max"), basis.weights
    lost = J_dot / arm.regular * tip.moment
    carried = arm.carried * float(np.max(weights[:6]))
    out = {"d": basis.d_bound * ((float(np.max(weights[6:])) + carried) * tip.known
                                 + lost)}
    if basis.contact is None:
        return out
    own, moved = (inputs.sensor_parts(tip, inputs.zeta(blocks)) for blocks in ([2], [0, 1]))
    whole = inputs.sensor_parts(tip._replace(known=np.ones(4), missed=np.full(4, 2.0)),
                        inputs.zeta([0, 1, 2]))
    return out | {source: own[source] + arm.carried * moved[source] + lost * whole[source]
                  for source in SOURCES}


def euler_stretch(angle: float) -> float:
    """Returns (1 − sin θ)^−½, the norm of the map from angular velocity to Euler rates."""
    return float((1.0 - np.sin(angle)) ** -0.5)


THEOREM = "tube/theory.md#tube-of-the-law-tip-first"
"""Theorem of the conditions on task, arm and actuation."""


def tip_first_constants(law: TipFirst, weights: np.ndarray) -> tuple[str, ...]:
    """Returns the names of the constants of the law `tip first`, for the diagonal of Ŵ."""
    name = PROVEN["position"]
    return name if np.all(weights == 1.0) else WEIGHTED[name], "J_dot_max"


@register_tube(TipFirst, tip_first_constants)
def tip_first_law_tube(law: TipFirst, basis: Basis) -> LawTube:
    """Returns the tube of the law `tip first`; see the module."""
    # Task, actuation and arm: without these conditions there is nothing to compute.
    model, settings, rows = basis.model, basis.settings, tip_rows(basis.model, tuple(law.rows))
    conditions = _structural_conditions(law, basis, rows)
    arm = arm_of(model, basis.declared, rows, settings)
    conditions.append(Condition(
        "arm, smallest singular value of J_sq, estimated", arm.regular, ">", 0.0,
        theorem=THEOREM))
    if any(not condition.holds and condition.topic != "undriven" for condition in conditions):
        return LawTube(TubeRadii(), tuple(conditions))

    # Disturbance and sensor by block of rows: the sums are the radii, the parts are the budget.
    vehicle, tip = (loop_gains(gains.k, gains.sigma, basis) for gains in (law.vehicle, law.tip))
    inputs = DisturbanceInputs(basis)
    table = _table(basis, arm, inputs, vehicle, tip)
    sums = {name: np.sum(list(parts.values()), axis=0) for name, parts in table.items()}
    budget = {name: {source: float(value[E]) for source, value in parts.items()}
              for name, parts in table.items()}
    sensed = basis.contact is not None
    if sensed:
        budget["depth_speed"] = {
            source: float(value[RATE]) for source, value in table[DEPTH].items()}
    else:
        del budget[DEPTH]
    if not all(condition.holds for condition in conditions):
        return LawTube(TubeRadii(), tuple(conditions), budget)

    # The other radii are images of those of the rows.
    image, check_image = tip_first_image(
        model, basis.declared, rows, block_bounds(sums, model.size), basis.u_limit, settings,
        forces=basis.forces, largest_rate=basis.largest_rate, tip=float(sums[TIP][E]))
    attitude, (by_u, by_tau) = float(sums[ATTITUDE][E]), np.split(inputs.reading, 2)
    tube = replace(
        image, tip_speed=float(sums[TIP][RATE]), roll=attitude, pitch=attitude,
        depth=float(sums[DEPTH][E]) if sensed else None,
        depth_speed=float(sums[DEPTH][RATE]) if sensed else None, u=image.u + by_u,
        tau=None if image.tau is None else image.tau + by_tau)

    def in_hold(force: MeasuredForceBounds, nu2: float, qdot: float) -> TipBounds:
        """Returns the radii for other forces; other sources, and speeds, as they are."""
        by_row = [sums[name] - np.sum([table[name][source] for source in SOURCES], axis=0)
                  + np.sum(list(inputs.for_other(force, nu2, qdot, tip, name).values()), axis=0)
                  for name in (DEPTH, TIP)]
        (depth, position), (depth_speed, tip_speed) = np.array(by_row)[:, [E, RATE]].T
        assert tube.nu2 is not None and tube.qdot is not None
        return TipBounds(float(depth), float(position), float(depth_speed), float(tip_speed),
                         tube.nu2, tube.qdot)

    return LawTube(tube, tuple(conditions), budget, tuple(vars(tube)), together(
        arm.check, inputs.check, check_image, lambda: checked_constants(
            model, basis.declared, (basis.constants["J_dot_max"],), settings.seed)),
        HoldLaw(in_hold, law.tip.k, law.tip.sigma) if sensed else None,
        TipAcceleration(
            *inputs.norms, inputs.turning, basis.d_bound * basis.row_norm("position"))
        if sensed else None)


def _table(basis: Basis, arm: Arm, inputs: DisturbanceInputs, vehicle: LoopGains, tip: LoopGains
           ) -> dict[str, Parts]:
    """Returns the parts of the blocks by disturbance and sensor, for the gains of their loops."""
    stretch, weights = euler_stretch(basis.declared.pitch), basis.weights
    tip_norm = basis.row_norm("position")
    return {
        VEHICLE: inputs.of(vehicle, float(np.max(weights[:3])), VEHICLE),
        ATTITUDE: inputs.of(vehicle, stretch * float(np.max(weights[3:6])), ATTITUDE),
        TIP: inputs.of(tip, tip_norm, TIP), DEPTH: inputs.of(tip, tip_norm, DEPTH),
        JOINTS: in_joints(basis, arm, tip, inputs)}


def _structural_conditions(law: TipFirst, basis: Basis, rows: np.ndarray) -> list[Condition]:
    """Returns conditions that fail: a task without position, actuation without a bound."""
    failed = [assumption("rows of the tip's task", f"{name} is not among them", theorem=THEOREM)
              for i, name in enumerate("xyz") if i not in rows]
    failed += [assumption(f"undriven {name}", "of which no bound is known", topic="undriven",
                          theorem=THEOREM)
               for name in law.undriven]
    if any(basis.command_path):
        failed.append(assumption("actuation that delays a command", "of which no tube is proven",
                                 topic="actuation path", theorem=THEOREM))
    failed += [assumption(f"an observer of {key}", "of which no tube is proven",
                          topic="actuation path", theorem=THEOREM)
               for key in ("vehicle", "tip") if getattr(law, key).observer > 0.0]
    return failed
