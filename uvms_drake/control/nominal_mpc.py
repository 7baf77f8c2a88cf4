"""The nominal MPC as a system: plans at the sampling instants, evaluates the plan in between."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import (
    DiagramBuilder,
    EventStatus,
    LeafSystem,
    OutputPort,
    ValueProducer,
)

from uvms_drake.alarm import warn
from uvms_drake.control.dynamic_ocp import DynamicOcp
from uvms_drake.control.ocp import Ocp
from uvms_drake.control.plan import Plan
from uvms_drake.control.scp import SequentialConvexSolver, Solution
from uvms_drake.errors import InvalidParameter, RunFailed

FIRST_SOLVE_ITERATIONS = 50
"""The first solve starts from a plan that goes nowhere and is iterated to convergence."""
FEASIBLE = 1e-4
"""Largest violation that the first plan may have, in the unit of the limit that it violates."""

REACHED = 1e-6
"""Distance to the terminal set, in ‖ξ‖_P, that counts as none."""

REPORT_FIELDS = ("time", "status", "cost", "terminal_slack", "violation", "iterations", "refused")
"""Of the last sample: t_k [s], 0 solved or 1 fallback, the plan's objective, s of the terminal
set, largest violation of a limit (in its own unit), convex programs solved, 1 if a new desired
force was asked for and is refused."""

TROUBLE = {1: "the solver failed", 2: "the solver was too late", 3: "the sample was dropped"}
"""What is said of a status at the first of the samples in a row that have it."""

SOLVERS_KEPT = 16
"""Problems of other desired forces that are remembered, the latest ones."""


class Targets(NamedTuple):
    """How the nominal MPC comes by the problem of another desired force."""

    force: np.ndarray
    """𝔉_des at the start (6,) [N, N m]."""
    ocp: Callable[[np.ndarray], Ocp]
    """Returns the problem of another 𝔉_des; raises `InvalidParameter` if there is none."""
    accepts: Callable[[np.ndarray, Plan], bool]
    """Returns whether the first plan to another 𝔉_des stays where the tube holds."""


@dataclass(frozen=True)
class MpcMemory:
    """What the nominal MPC remembers: everything that changes in time lives in the Context."""

    plan: Plan | None = None
    force: np.ndarray = field(default_factory=lambda: np.zeros(6))
    """𝔉_des of the problem whose plan it is (6,) [N, N m]; zero if it cannot be changed."""
    asked: np.ndarray = field(default_factory=lambda: np.zeros(6))
    """The last 𝔉_des that was asked for, and is refused if it is not `force`."""
    solves: int = 0
    """Plans made so far."""
    report: np.ndarray = field(default_factory=lambda: np.full(len(REPORT_FIELDS), np.nan))
    solve_seconds: float = 0.0
    """Wall time of the last step; the only thing here that is not reproducible."""


class NominalMpc(LeafSystem):
    """Solves the FHOCP at t = 0, h, 2h, ... and puts out the nominal trajectory at any time.

    The first plan is made at initialization, from the measured state; every later one starts at the
    state that the last plan predicted, because the tube is about the *nominal* trajectory:
    (eq:diff_mpc), which starts each solve at the measured state, contradicts the paper's own proof.
    A problem with the initial state `measured` does so all the same.

    The state is (𝔮, ζ) with a `DynamicOcp` and 𝔮 with a `KinematicOcp`, whose input is ζ̄.

    If a solve fails, the last plan continued by the terminal controller takes its place; that is
    counted in `report`, and said on the logger `uvms_drake` at the first of the samples in a row
    where it is so. If a sampling instant is missed, the last plan goes on. Without a first
    plan there is nothing to fall back to: `RunFailed`.

    With `targets` the desired force can be changed while it runs. A new one gets a problem of its
    own, with its own equilibrium, penalty and terminal set. If that has a feasible plan from the
    nominal state, into its terminal set, it is taken; else the old one is kept, the refusal
    reported, and the new one tried again at the next sample. So what made the continued plan
    feasible before makes it so after: a checked terminal set that the last plan reached (slack
    zero), and plans that start at the nominal state.

    .. pydrake_system::

        name: NominalMpc
        input_ports:
        - state
        - desired_force (optional, with targets)
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
    - `nominal_state`: (𝔮̄, ζ̄) at the context's time (2(6+n)).
    - `nominal_acceleration`: ζ̄̇ (6+n).
    - `nominal_input`: ū = ζ̄̇ − f(𝔮̄, ζ̄), or ζ̄ (6+n).
    - `plan`: the current `Plan` (abstract).
    - `report`: see `REPORT_FIELDS`.
    - `solve_seconds`: wall time of the last step [s]; not reproducible, unlike all else.
    - `desired_force`, `accepted_force`: 𝔉_des as asked for and as planned for (6) [N, N m].

    The state is one abstract `MpcMemory`. The computation takes no simulated time.

    Args:
        solver: Solves the problem; its `ocp` is the problem.
        targets: Makes the problem of another desired force; None if it stays as it is.
    """

    def __init__(self, solver: SequentialConvexSolver, targets: Targets | None = None):
        super().__init__()
        self._targets = targets
        self._solver = solver
        self._ocp = solver.ocp
        size = self._ocp.model.size
        force = np.zeros(6) if targets is None else np.asarray(targets.force, dtype=float)
        self._problem = lru_cache(maxsize=SOLVERS_KEPT)(self._make_solver)
        self._initial = MpcMemory(force=force, asked=force)
        self._memory = self.DeclareAbstractState(Value(self._initial))
        self._state_port = self.DeclareVectorInputPort("state", self._ocp.state_size)
        if targets is not None:
            self._force_port = self.DeclareVectorInputPort("desired_force", 6)
            self.DeclareVectorOutputPort(
                "accepted_force", 6, self._calc_force, {self.abstract_state_ticket(self._memory)})
        self.DeclareInitializationUnrestrictedUpdateEvent(self._plan_first)
        self.DeclarePeriodicUnrestrictedUpdateEvent(self._ocp.time_step, 0.0, self._plan_again)
        remembered = {self.abstract_state_ticket(self._memory)}
        self._nominal = self.DeclareCacheEntry(
            description="the nominal trajectory now",
            value_producer=ValueProducer(
                allocate=lambda: AbstractValue.Make(()), calc=self._evaluate_plan),
            prerequisites_of_calc=remembered | {self.time_ticket()})
        evaluated = {self._nominal.ticket()}
        self.DeclareVectorOutputPort("nominal_state", 2 * size, self._calc_state, evaluated)
        if isinstance(self._ocp, DynamicOcp):
            self.DeclareVectorOutputPort(
                "nominal_acceleration", size, self._calc_acceleration, evaluated)
        self.DeclareVectorOutputPort("nominal_input", size, self._calc_input, evaluated)
        self.DeclareAbstractOutputPort(
            "plan", lambda: Value(object()), self._calc_plan, remembered)
        self.DeclareVectorOutputPort("report", len(REPORT_FIELDS), self._calc_report, remembered)
        self.DeclareVectorOutputPort("solve_seconds", 1, self._calc_seconds, remembered)

    def _recall(self, context) -> MpcMemory:
        return context.get_abstract_state(int(self._memory)).get_value()

    def _plan_now(self, context) -> Plan:
        plan = self._recall(context).plan
        if plan is None:
            raise RuntimeError("NominalMpc has no plan yet: call Simulator.Initialize() first")
        return plan

    def _plan_first(self, context, state):
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
        guess = self._ocp.resting_plan(now, measured)
        solution = self._solver.solve(guess, FIRST_SOLVE_ITERATIONS)
        if solution.plan is None or not solution.evaluation.violation <= FEASIBLE:
            raise RunFailed("the nominal MPC has no solution at the start: the limits cannot be "
                            "kept from there, or the tube leaves too little of them")
        return self._remember(state, self._initial, now, solution, solution.plan, started)

    def _goes_on(self, memory: MpcMemory, now: float) -> bool:
        """Returns whether an initialized Context goes on with its plan, as a clone of a run does.

        The first plan is made anew as long as its first instant has not passed: the measured state
        may have been changed since.
        """
        if memory.plan is None:
            return False
        elapsed = now - memory.plan.start_time
        latest = (1.0 + 1e-9) * self._ocp.time_step
        return (elapsed > 0.0 or memory.solves > 1) and -1e-9 <= elapsed <= latest

    def _plan_again(self, context, state):
        started = time.perf_counter()
        plan = self._plan_now(context)
        if context.get_time() < plan.start_time + 0.5 * plan.time_step:
            return EventStatus.DidNothing()  # The first plan was made a moment ago.
        memory = self._recall(context)
        solver = self._current(memory)
        ocp = solver.ocp
        guess = ocp.continued(plan)
        while guess.start_time < context.get_time() - 0.5 * plan.time_step:
            guess = ocp.continued(guess)  # Sampling instants were missed.
        if ocp.starts_at_measured:
            guess = guess.redone(self._state_port.Eval(context), guess.decision)
        memory, solution = self._retargeted(context, memory, guess)
        if solution is None:
            solution = solver.solve(guess, ocp.iterations)
            if solution.evaluation is not None and solution.evaluation.violation > FEASIBLE \
                    and ocp.evaluate(guess).violation <= FEASIBLE:
                solution = replace(solution, plan=None, evaluation=None)  # The guess is better.
        return self._remember(state, memory, context.get_time(), solution,
                              solution.plan or guess, started)

    def _retargeted(self, context, memory: MpcMemory, guess: Plan
                    ) -> tuple[MpcMemory, Solution | None]:
        """Returns what is remembered after a look at `desired_force`, and the plan to a new one."""
        if self._targets is None or not self._force_port.HasValue(context):
            return memory, None
        asked = self._force_port.Eval(context)
        memory = replace(memory, asked=asked.copy())
        if np.array_equal(asked, memory.force):
            return memory, None
        solver = self._solver_of(asked)
        if solver is None:
            return memory, None
        solution = solver.solve(guess, FIRST_SOLVE_ITERATIONS)
        plan, value = solution.plan, solution.evaluation
        if plan is None or value is None:
            return memory, None
        if not (value.violation <= FEASIBLE and value.terminal_slack <= REACHED
                and self._targets.accepts(asked, plan)):
            return memory, None
        return replace(memory, force=memory.asked), solution

    def _current(self, memory: MpcMemory) -> SequentialConvexSolver:
        """Returns the solver of the problem whose plan it is."""
        solver = self._solver_of(memory.force)
        assert solver is not None  # It made the plan.
        return solver

    def _solver_of(self, force: np.ndarray) -> SequentialConvexSolver | None:
        """Returns the solver of the problem of a desired force (6,), or None if there is none.

        The latest are remembered; they are no state, but a function of the force alone.
        """
        if np.array_equal(force, self._initial.force):
            return self._solver
        return self._problem(force.tobytes())

    def _make_solver(self, force: bytes) -> SequentialConvexSolver | None:
        assert self._targets is not None
        try:
            return SequentialConvexSolver(self._targets.ocp(np.frombuffer(force)))
        except (InvalidParameter, np.linalg.LinAlgError):
            return None

    def _remember(self, state, old: MpcMemory, now: float, solution: Solution, plan: Plan,
                  started: float):
        value = solution.evaluation or self._current(old).ocp.evaluate(plan)
        report = np.array([now, float(solution.plan is None), value.cost, value.terminal_slack,
                           value.violation, solution.iterations,
                           float(not np.array_equal(old.asked, old.force))])
        if report[1] not in (0.0, old.report[1]):
            warn(now, TROUBLE[int(report[1])])
        state.get_mutable_abstract_state(int(self._memory)).set_value(replace(
            old, plan=plan, solves=old.solves + 1, report=report,
            solve_seconds=time.perf_counter() - started))
        return EventStatus.Succeeded()

    def _evaluate_plan(self, context, nominal):
        nominal.set_value(self._plan_now(context).at(context.get_time()))

    def _calc_state(self, context, output):
        output.SetFromVector(np.concatenate(self._nominal.Eval(context)[:2]))

    def _calc_acceleration(self, context, output):
        output.SetFromVector(self._nominal.Eval(context)[2])

    def _calc_input(self, context, output):
        output.SetFromVector(self._ocp.nominal_input(self._nominal.Eval(context)))

    def _calc_plan(self, context, output):
        output.set_value(self._plan_now(context))

    def _calc_report(self, context, output):
        output.SetFromVector(self._recall(context).report)

    def _calc_force(self, context, output):
        output.SetFromVector(self._recall(context).force)

    def _calc_seconds(self, context, output):
        output.SetFromVector([self._recall(context).solve_seconds])

    @staticmethod
    def AddToBuilder(builder: DiagramBuilder, solver: SequentialConvexSolver, *,
                     state: OutputPort | None = None, targets: Targets | None = None,
                     name: str = "nominal_mpc") -> "NominalMpc":
        """Adds the planner; `state` gives (𝔮, ζ) or 𝔮 and is left to the caller if None."""
        mpc = NominalMpc(solver, targets)
        builder.AddNamedSystem(name, mpc)
        if state is not None:
            builder.Connect(state, mpc.GetInputPort("state"))
        return mpc
