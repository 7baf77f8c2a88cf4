"""The nominal MPC as a system: plans at the sampling instants, evaluates the plan in between."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiagramBuilder,
    EventStatus,
    LeafSystem,
    OutputPort,
    State,
    ValueProducer,
)

from uvms_drake.common.alarm import warn
from uvms_drake.common.errors import InvalidParameter, RunFailed
from uvms_drake.control.ocp import Ocp
from uvms_drake.control.plan import Plan, advance
from uvms_drake.control.scp import SequentialConvexSolver, Solution
from uvms_drake.control.why_no_plan import why_no_plan

FIRST_SOLVE_ITERATIONS = 50
"""Largest number of iterations of the first solve, which starts from a plan that goes nowhere."""
REACHED = 1e-6
"""Distance of a first plan to the terminal set, in ‖ξ‖_P, that counts as none."""

SOLVED, FAILED, LATE, DROPPED, KEPT, WAITING = range(6)
"""Outcomes of a sample: a new plan is made; the solver has none; it comes too late and is thrown
away; nothing is done at all; the last plan, continued, is kept, because it is within limits and
terminal set where the new one is not; the first plan is yet to begin."""

MPC_REPORT = ("time", "status", "cost", "terminal_slack", "violation", "iterations", "refused")
"""Entries about the last sample: t_k [s], its outcome (`SOLVED` 0, `FAILED` 1, `LATE` 2, `DROPPED`
3, `KEPT` 4, `WAITING` 5), the plan's objective, s of the terminal set, largest violation of a limit
(in its own unit), convex programs solved, 1 if a new desired force was asked for and is refused. A
sample that is dropped or waits changes the first two only."""

TROUBLE = {FAILED: "the solver failed", LATE: "the solver was too late",
           DROPPED: "the sample was dropped"}
"""Alarm about an outcome, given at the first of the samples in a row that have it."""

NOTHING: Solution = Solution(None, None, 0, converged=False)
"""Solution of a solver that did not even start."""

SOLVERS_KEPT = 16
"""Number of problems of other desired forces that are remembered, the latest ones."""


class Targets(NamedTuple):
    """How the nominal MPC comes by the problem of another desired force."""

    force: np.ndarray
    """𝔉_des at the start (6,) [N, N m]."""
    ocp: Callable[[np.ndarray], Ocp]
    """Function from another 𝔉_des to its problem; raises `InvalidParameter` if there is none."""


@dataclass(frozen=True)
class MpcMemory:
    """The memory of the nominal MPC: everything that changes in time lives in the Context."""

    plan: Plan | None = None
    """The current plan; none before the first sample."""
    force: np.ndarray = field(default_factory=lambda: np.zeros(6))
    """𝔉_des that the plan was made for (6,) [N, N m]; zero if it cannot be changed."""
    asked: np.ndarray = field(default_factory=lambda: np.zeros(6))
    """Last 𝔉_des that was asked for (6,) [N, N m]; it is refused if it is not `force`."""
    solves: int = 0
    """Number of plans made so far."""
    report: np.ndarray = field(default_factory=lambda: np.full(len(MPC_REPORT), np.nan))
    """The last values of `MPC_REPORT`."""
    solve_seconds: float = 0.0
    """Wall time of the last step [s]; the only thing here that is not reproducible."""


class NominalMpc(LeafSystem):
    """Solves the FHOCP at t = 0, h, 2h, ... and puts out the nominal trajectory at any time.

    The first plan is made at initialization, from the measured state; every later one starts at the
    state that the last plan predicted, because the tube is about the *nominal* trajectory:
    (eq:diff_mpc), which starts each solve at the measured state, contradicts the paper's own proof.
    A problem with the initial state `measured` does so all the same.

    The state is (𝔮, ζ) with a `DynamicOcp` and 𝔮 with a `KinematicOcp`, whose input is ζ̄.

    If a solve fails, or takes longer than the problem's deadline, the last plan continued by the
    terminal controller takes its place; likewise if it is sound and the new one is not, which is no
    failure: the proofs ask for nothing better. If a sampling instant is dropped, the last plan goes
    on as it is, and where it ends, by the terminal controller. `report` says which, and the logger
    `uvms_drake` tells of trouble at the first of the samples in a row where it is so. All but the
    first plan can be made to fail by the port `fault`. Without a first plan there is nothing to
    fall back to: `RunFailed`.

    The first plan may begin a few intervals later, until when the robot coasts: what is to be asked
    for ahead, see `control.ahead`, has to be known before it is needed. A robot at rest hovers.

    A measured state that is not finite is none: there is no first plan from it, and a problem with
    the initial state `measured` plans from the nominal state instead.

    With `targets` the desired force can be changed while it runs. A new one gets a problem of its
    own, with its own equilibrium, penalty and terminal set. If that has a feasible plan from the
    nominal state, into its terminal set, it is taken; else the old one is kept, the refusal
    reported, and the new one tried again at the next sample. So what made the continued plan
    feasible before makes it so after: a checked terminal set that the last plan reached (slack
    zero), and plans that start at the nominal state.

    What a problem says by `inputs_given` that may change, as a target may with a `TrackingOcp`, has
    a port of its own, is read at every sample, and costs nothing. It is left as it was where a port
    is not connected. A contact between two samples is planned for at the next one: the knots of the
    plan, at which limits hold and by which it is continued, are the sampling instants.

    .. pydrake_system::

        name: NominalMpc
        input_ports:
        - state
        - fault (optional)
        - desired_force (optional, with targets)
        - target (optional, with a TrackingOcp)
        - safe_depth (optional, with a TrackingOcp)
        - approach_speed (optional, with a TrackingOcp)
        output_ports:
        - nominal_state
        - nominal_acceleration (with a DynamicOcp)
        - nominal_input
        - plan
        - report
        - solve_seconds
        - accepted_force (with targets)

    - `state`: (𝔮, ζ) (2(6+n)) or 𝔮 (6+n) measured, in the paper's order; unless each plan starts
      there, it is read at initialization only.
    - `fault` (1): outcome of the sample, `SOLVED` unless something fails; read at every sample
      after the first.
    - `nominal_state`: (𝔮̄, ζ̄) at the context's time (2(6+n)).
    - `nominal_acceleration`: ζ̄̇ (6+n).
    - `nominal_input`: ū = ζ̄̇ − f(𝔮̄, ζ̄), or ζ̄ (6+n).
    - `plan`: the current `Plan` (abstract).
    - `report`: see `MPC_REPORT`.
    - `solve_seconds`: wall time of the last step [s]; not reproducible, unlike all else.
    - `target` (3), `safe_depth` (one for each facet), `approach_speed` (1): the `Aim` [m, m, m/s];
      see `TrackingOcp` for when every problem is feasible.
    - `desired_force`, `accepted_force`: 𝔉_des as asked for and as planned for (6) [N, N m].

    The state is one abstract `MpcMemory`. Beside it the system remembers the problems of the latest
    desired forces, each a pure function of its force. The computation takes no simulated time.

    Args:
        solver: Solves the problem; its `ocp` is the problem.
        targets: Makes the problem of another desired force; None if it stays as it is.
        hover: Number of intervals before the first plan begins; zero for a `KinematicOcp`.
    """

    def __init__(self, solver: SequentialConvexSolver, targets: Targets | None = None,
                 hover: int = 0):
        super().__init__()
        # The problem, and how to make one for another desired force.
        self._targets = targets
        self._solver = solver
        self._ocp = solver.ocp
        self._hover = hover * solver.ocp.time_step
        size = self._ocp.model.size
        force = np.zeros(6) if targets is None else np.asarray(targets.force, dtype=float)
        self._problem = lru_cache(maxsize=SOLVERS_KEPT)(self._make_solver)
        self._initial = MpcMemory(force=force, asked=force)
        # State and inputs.
        self._memory = self.DeclareAbstractState(Value(self._initial))
        self._state_port = self.DeclareVectorInputPort("state", self._ocp.state_size)
        self._fault_port = self.DeclareVectorInputPort("fault", 1)
        if targets is not None:
            self._force_port = self.DeclareVectorInputPort("desired_force", 6)
            self.DeclareVectorOutputPort(
                "accepted_force", 6, self._calc_force, {self.abstract_state_ticket(self._memory)})
        self._given_ports = {name: self.DeclareVectorInputPort(name, size)
                             for name, size in self._ocp.inputs_given.items()}
        # Events, and the nominal trajectory as a cache entry.
        self.DeclareInitializationUnrestrictedUpdateEvent(self._plan_first)
        self.DeclarePeriodicUnrestrictedUpdateEvent(self._ocp.time_step, 0.0, self._plan_again)
        remembered = {self.abstract_state_ticket(self._memory)}
        self._nominal = self.DeclareCacheEntry(
            description="the nominal trajectory now",
            value_producer=ValueProducer(
                allocate=lambda: AbstractValue.Make(()), calc=self._evaluate_plan),
            prerequisites_of_calc=remembered | {self.time_ticket()})
        # Outputs.
        evaluated = {self._nominal.ticket()}
        self.DeclareVectorOutputPort("nominal_state", 2 * size, self._calc_state, evaluated)
        if self._ocp.has_accelerations:
            self.DeclareVectorOutputPort(
                "nominal_acceleration", size, self._calc_acceleration, evaluated)
        self.DeclareVectorOutputPort("nominal_input", size, self._calc_input, evaluated)
        self.DeclareAbstractOutputPort(
            "plan", lambda: Value(object()), self._calc_plan, remembered)
        self.DeclareVectorOutputPort("report", len(MPC_REPORT), self._calc_report, remembered)
        self.DeclareVectorOutputPort("solve_seconds", 1, self._calc_seconds, remembered)

    def _recall(self, context: Context) -> MpcMemory:
        return context.get_abstract_state(int(self._memory)).get_value()

    def _plan_now(self, context: Context) -> Plan:
        plan = self._recall(context).plan
        if plan is None:
            raise RuntimeError("NominalMpc has no plan yet: call Simulator.Initialize() first")
        return plan

    def _plan_first(self, context: Context, state: State) -> EventStatus:
        started = time.perf_counter()
        now, h = context.get_time(), self._ocp.time_step
        if self._goes_on(self._recall(context), now):
            return EventStatus.DidNothing()
        if abs(now / h - round(now / h)) > 1e-6:
            raise RunFailed(f"the nominal MPC starts at t = {now:g} s: must be a multiple of its "
                            f"sampling period, {h:g} s")
        measured = self._state_port.Eval(context)
        if not np.all(np.isfinite(measured)):
            raise RunFailed(f"the measured state is not finite at t = {now:.3f} s")
        solver = self._current(context, self._initial)
        if self._hover > 0.0:
            config, zeta = np.split(measured, 2)
            measured = np.append(advance(config, zeta, np.zeros_like(zeta), self._hover), zeta)
        guess = solver.ocp.resting_plan(now + self._hover, measured)
        solution = solver.solve(guess, FIRST_SOLVE_ITERATIONS)
        slack = REACHED if solver.ocp.strict else np.inf
        if solution.plan is None or not solver.ocp.is_sound(solution.evaluation, slack):
            why = why_no_plan(solver.ocp, guess, solution.plan, solver.ocp.tolerance)
            raise RunFailed(f"the nominal MPC has no solution at the start: {why}")
        return self._remember(
            context, state, self._initial, SOLVED, solution, solution.plan, started)

    def _goes_on(self, memory: MpcMemory, now: float) -> bool:
        """Returns whether an initialized Context goes on with its plan, as a clone of a run does.

        The first plan is made anew as long as its first instant has not passed: the measured state
        may have been changed since.
        """
        if memory.plan is None:
            return False
        elapsed = now - memory.report[0]  # Since the last sample; it may have left the plan as is.
        latest = (1.0 + 1e-9) * self._ocp.time_step
        begun = now > memory.plan.start_time - self._hover or memory.solves > 1
        return begun and -1e-9 <= elapsed <= latest

    def _plan_again(self, context: Context, state: State) -> EventStatus:
        started = time.perf_counter()
        now, plan = context.get_time(), self._plan_now(context)
        if now < plan.start_time - self._hover + 0.5 * plan.time_step:
            return EventStatus.DidNothing()  # The first plan was made a moment ago.
        if now < plan.start_time + 0.5 * plan.time_step:
            return self._pass_over(context, state, WAITING, started)  # It begins now or later.
        fault = self._fault(context)
        if fault == DROPPED:
            return self._pass_over(context, state, DROPPED, started)
        memory = self._asked(context)
        guess = self._guess(context, memory)
        force, solution, status = memory.force, NOTHING, fault
        if fault == SOLVED:
            force, solution, status = self._solve(context, memory, guess)
        deadline = self._ocp.deadline
        if status == SOLVED and deadline is not None and time.perf_counter() - started > deadline:
            status = LATE
        if status != SOLVED:
            force, solution = memory.force, replace(solution, plan=None, evaluation=None)
        return self._remember(context, state, replace(memory, force=force), status, solution,
                              solution.plan or guess, started)

    def _fault(self, context: Context) -> int:
        return int(self._fault_port.Eval(context)[0]) if self._fault_port.HasValue(context) \
            else SOLVED

    def _pass_over(self, context: Context, state: State, status: int, started: float
                   ) -> EventStatus:
        """Leaves the plan as it is, but for an end that comes before the next sample."""
        memory, now = self._recall(context), context.get_time()
        plan = memory.plan
        assert plan is not None
        ocp = self._current(context, memory).ocp
        while plan.start_time + ocp.horizon * plan.time_step < now + 0.5 * plan.time_step:
            plan = ocp.continued(plan)
        report = memory.report.copy()
        report[:2] = now, status
        self._say(now, status, memory)
        state.get_mutable_abstract_state(int(self._memory)).set_value(replace(
            memory, plan=plan, report=report, solve_seconds=time.perf_counter() - started))
        return EventStatus.Succeeded()

    def _asked(self, context: Context) -> MpcMemory:
        """Returns the memory with the 𝔉_des that is asked for now."""
        memory = self._recall(context)
        if self._targets is None or not self._force_port.HasValue(context):
            return memory
        return replace(memory, asked=self._force_port.Eval(context).copy())

    def _guess(self, context: Context, memory: MpcMemory) -> Plan:
        """Returns the last plan continued to now, from where a new one is to start."""
        plan, ocp = memory.plan, self._current(context, memory).ocp
        assert plan is not None
        guess = ocp.continued(plan)
        while guess.start_time < context.get_time() - 0.5 * plan.time_step:
            guess = ocp.continued(guess)  # Sampling instants were missed.
        if ocp.starts_at_measured:
            measured = self._state_port.Eval(context)
            if np.all(np.isfinite(measured)):
                guess = guess.redone(measured, guess.decision)
        return guess

    def _solve(self, context: Context, memory: MpcMemory, guess: Plan
               ) -> tuple[np.ndarray, Solution, int]:
        """Returns 𝔉_des (6,) of a new plan, the solution for it, and the outcome of the sample."""
        solution = self._retargeted(context, memory, guess)
        if solution is not None:
            return memory.asked, solution, SOLVED
        solver = self._current(context, memory)
        ocp = solver.ocp
        solution = solver.solve(guess, ocp.iterations)
        if solution.plan is None:
            return memory.force, solution, FAILED
        slack = ocp.tolerance if ocp.ends_at_task else np.inf
        better = ocp.is_sound(solution.evaluation, slack) or not ocp.is_sound(
            ocp.evaluate(guess), slack)
        return memory.force, solution, SOLVED if better else KEPT

    def _retargeted(self, context: Context, memory: MpcMemory, guess: Plan) -> Solution | None:
        """Returns the plan to a new desired force, or None if there is none or it is refused.

        The logger is told why it is refused, at the first sample at which it is asked for.
        """
        asked = memory.asked
        if self._targets is None or np.array_equal(asked, memory.force):
            return None
        solver = self._solver_of(asked)
        if solver is None:
            _, why = self._problem(asked.tobytes())
        else:
            solution = solver.solve(guess, FIRST_SOLVE_ITERATIONS)
            if solver.ocp.is_sound(solution.evaluation, REACHED):
                return solution
            why = "no plan to it keeps the limits and ends in its terminal set"
        if not np.array_equal(asked, self._recall(context).asked):
            warn(context.get_time(), f"the desired force is refused: {why}")
        return None

    def _current(self, context: Context, memory: MpcMemory) -> SequentialConvexSolver:
        """Returns the solver of the problem whose plan it is, for what is given now."""
        solver = self._solver_of(memory.force)
        assert solver is not None  # It made the plan.
        given = {name: port.Eval(context) for name, port in self._given_ports.items()
                 if port.HasValue(context)}
        return SequentialConvexSolver(solver.ocp.given(given)) if given else solver

    def _solver_of(self, force: np.ndarray) -> SequentialConvexSolver | None:
        """Returns the solver of the problem of a desired force (6,), or None if there is none.

        The latest are remembered; they are no state, but a function of the force alone.
        """
        if np.array_equal(force, self._initial.force):
            return self._solver
        return self._problem(force.tobytes())[0]

    def _make_solver(self, force: bytes) -> tuple[SequentialConvexSolver | None, str]:
        assert self._targets is not None
        try:
            return SequentialConvexSolver(self._targets.ocp(np.frombuffer(force))), ""
        except (InvalidParameter, np.linalg.LinAlgError) as error:
            return None, str(error)

    def _remember(self, context: Context, state: State, old: MpcMemory, status: int,
                  solution: Solution, plan: Plan, started: float) -> EventStatus:
        now = context.get_time()
        value = solution.evaluation or self._current(context, old).ocp.evaluate(plan)
        report = np.array([now, float(status), value.cost, value.terminal_slack,
                           value.violation, solution.iterations,
                           float(not np.array_equal(old.asked, old.force))])
        self._say(now, status, old)
        state.get_mutable_abstract_state(int(self._memory)).set_value(replace(
            old, plan=plan, solves=old.solves + 1, report=report,
            solve_seconds=time.perf_counter() - started))
        return EventStatus.Succeeded()

    def _say(self, now: float, status: int, old: MpcMemory) -> None:
        """Says on the logger that a sample came to nothing, unless the one before it did so too."""
        if status in TROUBLE and status != old.report[1]:
            warn(now, TROUBLE[status])

    def _evaluate_plan(self, context: Context, nominal: AbstractValue) -> None:
        last_sample = float(self._recall(context).report[0])
        nominal.set_value(self._plan_now(context).at(context.get_time(), last_sample))

    def _calc_state(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(np.concatenate(self._nominal.Eval(context)[:2]))

    def _calc_acceleration(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._nominal.Eval(context)[2])

    def _calc_input(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._ocp.nominal_input(self._nominal.Eval(context)))

    def _calc_plan(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self._plan_now(context))

    def _calc_report(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._recall(context).report)

    def _calc_force(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._recall(context).force)

    def _calc_seconds(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector([self._recall(context).solve_seconds])

    @staticmethod
    def AddToBuilder(builder: DiagramBuilder, solver: SequentialConvexSolver, *,
                     state: OutputPort | None = None, targets: Targets | None = None,
                     hover: int = 0, name: str = "nominal_mpc") -> "NominalMpc":
        """Adds the planner; `state` gives (𝔮, ζ) or 𝔮 and is left to the caller if None."""
        mpc = NominalMpc(solver, targets, hover)
        builder.AddNamedSystem(name, mpc)
        if state is not None:
            builder.Connect(state, mpc.GetInputPort("state"))
        return mpc
