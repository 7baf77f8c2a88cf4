"""Tube of the law `tip first`: one loop for each row of its outputs y = (η, s).

Each row obeys ë + (k + σ)ė + kσe = δ, δ = J_y D, and with the gains γ of the loop

    ‖e_b‖ ≤ γ_e ‖δ_b‖∞,    ‖ė_b‖ ≤ γ_ė ‖δ_b‖∞,    ‖w_b‖ ≤ γ_w ‖δ_b‖∞,    w = −(K + Σ)ė − KΣe,  (1)
    ‖J_sq⁻¹e_s‖ ≤ γ_e‖D_q‖ + ‖J_sq⁻¹J_sv‖ γ_e‖D_v‖ + ‖J_sq⁻¹‖ J̃ m_e‖D‖,                   (2)

for blocks b of rows with the same gains: the vehicle's position and attitude, the tip's position,
and the joints. Each radius is the sum of gain × bound of all sources. Of commands that act late
there is no tube. See tube/theory.md#tube-of-the-law-tip-first.
"""

import numpy as np

from uvms_drake.control.laws.outputs import tip_rows
from uvms_drake.control.laws.tip_first import TipFirst
from uvms_drake.control.limits import TubeRadii
from uvms_drake.tube.conditions import Condition, assumption
from uvms_drake.tube.constants import checked_constants
from uvms_drake.tube.contact.hold import HoldLaw, TipBounds
from uvms_drake.tube.contact.sensor_error import SOURCES, MeasuredForceBounds
from uvms_drake.tube.contact.tip_motion import TipAcceleration
from uvms_drake.tube.estimates import together
from uvms_drake.tube.law_tube import PROVEN, WEIGHTED, Basis, LawTube, register_tube
from uvms_drake.tube.laws.tip_first_image import (
    Arm,
    TipFirstImage,
    arm_of,
    block_bounds,
    tip_first_image,
)
from uvms_drake.tube.laws.tip_first_inputs import (
    ATTITUDE,
    DEPTH,
    JOINTS,
    RATE,
    TIP,
    VEHICLE,
    DisturbanceInputs,
    E,
    LoopGains,
    Parts,
    euler_stretch,
    in_joints,
    loop_gains,
)

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
    image = tip_first_image(
        model, basis.declared, rows, block_bounds(sums, model.size), basis.u_limit, settings,
        forces=basis.forces, largest_rate=basis.largest_rate)
    tube = _radii(sums, image, inputs.reading, sensed)

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
        arm.check, inputs.check, image.check, lambda: checked_constants(
            model, basis.declared, (basis.constants["J_dot_max"],), settings.seed)),
        HoldLaw(in_hold, law.tip.k, law.tip.sigma) if sensed else None,
        TipAcceleration(
            *inputs.depth_norms, inputs.turning, basis.d_bound * basis.row_norm("position"))
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


def _radii(sums: dict[str, np.ndarray], image: TipFirstImage, reading: np.ndarray,
           sensed: bool) -> TubeRadii:
    """Returns the radii, of the rows' bounds (4,) by block and their image."""
    position, attitude = float(sums[TIP][E]), float(sums[ATTITUDE][E])
    size = len(image.u)
    return TubeRadii(
        e=float(np.linalg.norm([position, image.orientation, image.joints])), position=position,
        orientation=image.orientation, joints=image.joints,
        z=float(np.linalg.norm([image.nu1, image.nu2, image.qdot])), nu1=image.nu1, nu2=image.nu2,
        qdot=image.qdot, tip_speed=float(sums[TIP][RATE]), roll=attitude, pitch=attitude,
        depth=float(sums[DEPTH][E]) if sensed else None,
        depth_speed=float(sums[DEPTH][RATE]) if sensed else None, u=image.u + reading[:size],
        tau=None if image.tau is None else image.tau + reading[size:])


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
