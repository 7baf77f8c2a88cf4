"""Estimate of a wall's normal from the force and the path of a sliding tip, and the turn after it.

On the wall, with its inward normal along n + 𝔱, 𝔱 ⊥ n, a tip that moves along d ⊥ n exerts 𝐅 = φ (n
+ 𝔱) + friction along d. Across d, 𝔱 − (d·𝔱) d is that part of 𝐅/(n·𝐅); along d it follows from the
change of depth Δx = Δφ/κ − s d·𝔱 over a displacement s. Both are averaged over `LENGTH`. It is an
estimate without a bound, which the turn of a reference does not need; its errors and the limits of
the turn are in control/contact/theory.md#inclination-of-the-wall.
"""

import math
from typing import NamedTuple

import numpy as np
from pydrake.systems.framework import (
    Context,
    DiagramBuilder,
    DiscreteValues,
    EventStatus,
    LeafSystem,
)

from uvms_drake.common.errors import require
from uvms_drake.common.finite import is_finite
from uvms_drake.common.wiring import added
from uvms_drake.control.contact.contact_estimator import ContactEstimator
from uvms_drake.model.surface.surface_class import SurfaceClass

STEP = 0.01
"""Shortest displacement across n that updates the estimate [m]."""
LENGTH = 0.03
"""Displacement across n over which it is averaged [m]."""
STEADY = 0.05
"""Largest Δφ/κ over the displacement at which the path determines the inclination along it."""
TURN_PER_METRE = 0.4
"""Largest change of the desired turn over a displacement across n [rad/m]."""
SMALLEST_FORCE = 1.0
"""Force along n below which its direction is not used [N]."""


class Inclination(NamedTuple):
    """Estimate of a wall's inclination."""

    tilt: np.ndarray
    """Inclination 𝔱 (3,), across n."""
    reading: np.ndarray
    """Place of the tip at the last update (3) in Σ_I [m], and its force along n [N]; NaN off the
    wall (4,)."""


UNKNOWN = Inclination(np.zeros(3), np.full(4, np.nan))
"""Estimate before any touch."""


def learned(before: Inclination, surface: SurfaceClass, tip: np.ndarray, force: np.ndarray,
            stiffness: float) -> Inclination:
    """Returns the estimate after a reading on the wall; 𝔱 is one of the class.

    Args:
        before: Estimate before it.
        surface: The class of walls.
        tip: Place of the tip (3,) in Σ_I [m].
        force: 𝐅 on the wall (3,) in Σ_I [N]; not finite: no reading.
        stiffness: Estimate of κ [N/m].
    """
    n = surface.direction
    reading = np.append(tip, n @ force)
    if not reading[3] >= SMALLEST_FORCE:
        return before._replace(reading=UNKNOWN.reading)
    if np.isnan(before.reading[0]):
        return before._replace(reading=reading)
    change = reading - before.reading
    deeper = n @ change[:3]
    displacement = change[:3] - deeper * n
    length = math.sqrt(displacement @ displacement)
    if length < STEP:
        return before
    d, inclination, pressed = displacement / length, force / reading[3] - n, change[3] / stiffness
    along = d @ before.tilt
    if abs(pressed) <= STEADY * length:
        along = (pressed - deeper) / length
    tilt = before.tilt + (1.0 - np.exp(-length / LENGTH)) * (
        inclination + (along - d @ inclination) * d - before.tilt)
    size = float(np.linalg.norm(tilt))
    return Inclination(tilt * min(1.0, surface.tilt / max(size, 1e-12)), reading)


def wall_turn(direction: np.ndarray, tilt: np.ndarray) -> float:
    """Returns the turn about the vertical from n to a wall's inward normal [rad].

    Args:
        direction: n (3,); zero is returned for a vertical one.
        tilt: 𝔱 (3,).
    """
    (x, y, _), (x_wall, y_wall, _) = direction, direction + tilt
    if np.hypot(x, y) < 1e-6:
        return 0.0
    return float(np.arctan2(x * y_wall - y * x_wall, x * x_wall + y * y_wall))


class WallNormal(LeafSystem):
    """Estimator of a wall's inclination and of the turn of the reference that follows it.

    .. pydrake_system::

        name: WallNormal
        input_ports:
        - reading
        - touched
        - stiffness_used
        - force_measured
        output_ports:
        - turn

    - `reading`, `touched`, `stiffness_used`: those of a `ContactEstimator`.
    - `force_measured`: 𝔉 (6) on the wall as the sensor gives it; its force in Σ_I is read [N].
    - `turn` (1): follows `wall_turn` with `TURN_PER_METRE` [rad]; constant off the wall.

    The discrete state is an `Inclination` and the turn.

    Args:
        surface: The class of walls.
        most: Largest turn, to either side [rad].
        period: Time between two updates [s].
    """

    def __init__(self, surface: SurfaceClass, most: float, period: float):
        super().__init__()
        require(0.0 <= most < np.inf, "most", most, "zero or positive")
        require(0.0 < period < np.inf, "period", period, "positive")
        self._surface, self._most = surface, most
        self._reading_port = self.DeclareVectorInputPort("reading", 4)
        self._touched_port = self.DeclareVectorInputPort("touched", 1)
        self._stiffness_port = self.DeclareVectorInputPort("stiffness_used", 1)
        self._force_port = self.DeclareVectorInputPort("force_measured", 6)
        for part in UNKNOWN:
            self.DeclareDiscreteState(part)
        turn = self.DeclareDiscreteState(1)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._read)
        self.DeclareStateOutputPort("turn", turn)

    @staticmethod
    def _known(context: Context) -> Inclination:
        return Inclination(*(context.get_discrete_state(i).value() for i in range(2)))

    def _read(self, context: Context, state: DiscreteValues) -> EventStatus:
        before = known = self._known(context)
        if self._touched_port.Eval(context)[0]:
            known = learned(known, self._surface, self._reading_port.Eval(context)[:3],
                            self._force_port.Eval(context)[:3],
                            self._stiffness_port.Eval(context)[0])
        else:
            known = known._replace(reading=UNKNOWN.reading)
        turn = context.get_discrete_state(2)[0]
        if (known.reading is not before.reading
                and is_finite(known.reading) and is_finite(before.reading)):
            wanted = np.clip(wall_turn(self._surface.direction, known.tilt),
                             -self._most, self._most)
            step = TURN_PER_METRE * self._surface.lateral(known.reading[:3] - before.reading[:3])
            turn += np.clip(wanted - turn, -step, step)
        for i, part in enumerate((*known, [turn])):
            state.set_value(i, part)
        return EventStatus.Succeeded()

    @staticmethod
    def AddToBuilder(builder: DiagramBuilder, estimator: ContactEstimator, surface: SurfaceClass,
                     most: float, period: float, name: str = "wall_normal") -> "WallNormal":
        """Adds the system and connects it, but for `force_measured`.

        Args:
            builder: Builder of the Diagram.
            estimator: Estimator of the contact state.
            surface: The class of walls.
            most: Largest turn, to either side [rad].
            period: Time between two updates [s].
            name: Name of the system.
        """
        return added(builder, name, WallNormal(surface, most, period), **{
            port: estimator.GetOutputPort(port) for port in (
                "reading", "touched", "stiffness_used")})
