"""The paper's assumption about the contact: the controller knows the surface."""

from dataclasses import dataclass

from uvms_drake.model.surface.law import Surface
from uvms_drake.station.contact.contact import Contact


@dataclass
class KnownSurface(Contact):
    """Contact with a known surface: the controller has the `surface` of the scenario."""

    def controller_surface(self, surface: Surface) -> Surface:
        """Returns the surface of the nominal model: the scenario's."""
        return surface
