"""Tests of `uvms_drake.model.uvms_model`: against the paper's table, Drake and differences.

The plant side of the package computes the same dynamics from Drake's own quantities and shares no
equation of motion with the model: each is the other's check.
"""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import MultibodyForces
from support import dh
from support.tiny_robots import drill, oblique, telescope, turret

import uvms_drake as uv
from uvms_drake.model.coordinates import Coordinates
from uvms_drake.model.description.hydrodynamics_file import (
    BodyHydrodynamics,
    HydrodynamicParameters,
)
from uvms_drake.model.surface.law import check_surface
from uvms_drake.model.uvms import add_uvms
from uvms_drake.model.uvms_model import Kinematics, configuration_rate_matrix
from uvms_drake.plant.disturbance import ConstantDisturbance

FAR_AWAY = check_surface(uv.UnilateralPlane(point=np.array([1e3, 0.0, 0.0])))


def drake_acceleration(eta: np.ndarray, zeta: np.ndarray, zeta_dot: np.ndarray) -> np.ndarray:
    """Returns ζ̇ (10,) with world components: R(ν̇₁ + ν₂ × ν₁), Rν̇₂, q̈; v̇ but for its order."""
    R = RollPitchYaw(eta[3:6]).ToRotationMatrix().matrix()
    return np.concatenate([R @ (zeta_dot[:3] + np.cross(zeta[3:6], zeta[:3])),
                           R @ zeta_dot[3:6], zeta_dot[6:]])


def to_drake_velocity(uvms, values: np.ndarray) -> np.ndarray:
    """Returns (linear, angular, joints) in the order of the plant's v."""
    start = uvms.vehicle.floating_velocities_start_in_v()
    out = np.empty(10)
    out[start: start + 6] = values[[3, 4, 5, 0, 1, 2]]
    out[[joint.velocity_start() for joint in uvms.joints]] = values[6:]
    return out


def moved(config: np.ndarray, zeta: np.ndarray, s: float) -> np.ndarray:
    """Returns 𝔮 to first order in s along ζ, with Drake's rates of Euler angles."""
    rpy = RollPitchYaw(config[3:6])
    rates = rpy.CalcRpyDtFromAngularVelocityInChild(zeta[3:6])
    return config + s * np.concatenate(
        [rpy.ToRotationMatrix().matrix() @ zeta[:3], rates, zeta[6:]])


class Plant:
    """The plant side: f + M⁻¹τ of (𝔮, ζ) by the Diagram that the simulation uses."""

    def __init__(self, surface):
        self.diagram = uv.make_uvms_plant("girona500_arm5e", surface=surface,
                                       disturbance=ConstantDisturbance(bound=0.0))
        self.context = self.diagram.CreateDefaultContext()
        self.uvms = add_uvms(MultibodyPlant(0.0), "girona500_arm5e")
        self.uvms.plant.Finalize()

    def zeta_dot(self, state: np.ndarray, tau: np.ndarray) -> np.ndarray:
        """Returns ζ̇ (10,) from the derivatives of the plant's continuous state."""
        uv.set_state(self.diagram, self.context, state)
        self.diagram.GetInputPort("tau").FixValue(self.context, tau)
        v_dot = self.diagram.EvalTimeDerivatives(self.context).CopyToVector()[-10:]
        start = self.uvms.vehicle.floating_velocities_start_in_v()
        R = RollPitchYaw(state[3:6]).ToRotationMatrix().matrix()
        angular, linear = v_dot[start: start + 3], v_dot[start + 3: start + 6]
        return np.concatenate([
            R.T @ linear - np.cross(state[13:16], state[10:13]), R.T @ angular,
            v_dot[[joint.velocity_start() for joint in self.uvms.joints]]])


# Kinematics --------------------------------------------------------------------------------------


def test_the_end_effector_is_where_the_papers_table_puts_it(model):
    for config in dh.random_configurations(seed=1, count=50, tip_pitch=1.4):
        y = model.task_pose(config)
        np.testing.assert_allclose(y[:6], dh.chi(config), atol=1e-9)
        np.testing.assert_array_equal(y[6:], config[6:])


def test_the_jacobian_is_the_derivative_of_the_papers_chain(model, derivative):
    """The vehicle is moved by a twist in its own axes, so no Euler rate enters the check."""
    for config in dh.random_configurations(seed=2, count=10, tip_pitch=1.2):
        X_WB = dh.vehicle(config[:6])
        columns = []
        for direction in np.eye(10):
            def pose(s, X_WB=X_WB, direction=direction, config=config):
                twist = RigidTransform(
                    RollPitchYaw(s * direction[3:6]), s * direction[:3]).GetAsMatrix4()
                return dh.pose_vector(
                    dh.chain(X_WB @ twist, config[6:] + s * direction[6:])["tip"])
            columns.append(derivative(pose))
        J = model.kinematics(config).J_chi
        np.testing.assert_allclose(J, np.array(columns).T, atol=1e-9)
        np.testing.assert_array_equal(
            model.task_jacobian(config), np.vstack([J, np.eye(10)[6:]]))


def test_link_jacobians_are_those_of_the_plant(model, uvms):
    """Jₖζ is the velocity of each link, the last one's at the tip, in its own axes."""
    plant = uvms.plant
    context = plant.CreateDefaultContext()
    rng = np.random.default_rng(3)
    links = [uvms.vehicle, *(joint.child_body() for joint in uvms.joints[:-1])]
    frames = [*(link.body_frame() for link in links), uvms.tip]
    for config in dh.random_configurations(seed=3, count=5):
        zeta = rng.normal(size=10)
        plant.SetPositionsAndVelocities(
            context, Coordinates(uvms).to_drake(np.concatenate([config, zeta])))
        for J, frame in zip(model.kinematics(config).J_links, frames, strict=True):
            V = frame.CalcSpatialVelocity(context, plant.world_frame(), frame)
            np.testing.assert_allclose(
                J @ zeta, np.concatenate([V.translational(), V.rotational()]), atol=1e-12)


@pytest.mark.parametrize("robot", [turret(0.4), drill(), oblique(), telescope(1)])
@pytest.mark.parametrize("step", [0.0, 0.3j])
def test_the_tip_alone_has_the_geometry_of_the_whole_chain(robot, step):
    config = np.random.default_rng(11).normal(size=(3, 2, robot.size)) * (0.4 + step)
    whole, tip = robot.kinematics(config), robot.tip_kinematics(config)
    for name in tip._fields:
        np.testing.assert_allclose(getattr(tip, name), getattr(whole, name), rtol=1e-12, atol=1e-12)


def test_the_rate_of_the_jacobian_is_its_derivative_along_the_motion(model, derivative):
    rng = np.random.default_rng(4)
    for config in dh.random_configurations(seed=4, count=10, tip_pitch=1.2):
        zeta = rng.uniform(-0.5, 0.5, size=10)
        y, J_x, J_x_dot = model.task_motion(config, zeta)
        np.testing.assert_allclose(y, model.task_pose(config), atol=1e-15)
        np.testing.assert_allclose(J_x, model.task_jacobian(config), atol=1e-15)
        expected = derivative(
            lambda s, config=config, zeta=zeta: model.task_jacobian(moved(config, zeta, s)))
        np.testing.assert_allclose(J_x_dot, expected, atol=1e-8)


def test_the_configuration_moves_with_zeta(derivative):
    """𝔮̇ = Γζ, against the pose matrix of a vehicle that moves by a twist."""
    rng = np.random.default_rng(5)
    for config in dh.random_configurations(seed=5, count=10):
        zeta = rng.normal(size=10)

        def pose(s, config=config, zeta=zeta):
            twist = RigidTransform(RollPitchYaw(s * zeta[3:6]), s * zeta[:3]).GetAsMatrix4()
            X_WB = dh.vehicle(config[:6]) @ twist
            return np.concatenate([dh.pose_vector(X_WB), config[6:] + s * zeta[6:]])

        rate = uv.configuration_rate(config, zeta)
        np.testing.assert_allclose(rate, derivative(pose, step=1e-4), atol=1e-8)
        np.testing.assert_allclose(configuration_rate_matrix(config) @ zeta, rate, atol=1e-14)


def test_the_extended_task_determines_the_configuration(model):
    """configuration(task_pose(𝔮)) = 𝔮, for redundant vehicle and arm."""
    configs = np.array(list(dh.random_configurations(seed=6, count=50, tip_pitch=1.5)))
    np.testing.assert_allclose(model.configuration(model.task_pose(configs)), configs, atol=1e-11)


# Dynamics ----------------------------------------------------------------------------------------


def test_without_water_mass_matrix_and_inverse_dynamics_are_drakes(uvms):
    plant = uvms.plant
    dry = uv.ContactModel(replace(uvms, hydrodynamics=HydrodynamicParameters()), FAR_AWAY)
    context, forces = plant.CreateDefaultContext(), MultibodyForces(plant)
    coordinates = Coordinates(uvms)
    rng = np.random.default_rng(7)
    for config in dh.random_configurations(seed=7, count=20):
        zeta, zeta_dot = rng.normal(size=(2, 10))
        x = coordinates.to_drake(np.concatenate([config, zeta]))
        plant.SetPositionsAndVelocities(context, x)
        T = np.column_stack([coordinates.vector_to_drake(x, column) for column in np.eye(10)])
        kinematics = dry.kinematics(config)
        np.testing.assert_allclose(
            dry.mass_matrix(kinematics), T.T @ plant.CalcMassMatrix(context) @ T, atol=1e-9)

        v_dot = to_drake_velocity(uvms, drake_acceleration(config[:6], zeta, zeta_dot))
        plant.CalcForceElementsContribution(context, forces)  # weight and joint damping
        expected = T.T @ plant.CalcInverseDynamics(context, v_dot, forces)
        np.testing.assert_allclose(
            dry.inverse_dynamics(kinematics, zeta, zeta_dot), expected,
            rtol=1e-9, atol=1e-9)


SPRING = uv.BilateralSpring(
    stiffness=np.diag([1000.0, 400.0, 400.0, 5.0, 5.0, 5.0]) + 3.0 * np.eye(6)[::-1],
    equilibrium=np.array([0.02, 0.1, -0.1, 0.1, 0.2, -0.1]))


@pytest.mark.parametrize("where", ["free", "skin", "deep"])
@pytest.mark.parametrize("surface", [uv.UnilateralPlane(stiffness=1000.0), SPRING],
                         ids=["plane", "spring"])
def test_model_and_plant_accelerate_alike(uvms, states, surface, where):
    """ζ̇ = f + M⁻¹τ with all of the water, off, in the skin of and deep in the surface."""
    plant, model = Plant(surface), uv.ContactModel(uvms, check_surface(surface))
    rng = np.random.default_rng(8)
    for state in states[where]:
        tau = rng.uniform(-1.0, 1.0, size=10) * np.repeat([50.0, 20.0, 5.0], [3, 3, 4])
        config, zeta = np.split(state, 2)
        M = model.mass_matrix(model.kinematics(config))
        expected = model.drift(config, zeta) + np.linalg.solve(M, tau)
        np.testing.assert_allclose(plant.zeta_dot(state, tau), expected, rtol=1e-8, atol=1e-8)
    if surface is not SPRING:
        depth = model.surface.penetration(model.task_pose(states[where][:, :10])[:, :6])
        assert np.all(depth > 0.0) == (where != "free"), "the states are where they should be"


def check_derivatives(model: uv.ContactModel, config: np.ndarray, zeta: np.ndarray) -> None:
    """Compares ∂f/∂𝔮 and ∂f/∂ζ (m, 6+n, 6+n) with complex steps, one column at a time."""
    f, *derivatives = model.drift_derivatives(config, zeta)
    M = model.mass_matrix(model.kinematics(config))
    np.testing.assert_allclose(f, model.drift(config, zeta), rtol=1e-9, atol=1e-9)
    columns = []
    for direction in np.eye(2 * model.size):
        by_config, by_zeta = np.split(1e-30j * direction, 2)
        residual = model.inverse_dynamics(
            model.kinematics(config + by_config), zeta + by_zeta, f.astype(complex))
        columns.append(-np.linalg.solve(M, residual.imag[..., None] / 1e-30))
    for found, expected in zip(derivatives, np.split(np.concatenate(columns, axis=-1), 2, axis=-1),
                               strict=True):
        np.testing.assert_allclose(
            found, expected, rtol=1e-9, atol=1e-10 * max(np.max(np.abs(expected)), 10.0))


def tilted(surface) -> uv.ContactModel:
    """Returns the robot where gravity has all three components."""
    plant = MultibodyPlant(time_step=0.1)
    uvms = add_uvms(plant, "girona500_arm5e")
    plant.mutable_gravity_field().set_gravity_vector([2.0, -3.0, 8.0])
    plant.Finalize()
    return uv.ContactModel(uvms, surface)


@pytest.mark.parametrize("where", ["free", "skin", "deep"])
@pytest.mark.parametrize("kind", ["plane", "spring", "tilted"])
def test_the_derivatives_of_f_are_those_of_complex_steps(uvms, model, states, kind, where):
    if kind != "plane":
        surface = check_surface(SPRING)
        model = uv.ContactModel(uvms, surface) if kind == "spring" else tilted(surface)
    check_derivatives(model, *np.split(states[where], 2, axis=1))


@pytest.mark.parametrize("robot", [
    turret(0.4), drill(), oblique(), telescope(0), telescope(1), telescope(2)])
def test_robots_with_other_joints_have_their_derivatives_too(robot):
    rng = np.random.default_rng(12)
    config, zeta = rng.uniform(-1.0, 1.0, size=(2, 4, robot.size))
    config[:, 0] += 0.01 - robot.task_pose(config)[:, 0]
    check_derivatives(robot, config, zeta)


def test_the_derivatives_exist_where_the_vehicle_stands_on_its_nose(model):
    """𝔮 is singular there, f is not."""
    config = np.array([[-2.0, 0.0, 0.0, 0.3, 0.5 * np.pi, 0.2, 0.2, 0.9, 0.2, 0.1]])
    check_derivatives(model, config, np.linspace(-0.3, 0.3, 10)[None])


def test_the_equilibrium_input_holds_the_robot_still_on_the_wall(uvms, model, states, plane):
    """τ = M u_eq is the inverse dynamics at rest, and the plant does not move under it."""
    plant = Plant(plane)
    for state in states["deep"]:
        config, still = state[:10], np.zeros(10)
        kinematics = model.kinematics(config)
        tau = model.mass_matrix(kinematics) @ model.equilibrium_input(config)
        np.testing.assert_allclose(
            tau, model.inverse_dynamics(kinematics, still, still), atol=1e-10)
        assert np.linalg.norm(tau) > 5.0, "there is something to hold"
        np.testing.assert_allclose(
            plant.zeta_dot(np.concatenate([config, still]), tau), 0.0, atol=1e-9)


def test_a_stack_of_states_is_the_same_as_one_after_the_other(model, states):
    stack = np.stack([states["free"], states["deep"]])
    config, zeta = np.split(stack, 2, axis=-1)
    kinematics = model.kinematics(config)
    y = model.task_pose(config)
    batched = [y, model.configuration(y), model.drift(config, zeta), *kinematics,
               model.mass_matrix(kinematics), *model.task_motion(config, zeta),
               model.inverse_dynamics(kinematics, zeta, 2.0 * zeta)]
    for i in np.ndindex(2, 8):
        one = Kinematics(*model.kinematics(config[i]))
        single = [model.task_pose(config[i]), model.configuration(y[i]),
                  model.drift(config[i], zeta[i]), *one, model.mass_matrix(one),
                  *model.task_motion(config[i], zeta[i]),
                  model.inverse_dynamics(one, zeta[i], 2.0 * zeta[i])]
        for many, expected in zip(batched, single, strict=True):
            np.testing.assert_allclose(many[i], expected, rtol=1e-9, atol=1e-11)


def test_turning_and_shifting_the_whole_world_about_the_vertical_changes_nothing(uvms, states):
    """With the wall carried along, f in body axes does not know north from east."""
    turn, shift = 2.1, np.array([3.0, -5.0, 7.0])
    R = RotationMatrix.MakeZRotation(turn).matrix()
    wall = uv.UnilateralPlane(stiffness=1000.0, normal=np.array([-0.8, 0.36, 0.48]))
    carried = replace(wall, point=shift, normal=R @ wall.normal)
    here, there = (uv.ContactModel(uvms, check_surface(each)) for each in (wall, carried))
    for state in [*states["free"], *states["deep"]]:
        config, zeta = np.split(state, 2)
        config = config - np.concatenate([dh.chi(config)[:3] - 0.01 * np.eye(3)[0], np.zeros(7)])
        assert here.surface.penetration(dh.chi(config)) > 0.005
        other = config.copy()
        other[:3] = R @ config[:3] + shift
        other[5] += turn
        np.testing.assert_allclose(
            there.drift(other, zeta), here.drift(config, zeta), rtol=1e-9, atol=1e-9)


def test_kinetic_energy_grows_by_the_power_of_the_forces(derivative):
    """d/dt(½ζᵀMζ) = ζᵀτ without weight, drag, damping and contact: Ṁ − 2C is skew."""
    plant = MultibodyPlant(time_step=0.0)
    uvms = add_uvms(plant, "girona500_arm5e")
    plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, 0.0])
    for joint in uvms.joints:
        joint.set_default_damping(0.0)
    plant.Finalize()
    water = uvms.hydrodynamics
    bodies = {name: BodyHydrodynamics(added_mass=body.added_mass)
              for name, body in water.bodies.items()}
    model = uv.ContactModel(replace(uvms, hydrodynamics=replace(water, bodies=bodies)), FAR_AWAY)
    rng = np.random.default_rng(11)
    for config in dh.random_configurations(seed=11, count=10):
        zeta = rng.normal(size=10)
        tau = rng.uniform(-20.0, 20.0, size=10)
        M = model.mass_matrix(model.kinematics(config))
        zeta_dot = model.drift(config, zeta) + np.linalg.solve(M, tau)

        def energy(s, config=config, zeta=zeta, zeta_dot=zeta_dot):
            later = zeta + s * zeta_dot
            return 0.5 * later @ model.mass_matrix(
                model.kinematics(moved(config, zeta, s))) @ later

        assert derivative(energy, 1e-4) == pytest.approx(zeta @ tau, rel=1e-7, abs=1e-6)


def test_a_vehicle_without_an_arm_is_a_model_too(tmp_path):
    """Released at rest it moves as one rigid body with added mass: v̇ = (m − ρV)g/(m + m_A)."""
    folder = tmp_path / "bare"
    folder.mkdir()
    (folder / "bare.sdf").write_text(
        '<sdf version="1.9"><model name="bare"><link name="vehicle"><inertial><mass>50</mass>'
        "<inertia><ixx>1</ixx><iyy>1</iyy><izz>1</izz></inertia></inertial></link>"
        "<frame name=\"tip\" attached_to=\"vehicle\"><pose>0.6 0 0 0 0 0</pose>"
        "</frame></model></sdf>")
    (folder / "hydrodynamics.yaml").write_text(
        "bodies: {vehicle: {displaced_volume: 0.04, added_mass: [{matrix: [9, 9, 30, 1, 1, 1]}]}}")
    (folder / "package.xml").write_text(
        '<?xml version="1.0"?><package format="2"><name>bare</name></package>')
    bare = uv.ContactModel.load(str(folder), check_surface(uv.UnilateralPlane()))
    config = np.array([-3.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    expected = np.array([0.0, 0.0, (50.0 - 40.0) * 9.81 / (50.0 + 30.0), 0.0, 0.0, 0.0])
    np.testing.assert_allclose(bare.drift(config, np.zeros(6)), expected, atol=1e-12)
    np.testing.assert_allclose(bare.task_pose(config)[:3], [-2.4, 0.0, 0.0], atol=1e-12)
    np.testing.assert_array_equal(
        bare.tip_kinematics(config).J_chi, bare.kinematics(config).J_chi)
    config[0], zeta = -0.595, np.linspace(-0.2, 0.3, 6)
    check_derivatives(bare, config[None], zeta[None])
    ahead, behind = (bare.task_jacobian(moved(config, zeta, s)) for s in (1e-5, -1e-5))
    np.testing.assert_allclose(
        bare.task_motion(config, zeta)[2], (ahead - behind) / 2e-5, atol=1e-8)


def test_a_force_that_is_given_counts_as_that_of_the_surface(uvms, model, states):
    """As a force sensor would: robot and water alone, and 𝔉 as numbers."""
    config, zeta = np.split(states["deep"], 2, axis=1)
    alone, kinematics = uv.UvmsModel(uvms), model.kinematics(config)
    chi_dot = np.einsum("kij,kj->ki", kinematics.J_chi, zeta)
    force = model.surface.force(kinematics.chi, chi_dot)
    assert np.min(np.linalg.norm(force, axis=1)) > 5.0
    expected = model.inverse_dynamics(kinematics, zeta, zeta)
    np.testing.assert_allclose(
        alone.inverse_dynamics(kinematics, zeta, zeta, force), expected, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(
        alone.inverse_dynamics(kinematics, zeta, zeta)
        + np.einsum("kij,ki->kj", kinematics.J_chi, force), expected, rtol=1e-10, atol=1e-10)
