"""Closed loop of any controller of a press, and its run; the plant and its parts are a station's.

The controller is a Diagram or LeafSystem with the ports `state`, `force_measured` and `tau`, and
optional others: `desired_force`, `place`, and those by which the tube MPC reads its measurements.
"""

import time
from dataclasses import dataclass

import numpy as np
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from pydrake.systems.framework import (
    Context,
    Diagram,
    DiagramBuilder,
    DiscreteValues,
    EventStatus,
    LeafSystem,
    System,
)
from pydrake.systems.primitives import Adder, LogVectorOutput

from uvms_drake.common.errors import RunFailed
from uvms_drake.common.wiring import output_of, outputs, release
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.signals.sensor_actuator import Signals
from uvms_drake.plant.waves import WaterMotion
from uvms_drake.station.controller import connect_controller, signals_of
from uvms_drake.station.plant import applied_disturbance, make_simulated_uvms
from uvms_drake.station.scenario.scenario import Scenario

LOGGED = ("state", "chi", "force", "penetration")
"""Signals of the plant in a `Trace`."""
LARGEST_FORCE = 500.0
"""Force at which a run is ended: a wall or an arm breaks before it [N]."""
EVENTS = "events"
"""Name of the `TouchEvents` in a loop."""


@dataclass(frozen=True)
class Events:
    """Events of a run that depend on its touch, and not on a scenario's time alone."""

    impulse: np.ndarray
    """Acceleration of the vehicle for a second from the touch on (6,) [m/s², rad/s²]."""
    slide: np.ndarray
    """Displacement of the place in contact (3,) in Σ_I [m]."""
    latest: float
    """Instant at which a run without a touch ends [s]."""
    after: float
    """Time from the touch to the end of a run [s]."""
    slide_start: float = 3.0
    """Time from the touch until the place begins to move [s]."""
    slide_speed: float = 0.05
    """Its speed [m/s]."""

    def end(self, touch: float) -> float:
        """Returns the end of a run [s] that touches at an instant, infinite for not yet."""
        return self.latest if np.isinf(touch) else touch + self.after


@dataclass(frozen=True)
class Trace:
    """Logged signals of a run, T samples."""

    time: np.ndarray
    """(T,) [s]."""
    signals: dict[str, np.ndarray]
    """`state`, `chi`, `force`, `penetration`, `tau`, `exerted`, `place`, and others (T, size)."""
    step_seconds: np.ndarray
    """Processor times of steps of the controller (K,) [s]."""
    ended: str
    """Reason of an early end; empty for none."""


class TouchEvents(LeafSystem):
    """Source of the events of a run.

    .. pydrake_system::

        name: TouchEvents
        input_ports:
        - force
        output_ports:
        - impulse
        - place

    - `force`: the true 𝔉 (6) [N, N m].
    - `impulse`: acceleration (6+n) [m/s², rad/s²]; `place`: place across n (3) [m].

    The discrete state is the instant of the first touch [s], infinite before (1).

    Args:
        events: The events.
        place: Place at the start (3,) [m].
        size: 6 + n.
    """

    def __init__(self, events: Events, place: np.ndarray, size: int):
        super().__init__()
        self._events, self._place, self._size = events, place, size
        self._port = self.DeclareVectorInputPort("force", 6)
        self.DeclareDiscreteState([np.inf])
        self.DeclarePerStepDiscreteUpdateEvent(self._update)
        now = {self.time_ticket(), self.xd_ticket()}
        output_of(self, "impulse", size, self._impulse, now)
        output_of(self, "place", 3, self._moved_place, now)

    def _update(self, context: Context, state: DiscreteValues) -> None:
        touch = context.get_discrete_state_vector().value()[0]
        if np.isinf(touch) and np.any(self._port.Eval(context)[:3]):
            state.set_value([context.get_time()])

    @staticmethod
    def touch(context: Context) -> float:
        """Returns the instant of the first touch [s], infinite before, from its own Context."""
        return float(context.get_discrete_state_vector().value()[0])

    def _impulse(self, context: Context) -> np.ndarray:
        out = np.zeros(self._size)
        if 0.0 <= context.get_time() - self.touch(context) < 1.0:
            out[:6] = self._events.impulse
        return out

    def _moved_place(self, context: Context) -> np.ndarray:
        events = self._events
        length = float(np.linalg.norm(events.slide))
        since = context.get_time() - self.touch(context) - events.slide_start
        moved = np.clip(events.slide_speed * since, 0.0, length)
        return self._place + (events.slide * moved / length if length > 0.0 else 0.0)


def make_loop(scenario: Scenario, model: ContactModel, controller: System, events: Events
              ) -> Diagram:
    """Returns plant, sensors, controller and actuators of a scenario as a Diagram.

    Raises:
        InvalidParameter: A value of the scenario cannot be used, or a port is missing.
    """
    builder = DiagramBuilder()
    uvms = builder.AddNamedSystem("uvms", make_simulated_uvms(
        scenario, None, scenario.start.config))
    builder.AddNamedSystem("controller", controller)
    WaterMotion.AddToBuilder(builder, scenario.current, scenario.waves, plant=uvms)
    signals = Signals({name: port for name, port in (
        outputs(uvms) | signals_of(controller)).items() if name != "plant_state"})
    source = builder.AddNamedSystem(
        EVENTS, TouchEvents(events, scenario.task.place, model.size))
    builder.Connect(signals["force"], source.get_input_port())
    if controller.HasInputPort("place"):
        builder.Connect(source.GetOutputPort("place"), controller.GetInputPort("place"))
    _, exerted = connect_controller(
        builder, scenario, model, controller, signals["state"], signals,
        [fault for fault in scenario.faults if fault.place == "force"])
    builder.Connect(exerted, uvms.GetInputPort("tau"))

    # Disturbance.
    total = builder.AddNamedSystem("disturbances", Adder(2, model.size))
    applied = applied_disturbance(
        scenario.disturbance, scenario.model_error.share, scenario.faults)
    disturbance = applied.add_to(builder, model, scenario.seed, signals)
    builder.Connect(disturbance, total.get_input_port(0))
    builder.Connect(source.GetOutputPort("impulse"), total.get_input_port(1))
    builder.Connect(total.get_output_port(), uvms.GetInputPort("disturbance"))

    logged = {name: signals[name] for name in (*LOGGED, "tau", "wrench_shortfall")
              if name in signals}
    logged |= {"exerted": exerted, "place": source.GetOutputPort("place")}
    for name, port in (("limited", "input_limited"), ("memory", "memory")):
        if controller.HasOutputPort(port):
            logged[name] = controller.GetOutputPort(port)
    for name, port in logged.items():
        LogVectorOutput(port, builder, scenario.log_period).set_name(f"log.{name}")
    if controller.HasOutputPort("solve_seconds"):
        LogVectorOutput(controller.GetOutputPort("solve_seconds"), builder,
                        scenario.mpc.time_step).set_name("log.solve_seconds")
    loop = builder.Build()
    loop.set_name("loop")
    return loop


def run_loop(scenario: Scenario, model: ContactModel, controller: System, events: Events) -> Trace:
    """Returns the trace of a run until `events.end`; one that fails before it says so."""
    loop = make_loop(scenario, model, controller, events)
    ended = ""
    try:
        simulator = Simulator(loop)
        ApplySimulatorConfig(scenario.simulator, simulator)
        context = simulator.get_mutable_context()
        uvms, source = loop.GetSubsystemByName("uvms"), loop.GetSubsystemByName(EVENTS)
        force = uvms.GetOutputPort("force")

        def ends(root: Context) -> EventStatus:
            """Ends a run at its time, or as soon as its force would break something."""
            nonlocal ended
            read = force.Eval(uvms.GetMyContextFromRoot(root))
            if not read[:3] @ read[:3] < LARGEST_FORCE**2:
                ended = f"force beyond {LARGEST_FORCE:g} N"
            elif root.get_time() < events.end(
                    TouchEvents.touch(source.GetMyContextFromRoot(root))) - 1e-6:
                return EventStatus.DidNothing()
            return EventStatus.ReachedTermination(loop, "end")

        # A run that fails on the way has a trace; one that cannot begin has none.
        simulator.set_monitor(ends)
        simulator.Initialize()
        try:
            simulator.AdvanceTo(scenario.duration)
        except (RunFailed, RuntimeError, np.linalg.LinAlgError) as error:
            ended = f"{type(error).__name__}: {' '.join(str(error).split())}"
        steps = _log(loop, context, "solve_seconds") if "log.solve_seconds" in _names(loop) else (
            _step_seconds(loop, context, controller))
        names = [name.removeprefix("log.") for name in _names(loop) if name.startswith("log.")]
        signals = {name: _log(loop, context, name) for name in names if name != "solve_seconds"}
        times = loop.GetSubsystemByName("log.state").FindLog(context).sample_times().copy()
    finally:
        release(loop)
    return Trace(times, signals, steps.reshape(-1), ended)


def _names(loop: Diagram) -> list[str]:
    return [system.get_name() for system in loop.GetSystems()]


def _log(loop: Diagram, context: Context, name: str) -> np.ndarray:
    data: np.ndarray = loop.GetSubsystemByName(f"log.{name}").FindLog(context).data().T.copy()
    return data


def _step_seconds(loop: Diagram, context: Context, controller: System, steps: int = 20
                  ) -> np.ndarray:
    """Returns processor times of a law's evaluation from scratch, without its sensors (K,) [s]."""
    own, out = controller.GetMyContextFromRoot(context), []
    alone = controller.CreateDefaultContext()
    for name in ("state", "force_measured"):
        port = controller.GetInputPort(name)
        port.FixValue(alone, port.Eval(own))
    for i in range(steps):
        alone.SetTime(float(i))
        port = controller.GetInputPort("state")
        port.FixValue(alone, port.Eval(alone))
        begun = time.process_time()
        controller.GetOutputPort("tau").Eval(alone)
        out.append(time.process_time() - begun)
    return np.array(out)
