"""State of the contact estimator, and its update by one reading of a force sensor."""

import math
from dataclasses import dataclass, replace
from typing import Annotated, NamedTuple

import numpy as np

from uvms_drake.common.constraints import NotNegative, Positive
from uvms_drake.common.errors import require
from uvms_drake.common.finite import is_finite
from uvms_drake.common.schema import check_values
from uvms_drake.control.contact.safe_region import apex, dominates, tip_advance
from uvms_drake.control.contact.stiffness_estimate import (
    NO_ESTIMATE,
    StiffnessEstimate,
    with_reading,
)
from uvms_drake.model.surface.surface_class import SurfaceClass

APART = 0.003
"""Largest distance of the tip at those readings from its place at the last one [m]."""


@dataclass(frozen=True)
class EstimatorSettings:
    """Declared bounds of the force and of its readings, for the contact estimator."""

    force_max: Annotated[float, Positive]
    """F_max, largest static normal force [N]."""
    noise: Annotated[float, Positive]
    """ν, bound of the reading's error in norm [N]; see `SurfaceClass.normal_force_bound`."""
    period: Annotated[float, Positive] = 0.01
    """Time between two readings [s]."""
    window: Annotated[float, NotNegative] = 0.0
    """W, largest age of the force in a reading [s]: hold, delay, filter; see `safe_region`."""
    memory: Annotated[float, Positive] = 10.0
    """Force change on which the stiffness may change [N]; see `stiffness_estimate`."""
    patience: Annotated[int, Positive] = 10
    """Number of readings in a row that may be missing; from then on the tip retreats."""
    repeats: int = 3
    """m, number of readings in a row, equal in all six components, of a frozen sensor; 0: none is
    detected. See `ForceFaultDetector`."""

    mean: Annotated[float, NotNegative] = 0.8
    """Time over which readings are averaged for a target, where the tip stays [s]."""

    def __post_init__(self) -> None:
        check_values(self)
        require(self.repeats == 0 or self.repeats >= 2, "repeats", self.repeats, "0, or 2 or more")

    @property
    def watched(self) -> "EstimatorSettings":
        """Properties of the readings behind a `ForceFaultDetector`, which may be older by mT.

        At a speed v the free distance of a tip without contact is smaller by mTv.
        """
        return replace(self, window=self.window + self.repeats * self.period)

    @property
    def readings(self) -> int:
        """Number m of readings of the time W, its two ends included."""
        return 1 + math.ceil(self.window / self.period - 1e-9)


class ContactState(NamedTuple):
    """State of the contact estimator; the arrays are the discrete state."""

    apex: np.ndarray
    """𝔞 (3,) [m]; NaN: no place is known to be safe."""
    reading: np.ndarray
    """Position of the tip at the last reading (3) [m], its force n·𝐅 [N], 1 if it was a touch, else
    0 (5,)."""
    stiffness: np.ndarray
    """The `StiffnessEstimate` (23,)."""
    past: np.ndarray
    """Position [m] and velocity [m/s] of the tip at the readings of the time W (6m,); see
    `without_reading`. NaN before the first measured one, whose position is then used."""
    missing: np.ndarray
    """Number of readings in a row that are missing (1,)."""
    recent: np.ndarray
    """Position of the tip [m] and force n·𝐅 [N] of the readings of the time `mean` (4m,); NaN for
    those that are missing or no touch."""

    @property
    def mean_reading(self) -> np.ndarray:
        """Mean position (3) [m] and force [N] of the recent touches within `APART` (4,).

        The last reading itself if that is no touch.
        """
        if not self.reading[4]:
            return self.reading[:4]
        rows = self.recent.reshape(-1, 4)
        off = rows[:, :3] - self.reading[:3]
        near = (off * off).sum(axis=1) <= APART**2
        mean: np.ndarray = rows[near].mean(axis=0) if near.any() else self.reading[:4]
        return mean


def initial_contact_state(sensing: EstimatorSettings) -> ContactState:
    """Returns the state before any reading."""
    return ContactState(np.full(3, np.nan), np.append(np.full(4, np.nan), 0.0), NO_ESTIMATE.state,
                        np.full(6 * sensing.readings, np.nan), np.zeros(1),
                        np.full(4 * max(round(sensing.mean / sensing.period), 1), np.nan))


def without_reading(before: ContactState) -> np.ndarray:
    """Returns position and velocity (6,) of an unmeasured tip: the last position, and NaN."""
    return np.append(before.past[-6:-3], np.full(3, np.nan))


def updated_contact_state(surface: SurfaceClass, sensing: EstimatorSettings, extent: np.ndarray,
                          before: ContactState, tip: np.ndarray, force: np.ndarray
                          ) -> ContactState:
    """Returns the state after one more reading.

    A touch is a reading above ν in norm: there is no noise that large. If the tip was not measured
    all the time W, the place of the reading is unknown, and neither apex nor stiffness use it.

    Args:
        surface: The class of walls.
        sensing: The sensor.
        extent: Lateral extent of plans (2, 2), see `dominates` [m].
        before: State before.
        tip: Position and velocity now (6,) [m, m/s]; or `without_reading`.
        force: The reading, on the wall, in Σ_I (3,) [N]; not finite if it is missing.
    """
    past = np.concatenate([before.past[6:], tip])
    motion = past.reshape(-1, 6)
    if (missing := np.isnan(motion[:, 0])).any():
        motion[missing] = tip
    points, velocities = motion[:, :3], motion[:, 3:]
    known = is_finite(force)
    before = before._replace(
        past=past, missing=np.zeros(1) if known else before.missing + 1.0,
        recent=np.append(before.recent[4:], np.full(4, np.nan)))
    if not (known and is_finite(tip)):
        return before
    nu, stiffness = sensing.noise, StiffnessEstimate.of(before.stiffness)
    advance = tip_advance(surface, points, velocities)
    new = apex(surface, points, velocities, force, sensing.force_max, nu, sensing.period, advance)
    if not dominates(surface, new, before.apex, extent):
        new = before.apex
    touch, pressed = np.bool(math.sqrt(force @ force) > nu), surface.depth(force)
    in_contact = touch or not np.isnan(stiffness.mean[0])  # Else there is nothing to estimate.
    # The static force is bounded unless the tip retreats faster than 1/c₊.
    if in_contact and (surface.dissipation * advance.retreat < 1.0).all():
        steady = advance.before.max() <= nu / surface.stiffness
        travelled_forward = advance.since.max() if steady else np.inf
        stiffness = with_reading(stiffness, surface, tip[:3], pressed, touch, nu, sensing.memory,
                                 sensing.period, travelled_forward)
    recent = before.recent
    if touch:
        recent[-4:] = *tip[:3], pressed
    return ContactState(new, np.array([*tip[:3], pressed, touch]), stiffness.state, past,
                        before.missing, recent)
