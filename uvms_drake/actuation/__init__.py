"""Parts between controller and plant, one a file; they know neither the one nor the other."""

from uvms_drake.actuation.lagged_wrench import LaggedWrench
from uvms_drake.actuation.sampled_command import SampledCommand
from uvms_drake.actuation.thrusters import Thrusters

AnyActuation = SampledCommand | Thrusters | LaggedWrench
"""The parts that a scenario's file may name."""
