"""Tube of the law `tip first`: one loop for each row of its outputs y = (η, s).

Each row obeys ë + (k + σ)ė + kσe = δ, δ = J_y D, and with the gains γ of the loop

    ‖e_b‖ ≤ γ_e ‖δ_b‖∞,    ‖ė_b‖ ≤ γ_ė ‖δ_b‖∞,    ‖w_b‖ ≤ γ_w ‖δ_b‖∞,    w = −(K + Σ)ė − KΣe,  (1)
    ‖J_sq⁻¹e_s‖ ≤ γ_e‖D_q‖ + ‖J_sq⁻¹J_sv‖ γ_e‖D_v‖ + ‖J_sq⁻¹‖ J̃ m_e‖D‖,                   (2)

for blocks b of rows with the same gains: the vehicle's position and attitude, the tip's position,
and the joints. Clocks, dead times and lags have sources of their own: `zoh_command_tube` for a
command under zero-order hold, `LaggedWrenchTube` for a vehicle's wrench that lags. Of thrusters
behind a clock there is no proof, and no tube: `tube.coupled` has a linear budget. Each radius is
the sum of gain × bound of all sources. See tube/theory.md#tube-of-the-law-tip-first.
"""

from dataclasses import replace

import numpy as np

from uvms_drake.control.laws.tip_first import TipFirst
from uvms_drake.control.laws.tip_rows import tip_rows
from uvms_drake.control.limits import TubeRadii
from uvms_drake.model.signals.command_path import CommandPath
from uvms_drake.tube.actuation.lagged_wrench import LaggedWrenchTube
from uvms_drake.tube.actuation.slower_plans import (
    block_bounds,
    slower_plans,
    zoh_command_tube,
)
from uvms_drake.tube.actuation.zoh_command import ZohCommandTube, drags_of, turning_of
from uvms_drake.tube.conditions import Condition, assumption
from uvms_drake.tube.constants.constant_check import checked_constants
from uvms_drake.tube.contact.hold import HoldLaw, TipBounds
from uvms_drake.tube.contact.sensor_error import SOURCES, MeasuredForceBounds
from uvms_drake.tube.contact.uneven_motion import TipAcceleration
from uvms_drake.tube.law_tube import PROVEN, WEIGHTED, Basis, LawTube, register_tube
from uvms_drake.tube.loops.row_loop import RATE, E, RowLoop
from uvms_drake.tube.rows.disturbance_gains import (
    ATTITUDE,
    DEPTH,
    JOINTS,
    TIP,
    VEHICLE,
    DisturbanceInputs,
    LoopGains,
    Parts,
    euler_stretch,
    grown_gains,
    in_joints,
    loop_gains,
)
from uvms_drake.tube.rows.image import Arm, TipFirstImage, arm_of, free_arm, tip_first_image
from uvms_drake.tube.search.estimate import no_estimates, together

THEOREM = "tube/theory.md#tube-of-the-law-tip-first"
"""Theorem of the conditions on task, arm and actuation."""
SHARE = 0.15
"""A plan's share of the limits of speeds where thrusters lag; the tube has the remainder, needed or
not, for the delayed part of a plan is as large as its jumps."""
KNOTS = 1e-6
"""Rounding allowance of a knot at a tick, over a period."""


def tip_first_constants(law: TipFirst, weights: np.ndarray) -> tuple[str, ...]:
    """Returns the names of the constants of the law `tip first`, for the diagonal of Ŵ."""
    name = PROVEN["position"]
    return name if np.all(weights == 1.0) else WEIGHTED[name], "J_dot_max"


@register_tube(TipFirst, tip_first_constants)
def tip_first_law_tube(law: TipFirst, basis: Basis) -> LawTube:
    """Returns the tube of the law `tip first`; see the module."""
    # Task, loops and arm: without these conditions there is nothing to compute.
    model, settings, path = basis.model, basis.settings, basis.command_path
    rows = tip_rows(model, tuple(law.rows))
    is_sampled = path.joint_age > 0.0 and not path.has_thrusters
    is_lagged = lag_is_proven(law, path, basis.time_step)
    loops = _row_loops(law, path)
    conditions = _structural_conditions(law, basis, rows, loops)
    if path.has_thrusters and not is_lagged:
        conditions.append(assumption(
            "actuation, thrusters behind a clock",
            "of which no tube is proven; see the coupled linear budget", topic="actuation path",
            theorem="tube/coupled/theory.md#coupled-loop"))
        return LawTube(TubeRadii(), tuple(conditions))
    arm = arm_of(model, basis.declared, rows, settings)
    conditions.append(Condition(
        "arm, smallest singular value of J_sq, estimated", arm.regular, ">", 0.0,
        theorem=THEOREM))
    if any(not condition.holds and condition.topic != "undriven" for condition in conditions):
        return LawTube(TubeRadii(), tuple(conditions))

    # Gains of the loops; the delay of a reading is a source of its own where there is only a lag.
    turning, turning_check, joint_loop = 0.0, no_estimates, loops[1]
    ages = 0.0 if is_lagged else path.vehicle_age, path.joint_age
    if is_sampled:
        tip_drag, joint_drag = drags_of(model, basis.declared, rows)
        loops, joint_loop = (
            (loops[0], replace(loops[1], drag=tip_drag)), replace(loops[1], drag=joint_drag))
        turning, turning_check = turning_of(basis, rows)
        vehicle, tip = (grown_gains(*each) for each in zip(loops, ages, strict=True))
        joints = grown_gains(joint_loop, ages[1], turning)
    else:
        vehicle, tip = (loop_gains(*each, basis) for each in zip(loops, ages, strict=True))
        joints = tip

    # Disturbance and sensor by block of rows, and then the actuators, which depend on both.
    inputs = DisturbanceInputs(basis)
    table = _table(basis, arm, inputs, vehicle, tip, joints)
    actuation: ZohCommandTube | LaggedWrenchTube | None = None
    free_check = no_estimates
    limits = np.array([basis.declared.nu1, basis.declared.nu2, basis.declared.qdot])
    if is_sampled:
        actuation = zoh_command_tube(basis, rows, (*loops, joint_loop), table, turning, arm.regular)
    elif is_lagged:
        free, free_check = free_arm(model, basis.declared, rows, settings)
        conditions.append(Condition(
            "arm, least det J_g over det J_sq, estimated", free, ">", 0.0,
            theorem="tube/actuation/theory.md#vehicle-wrench-with-a-first-order-lag"))
        actuation = LaggedWrenchTube(basis, rows, *loops, table, np.minimum(
            slower_plans(basis, rows, table), SHARE * limits), inputs)
    if actuation is not None:
        table = actuation.table

    # The sums by block are the radii of the rows; their parts are the budget.
    sums = {name: np.sum(list(parts.values()), axis=0) for name, parts in table.items()}
    budget = {name: {source: float(value[E]) for source, value in parts.items()}
              for name, parts in table.items()}
    sensed = basis.contact is not None
    if sensed:
        budget["depth_speed"] = {
            source: float(value[RATE]) for source, value in table[DEPTH].items()}
    else:
        del budget[DEPTH]
    if actuation is not None:
        conditions.append(actuation.condition)
    if not all(condition.holds for condition in conditions):
        return LawTube(TubeRadii(), tuple(conditions), budget)

    # The other radii are images of those of the rows.
    image = tip_first_image(
        model, basis.declared, rows, block_bounds(sums, model.size), basis.u_limit, settings,
        forces=basis.forces, largest_rate=basis.largest_rate)
    extra_input = inputs.reading if actuation is None else inputs.reading + actuation.extra_input
    speeds = np.maximum(
        [image.nu1, image.nu2, image.qdot], (1.0 - SHARE) * limits if is_lagged else 0.0)
    tube = _radii(sums, image, speeds, extra_input, sensed)

    def in_hold(force: MeasuredForceBounds, nu2: float, qdot: float) -> TipBounds:
        """Returns the radii for other forces; other sources of the rows, and speeds, as they are.

        A sampled loop settles with a constant error, too, but its kernels are none of one age.
        """
        if not loops[1].at_once:
            force = replace(force, reading=force.reading.changing())
        by_row = [sums[name] - np.sum([table[name][source] for source in SOURCES], axis=0)
                  + np.sum(list(inputs.for_other(force, nu2, qdot, tip, name).values()), axis=0)
                  for name in (DEPTH, TIP)]
        (depth, position), (depth_speed, tip_speed) = np.array(by_row)[:, [E, RATE]].T
        assert tube.nu2 is not None and tube.qdot is not None
        return TipBounds(float(depth), float(position), float(depth_speed), float(tip_speed),
                         tube.nu2, tube.qdot)

    return LawTube(tube, tuple(conditions), budget, tuple(vars(tube)), together(
        arm.check, turning_check, free_check, inputs.check, image.check,
        no_estimates if actuation is None else actuation.check,
        lambda: checked_constants(
            model, basis.declared, (basis.constants["J_dot_max"],), settings.seed)),
        HoldLaw(in_hold, loops[1], tip.age) if sensed else None,
        TipAcceleration(
            *inputs.depth_norms, inputs.turning, basis.d_bound * basis.row_norm("position"))
        if sensed else None)


def _table(basis: Basis, arm: Arm, inputs: DisturbanceInputs, vehicle: LoopGains, tip: LoopGains,
           joints: LoopGains) -> dict[str, Parts]:
    """Returns the parts of the blocks by disturbance and sensor, for the gains of their loops."""
    stretch, weights = euler_stretch(basis.declared.pitch), basis.weights
    tip_norm = basis.row_norm("position")
    return {
        VEHICLE: inputs.of(vehicle, float(np.max(weights[:3])), VEHICLE),
        ATTITUDE: inputs.of(vehicle, stretch * float(np.max(weights[3:6])), ATTITUDE),
        TIP: inputs.of(tip, tip_norm, TIP), DEPTH: inputs.of(tip, tip_norm, DEPTH),
        JOINTS: in_joints(basis, arm, joints, inputs)}


def _radii(sums: dict[str, np.ndarray], image: TipFirstImage, speeds: np.ndarray,
           extra_input: np.ndarray, sensed: bool) -> TubeRadii:
    """Returns the radii, of the rows' bounds (4,) by block, their image, and speeds (3,)."""
    position, attitude = float(sums[TIP][E]), float(sums[ATTITUDE][E])
    (nu1, nu2, qdot), size = speeds, len(image.u)
    return TubeRadii(
        e=float(np.linalg.norm([position, image.orientation, image.joints])), position=position,
        orientation=image.orientation, joints=image.joints,
        z=float(np.linalg.norm([nu1, nu2, qdot])), nu1=float(nu1), nu2=float(nu2),
        qdot=float(qdot), tip_speed=float(sums[TIP][RATE]), roll=attitude, pitch=attitude,
        depth=float(sums[DEPTH][E]) if sensed else None,
        depth_speed=float(sums[DEPTH][RATE]) if sensed else None, u=image.u + extra_input[:size],
        tau=None if image.tau is None else image.tau + extra_input[size:])


def _structural_conditions(law: TipFirst, basis: Basis, rows: np.ndarray,
                           loops: tuple[RowLoop, RowLoop]) -> list[Condition]:
    """Returns conditions that fail: a task without position, actuation without a bound."""
    failed = [assumption("rows of the tip's task", f"{name} is not among them", theorem=THEOREM)
              for i, name in enumerate("xyz") if i not in rows]
    failed += [assumption(f"undriven {name}", "of which no bound is known", topic="undriven",
                          theorem=THEOREM)
               for name in law.undriven]
    failed += [assumption(f"actuation, {path}", "of which no bound is known",
                          topic="actuation path", theorem=THEOREM)
               for path in _unknown(law, basis)]
    failed += [assumption(key, "loop that is not stable behind its actuators", topic=f"{key} loop",
                          theorem="tube/loops/theory.md#row-loop-behind-an-actuator")
               for key, loop in zip(("vehicle", "tip"), loops, strict=True) if not loop.stable]
    return failed


def lag_is_proven(law: TipFirst, path: CommandPath, time_step: float) -> bool:
    """Returns whether `LaggedWrenchTube` holds for a law, with these commands and plans.

    There are thrusters without a clock, on all axes and as known; no plan is commanded in advance,
    and its knots are ticks.

    Args:
        law: The law.
        path: Path of its commands.
        time_step: Time step of a plan [s].
    """
    return (path.thruster_period > 0.0 and path.joint_age == 0.0 and not any(path.preview)
            and not np.any(path.thruster_error) and not path.undriven and not path.unknown
            and path.ticks_at_knots(time_step) and not (law.undriven or law.vehicle.observer))


def _row_loops(law: TipFirst, path: CommandPath) -> tuple[RowLoop, RowLoop]:
    """Returns the loops of the vehicle's rows and of the tip's."""
    vehicle, tip = law.vehicle, law.tip
    return (RowLoop(vehicle.k, vehicle.sigma, vehicle.observer, path.lag, path.vehicle_period,
                    path.vehicle_dead_time),
            RowLoop(tip.k, tip.sigma, tip.observer, 0.0, path.period, path.delay))


def _unknown(law: TipFirst, basis: Basis) -> list[str]:
    """Returns the actuation effects without a bound."""
    path = basis.command_path
    out = list(path.unknown)
    if set(path.undriven) != set(law.undriven_rows) and path.has_thrusters:
        out.append("axes without thrusters other than those of the law")
    if path.vehicle_age > 0.0 and basis.contact is None:
        out.append("a known surface behind delayed actuators")
    ticks = basis.time_step / path.vehicle_period if path.vehicle_period else 0.0
    if abs(ticks - round(ticks)) > KNOTS:
        out.append("a plan with knots that are no ticks")
    if not path.has_thrusters and 2.0 * path.joint_age > basis.time_step:
        out.append("a delay of more than half of the time between two knots of a plan")
    out += [f"an observer of {key} behind a zero-order hold" for key in ("vehicle", "tip")
            if path.joint_age > 0.0 and not path.has_thrusters and getattr(law, key).observer > 0.0]
    out += [f"an observer of {key} whose period is not that of its commands" for key, period in (
        ("vehicle", path.vehicle_period), ("tip", path.period))
        if getattr(law, key).observer > 0.0 and not np.isclose(period, law.observer_period)]
    return out
