"""What one reading of a force sensor adds to what is known of a wall."""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from uvms_drake.common.errors import require
from uvms_drake.control.contact.safe_region import apex, dominates
from uvms_drake.control.contact.stiffness_estimate import NOTHING, StiffnessEstimate, with_reading
from uvms_drake.model.surface.surface_class import SurfaceClass


@dataclass(frozen=True)
class ForceSensorModel:
    """What is known of the force sensor, and what is wanted of the force."""

    force_max: float
    """F_max, largest static normal force [N]."""
    noise: float
    """ν, bound of the reading's error in norm [N]; see `SurfaceClass.normal_force_bound`."""
    period: float = 0.01
    """Time between two readings [s]."""
    window: float = 0.0
    """W, how old the force may be that a reading shows [s]: hold, delay, filter; see `front`."""
    memory: float = 10.0
    """Change of the force with which the slope may become another one [N]; see `slope`."""
    patience: int = 10
    """Number of readings in a row that may be missing; from then on the tip retreats."""
    repeats: int = 3
    """m, number of equal readings in a row that are none; 0: any are. See `ForceFaultDetector`."""
    tare: float = 0.0
    """Time at the start in which the sensor may say zero, for nothing is touched then [s]."""
    largest: float = np.inf
    """Norm of a force at the end of the sensor's range, which is no reading [N]."""

    def __post_init__(self):
        for key in ("force_max", "noise", "period", "memory", "patience"):
            value = getattr(self, key)
            require(0.0 < value < np.inf, key, value, "positive")
        for key in ("window", "tare"):
            value = getattr(self, key)
            require(0.0 <= value < np.inf, key, value, "zero or positive")
        require(self.repeats == 0 or self.repeats >= 2, "repeats", self.repeats, "0, or 2 or more")
        require(self.largest > 0.0, "largest", self.largest, "positive")

    @property
    def watched(self) -> "ForceSensorModel":
        """What is known of the readings that a `ForceFaultDetector` lets pass: they may be older by mT.

        At a speed v the front of a tip that feels nothing is so mTv less far ahead of it.
        """
        return replace(self, window=self.window + self.repeats * self.period)

    @property
    def readings(self) -> int:
        """Number m of readings of the time W, its two ends included."""
        return 1 + math.ceil(self.window / self.period - 1e-9)


class ContactState(NamedTuple):
    """All that is remembered; the arrays are the discrete state."""

    apex: np.ndarray
    """𝔞 (3,) [m]; NaN: no place is known to be safe."""
    reading: np.ndarray
    """Where the tip was at the last reading (3) [m], its force n·𝐅 [N], 1 if it was a touch, else 0
    (5,)."""
    stiffness: np.ndarray
    """The `StiffnessEstimate` (23,)."""
    past: np.ndarray
    """Position [m] and velocity [m/s] of the tip at the readings of the time W (6m,); see `without_reading`.
    NaN before the first one that was seen: there it is taken to have been where that was."""
    missing: np.ndarray
    """Number of readings in a row that were none (1,)."""


def initial_contact_state(sensing: ForceSensorModel) -> ContactState:
    """Returns what is known before any reading."""
    return ContactState(np.full(3, np.nan), np.append(np.full(4, np.nan), 0.0), NOTHING.state,
                np.full(6 * sensing.readings, np.nan), np.zeros(1))


def without_reading(before: ContactState) -> np.ndarray:
    """Returns position and velocity (6,) of a tip that is not seen: where it was last, and NaN."""
    return np.append(before.past[-6:-3], np.full(3, np.nan))


def updated_contact_state(surface: SurfaceClass, sensing: ForceSensorModel, extent: np.ndarray, before: ContactState,
         tip: np.ndarray, force: np.ndarray) -> ContactState:
    """Returns what is known after one more reading.

    A touch is a reading above ν in norm: there is no noise that large. If the tip was not seen all
    the time W, nobody knows which place the reading tells of: it teaches nothing.

    Args:
        surface: The class of walls.
        sensing: The sensor.
        extent: Where plans go (2, 2), see `dominates` [m].
        before: What was known.
        tip: Position and velocity now (6,) [m, m/s]; or `without_reading`.
        force: The reading, on the wall, in Σ_I (3,) [N]; not finite: there is none.
    """
    motion = np.vstack([before.past[6:].reshape(-1, 6), tip])
    motion[np.isnan(motion[:, 0])] = tip
    past, (points, velocities) = motion.ravel(), np.hsplit(motion, 2)
    known = np.all(np.isfinite(force))
    before = before._replace(past=past, missing=np.zeros(1) if known else before.missing + 1.0)
    if not (known and np.all(np.isfinite(tip))):
        return before
    nu, stiffness = sensing.noise, StiffnessEstimate.of(before.stiffness)
    new = apex(surface, points, velocities, force, sensing.force_max, nu, sensing.period)
    if not dominates(surface, new, before.apex, extent):
        new = before.apex
    touch, pressed = np.linalg.norm(force) > nu, surface.depth(force)
    feels = touch or not np.isnan(stiffness.mean[0])  # Else there is nothing to be learned.
    if feels and np.all(np.isfinite(surface.static_force_bound(force, velocities, nu))):
        travelled = tip[:3] - points
        travelled_forward, back = (np.max(surface.advance(each)) for each in (travelled, -travelled))
        travelled_forward = travelled_forward if back <= nu / surface.stiffness else np.inf
        stiffness = with_reading(stiffness, surface, tip[:3], pressed, touch, nu, sensing.memory,
                              sensing.period, travelled_forward)
    return ContactState(new, np.array([*tip[:3], pressed, touch]), stiffness.state, past, before.missing)
