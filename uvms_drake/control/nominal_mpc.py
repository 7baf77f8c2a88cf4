"""The nominal MPC as a system: plans at the sampling instants, evaluates the plan in between."""

import time
from dataclasses import dataclass, field

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import (
    DiagramBuilder,
    EventStatus,
    LeafSystem,
    OutputPort,
    ValueProducer,
)

from uvms_drake.control.plan import Plan
from uvms_drake.control.scp import SequentialConvexSolver, Solution
from uvms_drake.errors import RunFailed

FIRST_SOLVE_ITERATIONS = 50
"""The first solve starts from a plan that goes nowhere and is iterated to convergence."""
FEASIBLE = 1e-4
"""Largest violation that the first plan may have, in the unit of the limit that it violates."""

REPORT_FIELDS = ("time", "status", "cost", "terminal_slack", "violation", "iterations")
"""Of the last sample: t_k [s], 0 solved or 1 fallback, the plan's objective, s of the terminal
set, largest violation of a limit (in its own unit), convex programs solved."""


@dataclass(frozen=True)
class MpcMemory:
    """What the nominal MPC remembers: everything that changes in time lives in the Context."""

    plan: Plan | None = None
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

    If a solve fails, the last plan continued by the terminal controller takes its place; that is
    counted in `report`. Without a first plan there is nothing to fall back to: `RunFailed`.

    .. pydrake_system::

        name: NominalMpc
        input_ports:
        - state
        output_ports:
        - nominal_state
        - nominal_acceleration
        - nominal_input
        - plan
        - report
        - solve_seconds

    - `state`: (𝔮, ζ) measured (2(6+n)), in the paper's order; read at initialization only.
    - `nominal_state`: (𝔮̄, ζ̄) at the context's time (2(6+n)).
    - `nominal_acceleration`: ζ̄̇ (6+n).
    - `nominal_input`: ū = ζ̄̇ − f(𝔮̄, ζ̄) (6+n).
    - `plan`: the current `Plan` (abstract).
    - `report`: see `REPORT_FIELDS`.
    - `solve_seconds`: wall time of the last step [s]; not reproducible, unlike all else.

    The state is one abstract `MpcMemory`. The computation takes no simulated time.

    Args:
        solver: Solves the problem; its `ocp` is the problem.
    """

    def __init__(self, solver: SequentialConvexSolver):
        super().__init__()
        self._solver = solver
        self._ocp = solver.ocp
        size = self._ocp.model.size
        self._memory = self.DeclareAbstractState(Value(MpcMemory()))
        self._state_port = self.DeclareVectorInputPort("state", 2 * size)
        self.DeclareInitializationUnrestrictedUpdateEvent(self._plan_first)
        self.DeclarePeriodicUnrestrictedUpdateEvent(self._ocp.time_step, 0.0, self._plan_again)
        remembered = {self.abstract_state_ticket(self._memory)}
        self._nominal = self.DeclareCacheEntry(
            description="𝔮̄, ζ̄ and ζ̄̇ now",
            value_producer=ValueProducer(
                allocate=lambda: AbstractValue.Make(()), calc=self._evaluate_plan),
            prerequisites_of_calc=remembered | {self.time_ticket()})
        evaluated = {self._nominal.ticket()}
        self.DeclareVectorOutputPort("nominal_state", 2 * size, self._calc_state, evaluated)
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
        guess = self._ocp.resting_plan(now, self._state_port.Eval(context))
        solution = self._solver.solve(guess, FIRST_SOLVE_ITERATIONS)
        if solution.plan is None or solution.evaluation.violation > FEASIBLE:
            raise RunFailed("the nominal MPC has no solution at the start: the limits cannot be "
                            "kept from there, or the tube leaves too little of them")
        return self._remember(state, MpcMemory(), now, solution, solution.plan, started)

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
        guess = self._ocp.continued(plan)
        solution = self._solver.solve(guess, self._ocp.iterations)
        return self._remember(state, self._recall(context), context.get_time(), solution,
                              solution.plan or guess, started)

    def _remember(self, state, old: MpcMemory, now: float, solution: Solution, plan: Plan,
                  started: float):
        value = solution.evaluation or self._ocp.evaluate(plan)
        report = np.array([now, float(solution.plan is None), value.cost, value.terminal_slack,
                           value.violation, solution.iterations])
        state.get_mutable_abstract_state(int(self._memory)).set_value(
            MpcMemory(plan, old.solves + 1, report, time.perf_counter() - started))
        return EventStatus.Succeeded()

    def _evaluate_plan(self, context, nominal):
        nominal.set_value(self._plan_now(context).at(context.get_time()))

    def _calc_state(self, context, output):
        config, zeta, _ = self._nominal.Eval(context)
        output.SetFromVector(np.concatenate([config, zeta]))

    def _calc_acceleration(self, context, output):
        output.SetFromVector(self._nominal.Eval(context)[2])

    def _calc_input(self, context, output):
        config, zeta, zeta_dot = self._nominal.Eval(context)
        output.SetFromVector(zeta_dot - self._ocp.model.drift(config, zeta))

    def _calc_plan(self, context, output):
        output.set_value(self._plan_now(context))

    def _calc_report(self, context, output):
        output.SetFromVector(self._recall(context).report)

    def _calc_seconds(self, context, output):
        output.SetFromVector([self._recall(context).solve_seconds])

    @staticmethod
    def AddToBuilder(builder: DiagramBuilder, solver: SequentialConvexSolver, *,
                     state: OutputPort | None = None,
                     name: str = "nominal_mpc") -> "NominalMpc":
        """Adds the planner; `state` gives (𝔮, ζ) and is left to the caller if None."""
        mpc = NominalMpc(solver)
        builder.AddNamedSystem(name, mpc)
        if state is not None:
            builder.Connect(state, mpc.GetInputPort("state"))
        return mpc
