"""The paper's assumption about the contact: the controller knows the surface."""

from dataclasses import dataclass
from typing import ClassVar

from uvms_drake.model.surface.law import Surface


@dataclass
class KnownSurface:
    """Contact with a known surface: the controller has the `surface` of the scenario."""

    is_sensed: ClassVar[bool] = False
    """Whether the surface is unknown and the force sensed."""

    def controller_surface(self, surface: Surface) -> Surface:
        """Returns the surface of the controller's model: the scenario's."""
        return surface
