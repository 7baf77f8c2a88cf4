"""Tests of `uvms_drake.sensing.faulty_sensor`: the law and the system alone."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from support.scripts import Script

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.sensing.faulty_sensor import FaultySensor, FrozenState, LostState, sensed
from uvms_drake.sensing.force_faults import FrozenForce, JumpedForce, LostForce, SaturatedForce


@pytest.mark.parametrize(("fault", "during"), [
    (LostState(1.0, 0.5), [np.nan, np.nan]), (FrozenState(1.0, 0.5), [7.0, 8.0]),
    (LostForce(1.0, 0.5), [np.nan, np.nan]), (FrozenForce(1.0, 0.5), [7.0, 8.0]),
    (SaturatedForce(1.0, 0.5, largest=1.5), [1.0, 1.5]),
    (JumpedForce(1.0, 0.5, jump=np.array([3.0, -1.0])), [4.0, 1.0])])
def test_a_sensor_measures_something_else_during_its_fault(fault, during):
    true, frozen = np.array([1.0, 2.0]), np.array([7.0, 8.0])
    for time in (0.0, 0.999, 1.5, 9.0):
        np.testing.assert_array_equal(sensed(fault, time, true, frozen), true)
    for time in (1.001, 1.499):
        np.testing.assert_array_equal(sensed(fault, time, true, frozen), during)


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


def test_a_sensor_that_is_frozen_before_the_simulation_begins_holds_what_it_measures_then():
    builder = DiagramBuilder()
    clock = builder.AddSystem(Script(y=lambda t: [t, -t]))
    sensor = FaultySensor.AddToBuilder(
        builder, FrozenState(1.0, 5.0), true=clock.get_output_port())
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    context.SetTime(3.0)

    def measured(context):
        return sensor.GetOutputPort("measured").Eval(sensor.GetMyContextFromRoot(context))

    # Before the initialization is over too, when others are initialized.
    np.testing.assert_array_equal(measured(context), [3.0, -3.0])
    simulator = Simulator(diagram, context)
    simulator.AdvanceTo(3.5)
    clone = Simulator(diagram, context.Clone())
    clone.AdvanceTo(4.0)
    for each in (context, clone.get_context()):
        np.testing.assert_array_equal(measured(each), [3.0, -3.0])


@pytest.mark.parametrize(("fault", "message"), [
    (SaturatedForce(largest=-1.0), r"^largest = -1.0: must be zero or positive"),
    (JumpedForce(jump=np.zeros(3)), r"^jump = .*: must be 6 finite numbers"),
    (LostForce(duration=0.0), r"^duration = 0.0: must be positive"),
    (JumpedForce(start=-1.0), r"^start = -1.0: must be zero or positive")])
def test_a_fault_without_a_meaning_is_one_line(fault, message):
    with pytest.raises(InvalidParameter, match=message):
        fault.check()
