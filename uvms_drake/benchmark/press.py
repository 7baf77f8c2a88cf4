"""A press with any controller in the station of a scenario, and its figures of merit.

The controller is a Diagram or LeafSystem with the ports `state`, `force_measured` and `tau`, and
optional others: see `make_station`.
"""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pydrake.systems import framework
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator

from uvms_drake.baselines.baseline import BACK, read_gains
from uvms_drake.common.errors import RunFailed
from uvms_drake.common.kinds import register
from uvms_drake.common.wiring import WiredSystem, output_of, release
from uvms_drake.control.limits import Limit
from uvms_drake.control.mpc.planner import HOVERED
from uvms_drake.control.plan.points import Points
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.plant.disturbance import Disturbance
from uvms_drake.report.signals import settling_index
from uvms_drake.station.contact.bounds import pressing_force, sensed_contact
from uvms_drake.station.diagram import make_station, read_logs
from uvms_drake.station.problem import limits_of
from uvms_drake.station.scenario.scenario import Scenario

LARGEST_FORCE = 500.0
"""Force at which a run is ended: a wall or an arm breaks before it [N]."""
SLIDE_START, SLIDE_SPEED = 3.0, 0.05
"""Time from the touch until the place in contact begins to move [s], and its speed [m/s]."""
LAST = 3.0
"""End of a run over which force and lateral error are averaged [s]: the same time since the touch
for all controllers."""
IMPACT = 1.0
"""Time from the touch in which a force is of the impact [s]."""
SHORTFALL = 1.0
"""Part of a commanded wrench that the thrusters cannot give, from which they are saturated [N]."""
STEPS = 20
"""Evaluations of a law from which its processor time follows."""


class AfterTouch(WiredSystem):
    """Source of a function of the time since the first touch.

    .. pydrake_system::

        name: AfterTouch
        input_ports:
        - force
        output_ports:
        - value

    - `force`: the true 𝔉 (6) [N, N m].
    - `value` (size).

    The discrete state is the instant of the first touch [s], infinite before (1).

    Args:
        function: Function of the time since the touch [s], minus infinity before it.
        size: Size of its value.
    """

    def __init__(self, function: Callable[[float], np.ndarray], size: int):
        super().__init__()
        self._port = self.DeclareVectorInputPort("force", 6)
        self.DeclareDiscreteState([np.inf])
        self.DeclarePerStepDiscreteUpdateEvent(self._update)
        output_of(self, "value", size, lambda context: function(
            context.get_time() - context.get_discrete_state_vector().value()[0]),
            {self.time_ticket(), self.xd_ticket()})

    def _update(self, context: framework.Context, state: framework.DiscreteValues) -> None:
        touch = context.get_discrete_state_vector().value()[0]
        if np.isinf(touch) and np.any(self._port.Eval(context)[:3]):
            state.set_value([context.get_time()])


@register
@dataclass
class TouchImpulse(Disturbance):
    """Acceleration of the vehicle in sway by the bound, for a second from the first touch on."""

    label = "impulse"

    def add_to(self, builder: framework.DiagramBuilder, model: UvmsModel, seed: int,
               signals: Mapping[str, framework.OutputPort]) -> framework.OutputPort:
        """Adds the source of d; see `Disturbance`."""
        sway = self.bound * np.eye(model.size)[1]
        return AfterTouch.AddToBuilder(
            builder, lambda since: sway * (0.0 <= since < 1.0), model.size, name="impulse",
            force=signals["force"]).get_output_port()


@dataclass(frozen=True)
class Course:
    """Course of a run, which depends on its touch."""

    latest: float
    """Instant at which a run without a touch ends [s]."""
    after: float
    """Time from the touch to the end of a run [s]."""
    slide: np.ndarray = field(default_factory=lambda: np.zeros(3))
    """Displacement of the place in contact (3,) in Σ_I [m]."""
    event: float | None = None
    """Instant of an event outside of the class [s]; the touch is one without it."""
    lasting: float = 0.0
    """Time from the event to the end of a run [s]."""

    def end(self, touch: float) -> float:
        """Returns the end of a run [s] that touches at an instant, infinite for not yet."""
        if self.event is not None:
            return self.event + self.lasting
        return self.latest if np.isinf(touch) else touch + self.after

    def moved(self, since: float) -> np.ndarray:
        """Returns the displacement of the place (3,) [m], a time after the touch [s]."""
        length = float(np.linalg.norm(self.slide))
        moved = np.clip(SLIDE_SPEED * (since - SLIDE_START), 0.0, length)
        return self.slide * (moved / length if length > 0.0 else 0.0)


@dataclass(frozen=True)
class Trace:
    """Logged signals of a run, T samples."""

    time: np.ndarray
    """(T,) [s]."""
    signals: dict[str, np.ndarray]
    """Signals of the station, and `place` (T, size)."""
    step_seconds: np.ndarray
    """Processor times of steps of the controller (K,) [s]."""
    ended: str
    """Reason of an early end; empty for none."""


def run_press(scenario: Scenario, model: ContactModel, controller: framework.System, course: Course
              ) -> Trace:
    """Returns the trace of a run until `Course.end`; one that fails before it says so."""
    builder, place = framework.DiagramBuilder(), scenario.task.place
    station = builder.AddNamedSystem(
        "station", make_station(scenario, controller=controller, model=model))
    if station.HasInputPort("place"):
        source = AfterTouch.AddToBuilder(
            builder, lambda since: place + course.moved(since), 3, name="place",
            force=station.GetOutputPort("force"))
        builder.Connect(source.get_output_port(), station.GetInputPort("place"))
    loop, force = builder.Build(), station.GetOutputPort("force")
    ended, touch = "", np.inf

    def ends(root: framework.Context) -> framework.EventStatus:
        """Ends a run at its time, or as soon as its force would break something."""
        nonlocal ended, touch
        read, now = force.Eval(station.GetMyContextFromRoot(root))[:3], root.get_time()
        touch = min(touch, now) if np.any(read) else touch
        if not read @ read < LARGEST_FORCE**2:
            ended = f"force beyond {LARGEST_FORCE:g} N"
        elif now < course.end(touch) - 1e-6:
            return framework.EventStatus.DidNothing()
        return framework.EventStatus.ReachedTermination(loop, "end")

    # A run that fails on the way has a trace; one that cannot begin has none.
    try:
        simulator = Simulator(loop)
        ApplySimulatorConfig(scenario.simulator, simulator)
        context = simulator.get_mutable_context()
        simulator.set_monitor(ends)
        simulator.Initialize()
        try:
            simulator.AdvanceTo(scenario.duration)
        except (RunFailed, RuntimeError, np.linalg.LinAlgError) as error:
            ended = f"{type(error).__name__}: {' '.join(str(error).split())}"
        logs = read_logs(station, context)
        # Of an MPC the samples at which it plans; there is nothing to compute where it hovers.
        steps = logs["step_seconds"][logs["mpc_status"] != HOVERED] if "step_seconds" in logs else (
            step_seconds(controller, controller.GetMyContextFromRoot(context)))
    finally:
        release(loop)
    logs["place"] = place + np.array([course.moved(now - touch) for now in logs["time"]])
    return Trace(logs["time"], logs, steps, ended)


def step_seconds(controller: framework.System, own: framework.Context) -> np.ndarray:
    """Returns processor times of a law's evaluation from scratch, without its sensors (K,) [s]."""
    alone, out = controller.CreateDefaultContext(), []
    alone.SetTimeStateAndParametersFrom(own)
    for port in map(controller.get_input_port, range(controller.num_input_ports())):
        if port.HasValue(own):
            port.FixValue(alone, port.Eval(own))
    for i in range(STEPS):
        alone.SetTime(float(i))
        port = controller.GetInputPort("state")
        port.FixValue(alone, port.Eval(alone))
        begun = time.process_time()
        controller.GetOutputPort("tau").Eval(alone)
        out.append(time.process_time() - begun)
    return np.array(out)


def measure(scenario: Scenario, model: ContactModel, trace: Trace, event: float | None = None
            ) -> dict[str, Any]:
    """Returns the figures of merit of a run; None where there is none, as of a run without touch.

    `force_rms` and `lateral` are of the last `LAST` seconds of a run, which ends a given time after
    the touch; of motion during a slide. `peak` is the largest force of the run, or from the event
    on, `impact` that of the first `IMPACT` seconds from the touch. `settling` is the time from the
    touch until the force stays within the task's tolerance. `limits` are the broken limits of pose
    and speed with the largest excess, in the limit's unit, and `force`, that of the declared
    contact. `saturated` is the part of the time in which a limit cuts the command. `chatter` is the
    total variation of a command per second over the largest |τᵢ| of its axis, of the worst axis
    [1/s]. `energy` is ∫Σ|τᵢζᵢ|dt. `step_ms` and `worst_step_ms` are processor times. `above` is the
    time with more than the declared force [s], `off` the largest distance of the vehicle from the
    way straight back, as long as that of a stop, from where it is at the event, or else the touch
    [m]; `beyond` that of a joint from its range [rad], both of the run or from the event on.
    """
    # Force and contact along the declared direction, from the true signals.
    contact, n = sensed_contact(scenario), sensed_contact(scenario).direction
    now, signals, steps = trace.time, trace.signals, trace.step_seconds
    force = signals["force"][:, :3] @ n
    off = np.abs(force - pressing_force(scenario))
    settled = settling_index(off, scenario.task.force_tolerance)
    touching = signals["penetration"].reshape(-1) > 0.0
    first = int(np.argmax(touching)) if np.any(touching) else None
    touch = None if first is None else float(now[first])
    last, pressed = now >= now[-1] - LAST, touch is not None and not trace.ended
    way = signals["chi"][:, :3] - signals["place"]
    lateral = np.linalg.norm(way - np.outer(way @ n, n), axis=1)
    begun = touch if event is None else event
    since = now >= (now[0] if event is None else min(event, now[-1]))
    joints = signals["state"][since, 6: model.size]
    beyond = np.max(np.maximum(joints - model.q_upper, model.q_lower - joints))
    after = signals["state"][now >= (np.inf if begun is None else begun), :3]
    limits = broken_limits(limits_of(scenario, model), model, signals["state"])
    if np.max(force) > contact.force:
        limits["force"] = float(np.max(force) - contact.force)
    exerted, zeta = signals.get("exerted", signals["tau"]), signals["state"][:, model.size:]
    return {
        "ended": trace.ended or None,
        "force_rms": float(np.sqrt(np.mean(off[last]**2))) if pressed else None,
        "peak": float(np.max(force[since])),
        "impact": None if touch is None else float(
            np.max(force[(now >= touch) & (now <= touch + IMPACT)])),
        "touch": touch,
        "settling": (float(max(now[settled] - touch, 0.0))
                     if pressed and settled is not None and touch is not None else None),
        "lateral": float(np.mean(lateral[last])) if pressed else None,
        "lost": int(np.count_nonzero(np.diff(touching[first:].astype(int)) < 0)),
        "limits": limits,
        "above": float(np.sum((force > contact.force)[since]) * (now[-1] - now[0]) / len(now)),
        "off": way_off(after, n) if len(after) else None,
        "beyond": float(max(beyond, 0.0)),
        "saturated": float(np.mean(_saturated(signals, len(now)))),
        "chatter": _chatter(now, signals["tau"], read_gains(scenario.model).largest),
        "energy": float(np.trapezoid(np.sum(np.abs(exerted * zeta), axis=1), now)),
        "step_ms": 1e3 * float(np.median(steps)) if len(steps) else None,
        "worst_step_ms": 1e3 * float(np.max(steps)) if len(steps) else None,
    }


def broken_limits(limits: Mapping[str, Limit], model: ContactModel, state: np.ndarray
                  ) -> dict[str, float]:
    """Returns the largest excess of each broken limit of pose and speed, in the limit's unit."""
    config, zeta = np.split(state, 2, axis=1)
    at = Points(model, config, model.task_pose(config), zeta)
    excess = {name: float(np.max(limit.excess(at))) for name, limit in limits.items()
              if limit.about != "input"}
    return {name: value for name, value in excess.items() if value > 0.0}


def way_off(positions: np.ndarray, n: np.ndarray, back: float = BACK) -> float:
    """Returns the largest distance of positions (T, 3) [m] from the way back from the first.

    Args:
        positions: Positions of the vehicle.
        n: Direction into the wall (3,).
        back: Length of the way along −n [m].
    """
    way = positions - positions[0]
    along = np.clip(way @ n, -back, 0.0)
    return float(np.max(np.linalg.norm(way - np.outer(along, n), axis=1)))


def _saturated(signals: Mapping[str, np.ndarray], samples: int) -> np.ndarray:
    """Returns whether a limit cuts the command (T,); roll is not driven by every vehicle."""
    cut = np.zeros(samples, dtype=bool)
    if "input_limited" in signals:
        cut |= np.any(signals["input_limited"] > 0.0, axis=1)
    if "wrench_shortfall" in signals:
        rows = np.delete(signals["wrench_shortfall"], 3, axis=1)
        cut |= np.any(np.abs(rows) > SHORTFALL, axis=1)
    return cut


def _chatter(now: np.ndarray, tau: np.ndarray, largest: np.ndarray) -> float:
    """Returns the total variation of a command per second over its largest, of the worst axis."""
    variation = np.sum(np.abs(np.diff(tau, axis=0)), axis=0)[largest > 0.0]
    return float(np.max(variation / largest[largest > 0.0]) / max(now[-1] - now[0], 1e-9))
