"""The assembled plant: its order, its parts, and forces of Drake's own systems."""

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import (
    ExternallyAppliedSpatialForce,
    ExternallyAppliedSpatialForceMultiplexer,
    MultibodyPlant,
    Propeller,
    Wing,
)
from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator
from pydrake.systems.framework import DiagramBuilder
from support import tank
from support.surfaces import Sphere
from support.tank import plant_of

import uvms_drake as uv
from uvms_drake.model.coordinates import Coordinates
from uvms_drake.model.description.hydrodynamics_file import HydrodynamicParameters
from uvms_drake.model.uvms import Uvms, add_uvms
from uvms_drake.plant.applied_forces import generalized_force
from uvms_drake.plant.disturbance import ConstantDisturbance, SinusoidalDisturbance
from uvms_drake.plant.hydrodynamics import Hydrodynamics
from uvms_drake.plant.order import ToDrakeOrder, ToPaperOrder
from uvms_drake.plant.surface import CompliantSurface, pose_and_jacobian


@pytest.fixture
def robot():
    """Returns the Coordinates of the robot, its plant and the plant's builder."""
    builder = DiagramBuilder()
    plant = plant_of(tank.robot(), builder)
    coordinates = Coordinates(Uvms(
        plant, plant.GetModelInstanceByName("robot"), plant.GetBodyByName("vehicle"),
        (plant.GetJointByName("shoulder"), plant.GetJointByName("elbow")),
        plant.GetFrameByName("tip"), HydrodynamicParameters()))
    return coordinates, plant, builder


def converted(robot, kind, output, **inputs):
    """Returns a plant state, a Context with it, and what a converter makes of it and of inputs."""
    coordinates, plant, builder = robot
    x = np.random.default_rng(0).normal(size=plant.num_multibody_states())
    x[:4] = RollPitchYaw(0.7, -0.4, 2.1).ToQuaternion().wxyz()
    plant_context = plant.CreateDefaultContext()
    plant.SetPositionsAndVelocities(plant_context, x)
    system = kind.AddToBuilder(builder, coordinates, name="order",
                               plant_state=plant.get_state_output_port())
    context = system.CreateDefaultContext()
    for name, value in {"plant_state": x, **inputs}.items():
        system.GetInputPort(name).FixValue(context, value)
    return x, plant_context, system.GetOutputPort(output).Eval(context)


def test_the_state_is_pose_and_body_velocity(robot):
    plant = robot[1]
    _, plant_context, state = converted(robot, ToPaperOrder, "state")
    vehicle = plant.GetBodyByName("vehicle")
    X_WB = vehicle.EvalPoseInWorld(plant_context)
    V_WB = vehicle.EvalSpatialVelocityInWorld(plant_context)
    R_WB = X_WB.rotation().matrix()
    joints = [plant.GetJointByName(name) for name in ("shoulder", "elbow")]
    np.testing.assert_allclose(state, np.concatenate([
        X_WB.translation(), RollPitchYaw(X_WB.rotation()).vector(),
        [joint.get_angle(plant_context) for joint in joints],
        R_WB.T @ V_WB.translational(), R_WB.T @ V_WB.rotational(),
        [joint.get_angular_rate(plant_context) for joint in joints]]), atol=1e-14)


def test_a_force_keeps_its_power(robot):
    coordinates, plant, _ = robot
    tau = np.random.default_rng(1).normal(size=8)
    x, plant_context, tau_drake = converted(
        robot, ToDrakeOrder, "drake_order", paper_order=tau)
    zeta = coordinates.from_drake(x)[8:]
    assert tau_drake @ plant.GetVelocities(plant_context) == pytest.approx(tau @ zeta, rel=1e-12)


def test_an_acceleration_of_the_vehicle_is_that_of_its_body_less_the_turning_of_its_axes(robot):
    coordinates, plant, _ = robot
    v_dot = np.random.default_rng(2).normal(size=8)
    x, plant_context, zeta_dot = converted(robot, ToPaperOrder, "acceleration", v_dot=v_dot)
    vehicle = plant.GetBodyByName("vehicle")
    A_WB = plant.CalcSpatialAccelerationsFromVdot(plant_context, v_dot)[int(vehicle.index())]
    R_WB = vehicle.EvalPoseInWorld(plant_context).rotation().matrix()
    nu = coordinates.from_drake(x)[8:14]
    np.testing.assert_allclose(
        zeta_dot[:3] + np.cross(nu[3:], nu[:3]), R_WB.T @ A_WB.translational(), atol=1e-13)
    np.testing.assert_allclose(zeta_dot[3:6], R_WB.T @ A_WB.rotational(), atol=1e-13)
    joints = [plant.GetJointByName(name).velocity_start() for name in ("shoulder", "elbow")]
    np.testing.assert_array_equal(zeta_dot[6:], v_dot[joints])


MODEL = "girona500_arm5e"
FAR_AWAY = uv.UnilateralPlane(point=np.array([100.0, 0.0, 0.0]))
CALM = ConstantDisturbance(bound=0.0)


def make(surface=FAR_AWAY, disturbance=CALM, **kwargs):
    return uv.make_uvms_plant(MODEL, surface=surface, disturbance=disturbance, **kwargs)


def moving_state():
    rng = np.random.default_rng(0)
    eta = np.array([0.4, -1.2, 2.0, 0.1, -0.2, 0.7])
    return np.concatenate([eta, rng.uniform(-0.3, 0.3, 4), rng.uniform(-0.3, 0.3, 10)])


def simulator_of(uvms, context=None):
    simulator = Simulator(uvms) if context is None else Simulator(uvms, context)
    ResetIntegratorFromFlags(simulator, "runge_kutta3", 0.01)
    simulator.get_mutable_integrator().set_fixed_step_mode(True)
    return simulator


def test_the_diagram_equals_its_parts_wired_by_hand():
    """Force, current, surface and disturbance each arrive once, in the right order and sign."""
    rng = np.random.default_rng(1)
    tau, current = rng.normal(scale=20.0, size=10), np.array([0.2, -0.1, 0.05])
    d = ConstantDisturbance(0.3, rng.normal(size=10))
    spring = uv.BilateralSpring(np.diag([90.0, 80, 70, 3, 2, 1]),
                                np.array([1, -1, 2, 0.1, 0.2, 0.3]))
    uvms = make(spring, d)
    context = uvms.CreateDefaultContext()
    uv.set_state(uvms, context, moving_state())
    uvms.GetInputPort("tau").FixValue(context, tau)
    uvms.GetInputPort("current").FixValue(context, current)
    actual = uvms.EvalTimeDerivatives(context).CopyToVector()

    builder = DiagramBuilder()
    plant = builder.AddNamedSystem("plant", MultibodyPlant(0.0))
    robot = add_uvms(plant, MODEL)
    plant.Finalize()
    coordinates = Coordinates(robot)
    x = coordinates.to_drake(moving_state())
    water = Hydrodynamics.AddToBuilder(builder, plant, robot.hydrodynamics)
    surface = CompliantSurface(plant, robot.tip, spring)
    surface_context = surface.CreateDefaultContext()
    surface.GetInputPort("plant_state").FixValue(surface_context, x)
    push = surface.GetOutputPort("generalized_force").Eval(surface_context)
    by_hand = builder.Build()
    context = by_hand.CreateDefaultContext()
    plant.SetPositionsAndVelocities(plant.GetMyMutableContextFromRoot(context), x)
    water_context = water.GetMyMutableContextFromRoot(context)
    water.GetInputPort("generalized_force").FixValue(
        water_context, push + coordinates.vector_to_drake(x, tau))
    water.GetInputPort("current").FixValue(water_context, current)
    d_paper = d.bound * d.direction / np.linalg.norm(d.direction)
    water.GetInputPort("acceleration_disturbance").FixValue(
        water_context, coordinates.vector_to_drake(x, d_paper))
    expected = by_hand.EvalTimeDerivatives(context).CopyToVector()
    np.testing.assert_allclose(actual, expected, rtol=1e-11, atol=1e-11)


def test_the_disturbance_is_what_is_added_to_the_rate_of_zeta():
    rates = []
    for bound in (0.0, 0.4):
        uvms = make(disturbance=SinusoidalDisturbance(bound, phase=0.9))
        context = uvms.CreateDefaultContext()
        uv.set_state(uvms, context, moving_state())
        d = uvms.GetOutputPort("disturbance").Eval(context)
        rates.append(uvms.GetOutputPort("acceleration").Eval(context).copy())
    assert np.linalg.norm(d) > 0.1
    np.testing.assert_allclose(rates[1] - rates[0], d, atol=1e-9)


def test_the_acceleration_is_the_rate_of_zeta_along_a_trajectory():
    """In a current and in contact, disturbed and driven, by central differences."""
    uvms = make(uv.UnilateralPlane(np.array([0.5, 0.0, 0.0]), stiffness=200.0, transition=0.5),
                SinusoidalDisturbance(0.4, phase=0.9))
    simulator = simulator_of(uvms)
    context, step = simulator.get_mutable_context(), 2e-4
    uv.set_state(uvms, context, moving_state())
    tau = [20.0, -10.0, 30.0, 5.0, -5.0, 8.0, 1.0, -1.0, 0.5, 0.01]
    uvms.GetInputPort("tau").FixValue(context, tau)
    uvms.GetInputPort("current").FixValue(context, [0.2, -0.1, 0.05])
    zeta, rates = [], []
    for time in step * np.arange(51):
        simulator.AdvanceTo(time)
        zeta.append(uvms.GetOutputPort("state").Eval(context)[10:].copy())
        rates.append(uvms.GetOutputPort("acceleration").Eval(context).copy())
    assert np.linalg.norm(uvms.GetOutputPort("force").Eval(context)) > 1.0
    expected = (np.array(zeta[2:]) - np.array(zeta[:-2])) / (2.0 * step)
    np.testing.assert_allclose(rates[1:-1], expected, atol=1e-5 * np.max(np.abs(expected)))


def test_left_alone_it_floats_up_slowly_and_arm_and_water_bring_it_to_rest():
    """It is trimmed a little light; nothing blows up although added mass exceeds the dry mass."""
    uvms = make()
    simulator = simulator_of(uvms)
    uv.set_state(uvms, simulator.get_mutable_context(), moving_state())
    simulator.AdvanceTo(10.0)
    state = uvms.GetOutputPort("state").Eval(simulator.get_context())
    assert np.all(np.isfinite(state))
    assert np.linalg.norm(state[10:16]) < 0.3


def test_a_surface_of_ones_own_pushes_by_its_law():
    sphere = Sphere()
    uvms = make(sphere)
    context = uvms.CreateDefaultContext()
    uv.set_state(uvms, context, np.concatenate([[-1.6], np.zeros(19)]))
    plant = uvms.GetSubsystemByName("plant")
    tip = uvms.GetSubsystemByName("surface")._tip
    chi, _ = pose_and_jacobian(plant, uvms.GetSubsystemContext(plant, context), tip)
    force = uvms.GetOutputPort("force").Eval(context)
    assert np.linalg.norm(force) > 10.0
    np.testing.assert_array_equal(force, sphere.force(chi, np.zeros(6)))
    with pytest.raises(uv.InvalidParameter, match=r"^surface\.stiffness = -1\.0: must be"):
        make(Sphere(stiffness=-1.0))


def test_a_clone_of_a_context_goes_on_from_its_own_state():
    """Geometry that is known already is not computed again as the water begins to move."""
    uvms, current = make(uv.UnilateralPlane()), np.array([0.3, -0.2, 0.1])
    accelerations = []
    for known in (True, False):
        context = uvms.CreateDefaultContext()
        uvms.GetInputPort("current").FixValue(context, np.zeros(3))
        uv.set_state(uvms, context, moving_state())
        clone = context
        if known:
            uvms.GetOutputPort("acceleration").Eval(context)
            clone = context.Clone()
            uv.set_state(uvms, context, 0.5 * moving_state())
            uvms.GetOutputPort("acceleration").Eval(context)
        uvms.GetInputPort("current").FixValue(clone, current)
        accelerations.append(uvms.GetOutputPort("acceleration").Eval(clone).copy())
    np.testing.assert_array_equal(*accelerations)


AT = np.array([-0.3, 0.2, 0.1])  # m, where a propeller sits on the vehicle
ALONG = RotationMatrix.MakeFromOneVector(np.array([0.6, 0.0, 0.8]), 2)  # its z-axis pushes
POSES = [np.zeros(6), np.array([3.0, -5.0, 0.8, 0.7, -0.4, 2.1])]
JOINTS = np.array([0.2, 0.8, 0.1, -0.4])


@pytest.fixture
def plant(uvms):
    """The robot in a plant of its own, with a Context in motion."""
    context = uvms.plant.CreateDefaultContext()
    rng = np.random.default_rng(0)
    q = np.concatenate([rng.normal(size=7), JOINTS])
    q[:4] /= np.linalg.norm(q[:4])
    uvms.plant.SetPositionsAndVelocities(context, np.concatenate([q, rng.normal(size=10)]))
    return uvms.plant, context


def spatial_force(body, seed):
    rng = np.random.default_rng(seed)
    force = ExternallyAppliedSpatialForce()
    force.body_index, force.p_BoBq_B = body.index(), rng.normal(size=3)
    force.F_Bq_W = SpatialForce(rng.normal(size=3), rng.normal(size=3))
    return force


def forces_on(plant):
    bodies = [plant.get_joint(index).child_body() for index in plant.GetJointIndices()]
    return [spatial_force(body, seed) for seed, body in enumerate(bodies)]


def test_in_air_a_generalized_force_is_what_the_plant_makes_of_the_forces(plant):
    plant, context = plant
    forces, rates = forces_on(plant), []
    for spatial, generalized in (
            (forces, np.zeros(10)), ([], generalized_force(plant, context, forces))):
        plant.get_applied_spatial_force_input_port().FixValue(context, spatial)
        plant.get_applied_generalized_force_input_port().FixValue(context, generalized)
        rates.append(plant.get_generalized_acceleration_output_port().Eval(context).copy())
    np.testing.assert_allclose(rates[1], rates[0], rtol=1e-10, atol=1e-10)


class Driven:
    """The robot under water with forces of Drake's systems, wired as their headers say."""

    def __init__(self, *kinds):
        builder = DiagramBuilder()
        self.uvms = builder.AddNamedSystem("uvms", uv.make_uvms_plant(
            MODEL, surface=uv.UnilateralPlane(point=np.array([100.0, 0.0, 0.0])),
            disturbance=ConstantDisturbance(0.0)))
        index = self.uvms.GetSubsystemByName("plant").GetBodyByName("vehicle").index()
        self.propellers, ports = [], []
        for kind in kinds:
            if kind == "wing":
                system = builder.AddSystem(Wing(
                    index, surface_area=0.1, fluid_density=1025.0,
                    X_BodyWing=RigidTransform(np.array([0.2, 0.0, -0.3]))))
                builder.Connect(self.uvms.GetOutputPort("body_spatial_velocities"),
                                system.get_body_spatial_velocities_input_port())
                ports.append(system.get_spatial_force_output_port())
            else:
                system = builder.AddSystem(Propeller(index, RigidTransform(ALONG, AT)))
                self.propellers.append(system)
                ports.append(system.get_spatial_forces_output_port())
            builder.Connect(self.uvms.GetOutputPort("body_poses"),
                            system.get_body_poses_input_port())
        total = builder.AddSystem(ExternallyAppliedSpatialForceMultiplexer(len(ports)))
        for i, port in enumerate(ports):
            builder.Connect(port, total.get_input_port(i))
        builder.Connect(
            total.get_output_port(), self.uvms.GetInputPort("applied_spatial_force"))
        self.diagram = builder.Build()
        self.root = self.diagram.CreateDefaultContext()
        self.context = self.uvms.GetMyMutableContextFromRoot(self.root)

    def acceleration(self, eta, thrusts, zeta=None):
        """Returns ζ̇ (10,) at η and the joint angles of this file."""
        zeta = np.zeros(10) if zeta is None else zeta
        uv.set_state(self.uvms, self.context, np.concatenate([eta, JOINTS, zeta]))
        for propeller, thrust in zip(self.propellers, thrusts, strict=True):
            propeller.get_command_input_port().FixValue(
                propeller.GetMyMutableContextFromRoot(self.root), [thrust])
        return self.uvms.GetOutputPort("acceleration").Eval(self.context).copy()


def wrench(thrust):
    """Returns the force and moment (6,) of a propeller about the vehicle's origin."""
    force = thrust * ALONG.matrix()[:, 2]
    return np.concatenate([force, np.cross(AT, force)])


@pytest.mark.parametrize("eta", POSES, ids=["upright", "turned and moved"])
def test_a_propeller_accelerates_robot_and_water_together(model, eta):
    """By the inertia of the controller's model, which is computed without a MultibodyPlant."""
    driven = Driven("propeller")
    change = driven.acceleration(eta, [100.0]) - driven.acceleration(eta, [0.0])
    M = model.mass_matrix(model.kinematics(np.concatenate([eta, JOINTS])))
    expected = np.linalg.solve(M, np.concatenate([wrench(100.0), np.zeros(4)]))
    np.testing.assert_allclose(change, expected, rtol=1e-9, atol=1e-12)


def test_a_wing_brakes_beside_a_propeller():
    """A plate that falls broadside feels ρ w² S upwards, at its place on the vehicle."""
    sinking = np.concatenate([[0.0, 0.0, 0.5], np.zeros(7)])
    change = (Driven("wing", "propeller").acceleration(POSES[0], [0.0], sinking)
              - Driven("propeller").acceleration(POSES[0], [0.0], sinking))
    assert change[2] < -0.02


def test_a_generalized_force_in_the_plants_order_adds_to_tau():
    uvms = Driven("propeller").uvms
    context = uvms.CreateDefaultContext()
    uvms.GetInputPort("applied_spatial_force").FixValue(context, [])
    rates = []
    for name, force in (("tau", [10.0, 20, 30, 4, 5, 6, 0.1, 0.2, 0.3, 0.4]),
                        ("applied_generalized_force",
                         [4.0, 5, 6, 10, 20, 30, 0.1, 0.2, 0.3, 0.4])):
        uv.set_state(uvms, context, np.concatenate([np.zeros(6), JOINTS, np.zeros(10)]))
        for port in ("tau", "applied_generalized_force"):
            uvms.GetInputPort(port).FixValue(context, force if port == name else np.zeros(10))
        rates.append(uvms.EvalTimeDerivatives(context).CopyToVector())
    np.testing.assert_allclose(rates[1], rates[0], rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("name", ["applied_spatial_force", "actuation"])
def test_a_force_that_came_before_the_water_is_refused(name):
    builder = DiagramBuilder()
    plant = builder.AddNamedSystem("plant", MultibodyPlant(0.0))
    uvms = add_uvms(plant, MODEL)
    plant.Finalize()
    builder.ExportInput(plant.GetInputPort(name))
    with pytest.raises(uv.InvalidParameter, match=rf"^plant\.{name} = .*: must be free"):
        Hydrodynamics.AddToBuilder(builder, plant, uvms.hydrodynamics)
