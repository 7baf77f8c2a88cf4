"""Parts of one's own and shipped ones in the closed loop: what is logged, proven and refused."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import LeafSystem
from pydrake.systems.primitives import Demultiplexer, FirstOrderLowPassFilter, Gain

import uvms_drake as uv
from uvms_drake.actuation.ideal import SampledCommand
from uvms_drake.actuation.joint_brake import StuckJoint
from uvms_drake.certificate.assumptions import assumed_conditions
from uvms_drake.common.wiring import output_of
from uvms_drake.control.laws import TipFirst
from uvms_drake.control.laws.tip_first import BlockGains
from uvms_drake.model.propulsion.thrusters import ThrusterModel
from uvms_drake.model.signals.sensor_actuator import VEHICLE_WRENCH
from uvms_drake.sensing.navigation import Channel, Dvl, Navigation
from uvms_drake.station.record import save_record
from uvms_drake.station.scenario.scenario import dump_scenario

CLOSE = "start.eta=[-1.13, -0.05, -0.05, 0.02, 0.02, 0.05]"
"""The tip starts 4 cm off the wall and touches it within a second."""


@dataclass
class Nothing(uv.Part):
    """Its author forgot to return a port."""

    def add_to(self, builder, model, port, signals, seed):
        pass


@dataclass
class Scaled(uv.Part):
    """What comes out is a factor times what goes in."""

    factor: float = 1.0
    signal: str = "scaled"

    def add_to(self, builder, model, port, signals, seed):
        gain = builder.AddNamedSystem("gain", Gain(self.factor, port.size()))
        builder.Connect(port, gain.get_input_port())
        signals[self.signal] = gain.get_output_port()
        return gain.get_output_port()


@dataclass
class Short(uv.Part):
    """It loses a component."""

    def add_to(self, builder, model, port, signals, seed):
        gain = builder.AddNamedSystem("gain", Gain(1.0, port.size() - 1))
        return gain.get_output_port()


def scenario_of(duration: float, **lists):
    return replace(uv.load_scenario("girona500_ideal", [f"duration={duration}", CLOSE]), **lists)


def broken_assumptions(scenario) -> list[str]:
    return [condition.name for condition in assumed_conditions(scenario) if not condition.holds]


def test_the_force_settles_with_a_sampled_command():
    """Every 10 ms and 5 ms late: within a third of a time constant of the law."""
    record = uv.simulate(scenario_of(4.5, actuation=[SampledCommand(0.01, 0.005)]))
    error = np.linalg.norm(record.force - record.desired_force, axis=1)
    assert np.all(error[record.time > 4.0] < record.scenario.task.force_tolerance)
    assert np.any(record.force[0] != record.force[-1])


def test_a_part_of_ones_own_is_logged_saved_and_named_in_the_certificate(tmp_path):
    parts = [Scaled(2.0, "twice"), Scaled(0.5, "once")]
    plain, record = uv.simulate(scenario_of(0.4)), uv.simulate(scenario_of(0.4, sensing=parts))
    np.testing.assert_array_equal(record.state, plain.state)
    np.testing.assert_array_equal(record.signals["twice"], 2.0 * record.state)
    np.testing.assert_array_equal(record.signals["once"], record.state)
    assert broken_assumptions(record.scenario) == [
        "sensing[0], Scaled: nothing is proven about it",
        "sensing[1], Scaled: nothing is proven about it"]
    save_record(replace(record, scenario=plain.scenario), tmp_path)
    np.testing.assert_array_equal(
        uv.load_record(tmp_path).signals["twice"], record.signals["twice"])


def test_the_station_exports_a_parts_signal_and_names_its_systems_by_their_place():
    station = uv.make_station(scenario_of(0.4, actuation=[Scaled()]))
    assert station.HasSubsystemNamed("actuation[0].gain")
    assert station.HasSubsystemNamed("log.scaled")
    simulator = Simulator(station)
    simulator.Initialize()
    context = simulator.get_context()
    np.testing.assert_array_equal(*(station.GetOutputPort(name).Eval(context)
                                    for name in ("scaled", "tau")))


@pytest.mark.parametrize(("name", "entry", "part", "void"), [
    ("sensing", "{dvl: {gap: 0.4}, position: {rate: 5}}",
     Navigation(dvl=Dvl(gap=0.4), position=Channel(5.0, 0.0005, 0.01, True)),
     "sensing[0], Navigation: the proofs take the state for known at all times"),
    ("actuation", "{period: 0.1}", SampledCommand(0.1, 0.01),
     "actuation[0], SampledCommand: the proofs take the feedback for continuous")])
def test_a_shipped_part_comes_from_a_file_and_voids_the_certificate(
        name, entry, part, void, tmp_path):
    for tag in (f"!{type(part).__name__} ", ""):
        scenario = uv.load_scenario("bluerov2_ideal", [f"{name}=[{tag}{entry}]"])
        assert repr(getattr(scenario, name)) == repr([part])
        assert broken_assumptions(scenario) == [void]
    path = tmp_path / "mine.yaml"
    path.write_text(dump_scenario(scenario))
    assert repr(getattr(uv.load_scenario(str(path)), name)) == repr([part])
    assert not broken_assumptions(uv.load_scenario("bluerov2_ideal"))


@pytest.mark.parametrize(("parts", "expected"), [
    ([Scaled(signal="force")], r"^sensing\[0\]\.signal = 'force': must be given by one part only"),
    ([Scaled(signal="tube_report")],
     r"^sensing\[0\]\.signals = \['tube_report'\]: must be called otherwise than"),
    ([Scaled(), Scaled()], r"^sensing\[1\]\.signal = 'scaled': must be given by one part only"),
    ([Short()], r"^sensing\[0\]\.size = 19: must be 20, as before it"),
    ([Nothing()], r"^sensing\[0\]\.add_to = None: must be the output port to go on from"),
    (Scaled(), r"^sensing = !Scaled: must be a list")])
def test_a_part_takes_no_name_away_and_no_component(parts, expected):
    with pytest.raises(uv.InvalidParameter, match=expected):
        uv.make_station(scenario_of(0.4, sensing=parts))


@dataclass
class Swell(uv.Disturbance):
    """d̃ sin t along x."""

    def add_to(self, builder, model, seed, signals):
        assert {"state", "e_y", "r"} <= set(signals)
        own = uv.SinusoidalDisturbance(self.bound, np.eye(model.size)[0], 1.0)
        return builder.AddSystem(own.system(model.size)).get_output_port()


def test_a_disturbance_of_ones_own_is_one_class():
    record = uv.simulate(scenario_of(0.4, disturbance=Swell(0.1)))
    np.testing.assert_allclose(record.disturbance[:, 0], 0.1 * np.sin(record.time), atol=1e-12)


# A controller of one's own in the closed loop of a station.


class Still(LeafSystem):
    """Holds the robot at its start by the model's gravity and stiff springs."""

    def __init__(self, model, config):
        super().__init__()
        size = model.size
        state = self.DeclareVectorInputPort("state", 2 * size)
        force = self.DeclareVectorInputPort("force_measured", 6)
        self.DeclareVectorInputPort("place", 3)

        def tau(context):
            y, zeta = np.split(state.Eval(context), 2)
            away = np.concatenate([config[:3] - y[:3], np.zeros(3), config[6:] - y[6:]])
            return -model.mass_matrix(model.kinematics(y)) @ (
                model.drift(y, zeta, np.zeros(6)) + 4.0 * zeta - 4.0 * away)

        output_of(self, "tau", size, tau, {state.ticket()})
        output_of(self, "seen", 6, force.Eval, {force.ticket()})


def test_a_controller_of_ones_own_is_wired_and_logged_by_the_names_of_its_ports():
    scenario = uv.load_scenario("girona500_contact", ["duration=1", "start.eta=[-1,0,0,0,0,0]"])
    model = uv.load_model(scenario)
    scenario = uv.with_step(scenario, model)
    station = uv.make_station(
        scenario, controller=Still(model, scenario.start.config), model=model)
    names = {station.get_input_port(i).get_name() for i in range(station.num_input_ports())}
    assert names == {"place"}
    simulator = Simulator(station)
    simulator.AdvanceTo(1.0)
    logs = uv.read_logs(station, simulator.get_context())
    assert {"state", "tau", "seen", "force_measured", "force_last_valid"} <= set(logs)
    assert not {"tube_bound", "mpc_time", "plan"} & set(logs)
    np.testing.assert_allclose(logs["state"][-1, :3], scenario.start.eta[:3], atol=0.05)
    np.testing.assert_array_equal(logs["seen"], logs["force_last_valid"])


# What the thrusters give now, on its way to a law that takes it.


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


# A closed loop with thrusters, by a scenario's file.


PART = "actuation=[!Thrusters {lag: 0.2, dead_time: 0.02, error: [0.1]}]"


def test_a_law_takes_what_the_thrusters_give_by_their_model():
    scenario = uv.load_scenario("girona500_ideal", [
        "duration=0.3", PART, "ancillary=!TipFirst {undriven: [roll]}"])
    record = uv.simulate(scenario)
    force, wrench = (record.signals[name] for name in ("thruster_force", VEHICLE_WRENCH))
    known = ThrusterModel.of(record.model.thrusters)
    np.testing.assert_allclose(wrench, force @ known.B.T / 1.1, atol=1e-9)
    assert np.ptp(force, axis=0).max() > 1.0
    # The law gives joints torques for the wrench as it is: the tip goes as it is planned to.
    off = np.linalg.norm(record.chi[:, :3] - record.chi_nominal[:, :3], axis=1)
    assert np.max(off) < 5e-4
