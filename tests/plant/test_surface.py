"""`CompliantSurface` on a small arm of its own, and where a surface is that is off."""

from itertools import cycle

import numpy as np
import pytest
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import Adder, ConstantVectorSource, LogVectorOutput
from support.shapes import LAWS, SHAPES, turned
from support.tank import link, plant_of, robot

import uvms_drake as uv
from uvms_drake.model.frames.euler import euler_angles, rotation_matrix
from uvms_drake.model.surface.law import check_surface
from uvms_drake.plant.surface import (
    CompliantSurface,
    SurfaceError,
    displaced,
    pose_and_jacobian,
    rotation_by,
)

BALL = link("tip", 2.3)

POSES = [RigidTransform(),
         RigidTransform(RollPitchYaw(0.7, -0.4, 2.1), np.array([3.0, -5.0, 0.8]))]


def random_state(plant, X_WV, seed=0):
    """Returns a plant state with the vehicle near X_WV and everything moving."""
    rng = np.random.default_rng(seed)
    X = X_WV @ RigidTransform(RollPitchYaw(0.2, -0.3, 0.4), rng.normal(size=3))
    joints = plant.num_positions() - 7
    return np.concatenate([X.rotation().ToQuaternion().wxyz(), X.translation(),
                           rng.uniform(-0.5, 0.5, joints), rng.normal(size=plant.num_velocities())])


def spring_config():
    A = np.random.default_rng(1).normal(size=(6, 6))
    return uv.BilateralSpring(100.0 * (A @ A.T + np.eye(6)),
                           np.array([0.2, -0.1, 0.3, 0.4, -0.2, 0.1]))


def plane_config(plant, state, depth=0.03):
    """Returns a plane with the tip of the robot `depth` inside."""
    context = plant.CreateDefaultContext()
    plant.SetPositionsAndVelocities(context, state)
    chi, _ = pose_and_jacobian(plant, context, plant.GetFrameByName("tip"))
    normal = np.array([-0.6, 0.48, 0.64])
    return uv.UnilateralPlane(chi[:3] + depth * normal, normal, 700.0, 1.3, 0.004)


def outputs(system, state):
    context = system.CreateDefaultContext()
    system.GetInputPort("plant_state").FixValue(context, state)
    return {name: system.GetOutputPort(name).Eval(context)
            for name in ("generalized_force", "force", "penetration")}


def chi_of(plant, state):
    context = plant.CreateDefaultContext()
    plant.SetPositionsAndVelocities(context, state)
    X_WT = plant.GetFrameByName("tip").CalcPoseInWorld(context)
    return np.concatenate([X_WT.translation(), RollPitchYaw(X_WT.rotation()).vector()])


def chi_rate(plant, state, h=1e-6):
    """Returns χ̇ by central differences along q̇ = N(q) v."""
    context = plant.CreateDefaultContext()
    plant.SetPositionsAndVelocities(context, state)
    q_dot = plant.MapVelocityToQDot(context, plant.GetVelocities(context))
    step = np.append(h * q_dot, np.zeros(plant.num_velocities()))
    return (chi_of(plant, state + step) - chi_of(plant, state - step)) / (2.0 * h)


@pytest.mark.parametrize("X_WV", POSES, ids=["upright", "turned and moved"])
@pytest.mark.parametrize("kind", ["spring", "plane"])
def test_the_force_is_the_laws_at_the_tip_and_the_robot_feels_minus_its_power(X_WV, kind):
    """By virtual power: vᵀτ = −𝔉ᵀχ̇ for every v, with χ̇ by finite differences."""
    plant = plant_of(robot())
    state = random_state(plant, X_WV)
    config = spring_config() if kind == "spring" else plane_config(plant, state)
    system = CompliantSurface(plant, plant.GetFrameByName("tip"), config)
    law = check_surface(config)
    chi = chi_of(plant, state)
    out = outputs(system, state)
    np.testing.assert_allclose(
        out["force"], law.force(chi, chi_rate(plant, state)), rtol=1e-6, atol=1e-9)
    assert np.linalg.norm(out["force"]) > 1.0
    for v in np.eye(plant.num_velocities()):
        virtual = np.append(state[: plant.num_positions()], v)
        assert v @ out["generalized_force"] == pytest.approx(
            -out["force"] @ chi_rate(plant, virtual), abs=1e-6 * np.linalg.norm(out["force"]))
    np.testing.assert_allclose(out["penetration"], [law.penetration(chi)], rtol=1e-12)


def thrown(surface, tangent, weight):
    """Throws a ball at a surface and pulls it there; returns its state (T, 13) and its energy (T,).

    Energy is kinetic, potential and elastic, the last by quadrature of the force at rest.
    """
    builder = DiagramBuilder()
    plant = plant_of(BALL, builder)
    contact = CompliantSurface.AddToBuilder(
        builder, plant, plant.GetFrameByName("tip"), surface, name="surface",
        plant_state=plant.get_state_output_port())
    pull = builder.AddSystem(ConstantVectorSource(np.append(np.zeros(3), weight)))
    total = builder.AddSystem(Adder(2, 6))
    builder.Connect(contact.GetOutputPort("generalized_force"), total.get_input_port(0))
    builder.Connect(pull.get_output_port(), total.get_input_port(1))
    builder.Connect(total.get_output_port(), plant.get_applied_generalized_force_input_port())
    log = LogVectorOutput(plant.get_state_output_port(), builder, 0.01)
    simulator = Simulator(builder.Build())
    simulator.get_mutable_integrator().set_target_accuracy(1e-7)
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    away = surface.geometry.point_at(np.zeros(2), -0.02)
    plant.SetPositionsAndVelocities(context, np.concatenate([
        [1, 0, 0, 0], away, np.zeros(3), -0.3 * surface.geometry.normal + 0.1 * tangent]))
    simulator.AdvanceTo(1.0)
    states = log.FindLog(simulator.get_context()).data().T
    position, velocity = states[:, 4:7], states[:, 10:]
    depth = surface.geometry.depth(position)
    fraction = (np.arange(200) + 0.5) / 200
    elastic = np.mean(surface.law.force(depth[:, None] * fraction), axis=1) * depth
    return states, 0.5 * 2.3 * np.sum(velocity**2, axis=1) + elastic - position @ weight


@pytest.mark.parametrize(("name", "law"), list(zip(SHAPES, cycle(LAWS))))
def test_a_ball_thrown_at_any_surface_keeps_its_energy_or_loses_it(name, law):
    shape = turned(SHAPES[name])
    tangent, weight = shape.axes[1], 12.0 * shape.axes[2]
    smooth = uv.ShapedSurface(shape, LAWS[law], dissipation=0.0, friction=0.0)
    states, energy = thrown(smooth, tangent, weight)
    assert np.max(shape.depth(states[:, 4:7])) > 0.015
    np.testing.assert_allclose(energy, energy[0], atol=2e-4)
    rough = uv.ShapedSurface(shape, LAWS[law], dissipation=3.0, friction=0.4)
    _, energy = thrown(rough, tangent, weight)
    assert np.max(np.diff(energy)) < 2e-5
    assert energy[-1] < energy[0] - 0.1


@pytest.mark.parametrize("name", ["plane", "pole", "pipe"])
def test_a_ball_that_slides_slows_down_by_the_friction_and_ends_as_deep_as_its_weight_takes(name):
    """Along the axis it loses μ times the momentum that the surface gives, 12 N s in 1 s."""
    shape = turned(SHAPES[name])
    weight = 12.0 * shape.axes[2]
    surface = uv.ShapedSurface(shape, LAWS["linear"], dissipation=8.0, friction=0.01, creep=0.001)
    states, _ = thrown(surface, shape.tangent, weight)
    given = 12.0 + 2.3 * (0.3 + states[-1, 10:] @ shape.normal)
    lost = 2.3 * (0.1 - states[-1, 10:] @ shape.tangent)
    assert lost == pytest.approx(0.01 * given, rel=1e-4)
    assert shape.depth(states[-1, 4:7]) == pytest.approx(LAWS["linear"].depth_for(12.0), rel=0.05)


OFF = SurfaceError(stiffness=1.3, shift=np.array([0.02, -0.01, 0.03]),
                   turn=np.array([0.3, -0.2, 0.4]))
PLANE = uv.UnilateralPlane(point=np.array([1.0, 0.5, -0.2]), normal=np.array([-0.8, 0.0, 0.6]))


@pytest.fixture(scope="module")
def spring():
    """A spring with a stiffness that couples everything, away from zero attitude."""
    root = np.random.default_rng(0).normal(size=(6, 6)) * np.repeat([10.0, 1.0], 3)[:, None]
    return uv.BilateralSpring(stiffness=root @ root.T + np.eye(6),
                           equilibrium=np.array([1.0, 2.0, 3.0, 0.3, -0.4, 0.9]))


def carried(chi, point):
    """Returns χ of a tip that is moved along with the surface, about a point of it."""
    R = AngleAxis(np.linalg.norm(OFF.turn), OFF.turn / np.linalg.norm(OFF.turn)).rotation()
    return np.concatenate([point + OFF.shift + R @ (chi[:3] - point),
                           euler_angles(R @ rotation_matrix(chi[3:]))])


def test_a_rotation_vector_is_an_axis_times_an_angle():
    for turn in (OFF.turn, np.array([0.0, 0.0, 0.5 * np.pi]), np.array([0.0, 1e-9, 0.0])):
        angle = np.linalg.norm(turn)
        np.testing.assert_allclose(
            rotation_by(turn), AngleAxis(angle, turn / angle).rotation(), atol=1e-15)
    np.testing.assert_array_equal(rotation_by(np.zeros(3)), np.eye(3))


def test_a_plane_pushes_a_tip_that_is_carried_along_as_before_but_for_its_stiffness():
    chi, speed = np.array([1.05, 0.9, -0.4, 0.0, 0.0, 0.0]), np.array([0.1, 0.2, -0.05])
    R = rotation_by(OFF.turn)
    old, new = (check_surface(config) for config in (PLANE, displaced(PLANE, OFF)))
    before = old.force(chi, np.concatenate([speed, np.zeros(3)]))
    after = new.force(carried(chi, PLANE.point), np.concatenate([R @ speed, np.zeros(3)]))
    assert np.linalg.norm(before) > 10.0
    np.testing.assert_allclose(after[:3], 1.3 * R @ before[:3], rtol=1e-12)


def test_a_spring_that_is_carried_along_with_the_tip_keeps_its_energy(spring):
    """Up to a third power of the stretch, as Euler angles are no vector."""
    new = displaced(spring, OFF)
    np.testing.assert_allclose(
        new.equilibrium, carried(spring.equilibrium, spring.equilibrium[:3]), atol=1e-14)
    for stretch in 1e-5 * np.random.default_rng(1).normal(size=(10, 6)):
        moved = carried(spring.equilibrium + stretch, spring.equilibrium[:3]) - new.equilibrium
        assert moved @ new.stiffness @ moved == pytest.approx(
            1.3 * stretch @ spring.stiffness @ stretch, rel=1e-3)
    check_surface(new)  # It is symmetric and positive definite.
