"""The frame of the task: what its Euler angles are about, and a world that is turned with it."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.math import RollPitchYaw, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from support.quick import FEW, search_less

import uvms_drake as uv
from uvms_drake.control.limits.pose import ToolAngle
from uvms_drake.model.coordinates import Coordinates
from uvms_drake.model.surface.law import check_surface
from uvms_drake.model.uvms import add_uvms
from uvms_drake.plant.surface import pose_and_jacobian
from uvms_drake.station.plant import make_simulated_uvms
from uvms_drake.station.problem import make_dynamic_ocp

FRAME = np.array([0.3, -1.4, 0.5])
CONFIG = np.array([0.3, -0.2, 0.5, 0.1, -0.2, 2.0, 0.2, 0.1, -0.2, 0.4])
ZETA = np.linspace(-0.3, 0.4, 10)
TURN = RotationMatrix(RollPitchYaw(0.2, -0.7, 0.4))
"""How the world is turned."""


@pytest.fixture(scope="module")
def uvms():
    return uv.read_uvms("girona500_arm5e")


def turned_pose(eta: np.ndarray) -> np.ndarray:
    """Returns a vehicle's pose (6,) in the turned world."""
    attitude = TURN @ RollPitchYaw(eta[3:]).ToRotationMatrix()
    return np.concatenate([TURN @ eta[:3], RollPitchYaw(attitude).vector()])


def test_the_models_angles_are_about_the_frame(uvms):
    model, paper = uv.UvmsModel(uvms, FRAME), uv.UvmsModel(uvms)
    chi, chi_W = model.task_pose(CONFIG)[:6], paper.task_pose(CONFIG)[:6]
    np.testing.assert_array_equal(chi[:3], chi_W[:3])
    R_WE = RotationMatrix(RollPitchYaw(FRAME)) @ RotationMatrix(RollPitchYaw(chi[3:]))
    np.testing.assert_allclose(
        R_WE.matrix(), RollPitchYaw(chi_W[3:]).ToRotationMatrix().matrix(), atol=1e-12)
    np.testing.assert_allclose(model.configuration(model.task_pose(CONFIG)), CONFIG, atol=1e-12)


def test_plant_and_model_agree_about_pose_and_jacobian(uvms):
    coordinates, kinematics = Coordinates(uvms), uv.UvmsModel(uvms, FRAME).kinematics(CONFIG)
    state = coordinates.to_drake(np.concatenate([CONFIG, ZETA]))
    context = uvms.plant.CreateDefaultContext()
    uvms.plant.SetPositionsAndVelocities(context, state)
    chi, J = pose_and_jacobian(
        uvms.plant, context, uvms.tip, RotationMatrix(RollPitchYaw(FRAME)).inverse())
    np.testing.assert_allclose(kinematics.chi, chi, atol=1e-12)
    np.testing.assert_allclose(
        kinematics.J_chi @ ZETA, J @ uvms.plant.GetVelocities(context), atol=1e-12)


def test_rates_are_those_of_differences(uvms, derivative):
    model = uv.UvmsModel(uvms, FRAME)
    _, J_x, J_x_dot = model.task_motion(CONFIG, ZETA)
    along = uv.configuration_rate(CONFIG, ZETA)
    np.testing.assert_allclose(
        J_x @ ZETA, derivative(lambda s: model.task_pose(CONFIG + s * along), 1e-5), atol=1e-8)
    np.testing.assert_allclose(
        J_x_dot, derivative(lambda s: model.task_jacobian(CONFIG + s * along), 1e-5), atol=1e-7)


def test_a_tool_straight_down_is_like_a_tool_straight_ahead(uvms):
    ahead, down = uv.UvmsModel(uvms), uv.UvmsModel(uvms, np.array([0.0, -0.5 * np.pi, 0.0]))
    q = np.array([0.0, 0.1, -0.1, 0.0])
    config = np.concatenate([np.zeros(6), q])
    assert abs(ahead.task_pose(config)[4]) == pytest.approx(0.5 * np.pi, abs=1e-6)
    np.testing.assert_allclose(down.task_pose(config)[3:6], 0.0, atol=1e-12)
    assert np.linalg.norm(down.task_jacobian(config), 2) < 3.0


def test_the_limit_on_the_tools_angle_is_about_the_same_axis(uvms):
    model = uv.ContactModel(uvms, check_surface(uv.UnilateralPlane()), FRAME)
    n = np.array([0.0, 0.6, 0.8])
    x_E = model.kinematics(CONFIG).A_E[:3, 0]
    at = uv.Points(model, CONFIG, model.task_pose(CONFIG))
    assert ToolAngle(n, 0.3).values(at) == pytest.approx([n @ x_E], abs=1e-12)


def closed_loop(scenario, duration: float) -> tuple[np.ndarray, ...]:
    """Returns state, force and τ after a time, without gravity."""
    alone = MultibodyPlant(time_step=0.0)
    robot = add_uvms(alone, scenario.model)
    alone.Finalize()
    model = uv.ContactModel(robot, check_surface(scenario.surface), scenario.task.frame)
    builder = DiagramBuilder()
    plant = builder.AddSystem(make_simulated_uvms(scenario, scenario.disturbance))
    controller = builder.AddSystem(uv.make_tube_mpc(
        make_dynamic_ocp(scenario, model), scenario.ancillary))
    builder.Connect(plant.GetOutputPort("state"), controller.GetInputPort("state"))
    builder.Connect(controller.GetOutputPort("tau"), plant.GetInputPort("tau"))
    simulator = Simulator(builder.Build())
    root = simulator.get_mutable_context()
    uv.set_state(plant, plant.GetMyMutableContextFromRoot(root),
                 np.concatenate([scenario.start.config, np.zeros(10)]))
    simulator.get_mutable_integrator().set_maximum_step_size(0.02)
    simulator.AdvanceTo(duration)
    return tuple(system.GetOutputPort(name).Eval(system.GetMyContextFromRoot(root)).copy()
                 for system, name in ((plant, "state"), (plant, "force"), (controller, "tau")))


def test_a_turned_world_has_the_same_closed_loop(monkeypatch):
    # Without gravity, and without limits on roll and pitch, which are about the vertical.
    monkeypatch.setattr("uvms_drake.model.uvms.STANDARD_GRAVITY", 0.0)
    wall = uv.load_scenario("girona500_ideal", ["mpc.horizon=5", "limits.roll=1.5",
                                                "limits.pitch=1.5"])
    eta = np.array([-1.065, -0.05, -0.06, 0.03, 0.04, 0.05])
    wall = replace(wall, start=replace(wall.start, eta=eta))
    force = np.concatenate([TURN @ wall.task.force[:3], np.zeros(3)])
    slope = replace(
        wall, surface=wall.surface.moved(TURN.matrix(), np.zeros(3)),
        start=replace(wall.start, eta=turned_pose(eta)),
        task=replace(wall.task, force=force, frame=RollPitchYaw(TURN).vector()))
    state, pushed, tau = closed_loop(wall, 0.4)
    other, other_pushed, other_tau = closed_loop(slope, 0.4)
    assert np.linalg.norm(pushed) > 5.0
    np.testing.assert_allclose(other[:6], turned_pose(state[:6]), atol=1e-6)
    np.testing.assert_allclose(other[6:], state[6:], atol=1e-6)
    np.testing.assert_allclose(other_pushed[:3], TURN @ pushed[:3], atol=1e-4)
    np.testing.assert_allclose(other_tau, tau, rtol=1e-4, atol=1e-4)


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize(("name", "force"), [
    ("girona500_floor", 20.0), ("girona500_slope", 20.0), ("bluerov2_ceiling", 5.0)])
def test_the_force_settles_on_floor_slope_and_ceiling_under_a_certificate(
        name, force, monkeypatch):
    search_less(monkeypatch)
    scenario = uv.load_scenario(name, [*FEW, "duration=12"])
    certificate = uv.certify(scenario)
    assert certificate.certified
    summary = uv.summarise(uv.simulate(certificate.applied_to(scenario), certified=True))
    assert summary["tube"]["exits"] == summary["contact"]["losses"] == 0
    assert summary["force"]["last_5_s"]["mean_error_norm"] < 0.05 * force
