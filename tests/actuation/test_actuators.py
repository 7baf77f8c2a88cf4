"""Thrusters, a brake and the loop of a computer: each system alone, and the part."""

from copy import copy
from dataclasses import replace

import numpy as np
import pytest
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, PassThrough
from support.thrusters import eight_thrusters

import uvms_drake as uv
from uvms_drake.actuation.ideal import SampledCommand
from uvms_drake.actuation.joint_brake import StuckJoint, braked
from uvms_drake.actuation.thruster_systems import ThrusterAllocation, ThrusterDynamics
from uvms_drake.actuation.thrusters import Thrusters, largest_error, with_errors
from uvms_drake.common.schema import check_values
from uvms_drake.model.propulsion.allocation import Allocation
from uvms_drake.model.propulsion.thrusters import ThrusterModel
from uvms_drake.model.signals.sensor_actuator import VEHICLE_WRENCH, Signals
from uvms_drake.plant.disturbance import ConstantDisturbance
from uvms_drake.station.controller import make_tube
from uvms_drake.station.plant import make_simulated_uvms

TAU = np.array([12.0, -9.0, 7.0, 2.0, 4.0, -3.0, 1.0, 2.0, 3.0, 4.0])


PRESSED = np.array([-8.0, 3.0, 1.0, 0.0, 0.0, 0.0])  # N
AT = np.array([0.1, -0.2, 0.3, 0.1, -0.05, 0.4, 0.2, 0.9, 0.3, -0.1])


def hovering(model):
    """Returns τ that holds the robot at `AT`, pressed, by its drift."""
    M = model.mass_matrix(model.kinematics(AT))
    return -M @ model.drift(AT, np.zeros(10), PRESSED)


class Bench:
    """A part between a constant or free τ and what it makes of it, at `AT`, pressed."""

    def __init__(self, model, part, tau=TAU):
        check_values(part)
        builder, self.signals = DiagramBuilder(), Signals()
        for name, value in (("state", np.append(AT, np.zeros(10))), ("force", PRESSED)):
            self.signals[name] = builder.AddSystem(ConstantVectorSource(value)).get_output_port()
        free = tau is None
        source = builder.AddSystem(PassThrough(10) if free else ConstantVectorSource(tau))
        if free:
            builder.ExportInput(source.get_input_port(), "tau")
        out = part.add_to(builder, model, source.get_output_port(), self.signals, seed=0)
        for name, port in (*self.signals.items(), ("exerted", out)):
            builder.ExportOutput(port, name)
        self.diagram = builder.Build()

    def simulator(self, context=None):
        simulator = Simulator(self.diagram, context)
        integrator = simulator.get_mutable_integrator()
        integrator.set_maximum_step_size(0.005)
        integrator.set_fixed_step_mode(True)
        simulator.Initialize()
        return simulator

    def at(self, context, name):
        return self.diagram.GetOutputPort(name).Eval(context)


def with_thrusters(model, parameters):
    """Returns the model with other thrusters."""
    model = copy(model)
    model.thrusters = parameters
    return model


@pytest.fixture(scope="module")
def other(model):
    return with_thrusters(model, eight_thrusters(bias=3.0))


def test_a_force_follows_its_command_after_the_dead_time_with_the_lag(model):
    """f(t) = f∞ + (f₀ − f∞) exp(−(t − θ)/T); f₀ hovers, f∞ gives the command from t = 0."""
    bench = Bench(model, Thrusters(lag=0.12, dead_time=0.05))
    allocation = Allocation.to(ThrusterModel.of(model.thrusters))
    before, after = (allocation.forces(tau[:6]) for tau in (hovering(model), TAU))
    assert np.min(np.abs(before - after)) > 0.5
    simulator = bench.simulator()
    for time in (0.0, 0.04, 0.05, 0.08, 0.2, 0.5):
        simulator.AdvanceTo(time)
        left = np.exp(-max(time - 0.05, 0.0) / 0.12)
        np.testing.assert_allclose(
            bench.at(simulator.get_context(), "thruster_force"), after + (before - after) * left,
            atol=1e-4)


def test_at_the_start_the_thrusters_hold_the_robot_but_for_roll(model, other):
    for robot, driven in ((model, [0, 1, 2, 4, 5]), (other, range(6))):
        bench = Bench(robot, Thrusters())
        wrench = bench.at(bench.simulator().get_context(), VEHICLE_WRENCH)
        np.testing.assert_allclose(wrench[driven], hovering(model)[:6][driven], atol=1e-9)


def test_torques_pass_at_once_and_the_wrench_arrives_but_for_roll(model):
    bench = Bench(model, Thrusters())
    simulator = bench.simulator()
    np.testing.assert_array_equal(bench.at(simulator.get_context(), "exerted")[6:], TAU[6:])
    simulator.AdvanceTo(3.5)
    context = simulator.get_context()
    short = bench.at(context, "wrench_shortfall")
    np.testing.assert_allclose(bench.at(context, "exerted")[:6], TAU[:6] - short, atol=1e-6)
    np.testing.assert_allclose(short[[0, 1, 2, 4, 5]], 0.0, atol=1e-9)
    assert abs(short[3]) > 1.0
    np.testing.assert_array_equal(
        bench.at(context, VEHICLE_WRENCH), bench.at(context, "exerted")[:6])


@pytest.mark.parametrize(("part", "off"), [
    (Thrusters(error=np.array([0.1])), lambda file: ThrusterModel.of(file).off_by(0.1)),
    (Thrusters(error=np.linspace(-0.3, 0.3, 8)),
     lambda file: ThrusterModel.of(file).off_by(np.linspace(-0.3, 0.3, 8)))])
def test_model_errors_are_in_the_forces_only(other, part, off):
    bench = Bench(other, part)
    simulator = bench.simulator()
    simulator.AdvanceTo(3.0)
    context, file = simulator.get_context(), other.thrusters
    forces = off(file).forces_of(bench.at(context, "thruster_command"))
    np.testing.assert_allclose(bench.at(context, "thruster_force"), forces, atol=1e-6)
    np.testing.assert_allclose(
        bench.at(context, "exerted")[:6], ThrusterModel.of(file).B @ forces, atol=1e-6)
    np.testing.assert_allclose(bench.at(context, VEHICLE_WRENCH), TAU[:6], atol=1e-6)
    assert np.max(np.abs(bench.at(context, "exerted")[:6] - TAU[:6])) > 0.3


def test_parts_of_the_errors_are_those_of_thrusters_alone(model):
    clock, thrusters = SampledCommand(), Thrusters(error=np.array([0.1]))
    shares = np.linspace(-1.0, 1.0, 5)
    same, changed = with_errors([clock, thrusters], model, lambda count: shares[:count])
    assert same is clock
    np.testing.assert_allclose(changed.error, 0.1 * shares)
    assert largest_error([clock, Thrusters(error=np.array([0.1, -0.3]))]) == 0.3
    assert largest_error([clock]) == largest_error([clock, Thrusters()]) == 0.0
    whole = Thrusters()
    assert with_errors([clock, whole], model, pytest.fail) == [clock, whole]  # Nothing is drawn.


def test_a_cloned_context_goes_on_with_the_delayed_commands(model):
    """After a step of the command, within the dead time."""
    bench = Bench(model, Thrusters(dead_time=0.05), tau=None)
    context = bench.diagram.CreateDefaultContext()
    port = bench.diagram.GetInputPort("tau")
    port.FixValue(context, TAU)
    simulator = bench.simulator(context)
    simulator.AdvanceTo(0.1)
    port.FixValue(simulator.get_mutable_context(), -TAU)
    simulator.AdvanceTo(0.12)
    again = bench.simulator(simulator.get_context().Clone())
    for each in (simulator, again):
        each.AdvanceTo(0.3)
    first, second = (bench.at(each.get_context(), "exerted") for each in (simulator, again))
    np.testing.assert_array_equal(first, second)
    assert first[0] < 0.0


def test_they_begin_anew_with_what_they_hover_with_until_time_goes_on(other):
    """A state that is set between two initializations is that of the start."""
    known = ThrusterModel.of(other.thrusters)
    builder = DiagramBuilder()
    command = builder.AddSystem(ConstantVectorSource(known.commands_of(np.full(8, 4.0))))
    system = builder.AddSystem(ThrusterDynamics(known, 0.01, 2))
    builder.Connect(command.get_output_port(), system.GetInputPort("command"))
    builder.ExportInput(system.GetInputPort("hover"), "hover")
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = simulator.get_context()
    for hover, end, expected in ((-5.0, 0.0, -5.0), (2.0, 0.015, 2.0), (-5.0, 0.0, 2.0)):
        diagram.GetInputPort("hover").FixValue(
            simulator.get_mutable_context(), known.commands_of(np.full(8, hover)))
        simulator.Initialize()
        np.testing.assert_allclose(system.get_output_port().Eval(
            system.GetMyContextFromRoot(context)), expected, rtol=1e-6)
        if end > 0.0:
            simulator.AdvanceTo(end)


def test_the_allocation_alone_commands_what_gives_the_wrench(other):
    builder = DiagramBuilder()
    tau, state, force = (builder.AddSystem(ConstantVectorSource(value)).get_output_port()
                         for value in (TAU, np.append(AT, np.ones(10)), PRESSED))
    thrusters = ThrusterModel.of(other.thrusters)
    system = ThrusterAllocation.AddToBuilder(
        builder, other, Allocation.to(thrusters), name="allocation", tau=tau, state=state,
        force=force)
    context = system.GetMyContextFromRoot(builder.Build().CreateDefaultContext())
    for name, wrench in (("command", TAU[:6]), ("hover", hovering(other)[:6])):
        command = system.GetOutputPort(name).Eval(context)
        np.testing.assert_allclose(
            thrusters.B @ thrusters.forces_of(command), wrench, atol=1e-9)
    np.testing.assert_allclose(system.GetOutputPort("shortfall").Eval(context), 0.0, atol=1e-9)


class Brake:
    """A brake on the third joint from 0.5 s on, of a robot whose state is put in."""

    def __init__(self, model, state):
        builder, signals = DiagramBuilder(), Signals()
        self.true = builder.AddSystem(ConstantVectorSource(state))
        signals["state"] = self.true.get_output_port()
        commanded = builder.AddSystem(ConstantVectorSource(TAU)).get_output_port()
        builder.ExportOutput(StuckJoint(2, 0.5).add_to(builder, model, commanded, signals, 0))
        self.diagram = builder.Build()

    def tau(self, context):
        return self.diagram.get_output_port().Eval(context)

    def move(self, context, state):
        self.true.get_mutable_source_value(
            self.true.GetMyMutableContextFromRoot(context)).set_value(state)


def test_a_brake_is_critically_damped(model, states):
    """Both eigenvalues of q̈ = torque / inertia."""
    held, rows = np.append(states["free"][0][:10], np.zeros(10)), []
    inertia = model.mass_matrix(model.kinematics(held[:10]))[8, 8]
    for change in (8, 18):
        now = held.copy()
        now[change] += 1e-4
        rows.append(braked(model, 2, np.zeros(10), held, now)[8] / inertia / 1e-4)
    np.testing.assert_allclose(
        np.linalg.eigvals([[0.0, 1.0], rows]), [-20.0, -20.0], atol=0.2)


@pytest.mark.parametrize("begins", [0.0, 3.0])
def test_a_stuck_joint_gets_the_brakes_torque_and_the_others_the_commanded_one(
        model, states, begins):
    """It is held where it is at the start, or where a simulation begins later; in a clone, too."""
    state = states["free"][0].copy()
    bench = Brake(model, state)
    context = bench.diagram.CreateDefaultContext()
    context.SetTime(begins)
    simulator = Simulator(bench.diagram, context)
    simulator.Initialize()
    if begins == 0.0:
        simulator.AdvanceTo(0.4)
        np.testing.assert_array_equal(bench.tau(context), TAU)
        simulator.AdvanceTo(0.6)
    moved = state.copy()
    moved[8] += 0.01
    bench.move(context, moved)
    again = Simulator(bench.diagram, context.Clone())
    again.Initialize()
    expected = braked(model, 2, TAU, state, moved)
    assert expected[8] != TAU[8]
    np.testing.assert_array_equal(np.delete(expected, 8), np.delete(TAU, 8))
    for each in (context, again.get_context()):
        np.testing.assert_allclose(bench.tau(each), expected, rtol=1e-9)


def test_a_joint_that_the_arm_has_not_cannot_be_stuck(model):
    with pytest.raises(uv.InvalidParameter, match=r"^joint = 4: must be an index from 0 to 3$"):
        StuckJoint(joint=4).add_to(DiagramBuilder(), model, None, Signals(), 0)


PERIOD, DELAY = 1.0 / 64.0, 1.0 / 128.0
"""Sums of them are exact, so that events that are meant to be of one instant are."""
CLOSE = "start.eta=[-1.105, -0.05, -0.05, 0.02, 0.02, 0.05]"
STEP = "simulator.max_step_size=0.005"


def scenario_of(duration: float, *overrides: str, part=None):
    scenario = uv.load_scenario("girona500_ideal", [f"duration={duration}", CLOSE, STEP,
                                                 *overrides])
    return replace(scenario, actuation=[part or SampledCommand(PERIOD, DELAY)],
                   disturbance=ConstantDisturbance(0.05))


def by_hand(scenario, steps: int) -> list[np.ndarray]:
    """Returns the states at the ticks of a loop in Python around plant and controller."""
    model = uv.load_model(scenario)
    ocp = uv.make_ocp(scenario, model)
    uvms = make_simulated_uvms(scenario, scenario.disturbance, scenario.start.config)
    robot = Simulator(uvms)
    ApplySimulatorConfig(scenario.simulator, robot)
    controller = Simulator(make_tube(scenario, model, ocp))

    def state():
        return uvms.GetOutputPort("state").Eval(robot.get_context()).copy()

    def command(now):
        system, context = controller.get_system(), controller.get_mutable_context()
        system.GetInputPort("state").FixValue(context, state())
        controller.AdvanceTo(now)
        controller.AdvancePendingEvents()
        return system.GetOutputPort("tau").Eval(context).copy()

    def apply(tau):
        uvms.GetInputPort("tau").FixValue(robot.get_mutable_context(), tau)

    states = []
    for k in range(steps):
        states.append(state())
        tau = command(k * PERIOD)
        if k == 0:
            apply(tau)
        robot.AdvanceTo(k * PERIOD + DELAY)
        apply(tau)
        robot.AdvanceTo((k + 1) * PERIOD)
    return states


def test_the_loop_is_that_of_a_computer_bit_for_bit():
    """Over two plans that the MPC makes anew, and into the wall."""
    scenario = scenario_of(0.625, "mpc.time_step=0.25", f"log_period={PERIOD}")
    record = uv.simulate(scenario)
    np.testing.assert_array_equal(record.state[:-1], by_hand(scenario, 40))
    assert record.force[-1, 0] > 0.0


def test_the_law_runs_once_a_period_and_its_command_stays(monkeypatch):
    asked, command = [], uv.Resolved.command

    def counted(self, *args):
        asked.append(1)
        return command(self, *args)

    monkeypatch.setattr(uv.Resolved, "command", counted)
    record = uv.simulate(scenario_of(0.4, "log_period=0.01", part=SampledCommand(0.02, 0.012)))
    # Every 10 ms, for the log and for the tick, and at 0.2 s again, after a plan is made.
    assert len(asked) == 41 + 1
    sampled, tau = record.signals["zoh_command"], record.tau
    np.testing.assert_array_equal(sampled[0], tau[0])
    for k in range(1, 20):  # A log is made before the events of its instant.
        np.testing.assert_array_equal(sampled[2 * k], sampled[2 * k + 1])
        if k % 10:  # At 0.2 s the plan is made anew after the log.
            np.testing.assert_array_equal(sampled[2 * k + 2], tau[2 * k])
    assert np.all(np.any(np.diff(sampled[2::2], axis=0) != 0.0, axis=1))
    # The effect of the hold is no disturbance.
    np.testing.assert_allclose(record.effective_disturbance, record.disturbance, atol=1e-9)
