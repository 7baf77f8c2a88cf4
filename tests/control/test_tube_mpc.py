"""Tests of `uvms_drake.control.tube_mpc`: the controller's Diagram, alone and on the plant."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

import uvms_drake as uv
from uvms_drake.papers.nikou2018 import Transpose


def closed_loop(short_ocp, plane, start, ancillary, bound: float):
    """Returns a Simulator of plant and controller, and what reads their ports."""
    builder = DiagramBuilder()
    plant = builder.AddNamedSystem("uvms", uv.make_uvms_plant(
        "girona500_arm5e", surface=plane, disturbance=uv.disturbances.ConstantDisturbance(bound)))
    controller = builder.AddNamedSystem("controller", uv.make_tube_mpc(short_ocp, ancillary))
    builder.Connect(plant.GetOutputPort("state"), controller.GetInputPort("state"))
    builder.Connect(controller.GetOutputPort("tau"), plant.GetInputPort("tau"))
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    uv.set_state(plant, plant.GetMyMutableContextFromRoot(context), start)
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


@pytest.mark.parametrize("ancillary", [uv.Resolved(), Transpose()])
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


@pytest.mark.parametrize("ancillary", [uv.Resolved(), Transpose()])
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
    if isinstance(ancillary, uv.Resolved):
        # Its 𝔯 settles at d/k = 0.005.
        assert np.linalg.norm(deviation) < 0.01
