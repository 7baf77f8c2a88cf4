"""Tests of `uvms_drake.station.controller`: one function that is right for every scenario."""

import re

import numpy as np
import pytest
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from pydrake.systems.framework import DiagramBuilder
from support.scenarios import OF_A_STATION

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


@pytest.mark.slow
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


@pytest.mark.parametrize("name", OF_A_STATION)
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


def test_the_limit_of_a_known_surface_is_refused_in_the_terms_of_the_scenario():
    """D9: `surface = 'UnmeasuredWall': must be one that has static_force_rows`."""
    scenario = uv.load_scenario("girona500_contact", ["limits.static_force=30"])
    with pytest.raises(uv.InvalidParameter, match=r"^limits\.static_force = 30\.?0?: must be left out "
                       r"\(null\) .* contact\.force limits$"):
        uv.make_station(scenario)
