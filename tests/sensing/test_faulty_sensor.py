"""Tests of `uvms_drake.sensing.faulty_sensor`: the law and the system alone."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from support.scripts import Script

from uvms_drake.sensing.faulty_sensor import FaultySensor, FrozenState, LostState, sensed


@pytest.mark.parametrize(("fault", "during"), [
    (LostState(1.0, 0.5), [np.nan, np.nan]), (FrozenState(1.0, 0.5), [7.0, 8.0])])
def test_a_sensor_measures_something_else_during_its_fault(fault, during):
    true, held = np.array([1.0, 2.0]), np.array([7.0, 8.0])
    for time in (0.0, 0.999, 1.5, 9.0):
        np.testing.assert_array_equal(sensed(fault, time, true, held), true)
    for time in (1.001, 1.499):
        np.testing.assert_array_equal(sensed(fault, time, true, held), during)


@pytest.mark.parametrize("start", [0.0, 1.0])
def test_a_frozen_sensor_holds_what_it_measured_at_the_start(start):
    """Also in a clone of the Context."""
    builder = DiagramBuilder()
    clock = builder.AddSystem(Script(y=lambda t: [t, -t]))
    sensor = FaultySensor.AddToBuilder(
        builder, FrozenState(start, 0.5), true=clock.get_output_port())
    diagram = builder.Build()
    simulator = Simulator(diagram)

    def measured(context):
        return sensor.GetOutputPort("measured").Eval(sensor.GetMyContextFromRoot(context))

    for time in (start, start + 0.25, start + 0.49):
        simulator.AdvanceTo(time)
        np.testing.assert_allclose(measured(simulator.get_context()), [start, -start], atol=1e-12)
    other = Simulator(diagram, simulator.get_context().Clone())
    for each in (simulator, other):
        each.Initialize()
        np.testing.assert_allclose(measured(each.get_context()), [start, -start], atol=1e-12)
        each.AdvanceTo(start + 0.75)
        np.testing.assert_allclose(measured(each.get_context()), [start + 0.75, -start - 0.75])
