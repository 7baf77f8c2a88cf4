"""What is pressed: one surface, one file. A further one is a `Surface` and a name in this line."""

from uvms_drake.model.surface.plane import UnilateralPlane
from uvms_drake.model.surface.spring import BilateralSpring

ScenarioSurface = UnilateralPlane | BilateralSpring
"""Surfaces that a file may name by tag; the first is the one meant if there is none."""
