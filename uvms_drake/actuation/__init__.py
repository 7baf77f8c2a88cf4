"""Actuators, their delays and faults; independent of controller and plant."""

from uvms_drake.actuation.ideal import IdealWrench, SampledCommand
from uvms_drake.actuation.thrusters import Thrusters
from uvms_drake.common.kinds import offer
from uvms_drake.model.signals.sensor_actuator import Actuator

__all__ = ["Actuator", "IdealWrench", "SampledCommand", "Thrusters"]

offer(Actuator, SampledCommand, Thrusters, IdealWrench)
