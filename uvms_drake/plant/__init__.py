"""The simulated robot with water, contact and disturbance; it does not depend on the controller."""

from uvms_drake.plant.adversary import AdversarialDisturbance
from uvms_drake.plant.disturbance import (
    ConstantDisturbance,
    RandomDisturbance,
    SinusoidalDisturbance,
)

AnyDisturbance = (
    SinusoidalDisturbance | ConstantDisturbance | RandomDisturbance | AdversarialDisturbance)
"""Disturbances that a scenario's file may name; the first is the default tag."""
