"""Tests of `uvms_drake.actuation.joint_brake`: the law and the system alone."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from uvms_drake.actuation.joint_brake import JointBrake, StuckJoint, brake_torque
from uvms_drake.common.errors import InvalidParameter


def test_a_brake_is_critically_damped():
    """Both eigenvalues of q̈ = torque / inertia."""
    A = np.array([[0.0, 1.0], [brake_torque(1.0, 1.0, 0.0), brake_torque(1.0, 0.0, 1.0)]])
    np.testing.assert_allclose(np.linalg.eigvals(A), [-20.0, -20.0], atol=1e-4)
    assert brake_torque(3.0, 0.1, 0.2) == pytest.approx(3.0 * brake_torque(1.0, 0.1, 0.2))


def test_a_stuck_joint_gets_the_brakes_torque_and_the_others_the_commanded_one(model, states):
    state, tau = states["free"][0].copy(), np.arange(1.0, 11.0)
    builder = DiagramBuilder()
    commanded = builder.AddSystem(ConstantVectorSource(tau))
    true = builder.AddSystem(ConstantVectorSource(state))
    brake = JointBrake.AddToBuilder(
        builder, model, StuckJoint(joint=2, start=0.5), commanded=commanded.get_output_port(),
        state=true.get_output_port())
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()

    def put_out():
        return brake.GetOutputPort("tau").Eval(brake.GetMyContextFromRoot(context))

    simulator.AdvanceTo(0.4)
    np.testing.assert_array_equal(put_out(), tau)
    simulator.AdvanceTo(0.6)
    moved = state.copy()
    moved[8] += 0.01
    true.get_mutable_source_value(true.GetMyMutableContextFromRoot(context)).set_value(moved)
    inertia = model.mass_matrix(model.kinematics(moved[:10]))[8, 8]
    expected = tau.copy()
    expected[8] = brake_torque(inertia, 0.01, state[18])
    np.testing.assert_allclose(put_out(), expected, rtol=1e-9)


def test_a_brake_of_a_simulation_that_begins_later_holds_the_joint_where_it_is(model, states):
    state = states["free"][0].copy()
    builder = DiagramBuilder()
    commanded = builder.AddSystem(ConstantVectorSource(np.zeros(10)))
    true = builder.AddSystem(ConstantVectorSource(state))
    brake = JointBrake.AddToBuilder(
        builder, model, StuckJoint(joint=2, start=0.5), commanded=commanded.get_output_port(),
        state=true.get_output_port())
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    context.SetTime(3.0)
    inertia = model.mass_matrix(model.kinematics(state[:10]))[8, 8]

    def pull(context):
        return brake.GetOutputPort("tau").Eval(brake.GetMyContextFromRoot(context))[8]

    assert pull(context) == pytest.approx(brake_torque(inertia, 0.0, state[18]))
    Simulator(diagram, context).Initialize()
    moved = state.copy()
    moved[8] += 0.01
    true.get_mutable_source_value(true.GetMyMutableContextFromRoot(context)).set_value(moved)
    again = Simulator(diagram, context.Clone())  # The angle stays in a clone that continues.
    again.Initialize()
    inertia = model.mass_matrix(model.kinematics(moved[:10]))[8, 8]
    for each in (context, again.get_context()):
        assert pull(each) == pytest.approx(brake_torque(inertia, 0.01, state[18]))


def test_a_joint_that_the_arm_has_not_cannot_be_stuck(model):
    with pytest.raises(InvalidParameter, match=r"^joint = 4: must be an index from 0 to 3$"):
        JointBrake(model, StuckJoint(joint=4))
