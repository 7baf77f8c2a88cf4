"""Sheet and stills of a robot: closed forms, the model let go, and where things are drawn."""

from dataclasses import replace

import numpy as np
import pytest
from support.robot_files import FILES
from support.robots import without_an_arm
from support.synthetic import synthetic_record

from uvms_drake.command.robot import write_robot
from uvms_drake.model.description.thruster_file import (
    CurveData,
    ThrusterData,
    ThrusterKind,
    ThrusterParameters,
)
from uvms_drake.model.frames.euler import rotation_matrix
from uvms_drake.model.propulsion.allocation import largest_wrench
from uvms_drake.model.propulsion.thrusters import ThrusterModel
from uvms_drake.model.surface.plane import UnilateralPlane
from uvms_drake.model.trim import middle_posture
from uvms_drake.model.uvms_model import UvmsModel, configuration_rate, read_uvms
from uvms_drake.report.robot.render import RobotScene, picture_axes
from uvms_drake.report.robot.robot_figure import SIZE, SQUARES, draw_robot, wall_triangles
from uvms_drake.report.robot.robot_sheet import (
    Thrust,
    notes_of,
    sheet_of,
    swing,
    thrust_of,
)
from uvms_drake.station.problem import true_surface
from uvms_drake.station.scenario.scenario import load_scenario


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


def covered(scene: RobotScene, middle: np.ndarray, eye: list[float]) -> np.ndarray:
    """Where a picture of 2 m × 2 m about a point in Σ_I, 100 pixels each way, is not white."""
    R = picture_axes(np.array(eye))
    center = R[:2] @ middle
    return np.any(scene.picture(R, center - 1.0, center + 1.0, 100) < 0.99, axis=-1)


def test_a_square_is_where_and_as_large_as_it_is_whatever_its_distance():
    """0.6 m × 0.3 m, 3 m above the robot and 4 m ahead, from above."""
    middle = np.array([4.0, 0.5, -3.0])
    corners = middle + np.array([[x, y, 0.0] for x in (-0.3, 0.3) for y in (-0.15, 0.15)])
    square = corners[[[0, 1, 3], [0, 3, 2]]]
    scene = RobotScene("box_uvms", np.zeros(8), [(square, np.array([0.8, 0.1, 0.1]))])
    rows, columns = np.nonzero(covered(scene, middle, [0.0, 1e-6, -1.0]))
    assert (np.min(columns), np.max(columns), np.min(rows), np.max(rows)) == pytest.approx(
        (35, 64, 42, 57), abs=1)
    assert not np.any(covered(scene, middle + [0.0, 0.0, -2.0], [0.0, 1.0, 0.0]))


def test_the_robot_is_drawn_where_its_tip_is(model):
    record = synthetic_record(1.0)
    config = record.config[-1]
    scene, tip = RobotScene(record.scenario.model, config), model.task_pose(config)[:3]
    seen = covered(scene, tip, [0.0, 1.0, 0.0])
    assert np.any(seen[46:54, 46:54])
    assert not np.any(seen[:, 54:]), "nothing is ahead of it"
    assert np.min(np.linalg.norm(scene.corners - tip, axis=1)) < 0.05


def test_a_mesh_without_normals_is_drawn(tmp_path, capsys):
    """As one that was converted from STL: its hull, in the middle of the vehicle."""
    write_robot(FILES / "heavy_rov.urdf", tmp_path / "heavy")
    assert "converted from STL" in capsys.readouterr().out
    scene = RobotScene(str(tmp_path / "heavy"), np.zeros(12))
    assert np.all(covered(scene, np.zeros(3), [1.0, 0.0, 0.0])[45:55, 45:55])


def test_a_wall_is_a_square_metre_about_its_middle():
    middle, normal = np.array([1.0, 2.0, 3.0]), np.array([0.6, 0.0, -0.8])
    plane = UnilateralPlane(point=middle - 0.3 * np.array([0.8, 0.0, 0.6]), normal=normal,
                            stiffness=1e3, dissipation=0.0)
    light, dark = (t for t, _ in wall_triangles(
        plane.patch(middle + 0.2 * normal, SIZE, SQUARES + 1)))
    corners = np.concatenate([light, dark])
    area = 0.5 * np.sum(np.linalg.norm(np.cross(
        corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1))
    assert area == pytest.approx(1.0)
    assert len(light) == len(dark)
    np.testing.assert_allclose((corners - middle) @ normal, 0.0, atol=1e-12)
    np.testing.assert_allclose(corners.mean(axis=(0, 1)), middle, atol=1e-12)


def test_the_wall_that_is_drawn_is_the_real_one_whatever_the_controller_is_told():
    """The leg of a jacket, told as a direction only; its squares are on it, next to the tip."""
    wall = true_surface(load_scenario("jacket_inspection"))
    tip = np.array([-0.1, 0.05, 0.2])
    corners = np.concatenate([t for t, _ in wall_triangles(
        wall.patch(tip, SIZE, SQUARES + 1))]).reshape(-1, 3)
    np.testing.assert_allclose(wall.geometry.depth(corners), 0.0, atol=1e-6)
    assert np.min(np.linalg.norm(corners - tip, axis=1)) < 0.2
    assert np.ptp(corners, axis=0)[2] == pytest.approx(1.0, rel=0.05)


@pytest.mark.parametrize("name", ["girona500_ideal", "girona500_bilateral"])
def test_the_force_is_written_where_there_is_one(name):
    record = replace(synthetic_record(4.0), scenario=load_scenario(name))
    texts = [text.get_text() for text in draw_robot(record).axes[0].texts]
    assert "18.9 N" in texts
    assert {"$x$", "$y$", "$z$", "0.25 m"} <= set(texts)


def test_a_picture_that_turns_with_a_wall_has_its_light():
    """To the east as to the north: the wall was nearly black there."""
    north, ahead = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, -0.5, 0.9]), np.array([1.0, 0.0, 0.0])
    wall = np.array([[[0.0, -0.4, -0.4], [0.0, 0.4, -0.4], [0.0, 0.4, 0.4]],
                     [[0.0, -0.4, -0.4], [0.0, 0.4, 0.4], [0.0, -0.4, 0.4]]]) + ahead
    wall = np.concatenate([wall, wall[:, ::-1]])
    pictures = []
    for heading in (0.0, 0.5 * np.pi):
        turn = rotation_matrix(np.array([0.0, 0.0, heading]))
        config = north + heading * np.eye(8)[5]
        scene = RobotScene("box_uvms", config, [(wall @ turn.T, np.full(3, 0.8))], heading)
        R = picture_axes(turn @ np.array([-0.5, -0.8, -0.4]))
        pictures.append(scene.picture(R, np.full(2, -1.5), np.full(2, 1.5), 150))
    assert np.mean(np.any(pictures[0] < 0.99, axis=-1)) > 0.05
    assert np.mean(np.abs(pictures[1] - pictures[0])) < 0.003
