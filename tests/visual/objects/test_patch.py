"""Drawing of a surface that is not flat."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.geometry import Meshcat, MeshcatParams, Sphere
from support.shapes import SHAPES, turned
from support.synthetic import synthetic_record

from uvms_drake.model.surface.geometry import Cylinder, Plane
from uvms_drake.model.surface.shaped_surface import ShapedSurface
from uvms_drake.report.replay import moment_of
from uvms_drake.station.scene_setting import setting_of
from uvms_drake.visual.objects import patch
from uvms_drake.visual.objects.wall import DrawnWall, grid
from uvms_drake.visual.scene import Scene
from uvms_drake.visual.stage import Stage


@pytest.fixture
def meshcat():
    return Meshcat(MeshcatParams(host="localhost"))


@pytest.mark.parametrize("shape", [*map(turned, SHAPES.values()), Cylinder(radius=0.05)],
                         ids=[*SHAPES, "thin pole"])
def test_the_mesh_is_on_the_surface_and_its_grid_has_lines_every_ten_centimetres(
        shape, meshcat, monkeypatch):
    given = {}

    def mesh(vertices, uv, faces, image, *, normals):
        given.update(vertices=vertices, uv=uv, faces=faces, image=image, normals=normals)
        return Sphere(1.0)

    monkeypatch.setattr(patch, "textured_mesh", mesh)
    patch.draw_patch(Stage(meshcat), "ned/wall", shape.patch(shape.point, DrawnWall.SIZE, 65))
    assert meshcat.HasPath("ned/wall")
    np.testing.assert_array_equal(given["image"], grid())
    np.testing.assert_allclose(shape.depth(given["vertices"]), 0.0, atol=1e-14)
    _, into = shape.depth_and_gradient(given["vertices"])
    into = into / np.linalg.norm(into, axis=1)[:, None]
    assert np.min(np.sum(into * given["normals"], axis=1)) > 0.99
    corners, uv = given["vertices"][given["faces"]], given["uv"][given["faces"]]
    sides = corners[:, 1:] - corners[:, :1]
    across = np.cross(sides[:, 0], sides[:, 1])
    assert np.min(np.sum(across * into[given["faces"][:, 0]], axis=1)) > 0.0
    lengths = np.linalg.norm(sides, axis=-1)
    np.testing.assert_allclose(np.linalg.norm(uv[:, 1:] - uv[:, :1], axis=-1), lengths, rtol=0.06)


@pytest.mark.parametrize(("geometry", "dented"), [
    (Plane(), True), (Cylinder(radius=0.3), False)], ids=["plane", "hull"])
def test_a_scene_has_the_surface_and_no_spring(geometry, dented, meshcat):
    record = synthetic_record(0.2)
    limits = replace(record.scenario.limits, static_force=None)
    scenario = replace(record.scenario, surface=ShapedSurface(geometry), limits=limits)
    record = replace(record, scenario=scenario)
    Scene(meshcat, setting_of(scenario, record.model)).show(moment_of(record, 0), 0.0)
    assert meshcat.HasPath("ned/wall")
    assert meshcat.HasPath("ned/wall/depth") == dented
    assert not meshcat.HasPath("ned/spring")
