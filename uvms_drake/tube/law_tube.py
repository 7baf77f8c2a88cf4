"""Tube of an ancillary law, and the data that it is computed from."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from uvms_drake.control.limits import TubeRadii
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.tube.conditions import Condition
from uvms_drake.tube.constants.constants import Constant
from uvms_drake.tube.contact.hold import HoldLaw
from uvms_drake.tube.contact.sensor_error import MeasuredForceBounds
from uvms_drake.tube.contact.uneven_motion import TipAcceleration
from uvms_drake.tube.loops.actuator_path import Actuators
from uvms_drake.tube.search.constraint_set import ConstraintSet
from uvms_drake.tube.search.estimate import Check, no_estimates
from uvms_drake.tube.settings import CertificateSettings

PROVEN = {"task": "Jx_max", "position": "J_position_max", "orientation": "J_attitude_max"}
"""Constants that decide the tube of `resolved` in a ball of disturbances, by block of rows."""
WEIGHTED = {name: name.replace("_max", "_W_max") for name in PROVEN.values()}
"""Constants of J_xŴ by those of J_x: they decide where Ŵ is not I."""


@dataclass(frozen=True)
class Basis:
    """Data that the tube of a law is computed from, besides the law."""

    model: ContactModel
    """The prediction model."""
    declared: ConstraintSet
    """Set that the constants are suprema over: the limits of the real robot."""
    constants: dict[str, Constant]
    """Constants by name."""
    d_bound: float
    """Bound d̃ of ‖Ŵ⁻¹d‖₂, and so of ‖d‖₂; with kinematic motion w̃ of ‖w‖₂."""
    weights: np.ndarray
    """Diagonal of Ŵ, one for each component of the disturbance, the largest 1."""
    u_limit: np.ndarray
    """Limits of |uᵢ| (6+n,); empty with kinematic motion."""
    settings: CertificateSettings
    """Numbers of samples, safety factor and seed."""
    contact: MeasuredForceBounds | None = None
    """Forces of a sensed contact, which are not in the model."""
    largest_rate: np.ndarray | float = np.inf
    """Bounds of |ζ̄̇ᵢ| of a plan (6+n,): those by |ūᵢ| alone are far too large for light joints."""
    actuators: Actuators = field(default_factory=Actuators)
    """Clocks, dead times and lags between the law and the robot."""
    time_step: float = np.inf
    """Time step of a plan, over which ζ̄̇ is constant [s]."""
    forces: bool = False
    """True if forces are limited, so that the tube in τ is needed."""

    def value(self, name: str) -> float:
        """Returns a constant."""
        return self.constants[name].value

    def row_norm(self, block: str) -> float:
        """Returns the bound of ‖J_bŴ‖ of a block of rows, a key of `PROVEN`."""
        name = PROVEN[block]
        return self.value(name if np.all(self.weights == 1.0) else WEIGHTED[name])


class LawTube(NamedTuple):
    """Tube of a law, with its conditions."""

    radii: TubeRadii
    conditions: tuple[Condition, ...]
    budget: Mapping[str, Mapping[str, float]] = MappingProxyType({})
    """Error budget: parts of radii by their source."""
    estimated: tuple[str, ...] = ()
    """Names of the radii that depend on estimates; the others are proven."""
    check: Check = no_estimates
    """Function that returns the estimates, each with the result of a second search."""
    hold: HoldLaw | None = None
    """Radii for the forces of a hold; None: unknown."""
    along: TipAcceleration | None = None
    """Acceleration of the tip along n in a sensed contact; None: unknown."""
