"""Declared data of a contact with a wall of unknown place and stiffness, and its nominal surface.

The wall is one of a `SurfaceClass`. The law adds the *measured* force to its inverse dynamics, so
the wall drops out of the error dynamics, and the nominal model is that of free water
(`UnknownSurface`).
"""

from dataclasses import dataclass, field
from typing import Annotated, Self

import numpy as np

from uvms_drake.common.constraints import AtMost, Between, NotNegative, Period, Positive, UnitVector
from uvms_drake.common.errors import InvalidParameter, require
from uvms_drake.common.schema import checked
from uvms_drake.model.surface.law import Surface, TipErrors
from uvms_drake.model.surface.surface_class import SurfaceClass

STEEPEST = 0.45
"""Largest `angle` that is accepted [rad]; the search of a wall needs tan α < 0.5, see
control/contact/theory.md#search-before-contact, a task far less."""
MOST_ASLANT = 0.5
"""Largest `tool_angle` that is accepted [rad]."""


@dataclass
class HoldForces:
    """Bounds of the force apart from the size of its normal part, in a hold."""

    force_rate: float = 40.0
    """Largest rate, like `contact.force_rate` [N/s]."""
    force_ripple: float = 2.0
    """Bound of the part that may change at any rate, like `contact.force_ripple` [N]."""


@dataclass
class UnknownContact:
    """Declared bounds of a contact: class of the wall, forces, speeds, and error of a reading."""

    direction: Annotated[np.ndarray, UnitVector] = field(
        default_factory=lambda: np.array([1.0, 0.0, 0.0]))
    """Direction n into the wall (3,), a unit vector in Σ_I."""
    angle: Annotated[float, Between(0, STEEPEST, " rad")] = 0.0873
    """Angle α by which the wall's inward normal may differ from `direction` [rad]."""
    stiffness: Annotated[float, Positive] = 1000.0
    """Largest stiffness κ₊ of tool and wall together [N/m]."""
    force: Annotated[float, Positive] = 45.0
    """Largest static normal force F_max that the tip may exert [N]."""
    dissipation: Annotated[float, NotNegative] = 2.5
    """Largest dissipation c₊ of the wall (Hunt and Crossley) [s/m]."""
    friction: Annotated[float, NotNegative] = 0.5
    """Largest coefficient of friction μ."""
    force_rate: Annotated[float, NotNegative] = 40.0
    """Largest rate of the force apart from the size of its normal part along `direction` [N/s]:
    friction that turns with the motion, a normal that turns along the path."""
    force_ripple: Annotated[float, NotNegative] = 2.0
    """Bound of the part of it that may change at any rate [N]."""
    force_error: Annotated[float, Positive] = 4.2
    """Bound ν of the error of a reading of the force, in norm, without that of `delay` [N]."""
    force_line: Annotated[float, Positive] | None = None
    """Largest error of the normal force at the end of a hold that is no failure of a drawn run [N];
    None: a tenth of the force, or the error of the sensor, whichever is larger."""
    delay: Annotated[float, NotNegative] = 0.11
    """Largest age of the force in a reading [s]: five lags and a period of the sensor."""
    period: Annotated[float, Period] = 0.01
    """Sampling period of the measured force [s]."""
    tangential_lag: Annotated[float, NotNegative] = 0.0
    """Time constant with which the law follows the measured force across `direction` [s]; zero, and
    it takes it as it is read. A sampled law cancels friction with a delay, which makes the tip
    heavier by that delay times the slope of friction. No proof covers one."""
    speed: Annotated[float, Positive] = 0.1
    """Largest speed of the tip along `direction`, either way [m/s]."""
    speed_across: Annotated[float, Positive] = 0.15
    """Largest speed of the tip along each of two directions across it [m/s]."""
    clearance: Annotated[float, NotNegative] = 0.075
    """Free distance in front of the tip at the start, while the sensor is tared [m]."""
    tool_angle: Annotated[float, Positive, AtMost(MOST_ASLANT)] = 0.25
    """Largest angle between the tool's axis and `direction` [rad]."""
    hold: HoldForces | None = None
    """Smaller bounds in a hold, of a tip that does not slide; None: those of any motion."""

    @property
    def hold_forces(self) -> HoldForces:
        """Bounds in a hold, declared or not."""
        return self.hold or HoldForces(self.force_rate, self.force_ripple)

    @property
    def walls(self) -> SurfaceClass:
        """The class of walls, of which this may be any."""
        return SurfaceClass(direction=self.direction, stiffness=self.stiffness, angle=self.angle,
                            dissipation=self.dissipation, friction=self.friction)

    @property
    def largest_advance(self) -> float:
        """Largest ⟨𝔭̇⟩ of the tip, its speed of advance [m/s]."""
        return self.speed + self.walls.tilt * float(np.sqrt(2.0)) * self.speed_across

    @property
    def slope(self) -> float:
        """Largest change of φ with the position of the tip, κ₊ / cos α [N/m]."""
        return self.stiffness / float(np.cos(self.angle))

    def check(self) -> None:
        """Raises `InvalidParameter` for bounds in a hold that are larger than those of motion."""
        for key, declared in vars(self.hold_forces).items():
            require(0.0 <= declared <= getattr(self, key), f"hold.{key}", declared,
                    f"zero or positive, up to contact.{key}")

    def checked(self) -> Self:
        """Returns it with arrays, or raises."""
        return checked(self)

    def wrench(self, force: float) -> np.ndarray:
        """Returns 𝔉 (6,) that presses along n with a force [N]."""
        return np.concatenate([force * np.asarray(self.direction, dtype=float), np.zeros(3)])

    def band(self, force: float, off: TipErrors, recedes: float = 0.0, short: float = 0.0
             ) -> float:
        """Returns the largest |n·𝐅 − F| of a tip whose plan steers for F [N]; inf if none is.

        With E = E_n + αE_t, d = c₊s < 1 at the speed s = Ė_n + α(Ė_t + 2v) of tip and wall, W the
        delay, D = 2αvW, c = 1/(a₋(1 − d)) and a± the least and largest shares, it is

            b(ℓ) = (1 + d) a₊ max(c(F + ν + κ₊(E + ℓ)) + κ₊ min(sW, 2E + D),
                                  c(F + ν) + κ₊(2E + min(sW, D))) − F,

        the largest over all estimates of the stiffness in [0, κ₊] and all errors of the tip in its
        tube at the reading and now: model/surface/theory.md#force-band-of-a-sensed-contact.
        ℓ = |n·𝔪| + α‖P_t 𝔪‖ of a plan that is short of its target by 𝔪: zero in a hold at the
        target.

        Args:
            force: F [N].
            off: The tube of the tip.
            recedes: v [m/s].
            short: ℓ [m].
        """
        tilt = self.walls.tilt
        E = off.depth + tilt * off.position
        apart = 2.0 * tilt * recedes
        s = off.depth_speed + tilt * off.speed + apart
        d, least, most = self.dissipation * s, self.walls.share, self.walls.largest_share
        if d >= 1.0 or least <= 0.0:
            return float(np.inf)
        before, drift = (force + self.force_error) / (least * (1.0 - d)), apart * self.delay
        # Errors E at the reading and now, by an estimate κ₊; −E at the reading, by one of zero.
        stiff = (E + short) / (least * (1.0 - d)) + min(s * self.delay, 2.0 * E + drift)
        soft = 2.0 * E + min(s * self.delay, drift)
        static = before + self.stiffness * max(stiff, soft)
        return float((1.0 + d) * most * static - force)

    def peak(self, force: float, speed: float) -> float:
        """Returns the largest normal force φ (1 + c₊ δ̇) at φ ≤ `force` [N], δ̇ ≤ `speed` [m/s]."""
        return force * (1.0 + self.dissipation * speed)


class UnknownSurface(Surface):
    """Wall of an `UnknownContact` in the controller's model: free water everywhere.

    Args:
        contact: The declared contact.
    """

    exerts_force = False

    def __init__(self, contact: UnknownContact):
        self.contact = contact.checked()

    def __repr__(self) -> str:
        return f"UnknownSurface({self.contact!r})"

    @property
    def anchor(self) -> np.ndarray:
        """The origin: the position of the wall is unknown."""
        return np.zeros(3)

    @property
    def stiffness_bound(self) -> float:
        """Largest change of φ with the position [N/m]."""
        return self.contact.slope

    def force(self, chi: np.ndarray, chi_dot: np.ndarray) -> np.ndarray:
        """Returns zeros (..., 6): the law adds the measured force itself."""
        return np.zeros_like(chi)

    def penetration(self, chi: np.ndarray) -> np.ndarray:
        """Returns zeros (...)."""
        return np.zeros_like(chi[..., 0])

    def pose_for(self, force: np.ndarray, pose: np.ndarray | None) -> np.ndarray:
        """Returns `pose`: place on the wall and attitude of the tool, without the depth.

        𝔉_des must press along n with no more than the largest force, without torque.
        """
        if pose is None:
            raise InvalidParameter("pose", pose, "given: a wall leaves five coordinates free")
        magnitude = float(force[:3] @ self.contact.direction)
        require(bool(np.allclose(force, self.contact.wrench(magnitude), atol=1e-9)
                     and 0.0 <= magnitude < self.contact.force), "force", force,
                f"F · direction with F from 0 to {self.contact.force:g} N, and no torque")
        return np.array(pose, dtype=float)

    def force_jacobian(self) -> np.ndarray:
        """Returns a row of zeros (1, 6): in the model, no pose exerts a force."""
        return np.zeros((1, 6))

    def sample_contact(self, chi: np.ndarray, force_max: float, rng: np.random.Generator
                       ) -> np.ndarray:
        """Returns zeros (m, 3): free water is the same everywhere."""
        return np.zeros((len(chi), 3))

    def contact_measure(self, chi: np.ndarray, force_max: float) -> np.ndarray:
        """Returns zeros (m,): every pose counts."""
        return np.zeros(len(chi))

    def contact_reach(self, force_max: float) -> float:
        """Returns 1 m: any length would do."""
        return 1.0

    def force_error(self, chi: np.ndarray, wrench: np.ndarray, off: TipErrors) -> float:
        """Returns `UnknownContact.band` of the force along n, once the target is reached [N]."""
        return self.contact.band(float(wrench[:3] @ self.contact.direction), off)
