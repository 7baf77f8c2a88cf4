"""Tests of `uvms_drake.sensing.measurements`: the value through a gap."""

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, Integrator
from support.scripts import Script, use_fixed_steps

from uvms_drake.common.wiring import added
from uvms_drake.sensing.measurements import HoldLastValue


def measured(time):
    """Rises, but for a gap from 0.5 s to 0.7 s, of one component only."""
    return [time, np.nan if time < 0.1 or 0.5 <= time < 0.7 else -time]


def test_the_last_finite_vector_goes_on_through_a_gap_also_in_a_clone():
    builder = DiagramBuilder()
    script = builder.AddSystem(Script(measured=measured))
    last = added(
        builder, "hold_last_value", HoldLastValue(script.get_output_port().size()),
        measured=script.get_output_port())
    moving = builder.AddSystem(Integrator(1))  # A continuous state makes steps.
    one = builder.AddSystem(ConstantVectorSource([1.0]))
    builder.Connect(one.get_output_port(), moving.get_input_port())
    diagram = builder.Build()
    simulator = Simulator(diagram)
    use_fixed_steps(simulator)
    step = simulator.get_integrator().get_maximum_step_size()

    def value(simulator):
        return last.get_output_port().Eval(last.GetMyContextFromRoot(simulator.get_context()))

    for time in (0.05, 0.2, 0.45, 0.55, 0.69, 0.75):
        simulator.AdvanceTo(time)
        if time == 0.55:
            clone = Simulator(diagram, simulator.get_context().Clone())
        expected = {0.05: np.nan, 0.55: 0.5, 0.69: 0.5}.get(time, time)
        np.testing.assert_allclose(value(simulator), [expected, -expected], atol=1.01 * step)
    clone.AdvanceTo(0.69)
    np.testing.assert_allclose(value(clone), [0.5, -0.5], atol=1.01 * step)


def test_in_a_gap_release_zeroes_the_last_vector():
    builder = DiagramBuilder()
    script = builder.AddSystem(Script(measured=measured, release=lambda time: [time > 0.55]))
    last = added(
        builder, "hold_last_value", HoldLastValue(script.GetOutputPort("measured").size()),
        measured=script.GetOutputPort("measured"), release=script.GetOutputPort("release"))
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    own = last.GetMyMutableContextFromRoot(context)
    own.SetDiscreteState(np.array([0.4, -0.4]))
    for time, expected in ((0.52, 0.4), (0.6, 0.0), (0.8, 0.8)):
        context.SetTime(time)
        np.testing.assert_array_equal(last.get_output_port().Eval(own), [expected, -expected])
