"""Actuators, their delays and faults, one a file; independent of controller and plant."""

from uvms_drake.actuation.ideal_wrench import IdealWrench
from uvms_drake.actuation.lagged_wrench import LaggedWrench
from uvms_drake.actuation.sampled_command import SampledCommand
from uvms_drake.actuation.thrusters import Thrusters
from uvms_drake.common.kinds import offer
from uvms_drake.model.signals.sensor_actuator import Actuator

__all__ = ["Actuator", "IdealWrench", "LaggedWrench", "SampledCommand", "Thrusters"]

offer(Actuator, SampledCommand, Thrusters, LaggedWrench, IdealWrench)
