"""Parts between plant and controller, one a file; they know neither the one nor the other."""

from uvms_drake.sensing.force_sensor import ForceSensor
from uvms_drake.sensing.navigation import Navigation

AnySensing = Navigation | ForceSensor
"""The parts that a scenario's file may name; the first is the one meant without a tag."""
