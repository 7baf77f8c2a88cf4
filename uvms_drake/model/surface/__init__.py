"""Surfaces to press on, one a file, and the list of those that a scenario can name."""

from uvms_drake.model.surface.known_surface import KnownSurface
from uvms_drake.model.surface.plane import UnilateralPlane
from uvms_drake.model.surface.sensed_contact import SensedContact
from uvms_drake.model.surface.shaped_surface import ShapedSurface
from uvms_drake.model.surface.spring import BilateralSpring

__all__ = ["AnyContact", "AnySurface", "BilateralSpring", "KnownSurface", "SensedContact",
           "ShapedSurface", "UnilateralPlane"]

AnySurface = UnilateralPlane | BilateralSpring | ShapedSurface
"""Surfaces that a file may name by tag; the first is the default."""

AnyContact = KnownSurface | SensedContact
"""Specifications of the contact by tag; the first is the default."""
