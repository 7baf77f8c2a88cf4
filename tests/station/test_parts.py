"""Parts of one's own and shipped ones in the closed loop: what is logged, proven and refused."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.primitives import Gain

from uvms_drake.actuation.ideal import SampledCommand
from uvms_drake.certificate.assumptions import assumed_conditions
from uvms_drake.common.errors import InvalidParameter, ScenarioError
from uvms_drake.model.signals.sensor_actuator import Part
from uvms_drake.plant.disturbance import Disturbance, SinusoidalDisturbance
from uvms_drake.sensing.navigation import Channel, Dvl, Navigation
from uvms_drake.station.diagram import make_station
from uvms_drake.station.record import load_record, save_record
from uvms_drake.station.scenario.scenario import dump_scenario, load_scenario
from uvms_drake.station.simulation import simulate

CLOSE = "start.eta=[-1.13, -0.05, -0.05, 0.02, 0.02, 0.05]"
"""The tip starts 4 cm off the wall and touches it within a second."""


@dataclass
class Nothing(Part):
    """Its author forgot to return a port."""

    def add_to(self, builder, model, port, signals, seed):
        pass


@dataclass
class Scaled(Part):
    """What comes out is a factor times what goes in."""

    factor: float = 1.0
    signal: str = "scaled"

    def add_to(self, builder, model, port, signals, seed):
        gain = builder.AddNamedSystem("gain", Gain(self.factor, port.size()))
        builder.Connect(port, gain.get_input_port())
        signals[self.signal] = gain.get_output_port()
        return gain.get_output_port()


@dataclass
class Short(Part):
    """It loses a component."""

    def add_to(self, builder, model, port, signals, seed):
        gain = builder.AddNamedSystem("gain", Gain(1.0, port.size() - 1))
        return gain.get_output_port()


def scenario_of(duration: float, **lists):
    return replace(load_scenario("girona500_ideal", [f"duration={duration}", CLOSE]), **lists)


def broken_assumptions(scenario) -> list[str]:
    return [condition.name for condition in assumed_conditions(scenario) if not condition.holds]


def test_the_force_settles_with_a_sampled_command():
    """Every 10 ms and 5 ms late: within a third of a time constant of the law."""
    record = simulate(scenario_of(4.5, actuation=[SampledCommand(0.01, 0.005)]))
    error = np.linalg.norm(record.force - record.desired_force, axis=1)
    assert np.all(error[record.time > 4.0] < record.scenario.task.force_tolerance)
    assert np.any(record.force[0] != record.force[-1])


def test_a_part_of_ones_own_is_logged_saved_and_named_in_the_certificate(tmp_path):
    parts = [Scaled(2.0, "twice"), Scaled(0.5, "once")]
    plain, record = simulate(scenario_of(0.4)), simulate(scenario_of(0.4, sensing=parts))
    np.testing.assert_array_equal(record.state, plain.state)
    np.testing.assert_array_equal(record.signals["twice"], 2.0 * record.state)
    np.testing.assert_array_equal(record.signals["once"], record.state)
    assert broken_assumptions(record.scenario) == [
        "sensing[0], Scaled: nothing is proven about it",
        "sensing[1], Scaled: nothing is proven about it"]
    save_record(replace(record, scenario=plain.scenario), tmp_path)
    np.testing.assert_array_equal(
        load_record(tmp_path).signals["twice"], record.signals["twice"])


def test_the_station_exports_a_parts_signal_and_names_its_systems_by_their_place():
    station = make_station(scenario_of(0.4, actuation=[Scaled()]))
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
        scenario = load_scenario("bluerov2_ideal", [f"{name}=[{tag}{entry}]"])
        assert repr(getattr(scenario, name)) == repr([part])
        assert broken_assumptions(scenario) == [void]
    path = tmp_path / "mine.yaml"
    path.write_text(dump_scenario(scenario))
    assert repr(getattr(load_scenario(str(path)), name)) == repr([part])
    assert not broken_assumptions(load_scenario("bluerov2_ideal"))


@pytest.mark.parametrize(("override", "expected"), [
    ("sensing=[{joints: {rate: 0}}]", "sensing[0].joints.rate = 0.0: must be positive, and"),
    ("actuation=[{}, {period: -1}]", "actuation[1].period = -1.0: must be at least 0.0001"),
    ("actuation=[!Hold {}]",
     "actuation[0] = '!Hold': must be a mapping tagged !SampledCommand or !Thrusters "
     "or !IdealWrench")])
def test_a_part_without_a_meaning_is_one_line(override, expected):
    with pytest.raises(ScenarioError) as caught:
        load_scenario("girona500_ideal", [override])
    assert expected in str(caught.value)


@pytest.mark.parametrize(("parts", "expected"), [
    ([Scaled(signal="force")], r"^sensing\[0\]\.signal = 'force': must be given by one part only"),
    ([Scaled(signal="tube_report")],
     r"^sensing\[0\]\.signals = \['tube_report'\]: must be called otherwise than"),
    ([Scaled(), Scaled()], r"^sensing\[1\]\.signal = 'scaled': must be given by one part only"),
    ([Short()], r"^sensing\[0\]\.size = 19: must be 20, as before it"),
    ([Nothing()], r"^sensing\[0\]\.add_to = None: must be the output port to go on from"),
    (Scaled(), r"^sensing = Scaled\(.*\): must be a list")])
def test_a_part_takes_no_name_away_and_no_component(parts, expected):
    with pytest.raises(InvalidParameter, match=expected):
        make_station(scenario_of(0.4, sensing=parts))


@dataclass
class Swell(Disturbance):
    """d̃ sin t along x."""

    def add_to(self, builder, model, seed, signals):
        assert {"state", "e_y", "r"} <= set(signals)
        own = SinusoidalDisturbance(self.bound, np.eye(model.size)[0], 1.0)
        return builder.AddSystem(own.system(model.size)).get_output_port()


def test_a_disturbance_of_ones_own_is_one_class():
    record = simulate(scenario_of(0.4, disturbance=Swell(0.1)))
    np.testing.assert_allclose(record.disturbance[:, 0], 0.1 * np.sin(record.time), atol=1e-12)
