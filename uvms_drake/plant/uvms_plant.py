"""The simulated robot: a MultibodyPlant, the water, a surface and a disturbance in one Diagram."""

from typing import cast

import numpy as np
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.systems.framework import Context, Diagram, DiagramBuilder
from pydrake.systems.primitives import Adder, PassThrough

from uvms_drake.common.errors import require, vector, within
from uvms_drake.model.coordinates import Coordinates
from uvms_drake.model.frames.euler import WORLD
from uvms_drake.model.robot import Robot
from uvms_drake.model.signals.sensor_actuator import PAYLOAD, PAYLOAD_AT_REST
from uvms_drake.model.surface.law import Surface
from uvms_drake.plant.applied_forces import AppliedForces
from uvms_drake.plant.disturbance import OpenLoopDisturbance
from uvms_drake.plant.hydrodynamics import Hydrodynamics
from uvms_drake.plant.joint_friction import DryJoints
from uvms_drake.plant.joint_limits import JointLimits, LimitedJoints
from uvms_drake.plant.model_error import ModelError, add_simulated_uvms
from uvms_drake.plant.order import ToDrakeOrder, ToPaperOrder
from uvms_drake.plant.payload import PayloadWrench
from uvms_drake.plant.surface import CompliantSurface


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

        current, current_acceleration ───────────────┐
        tau ─▶ joints ▶ to_drake_… ──┐               ▼
        applied_… ─▶ applied_forces ─┼─▶ (+) ─▶ hydrodynamics ─▶ plant ─┬─▶ plant_state, body_…
                   ┌─▶ surface ──────┘               ▲                  ├─▶ to_paper_order ─▶ state
                   │      └▶ force, penetration, chi │                  │
                   │         disturbance ─▶ disturbance_to_drake_order  │
                   │              └──▶ disturbance                      │
                   └────────────────── plant state (to all) ◀───────────┘

        hydrodynamics ─▶ to_paper_order ─▶ acceleration

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
      vehicle's part in body axes; unconnected means zero. The joints' part is limited by the
      motors of the robot's file, and their stops act, see `joint_limits`.
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

    The subsystems "plant", "scene_graph", "hydrodynamics", "surface" and "disturbance" are found
    with `GetSubsystemByName`. A continuous MultibodyPlant has no end stops: they are forces here.
    Systems are for double only; for derivatives there is `UvmsModel`. A robot of another mass is
    made with `error`, not by `SetMass` in a Context: see `Hydrodynamics`.

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
    coordinates, plant_state = Coordinates(uvms), plant.get_state_output_port()
    if start is not None:
        at_rest = np.concatenate([vector("start", start, coordinates.size),
                                  np.zeros(coordinates.size)])
        plant.SetDefaultPositions(coordinates.to_drake(at_rest)[: coordinates.num_positions])

    # All forces but the water's, in the plant's order, and their sum.
    with within("surface"):
        contact = None if surface is None else CompliantSurface.AddToBuilder(
            builder, plant, uvms.tip, surface, task_frame, name="surface", plant_state=plant_state)
    tau = ToDrakeOrder.AddToBuilder(
        builder, coordinates, name="tau_to_drake_order", plant_state=plant_state)
    applied = AppliedForces.AddToBuilder(builder, plant, plant_state=plant_state)
    forces = [tau.GetOutputPort("drake_order"), applied.GetOutputPort("generalized_force")]
    if contact is not None:
        forces.insert(1, contact.GetOutputPort("generalized_force"))
    if error is not None and error.joint_friction.largest > 0.0:
        with within("model_error.joint_friction"):
            dry = DryJoints.AddToBuilder(
                builder, plant, uvms, error.joint_friction, name="joint_friction",
                plant_state=plant_state)
        forces.append(dry.get_output_port())
    total = Adder(num_inputs=len(forces), size=plant.num_velocities())
    builder.AddNamedSystem("total_force", total)
    for i, port in enumerate(forces):
        builder.Connect(port, total.get_input_port(i))

    # The disturbance of the acceleration.
    d_drake = ToDrakeOrder.AddToBuilder(
        builder, coordinates, name="disturbance_to_drake_order", plant_state=plant_state)
    if disturbance is None:
        d_source = builder.AddNamedSystem("disturbance", PassThrough(coordinates.size))
        builder.ExportInput(d_source.get_input_port(), "disturbance")
    else:
        with within("disturbance"):
            d_source = builder.AddNamedSystem(
                "disturbance", disturbance.system(coordinates.size, seed))
    builder.Connect(d_source.get_output_port(), d_drake.GetInputPort("paper_order"))

    # The water, through which everything acts on the plant; and the joints as they are built.
    with within("hydrodynamics"):
        water = Hydrodynamics.AddToBuilder(builder, plant, uvms.hydrodynamics)
    M = water.mass_matrix(plant.GetPositionsAndVelocities(plant.CreateDefaultContext()))
    joints = LimitedJoints.AddToBuilder(
        builder, plant, uvms, JointLimits.of(plant, uvms, M), name="joints",
        plant_state=plant_state)
    builder.Connect(joints.get_output_port(), tau.GetInputPort("paper_order"))
    builder.Connect(total.get_output_port(), water.GetInputPort("generalized_force"))
    builder.Connect(
        d_drake.GetOutputPort("drake_order"), water.GetInputPort("acceleration_disturbance"))

    state = ToPaperOrder.AddToBuilder(builder, coordinates, plant_state=plant_state)
    builder.Connect(water.GetOutputPort("acceleration"), state.GetInputPort("v_dot"))

    # The payload, for a wrist sensor.
    payload = None if error is None or not error.payload.present else PayloadWrench.AddToBuilder(
        builder, plant, uvms, error.payload, name="payload",
        **{name: plant.GetOutputPort(name) for name in (
            "body_poses", "body_spatial_velocities", "body_spatial_accelerations")})

    # The ports.
    builder.ExportInput(joints.GetInputPort("tau"), "tau")
    for name in ("current", "current_acceleration"):
        builder.ExportInput(water.GetInputPort(name), name)
    if payload is not None:
        builder.ConnectInput("current_acceleration", payload.GetInputPort("current_acceleration"))
        builder.ExportOutput(payload.GetOutputPort("wrench"), PAYLOAD)
        builder.ExportOutput(payload.GetOutputPort("wrench_at_rest"), PAYLOAD_AT_REST)
    for name in ("applied_spatial_force", "applied_generalized_force"):
        builder.ExportInput(applied.GetInputPort(name), name)
    builder.ExportOutput(state.GetOutputPort("state"), "state")
    if contact is not None:
        for name in ("force", "penetration", "chi"):
            builder.ExportOutput(contact.GetOutputPort(name), name)
    builder.ExportOutput(d_source.get_output_port(), "disturbance")
    builder.ExportOutput(state.GetOutputPort("acceleration"), "acceleration")
    builder.ExportOutput(plant_state, "plant_state")
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
    coordinates = cast(ToPaperOrder, uvms.GetSubsystemByName("to_paper_order")).coordinates
    plant = cast(MultibodyPlant, uvms.GetSubsystemByName("plant"))
    plant.SetPositionsAndVelocities(
        uvms.GetMutableSubsystemContext(plant, context),
        coordinates.to_drake(vector("state", state, 2 * coordinates.size)))
