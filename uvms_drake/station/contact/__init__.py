"""Kinds of contact that a scenario can name, one a file."""

from uvms_drake.common.kinds import offer
from uvms_drake.station.contact.contact import Contact
from uvms_drake.station.contact.known_surface import KnownSurface
from uvms_drake.station.contact.sensed_contact import SensedContact

__all__ = ["Contact", "KnownSurface", "SensedContact"]

offer(Contact, KnownSurface, SensedContact)
