"""Nominal MPC as a system: plans at the sampling instants, evaluates the plan in between."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import Context, EventStatus, InputPort, State

from uvms_drake.common.alarm import warn
from uvms_drake.common.errors import RunFailed
from uvms_drake.common.wiring import WiredSystem, cached, output_of
from uvms_drake.control.mpc import planner
from uvms_drake.control.ocp.scp import Solver
from uvms_drake.control.plan.plan import Plan


class Computer(Protocol):
    """Computer of plans that runs beside the loop, as in another process."""

    def start(self, sample: planner.Sample, memory: planner.MpcMemory) -> None:
        """Begins to compute `Planner.again`, unless it is at work still."""

    def result(self) -> planner.MpcMemory | None:
        """Returns the memory of the last `start`; None if it is late, or was not begun."""


class NominalMpc(WiredSystem):
    """Planner that solves the FHOCP at t = 0, h, 2h, ...; its output is the nominal trajectory.

    The first plan is made at initialization, from the measured state; every later one starts at the
    state that the last plan predicted, because the tube is about the *nominal* trajectory:
    (eq:diff_mpc), which starts each solve at the measured state, contradicts the paper's own proof.
    A problem with the initial state `measured` follows (eq:diff_mpc).

    If a solve fails, or takes longer than the problem's deadline, the last plan continued by the
    terminal controller replaces the new one; likewise if it is sound and the new one is not, which
    is no failure. If a sampling instant is dropped, the last plan goes on unchanged, and after its
    end by the terminal controller. `report` has the outcome, and the logger `uvms_drake` warns at
    the first of consecutive samples with it. The port `fault` can make any plan but the first fail.
    Without a first plan there is no fallback: `RunFailed`.

    Before the problem's `hover` the plan is to keep the place measured at initialization, for
    observers to settle; if the first plan after it fails, it is `RunFailed`, too. With a supervisor
    one that fails later, as of a slow `computer` or from where a retreat has ended, is a failed
    sample: the place is kept, and the next sample tries again.
    Coordinates that nothing drives are where the task has them.

    The first n intervals of a plan may be committed: each plan then has those of the last one, and
    the first one coasts (from rest, hovers) there; see `planner`.

    A measured state that is not finite counts as missing: there is no first plan from it, and a
    problem with the initial state `measured` plans from the nominal state instead.

    With `targets` the desired force can change at run time. A new one gets a problem of its own,
    with its own equilibrium, penalty and terminal set. If that has a feasible plan from the nominal
    state, into its terminal set, it is accepted; else the old one is kept, the refusal reported,
    and the new one tried again at the next sample. So recursive feasibility holds as before: a
    checked terminal set that the last plan reached (slack zero), and plans that start at the
    nominal state.

    The inputs of a problem, `inputs_given`, such as the target of a `TrackingOcp`, have ports of
    their own that are read at every sample; an unconnected one keeps its default. A contact between
    two samples is planned for at the next one: the knots of the plan, at which limits hold and by
    which it is continued, are the sampling instants.

    .. pydrake_system::

        name: NominalMpc
        input_ports:
        - state
        - fault (optional)
        - retreat (optional)
        - desired_force (optional, with targets)
        - target (optional, with a TrackingOcp)
        - safe_depth (optional, with a TrackingOcp)
        output_ports:
        - nominal_state
        - nominal_acceleration
        - nominal_input
        - plan
        - report
        - solve_seconds
        - accepted_force (with targets)

    - `state`: (𝔮, ζ) (2(6+n)) measured, in the paper's order; read at initialization only, unless
      each plan starts there.
    - `fault` (1): imposed outcome of the sample, `SOLVED` for none; read at every sample
      after the first.
    - `retreat`: mode and reference of a `Supervisor` (2 + 2(6+n)): after a trip plans rest at the
      measured place, and with it an exception of the planner is a failed sample, as without
      `raises`.
    - `nominal_state`: (𝔮̄, ζ̄) at the context's time (2(6+n)).
    - `nominal_acceleration`: ζ̄̇ (6+n).
    - `nominal_input`: ū = ζ̄̇ − f(𝔮̄, ζ̄) (6+n).
    - `plan`: current `Plan` (abstract).
    - `report`: see `MPC_REPORT`.
    - `solve_seconds`: time of the last step by the clock of `time_by` [s]; not reproducible.
    - `target` (3), `safe_depth` (one for each facet): `TrackingTarget` [m]; see
      `TrackingOcp` for the assumptions of feasibility.
    - `desired_force`, `accepted_force`: requested and accepted 𝔉_des (6) [N, N m].

    The state is one abstract `MpcMemory`. The problems of the latest desired forces, pure functions
    of the force, are cached outside of it. The computation takes no simulated time.

    Attributes:
        ocp: The problem.
        planner: Function from memory and sample to the memory after it.
        computer: Computer of plans `in_advance`, of which a late one times out; None: they are
            computed here.
        raises: Whether an exception of the planner is raised; else it is a failed sample, but for
            `RunFailed` without a supervisor.

    Args:
        solver: Solves the problem; its `ocp` is the problem.
        targets: Problems of other desired forces; None: the desired force is constant.
        committed: Number n of committed intervals.
        undriven: Indices in 𝔮 of coordinates that nothing drives, see `Planner`.
    """

    def __init__(self, solver: Solver, targets: planner.Targets | None = None,
                 committed: int = 0, undriven: Sequence[int] = ()):
        super().__init__()
        self.planner = planner.Planner(solver, targets, committed, undriven)
        self.computer: Computer | None = None
        self.raises = True
        self.ocp = solver.ocp
        size = self.ocp.model.size
        # State and inputs; those of the problem have its names.
        self._memory = self.DeclareAbstractState(Value(self.planner.initial))
        remembered = {self.abstract_state_ticket(self._memory)}
        self._state_port = self.DeclareVectorInputPort("state", self.ocp.state_size)
        self._fault_port = self.DeclareVectorInputPort("fault", 1)
        self._retreat_port = self.DeclareVectorInputPort("retreat", 2 + 2 * size)
        self._force_port = None
        if targets is not None:
            self._force_port = self.DeclareVectorInputPort("desired_force", 6)
            output_of(self, "accepted_force", 6, lambda c: self._recall(c).force, remembered)
        self._given_ports = {name: self.DeclareVectorInputPort(name, size)
                             for name, size in self.ocp.inputs_given.items()}
        # Events, and the nominal trajectory as a cache entry.
        self.DeclareInitializationUnrestrictedUpdateEvent(self._plan_first)
        self.DeclarePeriodicUnrestrictedUpdateEvent(self.ocp.time_step, 0.0, self._plan_again)
        nominal = cached(self, "the nominal trajectory now", self._evaluate_plan,
                         remembered | {self.time_ticket()})
        # Outputs of the plan at this instant, and of the last sample.
        now = {nominal.ticket()}
        output_of(self, "nominal_state", 2 * size,
                  lambda c: np.concatenate(nominal.Eval(c)[:2]), now)
        output_of(self, "nominal_acceleration", size, lambda c: nominal.Eval(c)[2], now)
        output_of(self, "nominal_input", size,
                  lambda c: self.ocp.nominal_input(nominal.Eval(c)), now)
        self.DeclareAbstractOutputPort(
            "plan", lambda: Value(object()), self._calc_plan, remembered)
        output_of(self, "report", len(planner.MPC_REPORT),
                  lambda c: self._recall(c).report, remembered)
        output_of(self, "solve_seconds", 1,
                  lambda c: [self._recall(c).solve_seconds], remembered)

    def time_by(self, clock: Callable[[], float]) -> None:
        """Sets the clock of `solve_seconds` and of the deadline [s], in place of wall time."""
        self.planner.clock = clock

    def _recall(self, context: Context) -> planner.MpcMemory:
        return context.get_abstract_state(int(self._memory)).get_value()

    def _plan_now(self, context: Context) -> Plan:
        plan = self._recall(context).plan
        if plan is None:
            raise RuntimeError("NominalMpc has no plan yet: call Simulator.Initialize() first")
        return plan

    def _plan_first(self, context: Context, state: State) -> EventStatus:
        if self._goes_on(self._recall(context), context.get_time()):
            return EventStatus.DidNothing()
        sample = self._sample(context)._replace(measured=self._state_port.Eval(context))
        return self._remember(state, self.planner.first(sample))

    def _goes_on(self, memory: planner.MpcMemory, now: float) -> bool:
        """Returns whether an initialized Context continues its plan, as a clone of a run does.

        The first plan is made again as long as its first instant has not passed: the measured state
        may have been changed since.
        """
        if memory.plan is None:
            return False
        elapsed = now - memory.report[0]  # Since the last sample, which may have kept the plan.
        latest = (1.0 + 1e-9) * self.ocp.time_step
        begun = now > memory.plan.start_time or memory.solves > 1 or memory.awaits
        return begun and -1e-9 <= elapsed <= latest

    def _plan_again(self, context: Context, state: State) -> EventStatus:
        plan = self._plan_now(context)
        if context.get_time() < plan.start_time + 0.5 * plan.time_step:
            return EventStatus.DidNothing()  # The first plan was made a moment ago.
        sample, memory = self._sample(context), self._recall(context)
        supervised = self._retreat_port.HasValue(context)
        if supervised and self._retreat_port.Eval(context)[0] > 0.0:
            return self._remember(state, self.planner.resting(
                sample, memory, self._state_port.Eval(context)))
        try:
            return self._step(state, sample, memory)
        except Exception as error:  # Whatever a planner raises, the last plan goes on.
            latest = self.ocp.hover + (0.999 + self.ocp.in_advance) * self.ocp.time_step
            first = memory.at_rest and context.get_time() < latest
            if (isinstance(error, RunFailed) and (first or not supervised)) or (
                    self.raises and not supervised):
                raise
            warn(sample.time, f"no plan: {type(error).__name__}: {error}")
            return self._remember(state, self.planner.pass_over(sample, memory, planner.FAILED))

    def _step(self, state: State, sample: planner.Sample, memory: planner.MpcMemory) -> EventStatus:
        """Makes a plan, or takes the one that was computed in advance and begins the next one."""
        if not self.ocp.in_advance:
            return self._remember(state, self.planner.again(sample, memory))
        if self.computer is not None:
            memory = replace(memory, coming=self.computer.result())
        memory = self.planner.taken(sample, memory)
        between = self.planner.between(sample, memory)
        if self.computer is not None:
            self.computer.start(sample, memory)
        else:
            between = replace(between, coming=self.planner.again(sample, memory))
        return self._remember(state, between)

    def _sample(self, context: Context) -> planner.Sample:
        """Returns the inputs now, a measured state only if plans start there."""
        def read(port: InputPort) -> np.ndarray | None:
            return port.Eval(context).copy() if port.HasValue(context) else None

        started = self.planner.clock()
        given = {name: port.Eval(context) for name, port in self._given_ports.items()
                 if port.HasValue(context)}
        fault = read(self._fault_port)
        return planner.Sample(
            context.get_time(), started, given,
            measured=self._state_port.Eval(context) if self.ocp.starts_at_measured else None,
            asked=None if self._force_port is None else read(self._force_port),
            fault=planner.SOLVED if fault is None else int(fault[0]))

    def _remember(self, state: State, memory: planner.MpcMemory) -> EventStatus:
        state.get_mutable_abstract_state(int(self._memory)).set_value(memory)
        return EventStatus.Succeeded()

    def _evaluate_plan(self, context: Context) -> tuple[np.ndarray, ...]:
        last_sample = float(self._recall(context).report[0])
        return self._plan_now(context).at(context.get_time(), last_sample)

    def _calc_plan(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self._plan_now(context))
