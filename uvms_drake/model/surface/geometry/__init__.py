"""Shapes of surfaces, and the list of those that a scenario can name."""

from uvms_drake.common.kinds import offer
from uvms_drake.model.surface.geometry.cylinder import Cylinder
from uvms_drake.model.surface.geometry.geometry import Geometry
from uvms_drake.model.surface.geometry.relief import Bead, Bumpy, Plane

__all__ = ["Bead", "Bumpy", "Cylinder", "Geometry", "Plane"]

offer(Geometry, Plane, Cylinder, Bumpy, Bead)
