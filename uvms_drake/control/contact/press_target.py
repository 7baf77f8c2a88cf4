"""Depth target of a press: the depth at which the wall should give the desired force.

In contact x_target = x + (F_des − F)/κ̂ − 𝔱·(𝔲 − 𝔭), x the depth of the tip 𝔭 [m], F the force [N]
of the mean reading at its place (`ContactState.mean_reading`), κ̂ [N/m] and 𝔱 the estimated
stiffness and inclination and 𝔲 the desired place.
The force error contracts by 1 − κ/κ̂ a step: iff κ̂ > κ/2, without overshoot iff κ̂ ≥ κ; see
control/contact/theory.md#contraction-of-a-press, in motion
control/contact/theory.md#press-while-the-tip-moves, with delayed plans
control/contact/theory.md#press-with-delayed-plans. Errors of reading and tip leave
control/contact/theory.md#remaining-force-error-of-a-press.

Without contact the target is beyond the safe depth, at most 2F_des/(κ₊t_r) times the plan's delay
forward of the tip: control/contact/theory.md#search-before-contact. Without readings it retreats:
control/contact/theory.md#retreat-without-readings. The target is in no limit of the plan.
"""

import math

import numpy as np
from pydrake.systems.framework import Context

from uvms_drake.common.errors import require, unit_vector, vector
from uvms_drake.common.finite import is_finite
from uvms_drake.common.wiring import WiredSystem, cached, output_of
from uvms_drake.control.contact.contact_state import EstimatorSettings

SEARCH_DEPTH = 0.1
"""Depth beyond the safe region at which the search aims [m]."""
CLEARANCE = 0.05
"""Distance of the retreat [m]."""
OVER = 2.0
"""Largest force of a touch, over F_des, before a plan knows of it."""
LATERAL_TOLERANCE = 0.05
"""Lateral error from which on the tip goes no deeper in search of the wall [m]."""


def target_depth(desired: np.ndarray, reading: np.ndarray, touched: np.ndarray,
                 stiffness_used: np.ndarray, contact_depth: np.ndarray, safe_depth: np.ndarray,
                 depth_offset: np.ndarray | float = 0.0, lateral_error: np.ndarray | float = 0.0,
                 search_lead: float = np.inf) -> np.ndarray:
    """Returns the target depth [m] of one wall, or of an array of them; see the module.

    Args:
        desired: F_des, along n [N].
        reading: Depths x [m] and forces F [N] of the last readings (2, ...).
        touched: Whether those readings were touches.
        stiffness_used: κ̂ [N/m].
        contact_depth: Depth at which the wall begins [m]; NaN: unknown.
        safe_depth: x_safe [m].
        depth_offset: −𝔱·(𝔲 − 𝔭), depth of the wall at the place less that at the tip [m].
        lateral_error: Tangential distance of the tip from the place [m].
        search_lead: Largest lead of the search over the tip per newton of desired force [m/N]; it
            is zero without any.
    """
    depth = np.where(touched, reading[0], np.maximum(reading[0], contact_depth))
    force = np.where(touched, reading[1], 0.0)
    pressing = depth + (desired - force) / stiffness_used + depth_offset
    lead = np.inf if np.isinf(search_lead) else search_lead * np.fmax(desired, 0.0)
    search = np.where(
        lateral_error < LATERAL_TOLERANCE,
        np.minimum(safe_depth + SEARCH_DEPTH, reading[0] + lead), reading[0])
    return np.where(np.isnan(pressing), search, pressing)


def touch_to_plan(time_step: float, committed: int, sensing: EstimatorSettings) -> float:
    """Returns t_r, the largest delay [s] from a touch to a plan that knows of it.

    Args:
        time_step: h of the plans [s].
        committed: Number of committed intervals at the beginning of a plan.
        sensing: The sensor.
    """
    return (1 + committed) * time_step + sensing.watched.window


def search_speed(force: float, stiffness: float, delay: float) -> float:
    """Returns the speed v of the search [m/s] for a desired force [N]; see the module.

    Args:
        force: F_des [N].
        stiffness: κ₊ [N/m].
        delay: t_r, from a touch to a plan that knows of it [s].
    """
    return OVER * force / (stiffness * delay)


def retreat_depth(reading: np.ndarray, contact_depth: np.ndarray) -> np.ndarray:
    """Returns the target depth without readings [m]; see the module.

    `CLEARANCE` outside of the wall, or of the last reading if that is less deep or none is known.

    Args:
        reading: Depth x [m] and force of the last reading (2, ...).
        contact_depth: Depth at which the wall begins [m]; NaN: unknown.
    """
    return np.fmin(reading[0], contact_depth) - CLEARANCE


class PressTarget(WiredSystem):
    """Target of the tip at which the wall should give the desired force, or of its retreat.

    .. pydrake_system::

        name: PressTarget
        input_ports:
        - desired_force
        - place (optional)
        - deepest (optional)
        - reading
        - mean_reading
        - touched
        - stiffness_used
        - tilt
        - contact_depth
        - safe_depth
        - force_lost
        output_ports:
        - target
        - unclipped_target
        - target_of_reading

    - `desired_force` (1): F_des along n [N].
    - `place` (3): a point of the line along n on which to press, in Σ_I [m]; the default if it is
      not connected or not finite.
    - `deepest` (1): largest target depth [m]; no limit if it is not connected or not finite.
    - The others: those of a `ContactEstimator`.
    - `target` (3): the point of that line at `target_depth` of the mean reading, or at
      `retreat_depth` while the force is lost, in Σ_I [m].
    - `unclipped_target` (3): the same without `deepest`.
    - `target_of_reading` (3): the same of the last reading, without `deepest`.

    It has no state.

    Args:
        direction: Unit vector n (3,).
        place: The default (3,) [m].
        search_lead: See `target_depth` [m/N].
    """

    def __init__(self, direction: np.ndarray, place: np.ndarray, *, search_lead: float = np.inf):
        super().__init__()
        require(search_lead > 0.0, "search_lead", search_lead, "positive")
        self._search_lead = search_lead
        self._direction = unit_vector("direction", direction)
        self._place = vector("place", place, 3)
        self._desired_port = self.DeclareVectorInputPort("desired_force", 1)
        self._place_port = self.DeclareVectorInputPort("place", 3)
        self._deepest_port = self.DeclareVectorInputPort("deepest", 1)
        self._ports = {name: self.DeclareVectorInputPort(name, size) for name, size in (
            ("reading", 4), ("mean_reading", 4), ("touched", 1), ("stiffness_used", 1), ("tilt", 3),
            ("contact_depth", 1), ("safe_depth", 1), ("force_lost", 1))}
        line = cached(self, "the place's part across n", self._line, {self._place_port.ticket()})
        depth = cached(self, "the depth by the mean reading", lambda c: self._depth(
            c, line.Eval(c), "mean_reading"), {self.all_input_ports_ticket()})
        inputs = {self.all_input_ports_ticket()}
        output_of(self, "target", 3, lambda c: (
            self._clipped(c, depth.Eval(c)) * self._direction + line.Eval(c)), inputs)
        output_of(self, "unclipped_target", 3, lambda c: (
            depth.Eval(c) * self._direction + line.Eval(c)), inputs)
        output_of(self, "target_of_reading", 3, lambda c: (
            self._depth(c, line.Eval(c), "reading") * self._direction + line.Eval(c)), inputs)

    def _clipped(self, context: Context, depth: np.ndarray) -> np.ndarray:
        """Returns a depth (1,), not deeper than `deepest`."""
        if not self._deepest_port.HasValue(context):
            return depth
        deepest = self._deepest_port.Eval(context)
        return np.where(np.isfinite(deepest), np.minimum(depth, deepest), depth)

    def _depth(self, context: Context, line: np.ndarray, of: str) -> np.ndarray:
        """Returns the target's depth (1,) by one of the readings."""
        estimate = {name: port.Eval(context) for name, port in self._ports.items()}
        readings = {name: estimate.pop(name) for name in ("reading", "mean_reading")}
        tip, force, tilt = readings[of][:3], readings[of][3], estimate.pop("tilt")
        depth, (lost,) = self._direction @ tip, estimate.pop("force_lost")
        reading, off = np.array([depth, force]), tip - depth * self._direction - line
        if lost:
            return retreat_depth(reading, estimate["contact_depth"])
        # An approach that is to press with no force is limited by its largest depth.
        desired, lead = self._desired_port.Eval(context), self._search_lead
        if not desired[0] > 0.0 and self._deepest_port.HasValue(context) and is_finite(
                self._deepest_port.Eval(context)):
            lead = np.inf
        return target_depth(desired, reading, **estimate, depth_offset=tilt @ (tip - line),
                            lateral_error=math.sqrt(off @ off), search_lead=lead)

    def _line(self, context: Context) -> np.ndarray:
        """Returns the place's part across n (3,)."""
        place = self._place
        if self._place_port.HasValue(context) and is_finite(
                asked := self._place_port.Eval(context)):
            place = asked
        across: np.ndarray = place - (self._direction @ place) * self._direction
        return across
