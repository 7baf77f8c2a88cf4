"""Sensors, their errors and faults, one a file; independent of plant and controller."""

from uvms_drake.common.kinds import offer
from uvms_drake.model.signals.sensor_actuator import Sensor
from uvms_drake.sensing.force_sensor import ForceSensor
from uvms_drake.sensing.navigation import Channel, Dvl, Navigation

__all__ = ["Channel", "Dvl", "ForceSensor", "Navigation", "Sensor"]

offer(Sensor, Navigation, ForceSensor)
