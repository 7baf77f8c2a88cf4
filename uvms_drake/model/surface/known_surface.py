"""The paper's assumption about the contact: the controller knows the surface."""

from dataclasses import dataclass
from typing import ClassVar

from uvms_drake.model.surface.law import Surface


@dataclass
class KnownSurface:
    """The controller knows the `surface` of the scenario, where it is and how it yields."""

    is_sensed: ClassVar[bool] = False
    """Whether the controller goes by the force that it feels."""

    def controller_surface(self, surface: Surface) -> Surface:
        """Returns the surface of the controller's model: the scenario's."""
        return surface
