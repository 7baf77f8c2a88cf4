"""What a command that is sampled, held and late makes of the rows of `tip first`, with a proof.

A law that runs at ticks s and whose command τ_c(s), of vehicle and joints, acts from s + D to
s + D + h asks for a(𝔮, ζ; τ_c − J_EᵀF̂) = ÿ̄ + w at s, with the a of `held_rests`, F̂ the force as it
is read and w = −(K + Σ)ė − KΣe. At t the robot does ÿ = a(𝔮, ζ; τ_c) − J_yM⁻¹J_EᵀF + J_yd. So

    ë(t) = w(s) + ∫ₛᵗ ρ dr − Σ [ÿ̄] + J_yM⁻¹J_Eᵀ(F̂(s) − F(t)) + J_yd(t),                        (1)

ρ by (2) of `held_rests`, [ÿ̄] = J̄_y[ζ̄̇] of the knots of a plan in (s, t], and t − s ≤ h + D. ∎ The
first term is the loop of `row_loop`; the last two are counted by `tip_first`, with a reading that
is older by h + D. What is left are three sources:

- *the plan*, ρ of errors that are zero;
- *its knots*: where they are ticks to the last digit, [ÿ̄] counts from a knot until that tick's own
  command acts, D, since Drake makes the plan before a sample of the same time. If they are not, the
  tick may come before its knot, and it is D + h. Besides, ë and α have [ÿ̄] in them as long, and
  with them ρ, which is affine in both: that makes no more than as long times what it then is, on
  any command that reaches back to there;
- *meanwhile*, the rest of ρ.

*ρ depends on errors, and errors on ρ.* Let R_b be what the blocks of ρ are assumed to be at most.
They give the errors e, ė and ë by gains, and w. And a(τ_c − J_EᵀF̂) − ÿ̄ = α of (2) begins as w(s)
and goes by ρ, but for [ÿ̄]: |α| ≤ |w| + (h + D)|ρ|. In joint angles J_sq⁻¹ turns meanwhile, at no
more than Ω = sup‖J_sq⁻¹J̇_sq‖, and |α_q| ≤ e^{Ω(h + D)}(|w_q| + (h + D)|ρ_q|). Where R bounds
ρ + κë, see below, |ρ| ≤ R + κ|ë|, all of ë. If the supremum of ρ
over all errors within these bounds is no more than R, then R was right: errors that obey it until
some time obey it a moment longer, since they come of what was before. R is found to first order,
enlarged, and then checked by `ascent`.

*In joint angles*, x_q = J_sq⁻¹(t)∫K(t, r)J_sq(r)δ_q(r)dr ≤ ∫|K|e^{Ω(t − r)}|δ_q|dr for a δ_s that
is J_sqδ_q, the gain of a loop whose states grow by e^{Ωt}; δ_q itself, J_sq⁻¹∫J_sqρ_q over an age,
is at most e^{Ω(h + D)} times that age times |ρ_q|. [ÿ̄_s] is J_sq of the plan's posture
times something, and counts ‖J_sq⁻¹‖ times as much.

*The joints' drag* makes most of ρ. So the tip's rows have a κ that their loop knows, see `RowLoop`,
and ρ + κë counts in place of ρ; position and joints, each bounded by itself, have their own.

All suprema are estimates: searched, multiplied by the declared factor, and searched for again.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.frames.euler import COMPLEX_STEP
from uvms_drake.tube.actuation.held_command_rates import (
    HeldCommandProblem,
    PlanProblem,
    jumping_plan,
    late_plan,
    turning_task,
)
from uvms_drake.tube.conditions import Condition
from uvms_drake.tube.law_tube import Basis
from uvms_drake.tube.loops.actuator_path import at_ticks
from uvms_drake.tube.loops.row_loop import RowLoop
from uvms_drake.tube.rows.remainders import output_jacobian
from uvms_drake.tube.search.ascent import by_part, first_order, supremum
from uvms_drake.tube.search.constraint_set import ConstraintSet
from uvms_drake.tube.search.estimate import Check, Estimate, largest_of, together
from uvms_drake.tube.search.search_problem import Part
from uvms_drake.tube.search.second_search import second_search
from uvms_drake.tube.settings import CertificateSettings

PLAN, KNOTS, MEANWHILE = ("the plan, held", "its knots", "what moves meanwhile")
"""Sources of the rows' errors by a command that is held."""
BLOCKS = ("vehicle", "attitude", "position", "joints")
"""Blocks by their names in the table."""
ENLARGED, TRIES = 1.05, 4
"""Factor of R to first order, and how often it is enlarged by what was found."""
Of = Callable[[PlanProblem, np.ndarray], np.ndarray]
"""What a plan makes of rows."""
FIXED_POINT = 300
"""Rounds in which errors and ρ converge to first order, or do not."""
Parts = dict[str, np.ndarray]
"""Bounds (4,) of e, ė, w and ë by source."""


class HeldCommandTube:
    """The sources, and the table of blocks with them.

    Args:
        basis: The data.
        rows: The tip's task in (χ, q) (n,).
        loops: Of the vehicle's rows, of the tip's, and these with the joints' drag; of one clock.
        table: Parts of the blocks without these sources, by block and by source.
        slower: What a plan may do at most, ‖ν̄₁‖, ‖ν̄₂‖ and ‖q̄̇‖ (3,).
        turning: Ω [1/s].
        regular: Smallest singular value of J_sq.
        reading: Bounds of ‖F̂‖, force and torque [N, N m].
    """

    table: dict[str, Parts]
    """All parts; those of what is late are infinite if no R was found."""
    condition: Condition
    """That errors do not make more of ρ than was counted with."""
    check: Check
    """Makes the second searches."""
    beside = 0.0
    """What is to be added to the tube in u and τ: nothing."""

    def __init__(self, basis: Basis, rows: np.ndarray, loops: Sequence[RowLoop],
                 table: Mapping[str, Parts], slower: np.ndarray, turning: float,
                 regular: float, reading: tuple[float, float]):
        self._basis, self._rows, self._known, self._reading = basis, rows, dict(table), reading
        self._turning, self._drags = turning, (loops[1].drag, loops[2].drag)
        model, settings, path = basis.model, basis.settings, basis.actuators.vehicle
        self._factor, self._age = settings.safety_factor, path.period + path.dead_time
        planned = replace(basis.declared, nu1=float(slower[0]), nu2=float(slower[1]),
                          qdot=float(slower[2]))
        self._rate = np.minimum(basis.largest_rate, 2.0 / basis.time_step * np.repeat(
            slower, [3, 3, model.num_joints]))
        self._planned = planned
        checks: list[Check] = []

        def plan_of(name: str, of: Of) -> np.ndarray:
            """Returns the claim (4,) of something that a plan does by itself."""
            claim, check = _claim_of(name, PlanProblem(
                model, planned, [(np.eye(1), 1.0)], rows, basis.u_limit, self._rate, of=of),
                settings)
            checks.append(check)
            return claim

        level = plan_of("the plan's forces, held", late_plan)
        self._jump = 2.0 * plan_of("accelerations of plans", jumping_plan)
        self._jump[3] /= regular
        self._turns = np.array([1.0, 1.0, 1.0, np.exp(turning * self._age)])
        self._gains = self._of_blocks(loops)
        self._gains[3] *= self._turns[3]  # J_sq turns while ρ is integrated, too.
        ticks = round(basis.time_step / path.period)
        until = path.dead_time + (0.0 if at_ticks(basis.time_step, path.period) else path.period)
        self._jump *= until > 0.0
        knots = self._of_blocks(loops, ticks, until) * self._jump[:, None]
        self._made = np.zeros(4)  # ∫ρ of what jumps turn into.
        if until > 0.0:
            known = [loops[i].grown(0.0) for i in (0, 0, 1)] + [loops[2].grown(turning)]
            self._made = until * self._by_knots(checks)
            knots += np.array(known) * (self._turns * self._made)[:, None]
            self._made[3] += until * self._drags[1] * self._jump[3]
        self._level = level
        self._of_plan = {PLAN: self._gains * level[:, None], KNOTS: knots}

        found, ratio = self._fixed_point(checks)
        self.table = self._table(found)
        self.condition = Condition(
            "held command, what moves meanwhile over what is counted with", ratio, "<=", 1.0,
            theorem="tube/actuation/theory.md#held-command")
        self.check = together(*checks)

    def _of_blocks(self, loops: Sequence[RowLoop], pulses: int = 0, until: float = 0.0
                   ) -> np.ndarray:
        """Returns gains to e, ė, w and ë of the blocks (4, 4); see `RowLoop.held`."""
        vehicle, tip, joints = (loop.held(growth, pulses=pulses, until=until) for loop, growth in
                                zip(loops, (0.0, 0.0, self._turning), strict=True))
        return np.array([vehicle, vehicle, tip, joints])

    def _table(self, rest: np.ndarray) -> dict[str, Parts]:
        """Returns the table with ρ (4,) in its blocks; the row of the depth is the tip's."""
        sources = self._of_plan | {MEANWHILE: self._gains * rest[:, None]}
        return {name: parts | {source: each[BLOCKS.index(
            name if name in BLOCKS else "position")] for source, each in sources.items()}
            for name, parts in self._known.items()}

    def _radii(self, rest: np.ndarray) -> np.ndarray:
        """Returns the radii of the errors of `HeldCommandProblem` by part (14,)."""
        table = self._table(rest)
        sums = np.array([np.sum(list(table[name].values()), axis=0) for name in BLOCKS])
        off = self._turns * (sums[:, 2] + self._age * (rest + self._level) + self._made)
        off[3] += self._turns[3] * self._age * self._drags[1] * sums[3, 3]
        sums[:, 3] -= self._jump
        by_block = np.column_stack([sums[:, [0, 1, 3]], off])[[0, 1, 3]]
        return np.append(by_block.T.ravel(), self._reading)

    def _by_knots(self, checks: list[Check]) -> np.ndarray:
        """Returns what [ÿ̄] in ë and in α makes of ρ (4,)."""
        radii = np.zeros((4, 3))
        radii[2:] = (self._turns * self._jump)[[0, 1, 3]]
        problem = replace(self._problem(np.append(radii, [0.0, 0.0])),
                          declared=self._basis.declared)
        claim, check = _claim_of("what jumps of a plan turn into", problem, self._basis.settings)
        checks.append(check)
        return claim

    def _problem(self, radii: np.ndarray) -> HeldCommandProblem:
        size = self._basis.model.size
        eye, blocks = np.eye(4 * size + 6), np.split(np.arange(size), [3, 6])
        columns = [eye[:, block + i * size] for i in range(4) for block in blocks]
        columns += [eye[:, 4 * size: 4 * size + 3], eye[:, 4 * size + 3:]]
        parts: list[Part] = list(zip(columns, map(float, radii), strict=True))
        return HeldCommandProblem(self._basis.model, self._planned, parts, self._rows,
                           self._basis.u_limit, self._rate, self._drags)

    def _fixed_point(self, checks: list[Check]) -> tuple[np.ndarray, float]:
        """Returns R (4,), and how much of it is found of errors within its bounds."""
        settings = self._basis.settings
        problem = self._problem(np.ones(14))
        x = problem.draw(settings.tube_samples, np.random.default_rng([settings.seed, 2]))
        slopes = by_part(problem, x)
        more = np.full(4, self._factor * ENLARGED)
        ratio = np.inf
        for _ in range(TRIES):
            rest = self._first_order(slopes, more)
            if not np.isfinite(rest).all():
                return rest, np.inf
            radii = self._radii(rest)
            problem = self._problem(radii)
            claim = self._factor * supremum(problem, x, slopes @ radii)
            ratio = float(np.max(claim / rest))
            if ratio <= 1.0:
                checks.append(_check(problem, "what moves while a command is held", rest,
                                     settings.seed))
                return rest, ratio
            more = more * ENLARGED * np.maximum(claim / rest, 1.0)
        return rest, ratio

    def _first_order(self, slopes: np.ndarray, more: np.ndarray) -> np.ndarray:
        """Returns the least R (4,) by slopes (m, 4, parts) at samples; inf if there is none."""
        rest = np.zeros(4)
        for _ in range(FIXED_POINT):
            last, rest = rest, more * np.max(slopes @ self._radii(rest), axis=0)
            if np.all(rest <= 1.001 * last):
                return rest
            if np.max(rest) > 1e6:
                break
        return np.full(4, np.inf)


def turning_of(basis: Basis, rows: np.ndarray) -> tuple[float, Check]:
    """Returns Ω = sup‖J_sq⁻¹J̇_sq‖ over the declared set [1/s], and what searches for it again."""
    unit = np.eye(basis.model.num_joints)
    claim, check = _claim_of("‖J_sq⁻¹J̇_sq‖", PlanProblem(
        basis.model, basis.declared, [(unit, 1.0)], rows, basis.u_limit, of=turning_task),
        basis.settings)
    return float(claim[3]), check


def drags_of(model: ContactModel, declared: ConstraintSet, rows: np.ndarray
             ) -> tuple[float, float]:
    """Returns the κ of `RowLoop` that the tip's position and its joints are near to [1/s].

    In the middle of the declared set and at rest: what the robot is off them is in ρ. No proof
    depends on them, and each block of rows may have its own.
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


def _claim_of(name: str, problem: HeldCommandProblem, settings: CertificateSettings
              ) -> tuple[np.ndarray, Check]:
    """Returns the claim for a problem (4,), and the second search."""
    x = problem.draw(settings.tube_samples, np.random.default_rng([settings.seed, 2]))
    claim = settings.safety_factor * supremum(problem, x, first_order(problem, x))
    return claim, _check(problem, name, claim, settings.seed)


def _check(problem: HeldCommandProblem, name: str, claim: np.ndarray, seed: int) -> Check:
    """Returns the second search for claims (4,)."""
    wanted = np.flatnonzero(claim > 0.0)

    def check() -> tuple[Estimate, ...]:
        second = second_search(problem, wanted, np.random.default_rng([seed, 3]))
        return (largest_of(name, claim[wanted], second),)

    return check
