"""How a wall is turned, by what a tip that slides on it feels, and how far to turn after it.

On the wall, with its inward normal along n + 𝔱, 𝔱 ⊥ n, a tip that moves along d ⊥ n exerts

    𝐅 = φ (n + 𝔱) + friction along d.

Across its way, 𝔱 − (d·𝔱) d is that part of 𝐅/(n·𝐅), whatever the friction. Along its way 𝐅 has the
friction in it, but the path is on the wall: over a way s the tip goes deeper by Δx = Δφ/κ − s d·𝔱,
which says little where Δφ/κ is much, as while a press begins, for κ̂ is above κ more often than not.
Both are averaged over the way, `LENGTH`: a tip at rest learns nothing, as friction may then point
anywhere, and a way shorter than `STEP` says too little of d. What is off: a force across of b of
the normal one (a bias of the sensor) is b [rad]; a d that is off by δ, μδ; a depth that is off by
ε, or a force by κε, ε/`LENGTH`; a κ̂ above κ, up to (κ̂/κ − 1) `STEADY` while the force changes; and
on a wall that bends it is where the tip was `LENGTH` ago. What
`slope` estimates of 𝔱 counts on errors of the force as large as is declared, and is slower.

It is no bound, and need be none: by how much a reference turns is in no limit of a plan
(`TrackingOcp`). A robot that may turn about the vertical turns by the angle between the horizontal
parts of n and n + 𝔱, so that the tool follows the normal as far as a turn can make it: on its way,
and by `TURN_PER_METRE` of it, for a robot that turns about its tip has to be moved, too. Its plans leave
the tip beside its place by about 0.4 s of a metre for each radian: at 20 mm/s, 3 mm. In a hold it
does not turn.
"""

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
from uvms_drake.common.wiring import added
from uvms_drake.control.contact.contact_estimator import ContactEstimator
from uvms_drake.model.surface.surface_class import SurfaceClass

STEP = 0.01
"""Shortest way across n by which anything is learned [m]."""
LENGTH = 0.03
"""Way across n over which it is averaged [m]."""
STEADY = 0.05
"""Largest Δφ/κ over the way at which the path says how the wall lies."""
TURN_PER_METRE = 0.4
"""By how much the turn that is asked for changes at most on a way across n [rad/m]."""
SMALLEST_FORCE = 1.0
"""Force along n below which its direction says nothing [N]."""


class Inclination(NamedTuple):
    """What is known of a wall's normal."""

    tilt: np.ndarray
    """𝔱 (3,), across n."""
    reading: np.ndarray
    """Where the tip was when it was learned last (3) in Σ_I [m], and its force along n [N]; NaN:
    not on the wall."""


UNKNOWN = Inclination(np.zeros(3), np.full(4, np.nan))
"""Nothing was felt yet."""


def learned(before: Inclination, surface: SurfaceClass, tip: np.ndarray, force: np.ndarray,
            slope: float) -> Inclination:
    """Returns what is known after a reading on the wall; 𝔱 is one of the class.

    Args:
        before: What was known.
        surface: The class of walls.
        tip: Where the tip is (3,) in Σ_I [m].
        force: 𝐅 on the wall (3,) in Σ_I [N]; not finite: no reading.
        slope: κ of the wall [N/m], as far as it is known.
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
    length = float(np.linalg.norm(displacement))
    if length < STEP:
        return before
    d, inclination, pressed = displacement / length, force / reading[3] - n, change[3] / slope
    along = d @ before.tilt
    if abs(pressed) <= STEADY * length:
        along = (pressed - deeper) / length
    tilt = before.tilt + (1.0 - np.exp(-length / LENGTH)) * (
        inclination + (along - d @ inclination) * d - before.tilt)
    size = float(np.linalg.norm(tilt))
    return Inclination(tilt * min(1.0, surface.tilt / max(size, 1e-12)), reading)


def wall_turn(direction: np.ndarray, tilt: np.ndarray) -> float:
    """Returns by how much a wall's inward normal is turned from n about the vertical [rad].

    Args:
        direction: n (3,); zero is returned for a vertical one.
        tilt: 𝔱 (3,).
    """
    (x, y, _), (x_wall, y_wall, _) = direction, direction + tilt
    if np.hypot(x, y) < 1e-6:
        return 0.0
    return float(np.arctan2(x * y_wall - y * x_wall, x * x_wall + y * y_wall))


class WallNormal(LeafSystem):
    """Keeps a wall's inclination at every reading, and puts out how far the wall is turned.

    .. pydrake_system::

        name: WallNormal
        input_ports:
        - reading
        - touched
        - slope
        - force_measured
        output_ports:
        - turn

    - `reading`, `touched`, `slope`: those of an `ContactEstimator`.
    - `force_measured`: 𝔉 (6) on the wall as the sensor gives it; its force in Σ_I is read [N].
    - `turn` (1): goes to `wall_turn` with `TURN_PER_METRE` [rad]; it stays where it is off the wall.

    The discrete state is an `Inclination` and the turn.

    Args:
        surface: The class of walls.
        most: Largest turn, to either side [rad].
        period: Time between two looks [s].
    """

    def __init__(self, surface: SurfaceClass, most: float, period: float):
        super().__init__()
        require(0.0 <= most < np.inf, "most", most, "zero or positive")
        require(0.0 < period < np.inf, "period", period, "positive")
        self._surface, self._most = surface, most
        self._reading_port = self.DeclareVectorInputPort("reading", 4)
        self._touched_port = self.DeclareVectorInputPort("touched", 1)
        self._slope_port = self.DeclareVectorInputPort("slope", 1)
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
                            self._force_port.Eval(context)[:3], self._slope_port.Eval(context)[0])
        else:
            known = known._replace(reading=UNKNOWN.reading)
        turn = context.get_discrete_state(2)[0]
        if np.all(np.isfinite([known.reading, before.reading])):
            wanted = np.clip(wall_turn(self._surface.direction, known.tilt),
                             -self._most, self._most)
            step = TURN_PER_METRE * self._surface.aside(known.reading[:3] - before.reading[:3])
            turn += np.clip(wanted - turn, -step, step)
        for i, part in enumerate((*known, [turn])):
            state.set_value(i, part)
        return EventStatus.Succeeded()

    @staticmethod
    def AddToBuilder(builder: DiagramBuilder, estimator: ContactEstimator, surface: SurfaceClass,
                     most: float, period: float, name: str = "wall_normal") -> "WallNormal":
        """Adds the system and connects it, but for `force_measured`.

        Args:
            builder: Where to add it.
            estimator: What was felt.
            surface: The class of walls.
            most: Largest turn, to either side [rad].
            period: Time between two looks [s].
            name: Name of the system.
        """
        return added(builder, name, WallNormal(surface, most, period), **{
            port: estimator.GetOutputPort(port) for port in ("reading", "touched", "slope")})
