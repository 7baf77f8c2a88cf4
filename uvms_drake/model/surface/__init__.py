"""Surfaces to press on, one a file, and the list of those that a scenario can name."""

from uvms_drake.common.kinds import offer
from uvms_drake.model.surface.known_surface import KnownSurface
from uvms_drake.model.surface.law import Surface
from uvms_drake.model.surface.plane import UnilateralPlane
from uvms_drake.model.surface.sensed_contact import SensedContact
from uvms_drake.model.surface.shaped_surface import ShapedSurface
from uvms_drake.model.surface.spring import BilateralSpring

__all__ = ["AnyContact", "BilateralSpring", "KnownSurface", "SensedContact", "ShapedSurface",
           "Surface", "UnilateralPlane"]

offer(Surface, UnilateralPlane, BilateralSpring, ShapedSurface)

AnyContact = KnownSurface | SensedContact
"""Specifications of the contact by tag; the first is the default."""
