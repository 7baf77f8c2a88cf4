"""Surfaces to press on, one a file, and the list of those that a scenario can name."""

from uvms_drake.common.kinds import offer
from uvms_drake.model.surface.contact_laws import Bilinear, Hardening, Linear, plane_load
from uvms_drake.model.surface.geometry import Bead, Bumpy, Cylinder, Geometry, Plane
from uvms_drake.model.surface.law import NotOffered, StaticForceRows, Surface, TipErrors
from uvms_drake.model.surface.plane import UnilateralPlane
from uvms_drake.model.surface.shaped_surface import ShapedSurface
from uvms_drake.model.surface.spring import BilateralSpring

__all__ = ["Bead", "BilateralSpring", "Bilinear", "Bumpy", "Cylinder", "Geometry",
           "Hardening", "Linear", "NotOffered", "Plane", "ShapedSurface", "StaticForceRows",
           "Surface", "TipErrors", "UnilateralPlane", "plane_load"]

offer(Surface, UnilateralPlane, BilateralSpring, ShapedSurface)
