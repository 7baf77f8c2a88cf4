"""Tests of `control.feedback.disturbance_observer`, of a robot that hovers, without an MPC."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import (
    ConstantVectorSource,
    Demultiplexer,
    FirstOrderLowPassFilter,
    Multiplexer,
)

import uvms_drake as uv
from uvms_drake.control.feedback.ancillary import AncillaryFeedback
from uvms_drake.control.feedback.disturbance_observer import add_observer, estimate
from uvms_drake.control.laws.law import pair_of
from uvms_drake.control.laws.tip_first import BlockGains
from uvms_drake.model.signals.sensor_actuator import VEHICLE_WRENCH
from uvms_drake.sensing.faults import FrozenState, LostState
from uvms_drake.sensing.navigation import Drift

CONFIG = np.array([-1.4, 0.0, 0.0, 0.0, 0.0, 0.0, 0.1, 1.0, 0.4, 0.2])
"""Away from any wall."""


@dataclass
class Lag(uv.Part):
    """Thrusters with a lag, at first in equilibrium; joints without one."""

    time: float = 0.15

    def add_to(self, builder, model, port, signals, seed):
        n = model.num_joints
        parts, lag, both = (builder.AddNamedSystem(name, system) for name, system in (
            ("parts", Demultiplexer([6, n])), ("lag", FirstOrderLowPassFilter(self.time, 6)),
            ("both", Multiplexer([6, n]))))
        builder.Connect(port, parts.get_input_port())
        builder.Connect(parts.get_output_port(0), lag.get_input_port())
        builder.Connect(lag.get_output_port(), both.get_input_port(0))
        builder.Connect(parts.get_output_port(1), both.get_input_port(1))
        signals[VEHICLE_WRENCH] = lag.get_output_port()
        return both.get_output_port()


class Hovering:
    """A simulation of it, and its readings."""

    def __init__(self, model, law, *, bound=0.0, disturbance=None, limits=None, sensing=(),
                 actuation=(), step=0.02):
        builder, self.signals = DiagramBuilder(), {}
        plant = builder.AddNamedSystem("uvms", uv.make_uvms_plant(
            "girona500_arm5e", surface=None,
            disturbance=disturbance or uv.disturbances.ConstantDisturbance(bound=bound)))
        feedback = builder.AddNamedSystem("feedback", AncillaryFeedback(model, law, limits))
        self.nominal = np.concatenate([CONFIG, np.zeros(10)])
        for name, value in (("nominal_state", self.nominal), ("nominal_acceleration", np.zeros(10)),
                            ("nominal_input", np.zeros(10))):
            source = builder.AddSystem(ConstantVectorSource(value))
            builder.Connect(source.get_output_port(), feedback.GetInputPort(name))
        self.signals["state"] = measured = plant.GetOutputPort("state")
        self.signals["force"] = builder.AddSystem(
            ConstantVectorSource(np.zeros(6))).get_output_port()
        for part in sensing:
            measured = part.add_to(builder, model, measured, self.signals, 0)
        builder.Connect(measured, feedback.GetInputPort("state"))
        observer = add_observer(builder, model, law, feedback, state=measured)
        applied = feedback.GetOutputPort("tau")
        for part in actuation:
            applied = part.add_to(builder, model, applied, self.signals, 0)
        builder.Connect(applied, plant.GetInputPort("tau"))
        listeners = [feedback, observer] if observer else [feedback]
        if observer and actuation:
            builder.Connect(applied, observer.GetInputPort("applied"))
        if VEHICLE_WRENCH in self.signals:
            for listener in listeners:
                builder.Connect(self.signals[VEHICLE_WRENCH], listener.GetInputPort(VEHICLE_WRENCH))
        self.diagram = builder.Build()
        self._systems = {"uvms": plant, "feedback": feedback, "observer": observer}
        self._step = step
        self.simulator = self.simulate()
        self.context = self.simulator.get_mutable_context()
        uv.set_state(plant, plant.GetMyMutableContextFromRoot(self.context), self.nominal)
        if self.diagram.HasSubsystemNamed("lag"):
            lag = self.diagram.GetSubsystemByName("lag")
            holds = model.inverse_dynamics(model.kinematics(CONFIG), np.zeros(10), np.zeros(10))
            lag.set_initial_output_value(
                lag.GetMyMutableContextFromRoot(self.context), holds[:6])
        self.simulator.Initialize()

    def simulate(self, *context):
        """Returns a simulator, of another context if there is one."""
        simulator = Simulator(self.diagram, *context)
        ApplySimulatorConfig(SimulatorConfig(
            integration_scheme="runge_kutta3", max_step_size=self._step, use_error_control=False,
            start_time=simulator.get_context().get_time()), simulator)
        return simulator

    def read(self, system, port, context=None):
        system = self._systems[system]
        return system.GetOutputPort(port).Eval(
            system.GetMyContextFromRoot(context or self.context)).copy()

    def every(self, period, end, read):
        """Returns the values of `read` at the ends of periods up to `end` [s]."""
        out = []
        for i in range(1, round(end / period) + 1):
            self.simulator.AdvanceTo(i * period)
            out.append(read())
        return np.array(out)


LAW = uv.laws.TipFirst(BlockGains(1.5, 0.4, 3.0), BlockGains(20.0, 10.0, 5.0), observer_period=0.05)
RATES = np.repeat([3.0, 5.0], [6, 4])
BOUND = 0.1
D = np.full(10, BOUND / np.sqrt(10.0))  # as of `ConstantDisturbance`


def disturbance(model, state) -> np.ndarray:
    """Returns δ = J_y d (10,), d constant."""
    now = pair_of(model, state, state)
    return LAW.observed(model).outputs(now).J[0] @ D


def test_it_is_a_filter_of_the_mean_of_the_disturbance():
    """A step takes 1 − e^{−λt}, exactly at the ticks; a law without λ is not observed."""
    value = np.zeros(2)
    for _ in range(10):
        value = estimate(value, np.array([1.0, -2.0]), np.array([3.0, 0.0]), 0.05)
    np.testing.assert_allclose(value, [1.0 - np.exp(-1.5), 0.0], rtol=1e-12)


@pytest.mark.parametrize("actuation", [
    [], [Lag(0.15)], [uv.actuators.SampledCommand(0.05, 0.02)],
    [uv.actuators.SampledCommand(0.05, 0.0), Lag(0.1)]])
def test_it_finds_the_disturbance_whatever_the_actuators_do_to_the_command(model, actuation):
    """δ is nearly constant here: J_y turns with the posture."""
    robot = Hovering(model, LAW, bound=BOUND, actuation=actuation)
    robot.simulator.AdvanceTo(0.501)
    delta = disturbance(model, robot.read("uvms", "state"))
    expected = delta * (1.0 - np.exp(-RATES * 0.5))
    # In a sampled loop the model's forces are those of the last sample, too.
    np.testing.assert_allclose(robot.read("observer", "estimate"), expected, atol=5e-3 * BOUND)


def test_a_constant_disturbance_leaves_no_error(model):
    errors = []
    for law in (LAW, uv.laws.TipFirst(LAW.vehicle, replace(LAW.tip, observer=0.0))):
        robot = Hovering(model, law, bound=BOUND, step=0.05)
        robot.simulator.AdvanceTo(1.5)
        tip = model.task_pose(robot.read("uvms", "state")[:10])[:3]
        errors.append(np.linalg.norm(tip - model.task_pose(robot.nominal[:10])[:3]))
    assert errors[1] > 2e-4
    assert errors[0] < 0.02 * errors[1]


def test_a_command_that_is_cut_does_not_wind_it_up(model):
    """The joint that holds the arm up gets a tenth of what it needs, and sinks."""
    limits = uv.limits.Limits(u=np.full(10, 50.0), tau=np.repeat([500.0, 0.3], [6, 4]))
    robot = Hovering(model, LAW, bound=BOUND, limits=limits)
    found = robot.every(0.05, 1.0, lambda: np.concatenate([
        robot.read("observer", "estimate"), disturbance(model, robot.read("uvms", "state")),
        robot.read("feedback", "limited")]))
    assert found[:, -1].all()
    largest = np.maximum.accumulate(np.abs(found[:, 10:20]), axis=0)
    assert np.all(np.abs(found[:, :10]) <= 1.05 * largest + 1e-3 * BOUND)
    moved = robot.read("uvms", "state")[:10] - robot.nominal[:10]
    assert np.max(np.abs(moved[6:])) > 0.02


@pytest.mark.parametrize(("axis", "disturbance", "dead"), [(0, 1.5, ()), (1, 0.25, (4,))])
def test_thrusters_at_their_limits_do_not_wind_it_up(model, axis, disturbance, dead):
    """A disturbance beyond their limits, or one against a dead thruster that the model has alive.

    The estimate is that of (O) for the applied forces, with those modelled of the dead one. The
    joints have no limits here: the arm holds the tip while the vehicle drifts, faster than its own
    motors could.
    """
    parts = uv.actuators.Thrusters(period=0.02, dead_time=0.04, error=np.where(
        np.isin(np.arange(5), dead), -0.999, 0.0))
    d, B = disturbance * np.eye(10)[axis], parts.known(model).B
    robot = Hovering(model, LAW, actuation=[parts], disturbance=(
        uv.disturbances.ConstantDisturbance(disturbance, direction=d)))
    joints = robot.diagram.GetSubsystemByName("uvms").GetSubsystemByName("joints")
    joints._limits = replace(joints._limits, effort=np.full(4, np.inf), lower=np.full(4, -np.inf),
                             upper=np.full(4, np.inf))

    def signal(name: str) -> np.ndarray:
        port = robot.signals[name]
        return port.Eval(port.get_system().GetMyContextFromRoot(robot.context)).copy()

    def read() -> np.ndarray:
        state = robot.read("uvms", "state")
        now = pair_of(model, state, state)
        given = np.linalg.lstsq(B, signal(VEHICLE_WRENCH), rcond=None)[0]
        missing = np.pad(B @ (parts.error * given), (0, 4))
        acts = d + np.linalg.solve(model.mass_matrix(now.kinematics.at(0)), missing)
        return np.stack([robot.read("observer", "estimate"),
                         LAW.observed(model).outputs(now).J[0] @ acts])

    found, expected = robot.every(0.05, 0.8, read), np.zeros(10)
    assert np.abs(signal("wrench_shortfall")[axis]) > 100.0
    for before, after in zip(found[:-1, 1], found[1:, 1], strict=True):
        expected = estimate(expected, 0.5 * (before + after), RATES, 0.05)
    np.testing.assert_allclose(found[-1, 0], expected, atol=0.02 * np.max(np.abs(expected)))


def test_gaps_of_a_dvl_move_it_by_no_more_than_what_the_velocity_is_off(model):
    """s/(s + λ) λ of an error has the peak-to-peak gain 2λ; a gap that goes on adds nothing."""
    channel, growth, rates = uv.sensors.Channel(20.0, 0.0, 0.0, True), 0.02, RATES[:3]
    robot = Hovering(model, LAW, bound=BOUND, sensing=[uv.sensors.Navigation(
        *6 * [channel], drift=Drift(0.0),
        dvl=uv.sensors.Dvl(noise=np.zeros(3), lost=1.0, growth=growth))], step=0.05)
    found = robot.every(0.05, 1.2, lambda: np.stack([
        robot.read("observer", "estimate"), disturbance(model, robot.read("uvms", "state"))]))
    t = 0.05 * np.arange(1, 25)[:, None]
    off = (found[:, 0] - found[:, 1] * (1.0 - np.exp(-RATES * t)))[:, :3]
    assert 0.1 < np.max(np.abs(off)) / np.max(2.0 * rates * growth * 0.38) < 1.0


@pytest.mark.parametrize("fault", [LostState(0.42, 0.4), FrozenState(0.42, 0.4)])
def test_without_news_of_the_state_the_estimate_stays_as_it_is(model, fault):
    robot = Hovering(model, LAW, bound=BOUND, sensing=[fault])
    frozen = isinstance(fault, FrozenState)  # Without a flag: the law goes on.
    robot.simulator.AdvanceTo(0.46 if frozen else 0.41)
    before = robot.read("observer", "estimate")
    robot.simulator.AdvanceTo(0.81 if frozen else 0.86)  # At first no tick is before the new one.
    np.testing.assert_array_equal(robot.read("observer", "estimate"), before)
    robot.simulator.AdvanceTo(1.21)
    delta = disturbance(model, robot.read("uvms", "state"))
    expected = delta + (before - delta) * np.exp(-RATES * 0.35)
    np.testing.assert_allclose(
        robot.read("observer", "estimate"), expected, atol=0.02 * BOUND)


def test_a_cloned_context_goes_on_identically(model):
    robot = Hovering(model, LAW, bound=BOUND, actuation=[Lag(0.15)])
    robot.simulator.AdvanceTo(0.22)
    clone = robot.context.Clone()
    robot.simulator.AdvanceTo(0.41)
    robot.simulate(clone).AdvanceTo(0.41)
    np.testing.assert_array_equal(robot.read("observer", "estimate", clone),
                                  robot.read("observer", "estimate"))
