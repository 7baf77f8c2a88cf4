"""Tests of `uvms_drake.control.tube_mpc`: the controller's Diagram, alone and on the plant."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from uvms_drake.control.laws import Resolved
from uvms_drake.control.tube_mpc import make_tube_mpc
from uvms_drake.papers.nikou2018 import Transpose
from uvms_drake.plant.disturbance import ConstantDisturbance
from uvms_drake.plant.uvms_plant import make_uvms_plant, set_state


def ports_of(controller) -> tuple[dict[str, int], dict[str, int]]:
    """Returns the sizes of the input and of the output ports, by name."""
    inputs = [controller.get_input_port(i) for i in range(controller.num_input_ports())]
    outputs = [controller.get_output_port(i) for i in range(controller.num_output_ports())]
    return ({port.get_name(): port.size() for port in inputs},
            {port.get_name(): port.size() for port in outputs})


def test_it_has_the_documented_ports(short_ocp):
    assert ports_of(make_tube_mpc(short_ocp, Resolved())) == (
        {"state": 20, "force_measured": 6, "vehicle_wrench": 6, "fault": 1},
        {"tau": 10, "u": 10, "state_lost": 1, "input_limited": 1, "pair": 0, "nominal_state": 20,
         "nominal_input": 10, "plan": 0, "report": 8, "solve_seconds": 1})


def closed_loop(short_ocp, plane, start, ancillary, bound: float):
    """Returns a Simulator of plant and controller, and what reads their ports."""
    builder = DiagramBuilder()
    plant = builder.AddNamedSystem("uvms", make_uvms_plant(
        "girona500_arm5e", surface=plane, disturbance=ConstantDisturbance(bound=bound)))
    controller = builder.AddNamedSystem("controller", make_tube_mpc(short_ocp, ancillary))
    builder.Connect(plant.GetOutputPort("state"), controller.GetInputPort("state"))
    builder.Connect(controller.GetOutputPort("tau"), plant.GetInputPort("tau"))
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    set_state(plant, plant.GetMyMutableContextFromRoot(context), start)
    simulator.get_mutable_integrator().set_maximum_step_size(0.01)
    simulator.Initialize()

    def read(name: str):
        system = plant if plant.HasOutputPort(name) else controller
        return system.GetOutputPort(name).Eval(system.GetMyContextFromRoot(context)).copy()

    return simulator, read


@pytest.fixture
def start(start_plans) -> np.ndarray:
    """At rest on the wall, off the task."""
    return np.concatenate([start_plans["on"][0].config[0], np.zeros(10)])


@pytest.mark.parametrize("ancillary", [Resolved(), Transpose()])
def test_without_a_disturbance_the_robot_moves_as_planned(short_ocp, plane, start, ancillary):
    simulator, read = closed_loop(short_ocp, plane, start, ancillary, bound=0.0)
    np.testing.assert_allclose(read("nominal_state"), start, atol=1e-12)
    np.testing.assert_allclose(read("u"), read("nominal_input"), atol=1e-9)
    simulator.AdvanceTo(0.5)
    assert np.linalg.norm(read("nominal_state") - start) > 0.02
    np.testing.assert_allclose(read("state"), read("nominal_state"), atol=1e-4)
    model = short_ocp.model
    M = model.mass_matrix(model.kinematics(read("state")[:10]))
    np.testing.assert_allclose(read("tau"), M @ read("u"), rtol=1e-9)


@pytest.mark.parametrize("ancillary", [Resolved(), Transpose()])
def test_the_feedback_fights_the_disturbance_and_the_plan_does_not_see_it(
        short_ocp, plane, start, ancillary):
    nominal = []
    for bound in (0.0, 0.1):
        simulator, read = closed_loop(short_ocp, plane, start, ancillary, bound)
        simulator.AdvanceTo(0.5)
        nominal.append(read("nominal_state"))
    np.testing.assert_array_equal(nominal[0], nominal[1])
    deviation = (read("state") - nominal[1])[10:]
    assert 1e-4 < np.linalg.norm(deviation) < 0.1 * 0.5 / 2.0, "less than half of without feedback"
    if isinstance(ancillary, Resolved):
        # Its 𝔯 settles at d/k = 0.005.
        assert np.linalg.norm(deviation) < 0.01
