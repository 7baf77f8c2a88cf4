"""The simulated robot with water, contact and disturbance; it does not depend on the controller."""

from uvms_drake.common.kinds import offer
from uvms_drake.plant.adversary import AdversarialDisturbance
from uvms_drake.plant.disturbance import (
    ConstantDisturbance,
    Disturbance,
    RandomDisturbance,
    SinusoidalDisturbance,
)

offer(Disturbance, SinusoidalDisturbance, ConstantDisturbance, RandomDisturbance,
      AdversarialDisturbance)
