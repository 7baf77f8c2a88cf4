"""Committed horizon: the part of a plan that is no longer free, as its forces have been commanded.

A law that commands the plan's forces ℓ in advance (`feedforward_preview`) has, until the next
sample t_{i+1}, committed the actuators up to t_{i+1} + ℓ. So with n = ⌈ℓ/h⌉

    plan i on [t_i, t_i + nh]  =  plan i − 1 there;    free on the N intervals from t_i + nh on,

and the problem is the one without actuation delay, from the state at t_i + nh. No command that was
issued changes, and every problem is feasible if it was so without: proofs in
control/plan/theory.md#committed-horizon. Before the first plan the robot coasts; at rest it hovers.
The price is that a measurement changes the motion nh later. None of this holds for problems that
start at the measured state.
"""

import math

from uvms_drake.control.laws.law import AncillaryLaw
from uvms_drake.control.plan.plan import KNOT_TOLERANCE
from uvms_drake.model.signals.command_path import CommandPath


def committed_intervals(law: AncillaryLaw, command_path: CommandPath, time_step: float) -> int:
    """Returns n; zero for a law without feedforward preview.

    Args:
        law: The law.
        command_path: Path of the commands, with ℓ as its `preview`.
        time_step: h [s].
    """
    if not law.takes_wrench:
        return 0
    return math.ceil(max(command_path.preview) / time_step - KNOT_TOLERANCE)
