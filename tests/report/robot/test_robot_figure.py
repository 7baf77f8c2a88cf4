"""Tests of `uvms_drake.report.robot.robot_figure` and `solids`."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.common import MemoryFile
from pydrake.geometry import (
    Box,
    Capsule,
    Convex,
    Cylinder,
    Ellipsoid,
    GeometryInstance,
    IllustrationProperties,
    InMemoryMesh,
    SceneGraph,
    Sphere,
)
from pydrake.math import RigidTransform
from support.synthetic import synthetic_record

from uvms_drake.model.surface.plane import UnilateralPlane
from uvms_drake.report.robot.robot_figure import (
    EYE,
    draw_robot,
    normals_of,
    rasterised,
    shaded,
    wall_points,
    wall_triangles,
)
from uvms_drake.report.robot.solids import robot_triangles, triangles_of
from uvms_drake.station.problem import true_surface
from uvms_drake.station.scenario.scenario import load_scenario

TETRAHEDRON = "v 0 0 0\nv 3 0 0\nv 0 2 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def triangles(shape):
    scene_graph = SceneGraph()
    instance = GeometryInstance(RigidTransform(), shape, "shape")
    instance.set_illustration_properties(IllustrationProperties())
    geometry = scene_graph.RegisterAnchoredGeometry(
        scene_graph.RegisterSource("test"), instance)
    return triangles_of(scene_graph.model_inspector(), geometry)


@pytest.mark.parametrize(("shape", "volume"), [
    (Box(1.0, 2.0, 3.0), 6.0), (Cylinder(0.5, 2.0), 0.5 * np.pi), (Sphere(2.0), 32.0 / 3.0 * np.pi),
    (Ellipsoid(1.0, 2.0, 3.0), 8.0 * np.pi), (Capsule(1.0, 2.0), 10.0 / 3.0 * np.pi),
    (Convex(InMemoryMesh(mesh_file=MemoryFile(TETRAHEDRON, ".obj", "t")), 1.0), 1.0)])
def test_the_triangles_of_a_shape_enclose_its_volume(shape, volume):
    """By the theorem of Gauss, which also tells that their normals point outwards."""
    a, b, c = triangles(shape).transpose(1, 0, 2)
    found = np.sum(a * np.cross(b, c)) / 6.0
    assert found == pytest.approx(volume, rel=1e-9 if isinstance(shape, Box | Convex) else 0.02)


def test_the_robot_is_drawn_where_its_tip_is(model):
    record = synthetic_record(1.0)
    config = record.config[-1]
    corners = np.concatenate([t.reshape(-1, 3) for t, _ in robot_triangles(
        record.scenario.model, config)])
    tip = model.task_pose(config)[:3]
    assert np.min(np.linalg.norm(corners - tip, axis=1)) < 0.05
    assert np.max(corners[:, 0]) == pytest.approx(tip[0], abs=0.03), "nothing is ahead of it"


def test_the_nearer_of_two_triangles_hides_the_other():
    square = np.array([[[0.0, 0.0, 0.0], [40.0, 0.0, 0.0], [0.0, 40.0, 0.0]],
                       [[40.0, 40.0, 0.0], [40.0, 0.0, 0.0], [0.0, 40.0, 0.0]]])
    red, blue = (np.tile(color, (2, 1)) for color in ([1.0, 0.0, 0.0], [0.0, 0.0, 1.0]))
    small = 0.5 * square
    for order in (1, -1):
        solids = [(square, red), (small + [0.0, 0.0, 1.0], blue)][::order]
        picture = rasterised(solids, np.array([60.0, 50.0]))
        assert picture.shape == (25, 30, 4)
        np.testing.assert_array_equal(picture[4, 4], [0.0, 0.0, 1.0, 1.0])
        np.testing.assert_array_equal(picture[15, 15], [1.0, 0.0, 0.0, 1.0])
        assert picture[4, 25, 3] == 0.0


def test_a_wall_is_a_square_metre_about_its_middle_and_faces_are_lit_from_above():
    middle, normal = np.array([1.0, 2.0, 3.0]), np.array([0.6, 0.0, -0.8])
    plane = UnilateralPlane(point=middle - 0.3 * np.array([0.8, 0.0, 0.6]), normal=normal,
                            stiffness=1e3, dissipation=0.0)
    light, dark = (t for t, _ in wall_triangles(wall_points(plane, middle + 0.2 * normal)))
    corners = np.concatenate([light, dark])
    area = 0.5 * np.sum(np.linalg.norm(np.cross(
        corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1))
    assert area == pytest.approx(1.0)
    assert len(light) == len(dark)
    np.testing.assert_allclose((corners - middle) @ normal, 0.0, atol=1e-12)
    np.testing.assert_allclose(corners.mean(axis=(0, 1)), middle, atol=1e-12)
    level = np.array([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]])
    upright = level[..., [0, 2, 1]]
    assert shaded(level, np.ones(3))[0, 0] > shaded(upright, np.ones(3))[0, 0]
    assert abs(normals_of(level)[0] @ EYE) == pytest.approx(abs(EYE[2]))


def test_the_wall_that_is_drawn_is_the_real_one_whatever_the_controller_is_told():
    """The leg of a jacket, told as a direction only; its squares are on it, next to the tip."""
    wall = true_surface(load_scenario("jacket_inspection"))
    tip = np.array([-0.1, 0.05, 0.2])
    corners = np.concatenate([t for t, _ in wall_triangles(wall_points(wall, tip))]).reshape(-1, 3)
    np.testing.assert_allclose(wall.geometry.depth(corners), 0.0, atol=1e-6)
    assert np.min(np.linalg.norm(corners - tip, axis=1)) < 0.2
    assert np.ptp(corners, axis=0)[2] == pytest.approx(1.0, rel=0.05)


@pytest.mark.parametrize("name", ["girona500_ideal", "girona500_bilateral"])
def test_the_force_is_written_where_there_is_one(name):
    record = replace(synthetic_record(4.0), scenario=load_scenario(name))
    texts = [text.get_text() for text in draw_robot(record).axes[0].texts]
    assert "18.9 N" in texts
    assert {"$x$", "$y$", "$z$", "0.25 m"} <= set(texts)
