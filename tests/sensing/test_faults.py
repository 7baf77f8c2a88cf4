"""Faults of sensors, the laws and their system alone, and the value through a gap."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, Integrator
from support.scripts import Script, use_fixed_steps

from uvms_drake.model.signals.sensor_actuator import Signals
from uvms_drake.sensing import faults
from uvms_drake.sensing.measurements import HoldLastValue


def bench(fault):
    """Returns a Diagram with the measurement of (t, −t) as its output."""
    builder = DiagramBuilder()
    clock = builder.AddSystem(Script(y=lambda t: [t, -t]))
    builder.ExportOutput(fault.add_to(builder, None, clock.get_output_port(), Signals(), 0))
    return builder.Build()


@pytest.mark.parametrize(("fault", "during"), [
    (faults.LostState(1.0, 0.5), [np.nan, np.nan]), (faults.FrozenState(1.0, 0.5), [1.0, -1.0]),
    (faults.LostForce(1.0, 0.5), [np.nan, np.nan]), (faults.FrozenForce(1.0, 0.5), [1.0, -1.0]),
    (faults.SaturatedForce(1.0, 0.5, largest=0.75), [0.75, -0.75]),
    (faults.JumpedForce(1.0, 0.5, jump=np.array([3.0, -1.0])), [4.25, -2.25])])
def test_a_sensor_measures_something_else_during_its_fault(fault, during):
    """A step that ends at the start is before it."""
    diagram = bench(fault)
    simulator = Simulator(diagram)
    for time in (0.0, 1.0, 1.25, 1.5, 9.0):
        simulator.AdvanceTo(time)
        np.testing.assert_allclose(
            diagram.get_output_port().Eval(simulator.get_context()),
            during if time == 1.25 else [time, -time], atol=1e-12)


@pytest.mark.parametrize(("start", "begins"), [(0.0, 0.0), (1.0, 0.0), (1.0, 3.0)])
def test_a_frozen_sensor_holds_what_it_measured_at_the_start(start, begins):
    """Or where a simulation begins later, also before its initialization and in a clone."""
    diagram, first = bench(faults.FrozenState(start, 5.0)), max(start, begins)
    measured = diagram.get_output_port().Eval
    context = diagram.CreateDefaultContext()
    context.SetTime(begins)
    if begins:
        np.testing.assert_array_equal(measured(context), [first, -first])
    simulator = Simulator(diagram, context)
    for time in (first, first + 0.25, first + 0.49):
        simulator.AdvanceTo(time)
        np.testing.assert_allclose(measured(context), [first, -first], atol=1e-12)
    for each in (simulator, Simulator(diagram, context.Clone())):
        each.Initialize()
        np.testing.assert_allclose(measured(each.get_context()), [first, -first], atol=1e-12)
        each.AdvanceTo(start + 5.25)
        np.testing.assert_allclose(measured(each.get_context()), [start + 5.25, -start - 5.25])


def measured(time):
    """Rises, but for a gap from 0.5 s to 0.7 s, of one component only."""
    return [time, np.nan if time < 0.1 or 0.5 <= time < 0.7 else -time]


def test_the_last_finite_vector_goes_on_through_a_gap_also_in_a_clone():
    builder = DiagramBuilder()
    script = builder.AddSystem(Script(measured=measured))
    last = HoldLastValue.AddToBuilder(
        builder, script.get_output_port().size(), measured=script.get_output_port())
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
    last = HoldLastValue.AddToBuilder(
        builder, script.GetOutputPort("measured").size(), measured=script.GetOutputPort("measured"),
        release=script.GetOutputPort("release"))
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    own = last.GetMyMutableContextFromRoot(context)
    own.SetDiscreteState(np.array([0.4, -0.4]))
    for time, expected in ((0.52, 0.4), (0.6, 0.0), (0.8, 0.8)):
        context.SetTime(time)
        np.testing.assert_array_equal(last.get_output_port().Eval(own), [expected, -expected])
