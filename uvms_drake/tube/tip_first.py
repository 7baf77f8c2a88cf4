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
bounds for a command that is held, with a proof, and `late_rows` for thrusters, without: each row of
the budget is the sum of gain × bound of all of them, and a radius. What is late of the tip is in
the joints J_sq⁻¹ times that. A reading is as much older as the actuators are late.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from uvms_drake.control.laws.tip_first import TipFirst
from uvms_drake.control.laws.tip_rows import tip_rows
from uvms_drake.control.limits import TubeRadii
from uvms_drake.tube.actuators import Actuators
from uvms_drake.tube.conditions import Condition
from uvms_drake.tube.constant_check import checked_constants
from uvms_drake.tube.estimate import Check, largest_of, no_estimates, together
from uvms_drake.tube.held_rows import HeldRows, drags_of, turning_of
from uvms_drake.tube.joint_search import second_over_joints, supremum_over_joints
from uvms_drake.tube.late_loads import Plans, late_loads
from uvms_drake.tube.late_rows import Errors, LateRows, least_bounds
from uvms_drake.tube.law_tube import Basis, LawTube
from uvms_drake.tube.row_gains import lagged_gains
from uvms_drake.tube.row_loop import RowLoop
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
from uvms_drake.tube.tip_first_image import (
    Arm,
    BlockBounds,
    arm_of,
    least_speeds,
    tip_first_image,
)

VEHICLE, ATTITUDE, TIP, DEPTH, JOINTS = "vehicle", "attitude", "position", "depth", "joints"
"""The blocks by their names in the budget; `DEPTH` is the row n·e_p, `JOINTS` x_q of (2)."""
KNOTS = 1e-6
"""Part of a period by which a knot may be off a tick: rounding."""
MODEL = "the thrusters' model"
"""Source of what their model is off by."""
Parts = dict[str, np.ndarray]
"""Bounds (4,) of e, ė, w and ë by source."""


class _Loop(NamedTuple):
    """The gains of a loop, to e, ė, w and ë (4,)."""

    known: np.ndarray
    """From any δ."""
    late: np.ndarray
    """From a force to what comes of its being felt late."""
    moment: np.ndarray
    """∫t|g|."""
    age: float
    """Of what acts [s]."""


def tip_first_law_tube(law: TipFirst, basis: Basis) -> LawTube:
    """Returns the tube of the law `tip first`; see the module."""
    model, settings, actuators = basis.model, basis.settings, basis.actuators
    rows = tip_rows(model, tuple(law.rows))
    is_held = actuators.late and not actuators.thrusters
    loops = _row_loops(law, actuators)
    conditions = [Condition(f"rows of the tip's task, {name} is not among them", 1.0, "<=", 0.0)
                  for i, name in enumerate("xyz") if i not in rows]
    conditions += [Condition(f"undriven {name}, of which no bound is known", 1.0, "<=", 0.0)
                   for name in law.undriven]
    conditions += [Condition(f"actuation, {what}, of which no bound is known", 1.0, "<=", 0.0)
                   for what in _unknown(law, basis)]
    conditions += [Condition(f"{key}, loop that is not stable behind its actuators", 1.0, "<=", 0.0)
                   for key, loop in zip(("vehicle", "tip"), loops, strict=True) if not loop.stable]
    arm = arm_of(model, basis.declared, rows, settings)
    conditions.append(Condition(
        "arm, smallest singular value of J_sq, estimated", arm.regular, ">", 0.0))
    gone = [condition for condition in conditions if not condition.holds]
    if any(condition.name.startswith(("rows", "actuation", "vehicle", "tip", "arm"))
           for condition in gone):
        return LawTube(TubeRadii(), tuple(conditions))

    turning, turning_check, in_joints = 0.0, no_estimates, loops[1]
    if is_held:
        of_tip, of_joints = drags_of(model, basis.declared, rows)
        loops, in_joints = (
            (loops[0], replace(loops[1], drag=of_tip)), replace(loops[1], drag=of_joints))
        turning, turning_check = turning_of(basis, rows)
    vehicle, tip = (_loop(loop, path.age, basis) for loop, path in zip(
        loops, (actuators.vehicle, actuators.joints), strict=True))
    pushes = _Pushes(basis)
    stretch, weights = _stretch(basis.declared.pitch), basis.weights
    tip_norm = basis.row_norm("position")
    table: dict[str, Parts] = {
        VEHICLE: pushes.of(vehicle, float(np.max(weights[:3])), VEHICLE),
        ATTITUDE: pushes.of(vehicle, stretch * float(np.max(weights[3:6])), ATTITUDE),
        TIP: pushes.of(tip, tip_norm, TIP), DEPTH: pushes.of(tip, tip_norm, DEPTH),
        JOINTS: _in_joints(basis, arm, _grown(in_joints, tip, turning) if is_held else tip, pushes)}
    late = _Late(law, basis, rows, loops, table) if actuators.late and not is_held else None
    held = _held(basis, rows, (*loops, in_joints), table, turning, arm.regular
                 ) if is_held else None
    if late is not None:
        table = late.table
    if held is not None:
        table = held.table
    sums = {name: np.sum(list(parts.values()), axis=0) for name, parts in table.items()}
    budget = {name: {source: float(value[0]) for source, value in parts.items()}
              for name, parts in table.items()}
    felt = basis.contact is not None
    if felt:
        budget["depth_speed"] = {source: float(value[1]) for source, value in table[DEPTH].items()}
    else:
        del budget[DEPTH]
    if late is not None:
        conditions.append(Condition(
            "late actuators, part of errors that comes back by loads", late.share, "<", 1.0))
    if held is not None:
        conditions.append(held.condition)
    if not all(condition.holds for condition in conditions):
        return LawTube(TubeRadii(), tuple(conditions), budget)

    size = model.size
    image = tip_first_image(
        model, basis.declared, rows, _blocks(sums, size),
        basis.u_limit, settings, forces=basis.forces, largest_rate=basis.largest_rate)
    position, attitude = float(sums[TIP][0]), float(sums[ATTITUDE][0])
    beside = pushes.reading if late is None else pushes.reading + late.beside
    tube = TubeRadii(
        e=float(np.linalg.norm([position, image.orientation, image.joints])), position=position,
        orientation=image.orientation, joints=image.joints,
        z=float(np.linalg.norm([image.nu1, image.nu2, image.qdot])), nu1=image.nu1, nu2=image.nu2,
        qdot=image.qdot, tip_speed=float(sums[TIP][1]), roll=attitude, pitch=attitude,
        depth=float(sums[DEPTH][0]) if felt else None,
        depth_speed=float(sums[DEPTH][1]) if felt else None, u=image.u + beside[:size],
        tau=None if image.tau is None else image.tau + beside[size:])
    return LawTube(tube, tuple(conditions), budget, tuple(vars(tube)), together(
        arm.check, turning_check, pushes.check, image.check,
        *(each.check for each in (late, held) if each is not None),
        lambda: checked_constants(
            model, basis.declared, (basis.constants["J_dot_max"],), settings.seed)))


def _blocks(sums: Mapping[str, np.ndarray], size: int) -> list[BlockBounds]:
    """Returns the bounds that `tip_first_image` takes."""
    return [BlockBounds(where, *map(float, sums[name][:3])) for name, where in (
        (VEHICLE, np.arange(3)), (ATTITUDE, np.arange(3, 6)), (JOINTS, np.arange(6, size)))]


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


def _slower(basis: Basis, rows: np.ndarray, table: Mapping[str, Parts]) -> np.ndarray:
    """Returns what plans may do at most, ‖ν̄₁‖, ‖ν̄₂‖ and ‖q̄̇‖ (3,).

    Less than the robot may by the least that a tube of these parts takes, if they can.
    """
    declared, sums = basis.declared, {
        name: np.sum(list(parts.values()), axis=0) for name, parts in table.items()}
    limits = np.array([declared.nu1, declared.nu2, declared.qdot])
    least = least_speeds(
        basis.model, declared, rows, _blocks(sums, basis.model.size), basis.settings.seed)
    return np.where(least < limits, limits - least, limits)


def _held(basis: Basis, rows: np.ndarray, loops: tuple[RowLoop, ...],
          table: Mapping[str, Parts], turning: float, regular: float) -> HeldRows:
    """Returns what a command that is held adds."""
    contact = basis.contact
    assert contact is not None  # or `_unknown`
    return HeldRows(basis, rows, loops, table, _slower(basis, rows, table),
                    turning, regular,
                    (contact.size + contact.error, contact.torque_error))


def _loop(loop: RowLoop, age: float, basis: Basis) -> _Loop:
    """Returns the gains of a row's loop; see `lagged_gains` for one with nothing in between."""
    # ë is what the feedback does, behind what is late, and what pushes.
    gains, moment, contact = loop.gains["disturbance"], loop.moment, basis.contact
    known = np.array([*gains, 1.0 + gains.command])
    late = 2.0 * known
    if contact is not None and loop.at_once:
        late[:3] = lagged_gains(loop.k, loop.sigma, contact.lag, contact.period)[:3]
    return _Loop(known, late, np.array([*moment, moment.command + age * gains.command]), age)


def _grown(loop: RowLoop, of_rows: _Loop, growth: float) -> _Loop:
    """Returns the gains of a loop whose states grow by e^(growth · t), which counts what turns."""
    known = loop.grown(growth)
    return _Loop(known, 2.0 * known, np.zeros(4), of_rows.age)


class _Late:
    """What late actuators add; see `late_rows`.

    Args:
        law: The law.
        basis: The data.
        rows: The tip's task in (χ, q) (n,).
        loops: Of the vehicle's rows and of the tip's.
        table: Parts of the blocks without it.
    """

    table: dict[str, Parts]
    """All parts."""
    share: float
    """What comes back of errors by the loads that they make; the parts are of none, if it is 1."""
    beside: np.ndarray
    """What the joints' taking the wrench as it is makes of u and τ (2(6+n),)."""
    check: Check

    def __init__(self, law: TipFirst, basis: Basis, rows: np.ndarray,
                 loops: tuple[RowLoop, RowLoop], table: dict[str, Parts]):
        model, declared, contact = basis.model, basis.declared, basis.contact
        assert contact is not None  # or `_unknown`
        before = {name: np.sum(list(parts.values()), axis=0) for name, parts in table.items()}
        slower = _slower(basis, rows, table)
        rate = np.minimum(basis.largest_rate, 2.0 / basis.time_step * np.repeat(
            slower, [3, 3, model.num_joints]))
        driven = np.setdiff1d(np.arange(6), law.undriven_rows)
        self._loads, self.check = late_loads(
            model, declared, rows, Plans(
                float(slower[0]), float(slower[1]), float(slower[2]), basis.u_limit, rate), driven,
            basis.actuators.off, basis.settings)
        vehicle, tip = (replace(loop, observer=0.0) for loop in loops)
        self._rows = LateRows(
            basis.actuators, vehicle, tip, self._loads,
            (contact.size, float(np.hypot(contact.rate, contact.aside_rate)),
             float(np.hypot(contact.ripple, contact.aside_ripple))))
        wrong = np.repeat([np.array(loop.gains["disturbance"]) for loop in loops], 2, axis=0)
        wrong = np.column_stack([wrong, 1.0 + wrong[:, 2]])  # ë as in `_loop`
        self._wrong = wrong * self._loads.by_thrusters[:, None]
        self._before = before
        self._feedback = np.repeat(
            [[loop.k * loop.sigma, loop.k + loop.sigma] for loop in loops], 2, axis=0)

        def sums(z: np.ndarray) -> np.ndarray:
            return np.sum(list(self._parts(z).values()), axis=0)

        z, self.share = least_bounds(sums, (4, 4))
        endless = not np.isfinite(z).all()
        if endless:  # What there is before anything comes back, at least.
            z = np.zeros((4, 4))
        parts, into = self._parts(z), self._loads.into_joints[:, None]
        of: dict[str, Callable[[np.ndarray], np.ndarray]] = {
            VEHICLE: lambda part: part[0], ATTITUDE: lambda part: part[1],
            TIP: lambda part: part[2], DEPTH: lambda part: part[2],
            JOINTS: lambda part: np.sum((into * part)[2:], axis=0)}
        self.table = {name: known | {source: of[name](part) for source, part in parts.items()}
                      for name, known in table.items()}
        self.beside = self._rows.beside(
            self._errors(z), float(sum(part[0] for part in self.table[JOINTS].values())),
            float(slower[2]))

    def _errors(self, late: np.ndarray) -> Errors:
        """Returns the errors of which those by what is late are e, ė, w and ë of rows (4, 4)."""
        before, J_q = self._before, self._loads.by_joints[3]
        vehicle, attitude = before[VEHICLE] + late[0], before[ATTITUDE] + late[1]
        x = np.array([vehicle, attitude, before[JOINTS], late[2], late[3]])
        of_rows = np.array([vehicle, attitude, before[TIP] + late[2],
                            J_q * before[JOINTS] + late[3]])
        return Errors(x[:, :2].T.ravel(), x[:, [1, 3]].T.ravel(), of_rows[:, 2], np.sum(
            of_rows[:, [1, 3]] * self._feedback, axis=1))

    def _parts(self, late: np.ndarray) -> dict[str, np.ndarray]:
        """Returns bounds of e, ė, w and ë by source (4, 4), if those of what is late are these."""
        return {MODEL: self._wrong} | self._rows.parts(self._errors(late))


def _stretch(angle: float) -> float:
    """Returns (1 − sin θ)^−½, the norm of what makes Euler rates of an angular velocity."""
    return float((1.0 - np.sin(angle)) ** -0.5)


def _in_joints(basis: Basis, arm: Arm, tip: _Loop, pushes: "_Pushes") -> Parts:
    """Returns the bounds of x_q by source, by (2)."""
    J_dot, weights = basis.value("J_dot_max"), basis.weights
    lost = J_dot / arm.regular * tip.moment
    carried = arm.carried * float(np.max(weights[:6]))
    out = {"d": basis.d_bound * ((float(np.max(weights[6:])) + carried) * tip.known
                                 + lost)}
    if basis.contact is None:
        return out
    own, moved = (pushes.felt(tip, pushes.zeta(blocks)) for blocks in ([2], [0, 1]))
    whole = pushes.felt(tip._replace(known=np.ones(4), late=np.full(4, 2.0)),
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
        by_d = {"d": self._basis.d_bound * norm * loop.known}
        return by_d if self._found is None else by_d | self.felt(loop, *self._rows[name])

    def felt(self, loop: _Loop, A: Sizes, turned: float = 0.0) -> Parts:
        """Returns what the sensor's errors make of rows with suprema A, by source."""
        contact, basis = self._basis.contact, self._basis
        assert contact is not None
        contact = replace(contact, lag=contact.lag + loop.age)
        terms = np.array([
            by_source(contact, A, known, late, turning=self._turning, qdot=basis.declared.qdot,
                      turned=turned, safety_factor=basis.settings.safety_factor)
            for known, late in zip(loop.known, loop.late, strict=True)])
        return dict(zip(SOURCES, terms.T, strict=True))
