"""Signals that are functions of time, and the outputs of a monitor for them."""

import numpy as np
from pydrake.systems.analysis import ResetIntegratorFromFlags
from pydrake.systems.framework import LeafSystem

from uvms_drake.control.feedback.tube_monitor import TUBE_REPORT


class Script(LeafSystem):
    """Puts out state, nominal state and disturbance as functions of time."""

    def __init__(self, **signals):
        super().__init__()
        for name, signal in signals.items():
            self.DeclareVectorOutputPort(
                name, len(signal(0.0)),
                lambda context, output, signal=signal: output.SetFromVector(
                    signal(context.get_time())), {self.time_ticket()})


def report_of(monitor, context) -> dict[str, float]:
    values = monitor.GetOutputPort("report").Eval(context)
    assert not np.any(np.isnan(values))
    return dict(zip(TUBE_REPORT, values, strict=True))


def use_fixed_steps(simulator):
    ResetIntegratorFromFlags(simulator, "runge_kutta3", 2e-3)
    simulator.get_mutable_integrator().set_fixed_step_mode(True)
