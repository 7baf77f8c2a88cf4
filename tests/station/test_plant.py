"""The plant of a scenario is the station's: the same acceleration by the same command."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

import uvms_drake as uv


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


@pytest.mark.parametrize(("name", "override", "expected"), [
    ("girona500_ideal", "disturbance=!AdversarialDisturbance {bound: 0.1}",
     "disturbance = 'AdversarialDisturbance': must be a function of time alone"),
    ("paper_kinematic", "seed=0", "simulation = .*: must be left out")])
def test_a_scenario_that_needs_a_station_is_refused(name, override, expected):
    with pytest.raises(uv.InvalidParameter, match=expected):
        uv.make_plant(uv.load_scenario(name, ["simulator.max_step_size=0.01", override]))


def test_a_scenario_without_a_step_of_the_integrator_is_refused_with_the_remedy():
    """A Simulator with its configuration would stand at t = 0 for ever, without a word."""
    scenario = uv.load_scenario("girona500_ideal")
    with pytest.raises(uv.InvalidParameter, match=r"max_step_size = 0\.0: .*uv\.with_step\("):
        uv.make_plant(scenario)
    assert uv.make_plant(uv.with_step(scenario)).get_name() == "plant"
