"""The controller's model against the plant, for a robot that neither has seen before.

The two share no equation of motion: the model is a chain of links with 6×6 inertias, the plant is
Drake's with the forces of the water. Parts of a file that only one of them reads show here, in
random states.
"""

from collections.abc import Iterator

import numpy as np
from pydrake.multibody.tree import JacobianWrtVariable, RigidBody
from pydrake.systems.framework import Context

from uvms_drake.common.errors import InvalidFile, InvalidParameter
from uvms_drake.model.coordinates import Coordinates
from uvms_drake.model.description.hydrodynamics_file import added_mass_about_origin
from uvms_drake.model.frames.spatial import cross
from uvms_drake.model.robot import Robot
from uvms_drake.model.robot_check import robot_complaints
from uvms_drake.model.uvms import Uvms
from uvms_drake.model.uvms_model import UvmsModel, configuration_rate
from uvms_drake.plant.hydrodynamics import Hydrodynamics, drag_force

STATES = 2
"""Number of random states that are tried."""
AGREEMENT = 1e-7
"""Largest difference that is taken as rounding, relative to the size of the quantity."""
BALANCE = 1e-5
"""The same for the balance of power, which is by differences."""
STEP = 1e-4
"""Step of the finite differences [s]."""
_FROM_DRAKE = [3, 4, 5, 0, 1, 2]


def model_complaints(uvms: Uvms) -> list[InvalidParameter]:
    """Returns the differences between the controller's model of a robot and the plant.

    Args:
        uvms: The robot, alone in a finalized plant that is continuous.
    """
    model, coordinates = UvmsModel(uvms), Coordinates(uvms)
    water = Hydrodynamics(uvms.plant, uvms.hydrodynamics)
    rng, found = np.random.default_rng(0), dict[str, tuple[float, float]]()
    for _ in range(STATES):
        state = random_state(model, rng)
        zeta_dot = rng.normal(size=model.size)
        tau = model.mass_matrix(model.kinematics(state[: model.size])) @ zeta_dot
        for what, off, allowed in (*_differences(uvms, model, coordinates, water, state, tau),
                                   _imbalance(uvms, model, coordinates, state, zeta_dot)):
            if not off <= allowed and off > found.get(what, (0.0, 0.0))[0]:
                found[what] = off, allowed
    return [InvalidParameter(
        f"model of the controller, {what}", float(f"{off:.3g}"),
        f"that of the plant within {allowed:g} of its size: something in the files is read by only "
        "one of them") for what, (off, allowed) in found.items()]


def random_state(model: UvmsModel, rng: np.random.Generator) -> np.ndarray:
    """Returns a state (𝔮, ζ) (2(6+n),) of any attitude, with speeds of the order of one."""
    attitude = rng.uniform([-np.pi, -1.3, -np.pi], [np.pi, 1.3, np.pi])
    angles = rng.uniform(*model.joint_range())
    return np.concatenate([rng.normal(size=3), attitude, angles, rng.normal(size=model.size)])


def _differences(uvms: Uvms, model: UvmsModel, coordinates: Coordinates, water: Hydrodynamics,
                 state: np.ndarray, tau: np.ndarray) -> Iterator[tuple[str, float, float]]:
    """Yields the name of a quantity, its relative difference, and the allowed one."""
    context, drake = water.CreateDefaultContext(), coordinates.to_drake(state)
    config, zeta = np.split(state, 2)
    kinematics = model.kinematics(config)
    # Where the tip is, and how it moves.
    pose, J_E = _tip_of(uvms, drake)
    R_WE = kinematics.R_WB @ kinematics.R_BL[-1]
    p_WE = config[:3] + kinematics.R_WB @ kinematics.p_BL[-1]
    off = np.column_stack([R_WE, p_WE]) - pose
    yield "pose of the tip", float(np.max(np.abs(off))), AGREEMENT
    velocity = kinematics.J_links[-1] @ zeta
    scale = 1.0 + float(np.linalg.norm(velocity))
    off = velocity - J_E @ drake[coordinates.num_positions:]
    yield "velocity of the tip", float(np.linalg.norm(off)) / scale, AGREEMENT
    # The force that gives the plant's acceleration.
    water.GetInputPort("plant_state").FixValue(context, drake)
    water.GetInputPort("generalized_force").FixValue(
        context, coordinates.vector_to_drake(drake, tau))
    zeta_dot = coordinates.acceleration_from_drake(
        drake, water.GetOutputPort("acceleration").Eval(context))
    size = np.abs(model.mass_matrix(kinematics)) @ np.abs(zeta_dot) + np.abs(tau)
    off = model.inverse_dynamics(kinematics, zeta, zeta_dot) - tau
    names = [*("surge", "sway", "heave", "roll", "pitch", "yaw"),
             *(joint.name() for joint in uvms.joints)]
    for name, each, of in zip(names, off, size, strict=True):
        yield f"force in {name}", float(abs(each) / of), AGREEMENT


def _tip_of(uvms: Uvms, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns Drake's X_WE (3, 4) and J_E (6, nv), of the tip's velocity (v, ω) in its axes."""
    plant, W = uvms.plant, uvms.plant.world_frame()
    context = plant.CreateDefaultContext()
    plant.SetPositionsAndVelocities(context, state)
    J = plant.CalcJacobianSpatialVelocity(
        context, JacobianWrtVariable.kV, uvms.tip, np.zeros(3), W, uvms.tip)
    return uvms.tip.CalcPoseInWorld(context).GetAsMatrix34(), J[_FROM_DRAKE]


def _imbalance(uvms: Uvms, model: UvmsModel, coordinates: Coordinates, state: np.ndarray,
               zeta_dot: np.ndarray) -> tuple[str, float, float]:
    """Returns by how much ζᵀτ of the model misses the rate of energy and the power of drag."""
    config, zeta = np.split(state, 2)
    power = float(zeta @ model.inverse_dynamics(model.kinematics(config), zeta, zeta_dot))
    tangent = np.concatenate([configuration_rate(config, zeta), zeta_dot])
    forward, backward, far, back = (energy(uvms, coordinates.to_drake(state + s * STEP * tangent))
                                for s in (1, -1, 2, -2))
    rate = (8.0 * (forward - backward) - (far - back)) / (12.0 * STEP)
    lost = dissipated(uvms, coordinates.to_drake(state))
    size = abs(power) + abs(rate) + lost + 1e-12
    return "balance of power", abs(power - rate - lost) / size, BALANCE


def energy(uvms: Uvms, state: np.ndarray) -> float:
    """Returns kinetic and potential energy of robot and water [J] in a plant state (q, v)."""
    plant, context = uvms.plant, uvms.plant.CreateDefaultContext()
    plant.SetPositionsAndVelocities(context, state)
    g_W = plant.gravity_field().gravity_vector()
    total = plant.CalcKineticEnergy(context) + plant.CalcPotentialEnergy(context)
    for name, water in uvms.hydrodynamics.bodies.items():
        body = plant.GetBodyByName(name, uvms.model_instance)
        nu = _velocity(uvms, context, body)
        displaced = uvms.hydrodynamics.fluid_density * water.displaced_volume
        p_WBb = body.EvalPoseInWorld(context) @ np.asarray(water.center_of_buoyancy, dtype=float)
        total += 0.5 * nu @ added_mass_about_origin(water.added_mass) @ nu + displaced * g_W @ p_WBb
    return float(total)


def dissipated(uvms: Uvms, state: np.ndarray) -> float:
    """Returns the power [W] that drag and the damping of the joints take in a plant state."""
    plant, context = uvms.plant, uvms.plant.CreateDefaultContext()
    plant.SetPositionsAndVelocities(context, state)
    total = sum(joint.default_damping() * plant.GetVelocities(context)[joint.velocity_start()] ** 2
                for joint in uvms.joints)
    for name, water in uvms.hydrodynamics.bodies.items():
        nu = _velocity(uvms, context, plant.GetBodyByName(name, uvms.model_instance))
        for drag in water.drag:
            nu_P = nu + np.concatenate([cross(nu[3:], np.asarray(drag.point)), np.zeros(3)])
            total -= drag_force(np.asarray(drag.linear), np.asarray(drag.quadratic), nu_P) @ nu_P
    return float(total)


def _velocity(uvms: Uvms, context: Context, body: RigidBody) -> np.ndarray:
    """Returns the velocity (v, ω) (6,) of a body's origin in axes of the body."""
    R_WB = body.EvalPoseInWorld(context).rotation()
    V = body.EvalSpatialVelocityInWorld(context)
    return np.concatenate([R_WB.inverse() @ V.translational(), R_WB.inverse() @ V.rotational()])


def complaints_about(robot: Robot) -> list[InvalidParameter]:
    """Returns the complaints about a robot whose files can be read; empty if it is sound."""
    return robot_complaints(robot) or model_complaints(robot.uvms)


def sound_robot(model: Robot | str) -> Robot:
    """Returns a robot, given itself, the name of a shipped one, or its folder.

    Raises:
        InvalidParameter: Its files cannot be used, or a certificate of it would be worth nothing.
    """
    robot = model if isinstance(model, Robot) else Robot.load(model)
    if complaints := complaints_about(robot):
        raise InvalidFile([str(complaint) for complaint in complaints])
    return robot
