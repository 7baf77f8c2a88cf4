"""A baseline controller: approach, laws and a limit in one system, and its gains on a robot."""

import functools
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from pydrake.systems.framework import Context, DiscreteValues

from uvms_drake.baselines import shared_laws, sliding_mode
from uvms_drake.baselines.compliant_laws import (
    Admittance,
    AdmittanceGains,
    Impedance,
    ImpedanceGains,
)
from uvms_drake.baselines.law import PERIOD, Law, Measured, PressTask, Reference
from uvms_drake.baselines.prescribed_performance import PerformanceGains, PrescribedPerformance
from uvms_drake.common.errors import require
from uvms_drake.common.schema import load_typed, read_yaml
from uvms_drake.common.wiring import WiredSystem, cached, output_of
from uvms_drake.model.uvms_model import UvmsModel

FOLDER = Path(__file__).parent
RELEASE = 0.3
"""Part of the force of a touch below which the contact is lost."""
SMOOTHING = 0.05
"""Time constant of the force for that decision [s]."""
STRAY, BACK, BACK_SPEED = 0.15, 0.3, 0.1
"""Distance of the tip across n from x_d that stops a press, that of the way back [m], and the speed
on it [m/s], the supervisor's."""
APPROACH = 10
"""Number of states of the approach."""


@dataclass
class ApproachGains:
    """Parameters of the approach."""

    speed: float = 0.04
    """Speed along n until the touch [m/s]."""
    across: float = 0.05
    """Largest speed across n, to a place that may jump [m/s]."""
    follow: float = 5.0
    """Time constant by which the reference's depth follows the touched tip's [s]."""
    touch: float = 1.0
    """Force along n of a touch [N]."""
    wait: float = 2.0
    """Time before the approach, for the tare of the sensor [s]."""


@dataclass
class ObserverGains:
    """Rates λ of the disturbance observer of a nominal MPC."""

    vehicle: float = 0.8
    """That of the vehicle's pose [1/s]."""
    tip: float = 1.3
    """That of the tip's task [1/s]."""


@dataclass
class RobotGains:
    """Gains of every law on one robot."""

    largest: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Largest commanded |τᵢ| (6+n,) [N, N m]; zero on an axis that nothing drives."""
    approach: ApproachGains = field(default_factory=ApproachGains)
    hold: shared_laws.HoldGains = field(default_factory=shared_laws.HoldGains)
    impedance: ImpedanceGains = field(default_factory=ImpedanceGains)
    admittance: AdmittanceGains = field(default_factory=AdmittanceGains)
    decoupled: sliding_mode.SlidingGains = field(default_factory=sliding_mode.SlidingGains)
    coupled: sliding_mode.SlidingGains = field(default_factory=sliding_mode.SlidingGains)
    performance: PerformanceGains = field(default_factory=PerformanceGains)
    offset_free: ObserverGains = field(default_factory=ObserverGains)


def robots_with_gains() -> list[str]:
    """Returns the names of the robots with a file of gains."""
    return sorted(path.stem for path in FOLDER.glob("*.yaml"))


def read_gains(robot: str) -> RobotGains:
    """Returns the gains of a robot by its name."""
    require(robot in robots_with_gains(), "robot", robot,
            f"one with gains of the baselines: {', '.join(robots_with_gains())}")
    return load_typed(RobotGains, read_yaml(FOLDER / f"{robot}.yaml"))


Laws = dict[str, Law]


def _shared(gains: RobotGains) -> Laws:
    return {"hold": shared_laws.VehicleHold(gains.hold), "compensation": shared_laws.Compensation(),
            "feedforward": shared_laws.ForceFeedforward()}


BASELINES: dict[str, Callable[[RobotGains], Laws]] = {
    "impedance": lambda gains: {
        "law": Impedance(gains.impedance), **_shared(gains)},
    "admittance": lambda gains: {
        "law": Admittance(gains.admittance, len(gains.largest) - 6), **_shared(gains)},
    "sliding_decoupled": lambda gains: {
        "law": sliding_mode.DecoupledArm(gains.decoupled),
        "hold": sliding_mode.DecoupledVehicle(gains.decoupled),
        "compensation": shared_laws.Compensation(), "feedforward": shared_laws.ForceFeedforward()},
    "sliding_coupled": lambda gains: {
        "law": sliding_mode.Coupled(gains.coupled), "compensation": shared_laws.Compensation()},
    "prescribed_performance": lambda gains: {
        "law": PrescribedPerformance(gains.performance, len(gains.largest)),
        "feedforward": shared_laws.ForceFeedforward(joints=True)},
    "prescribed_performance_gravity": lambda gains: {
        "law": PrescribedPerformance(gains.performance, len(gains.largest)),
        "gravity": shared_laws.Gravity(), "feedforward": shared_laws.ForceFeedforward(joints=True)},
}
"""Laws whose sum is the command of a baseline, by the baseline's name."""


def moved_reference(
    gains: ApproachGains, n: np.ndarray, x: np.ndarray, tip: np.ndarray, place: np.ndarray,
    touched: bool, time: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Returns the next x_d and ẋ_d (3,): along n at `speed`, or after the tip; across to `place`.

    Args:
        gains: Its parameters.
        n: Direction (3,).
        x: Last x_d (3,) [m].
        tip: Measured position of the tip (3,) [m].
        place: Place across n (3,) [m].
        touched: Whether the tip is in contact.
        time: Instant [s].
    """
    if time < gains.wait:
        return x, np.zeros(3)
    along = n @ (tip - x) / gains.follow if touched else gains.speed
    across = place - x - n * (n @ (place - x))
    distance = float(np.linalg.norm(across))
    if distance > 0.0:
        across = across * min(gains.across, distance / PERIOD) / distance
    v = along * n + across
    return x + PERIOD * v, v


def next_approach(gains: ApproachGains, task: PressTask, old: np.ndarray, tip: np.ndarray,
                  read: float, place: np.ndarray, time: float) -> np.ndarray:
    """Returns the next state (10,): x_d, ẋ_d, force, contact and since when, n·x_d of a stop's end.

    A force above the task's largest, or a tip that strays across n, stops the press for good: x_d
    goes back along −n from the tip, as if it were not in contact.

    Args:
        gains: Its parameters.
        task: The task, whose direction and largest force are used.
        old: The state (10,): the force is smoothed, and the end infinite while there is no stop.
        tip: Measured position of the tip (3,) [m].
        read: Measured force along n [N].
        place: Place across n (3,) [m].
        time: Instant [s].
    """
    # A stop is latched in its end.
    n, x, end = task.direction, old[:3], old[9]
    force = old[6] + PERIOD / SMOOTHING * (read - old[6])
    strayed = np.linalg.norm(tip - x - n * (n @ (tip - x))) > STRAY
    if np.isinf(end) and np.isfinite(task.largest) and (read > task.largest or strayed):
        x, end = tip, n @ tip - BACK
    touched = bool(np.isinf(end)) and force > gains.touch * (RELEASE if old[7] else 1.0)
    if np.isinf(end):
        x, v = moved_reference(gains, n, x, tip, place, touched, time)
    else:
        v = -BACK_SPEED * n * (n @ x > end)
        x = x + PERIOD * v
    since = time if touched != bool(old[7]) else old[8]
    return np.concatenate([x, v, [force, float(touched), since, end]])


class Baseline(WiredSystem):
    """Controller of a press: approach, a sum of laws, and the limit of their sum.

    ::

        state, force_measured, desired_force, place ─▶ approach ─▶ Measured
                                     Measured ┌───────────────┘
                                              ├─▶ law          ─┐
                                              ├─▶ hold         ─┼─(+)─▶ limit ─▶ tau
                                              └─▶ compensation ─┘

    .. pydrake_system::

        name: Baseline
        input_ports:
        - state
        - force_measured
        - desired_force (optional)
        - place (optional)
        output_ports:
        - tau
        - input_limited
        - reference
        - memory

    - `state`: (𝔮, ζ) (2(6+n)) measured; `force_measured`: 𝔉_s (6) [N, N m].
    - `desired_force` (6): 𝔉_des [N, N m], of which the part along n is used; the task's if
      unconnected.
    - `place` (3): place across n [m]; the task's if unconnected.
    - `tau`: τ (6+n) [N, N m], within the actuators' limits; `input_limited` (1): 1 while they cut
      it, and integrals only shrink.
    - `reference` (9): see `Reference`.
    - `memory` (m): states of the law named "law".

    The discrete state is that of the approach (10) and the memories of the laws. The first
    initialisation sets x_d to the measured tip; it is NaN before. A stop clears the memory of
    each law, as that defines it.

    Args:
        model: The controller's model; its contact is not used.
        task: The task.
        laws: Laws by name, whose sum is the command; one is "law".
        gains: Parameters of approach and limit.
    """

    def __init__(self, model: UvmsModel, task: PressTask, laws: Laws, gains: RobotGains):
        super().__init__()
        largest = gains.largest
        require("law" in laws, "laws", sorted(laws), "laws by name, one of them 'law'")
        require(bool(np.all(largest >= 0.0)), "largest", largest, "positive, or 0 if not driven")
        self._model, self._task, self._gains = model, task, gains
        self._laws, self._names = list(laws.values()), list(laws)
        self._ends = np.cumsum([APPROACH, *(law.memory for law in self._laws)])
        self._state, self._force, self._desired, self._place = (
            self.DeclareVectorInputPort(name, size) for name, size in (
                ("state", 2 * model.size), ("force_measured", 6), ("desired_force", 6),
                ("place", 3)))
        # The reference is that of the first initialisation; there is no stop yet.
        begin = np.zeros(self._ends[-1])
        begin[:3], begin[APPROACH - 1] = np.nan, np.inf
        self.DeclareDiscreteState(begin)
        self.DeclareInitializationDiscreteUpdateEvent(self._begin)
        self.DeclarePeriodicDiscreteUpdateEvent(PERIOD, PERIOD, self._update)
        read = {port.ticket() for port in (self._state, self._force, self._desired)}
        now = {self.time_ticket(), self.xd_ticket()}
        self._now = cached(self, "what the laws read", self._measured, read | now)
        self._sum = cached(self, "sum of the laws", self._summed,
                           {self._now.ticket(), self.xd_ticket()})
        self._most = np.where(largest > 0.0, largest, np.inf)
        output_of(self, "tau", model.size, lambda context: np.clip(
            self._sum.Eval(context), -largest, largest), {self._sum.ticket()})
        output_of(self, "input_limited", 1, lambda context: [float(self._is_limited(context))],
                  {self._sum.ticket()})
        output_of(self, "reference", 9, lambda context: np.hstack(self._reference(context)),
                  {self.xd_ticket(), self._desired.ticket()})
        output_of(self, "memory", laws["law"].memory, lambda context: self._memories(context)[
            self._names.index("law")], {self.xd_ticket()})

    def _memories(self, context: Context) -> list[np.ndarray]:
        return np.split(context.get_discrete_state_vector().value(), self._ends[:-1])[1:]

    def _reference(self, context: Context) -> Reference:
        old, force = context.get_discrete_state_vector().value()[:9], self._task.force
        if self._desired.HasValue(context):
            force = float(self._task.direction @ self._desired.Eval(context)[:3])
        return Reference(old[:3], old[3:6], force, bool(old[7]), old[8])

    def _measured(self, context: Context) -> Measured:
        config, zeta = np.split(self._state.Eval(context), 2)
        return Measured(self._model, self._task, context.get_time(), config, zeta,
                        self._force.Eval(context), self._reference(context))

    def _summed(self, context: Context) -> np.ndarray:
        now = self._now.Eval(context)
        return functools.reduce(np.add, [law.tau(now, memory) for law, memory in zip(
            self._laws, self._memories(context), strict=True)])

    def _is_limited(self, context: Context) -> bool:
        return bool(np.any(np.abs(self._sum.Eval(context)) > self._most))

    def _tip(self, context: Context) -> np.ndarray:
        return self._model.task_pose(self._state.Eval(context)[: self._model.size])[:3]

    def _begin(self, context: Context, state: DiscreteValues) -> None:
        values = context.get_discrete_state_vector().value().copy()
        if np.isnan(values[0]):
            values[:3] = self._tip(context)
            state.set_value(values)

    def _update(self, context: Context, state: DiscreteValues) -> None:
        now, limited = self._now.Eval(context), self._is_limited(context)
        place = self._place.Eval(context) if self._place.HasValue(context) else self._task.place
        old = context.get_discrete_state_vector().value()[:APPROACH]
        approach = next_approach(self._gains.approach, self._task, old, self._tip(context),
                                 now.force, place, now.time)
        memories = [law.updated(now, memory, limited) for law, memory in zip(
            self._laws, self._memories(context), strict=True)]
        if np.isinf(old[-1]) and np.isfinite(approach[-1]):
            memories = [law.stopped(memory) for law, memory in zip(
                self._laws, memories, strict=True)]
        state.set_value(np.concatenate([approach, *memories]))
