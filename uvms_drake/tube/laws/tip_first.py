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

*The real loop.* Clocks, dead times and lags make another loop of each row, whose gains are those of
`row_loop`; the ones above are its special case. They have sources of their own, which `held_rows`
bounds for a command that is held and `lagged_rows` for a vehicle's wrench that lags, with proofs,
and `late_rows` for thrusters behind a clock, without: each row of the budget is the sum of gain ×
bound of all of them, and a radius. What is late of the tip is in the joints J_sq⁻¹ times that. A
reading is as much older as the actuators are late.
"""

from dataclasses import replace

import numpy as np

from uvms_drake.control.laws.tip_first import TipFirst
from uvms_drake.control.laws.tip_rows import tip_rows
from uvms_drake.control.limits import TubeRadii
from uvms_drake.tube.actuation.held_command import HeldCommandTube, drags_of, turning_of
from uvms_drake.tube.actuation.lagged_wrench import LaggedWrenchTube
from uvms_drake.tube.actuation.thruster_tube import (
    ActuationTube,
    block_bounds,
    held_rows,
    slower_plans,
)
from uvms_drake.tube.conditions import Condition
from uvms_drake.tube.constants.constant_check import checked_constants
from uvms_drake.tube.law_tube import Basis, LawTube
from uvms_drake.tube.loops.actuator_path import Actuators, lagged_alone
from uvms_drake.tube.loops.row_loop import RowLoop
from uvms_drake.tube.rows.disturbance_gains import (
    ATTITUDE,
    DEPTH,
    JOINTS,
    TIP,
    VEHICLE,
    DisturbanceInputs,
    Parts,
    euler_stretch,
    grown_gains,
    in_joints,
    loop_gains,
)
from uvms_drake.tube.rows.image import arm_of, free_arm, tip_first_image
from uvms_drake.tube.search.estimate import no_estimates, together

THEOREM = "tube/theory.md#tube-of-the-law-tip-first"
"""Theorem of the conditions on task, arm and actuation."""
SHARE = 0.15
"""Part of the limits of speeds that is a plan's where thrusters lag: the tube takes the rest, if it
needs it or not. The less a plan may jump, the less there is that comes late."""
KNOTS = 1e-6
"""Part of a period by which a knot may be off a tick: rounding."""


def tip_first_law_tube(law: TipFirst, basis: Basis) -> LawTube:
    """Returns the tube of the law `tip first`; see the module."""
    model, settings, actuators = basis.model, basis.settings, basis.actuators
    rows = tip_rows(model, tuple(law.rows))
    is_held = actuators.late and not actuators.thrusters
    is_lagged = lag_is_proven(law, actuators, basis.time_step)
    loops = _row_loops(law, actuators)
    conditions = [Condition(f"rows of the tip's task, {name} is not among them", 1.0, "<=", 0.0,
                            theorem=THEOREM)
                  for i, name in enumerate("xyz") if i not in rows]
    conditions += [Condition(f"undriven {name}, of which no bound is known", 1.0, "<=", 0.0,
                             theorem=THEOREM)
                   for name in law.undriven]
    conditions += [Condition(f"actuation, {what}, of which no bound is known", 1.0, "<=", 0.0,
                             theorem=THEOREM)
                   for what in _unknown(law, basis)]
    conditions += [Condition(f"{key}, loop that is not stable behind its actuators", 1.0, "<=", 0.0,
                             theorem="tube/loops/theory.md#row-loop-behind-an-actuator")
                   for key, loop in zip(("vehicle", "tip"), loops, strict=True) if not loop.stable]
    arm = arm_of(model, basis.declared, rows, settings)
    conditions.append(Condition(
        "arm, smallest singular value of J_sq, estimated", arm.regular, ">", 0.0,
        theorem=THEOREM))
    gone = [condition for condition in conditions if not condition.holds]
    if any(condition.name.startswith(("rows", "actuation", "vehicle", "tip", "arm"))
           for condition in gone):
        return LawTube(TubeRadii(), tuple(conditions))

    turning, turning_check, of_joints = 0.0, no_estimates, loops[1]
    # What is late of a reading is a source of its own where there is only a lag.
    ages = 0.0 if is_lagged else actuators.vehicle.age, actuators.joints.age
    if is_held:
        tip_drag, joint_drag = drags_of(model, basis.declared, rows)
        loops, of_joints = (
            (loops[0], replace(loops[1], drag=tip_drag)), replace(loops[1], drag=joint_drag))
        turning, turning_check = turning_of(basis, rows)
        vehicle, tip = (grown_gains(*each) for each in zip(loops, ages, strict=True))
        joints = grown_gains(of_joints, ages[1], turning)
    else:
        vehicle, tip = (loop_gains(*each, basis) for each in zip(loops, ages, strict=True))
        joints = tip
    inputs = DisturbanceInputs(basis)
    stretch, weights = euler_stretch(basis.declared.pitch), basis.weights
    tip_norm = basis.row_norm("position")
    table: dict[str, Parts] = {
        VEHICLE: inputs.of(vehicle, float(np.max(weights[:3])), VEHICLE),
        ATTITUDE: inputs.of(vehicle, stretch * float(np.max(weights[3:6])), ATTITUDE),
        TIP: inputs.of(tip, tip_norm, TIP), DEPTH: inputs.of(tip, tip_norm, DEPTH),
        JOINTS: in_joints(basis, arm, joints, inputs)}
    late: ActuationTube | HeldCommandTube | LaggedWrenchTube | None = None
    free_check = no_estimates
    limits = np.array([basis.declared.nu1, basis.declared.nu2, basis.declared.qdot])
    if is_held:
        late = held_rows(basis, rows, (*loops, of_joints), table, turning, arm.regular)
    elif is_lagged:
        free, free_check = free_arm(model, basis.declared, rows, settings)
        conditions.append(Condition(
            "arm, least det J_g over det J_sq, estimated", free, ">", 0.0,
            theorem="tube/actuation/theory.md#vehicle-wrench-with-a-first-order-lag"))
        late = LaggedWrenchTube(basis, rows, *loops, table, np.minimum(
            slower_plans(basis, rows, table), SHARE * limits), inputs)
    elif actuators.late:
        late = ActuationTube(law, basis, rows, loops, table)
    if late is not None:
        table = late.table
    sums = {name: np.sum(list(parts.values()), axis=0) for name, parts in table.items()}
    budget = {name: {source: float(value[0]) for source, value in parts.items()}
              for name, parts in table.items()}
    felt = basis.contact is not None
    if felt:
        budget["depth_speed"] = {source: float(value[1]) for source, value in table[DEPTH].items()}
    else:
        del budget[DEPTH]
    if late is not None:
        conditions.append(late.condition)
    if not all(condition.holds for condition in conditions):
        return LawTube(TubeRadii(), tuple(conditions), budget)

    size = model.size
    image = tip_first_image(
        model, basis.declared, rows, block_bounds(sums, size),
        basis.u_limit, settings, forces=basis.forces, largest_rate=basis.largest_rate)
    position, attitude = float(sums[TIP][0]), float(sums[ATTITUDE][0])
    beside = inputs.reading if late is None else inputs.reading + late.beside
    nu1, nu2, qdot = np.maximum(
        [image.nu1, image.nu2, image.qdot], (1.0 - SHARE) * limits if is_lagged else 0.0)
    tube = TubeRadii(
        e=float(np.linalg.norm([position, image.orientation, image.joints])), position=position,
        orientation=image.orientation, joints=image.joints,
        z=float(np.linalg.norm([nu1, nu2, qdot])), nu1=float(nu1), nu2=float(nu2),
        qdot=float(qdot), tip_speed=float(sums[TIP][1]), roll=attitude, pitch=attitude,
        depth=float(sums[DEPTH][0]) if felt else None,
        depth_speed=float(sums[DEPTH][1]) if felt else None, u=image.u + beside[:size],
        tau=None if image.tau is None else image.tau + beside[size:])
    return LawTube(tube, tuple(conditions), budget, tuple(vars(tube)), together(
        arm.check, turning_check, free_check, inputs.check, image.check,
        no_estimates if late is None else late.check,
        lambda: checked_constants(
            model, basis.declared, (basis.constants["J_dot_max"],), settings.seed)))


def lag_is_proven(law: TipFirst, actuators: Actuators, time_step: float) -> bool:
    """Returns whether `lagged_rows` holds for a law behind its actuators, with plans of a step."""
    return lagged_alone(actuators, time_step) and not (law.undriven or law.vehicle.observer)


def _row_loops(law: TipFirst, actuators: Actuators) -> tuple[RowLoop, RowLoop]:
    """Returns the loops of the vehicle's rows and of the tip's."""
    return tuple(RowLoop(  # type: ignore[return-value]
        gains.k, gains.sigma, gains.observer, path.lag, path.period, path.dead_time,
        ahead=path.ahead) for gains, path in (
            (law.vehicle, actuators.vehicle), (law.tip, actuators.joints)))


def _unknown(law: TipFirst, basis: Basis) -> list[str]:
    """Returns what is between the law and what acts that no source here is for."""
    actuators = basis.actuators
    out = list(actuators.unknown)
    if set(actuators.undriven) != set(law.undriven_rows) and actuators.thrusters:
        out.append("axes without thrusters that are not the law's")
    if actuators.late and basis.contact is None:
        out.append("a wall that the model knows, behind actuators that are late")
    ticks = basis.time_step / actuators.vehicle.period if actuators.vehicle.period else 0.0
    if abs(ticks - round(ticks)) > KNOTS:
        out.append("a plan whose knots are no ticks")
    if not actuators.thrusters and 2.0 * actuators.vehicle.age > basis.time_step:
        out.append("a command that is later than half of the time between two knots of a plan")
    out += [f"an observer of {key} behind a command that is held" for key in ("vehicle", "tip")
            if actuators.late and not actuators.thrusters and getattr(law, key).observer > 0.0]
    out += [f"an observer of {key} whose period is not that of its commands" for key, path in (
        ("vehicle", actuators.vehicle), ("tip", actuators.joints))
        if getattr(law, key).observer > 0.0 and not np.isclose(path.period, law.observer_period)]
    return out
