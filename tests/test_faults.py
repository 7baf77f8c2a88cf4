"""What happens when a part fails: declared here, injected between the ports, and checked.

========================================  ==========================================================
fault                                     declared behaviour
========================================  ==========================================================
a solve fails or times out, at random     The last plan, continued by the terminal controller, takes
samples or for seconds on end             its place. Inside the theory: no exit. `mpc_status` is 1
                                          at the samples where it happened.
the first solve fails                     There is no plan to fall back to: one line, at t = 0.
a control period is dropped               The last plan goes on by itself. Inside the theory: no
                                          exit, and the next plan starts where it is then.
the measured state is not a number        The run ends with one line that says when: no command is
                                          computed from it, nothing is logged as if it was one.
the measured state is frozen for 0.5 s    Outside: the monitor notes an exit, with its time. Finite;
                                          back in the tube when the fault is over.
‖d‖ = 1.5, 2, 5 times d̃                   Outside: ‖d‖ > d̃ is noted at the sample at which it is
                                          first. The tube is proportional to d̃, so the deviation
                                          stays within as many times the trajectory-wise bound.
a wall 10 times as stiff as modelled      Outside: an exit is noted when contact is made. Finite.
a joint is stuck                          Outside: an exit is noted after it sticks. Finite.
========================================  ==========================================================

The monitor, the logs and the adversary see the true state. Nothing ends in a traceback, and no
number in a log is not finite.
"""

import logging
from dataclasses import replace

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder, LeafSystem

from uvms_drake import station
from uvms_drake.alarm import LOGGER
from uvms_drake.cli import main
from uvms_drake.control import scp
from uvms_drake.control.nominal_mpc import NominalMpc
from uvms_drake.control.tube_monitor import FIELDS, REPORT_FIELDS
from uvms_drake.control.tube_mpc import make_tube_mpc
from uvms_drake.errors import RunFailed
from uvms_drake.events import events
from uvms_drake.plant.uvms_plant import make_uvms_plant
from uvms_drake.scenario import load_scenario
from uvms_drake.simulation import simulate

CLOSE = "start.eta=[-1.13, -0.05, -0.05, 0.02, 0.02, 0.05]"
"""The tip starts 4 cm off the wall and touches it within a second."""
PERIOD = 0.02
"""Of the log and of the monitor [s]."""


class SensorFault(LeafSystem):
    """Passes a vector on, but from `start` to `end` [s] something else: NaN, or what it was."""

    def __init__(self, size: int, start: float, end: float, nan: bool):
        super().__init__()
        self._start, self._end, self._nan = start, end, nan
        self._port = self.DeclareVectorInputPort("true", size)
        self._held = self.DeclareDiscreteState(size)
        self.DeclarePeriodicDiscreteUpdateEvent(1e9, start, self._hold)
        self.DeclareVectorOutputPort("measured", size, self._calc)

    def _hold(self, context, state):
        state.set_value(self._port.Eval(context))

    def _calc(self, context, output):
        if not self._start < context.get_time() < self._end:
            output.SetFromVector(self._port.Eval(context))
        elif self._nan:
            output.SetFromVector(np.full(output.size(), np.nan))
        else:
            output.SetFromVector(context.get_discrete_state(self._held).value())


class StuckJoint(LeafSystem):
    """Replaces the torque of a joint, from `start` on, by a brake that holds it where it was."""

    def __init__(self, model, joint: int, start: float):
        super().__init__()
        self._model, self._row, self._start = model, 6 + joint, start
        self._tau_port = self.DeclareVectorInputPort("commanded", model.size)
        self._state_port = self.DeclareVectorInputPort("state", 2 * model.size)
        self.DeclareDiscreteState(1)
        self.DeclarePeriodicDiscreteUpdateEvent(1e9, start, self._hold)
        self.DeclareVectorOutputPort("tau", model.size, self._calc)

    def _hold(self, context, state):
        state.set_value(self._state_port.Eval(context)[[self._row]])

    def _calc(self, context, output):
        tau = self._tau_port.Eval(context).copy()
        if context.get_time() > self._start:
            config, zeta = np.split(self._state_port.Eval(context), 2)
            inertia = self._model.mass_matrix(self._model.kinematics(config))[self._row, self._row]
            stretch = config[self._row] - context.get_discrete_state_vector().value()[0]
            tau[self._row] = -inertia * (400.0 * stretch + 40.0 * zeta[self._row])
        output.SetFromVector(tau)


def with_faults(sensor=None, actuator=None):
    """Returns `make_tube_mpc` with systems in front of and behind the controller.

    Args:
        sensor: Makes a system from true to measured state, of the size of the state.
        actuator: Makes a system from commanded τ and true state to τ, of the model.
    """
    def make(ocp, ancillary, targets=None):
        builder = DiagramBuilder()
        controller = builder.AddNamedSystem("controller", make_tube_mpc(ocp, ancillary, targets))
        to_state = [controller.GetInputPort("state")]
        tau = controller.GetOutputPort("tau")
        if sensor is not None:
            fault = builder.AddSystem(sensor(2 * ocp.model.size))
            builder.Connect(fault.get_output_port(), to_state.pop())
            to_state.append(fault.get_input_port())
        if actuator is not None:
            brake = builder.AddSystem(actuator(ocp.model))
            builder.Connect(tau, brake.GetInputPort("commanded"))
            to_state.append(brake.GetInputPort("state"))
            tau = brake.get_output_port()
        index = builder.ExportInput(to_state[0], "state")
        for port in to_state[1:]:
            builder.ConnectInput(index, port)
        builder.ExportInput(controller.GetInputPort("desired_force"), "desired_force")
        builder.ExportOutput(tau, "tau")
        for name in ("u", "nominal_state", "nominal_input", "plan", "report", "solve_seconds",
                     "accepted_force"):
            builder.ExportOutput(controller.GetOutputPort(name), name)
        diagram = builder.Build()
        diagram.set_name("tube_mpc")
        return diagram

    return make


def scenario_of(duration: float, *overrides: str):
    return load_scenario("girona500_contact", [
        f"duration={duration}", f"log_period={PERIOD}", CLOSE, *overrides])


def run(scenario):
    """Returns the record and the monitor's report of a run; every number in the logs is finite."""
    record = simulate(scenario)
    for name in ("state", "nominal_state", "u", "tau", "force", "tube_deviation", "tube_bound",
                 "disturbance", "mpc_cost", "mpc_status"):
        assert np.all(np.isfinite(getattr(record, name))), name
    return record, dict(zip(REPORT_FIELDS, record.tube_report, strict=True))


@pytest.fixture
def said(caplog):
    """Returns what has been said of a run while it went on."""
    caplog.set_level(logging.WARNING, LOGGER.name)
    return lambda: caplog.messages


def ends_at_the_task(record) -> bool:
    error = record.force[-1] - np.asarray(record.scenario.task.force)
    return bool(np.linalg.norm(error) < record.scenario.task.force_tolerance)


@pytest.fixture
def failing(monkeypatch):
    """Lets the convex solver fail at the calls, after the first plan's, that a function picks."""
    def install(fails):
        solve, first = scp.SequentialConvexSolver.solve, [True]
        calls = [0]

        def wrapped(self, guess, iterations, tolerance=1e-6):
            if first[0]:
                first[0] = False
                return solve(self, guess, iterations, tolerance)
            calls[0] += 1
            if fails(calls[0]):
                with monkeypatch.context() as patch:
                    patch.setattr(scp, "solve_staged", lambda program: None)
                    return solve(self, guess, iterations, tolerance)
            return solve(self, guess, iterations, tolerance)

        monkeypatch.setattr(scp.SequentialConvexSolver, "solve", wrapped)

    return install


@pytest.mark.parametrize("which", ["at random", "for 2 s", "for ever"])
def test_a_failed_solve_keeps_the_tube_and_is_in_the_log(failing, said, which):
    random = np.random.default_rng(4).uniform(size=100) < 0.4
    fails = {"at random": lambda call: bool(random[call]), "for 2 s": lambda call: 3 <= call < 13,
             "for ever": lambda call: True}[which]
    failing(fails)
    record, report = run(scenario_of(4.0))
    # The first sample is the first plan's.
    expected = [False, *(fails(call) for call in range(1, len(record.mpc_status)))]
    np.testing.assert_array_equal(record.mpc_status, expected)
    assert np.count_nonzero(record.mpc_status) > 4
    failures = [event for event in events(record) if event.kind == "solver_failed"]
    assert said() == [f"t = {event.start:g} s: the solver failed" for event in failures]
    if which != "at random":
        assert len(failures) == 1
    assert (failures[-1].end is None) == bool(record.mpc_status[-1])
    assert report["set_exits"] == report["trajectory_exits"] == 0.0
    assert ends_at_the_task(record)


def test_without_a_first_plan_it_is_one_line(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(scp, "solve_staged", lambda program: None)
    output = tmp_path / "out"
    assert main(["run", "--uncertified", "--duration", "0.1", "--output", str(output)]) == 1
    err = capsys.readouterr().err
    assert "no solution at the start" in err
    assert "Traceback" not in err
    assert not output.exists()


@pytest.mark.parametrize("dropped", [{5}, {5, 6, 7}])
def test_a_dropped_control_period_keeps_the_tube(monkeypatch, dropped):
    plan_again, starts = NominalMpc._plan_again, []

    def wrapped(self, context, state):
        if round(context.get_time() / 0.2) not in dropped:
            plan_again(self, context, state)
        plan = state.get_abstract_state(0).get_value().plan
        starts.append((context.get_time(), plan.start_time))

    monkeypatch.setattr(NominalMpc, "_plan_again", wrapped)
    record, report = run(scenario_of(4.0))
    assert report["set_exits"] == report["trajectory_exits"] == 0.0
    late = {round(now / 0.2) for now, planned in starts if planned < now - 0.1}
    assert late == dropped
    assert ends_at_the_task(record)


@pytest.mark.parametrize("start", [-1.0, 0.731])
def test_a_measurement_that_is_not_a_number_ends_the_run_with_one_line(
        monkeypatch, tmp_path, capsys, start):
    monkeypatch.setattr(station, "make_tube_mpc", with_faults(
        lambda size: SensorFault(size, start, start + 10.0, nan=True)))
    if start > 0.0:
        with pytest.raises(RunFailed, match=r"measured state is not finite at t = 0\.7[34]"):
            simulate(scenario_of(1.0))
    output = tmp_path / "out"
    assert main(["run", "--uncertified", "--duration", "1", "--output", str(output)]) == 1
    err = capsys.readouterr().err
    assert sum("error: " in line for line in err.splitlines()) == 1
    assert "not finite" in err
    assert "Traceback" not in err
    assert not output.exists()


def test_a_frozen_measurement_is_noted_and_overcome(monkeypatch, said):
    start = 0.5
    monkeypatch.setattr(station, "make_tube_mpc", with_faults(
        lambda size: SensorFault(size, start, start + 0.5, nan=False)))
    record, report = run(scenario_of(4.0))
    assert start < report["set_first_exit"] < start + 0.5
    left = next(event for event in events(record) if event.kind == "tube_left")
    assert left.start == report["set_first_exit"]
    assert left.end is not None
    assert f"t = {left.start:g} s: left the tube (set-wise)" in said()
    deviation = record.deviation_of("position")
    assert np.max(deviation) > 3.0 * record.scenario.tube.position
    assert np.all(deviation[record.time > start + 2.0] < record.scenario.tube.position)
    assert ends_at_the_task(record)


@pytest.mark.parametrize("factor", [1.5, 2.0, 5.0])
def test_a_disturbance_above_its_bound_is_noted_and_takes_the_tube_along(monkeypatch, factor):
    def plant(*, disturbance, **others):
        return make_uvms_plant(
            disturbance=replace(disturbance, bound=factor * disturbance.bound), **others)

    monkeypatch.setattr(station, "make_uvms_plant", plant)
    record, report = run(scenario_of(3.0))
    above = np.linalg.norm(record.disturbance, axis=1) > 1.01 * record.scenario.disturbance.bound
    assert report["disturbance_exits"] >= 1.0
    assert report["disturbance_first_exit"] == pytest.approx(
        record.time[np.argmax(above)], abs=PERIOD)
    exceeded = next(event for event in events(record) if event.kind == "disturbance_exceeded")
    assert exceeded.start == report["disturbance_first_exit"]
    assert report["worst_disturbance"] == pytest.approx(factor, rel=0.01)
    ratios = [report[f"worst_trajectory_{field}"] for field in FIELDS[:4]]
    assert 0.5 * factor < max(ratios) < 1.02 * factor
    if factor == 5.0:
        assert report["set_first_exit"] < np.inf


def test_a_wall_that_is_stiffer_than_modelled_is_noted(monkeypatch):
    def plant(*, surface, **others):
        return make_uvms_plant(
            surface=replace(surface, stiffness=10.0 * surface.stiffness), **others)

    monkeypatch.setattr(station, "make_uvms_plant", plant)
    record, report = run(scenario_of(4.0))
    contact = record.time[np.argmax(record.penetration > 0.0)]
    assert contact > 0.2
    assert contact <= report["set_first_exit"] < contact + 0.5
    assert np.max(record.force[:, 0]) < 400.0
    assert np.ptp(record.force[record.time > 3.0, 0]) < 20.0  # It has come to rest.


@pytest.mark.parametrize("joint", [0, 2])
def test_a_stuck_joint_is_noted(monkeypatch, joint):
    start = 0.4
    monkeypatch.setattr(station, "make_tube_mpc", with_faults(
        actuator=lambda model: StuckJoint(model, joint, start)))
    record, report = run(scenario_of(4.0))
    q = record.state[:, 6 + joint]
    assert np.ptp(q[record.time > start + 0.5]) < 0.02
    assert start < report["set_first_exit"] < np.inf
    assert np.max(np.abs(record.state)) < 10.0
