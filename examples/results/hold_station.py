"""Runs that go on from a hold of an unknown wall, with scripted sensor errors and disturbances."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

import uvms_drake as uv
from uvms_drake.model.frames.euler import rotation_matrix
from uvms_drake.model.surface.contact_laws import dissipation_factor
from uvms_drake.plant.disturbance import OpenLoopDisturbance
from uvms_drake.report.contact_check import has_stood
from uvms_drake.sensing.force_sensor import ForceSensor
from uvms_drake.sensing.wrist_sensor import Imperfection
from uvms_drake.station.contact.bounds import mean_time, pressing_force, sensed_contact
from uvms_drake.station.problem import load_model
from uvms_drake.station.simulation import make_record

PATIENCE = 50.0
"""Longest time that a plan may take to stand [s]."""
DRIFTS = 0.5
"""Drift over its bound, so that it is in it for twice the scenario's duration."""
NOTHING = np.zeros(6)
GRIP = 0.9
"""Rate of the friction over the largest one in a hold; the rest is left to changes of the force."""
PARTS = 4
"""Intervals of constant disturbance in a period of the MPC."""


def noisy(index: int, along: np.ndarray = NOTHING, size: float = 0.0) -> np.ndarray:
    """Returns noise over its bound (6,): drawn, but for a given size along given components.

    Of a sensor that is quiet in all components a reading repeats, and is taken for a frozen one.
    """
    drawn = np.clip(np.random.default_rng(index).normal(0.0, 1.0 / 3.0, 6), -1.0, 1.0)
    return np.where(along == 0.0, drawn, size * along)


@dataclass
class ScriptedSensor(ForceSensor):
    """A force sensor whose noise is a function of the sample, by `script` times its bound."""

    drifts: float = 0.0
    """Drift over its bound."""
    script: Callable[[int], np.ndarray] = noisy
    """Function of the sample, within ±1 (6,); it may be set while it runs."""

    def imperfection(self, seed: int) -> Imperfection:
        """Returns the errors of this copy."""
        largest = self.noise_multiple * np.asarray(self.noise, dtype=float)
        # Such that the tare is rounded by half a step, in the sense of its noise.
        step = np.asarray(self.resolution, dtype=float)
        sign = np.sign(self.drifts)
        bias = sign * largest + (0.5 - 1e-3 * sign) * step
        return Imperfection(bias, self.drifts * np.asarray(self.drift, dtype=float),
                            lambda index: largest * np.clip(self.script(index), -1.0, 1.0))


@dataclass
class ScriptedDisturbance(OpenLoopDisturbance):
    """A disturbance that is constant in intervals, by rows that are set while it runs."""

    period: float = 0.05
    """Length of an interval [s]."""
    rows: int = 1
    """Number of intervals."""

    def system(self, size: int, seed: int = 0) -> LeafSystem:
        """Returns the source."""
        return Rows(self.axes(size), self.period, self.rows)


class Rows(LeafSystem):
    """Puts out rows of parameters times semi-axes, one after the other; then zeros."""

    def __init__(self, axes: np.ndarray, period: float, rows: int):
        super().__init__()
        self._axes, self._period = axes, period
        self.DeclareNumericParameter(BasicVector(np.zeros(rows * len(axes))))
        self.DeclareNumericParameter(BasicVector(np.zeros(1)))
        self.DeclareDiscreteState(len(axes))
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._next)
        self.DeclareVectorOutputPort("disturbance", len(axes), lambda context, output: (
            output.SetFromVector(context.get_discrete_state_vector().value())), {self.xd_ticket()})

    def _next(self, context: Context, state: DiscreteValues) -> None:
        rows = context.get_numeric_parameter(0).value().reshape(-1, len(self._axes))
        since = context.get_time() - context.get_numeric_parameter(1).value()[0]
        index = round(since / self._period)
        state.set_value(self._axes * rows[index] if 0 <= index < len(rows) else 0.0 * self._axes)

    def play(self, context: Context, rows: np.ndarray) -> None:
        """Sets the rows (rows, size), in the unit ball, from the Context's time on."""
        own = self.GetMyMutableContextFromRoot(context)
        own.get_mutable_numeric_parameter(0).SetFromVector(rows.ravel())
        own.get_mutable_numeric_parameter(1).SetFromVector([context.get_time()])


@dataclass
class Grip:
    """Share of the largest friction on a tip at rest: it changes at a rate, from a time on."""

    rate: float = 0.0
    """Its rate, from 1 to −1 [1/s]."""
    start: float = 0.0
    """Time at which it begins to change [s]."""
    now: float = 1.0
    """The present share."""

    def update(self, context: Context) -> None:
        """Takes the share at the Context's time."""
        self.now = max(1.0 - self.rate * max(context.get_time() - self.start, 0.0), -1.0)


@dataclass
class GrippingSurface(uv.ShapedSurface):
    """A flat surface whose friction is along a tangent, as stiction may leave it."""

    tangent: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    """Direction of the friction (3,)."""
    grip: Grip = field(default_factory=Grip)
    """Share of μ; of all copies the same."""

    def force(self, chi: np.ndarray, chi_dot: np.ndarray) -> np.ndarray:
        """Returns 𝔉 (..., 6)."""
        depth, gradient = self.geometry.depth_and_gradient(chi[..., :3])
        rate = (gradient * chi_dot[..., :3]).sum(axis=-1)
        load = self.law.force(depth) * dissipation_factor(self.dissipation * rate)
        direction = gradient + self.friction * self.grip.now * np.asarray(self.tangent)
        return np.concatenate([load[..., None] * direction, np.zeros_like(direction)], axis=-1)

    def slip_damping(self, force: float) -> float:
        """Returns zero: the friction is not of the velocity."""
        return 0.0

    def static_force(self, chi: np.ndarray) -> np.ndarray:
        """Returns φ (...) [N]."""
        return self.law.force(self.geometry.depth(chi[..., :3]))


class Attack(NamedTuple):
    """Errors of a run."""

    noise: np.ndarray
    """Noise of its samples over the bound (samples, 6)."""
    disturbance: np.ndarray
    """Rows of the disturbance, in the unit ball (intervals, 6+n)."""
    grip_start: float = np.inf
    """Time from its begin at which the friction starts to turn [s]."""


class Held(NamedTuple):
    """A hold to go on from."""

    context: Context
    """Context of the simulator."""
    logs: dict[str, np.ndarray]
    """The logs until then."""


class HoldStation:
    """Closed loop of a scenario with scripted sensor and disturbance.

    Args:
        scenario: Scenario with a `GrippingSurface` and a sensed contact, and its certified tube.
        sign: Sign of the constant error of a reading along n, which the tare has.
        duration: Duration of a run [s].
    """

    def __init__(self, scenario: uv.Scenario, sign: float, duration: float):
        shipped, = scenario.sensing
        self.sensor = ScriptedSensor(**vars(shipped), drifts=DRIFTS * sign)
        self.interval = scenario.mpc.time_step / PARTS
        self.duration, self.intervals = duration, round(duration / self.interval)
        declared = scenario.disturbance
        scenario = replace(
            scenario, duration=PATIENCE, log_period=0.01, sensing=[self.sensor],
            disturbance=ScriptedDisturbance(
                declared.bound, self.interval, self.intervals, weights=declared.weights))
        self.model, self.sign, self.grip = load_model(scenario), sign, scenario.surface.grip
        self.scenario = uv.with_step(scenario, self.model)
        self.contact = sensed_contact(scenario)
        # Errors along n in the sensor's axes, in the attitude of the task.
        R = rotation_matrix(np.asarray(scenario.task.pose, dtype=float)[3:])
        self.along = np.append(np.sign(np.round(R.T @ self.contact.direction, 6)), np.zeros(3))
        self.station = uv.make_station(self.scenario, certified=True, model=self.model)
        self.source = self.station.GetSubsystemByName("disturbance")
        self.simulator = Simulator(self.station)
        ApplySimulatorConfig(self.scenario.simulator, self.simulator)
        self.simulator.set_monitor(self.grip.update)
        self.station.GetInputPort("desired_force").FixValue(
            self.simulator.get_mutable_context(),
            self.contact.wrench(pressing_force(self.scenario)))

    def first_hold(self) -> Held:
        """Returns the first hold, with the largest constant error of the readings."""
        tare, rate = self.sensor.tare_samples, self.sensor.rate
        self.sensor.script = lambda index: noisy(index, self.along, -self.sign * (index < tare))
        self._advance_until_stood()
        begun = self.simulator.get_context().get_time()

        def ramp(index: int) -> np.ndarray:
            since = index / rate - begun
            return noisy(index, self.along, self.sign * min(max(since / 2.0, 0.0), 1.0))

        self.sensor.script = ramp
        self._advance(2.0 + mean_time(self.scenario))  # All readings of the target have it.
        return self._advance_until_stood()

    def next_hold(self, held: Held, force: float) -> Held:
        """Returns the hold after a change of the desired force [N]."""
        self._go_back(held)
        self.sensor.script = lambda index: noisy(index, self.along, self.sign)
        context = self.simulator.get_mutable_context()
        self.station.GetInputPort("desired_force").FixValue(context, self.contact.wrench(force))
        self._advance(1.0)
        found = self._advance_until_stood()
        logs = {name: np.concatenate([held.logs[name], each]) if len(each) == len(
            found.logs["time"]) else each for name, each in found.logs.items()}
        return Held(found.context, logs)

    def run(self, held: Held, attack: Attack) -> uv.Record:
        """Returns the record of a run that goes on from a hold, with the hold's last seconds."""
        self._go_back(held)
        context = self.simulator.get_mutable_context()
        begin, rate = context.get_time(), self.sensor.rate
        first = round(begin * rate)
        last = len(attack.noise) - 1
        self.sensor.script = lambda index: attack.noise[min(max(index - first, 0), last)]
        self.source.play(context, attack.disturbance)
        self.grip.start = begin + attack.grip_start
        self.grip.rate = GRIP * self.contact.hold_forces.force_rate / (
            self.contact.friction * self.contact.walls.depth(held.logs["force"][-1, :3]))
        self.simulator.AdvanceTo(begin + self.duration)
        logs = uv.read_logs(self.station, context)
        late = held.logs["time"] > begin - 2.0
        late &= held.logs["time"] < logs["time"][0] - 1e-6
        logs = {name: np.concatenate([held.logs[name][late], each]) if len(each) == len(
            logs["time"]) and len(held.logs[name]) == len(late) else each
            for name, each in logs.items()}
        return make_record(self.scenario, self.model, logs, 1.0, certified=True)

    def _advance(self, time: float) -> None:
        """Advances by a time [s] at least, to a sampling instant of the MPC, before its events."""
        step, now = self.scenario.mpc.time_step, self.simulator.get_context().get_time()
        self.simulator.AdvanceTo(float(np.ceil((now + time) / step - 1e-6)) * step)

    def _advance_until_stood(self) -> Held:
        """Advances until the plan has stood in contact for the time of a hold."""
        context = self.simulator.get_mutable_context()
        while context.get_time() < PATIENCE:
            self._advance(0.5)
            logs = uv.read_logs(self.station, context)
            record = make_record(self.scenario, self.model, logs, 1.0, certified=True)
            if has_stood(record)[-1] and record.signals["touched"][-1, 0] > 0.0:
                return Held(context.Clone(), logs)
        raise SystemExit(f"{self.scenario.name}: the plan does not stand within {PATIENCE:g} s")

    def _go_back(self, held: Held) -> None:
        """Sets the simulator to a hold, with empty logs."""
        context = self.simulator.get_mutable_context()
        context.SetTimeStateAndParametersFrom(held.context)
        port = self.station.GetInputPort("desired_force")
        port.FixValue(context, port.Eval(held.context))
        for system in self.station.GetSystems():
            if system.get_name().startswith("log."):
                system.FindMutableLog(context).Clear()
        self.grip.rate, self.grip.now = 0.0, 1.0
        self.simulator.Initialize()
