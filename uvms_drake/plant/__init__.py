"""The simulated robot in water, contact and disturbance; it does not know the controller."""

from uvms_drake.plant.adversary import AdversarialDisturbance
from uvms_drake.plant.disturbance import (
    ConstantDisturbance,
    RandomDisturbance,
    SinusoidalDisturbance,
)

AnyDisturbance = (
    SinusoidalDisturbance | ConstantDisturbance | RandomDisturbance | AdversarialDisturbance)
"""The disturbances that a scenario's file may name; the first is the one meant without a tag."""
