"""Parts between plant and controller, one a file; they know neither the one nor the other."""

from uvms_drake.sensing.force_sensor import ForceSensor
from uvms_drake.sensing.sampled_state import SampledState

AnySensing = SampledState | ForceSensor
"""The parts that a scenario's file may name; the first is the one meant without a tag."""
