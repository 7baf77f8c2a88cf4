"""The Diagram of a scenario's loop about a given plan, without MPC and contact estimator."""

from collections.abc import Callable

import numpy as np
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from pydrake.systems.primitives import LogVectorOutput

from uvms_drake.actuation.thruster_systems import ThrusterDynamics
from uvms_drake.actuation.thrusters import Thrusters
from uvms_drake.common.wiring import output_of
from uvms_drake.control.contact.tangential_filter import TangentialFilter
from uvms_drake.control.feedback.ancillary import AncillaryFeedback
from uvms_drake.control.feedback.disturbance_observer import add_observer
from uvms_drake.control.feedback.feedforward_preview import (
    SurfaceReaction,
    previewed_forces,
)
from uvms_drake.control.plan.plan import Plan
from uvms_drake.model.propulsion.allocation import Allocation
from uvms_drake.model.signals.sensor_actuator import MEASURED_FORCE, VEHICLE_WRENCH, Signals
from uvms_drake.plant.uvms_plant import make_uvms_plant
from uvms_drake.plant.waves import WaterMotion
from uvms_drake.sensing.wrist_sensor import WristSensor
from uvms_drake.station.contact.bounds import sensed_contact
from uvms_drake.station.controller import add_chain
from uvms_drake.station.scenario.parts import keyed

LOG_PERIOD = 0.005


class GivenPlan(LeafSystem):
    """A plan and its preview, as functions of time."""

    def __init__(self, model, plan: Plan, preview, reaction):
        super().__init__()
        size, end = model.size, plan.start_time + plan.time_step * len(plan.zeta_dot)

        def at(context):
            return plan.at(min(context.get_time(), end))

        when = {self.time_ticket()}
        output_of(self, "nominal_state", 2 * size, lambda c: np.hstack(at(c)[:2]), when)
        output_of(self, "nominal_acceleration", size, lambda c: at(c)[2], when)
        output_of(self, "nominal_input", size, lambda c: np.zeros(size), when)
        output_of(self, "preview", size, lambda c: previewed_forces(
            model, plan, c.get_time(), preview, at(c), reaction), when)


class Push(LeafSystem):
    """A further force on the surface, t ↦ (3,) in Σ_I: the wrench 𝔉 and τ with it."""

    def __init__(self, model, force: Callable[[float], np.ndarray]):
        super().__init__()
        state = self.DeclareVectorInputPort("state", 2 * model.size)
        tau = self.DeclareVectorInputPort("tau", model.size)
        of_surface = self.DeclareVectorInputPort("force", 6)

        def pushed(context):
            J = model.kinematics(state.Eval(context)[: model.size]).J_chi[:3]
            return tau.Eval(context) - force(context.get_time()) @ J

        output_of(self, "pushed", model.size, pushed,
                  {state.ticket(), tau.ticket(), self.time_ticket()})
        output_of(self, "whole_force", 6, lambda c: of_surface.Eval(c) + np.append(
            force(c.get_time()), np.zeros(3)), {of_surface.ticket(), self.time_ticket()})


def _settle(diagram, root, actuation, at):
    """Lets thrusters and force sensor begin at the point, so that nothing swings."""
    for part in actuation:
        if isinstance(part, Thrusters):
            forces = Allocation.to(part.known(at.model)).forces(at.modelled[:6])
    first = Simulator(diagram)
    first.AdvanceTo(1e-3)
    for system in diagram.GetSystems():
        context = system.GetMyMutableContextFromRoot(root)
        if isinstance(system, ThrusterDynamics):
            context.SetContinuousState(forces)
            context.SetDiscreteState(0, [1.0])
            samples = context.get_discrete_state(1).size() // len(forces)
            context.SetDiscreteState(1, np.tile(forces, samples))
        elif isinstance(system, WristSensor):
            context.SetStateAndParametersFrom(system.GetMyContextFromRoot(first.get_context()))


def run(scenario, parts, at, wall, surface, *, duration: float, plan: Plan | None = None,
        estimate: np.ndarray | None = None, sensing=None,
        push: Callable[[float], np.ndarray] | None = None
        ) -> tuple[np.ndarray, np.ndarray]:
    """Returns times (T,) and the true state less the plan's (T, 2(6+n)).

    Args:
        scenario: The scenario.
        parts: `LoopParts` of it.
        at: Operating point, at which the run starts.
        wall: Linear wall of the point.
        surface: The simulated surface, of the same force there; None: open water.
        duration: Time of the run [s].
        plan: The plan; at rest if None.
        estimate: δ̂ of the observer at the start, zero if None (6+n,).
        sensing: Sensors in place of the scenario's.
        push: Further force on the surface by the time (3,) [N].
    """
    model, size, builder = parts.model, parts.model.size, DiagramBuilder()
    config = at.state[:size]
    uvms = builder.AddNamedSystem("uvms", make_uvms_plant(
        scenario.model, surface=surface, error=scenario.model_error, start=config))
    WaterMotion.AddToBuilder(builder, scenario.current, scenario.waves, plant=uvms)
    still = np.zeros(size)
    if plan is None:
        plan = Plan.from_accelerations(
            0.0, duration + 1.0, config, still, np.zeros((1, size)))
    reaction = None
    if wall.force:
        reaction = SurfaceReaction(wall.normal, wall.force, wall.stiffness * wall.normal)
    preview = parts.command_path.preview
    nominal = builder.AddNamedSystem("plan", GivenPlan(model, plan, preview, reaction))
    signals = Signals()
    source = builder.AddNamedSystem("push", Push(
        model, (lambda time: np.zeros(3)) if push is None else push))
    builder.Connect(uvms.GetOutputPort("state"), source.GetInputPort("state"))
    builder.Connect(uvms.GetOutputPort("force"), source.GetInputPort("force"))
    for name in ("state", "chi"):
        signals[name] = uvms.GetOutputPort(name)
    signals["force"] = source.GetOutputPort("whole_force")
    measured = add_chain(builder, model, signals["state"], signals, keyed(
        "sensing", scenario.sensing if sensing is None else sensing), scenario.seed)
    feedback = AncillaryFeedback.AddToBuilder(
        builder, model, parts.law, nominal=nominal, state=measured)
    observer = add_observer(builder, model, parts.law, feedback, state=measured)
    if parts.law.takes_wrench and any(preview):
        builder.Connect(nominal.GetOutputPort("preview"), feedback.GetInputPort("preview"))
    force, contact = signals[MEASURED_FORCE], sensed_contact(scenario)
    if contact.tangential_lag > 0.0:
        force = TangentialFilter.AddToBuilder(
            builder, contact.direction, contact.tangential_lag, contact.period,
            measured=force).get_output_port()
    applied = add_chain(builder, model, feedback.GetOutputPort("tau"), signals,
                        keyed("actuation", scenario.actuation), scenario.seed)
    for system in (feedback, *([observer] if observer is not None else [])):
        builder.Connect(force, system.GetInputPort(MEASURED_FORCE))
        if VEHICLE_WRENCH in signals:
            builder.Connect(signals[VEHICLE_WRENCH], system.GetInputPort(VEHICLE_WRENCH))
    if observer is not None:
        builder.Connect(applied, observer.GetInputPort("applied"))
    builder.Connect(applied, source.GetInputPort("tau"))
    builder.Connect(source.GetOutputPort("pushed"), uvms.GetInputPort("tau"))
    log = LogVectorOutput(signals["state"], builder, LOG_PERIOD)
    reference = LogVectorOutput(nominal.GetOutputPort("nominal_state"), builder, LOG_PERIOD)
    diagram = builder.Build()
    simulator = Simulator(diagram)
    ApplySimulatorConfig(scenario.simulator, simulator)
    simulator.get_mutable_integrator().set_maximum_step_size(0.005)
    if estimate is not None:
        observer.GetMyMutableContextFromRoot(
            simulator.get_mutable_context()).SetDiscreteState(0, estimate)
    _settle(diagram, simulator.get_mutable_context(), scenario.actuation, at)
    simulator.Initialize()
    simulator.AdvanceTo(duration)
    context = simulator.get_context()
    logs = [sink.FindLog(context) for sink in (log, reference)]
    return logs[0].sample_times().copy(), (logs[0].data() - logs[1].data()).T
