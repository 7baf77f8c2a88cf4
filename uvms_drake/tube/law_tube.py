"""Tube of an ancillary law, and the data that it is computed from."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import NamedTuple, TypeVar

import numpy as np

from uvms_drake.control.laws.law import AncillaryLaw
from uvms_drake.control.limits import TubeRadii
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.signals.command_path import IDEAL_PATH, CommandPath
from uvms_drake.tube.conditions import Condition
from uvms_drake.tube.constants import Constant, estimate_constants
from uvms_drake.tube.contact.hold import HoldLaw
from uvms_drake.tube.contact.sensor_error import MeasuredForceBounds
from uvms_drake.tube.contact.tip_motion import TipAcceleration
from uvms_drake.tube.covering import prove_constants
from uvms_drake.tube.estimates import CertificateSettings, Check, no_estimates
from uvms_drake.tube.search.constraint_set import ConstraintSet

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
    """Bound d̃ of ‖Ŵ⁻¹d‖₂, and so of ‖d‖₂."""
    weights: np.ndarray
    """Diagonal of Ŵ, one for each component of the disturbance, the largest 1."""
    u_limit: np.ndarray
    """Limits of |uᵢ| (6+n,)."""
    settings: CertificateSettings
    """Numbers of samples, safety factor and seed."""
    contact: MeasuredForceBounds | None = None
    """Forces of a sensed contact, which are not in the model."""
    largest_rate: np.ndarray | float = np.inf
    """Bounds of |ζ̄̇ᵢ| of a plan (6+n,): those by |ūᵢ| alone are far too large for light joints."""
    command_path: CommandPath = IDEAL_PATH
    """Path of the commands from the law to the robot."""
    forces: bool = False
    """True if forces are limited, so that the tube in τ is needed."""

    def value(self, name: str) -> float:
        """Returns a constant."""
        return self.constants[name].value

    def row_norm(self, block: str) -> float:
        """Returns the bound of ‖J_bŴ‖ of a block of rows, a key of `PROVEN`."""
        name = PROVEN[block]
        return self.value(name if np.all(self.weights == 1.0) else WEIGHTED[name])


def constants_of(names: tuple[str, ...], model: ContactModel, declared: ConstraintSet,
                 weights: np.ndarray, settings: CertificateSettings) -> dict[str, Constant]:
    """Returns constants by name; those that decide the tube of `resolved` are proven.

    Args:
        names: Names of the constants.
        model: The prediction model.
        declared: Set of the suprema.
        weights: Diagonal of Ŵ, see `Basis`.
        settings: Effort of the searches.
    """
    ball = bool(np.all(weights == 1.0))
    norms = {name if ball else WEIGHTED[name]: name for name in PROVEN.values()}
    proven = prove_constants(
        model, declared, tuple(norms[name] for name in names if name in norms),
        seed=settings.seed, weights=weights)
    estimated = estimate_constants(
        model, declared, tuple(name for name in names if name not in norms),
        samples=settings.constant_samples, safety_factor=settings.safety_factor,
        seed=settings.seed)
    return estimated | {name: replace(proven[plain], name=name)
                        for name, plain in norms.items() if plain in proven}


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


@dataclass(frozen=True)
class LawTheory:
    """Theory of a law's tube: a function of the law and a `Basis`, and the constants it needs."""

    tube: Callable[..., LawTube]
    """Function from a law and a `Basis` to a `LawTube`."""
    constants: Callable[..., tuple[str, ...]]
    """Function from a law and the diagonal of Ŵ to the names of the constants in the `Basis`."""


def no_constants(law: AncillaryLaw, weights: np.ndarray) -> tuple[str, ...]:
    """Returns the names of the constants of a tube that needs none."""
    return ()


TUBES: dict[type[AncillaryLaw], LawTheory] = {}
"""Theories of the laws that have a tube on the dynamics ζ̇ = f(𝔮, ζ) + u + d, ‖Ŵ⁻¹d‖₂ ≤ d̃, by the
law's exact type: a proof for one law is none for one derived from it."""
TubeFunction = TypeVar("TubeFunction", bound=Callable[..., LawTube])


def register_tube(law: type[AncillaryLaw],
                  constants: Callable[..., tuple[str, ...]] = no_constants
                  ) -> Callable[[TubeFunction], TubeFunction]:
    """Registers a function as the tube of a law, so that the law has a certificate; a decorator.

    ::

        @uv.tubes.register_tube(SlowLaw, constants=lambda law, weights: ("Jx_max",))
        def slow_law_tube(law: SlowLaw, basis: uv.tubes.Basis) -> uv.tubes.LawTube:
            ...

    Args:
        law: The law; the tube is that of this very type.
        constants: Function from a law and the diagonal of Ŵ to the names of the constants that the
            tube needs, of `tube.constants`: the certificate searches for these alone.
    """
    def registered(tube: TubeFunction) -> TubeFunction:
        TUBES[law] = LawTheory(tube, constants)
        return tube

    return registered
