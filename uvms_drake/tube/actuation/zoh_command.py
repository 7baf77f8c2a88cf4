"""Effect of a sampled command under zero-order hold, with delay, on the rows of `tip first`.

A law that runs at ticks s and whose command acts from s + D to s + D + h has, at t,

    ë(t) = w(s) + ∫ₛᵗ ρ dr − Σ [ÿ̄] + J_yM⁻¹J_Eᵀ(F̂(s) − F(t)) + J_yd(t),                        (1)

w the feedback, ρ by (2) of `zoh_command_rates`, [ÿ̄] the jumps at the knots of a plan in (s, t].
Three sources are left: ρ of the plan, its knots, and the drift between samples, the remainder of ρ.
ρ depends on errors, and errors on ρ: bounds R of its blocks are found to first order, enlarged, and
then checked by `ascent`: if the errors that follow from R make no more than R, R was right. All
suprema are estimates. Proof: tube/actuation/theory.md#command-under-zero-order-hold.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.frames.euler import COMPLEX_STEP
from uvms_drake.tube.actuation.remainder_bound import remainder_bound, second_search_of
from uvms_drake.tube.actuation.zoh_command_rates import (
    PlanProblem,
    ZohCommandProblem,
    jumping_plan,
    turning_task,
    zoh_plan_rate,
)
from uvms_drake.tube.conditions import Condition
from uvms_drake.tube.law_tube import Basis
from uvms_drake.tube.loops.row_loop import ACCELERATION, RATE, E, RowLoop, W
from uvms_drake.tube.rows.remainders import output_jacobian
from uvms_drake.tube.search.ascent import first_order, supremum
from uvms_drake.tube.search.constraint_set import ConstraintSet
from uvms_drake.tube.search.estimate import Check, together
from uvms_drake.tube.search.search_problem import Part
from uvms_drake.tube.settings import CertificateSettings

PLAN, KNOTS, DRIFT = ("plan under hold", "jumps at knots", "drift between samples")
"""Sources of the rows' errors by a command under zero-order hold."""
BLOCKS = ("vehicle", "attitude", "position", "joints")
"""Blocks by their names in the table."""
VEHICLE_ROWS, ATTITUDE_ROWS, TIP_ROWS, JOINTS_ROWS = range(4)
"""Indices of the blocks."""
ERRORS = [VEHICLE_ROWS, ATTITUDE_ROWS, JOINTS_ROWS]
"""Blocks of the errors of `ZohCommandProblem`."""
ENLARGED = 1.05
"""Factor of R to first order."""
Of = Callable[[PlanProblem, np.ndarray], np.ndarray]
"""Function of a plan."""
Parts = dict[str, np.ndarray]
"""Bounds (4,) of e, ė, w and ë by source."""


class ZohCommandTube:
    """Sources of a command under zero-order hold, and the table of blocks with them.

    Args:
        basis: The data.
        rows: The tip's task in (χ, q) (n,).
        loops: Loops of the vehicle's rows, the tip's, and these with the joints' drag.
        table: Parts of the blocks without these sources, by block and by source.
        slower: Speed limits of plans, ‖ν̄₁‖, ‖ν̄₂‖ and ‖q̄̇‖ (3,).
        turning: Ω [1/s].
        regular: Smallest singular value of J_sq.
        reading: Bounds of ‖F̂‖, force and torque [N, N m].
    """

    table: dict[str, Parts]
    """All parts; those of these sources are infinite if no R was found."""
    condition: Condition
    """Condition that the errors make no more of ρ than its bound."""
    check: Check
    """Makes the second searches."""
    extra_input = 0.0
    """Addition to the tube in u and τ: nothing."""

    def __init__(self, basis: Basis, rows: np.ndarray, loops: Sequence[RowLoop],
                 table: Mapping[str, Parts], slower: np.ndarray, turning: float,
                 regular: float, reading: tuple[float, float]):
        self._basis, self._rows, self._known, self._reading = basis, rows, dict(table), reading
        self._turning, self._drags = turning, (loops[1].drag, loops[2].drag)
        # Plans are slower than the robot by the tube, and so are their accelerations.
        model, settings, path = basis.model, basis.settings, basis.command_path
        self._age = path.joint_age
        planned = replace(basis.declared, nu1=float(slower[0]), nu2=float(slower[1]),
                          qdot=float(slower[2]))
        self._rate = np.minimum(basis.largest_rate, 2.0 / basis.time_step * np.repeat(
            slower, [3, 3, model.num_joints]))
        self._planned = planned
        checks: list[Check] = []

        def plan_of(name: str, of: Of) -> np.ndarray:
            """Returns the claim (4,) of a function of the plan alone."""
            claim, check = _claim_of(name, PlanProblem(
                model, planned, [(np.eye(1), 1.0)], rows, basis.u_limit, self._rate, of=of),
                settings)
            checks.append(check)
            return claim

        # ρ of the plan, and the jumps at its knots; J_sq turns while ρ is integrated, too.
        level = plan_of("the plan's forces under hold", zoh_plan_rate)
        self._jump = 2.0 * plan_of("accelerations of plans", jumping_plan)
        self._jump[JOINTS_ROWS] /= regular
        self._turns = np.array([1.0, 1.0, 1.0, np.exp(turning * self._age)])
        self._gains = self._of_blocks(loops)
        self._gains[JOINTS_ROWS] *= self._turns[JOINTS_ROWS]
        # A jump counts until the command of its tick acts, and so does its effect on ρ.
        ticks = round(basis.time_step / path.period)
        until = path.delay + (0.0 if path.ticks_at_knots(basis.time_step) else path.period)
        self._jump *= until > 0.0
        knots = self._of_blocks(loops, ticks, until) * self._jump[:, None]
        self._made = np.zeros(4)  # ∫ρ by jumps.
        if until > 0.0:
            known = [loops[i].grown(0.0) for i in (0, 0, 1)] + [loops[2].grown(turning)]
            self._made = until * self._by_knots(checks)
            knots += np.array(known) * (self._turns * self._made)[:, None]
            self._made[JOINTS_ROWS] += until * self._drags[1] * self._jump[JOINTS_ROWS]
        self._level = level
        self._of_plan = {PLAN: self._gains * level[:, None], KNOTS: knots}

        # The drift between samples, by a fixed point of errors and ρ.
        found, ratio = remainder_bound(self._problem, self._radii, 14, ENLARGED, settings, 2)
        if ratio <= 1.0:
            checks.append(second_search_of(self._problem(self._radii(found)),
                                           "drift between samples", found, settings.seed, 3))
        self.table = self._table(found)
        self.condition = Condition(
            "zero-order hold, drift between samples over its bound", ratio, "<=", 1.0,
            theorem="tube/actuation/theory.md#command-under-zero-order-hold")
        self.check = together(*checks)

    def _of_blocks(self, loops: Sequence[RowLoop], pulses: int = 0, until: float = 0.0
                   ) -> np.ndarray:
        """Returns gains to e, ė, w and ë of the blocks (4, 4); see `RowLoop.zoh_gains`."""
        vehicle, tip, joints = (
            loop.zoh_gains(growth, pulses=pulses, until=until)
            for loop, growth in zip(loops, (0.0, 0.0, self._turning), strict=True))
        return np.array([vehicle, vehicle, tip, joints])

    def _table(self, remainder: np.ndarray) -> dict[str, Parts]:
        """Returns the table with ρ (4,) in its blocks; the row of the depth is the tip's."""
        sources = self._of_plan | {DRIFT: self._gains * remainder[:, None]}
        return {name: parts | {source: each[BLOCKS.index(
            name if name in BLOCKS else "position")] for source, each in sources.items()}
            for name, parts in self._known.items()}

    def _radii(self, remainder: np.ndarray) -> np.ndarray:
        """Returns the radii of the errors of `ZohCommandProblem` by part (14,)."""
        table = self._table(remainder)
        sums = np.array([np.sum(list(table[name].values()), axis=0) for name in BLOCKS])
        off = self._turns * (sums[:, W] + self._age * (remainder + self._level) + self._made)
        off[JOINTS_ROWS] += (self._turns[JOINTS_ROWS] * self._age * self._drags[1]
                             * sums[JOINTS_ROWS, ACCELERATION])
        sums[:, ACCELERATION] -= self._jump
        by_block = np.column_stack([sums[:, [E, RATE, ACCELERATION]], off])[ERRORS]
        return np.append(by_block.T.ravel(), self._reading)

    def _by_knots(self, checks: list[Check]) -> np.ndarray:
        """Returns the ρ of [ÿ̄] in ë and in α (4,)."""
        radii = np.zeros((4, 3))
        radii[2:] = (self._turns * self._jump)[ERRORS]
        problem = replace(self._problem(np.append(radii, [0.0, 0.0])),
                          declared=self._basis.declared)
        claim, check = _claim_of("rates by jumps of a plan", problem, self._basis.settings)
        checks.append(check)
        return claim

    def _problem(self, radii: np.ndarray) -> ZohCommandProblem:
        size = self._basis.model.size
        eye, blocks = np.eye(4 * size + 6), np.split(np.arange(size), [3, 6])
        columns = [eye[:, block + i * size] for i in range(4) for block in blocks]
        columns += [eye[:, 4 * size: 4 * size + 3], eye[:, 4 * size + 3:]]
        parts: list[Part] = list(zip(columns, map(float, radii), strict=True))
        return ZohCommandProblem(self._basis.model, self._planned, parts, self._rows,
                                 self._basis.u_limit, self._rate, self._drags)


def turning_of(basis: Basis, rows: np.ndarray) -> tuple[float, Check]:
    """Returns Ω = sup‖J_sq⁻¹J̇_sq‖ over the declared set [1/s], and its second search."""
    unit = np.eye(basis.model.num_joints)
    claim, check = _claim_of("‖J_sq⁻¹J̇_sq‖", PlanProblem(
        basis.model, basis.declared, [(unit, 1.0)], rows, basis.u_limit, of=turning_task),
        basis.settings)
    return float(claim[3]), check


def drags_of(model: ContactModel, declared: ConstraintSet, rows: np.ndarray
             ) -> tuple[float, float]:
    """Returns the approximate κ of `RowLoop` of the tip's position and of its joints [1/s].

    They are those in the middle of the declared set and at rest; the difference of the robot is in
    ρ. No proof depends on them, and each block of rows may have its own.
    """
    n, size = model.num_joints, model.size
    config = np.append(np.zeros(6), 0.5 * (declared.q_lower + declared.q_upper))
    kinematics = model.kinematics(config)
    rates = 1j * COMPLEX_STEP * np.eye(size)[6:]
    J = output_jacobian(model, config, kinematics, rows)[6:]
    b = model.inverse_dynamics(model.kinematics(np.tile(config, (n, 1))), rates,
                               np.zeros((n, size))).imag.T / COMPLEX_STEP
    slows = J @ np.linalg.solve(model.mass_matrix(kinematics), b)
    task, of_position = J[:, 6:], rows < 3
    each = np.linalg.eigvals(np.linalg.solve(task, slows)).real
    of_tip = np.sum(task[of_position] * slows[of_position]) / np.sum(task[of_position] ** 2)
    return max(0.0, float(of_tip)), max(0.0, 0.5 * float(np.max(each) + np.min(each)))


def _claim_of(name: str, problem: ZohCommandProblem, settings: CertificateSettings
              ) -> tuple[np.ndarray, Check]:
    """Returns the claim for a problem (4,), and the second search."""
    x = problem.draw(settings.tube_samples, np.random.default_rng([settings.seed, 2]))
    claim = settings.safety_factor * supremum(problem, x, first_order(problem, x))
    return claim, second_search_of(problem, name, claim, settings.seed, 3)
