"""Shapes of surfaces, one a file, and the list of those that a scenario can name."""

from uvms_drake.model.surface.geometry.bead import Bead
from uvms_drake.model.surface.geometry.bumpy import Bumpy
from uvms_drake.model.surface.geometry.cylinder import Cylinder
from uvms_drake.model.surface.geometry.plane import Plane

__all__ = ["AnyGeometry", "Bead", "Bumpy", "Cylinder", "Plane"]

AnyGeometry = Plane | Cylinder | Bumpy | Bead
"""Shapes that a file may name by tag; the first is the default."""
