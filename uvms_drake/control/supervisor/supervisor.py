"""Supervisor of a press on an unknown wall: watches the class, and retreats if it is left.

::

                    a ratio of `detections.ratios` > 1
        WATCHING ───────────────────────────────────────▶ RETREATING ◀─▶ STANDING
        the law of the scenario,     `resume`, and every   `retreat`: off the wall, station;
        plans every h                ratio below one       plans rest at the measured place
            ▲                        for `SETTLED`                          │
            └───────────────────────────────────────────────────────────────┘

The trip is latched: cause and time stay, and without `resume`, of a mission that goes on with the
next spot, there is no way back to the law; after a failure of law, planner or thruster, never.

A false alarm ends a task for nothing: inside of a certified class there is none, see
control/theory.md#silence-of-the-supervisor. A retreat may do harm, too: it is along −n, of which
the approach was the proof that it is free; it needs no plan, no force and no model of the wall; its
reference rests while the state is lost, leads by a leash, and keeps the joints off their stops.
"""

import math
from typing import NamedTuple

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import Context, DiscreteValues

from uvms_drake.common.alarm import warn
from uvms_drake.common.finite import is_finite
from uvms_drake.common.wiring import WiredSystem, output_of
from uvms_drake.control.laws.law import Pair
from uvms_drake.control.mpc.planner import HOVERED, KEPT, MPC_REPORT, SOLVED
from uvms_drake.control.supervisor.detections import (
    FINAL,
    OFF_PLAN,
    ROWS,
    SPACING,
    WINDOW,
    Seen,
    Thresholds,
    ratios,
    stiffness_of_touch,
)
from uvms_drake.control.supervisor.isolation import (
    CONFIRMED,
    ISOLATION,
    SUSPICION,
    faulty_thruster,
    wrench_of,
)
from uvms_drake.control.supervisor.retreat import (
    PATIENCE,
    RETREATING,
    SETTLED,
    STANDING,
    TURNING_FROM,
    WATCHING,
    Reference,
    RetreatSettings,
    begun,
    moved,
    stands,
)
from uvms_drake.model.frames.euler import pose_difference
from uvms_drake.model.propulsion.allocation import Allocation
from uvms_drake.model.signals.sensor_actuator import CAUSES, SAFETY
from uvms_drake.model.uvms_model import UvmsModel

SATURATED = 2.0
"""`force_status` of a reading at the end of the sensor's range."""
GOOD = (SOLVED, KEPT, HOVERED)
"""Outcomes of a sample with a plan that is as good as new."""
DRIFT, FIX = list(CAUSES).index("drift"), list(CAUSES).index("fix")
"""Indices of the drift, which has to be above its threshold for a thruster to be isolated, and of
the age of the fixes, by which it is seen."""


class Safety(NamedTuple):
    """Parts of a supervisor."""

    thresholds: Thresholds
    """Thresholds of its detections."""
    retreat: RetreatSettings
    """Distances and speeds, and limits of the joints."""
    allocation: Allocation | None
    """Allocation to the thrusters; None: the wrench is ideal."""


class Watch(NamedTuple):
    """Memory of a `Supervisor`, its discrete state."""

    safety: np.ndarray
    """`SAFETY` (5,)."""
    largest: np.ndarray
    """Largest ratio so far of each of `CAUSES` (11,)."""
    readings: np.ndarray
    """Time, position, force, planned speed of the last readings, the newest last (6 ROWS,); NaN for
    none."""
    clocks: np.ndarray
    """Times [s]: of the last update, touch, finite state and new plan; for which the command was
    cut, the force lost, the water driven, and all was well, standing; and of the last drift that
    was no suspicion (9,)."""
    flow: np.ndarray
    """Low-passed horizontal disturbance (2,) [m/s²]."""
    config: np.ndarray
    """`Reference`: 𝔮 (6+n,)."""
    rate: np.ndarray
    """`Reference`: 𝔮̇ (6+n,)."""
    start: np.ndarray
    """`Reference`: position at the trip (3,) [m]."""
    left: np.ndarray
    """`Reference`: distance left and depth of the tip (2,) [m]."""
    suspect: np.ndarray
    """Number of the thruster that explains the wrench, and time since when it does [s] (2,)."""

    @property
    def reference(self) -> Reference:
        """The reference of the retreat."""
        return Reference(*(getattr(self, name) for name in Reference._fields))


def initial_watch(size: int) -> Watch:
    """Returns the memory before the first update, for 6 + n = `size`."""
    return Watch(np.array([WATCHING, 0.0, np.nan, np.nan, 0.0]), np.zeros(len(CAUSES)),
                 np.full(6 * ROWS, np.nan),
                 np.array([np.nan, -np.inf, np.nan, np.nan, 0.0, 0.0, 0.0, 0.0, np.nan]),
                 np.zeros(2),
                 np.zeros(size), np.zeros(size), np.zeros(3), np.zeros(2), np.zeros(2))


def since_last(clocks: np.ndarray, now: float) -> float:
    """Returns the time since the last update [s]; zero before the first one."""
    return 0.0 if math.isnan(clocks[0]) else now - clocks[0]


def updated(before: Watch, seen: Seen, config: np.ndarray, limits: Thresholds,
            settings: RetreatSettings, model: UvmsModel) -> Watch:
    """Returns the memory after measurements: the state machine of the module.

    Args:
        before: The memory; its `clocks` are those of `seen` already.
        seen: The measurements.
        config: Measured 𝔮 (6+n,); while it is missing, that of the plan.
        limits: Thresholds.
        settings: Of the retreat.
        model: The controller's model.
    """
    # The measurements enter the memory, after the readings of the last second are taken.
    rows = before.readings.reshape(-1, 6)
    present = np.array([seen.time, *seen.tip, seen.force, seen.advance])
    recent = rows[rows[:, 0] >= seen.time - WINDOW]
    clocks, since = before.clocks.copy(), since_last(before.clocks, seen.time)
    clocks[0] = seen.time
    if seen.force > limits.touch:
        clocks[1] = seen.time
    if is_finite(seen.tip) and not seen.time - rows[-1, 0] < SPACING - 1e-9:
        rows = np.vstack([rows[1:], present])
    flow = before.flow + min(since / WINDOW, 1.0) * (np.nan_to_num(seen.drift[:2]) - before.flow)
    driven = np.linalg.norm(flow) > TURNING_FROM * limits.drift[0]
    clocks[6] = clocks[6] + since if driven else 0.0
    now = before._replace(readings=rows.ravel(), clocks=clocks, flow=flow)
    found = ratios(seen, np.vstack([recent, present]), limits)
    safety, suspect = before.safety.copy(), np.zeros(2)
    # The onset: the trip, or later a drift from nothing, standing off the wall and with fixes.
    if found[DRIFT] <= SUSPICION:
        clocks[8] = seen.time
    later = (safety[0] == STANDING and clocks[8] > safety[2] and found[FIX] <= 1.0
             and seen.time - clocks[1] > WINDOW)
    onset = np.nan if safety[0] == WATCHING else clocks[8] if later else safety[2]
    if (settings.thrusters is not None and not safety[4] and found[DRIFT] > SUSPICION
            and not seen.time - onset > ISOLATION and is_finite(seen.tip)
            and np.isfinite(seen.force) and not seen.saturated and seen.lost_time == 0.0):
        number = faulty_thruster(settings.thrusters, wrench_of(model, config, seen.drift))
        suspect = before.suspect if number == before.suspect[0] else np.array([number, seen.time])
    isolated = suspect[0] if found[DRIFT] > 1.0 and (
        seen.time - suspect[1] >= CONFIRMED - 1e-9) else 0.0
    now = now._replace(suspect=suspect)
    # Watching: the first ratio above one is the trip, at the measured place.
    if safety[0] == WATCHING:
        now = now._replace(largest=np.maximum(before.largest, found))
        if not (found > 1.0).any():
            return now
        cause = int(np.argmax(np.minimum(found, 1e9)))
        in_touch = recent[recent[:, 4] > limits.touch]
        warn(seen.time, f"retreats: {list(CAUSES.values())[cause]}")
        return now._replace(
            safety=np.array([RETREATING, cause + 1.0, seen.time, stiffness_of_touch(
                limits.walls.depth(in_touch[:, 1:4]), in_touch[:, 4], limits.depth_error,
                0.5 * limits.error), isolated if list(CAUSES)[cause] in OFF_PLAN else 0.0]),
            **begun(settings, model, config, seen.time - clocks[1] <= WINDOW)._asdict())
    # Retreating and standing: the reference moves on, or rests while the state is lost.
    reference = before.reference
    if not is_finite(seen.tip):
        clocks[7] = 0.0
        return now._replace(rate=np.zeros_like(before.rate))
    name = list(CAUSES)[int(safety[1]) - 1]
    if isolated and (later or name in OFF_PLAN):
        safety[4] = isolated
    if since > 0.0:
        waited = seen.time - safety[2] >= settings.distance / settings.speed
        heading = float(np.arctan2(-flow[1], -flow[0])) if (
            waited and clocks[6] > PATIENCE) else None
        reference = moved(settings, model, reference, config, since, heading)
    standing = stands(settings, safety[0] == STANDING, reference.left)
    safety[0] = STANDING if standing else RETREATING
    well = seen.resume and standing and (found <= 1.0).all() and not (
        safety[4] or name in FINAL)
    clocks[7] = clocks[7] + since if well else 0.0
    if clocks[7] >= SETTLED:
        safety[0], clocks[7] = WATCHING, 0.0
    return now._replace(safety=safety, **reference._asdict())


class Supervisor(WiredSystem):
    """Supervisor; see the module.

    .. pydrake_system::

        name: Supervisor
        input_ports:
        - state
        - pair
        - force_valid
        - force_status (optional)
        - force_lost
        - estimate (optional)
        - fix_age (optional)
        - report
        - raised
        - limited
        - resume (optional)
        output_ports:
        - safety
        - safety_ratio
        - retreat

    - `state`: (𝔮, ζ) (2(6+n)) measured.
    - `pair`: `Pair` of measured and nominal motion.
    - `force_valid` (6), `force_status` (1), `force_lost` (1): of a `ForceFaultDetector` and of a
      `ContactEstimator`.
    - `estimate`: δ̂ (6+n) of a `RowObserver`.
    - `fix_age`: age of the last fix of the navigation (1) [s].
    - `report`: `MPC_REPORT` of the planner.
    - `raised`, `limited` (1): of an `AncillaryFeedback`.
    - `resume` (1): above zero, the robot is to go on, of a `MissionControl`.
    - `safety` (5): `SAFETY`.
    - `safety_ratio`: largest ratio so far of each of `CAUSES` to its threshold, until a trip.
    - `retreat`: mode, isolated thruster, and the reference 𝔮, 𝔮̇ of the retreat (2 + 2(6+n)).

    All outputs are functions of the discrete state, a `Watch`, so there is no algebraic loop.

    Args:
        model: The controller's model.
        limits: Thresholds.
        settings: Of the retreat.
        period: Time between two updates [s], that of the law's clock; zero for one at the beginning
            of each step of the simulation. Neither changes the steps.
    """

    def __init__(self, model: UvmsModel, limits: Thresholds, settings: RetreatSettings,
                 period: float = 0.0):
        super().__init__()
        self._model, self._limits, self._settings = model, limits, settings
        size = model.size
        self._ports = {name: self.DeclareVectorInputPort(name, width) for name, width in (
            ("state", 2 * size), ("force_valid", 6), ("force_status", 1), ("force_lost", 1),
            ("estimate", size), ("fix_age", 1), ("report", len(MPC_REPORT)), ("raised", 1),
            ("limited", 1), ("resume", 1))}
        self._pair_port = self.DeclareAbstractInputPort("pair", Value(object()))
        for part in initial_watch(size):
            self.DeclareDiscreteState(part)
        if period > 0.0:
            self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)
        else:
            self.DeclarePerStepDiscreteUpdateEvent(self._update)
        known = {self.xd_ticket()}
        output_of(self, "safety", len(SAFETY), lambda c: self._watch(c).safety, known)
        output_of(self, "safety_ratio", len(CAUSES), lambda c: self._watch(c).largest, known)
        output_of(self, "retreat", 2 + 2 * size, self._retreat, known)

    def _retreat(self, context: Context) -> np.ndarray:
        watch = self._watch(context)
        return np.concatenate([watch.safety[[0, 4]], watch.config, watch.rate])

    @staticmethod
    def _watch(context: Context) -> Watch:
        return Watch(*(context.get_discrete_state(i).value() for i in range(len(Watch._fields))))

    def _value(self, context: Context, name: str, default: float = 0.0) -> float:
        port = self._ports[name]
        return float(port.Eval(context)[0]) if port.HasValue(context) else default

    def _update(self, context: Context, state: DiscreteValues) -> None:
        before, now = self._watch(context), context.get_time()
        clocks = before.clocks.copy()
        since = since_last(clocks, now)
        measured, report = (self._ports[name].Eval(context) for name in ("state", "report"))
        # Ages: of the state, of the plan, of a cut command and of a lost force.
        if is_finite(measured) or np.isnan(clocks[2]):
            clocks[2] = now
        if report[1] in GOOD or np.isnan(clocks[3]):
            clocks[3] = now if np.isnan(report[0]) else report[0]
        for i, name in ((4, "limited"), (5, "force_lost")):
            clocks[i] = clocks[i] + since if self._value(context, name) > 0.0 else 0.0
        off, tip, config = np.full(3, np.nan), np.full(3, np.nan), before.config
        advance = np.nan
        if is_finite(measured):
            pair: Pair = self._pair_port.Eval(context)
            config, errors = pair.config[0], pose_difference(*pair.y)
            off = np.array([np.linalg.norm(errors[part]) for part in (
                slice(0, 3), slice(3, 6), slice(6, None))])
            tip, planned = pair.y[0][:3], pair.kinematics.J_chi[1, :3] @ pair.zeta[1]
            advance = float(np.max(self._limits.walls.advance(np.array([planned, -planned]))))
        elif before.safety[0] == WATCHING:
            config = self._pair_port.Eval(context).config[1]
        drift = self._ports["estimate"]
        seen = Seen(
            now, tip, advance, float(self._settings.direction @ self._ports["force_valid"].Eval(
                context)[:3]), self._value(context, "force_status") == SATURATED, off,
            drift.Eval(context)[:6] if drift.HasValue(context) else np.zeros(6),
            max(self._value(context, "fix_age"), now - clocks[2]),
            self._value(context, "raised") > 0.0, clocks[4], now - clocks[3], clocks[5],
            self._value(context, "resume") > 0.0)
        after = updated(before._replace(clocks=clocks), seen, config, self._limits, self._settings,
                        self._model)
        for i, part in enumerate(after):
            state.set_value(i, part)
