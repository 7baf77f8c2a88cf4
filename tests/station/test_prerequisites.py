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
    for port in inputs:
        port.FixValue(context, np.full(port.size(), 0.1))

    def news():
        """Returns which outputs are made at a look at all of them."""
        made.clear()
        for i in range(system.num_output_ports()):
            system.get_output_port(i).Eval(context)
        return set(made)

    everything = news()
    assert len(everything) == system.num_output_ports()
    context.SetTime(1.0)
    assert news() == set()
    for port in inputs:
        port.FixValue(context, np.full(port.size(), 0.2))
        assert news() == everything
