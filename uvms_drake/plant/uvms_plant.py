"""The simulated robot: a MultibodyPlant, the water, a surface and a disturbance in one Diagram."""

from typing import NamedTuple, cast

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.multibody.plant import (
    AddMultibodyPlantSceneGraph,
    ExternallyAppliedSpatialForce,
    MultibodyPlant,
)
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, LeafSystem
from pydrake.systems.primitives import PassThrough

from uvms_drake.common.errors import require, vector, within
from uvms_drake.common.wiring import cached, output_of
from uvms_drake.model.coordinates import Coordinates
from uvms_drake.model.frames.euler import WORLD
from uvms_drake.model.robot import Robot
from uvms_drake.model.signals.sensor_actuator import PAYLOAD, PAYLOAD_AT_REST
from uvms_drake.model.surface.law import Surface
from uvms_drake.model.uvms import Uvms
from uvms_drake.plant.applied_forces import generalized_force
from uvms_drake.plant.disturbance import OpenLoopDisturbance
from uvms_drake.plant.hydrodynamics import Dynamics, SubmergedPlant, close_force_ports, value_of
from uvms_drake.plant.joint_friction import DryJoints
from uvms_drake.plant.model_error import ModelError, add_simulated_uvms
from uvms_drake.plant.payload import PayloadWrench
from uvms_drake.plant.surface import SurfaceAtTip, Touch
from uvms_drake.plant.workspace import Workspace, declare_workspace


class _Motion(NamedTuple):
    """Motion of the robot in a state of the plant."""

    state: np.ndarray
    """(𝔮, ζ) (2(6+n),)."""
    R_WB: np.ndarray
    """Attitude of the vehicle (3, 3)."""
    v: np.ndarray
    """Velocities of the plant (nv,)."""
    touch: Touch | None
    """Tip at the surface, if there is one."""


class UvmsDynamics(LeafSystem):
    """Dynamics of a UVMS under water at a compliant surface, in the paper's order.

    It is `ToPaperOrder`, `ToDrakeOrder`, `CompliantSurface`, `AppliedForces` and `Hydrodynamics` in
    one, with the geometry of a state computed once, for the derivative of a simulation.

    .. pydrake_system::

        name: UvmsDynamics
        input_ports:
        - plant_state
        - tau (optional)
        - disturbance (optional)
        - current (optional)
        - current_acceleration (optional)
        - applied_spatial_force (optional)
        - applied_generalized_force (optional)
        - joint_friction (optional)
        output_ports:
        - plant_force
        - state
        - acceleration
        - force (with a surface)
        - penetration (with a surface)
        - chi (with a surface)

    - `plant_state` (nq + nv): from `plant.get_state_output_port()`.
    - `joint_friction` (nv) [N, N m]: of `DryJoints`, in the plant's order.
    - `plant_force` (nv) [N, N m]: to `plant.get_applied_generalized_force_input_port()`.
    - The others are those of `make_uvms_plant`.

    This system does not have any state. The plant's parameters are those of its default Context.

    Args:
        uvms: The robot, alone in a finalized plant that is continuous.
        surface: The surface at the tip, if there is one.
        task_frame: ZYX Euler angles of the task's frame in World (3,) [rad].
    """

    def __init__(self, uvms: Uvms, surface: Surface | None = None, task_frame: np.ndarray = WORLD):
        super().__init__()
        self.coordinates = Coordinates(uvms)
        plant, size, nv = uvms.plant, self.coordinates.size, self.coordinates.num_velocities
        self._plant = plant
        with within("hydrodynamics"):
            self._submerged = SubmergedPlant(plant, uvms.hydrodynamics)
        with within("surface"):
            self._surface = (
                None if surface is None else SurfaceAtTip(plant, uvms.tip, surface, task_frame))
        self._workspace = declare_workspace(self, plant)
        self._declare_inputs(plant, size)
        # Geometry, which depends on the state alone; the water, which may move; the forces, which
        # may be sampled between two states.
        self._motion = cached(self, "motion", self._moving, {self._plant_state_port.ticket()})
        motion = {self._motion.ticket()}
        self._dynamics = cached(self, "dynamics without other forces", self._in_water, {
            *motion, *(port.ticket() for port in self._water_ports)})
        solution = cached(self, "v̇ and the force that produces it", self._accelerated, {
            self._dynamics.ticket(), *(port.ticket() for port in self._force_ports)})
        now = {solution.ticket()}
        output_of(self, "plant_force", nv, lambda c: solution.Eval(c)[1], now)
        output_of(self, "state", 2 * size, lambda c: self._motion.Eval(c).state, motion)
        output_of(self, "acceleration", size, lambda c: self.coordinates.acceleration_from_drake(
            self._plant_state_port.Eval(c), solution.Eval(c)[0]), now)
        if self._surface is None:
            return
        law = self._surface.law
        output_of(self, "force", 6, lambda c: self._motion.Eval(c).touch.force, motion)
        output_of(self, "penetration", 1,
                  lambda c: [law.penetration(self._motion.Eval(c).touch.chi)], motion)
        output_of(self, "chi", 6, lambda c: self._motion.Eval(c).touch.chi, motion)

    def _declare_inputs(self, plant: MultibodyPlant, size: int) -> None:
        nv = plant.num_velocities()
        self._plant_state_port = self.DeclareVectorInputPort(
            "plant_state", plant.num_multibody_states())
        self._tau_port, self._disturbance_port = (
            self.DeclareVectorInputPort(name, size) for name in ("tau", "disturbance"))
        self._water_ports = [self.DeclareVectorInputPort(name, 3)
                             for name in ("current", "current_acceleration")]
        self._spatial_port = self.DeclareAbstractInputPort(
            "applied_spatial_force", AbstractValue.Make([ExternallyAppliedSpatialForce()]))
        self._generalized_ports = [self.DeclareVectorInputPort(name, nv)
                                   for name in ("applied_generalized_force", "joint_friction")]
        self._force_ports = [self._tau_port, self._disturbance_port, self._spatial_port,
                             *self._generalized_ports]

    def _moving(self, context: Context) -> _Motion:
        """Returns the present motion, and sets the workspace to its state."""
        plant_state = cast(np.ndarray, self._plant_state_port.Eval(context))
        v, R_WB = plant_state[self._plant.num_positions():], self.coordinates.attitude(plant_state)
        workspace: Workspace = self._workspace.Eval(context)
        self._plant.SetPositionsAndVelocities(workspace.context, plant_state)
        touch = None if self._surface is None else self._surface.touch(workspace.context, v)
        return _Motion(self.coordinates.from_drake(plant_state, R_WB), R_WB, v, touch)

    def _in_water(self, context: Context) -> Dynamics:
        motion: _Motion = self._motion.Eval(context)  # The workspace has its state from here on.
        return self._submerged.at(self._workspace.Eval(context), motion.v,
                                  *(value_of(port, context) for port in self._water_ports))

    def _accelerated(self, context: Context) -> tuple[np.ndarray, np.ndarray]:
        dynamics: Dynamics = self._dynamics.Eval(context)
        motion: _Motion = self._motion.Eval(context)
        to_drake = self.coordinates.to_drake_order
        tau, d = value_of(self._tau_port, context), value_of(self._disturbance_port, context)
        total = np.zeros_like(motion.v) if tau is None else to_drake(motion.R_WB, tau)
        if motion.touch is not None:
            total += motion.touch.reaction
        if self._spatial_port.HasValue(context):
            forces = cast(list[ExternallyAppliedSpatialForce], self._spatial_port.Eval(context))
            total += generalized_force(self._plant, self._workspace.Eval(context).context, forces)
        for port in self._generalized_ports:
            if (force := value_of(port, context)) is not None:
                total += force
        return dynamics.accelerated(total, None if d is None else to_drake(motion.R_WB, d))

    @staticmethod
    def AddToBuilder(builder: DiagramBuilder, uvms: Uvms, surface: Surface | None = None,
                     task_frame: np.ndarray = WORLD, name: str = "dynamics") -> "UvmsDynamics":
        """Adds the system to `builder` and wires it to the state and force ports of the plant.

        It closes the plant's other ports for forces, see `close_force_ports`.
        """
        system = UvmsDynamics(uvms, surface, task_frame)
        builder.AddNamedSystem(name, system)
        close_force_ports(builder, uvms.plant, name)
        builder.Connect(uvms.plant.get_state_output_port(), system.GetInputPort("plant_state"))
        builder.Connect(system.GetOutputPort("plant_force"),
                        uvms.plant.get_applied_generalized_force_input_port())
        return system


def make_uvms_plant(
    robot: Robot | str,
    surface: Surface | None = None,
    *,
    disturbance: OpenLoopDisturbance | None = None,
    seed: int = 0,
    error: ModelError | None = None,
    start: np.ndarray | None = None,
    task_frame: np.ndarray = WORLD,
) -> Diagram:
    """Returns a UVMS under water at a compliant surface, as a Diagram named "uvms".

    ::

        tau, applied_…, current, … ──▶┌──────────┐ plant_force ┌───────┐
                                      │ dynamics │────────────▶│ plant │─┬─▶ plant_state, body_…
        disturbance ────────┬────────▶└──────────┘             └───────┘ │
                            ▼           ▲  └─▶ state, acceleration,      │
                        disturbance     │      force, penetration, chi   │
                                        └────────────────────────────────┘

    World is Σ_I (NED); n is the number of the arm's joints.

    .. pydrake_system::

        name: uvms
        input_ports:
        - tau (optional)
        - current (optional)
        - current_acceleration (optional)
        - applied_spatial_force (optional)
        - applied_generalized_force (optional)
        - disturbance (optional, with disturbance=None)
        output_ports:
        - state
        - force (with a surface)
        - penetration (with a surface)
        - chi (with a surface)
        - disturbance
        - acceleration
        - plant_state
        - payload, payload_at_rest (if the hand holds one)
        - body_poses
        - body_spatial_velocities
        - query_object

    - `tau` (6 + n) [N, N m]: generalised force of thrusters and joints, in the paper's order, the
      vehicle's part in body axes; unconnected means zero.
    - `current` (3) [m/s]: velocity of the water in World; unconnected means still water.
    - `current_acceleration` (3) [m/s²]: its rate; unconnected means that it is steady. Both are
      those of a `WaterMotion`.
    - `applied_spatial_force`: list[ExternallyAppliedSpatialForce] of Drake's `Propeller` and
      `Wing`, a tether or another source of force; unconnected means none.
    - `applied_generalized_force` (nv) [N, N m]: further force in the plant's order, not the
      paper's; unconnected means zero.
    - `state` (2 (6 + n)): 𝔮 [m, rad], ζ [m/s, rad/s].
    - `force` (6) [N, N m]: 𝔉, see `CompliantSurface`.
    - `penetration` (1) [m]: see `CompliantSurface`.
    - `chi` (6) [m, rad]: χ, pose of the tip; see `CompliantSurface`.
    - `disturbance` (6 + n) [m/s², rad/s²]: d, in the paper's order.
    - `acceleration` (6 + n) [m/s², rad/s²]: ζ̇, with d in it.
    - `plant_state` (nq + nv): of the MultibodyPlant, which is continuous.
    - `payload`, `payload_at_rest` (6) [N, N m]: by which the hand holds it, see `PayloadWrench`.
    - `body_poses`, `body_spatial_velocities`: X_WB and V_WB of all its bodies, which the systems
      at `applied_spatial_force` want to know.
    - `query_object`: of the SceneGraph, for a `MeshcatVisualizer` or a camera.

    The subsystems "plant", "scene_graph", "dynamics", a `UvmsDynamics`, and "disturbance" are found
    with `GetSubsystemByName`. Joint limits are left to the controller: a continuous MultibodyPlant
    has no end stops. Systems are for double only; for derivatives there is `UvmsModel`. A robot of
    another mass is made with `error`, not by `SetMass` in a Context: see `Hydrodynamics`.

    Args:
        robot: A `Robot`, the name of a shipped one, or a robot's folder.
        surface: The surface at the tip; None means open water, and `force`,
            `penetration` and `chi` are not there.
        disturbance: d, added to ζ̇ [m/s², rad/s²]; None exports an input port `disturbance` for the
            caller's, which means zero if unconnected.
        seed: Seed of the disturbance.
        error: Model error of the robot, if any.
        start: Default 𝔮 (6 + n,) [m, rad], at rest; if left out, that of the robot's file.
        task_frame: ZYX Euler angles of the task's frame in World (3,) [rad]; see
            `CompliantSurface`.
    """
    require(seed >= 0, "seed", seed, "zero or positive")
    builder = DiagramBuilder()
    # The robot, started at rest.
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
    uvms = add_simulated_uvms(plant, robot, error)
    plant.Finalize()
    coordinates = Coordinates(uvms)
    if start is not None:
        at_rest = np.concatenate([vector("start", start, coordinates.size),
                                  np.zeros(coordinates.size)])
        plant.SetDefaultPositions(coordinates.to_drake(at_rest)[: coordinates.num_positions])

    # Water and surface, through which everything acts on the plant, and friction in the joints.
    dynamics = UvmsDynamics.AddToBuilder(builder, uvms, surface, task_frame)
    if error is not None and error.joint_friction.largest > 0.0:
        with within("model_error.joint_friction"):
            dry = DryJoints.AddToBuilder(builder, plant, uvms, error.joint_friction)
        builder.Connect(dry.get_output_port(), dynamics.GetInputPort("joint_friction"))

    # The disturbance of the acceleration.
    if disturbance is None:
        d_source = builder.AddNamedSystem("disturbance", PassThrough(coordinates.size))
        builder.ExportInput(d_source.get_input_port(), "disturbance")
    else:
        with within("disturbance"):
            d_source = disturbance.add_source(builder, coordinates.size, seed)
    builder.Connect(d_source.get_output_port(), dynamics.GetInputPort("disturbance"))

    # The payload, for a wrist sensor.
    payload = None if error is None or not error.payload.present else (
        PayloadWrench.AddToBuilder(builder, plant, uvms, error.payload))

    # The ports.
    for name in ("tau", "current", "current_acceleration", "applied_spatial_force",
                 "applied_generalized_force"):
        builder.ExportInput(dynamics.GetInputPort(name), name)
    if payload is not None:
        builder.ConnectInput("current_acceleration", payload.GetInputPort("current_acceleration"))
        builder.ExportOutput(payload.GetOutputPort("wrench"), PAYLOAD)
        builder.ExportOutput(payload.GetOutputPort("wrench_at_rest"), PAYLOAD_AT_REST)
    for name in ("state", *(("force", "penetration", "chi") if surface is not None else ())):
        builder.ExportOutput(dynamics.GetOutputPort(name), name)
    builder.ExportOutput(d_source.get_output_port(), "disturbance")
    builder.ExportOutput(dynamics.GetOutputPort("acceleration"), "acceleration")
    builder.ExportOutput(plant.get_state_output_port(), "plant_state")
    builder.ExportOutput(plant.get_body_poses_output_port(), "body_poses")
    builder.ExportOutput(plant.get_body_spatial_velocities_output_port(), "body_spatial_velocities")
    builder.ExportOutput(scene_graph.get_query_output_port(), "query_object")
    diagram = builder.Build()
    diagram.set_name("uvms")
    return diagram


def set_state(uvms: Diagram, context: Context, state: np.ndarray) -> None:
    """Sets the state of a Diagram made by `make_uvms_plant`, or of one with it as "uvms".

    Args:
        uvms: The Diagram, or that of `make_plant` or `make_station`.
        context: Its Context; in a larger Diagram, `uvms.GetMyMutableContextFromRoot(root_context)`.
        state: (𝔮, ζ) (2 (6 + n)).
    """
    if uvms.HasSubsystemNamed("uvms"):
        inner = cast(Diagram, uvms.GetSubsystemByName("uvms"))
        uvms, context = inner, uvms.GetMutableSubsystemContext(inner, context)
    coordinates = cast(UvmsDynamics, uvms.GetSubsystemByName("dynamics")).coordinates
    plant = cast(MultibodyPlant, uvms.GetSubsystemByName("plant"))
    plant.SetPositionsAndVelocities(
        uvms.GetMutableSubsystemContext(plant, context),
        coordinates.to_drake(vector("state", state, 2 * coordinates.size)))
