"""The nominal MPC as a system: plans at the sampling instants, evaluates the plan in between."""

import time
from dataclasses import replace

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiagramBuilder,
    EventStatus,
    InputPort,
    LeafSystem,
    OutputPort,
    State,
    ValueProducer,
)

from uvms_drake.common.wiring import added
from uvms_drake.control.mpc.planner import (
    MPC_REPORT,
    SOLVED,
    MpcMemory,
    Planner,
    Sample,
    Targets,
)
from uvms_drake.control.ocp.scp import SequentialConvexSolver
from uvms_drake.control.plan.plan import Plan


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

    A problem with a time to `hover` is not solved before that: until then the plan is to stay where
    the robot was measured at the initialization, for observers to settle, and nothing fails but the
    first plan after it: `RunFailed`, too.

    The first n intervals of a plan may be committed: each plan then has those of the last one, and
    the first one coasts there, which a robot at rest calls hovering; see `commitment`.

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
        - turn (optional, with a TrackingOcp that may turn)
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
    - `target` (3), `safe_depth` (one for each facet), `turn` (1): the `TrackingTarget` [m, rad]; see
      `TrackingOcp` for when every problem is feasible.
    - `desired_force`, `accepted_force`: 𝔉_des as asked for and as planned for (6) [N, N m].

    The state is one abstract `MpcMemory`. Beside it the system remembers the problems of the latest
    desired forces, each a pure function of its force. The computation takes no simulated time.

    Args:
        solver: Solves the problem; its `ocp` is the problem.
        targets: Makes the problem of another desired force; None if it stays as it is.
        committed: n; zero for a `KinematicOcp`.
    """

    def __init__(self, solver: SequentialConvexSolver, targets: Targets | None = None,
                 committed: int = 0):
        super().__init__()
        self._planner = Planner(solver, targets, committed)
        self._ocp = solver.ocp
        size = self._ocp.model.size
        # State and inputs.
        self._memory = self.DeclareAbstractState(Value(self._planner.initial))
        self._state_port = self.DeclareVectorInputPort("state", self._ocp.state_size)
        self._fault_port = self.DeclareVectorInputPort("fault", 1)
        self._force_port = None
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
        if self._goes_on(self._recall(context), context.get_time()):
            return EventStatus.DidNothing()
        sample = self._sample(context)._replace(measured=self._state_port.Eval(context))
        return self._remember(state, self._planner.first(sample), sample.started)

    def _goes_on(self, memory: MpcMemory, now: float) -> bool:
        """Returns whether an initialized Context goes on with its plan, as a clone of a run does.

        The first plan is made anew as long as its first instant has not passed: the measured state
        may have been changed since.
        """
        if memory.plan is None:
            return False
        elapsed = now - memory.report[0]  # Since the last sample; it may have left the plan as is.
        latest = (1.0 + 1e-9) * self._ocp.time_step
        begun = now > memory.plan.start_time or memory.solves > 1
        return begun and -1e-9 <= elapsed <= latest

    def _plan_again(self, context: Context, state: State) -> EventStatus:
        plan = self._plan_now(context)
        if context.get_time() < plan.start_time + 0.5 * plan.time_step:
            return EventStatus.DidNothing()  # The first plan was made a moment ago.
        sample = self._sample(context)
        return self._remember(
            state, self._planner.again(sample, self._recall(context)), sample.started)

    def _sample(self, context: Context) -> Sample:
        """Returns what there is now, a measured state only if plans start there."""
        def read(port: InputPort) -> np.ndarray | None:
            return port.Eval(context).copy() if port.HasValue(context) else None

        started = time.perf_counter()
        given = {name: port.Eval(context) for name, port in self._given_ports.items()
                 if port.HasValue(context)}
        fault = read(self._fault_port)
        return Sample(
            context.get_time(), started, given,
            measured=self._state_port.Eval(context) if self._ocp.starts_at_measured else None,
            asked=None if self._force_port is None else read(self._force_port),
            fault=SOLVED if fault is None else int(fault[0]))

    def _remember(self, state: State, memory: MpcMemory, started: float) -> EventStatus:
        state.get_mutable_abstract_state(int(self._memory)).set_value(replace(
            memory, solve_seconds=time.perf_counter() - started))
        return EventStatus.Succeeded()

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
                     committed: int = 0, name: str = "nominal_mpc") -> "NominalMpc":
        """Adds the planner; `state` gives (𝔮, ζ) or 𝔮 and is left to the caller if None."""
        return added(builder, name, NominalMpc(solver, targets, committed), state=state)
