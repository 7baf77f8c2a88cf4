"""Tests of `uvms_drake.actuation.joint_brake`: the law and the system alone."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from uvms_drake.actuation.joint_brake import StuckJoint, braked
from uvms_drake.common.errors import InvalidParameter
from uvms_drake.model.signals.sensor_actuator import Signals

TAU = np.arange(1.0, 11.0)


class Bench:
    """A brake on the third joint from 0.5 s on, of a robot whose state is put in."""

    def __init__(self, model, state):
        builder, signals = DiagramBuilder(), Signals()
        self.true = builder.AddSystem(ConstantVectorSource(state))
        signals["state"] = self.true.get_output_port()
        commanded = builder.AddSystem(ConstantVectorSource(TAU)).get_output_port()
        builder.ExportOutput(StuckJoint(2, 0.5).add_to(builder, model, commanded, signals, 0))
        self.diagram = builder.Build()

    def tau(self, context):
        return self.diagram.get_output_port().Eval(context)

    def move(self, context, state):
        self.true.get_mutable_source_value(
            self.true.GetMyMutableContextFromRoot(context)).set_value(state)


def test_a_brake_is_critically_damped(model, states):
    """Both eigenvalues of q̈ = torque / inertia."""
    held, rows = np.append(states["free"][0][:10], np.zeros(10)), []
    inertia = model.mass_matrix(model.kinematics(held[:10]))[8, 8]
    for change in (8, 18):
        now = held.copy()
        now[change] += 1e-4
        rows.append(braked(model, 2, np.zeros(10), held, now)[8] / inertia / 1e-4)
    np.testing.assert_allclose(
        np.linalg.eigvals([[0.0, 1.0], rows]), [-20.0, -20.0], atol=0.2)


@pytest.mark.parametrize("begins", [0.0, 3.0])
def test_a_stuck_joint_gets_the_brakes_torque_and_the_others_the_commanded_one(
        model, states, begins):
    """It is held where it is at the start, or where a simulation begins later; in a clone, too."""
    state = states["free"][0].copy()
    bench = Bench(model, state)
    context = bench.diagram.CreateDefaultContext()
    context.SetTime(begins)
    simulator = Simulator(bench.diagram, context)
    simulator.Initialize()
    if begins == 0.0:
        simulator.AdvanceTo(0.4)
        np.testing.assert_array_equal(bench.tau(context), TAU)
        simulator.AdvanceTo(0.6)
    moved = state.copy()
    moved[8] += 0.01
    bench.move(context, moved)
    again = Simulator(bench.diagram, context.Clone())
    again.Initialize()
    expected = braked(model, 2, TAU, state, moved)
    assert expected[8] != TAU[8]
    np.testing.assert_array_equal(np.delete(expected, 8), np.delete(TAU, 8))
    for each in (context, again.get_context()):
        np.testing.assert_allclose(bench.tau(each), expected, rtol=1e-9)


def test_a_joint_that_the_arm_has_not_cannot_be_stuck(model):
    with pytest.raises(InvalidParameter, match=r"^joint = 4: must be an index from 0 to 3$"):
        StuckJoint(joint=4).add_to(DiagramBuilder(), model, None, Signals(), 0)
