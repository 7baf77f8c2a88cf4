"""The part of a plan that is no longer free, because its forces have been asked for.

A law that asks for the plan's forces ℓ ahead (`ahead`) has, until the next sample t_{i+1}, told the
actuators what it means to give until t_{i+1} + ℓ. So with n = ⌈ℓ/h⌉ the first n intervals of a plan
are committed:

    plan i on [t_i, t_i + nh]  =  plan i − 1 there;    free on the N intervals from t_i + nh on,

and the problem is the one without late actuators, from the state at t_i + nh.

*Nothing that was asked for changes.* What is asked for from t_i to t_{i+1} is of plan i until
t_{i+1} + ℓ ≤ t_{i+1} + nh, which plan i + 1 keeps; also where a sample failed, was dropped, or went
to another force. So τ̄(t + ℓ), as it is asked for at t, is what the plan then followed has at t + ℓ:
one trajectory is late, not one after another.

*Every problem is feasible* if it was so without: the end of plan i after t_{i+1} + nh, continued by
the terminal controller, begins where problem i + 1 does, and keeps its limits as in `tracking_ocp`.
The limits of the committed part are not looked at again. They held for it when it was free: what
lasts does so still, and a front that moves loses nothing where the plan goes (`front.replaces`),
all of whose knots count, the committed ones too (`PlanExtent`). And as it is said there, the cost
of the free part falls by h‖ξ‖²_Q of its first knot: it goes where it is asked to, nh later.

*Before the first plan* nothing was planned. There the robot coasts; at rest it hovers. That it does
so within its limits is assumed of the start, and not looked at.

*Its price* is that what is measured changes the motion nh later. Pressing bears that, whatever n
(`contact.target`). And problems that start at the measured state move the committed part with it:
nothing of the above holds for these.
"""

import math

from uvms_drake.control.laws.law import AncillaryLaw
from uvms_drake.control.plan.plan import KNOT_TOLERANCE
from uvms_drake.model.sensor_actuator import ActuationDelay


def committed_intervals(law: AncillaryLaw, actuation_delay: ActuationDelay, time_step: float) -> int:
    """Returns n; zero for a law that asks for nothing ahead.

    Args:
        law: The law.
        actuation_delay: ℓ of the vehicle and of the joints [s].
        time_step: h [s].
    """
    return math.ceil(max(actuation_delay) / time_step - KNOT_TOLERANCE) if law.takes_wrench else 0
