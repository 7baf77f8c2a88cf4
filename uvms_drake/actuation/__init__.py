"""Parts between controller and plant, one a file; they know neither the one nor the other."""

from uvms_drake.actuation.thrusters import Thrusters
from uvms_drake.actuation.zero_order_hold import ZeroOrderHold

AnyActuation = ZeroOrderHold | Thrusters
"""The parts that a scenario's file may name."""
