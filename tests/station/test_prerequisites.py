"""Outputs say what they depend on: neither are they stale, nor made anew as time goes by."""

import numpy as np
import pytest
from pydrake.systems.framework import LeafSystem

from uvms_drake.control.contact.contact_estimator import ContactEstimator
from uvms_drake.control.contact.contact_state import EstimatorSettings
from uvms_drake.control.contact.desired_force import DesiredForce
from uvms_drake.control.contact.press_target import PressTarget
from uvms_drake.model.surface.surface_class import SurfaceClass
from uvms_drake.sensing.measurements import HoldLastValue

N = np.array([1.0, 0.0, 0.0])
MADE = {
    "desired_force": lambda model: DesiredForce(N, 5.0, 20.0),
    "target": lambda model: PressTarget(N, np.zeros(3)),
    "front": lambda model: ContactEstimator(
        model, SurfaceClass(), EstimatorSettings(45.0, 1.0), margin=0.01),
    "hold_last_value": lambda model: HoldLastValue(6),
}


@pytest.mark.parametrize("name", MADE)
def test_outputs_follow_every_input_and_not_the_time(model, monkeypatch, name):
    made, declare = [], LeafSystem.DeclareVectorOutputPort

    def counting(system, port, size, calc, *prerequisites):
        def counted(context, output):
            made.append(port)
            calc(context, output)
        return declare(system, port, size, counted, *prerequisites)

    monkeypatch.setattr(LeafSystem, "DeclareVectorOutputPort", counting)
    system = MADE[name](model)
    context = system.CreateDefaultContext()
    inputs = [system.get_input_port(i) for i in range(system.num_input_ports())]
    values = [np.full(port.size(), 0.1) for port in inputs]
    for port, value in zip(inputs, values, strict=True):
        port.FixValue(context, value)

    def outputs(context):
        return [system.get_output_port(i).Eval(context) for i in range(system.num_output_ports())]

    def news():
        """Returns which outputs are made at a look at all of them."""
        made.clear()
        outputs(context)
        return set(made)

    everything = news()
    assert len(everything) == system.num_output_ports()
    context.SetTime(1.0)
    assert news() == set()
    for i, port in enumerate(inputs):
        values[i] = np.full(port.size(), 0.2)
        port.FixValue(context, values[i])
        assert news() == everything
        fresh = system.CreateDefaultContext()  # Nothing is kept there from other inputs.
        for each, value in zip(inputs, values, strict=True):
            each.FixValue(fresh, value)
        for found, expected in zip(outputs(context), outputs(fresh), strict=True):
            np.testing.assert_array_equal(found, expected)
