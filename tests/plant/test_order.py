"""The order converters on a robot and in a Diagram of their own."""

import numpy as np
import pytest
from pydrake.math import RollPitchYaw
from pydrake.systems.framework import DiagramBuilder
from support import tank
from support.tank import plant_of

from uvms_drake.model.coordinates import Coordinates
from uvms_drake.model.description.hydrodynamics_file import HydrodynamicParameters
from uvms_drake.model.uvms import Uvms
from uvms_drake.plant.order import ToDrakeOrder, ToPaperOrder


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


def random_state(plant):
    """Returns a plant state and a Context with it."""
    x = np.random.default_rng(0).normal(size=plant.num_multibody_states())
    x[:4] = RollPitchYaw(0.7, -0.4, 2.1).ToQuaternion().wxyz()
    context = plant.CreateDefaultContext()
    plant.SetPositionsAndVelocities(context, x)
    return x, context


def test_the_state_is_pose_and_body_velocity(robot):
    coordinates, plant, builder = robot
    system = ToPaperOrder.AddToBuilder(
        builder, coordinates, plant_state=plant.get_state_output_port())
    x, plant_context = random_state(plant)
    context = system.CreateDefaultContext()
    system.GetInputPort("plant_state").FixValue(context, x)
    state = system.GetOutputPort("state").Eval(context)

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
    coordinates, plant, builder = robot
    system = ToDrakeOrder.AddToBuilder(
        builder, coordinates, plant_state=plant.get_state_output_port())
    x, plant_context = random_state(plant)
    tau = np.random.default_rng(1).normal(size=8)
    context = system.CreateDefaultContext()
    system.GetInputPort("plant_state").FixValue(context, x)
    system.GetInputPort("paper_order").FixValue(context, tau)
    tau_drake = system.GetOutputPort("drake_order").Eval(context)
    zeta = coordinates.from_drake(x)[8:]
    assert tau_drake @ plant.GetVelocities(plant_context) == pytest.approx(tau @ zeta, rel=1e-12)


def test_an_acceleration_of_the_vehicle_is_that_of_its_body_less_the_turning_of_its_axes(robot):
    coordinates, plant, builder = robot
    system = ToPaperOrder.AddToBuilder(
        builder, coordinates, plant_state=plant.get_state_output_port())
    x, plant_context = random_state(plant)
    v_dot = np.random.default_rng(2).normal(size=8)
    context = system.CreateDefaultContext()
    system.GetInputPort("plant_state").FixValue(context, x)
    system.GetInputPort("v_dot").FixValue(context, v_dot)
    zeta_dot = system.GetOutputPort("acceleration").Eval(context)

    vehicle = plant.GetBodyByName("vehicle")
    A_WB = plant.CalcSpatialAccelerationsFromVdot(plant_context, v_dot)[int(vehicle.index())]
    R_WB = vehicle.EvalPoseInWorld(plant_context).rotation().matrix()
    nu = coordinates.from_drake(x)[8:14]
    np.testing.assert_allclose(
        zeta_dot[:3] + np.cross(nu[3:], nu[:3]), R_WB.T @ A_WB.translational(), atol=1e-13)
    np.testing.assert_allclose(zeta_dot[3:6], R_WB.T @ A_WB.rotational(), atol=1e-13)
    joints = [plant.GetJointByName(name).velocity_start() for name in ("shoulder", "elbow")]
    np.testing.assert_array_equal(zeta_dot[6:], v_dot[joints])
