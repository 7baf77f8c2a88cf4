"""Sensors, their errors and faults, one a file; independent of plant and controller."""

from uvms_drake.sensing.force_sensor import ForceSensor
from uvms_drake.sensing.navigation import Navigation

AnySensing = Navigation | ForceSensor
"""Sensors of a scenario's file; the first is the default without a tag."""
