"""Tests of `uvms_drake.sensing.faults`: the laws and their system alone."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from support.scripts import Script

from uvms_drake.model.signals.sensor_actuator import Signals
from uvms_drake.sensing.faults import (
    FrozenForce,
    FrozenState,
    JumpedForce,
    LostForce,
    LostState,
    SaturatedForce,
)


def bench(fault):
    """Returns a Diagram with the measurement of (t, −t) as its output."""
    builder = DiagramBuilder()
    clock = builder.AddSystem(Script(y=lambda t: [t, -t]))
    builder.ExportOutput(fault.add_to(builder, None, clock.get_output_port(), Signals(), 0))
    return builder.Build()


@pytest.mark.parametrize(("fault", "during"), [
    (LostState(1.0, 0.5), [np.nan, np.nan]), (FrozenState(1.0, 0.5), [1.0, -1.0]),
    (LostForce(1.0, 0.5), [np.nan, np.nan]), (FrozenForce(1.0, 0.5), [1.0, -1.0]),
    (SaturatedForce(1.0, 0.5, largest=0.75), [0.75, -0.75]),
    (JumpedForce(1.0, 0.5, jump=np.array([3.0, -1.0])), [4.25, -2.25])])
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
    diagram, first = bench(FrozenState(start, 5.0)), max(start, begins)
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
