"""Tests of `uvms_drake.station.controller`: one function that is right for every scenario."""

import re

import numpy as np
import pytest
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from pydrake.systems.framework import DiagramBuilder
from support.scenarios import UNLIKE_FIRST

import uvms_drake as uv


def pressed(name, until):
    """Returns the force (6,) of a loop of plant and controller at a time [s], and station's."""
    scenario = uv.with_step(uv.load_scenario(name, ["disturbance.bound=0"]))
    builder = DiagramBuilder()
    uvms = builder.AddSystem(uv.make_uvms_plant(
        scenario.model, surface=scenario.surface, disturbance=scenario.disturbance,
        start=scenario.start.config))
    controller = builder.AddSystem(uv.make_controller(scenario))
    for signal in ("state", "force"):
        builder.Connect(uvms.GetOutputPort(signal), controller.GetInputPort(signal))
    builder.Connect(controller.GetOutputPort("tau"), uvms.GetInputPort("tau"))
    simulator = Simulator(builder.Build())
    ApplySimulatorConfig(scenario.simulator, simulator)
    simulator.AdvanceTo(until)
    context = simulator.get_context()
    return uvms.GetOutputPort("force").Eval(uvms.GetMyContextFromRoot(context)), scenario


@pytest.mark.long
def test_the_main_scenario_presses_with_the_desired_force():
    """D3: the same snippet with `make_tube_mpc` pressed with 0 N for ever."""
    force, scenario = pressed("girona500_contact", 12.0)
    n = scenario.contact.direction
    assert force[:3] @ n == pytest.approx(scenario.task.force[:3] @ n, abs=0.5)


def test_of_a_known_surface_it_is_the_controller_of_the_station():
    """The same commands at the first instant, from the same state."""
    scenario = uv.load_scenario("girona500_ideal")
    alone, station = uv.make_controller(scenario), uv.make_station(scenario)
    context = alone.CreateDefaultContext()
    state = np.concatenate([scenario.start.config, np.zeros(10)])
    alone.GetInputPort("state").FixValue(context, state)
    alone.GetInputPort("force").FixValue(context, np.zeros(6))
    Simulator(alone, context).Initialize()
    simulator = Simulator(station)
    simulator.Initialize()
    np.testing.assert_allclose(
        alone.GetOutputPort("tau").Eval(context),
        station.GetOutputPort("tau").Eval(simulator.get_context()), rtol=1e-9, atol=1e-9)


def test_its_force_sensor_measures_the_payload_of_the_plant_as_that_of_the_station():
    scenario = uv.with_step(uv.load_scenario("girona500_contact", [
        "disturbance.bound=0", "model_error={payload: {mass: 2.0}}",
        "sensing=[!ForceSensor {tare: 0.0}]"]))
    builder = DiagramBuilder()
    plant = builder.AddSystem(uv.make_plant(scenario))
    controller = builder.AddSystem(uv.make_controller(scenario))
    for port in ("state", "force", "payload", "payload_at_rest"):
        builder.Connect(plant.GetOutputPort(port), controller.GetInputPort(port))
    builder.Connect(controller.GetOutputPort("tau"), plant.GetInputPort("tau"))
    loop, station = builder.Build(), uv.make_station(scenario)
    read = []
    for system, part in ((loop, controller), (station, station)):
        simulator = Simulator(system)
        ApplySimulatorConfig(scenario.simulator, simulator)
        simulator.AdvanceTo(0.02)
        context = part.GetMyContextFromRoot(simulator.get_context())
        read.append(part.GetOutputPort("force_raw").Eval(context))
    np.testing.assert_allclose(*read, rtol=1e-9, atol=1e-9)
    assert np.linalg.norm(read[0]) > 10.0


@pytest.mark.parametrize("name", UNLIKE_FIRST)
def test_it_is_made_for_every_shipped_scenario_with_the_ports_of_its_docstring(name):
    scenario = uv.load_scenario(name)
    controller = uv.make_controller(scenario)
    assert controller.HasInputPort("state") and controller.HasInputPort("force")
    assert controller.HasOutputPort("tau")
    assert controller.HasOutputPort("plan")
    asked = isinstance(scenario.contact, uv.SensedContact) and not scenario.mission.steps
    assert controller.HasInputPort("place") == asked
    assert controller.HasInputPort("stop") == bool(scenario.mission.steps)
    assert controller.HasInputPort("payload") == scenario.model_error.payload.present


@pytest.mark.parametrize("missing", ["state", "force"])
def test_a_signal_that_it_needs_must_be_connected(missing):
    """A force sensor that reads zero pressed with five times the desired force."""
    scenario = uv.load_scenario("girona500_contact")
    controller = uv.make_controller(scenario)
    context = controller.CreateDefaultContext()
    for name, value in (("state", np.concatenate([scenario.start.config, np.zeros(10)])),
                        ("force", np.zeros(6))):
        if name != missing:
            controller.GetInputPort(name).FixValue(context, value)
    with pytest.raises(RuntimeError, match=rf"::controller::{missing} .*is not connected"):
        Simulator(controller, context).AdvanceTo(0.02)


def test_a_problem_that_it_cannot_serve_is_refused():
    scenario = uv.load_scenario("girona500_contact")
    with pytest.raises(uv.InvalidParameter, match=re.escape("uv.make_controller(scenario)")):
        uv.make_tube_mpc(uv.make_ocp(scenario), scenario.ancillary)


# The plant of a scenario is the station's: the same acceleration by the same command.


@pytest.mark.parametrize(("name", "more"), [
    ("girona500_ideal", ["surface_error.shift=[-0.4, 0, 0]"]),
    ("girona500_ideal", ["model_error.mass=1.2", "current=[0.1, 0.2, 0]",
                         "waves=[{amplitude: 0.2, period: 5.0, depth: 3.0}]"])])
def test_it_moves_as_that_of_the_station(name, more):
    scenario = uv.load_scenario(name, ["simulator.max_step_size=0.01", *more])
    station, plant = uv.make_station(scenario), uv.make_plant(scenario)
    simulator = Simulator(station)
    simulator.Initialize()
    whole, alone = simulator.get_context(), plant.CreateDefaultContext()
    plant.GetInputPort("tau").FixValue(alone, station.GetOutputPort("tau").Eval(whole))
    for port in ("state", "force", "disturbance", "acceleration"):
        np.testing.assert_allclose(plant.GetOutputPort(port).Eval(alone),
                                   station.GetOutputPort(port).Eval(whole), atol=1e-12)


# The law of a worst-case certificate reads the present state, as its theory says; no older one.


TICK = 2.0**-8
"""Time between two samples of this test [s]."""


def test_the_law_of_a_certificate_reads_the_present_state():
    scenario = uv.with_step(uv.load_scenario("girona500_tip_first"))
    station = uv.make_station(scenario)
    simulator = Simulator(station)
    ApplySimulatorConfig(scenario.simulator, simulator)
    root = simulator.get_context()

    def value(system: str, port: str) -> np.ndarray:
        """Returns the present value of a port of a subsystem."""
        part = station.GetSubsystemByName(system)
        return part.GetOutputPort(port).Eval(part.GetMyContextFromRoot(root)).copy()

    controller = station.GetSubsystemByName("tube_mpc")
    for tick in (35, 69):  # Just after a plan, and on the way.
        simulator.AdvanceTo(tick * TICK)
        read = controller.GetInputPort("state").Eval(controller.GetMyContextFromRoot(root))
        assert np.any(read[len(read) // 2:]), "it moves"
        assert np.array_equal(read, value("uvms", "state"))
        due = value("tube_mpc", "tau")
        simulator.AdvanceTo((tick + 0.5) * TICK)
        assert np.max(np.abs(value("tube_mpc", "tau") - due)) > 0.01, "half a period is told apart"


def test_the_age_of_a_fix_is_an_input_of_a_supervisor_for_sensors_of_ones_own():
    scenario = uv.load_scenario("girona500_real_loop")
    controller = uv.make_controller(scenario, measured=True)
    assert controller.HasOutputPort("safety") and controller.HasInputPort("fix_age")
    for changes, measured in (([], False), (["supervisor=null"], True)):
        other = uv.make_controller(uv.load_scenario("girona500_real_loop", changes),
                                   measured=measured)
        assert not other.HasInputPort("fix_age")
