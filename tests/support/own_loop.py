"""A loop of one's own about our plant: `uv.Controller` called at ticks, and nothing else shared."""

from typing import NamedTuple

import numpy as np
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from pydrake.systems.primitives import ConstantVectorSource, Integrator, LogVectorOutput

import uvms_drake as uv


class Rows(NamedTuple):
    """What a loop has seen and sent at its ticks."""

    time: np.ndarray
    state: np.ndarray
    tau: np.ndarray
    nominal: np.ndarray
    commands: list


class Ticks(LeafSystem):
    """Calls `step` at its ticks, and holds the command."""

    def __init__(self, controller: uv.Controller, senses: bool):
        super().__init__()
        self._controller, size = controller, controller.model.size
        self._state = self.DeclareVectorInputPort("state", 2 * size)
        self._force = self.DeclareVectorInputPort("force", 6) if senses else None
        held = self.DeclareDiscreteState(size)
        self.DeclareDiscreteState(size)
        self._delay = next(part.delay for part in controller.scenario.actuation
                           if isinstance(part, uv.actuators.SampledCommand))
        self.DeclarePeriodicDiscreteUpdateEvent(controller.period, 0.0, self._tick)
        if self._delay > 0.0:
            self.DeclarePeriodicDiscreteUpdateEvent(
                controller.period, self._delay, lambda context, state: state.set_value(
                    0, context.get_discrete_state(1).value()))
        self.DeclareStateOutputPort("tau", held)
        self.rows: list = []

    def _tick(self, context, state):
        now, measured = context.get_time(), self._state.Eval(context).copy()
        force = None if self._force is None else self._force.Eval(context).copy()
        command = self._controller.step(now, measured, force)
        state.set_value(1, command.tau)
        if self._delay == 0.0 or not self.rows:
            state.set_value(0, command.tau)
        self.rows.append((now, measured, command.tau,
                          self._controller.signal("nominal_state").copy(), command))


def own_loop(scenario: uv.Scenario, duration: float, **options) -> Rows:
    """Returns the rows of a loop about the plant of a scenario and its sensor of the force."""
    scenario, builder = uv.with_step(scenario), DiagramBuilder()
    controller = uv.Controller(scenario, **options)
    plant = builder.AddSystem(uv.make_plant(scenario))
    signals = uv.Signals({name: plant.GetOutputPort(name) for name in ("state", "force", "chi")})
    for part in scenario.sensing:
        part.add_to(builder, controller.model, signals["state"], signals, scenario.seed)
    ticks = builder.AddSystem(Ticks(controller, "force_measured" in signals))
    builder.Connect(signals["state"], ticks.GetInputPort("state"))
    if "force_measured" in signals:
        builder.Connect(signals["force_measured"], ticks.GetInputPort("force"))
    applied = ticks.GetOutputPort("tau")
    for part in scenario.actuation:
        if isinstance(part, uv.actuators.Thrusters):
            applied = part.add_to(builder, controller.model, applied, signals, scenario.seed)
    builder.Connect(applied, plant.GetInputPort("tau"))
    # As in the station, logs end steps of the integrator, and its vector has the six states of the
    # tube's monitor: Drake's sums over it differ in the last digit at the end of a vector.
    LogVectorOutput(signals["state"], builder, scenario.log_period)
    others = builder.AddSystem(Integrator(6))
    builder.Connect(builder.AddSystem(ConstantVectorSource(np.zeros(6))).get_output_port(),
                    others.get_input_port())
    loop = builder.Build()
    simulator = Simulator(loop)
    ApplySimulatorConfig(scenario.simulator, simulator)
    simulator.Initialize()
    controller.reset(plant.GetOutputPort("state").Eval(
        plant.GetMyContextFromRoot(simulator.get_context())))
    # Before the first tick acts the command is that of the start, as in the station.
    ticks.GetMyMutableContextFromRoot(simulator.get_mutable_context()).SetDiscreteState(
        0, controller.signal("zoh_command"))
    simulator.AdvanceTo(duration)
    *columns, commands = zip(*ticks.rows, strict=True)
    return Rows(*(np.array(column) for column in columns), list(commands))
