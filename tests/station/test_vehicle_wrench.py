"""What the thrusters give now, on its way to a law that takes it."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.primitives import Demultiplexer, FirstOrderLowPassFilter

import uvms_drake as uv
from uvms_drake.actuation.joint_brake import StuckJoint
from uvms_drake.control.laws import TipFirst
from uvms_drake.control.laws.tip_first import BlockGains
from uvms_drake.model.signals.sensor_actuator import VEHICLE_WRENCH

LAGS = np.repeat([0.2, 0.01], [6, 4])


@dataclass
class Slow(uv.Part):
    """Thrusters that lag, and say what they give, or what they are commanded."""

    early: bool = False

    def add_to(self, builder, model, port, signals, seed):
        lag = builder.AddNamedSystem("lag", FirstOrderLowPassFilter(LAGS))
        builder.Connect(port, lag.get_input_port())
        parts = builder.AddNamedSystem("parts", Demultiplexer([6, model.num_joints]))
        builder.Connect(port if self.early else lag.get_output_port(), parts.get_input_port())
        signals[VEHICLE_WRENCH] = parts.get_output_port(0)
        return lag.get_output_port()


@dataclass
class ContactSpecification(uv.Resolved):
    """It commands the joints to ten times what the vehicle is given, and so shows that."""

    takes_wrench = True

    def command(self, model, now, nominal_acceleration, nominal_input):
        tau = np.concatenate([np.arange(1.0, 7.0), 10.0 * now.wrench[:4]])
        return uv.Command(u=np.zeros(10), tau=tau, M=np.eye(10))


def station_of(law, part):
    return uv.make_station(replace(
        uv.load_scenario("girona500_ideal", ["duration=1"]), ancillary=law, actuation=[part]))


def test_the_law_takes_what_the_thrusters_give_now():
    station = station_of(ContactSpecification(), Slow())
    simulator = Simulator(station)
    simulator.get_mutable_integrator().set_maximum_step_size(0.02)
    simulator.Initialize()
    for end in (0.0, 0.05):
        simulator.AdvanceTo(end)
        context = simulator.get_context()
        given, tau = (station.GetOutputPort(name).Eval(context) for name in (
            VEHICLE_WRENCH, "tau"))
        np.testing.assert_allclose(
            given, np.arange(1.0, 7.0) * (1.0 - np.exp(-end / 0.2)), rtol=1e-4, atol=1e-12)
        np.testing.assert_array_equal(tau[6:], 10.0 * given[:4])


def test_a_law_that_does_not_take_it_does_not_see_it():
    station = station_of(uv.Resolved(), Slow(early=True))
    controller = station.GetSubsystemByName("tube_mpc")
    context = controller.GetMyContextFromRoot(station.CreateDefaultContext())
    assert not controller.GetInputPort(VEHICLE_WRENCH).HasValue(context)


def test_what_follows_at_once_from_the_command_is_an_algebraic_loop():
    with pytest.raises(RuntimeError, match="algebraic loop"):
        station_of(ContactSpecification(), Slow(early=True))


def test_an_observer_is_told_what_known_actuators_give_and_of_no_fault():
    law = TipFirst(tip=BlockGains(20.0, 10.0, 2.0))
    station = uv.make_station(replace(
        uv.load_scenario("girona500_ideal", ["duration=1"]), ancillary=law, actuation=[Slow()],
        faults=[StuckJoint(0, 0.0)]))
    context = station.CreateDefaultContext()
    controller, lag, brake = (station.GetSubsystemByName(name) for name in (
        "tube_mpc", "actuation[0].lag", "faults[0].joint_brake"))
    given = np.arange(10.0)
    lag.GetMyMutableContextFromRoot(context).SetContinuousState(given)
    own = controller.GetMyContextFromRoot(context)
    np.testing.assert_array_equal(controller.GetInputPort("applied").Eval(own), given)
    np.testing.assert_array_equal(controller.GetInputPort(VEHICLE_WRENCH).Eval(own), given[:6])
    assert brake.GetInputPort("signal").HasValue(brake.GetMyContextFromRoot(context))
