"""The stills of a robot: where things are in the picture, and the wall beside it."""

from dataclasses import replace

import numpy as np
import pytest
from support.robot_files import FILES
from support.synthetic import synthetic_record

from uvms_drake.command.robot import write_robot
from uvms_drake.model.surface.plane import UnilateralPlane
from uvms_drake.report.robot.render import RobotScene, picture_axes
from uvms_drake.report.robot.robot_figure import SIZE, SQUARES, draw_robot, wall_triangles
from uvms_drake.station.problem import true_surface
from uvms_drake.station.scenario.scenario import load_scenario


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
