"""Claims of a certificate as data: numbers, the conditions that they need, and assumptions."""

from dataclasses import dataclass, field

import numpy as np

from uvms_drake.certificate.arrival import Arrival
from uvms_drake.certificate.assumptions import Assumption
from uvms_drake.certificate.declared_unknowns import UnknownEffect
from uvms_drake.control.limits import TubeRadii
from uvms_drake.station.contact.bounds import STANDING
from uvms_drake.station.contact.mission_legs import Leg
from uvms_drake.tube.conditions import Condition
from uvms_drake.tube.constants import Constant
from uvms_drake.tube.estimates import Estimate


@dataclass(frozen=True)
class TerminalResult:
    """The terminal ingredients, and the result of their check."""

    radius: float
    """Radius ε of the terminal set."""
    limiting: str
    """Name of the condition with the smallest margin."""
    margins: dict[str, float]
    """Margins by condition, see `terminal_set.TerminalCheck`."""
    samples: int
    """Number of states at which the set was checked."""
    P: np.ndarray
    """Matrix P of the set ‖ξ‖_P ≤ ε (2(6+n), 2(6+n))."""
    gain: np.ndarray
    """Gain of the terminal controller (6+n, 2(6+n))."""


@dataclass(frozen=True)
class Claims:
    """Claims about a scenario's closed loop, and the conditions that they need."""

    scenario: str
    law: str
    k: float
    """Gain k of the velocity error [1/s]."""
    sigma: float
    """Gain σ of the task error [1/s]."""
    d_bound: float
    """Bound d̃ [m/s², rad/s²] of the disturbance."""
    weights: np.ndarray | None = None
    """Bounds of each component of the disturbance over d̃, the diagonal of Ŵ: ‖Ŵ⁻¹d‖₂ ≤ d̃; None
    for a ball."""
    assumptions: tuple[Assumption, ...] = ()
    """Statements that it rests on and does not compute."""
    constants: tuple[Constant, ...] = ()
    conditions: tuple[Condition, ...] = ()
    """Conditions; kind `tightening` has the numbers that tighten limits, proven or estimated."""
    tube: TubeRadii | None = None
    unknowns: tuple[UnknownEffect, ...] = ()
    """Declared unknowns and the acceleration that each causes."""
    budget: dict[str, dict[str, float]] = field(default_factory=dict)
    """Parts of some radii by their source."""
    margin: dict[str, float] = field(default_factory=dict)
    """Smallest limit of each of those radii that has one, the tube being zero."""
    legs: tuple[Leg, ...] = ()
    """The steps of a mission."""
    estimates: tuple[Estimate, ...] = ()
    """Estimated suprema of the tube, with the result of a second search."""
    terminal: TerminalResult | None = None
    arrival: Arrival | None = None
    """Times of the nominal closed loop, of a sensed contact."""
    bounds: dict[str, float] = field(default_factory=dict)
    """Ultimate bounds by name, see `tube.ultimate_bounds`."""

    @property
    def failed(self) -> Condition | None:
        """First condition that does not hold, or None."""
        return next((item for item in self.conditions if not item.holds), None)

    @property
    def certified(self) -> bool:
        """Whether every condition that was checked holds."""
        return bool(self.conditions) and self.failed is None

    @property
    def tightening(self) -> list[Condition]:
        """Conditions whose number tightens a limit, each component of an input being one."""
        return [each for each in self.conditions if each.kind == "tightening" and each.left > 0.0]

    @property
    def hold_condition(self) -> str:
        """The condition of the band of a hold in words; empty if there is none."""
        if self.tube is None or (hold := self.tube.hold) is None:
            return ""
        tip, turn, joints = 1e3 * STANDING
        return (f"the plan at its target, not clipped by `deepest`, and for {hold.time:.2g} s "
                f"slower than {tip:g} mm/s, {turn:g} mrad/s and joints {joints:g} mrad/s")
