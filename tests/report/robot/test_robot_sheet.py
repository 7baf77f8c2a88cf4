"""`report.robot.robot_sheet`: against closed forms, and against the model let go."""

from dataclasses import replace

import numpy as np
import pytest
from support.robots import without_an_arm

from uvms_drake.model.description.thruster_file import (
    CurveData,
    ThrusterData,
    ThrusterKind,
    ThrusterParameters,
)
from uvms_drake.model.propulsion.thrusters import ThrusterModel
from uvms_drake.model.trim import middle_posture
from uvms_drake.model.uvms_model import UvmsModel, configuration_rate, read_uvms
from uvms_drake.report.robot.robot_sheet import (
    Thrust,
    largest_wrench,
    notes_of,
    sheet_of,
    swing,
    thrust_of,
)


@pytest.fixture(scope="module")
def sheets():
    robots = {name: read_uvms(name) for name in (
        "box_uvms", "bluerov2_alpha5", "girona500_arm5e")}
    return {name: sheet_of(uvms, name, middle_posture(uvms)) for name, uvms in robots.items()}


def test_a_pendulum_swings_with_the_period_that_it_is_said_to(tmp_path):
    """Let go at a small roll, without drag; the vehicle is free in sway meanwhile."""
    robot = without_an_arm(tmp_path, (".yaml", "linear: [20.0, 30.0, 30.0, 5.0, 5.0, 5.0]",
                                      "linear: [0, 0, 0, 0, 0, 0]"))
    uvms = read_uvms(str(robot))
    model = UvmsModel(uvms)
    config, zeta, step = 1e-3 * np.eye(6)[3], np.zeros(6), 0.005
    found = swing(model, np.zeros(6), 3)
    assert found.damping == 0.0
    roll = []
    for _ in range(int(found.period / step)):  # The midpoint rule.
        middle = zeta + 0.5 * step * model.drift(config, zeta)
        half = config + 0.5 * step * configuration_rate(config, zeta)
        zeta = zeta + step * model.drift(half, middle)
        config = config + step * configuration_rate(half, middle)
        roll.append(config[3])
    assert np.argmin(roll) * step == pytest.approx(0.5 * found.period, rel=0.02)
    assert min(roll) == pytest.approx(-1e-3, rel=0.01)


def test_stiffness_and_damping_are_those_of_weight_buoyancy_and_linear_drag(sheets):
    """About the level: ρV g times the lever, and the moments of what does not cancel."""
    sheet = sheets["box_uvms"]
    trim = sheet.trim
    moment = trim.mass * trim.center_of_mass[2] - trim.displaced_mass * trim.center_of_buoyancy[2]
    assert sheet.roll.stiffness == pytest.approx(9.81 * moment, rel=1e-9)
    model = UvmsModel(read_uvms("box_uvms"))
    M = model.mass_matrix(model.kinematics(np.concatenate([np.zeros(6), sheet.posture])))[:6, :6]
    free = np.linalg.inv(M)[3, 3]
    rate = 2.0 * np.pi / sheet.roll.period
    assert rate**2 == pytest.approx(sheet.roll.stiffness * free)
    assert sheet.roll.damping == pytest.approx(0.5 * 5.0 * free / rate)


def test_the_vehicle_hangs_where_no_moment_turns_it(sheets):
    """The template is balanced half bent; the others nod under their arms."""
    assert np.degrees(sheets["box_uvms"].hangs[1]) == pytest.approx(0.0, abs=0.6)
    for name in ("bluerov2_alpha5", "girona500_arm5e"):
        sheet = sheets[name]
        model = UvmsModel(read_uvms(name))
        level, hung = (np.concatenate([np.zeros(3), angles, [0.0], sheet.posture])
                       for angles in (np.zeros(2), sheet.hangs))
        moments = [np.linalg.norm(model.inverse_dynamics(
            model.kinematics(config), np.zeros(10), np.zeros(10))[3:5]) for config in (level, hung)]
        assert moments[1] < 0.02 * moments[0]


def test_the_largest_wrench_leaves_the_other_axes_alone():
    """Two thrusters beside each other: together ahead, against each other in yaw."""
    kind = ThrusterKind(lag=0.1, curves=[CurveData(command=np.array([-1.0, 1.0]),
                                                   force=np.array([-8.0, 10.0]))])
    thrusters = ThrusterModel.of(ThrusterParameters(
        undriven=["sway", "heave", "roll", "pitch"], kinds={"t": kind}, thrusters={
            name: ThrusterData("t", np.array([0.0, y, 0.0]), np.array([1.0, 0.0, 0.0]))
            for name, y in (("port", -0.5), ("starboard", 0.5))}))
    assert largest_wrench(thrusters, 0, 1.0) == pytest.approx(20.0)
    assert largest_wrench(thrusters, 0, -1.0) == pytest.approx(16.0)
    assert largest_wrench(thrusters, 5, 1.0) == pytest.approx(8.0)  # 8 N ahead, 8 N back
    assert largest_wrench(thrusters, 1, 1.0) == 0.0
    thrust = thrust_of(thrusters, np.array([4.0, 0.0, 0.0, 0.0, 0.0, 3.0]))
    assert (thrust.hover_thruster, thrust.hover) == ("port", pytest.approx(0.5))
    weak = thrust_of(thrusters, np.array([-24.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
    assert weak.hover == pytest.approx(1.5)


def test_an_arm_that_can_be_straight_is_said_to_be_singular_there(sheets):
    least, median, here = sheets["bluerov2_alpha5"].dexterity
    assert least < 1e-3 < here
    assert least < median < 1.0
    assert len(sheets["bluerov2_alpha5"].rows) == 4


def test_the_reach_is_the_length_of_the_arm(sheets):
    """Shoulder at (0.42, 0.12) m, stretched 0.6 m at the smallest angle of the elbow, 0.1 rad."""
    low, high = sheets["box_uvms"].reach
    longest = np.hypot(0.3 + 0.3 * np.cos(0.1), 0.3 * np.sin(0.1))
    assert 0.99 * longest < high[0] - 0.42 <= longest
    np.testing.assert_array_equal([low[1], high[1]], 0.0)


def test_what_is_no_mistake_is_noted(sheets):
    assert notes_of(sheets["box_uvms"]) == []
    (steep,) = notes_of(sheets["bluerov2_alpha5"])
    assert steep.startswith("the tip's x points almost straight up or down in this posture")
    dry = replace(sheets["box_uvms"], bodies=[("hook", 1.0, 0.0, np.zeros(3))],
                  joints=[("elbow", -np.inf, np.inf, 0.0, 0.0)],
                  thrust=Thrust(("bow",), np.zeros((6, 2)), (), 1.2, "bow"))
    assert [note.split(":")[0] for note in notes_of(dry)] == [
        "joint elbow has no limits", "joint elbow has no inertia of a motor",
        "thruster bow is too weak to hold the robot level",
        "dry, as hydrodynamics.yaml does not name it"]
