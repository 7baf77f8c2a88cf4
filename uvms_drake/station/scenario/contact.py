"""Kinds of contact between end-effector and surface, with their settings in a scenario."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import numpy as np

from uvms_drake.common.errors import within
from uvms_drake.common.kinds import offer
from uvms_drake.control.limits import Limit, Limits
from uvms_drake.control.limits.pose import ToolAngle
from uvms_drake.control.limits.speeds import ContactSpeed
from uvms_drake.model.surface.law import Surface
from uvms_drake.model.surface.unknown_contact import UnknownContact, UnknownSurface


class Contact(ABC):
    """Kind of contact: a dataclass, whose fields are its settings in a scenario's file.

    It has the surface of the nominal model. By default the surface is known: the controller's model
    has its force, and a further desired force has a problem of its own.
    """

    @abstractmethod
    def controller_surface(self, surface: Surface) -> Surface:
        """Returns the surface of the nominal model, for the scenario's surface."""

    def declared_wall(self) -> "SensedContact | None":
        """Returns the declared bounds of an unknown wall, checked; None: the surface is known."""
        return None

    def limits(self) -> list[Limit]:
        """Returns the limits that the contact adds to those of the scenario."""
        return []

    def force_limit(self, limits: Limits) -> float | None:
        """Returns the largest static force of the plans and their tube [N]; None: not limited."""
        return limits.static_force

    def takes_static_force(self, surface: Surface) -> bool:
        """Returns whether `limits.static_force` can limit the force on the scenario's surface."""
        return type(surface).static_force_rows is not Surface.static_force_rows

    def force_in_law(self, logs: Mapping[str, np.ndarray]) -> np.ndarray | None:
        """Returns the force 𝔉 (T, 6) that the law should take in place of the model's, if any."""
        return logs.get("force_last_valid")


@dataclass
class KnownSurface(Contact):
    """Contact with a known surface, as in the paper: the controller has that of the scenario."""

    def controller_surface(self, surface: Surface) -> Surface:
        """Returns the surface of the nominal model: the scenario's."""
        return surface


@dataclass
class SensedContact(UnknownContact, Contact):
    """Contact with a measured force; place and stiffness of the wall are unknown."""

    def controller_surface(self, surface: Surface) -> UnknownSurface:
        """Returns free water, for any true surface."""
        return UnknownSurface(self)

    def declared_wall(self) -> Self:
        """Returns the declared bounds of wall, forces and readings, checked."""
        with within("contact"):
            return self.checked()

    def limits(self) -> list[Limit]:
        """Returns the limits of the tip's velocity and of the tool's angle."""
        contact = self.declared_wall()
        return [ContactSpeed(contact.walls.axes, contact.speed, contact.speed_across),
                ToolAngle(contact.direction, contact.tool_angle)]

    def force_limit(self, limits: Limits) -> float:
        """Returns the declared largest static force [N]."""
        return self.force

    def takes_static_force(self, surface: Surface) -> bool:
        """Returns that `limits.static_force` is left out: `force` limits it."""
        return False

    def force_in_law(self, logs: Mapping[str, np.ndarray]) -> np.ndarray:
        """Returns the true force (T, 6): the errors of its measurement count as a disturbance."""
        return logs["force"]


offer(Contact, KnownSurface, SensedContact)
