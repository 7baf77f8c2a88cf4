"""Step of the nominal MPC at a sampling instant: from its memory and the sample to a new memory.

A plan is made for the N intervals after the first n of the last one, which are committed: a law
that commands the plan's forces ℓ in advance (`feedforward_preview`) has, until the next sample
t_{i+1}, committed the actuators up to t_{i+1} + ℓ. With n = ⌈ℓ/h⌉

    plan i on [t_i, t_i + nh]  =  plan i − 1 there;    free on the N intervals from t_i + nh on,

and the problem is the one without actuation delay, from the state at t_i + nh. No command that was
issued changes, and every problem is feasible if it was so without: proofs in
control/plan/theory.md#committed-horizon. Before the first plan the robot coasts; at rest it hovers.

With `mpc.in_advance` the plan of t_i comes at t_{i+1}, so that a computer may take h for it, and
one more interval is committed. Until it comes, the last plan goes on, which is the same over the
committed part; and it is taken only if it is sound with the inputs of t_{i+1}, which may have
changed, unless the last plan is not either.
"""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from uvms_drake.common.alarm import warn
from uvms_drake.common.errors import InvalidParameter, RunFailed
from uvms_drake.control.laws.law import AncillaryLaw
from uvms_drake.control.mpc.infeasibility import infeasibility_reason
from uvms_drake.control.ocp.ocp import Ocp
from uvms_drake.control.ocp.scp import Solution, Solver
from uvms_drake.control.plan.plan import KNOT_TOLERANCE, Plan
from uvms_drake.model.signals.command_path import CommandPath

FIRST_SOLVE_ITERATIONS = 50
"""Largest number of iterations of the first solve, which starts from a plan at rest."""
REACHED = 1e-6
"""Distance of a first plan to the terminal set, in ‖ξ‖_P, that counts as none."""

SOLVED, FAILED, TIMED_OUT, DROPPED, KEPT, HOVERED = range(6)
"""Outcomes of a sample: a new plan; none of the solver; one after the deadline, which is discarded;
no computation; the last plan, continued, which is within limits and terminal set where the new one
is not; a plan to hover before planning starts."""

MPC_REPORT = ("time", "status", "cost", "terminal_slack", "violation", "iterations", "refused",
              "rows")
"""Entries about the last sample: t_k [s], its outcome (`SOLVED` 0, `FAILED` 1, `TIMED_OUT` 2,
`DROPPED` 3, `KEPT` 4, `HOVERED` 5), the plan's objective, s of the terminal set, largest violation
of a limit (in its own unit), convex programs solved, 1 if a new desired force was asked for and is
refused, rows of limits in the last of the programs. A sample that is dropped changes the first two
only; of one that hovers all but these are zero."""

TROUBLE = {FAILED: "the solver failed", TIMED_OUT: "the solver missed its deadline",
           DROPPED: "the sample was dropped"}
"""Alarm about an outcome, given at the first of the samples in a row that have it."""

NOTHING: Solution = Solution(None, None, 0, converged=False)
"""Solution of a solver that was not started."""

SOLVERS_KEPT = 16
"""Number of problems of other desired forces that are remembered, the latest ones."""


class Targets(NamedTuple):
    """Problems of other desired forces, where the model has the force of the surface.

    It is the only way to change that force: along the surface's normal the model is not invariant,
    so that neither input at rest nor terminal set of one force serves another, as those of a
    `TrackingOcp` serve every target.
    """

    force: np.ndarray
    """𝔉_des at the start (6,) [N, N m]."""
    ocp: Callable[[np.ndarray], Ocp]
    """Function from 𝔉_des to its problem; raises `InvalidParameter` if there is none."""


@dataclass(frozen=True)
class MpcMemory:
    """Memory of the nominal MPC: all its time-varying data."""

    plan: Plan | None = None
    """Current plan of n + N intervals; none before the first sample."""
    force: np.ndarray = field(default_factory=lambda: np.zeros(6))
    """Desired force 𝔉_des of the plan (6,) [N, N m]; zero if it is constant."""
    asked: np.ndarray = field(default_factory=lambda: np.zeros(6))
    """Last requested 𝔉_des (6,) [N, N m]; it is refused if it is not `force`."""
    solves: int = 0
    """Number of plans made so far."""
    report: np.ndarray = field(default_factory=lambda: np.full(len(MPC_REPORT), np.nan))
    """Last values of `MPC_REPORT`."""
    solve_seconds: float = 0.0
    """Wall time of the last step [s]; the only value that is not reproducible."""
    coming: "MpcMemory | None" = None
    """Memory with the plan of the last sample, which comes at the next one, if it is
    computed in advance and not late."""
    awaits: bool = False
    """Whether the plan of the last sample is to come at the next one."""
    at_rest: bool = False
    """Whether the plan keeps a place, until there is a first plan from it."""


class Sample(NamedTuple):
    """Inputs of the nominal MPC at a sampling instant."""

    time: float
    """Sampling instant t_k [s]."""
    started: float
    """Value of the planner's clock at the beginning of the step [s]."""
    given: dict[str, np.ndarray]
    """Values of the problem's `inputs_given`; some may be missing."""
    measured: np.ndarray | None = None
    """Measured (𝔮, ζ) or 𝔮; None if no plan starts there."""
    asked: np.ndarray | None = None
    """Requested 𝔉_des (6,) [N, N m]; None: as before."""
    fault: int = SOLVED
    """Fault of the sample; `SOLVED` for none."""


class Planner:
    """Planner: a pure function of memory and sample, but for wall time and the logger.

    It also caches the problems of the latest desired forces, each a function of its force alone.

    Args:
        solver: Solves the problem; its `ocp` is the problem.
        targets: Problems of other desired forces; None: the desired force is constant.
        committed: n, number of intervals at the beginning of a plan that are not decided.
        undriven: Indices in 𝔮 of coordinates that nothing drives. They swing about their rest, so
            that a plan to keep a place has them where the task has them, and the tip where it is.
    """

    def __init__(self, solver: Solver, targets: Targets | None = None,
                 committed: int = 0, undriven: Sequence[int] = ()):
        self._solver, self._targets, self._committed = solver, targets, committed
        self._undriven = list(undriven)
        self.clock: Callable[[], float] = time.perf_counter
        self._made = lru_cache(maxsize=SOLVERS_KEPT)(self._make)
        force = np.zeros(6) if targets is None else np.asarray(targets.force, dtype=float)
        self.initial = MpcMemory(force=force, asked=force)

    def first(self, sample: Sample) -> MpcMemory:
        """Returns the memory with a first plan: the robot coasts over its committed part.

        If the robot is to hover first, the plan is to keep its place.

        Raises:
            RunFailed: There is none.
        """
        now, measured, h = sample.time, sample.measured, self._solver.ocp.time_step
        if abs(now / h - round(now / h)) > 1e-6:
            raise RunFailed(f"the nominal MPC starts at t = {now:g} s: must be a multiple of its "
                            f"sampling period, {h:g} s")
        if measured is None or not np.all(np.isfinite(measured)):
            raise RunFailed(f"the measured state is not finite at t = {now:.3f} s")
        return self._from_rest(sample, self.initial, measured)

    def _from_rest(self, sample: Sample, memory: MpcMemory, state: np.ndarray) -> MpcMemory:
        """Returns the memory with a plan from a state at rest, or one to keep it if it hovers.

        Raises:
            RunFailed: There is none.
        """
        solver = self._current(sample, memory)
        hovers = sample.time < solver.ocp.hover - 1e-6 * solver.ocp.time_step
        if hovers:
            return replace(self.resting(sample, memory, state), solves=memory.solves + 1)
        guess = solver.ocp.resting_plan(sample.time, state, self._committed)
        free = guess.after(self._committed)
        solution = solver.solve(free, FIRST_SOLVE_ITERATIONS)
        slack = REACHED if solver.ocp.strict else np.inf
        if solution.plan is None or not solver.ocp.is_sound(solution.evaluation, slack):
            why = infeasibility_reason(solver.ocp, free, solution.plan, solver.ocp.tolerance)
            raise RunFailed(f"the nominal MPC has no solution at the start, t = {sample.time:g} s: "
                            f"{why}")
        return self._remember(sample, memory, guess, solution, SOLVED)

    def resting(self, sample: Sample, memory: MpcMemory, state: np.ndarray) -> MpcMemory:
        """Returns the memory with a plan to keep a place; to keep the last one if it is missing.

        Args:
            sample: Inputs now.
            memory: The memory so far.
            state: (𝔮, ζ) at the place; ζ is not read: with a measured one, if only noise, it would
                coast.
        """
        ocp = self._current(sample, memory).ocp
        if not np.all(np.isfinite(state)) and memory.plan is not None:
            state = np.concatenate(memory.plan.at(sample.time)[:2])
        state = np.where(np.arange(len(state)) < ocp.model.size, state, 0.0)[: ocp.state_size]
        if self._undriven:
            tip = ocp.model.task_pose(state[:ocp.model.size])[:3]
            state[self._undriven] = ocp.model.configuration(ocp.y_des)[self._undriven]
            state[:3] += tip - ocp.model.task_pose(state[:ocp.model.size])[:3]
        report = np.zeros(len(MPC_REPORT))
        report[:2] = sample.time, HOVERED
        return replace(memory, plan=ocp.resting_plan(sample.time, state, self._committed),
                       report=report, coming=None, awaits=False, at_rest=True,
                       solve_seconds=self.clock() - sample.started)

    def again(self, sample: Sample, memory: MpcMemory) -> MpcMemory:
        """Returns the memory after a later sample.

        Raises:
            RunFailed: The robot has hovered until now, and there is no first plan.
        """
        if memory.plan is not None and memory.at_rest:
            hovering = np.concatenate(memory.plan.at(sample.time)[:2])
            start = self._measured_start(sample)
            return self._from_rest(
                sample, memory,
                hovering[: self._solver.ocp.state_size] if start is None else start)
        if sample.fault == DROPPED:
            return self.pass_over(sample, memory, DROPPED)
        old, memory = memory, memory if sample.asked is None else replace(
            memory, asked=sample.asked)
        solver = self._current(sample, memory)
        guess = self._guess(sample, memory, solver.ocp)
        force, solution, status = memory.force, NOTHING, sample.fault
        if status == SOLVED:
            force, solution, status = self._solve(sample, memory, old.asked, solver, guess)
        deadline = self._solver.ocp.deadline
        if (status == SOLVED and deadline is not None
                and self.clock() - sample.started > deadline):
            status = TIMED_OUT
        if status != SOLVED:
            force, solution = memory.force, replace(solution, plan=None, evaluation=None)
        return self._remember(sample, replace(memory, force=force), guess, solution, status)

    def between(self, sample: Sample, memory: MpcMemory) -> MpcMemory:
        """Returns the memory between a later sample and the next one, when its plan comes.

        That has the plan of the last sample, continued to now; its own is still to be computed, by
        `again` of the memory that `taken` returns. The report is that of the plan taken, but for
        its time.
        """
        plan, report = memory.plan, memory.report.copy()
        report[0] = sample.time
        if plan is not None and memory.at_rest:  # As at any time; not continued, it would move.
            plan = replace(plan, start_time=sample.time)
        else:
            plan = self._guess(sample, memory, self._current(sample, memory).ocp)
        return replace(memory, plan=plan, report=report, awaits=True)

    def taken(self, sample: Sample, memory: MpcMemory) -> MpcMemory:
        """Returns the memory with the plan that comes; without it, if it is late or not sound.

        One that is not awaited is from before the last plan to rest, and passed over.
        """
        coming, memory = memory.coming, replace(memory, coming=None)
        if coming is not None and memory.awaits:
            ocp = self._current(sample, coming).ocp
            new, last = (ocp.evaluate(plan.after(self._committed))
                         for plan in (coming.plan, memory.plan) if plan is not None)
            if (coming.at_rest or not sample.given or ocp.is_sound(new)
                    or not ocp.is_sound(last)):
                return coming
        if not memory.awaits or memory.at_rest:
            return memory
        return self.pass_over(sample, memory, TIMED_OUT if coming is None else KEPT)

    def pass_over(self, sample: Sample, memory: MpcMemory, status: int) -> MpcMemory:
        """Returns the memory with the same plan, continued if it ends before the next sample.

        One that keeps a place keeps it on.
        """
        plan, now = memory.plan, sample.time
        assert plan is not None
        ocp, h = self._current(sample, memory).ocp, plan.time_step
        if memory.at_rest:
            plan = replace(plan, start_time=now)
        while plan.start_time + ocp.horizon * h < now + 0.5 * h:
            plan = ocp.continued(plan)
            # Else the sum of h would drift off k h.
            plan = replace(plan, start_time=now - round((now - plan.start_time) / h) * h)
        report = memory.report.copy()
        report[:2] = now, status
        _say(now, status, memory)
        return replace(memory, plan=plan, report=report, coming=None,
                       solve_seconds=self.clock() - sample.started)

    def _guess(self, sample: Sample, memory: MpcMemory, ocp: Ocp) -> Plan:
        """Returns the last plan continued to now, the start of a new one."""
        plan = memory.plan
        assert plan is not None
        guess = ocp.continued(plan)
        while guess.start_time < sample.time - 0.5 * plan.time_step:
            guess = ocp.continued(guess)  # Sampling instants were missed.
        guess = replace(guess, start_time=sample.time)  # Else the sum of h would drift off k h.
        start = self._measured_start(sample)
        return guess if start is None else guess.redone(start, guess.decision)

    def _measured_start(self, sample: Sample) -> np.ndarray | None:
        """Returns the measured state if a later plan is to start there and it is finite."""
        state = sample.measured if self._solver.ocp.starts_at_measured else None
        return state if state is not None and np.all(np.isfinite(state)) else None

    def _solve(self, sample: Sample, memory: MpcMemory, asked_before: np.ndarray,
               solver: Solver, guess: Plan) -> tuple[np.ndarray, Solution, int]:
        """Returns 𝔉_des (6,) of a new plan, its solution, and the outcome of the sample."""
        free = guess.after(self._committed)
        solution = self._retargeted(sample, memory, asked_before, free)
        if solution is not None:
            return memory.asked, solution, SOLVED
        ocp = solver.ocp
        solution = solver.solve(free, ocp.iterations)
        if solution.plan is None:
            return memory.force, solution, FAILED
        # An unsound new plan is taken only if the one that goes on is unsound, too.
        accepted = ocp.is_sound(solution.evaluation) or not ocp.is_sound(ocp.evaluate(free))
        return memory.force, solution, SOLVED if accepted else KEPT

    def _retargeted(self, sample: Sample, memory: MpcMemory, asked_before: np.ndarray, free: Plan
                    ) -> Solution | None:
        """Returns the plan for a new desired force, or None if there is none or it is refused.

        The logger gets the reason at the first sample of the request.
        """
        asked = memory.asked
        if self._targets is None or np.array_equal(asked, memory.force):
            return None
        solver, why = self.solver_for(asked)
        if solver is not None:
            solution = solver.solve(free, FIRST_SOLVE_ITERATIONS)
            if solver.ocp.is_sound(solution.evaluation, REACHED):
                return solution
            why = "no plan to it keeps the limits and ends in its terminal set"
        if not np.array_equal(asked, asked_before, equal_nan=True):
            warn(sample.time, f"the desired force is refused: {why}")
        return None

    def _current(self, sample: Sample, memory: MpcMemory) -> Solver:
        """Returns the solver of the plan's problem, with the inputs given now."""
        solver, _ = self.solver_for(memory.force)
        assert solver is not None  # It made the plan.
        return solver.of(solver.ocp.given(sample.given)) if sample.given else solver

    def solver_for(self, force: np.ndarray) -> tuple[Solver | None, str]:
        """Returns the solver of the problem of a desired force (6,); without one, the reason.

        It is made once, which may take seconds, and remembered.
        """
        if self._targets is None or np.array_equal(force, self.initial.force):
            return self._solver, ""
        return self._made(force.tobytes())

    def _make(self, force: bytes) -> tuple[Solver | None, str]:
        assert self._targets is not None
        try:
            return self._solver.of(self._targets.ocp(np.frombuffer(force))), ""
        except (InvalidParameter, np.linalg.LinAlgError) as error:
            return None, str(error)

    def _remember(self, sample: Sample, memory: MpcMemory, guess: Plan, solution: Solution,
               status: int) -> MpcMemory:
        """Returns the memory with the plan of a solution; with the guess, if it has none."""
        value = solution.evaluation or self._current(sample, memory).ocp.evaluate(
            guess.after(self._committed))
        _say(sample.time, status, memory)
        return replace(
            memory, solves=memory.solves + 1, solve_seconds=self.clock() - sample.started,
            plan=guess if solution.plan is None else solution.plan.preceded(guess, self._committed),
            at_rest=False,
            report=np.array([sample.time, float(status), value.cost, value.terminal_slack,
                             value.violation, solution.iterations,
                             float(not np.array_equal(memory.asked, memory.force)), solution.rows]))


def _say(now: float, status: int, old: MpcMemory) -> None:
    """Warns of a sample without a new plan, unless the one before it had the same outcome."""
    if status in TROUBLE and status != old.report[1]:
        warn(now, TROUBLE[status])


def committed_intervals(law: AncillaryLaw, command_path: CommandPath, time_step: float) -> int:
    """Returns n of plans that come at once; zero for a law without feedforward preview.

    Args:
        law: The law.
        command_path: Path of the commands, with ℓ as its `preview`.
        time_step: h [s].
    """
    if not law.takes_wrench:
        return 0
    return math.ceil(max(command_path.preview) / time_step - KNOT_TOLERANCE)
