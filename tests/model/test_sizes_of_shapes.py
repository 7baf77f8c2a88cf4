"""Sizes of meshes and shapes: nodes of COLLADA, shadows against closed forms, and other units."""

import base64
import json
import shutil
import struct
from pathlib import Path

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from support.pages import ROOT

import uvms_drake as uv
from uvms_drake.command.main import main
from uvms_drake.model.description.meshes import bounding_box, format_obj, mesh_triangles
from uvms_drake.model.robot_import.importer import import_robot
from uvms_drake.model.robot_import.shapes import triangles_of, volume_of
from uvms_drake.model.robot_import.sizes import shadow
from uvms_drake.model.robot_import.tree import Shape

CASES = ROOT / "tests" / "field_cases"
FACES = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4],
                  [1, 5, 7, 3]])
UNIT = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
"""Corners of a cube from the origin; of its faces above."""


def row(values: np.ndarray) -> str:
    return " ".join(f"{value:.12g}" for value in np.ravel(values))


def geometry(name: str, points: np.ndarray, kind: str = "triangles") -> str:
    """Returns a cube in COLLADA, with normals between the corners' numbers."""
    inputs = (f'<input semantic="VERTEX" source="#{name}-v" offset="1"/>'
              f'<input semantic="NORMAL" source="#{name}-n" offset="0"/>')
    loops = [loop for a, b, c, d in FACES for loop in ([a, b, c], [a, c, d])] if (
        kind == "triangles") else FACES.tolist()
    texts = [" ".join(f"0 {i}" for i in loop) for loop in loops]
    body = {"triangles": f"<p>{' '.join(texts)}</p>",
            "polylist": f"<vcount>{'4 ' * 6}</vcount><p>{' '.join(texts)}</p>",
            "polygons": "".join(f"<p>{text}</p>" for text in texts)}[kind]
    return f"""<geometry id="{name}"><mesh>
      <source id="{name}-n"><float_array id="{name}-na" count="3">0 0 1</float_array></source>
      <source id="{name}-p"><float_array id="{name}-pa" count="24">{row(points)}</float_array>
      <technique_common><accessor source="#{name}-pa" count="8" stride="3"/></technique_common>
      </source>
      <vertices id="{name}-v"><input semantic="POSITION" source="#{name}-p"/></vertices>
      <{kind} count="{len(loops)}">{inputs}{body}</{kind}></mesh></geometry>"""


def dae(scene: str, geometries: str, unit: str = '<unit meter="1"/>', axis: str = "Z_UP",
        nodes: str = "") -> str:
    return f"""<?xml version="1.0"?>
      <COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
      <asset>{unit}<up_axis>{axis}</up_axis></asset>
      <library_nodes>{nodes}</library_nodes>
      <library_geometries>{geometries}</library_geometries>
      <library_visual_scenes><visual_scene id="other"><node>
      <scale>99 99 99</scale><instance_geometry url="#a"/></node></visual_scene>
      <visual_scene id="s">{scene}</visual_scene></library_visual_scenes>
      <scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


def check_box(text: str, corners: np.ndarray, folder: Path, volume: float | None = None) -> None:
    """Compares the box of a file with that around corners (k, 3), and the mesh's volume."""
    file = folder / "part.dae"
    file.write_text(text, encoding="utf-8")
    expected = [corners.min(axis=0), corners.max(axis=0)]
    np.testing.assert_allclose(bounding_box(file), expected, atol=1e-9)
    if volume is not None:
        found = volume_of(Shape("mesh", np.ones(3), RigidTransform(), file=file))
        assert found == pytest.approx(volume, rel=1e-9)


def test_the_matrices_of_nodes_are_applied_and_what_is_written_is_accepted(tmp_path, capsys):
    """The case as it was reported: 24 m and 2 km without them."""
    shutil.copytree(CASES / "collada_nodes", tmp_path / "files")
    assert main(["robot", "--from", str(tmp_path / "files" / "rov.urdf"),
                 str(tmp_path / "rov")]) == 0
    assert "the end of 'hand', 0.24 m from its origin" in capsys.readouterr().out
    assert main(["robot", str(tmp_path / "rov")]) == 0
    assert capsys.readouterr().err == ""
    text = (tmp_path / "rov" / "rov.sdf").read_text("utf-8")
    assert all(f"<box><size>{size}</size></box>" in text
               for size in ("0.08 0.08 0.04", "0.24 0.06 0.06"))
    model = uv.UvmsModel(uv.Robot.load(tmp_path / "rov").uvms)
    np.testing.assert_allclose(model.task_pose(np.zeros(8))[:3], [0.4 + 0.4 + 0.24, 0.0, 0.1],
                               atol=1e-9)


@pytest.mark.parametrize("kind", ["triangles", "polylist", "polygons"])
@pytest.mark.parametrize(("meter", "unit"), [
    (0.01, '<unit name="centimeter" meter="0.01"/>'), (0.0254, '<unit meter="0.0254"/>'),
    (1.0, "")])
def test_nested_nodes_are_applied_from_the_outside_in(kind, meter, unit, tmp_path):
    """Translate · rotate · (matrix · scale) p, in the file's unit, as the standard has it."""
    matrix = np.array([[0.0, -1.0, 0.0, 5.0], [1.0, 0.0, 0.0, 6.0], [0.0, 0.0, 1.0, 7.0],
                       [0.0, 0.0, 0.0, 1.0]])
    scene = f"""<node><translate>1 2 3</translate><rotate>0 0 2 90</rotate>
      <rotate>1 0 0 30</rotate><node><matrix>{row(matrix)}</matrix><scale>2 3 4</scale>
      <instance_geometry url="#a"/></node></node>"""
    inner = (UNIT * [2.0, 3.0, 4.0]) @ matrix[:3, :3].T + matrix[:3, 3]
    c, s = np.cos(np.pi / 6.0), 0.5
    turned = inner @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]]).T
    turned = turned @ np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]]).T
    check_box(dae(scene, geometry("a", UNIT, kind), unit), meter * (turned + [1.0, 2.0, 3.0]),
              tmp_path, 24.0 * meter**3)


@pytest.mark.parametrize(("axis", "to_z_up"), [
    ("Y_UP", lambda p: np.stack([p[:, 0], -p[:, 2], p[:, 1]], axis=1)),
    ("X_UP", lambda p: np.stack([-p[:, 1], -p[:, 2], p[:, 0]], axis=1))])
def test_the_axis_that_is_up_becomes_z(axis, to_z_up, tmp_path):
    corners = UNIT * [1.0, 2.0, 3.0]
    scene = '<node><instance_geometry url="#a"/></node>'
    check_box(dae(scene, geometry("a", corners), axis=axis), to_z_up(corners), tmp_path, 6.0)


def test_a_node_of_the_library_is_placed_as_often_as_it_is_named(tmp_path):
    nodes = ('<node id="pod"><translate>0 0 1</translate><instance_geometry url="#a"/>'
             '<instance_geometry url="#b"/></node>')
    scene = ('<node><translate>0 5 0</translate><instance_node url="#pod"/></node>'
             '<node><translate>0 -5 0</translate><scale>1 1 2</scale><instance_node url="#pod"/>'
             "</node>")
    geometries = geometry("a", UNIT) + geometry("b", UNIT + [2.0, 0.0, 0.0])
    both = np.concatenate([UNIT, UNIT + [2.0, 0.0, 0.0]]) + [0.0, 0.0, 1.0]
    corners = np.concatenate([both + [0.0, 5.0, 0.0], both * [1.0, 1.0, 2.0] - [0.0, 5.0, 0.0]])
    check_box(dae(scene, geometries, nodes=nodes), corners, tmp_path, 2.0 + 4.0)


@pytest.mark.parametrize("scene", [
    '<node><lookat>1 2 3 0 0 0 0 0 1</lookat><instance_geometry url="#a"/></node>',
    '<node><instance_geometry url="#missing"/></node>', "<node/>",
    '<node id="loop"><instance_node url="#loop"/></node>',
    '<node><scale>0 x 0</scale><instance_geometry url="#a"/></node>'])
def test_a_scene_that_is_not_understood_has_no_size(scene, tmp_path):
    file = tmp_path / "part.dae"
    file.write_text(dae(scene, geometry("a", UNIT)), encoding="utf-8")
    assert bounding_box(file) is None


def shape(kind: str, *size: float, rpy=(0.0, 0.0, 0.0), xyz=(0.0, 0.0, 0.0)) -> Shape:
    return Shape(kind, np.array(size), RigidTransform(RollPitchYaw(rpy), xyz))


def shadows(*shapes: Shape) -> np.ndarray:
    triangles = np.concatenate([triangles_of(each) for each in shapes])
    return np.array([shadow(triangles, axis) for axis in range(3)])


@pytest.mark.parametrize(("solid", "areas"), [
    (shape("box", 2.0, 3.0, 4.0, xyz=(9.0, 8.0, 7.0)), [12.0, 8.0, 6.0]),
    # Turned about z: an edge of 2 by cos and of 3 by sin is what a light along x meets.
    (shape("box", 2.0, 3.0, 4.0, rpy=(0.0, 0.0, 0.4)),
     [4.0 * (2.0 * np.sin(0.4) + 3.0 * np.cos(0.4)), 4.0 * (2.0 * np.cos(0.4) + 3.0 * np.sin(0.4)),
      6.0]),
    (shape("sphere", 0.7), np.full(3, np.pi * 0.49)),
    (shape("ellipsoid", 1.0, 2.0, 3.0), np.pi * np.array([6.0, 3.0, 2.0])),
    (shape("cylinder", 0.1, 1.8, rpy=(0.0, 0.5 * np.pi, 0.0)), [np.pi * 0.01, 0.36, 0.36]),
    (shape("capsule", 0.5, 2.0), [2.0 + np.pi / 4.0, 2.0 + np.pi / 4.0, np.pi / 4.0])])
def test_shadows_of_solids_are_those_of_closed_forms(solid, areas):
    np.testing.assert_allclose(shadows(solid), areas, rtol=0.01)


def test_what_is_covered_twice_counts_once():
    """Hull, wings and mast of the glider, by hand."""
    hull = shape("cylinder", 0.1, 1.8, rpy=(0.0, 0.5 * np.pi, 0.0))
    wings, mast = shape("box", 0.2, 1.2, 0.01), shape("box", 0.02, 0.02, 0.6, xyz=(-0.7, 0.0, 0.3))
    found = shadows(hull, wings, mast, hull)
    outside = 0.5 - np.mean(np.sqrt(0.01 - np.linspace(-0.01, 0.01, 201) ** 2)) + 0.1
    np.testing.assert_allclose(found, [
        np.pi * 0.01 + 2.0 * 0.5 * 0.01 + 0.02 * outside, 0.36 + 0.02 * 0.5,
        0.36 + 0.2 * 1.0], rtol=0.01)


def test_shadows_of_any_triangles_are_those_of_rays():
    """Random triangles, and the share of rays of a grid that meets one by its edges' signs."""
    rng = np.random.default_rng(5)
    triangles = rng.uniform(-1.0, 1.0, (12, 3, 3)) * 0.5 + rng.uniform(-0.6, 0.6, (12, 1, 3))
    for axis in range(3):
        a, b, c = np.delete(triangles, axis, axis=2).transpose(1, 0, 2)
        grid = np.stack(np.meshgrid(*2 * [np.linspace(-1.2, 1.2, 500)]), axis=-1).reshape(-1, 1, 2)
        signs = [np.sign((q - p)[:, 0] * (grid - p)[..., 1] - (q - p)[:, 1] * (grid - p)[..., 0])
                 for p, q in ((a, b), (b, c), (c, a))]
        met = (np.abs(sum(signs)) == 3).any(axis=1)
        assert shadow(triangles, axis) == pytest.approx(met.mean() * 2.4**2, rel=0.01)


def write_stl(file: Path, triangles: np.ndarray) -> None:
    data = b"".join(struct.pack("<12fH", 0, 0, 0, *triangle.ravel(), 0) for triangle in triangles)
    file.write_bytes(bytes(80) + struct.pack("<I", len(triangles)) + data)


def write_gltf(file: Path, points: np.ndarray, triangles: np.ndarray) -> None:
    """A mesh in a node that is 3 m along x, in y up as glTF has it."""
    parts = [points.astype("<f4").tobytes(), triangles.astype("<u2").tobytes()]
    views = [{"buffer": 0, "byteOffset": 0, "byteLength": len(parts[0])},
             {"buffer": 0, "byteOffset": len(parts[0]), "byteLength": len(parts[1])}]
    file.write_text(json.dumps({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "translation": [3.0, 0.0, 0.0]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"byteLength": sum(map(len, parts)), "uri": "data:application/octet-stream;"
                     f"base64,{base64.b64encode(b''.join(parts)).decode()}"}],
        "bufferViews": views, "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": len(points), "type": "VEC3",
             "min": points.min(axis=0).tolist(), "max": points.max(axis=0).tolist()},
            {"bufferView": 1, "componentType": 5123, "count": triangles.size, "type": "SCALAR"}],
    }), encoding="utf-8")


def test_all_formats_have_the_same_mesh(tmp_path):
    corners = UNIT * [1.0, 2.0, 3.0]
    triangles = corners[np.concatenate([FACES[:, :3], FACES[:, [0, 2, 3]]])]
    write_stl(tmp_path / "part.stl", triangles)
    (tmp_path / "part.obj").write_text("".join(f"v {row(p)}\n" for p in corners) + "".join(
        f"f {' '.join(str(i - 8) for i in face)}\n" for face in FACES), encoding="utf-8")
    (tmp_path / "part.dae").write_text(
        dae('<node><instance_geometry url="#a"/></node>', geometry("a", corners)), "utf-8")
    for kind in ("stl", "obj", "dae"):
        file = tmp_path / f"part.{kind}"
        np.testing.assert_allclose(bounding_box(file), [[0, 0, 0], [1, 2, 3]], atol=1e-6)
        found = mesh_triangles(file)
        np.testing.assert_allclose([shadow(found, axis) for axis in range(3)], [6, 3, 2],
                                   rtol=1e-6)
    write_gltf(tmp_path / "part.gltf", corners, np.concatenate(
        [FACES[:, :3], FACES[:, [0, 2, 3]]]))
    low, high = bounding_box(tmp_path / "part.gltf")
    np.testing.assert_allclose(high - low, [1.0, 3.0, 2.0], atol=1e-6)  # z up.
    assert low[0] == pytest.approx(3.0)


GLIDER = (CASES / "wings_and_mast" / "glider.urdf").read_text("utf-8")
HULL = '<visual><origin rpy="0 1.5707963 0"/><geometry><cylinder radius="0.1" length="1.8"/>' \
       "</geometry></visual>"
WINGS = '<visual><geometry><box size="0.2 1.2 0.01"/></geometry></visual>'
MAST = '<visual><origin xyz="-0.7 0 0.3"/><geometry><box size="0.02 0.02 0.6"/></geometry></visual>'


def drag_of(text: str, folder: Path, name: str = "glider.urdf") -> tuple[np.ndarray, list[str]]:
    """Returns the quadratic drag of the vehicle, and the lines on its shapes."""
    assert all(part in GLIDER for part in (HULL, WINGS, MAST))
    (folder / name).write_text(text, encoding="utf-8")
    found = import_robot(folder / name, "glider")
    (line,) = [line for line in found.files["hydrodynamics.yaml"].decode().splitlines()
               if "quadratic" in line]
    return (np.array(line.split("[")[1].rstrip("]").split(","), dtype=float),
            [line for line in found.notes.asked if "shapes of" in line])


def test_wings_and_a_mast_have_the_drag_of_their_shadows(tmp_path):
    """½ ρ C_D A: 31 N s²/m² by the sum of the areas; 474 by the box around all."""
    whole, asked = drag_of(GLIDER, tmp_path)
    bare, _ = drag_of(GLIDER.replace(MAST, ""), tmp_path)
    assert 20.0 < whole[0] < 40.0
    assert 0.7 * whole[0] < bare[0] < whole[0]
    np.testing.assert_allclose(whole[:3], 0.5 * 1025.0 * 1.1 * shadows(
        shape("cylinder", 0.1, 1.8, rpy=(0.0, 0.5 * np.pi, 0.0)), shape("box", 0.2, 1.2, 0.01),
        shape("box", 0.02, 0.02, 0.6, xyz=(-0.7, 0.0, 0.3))), rtol=1e-4)
    assert asked == []


def test_a_box_turns_as_its_faces_do(tmp_path):
    """½ ρ C_D ∫ |r|³ w dr of the face that has the larger moment, as of strips in cross flow."""
    text = GLIDER.replace(HULL, '<visual><geometry><box size="0.9 0.5 0.2"/></geometry></visual>')
    found, _ = drag_of(text.replace(WINGS, "").replace(MAST, ""), tmp_path)
    r = np.linspace(-0.5, 0.5, 20001)
    strip = 0.5 * 1025.0 * 1.1 * np.array([
        0.9 * 0.5**4, 0.5 * 0.9**4, 0.2 * 0.9**4]) * np.mean(np.abs(r) ** 3)
    np.testing.assert_allclose(found[3:], strip, rtol=1e-3)


@pytest.mark.parametrize(("old", "new"), [
    (MAST, MAST.replace("0.02 0.02 0.6", "0.01 0.01 3").replace("-0.7 0 0.3", "0 0 1.6")),
    (WINGS, WINGS.replace("0.2 1.2 0.01", "0.1 4 0.01")),
    (HULL, HULL + '<visual><origin xyz="0.9 0 -0.6"/><geometry><box size="0.2 0.01 1.2"/>'
     "</geometry></visual>")], ids=["an aerial of 3 m", "wings of 4 m", "a keel"])
def test_thin_parts_however_long_give_their_own_area(old, new, tmp_path):
    """Members of the kind: a box around them is 10 to 100 times the displaced volume."""
    drag, asked = drag_of(GLIDER.replace(old, new), tmp_path)
    assert 20.0 < drag[0] < 70.0
    assert len(asked) == 0 or "times the 0.0508 m³" in asked[0]


def test_a_mesh_in_one_piece_has_the_drag_of_its_parts(tmp_path):
    """Wings and hull in one file, as of a published glider: triangles, and not their hull."""
    parts = [shape("cylinder", 0.1, 1.8, rpy=(0.0, 0.5 * np.pi, 0.0)),
             shape("box", 0.2, 1.2, 0.01), shape("box", 0.02, 0.02, 0.6, xyz=(-0.7, 0.0, 0.3))]
    triangles = np.concatenate([triangles_of(part) for part in parts])
    (tmp_path / "glider.obj").write_text(format_obj(triangles), encoding="utf-8")
    mesh = '<visual><geometry><mesh filename="glider.obj"/></geometry></visual>'
    text = GLIDER.replace(HULL, mesh).replace(WINGS, "").replace(MAST, "")
    np.testing.assert_allclose(drag_of(text, tmp_path)[0], drag_of(GLIDER, tmp_path)[0], rtol=1e-3)


@pytest.mark.parametrize("unit", [1e3, 100.0, 1.0 / 39.37])
def test_a_mesh_in_another_unit_is_asked_about_and_not_used(unit, tmp_path):
    """Millimetres, centimetres, and inches taken twice: the drag is of the displaced volume."""
    triangles = unit * triangles_of(shape("box", 0.9, 0.3, 0.2))
    write_stl(tmp_path / "hull.stl", triangles)
    mesh = '<visual><geometry><mesh filename="hull.stl"/></geometry></visual>'
    text = GLIDER.replace(HULL, mesh).replace(WINGS, "").replace(MAST, "")
    drag, (asked,) = drag_of(text, tmp_path)
    edge = (0.0508 / (0.9 * 0.3 * 0.2)) ** (1.0 / 3.0)
    np.testing.assert_allclose(
        drag[:3], 0.5 * 1025.0 * 1.1 * edge**2 * np.array([0.06, 0.18, 0.27]), rtol=1e-4)
    assert "times the 0.0508 m³ of water that it displaces" in asked
    # What is drawn is within 10 m, or is left out with a line, so that it is accepted.
    assert main(["robot", "--from", str(tmp_path / "glider.urdf"), str(tmp_path / "found")]) == 0
    assert main(["robot", str(tmp_path / "found")]) == 0


def test_a_hand_in_millimetres_has_its_tip_near(tmp_path, capsys):
    """240 m by its mesh: its estimate is of the size of its mass, and is asked about."""
    shutil.copytree(CASES / "collada_nodes", tmp_path / "files")
    write_stl(tmp_path / "files" / "hand.stl", 1e3 * triangles_of(
        shape("box", 0.24, 0.06, 0.06, xyz=(0.12, 0.0, 0.0))))
    file = tmp_path / "files" / "rov.urdf"
    file.write_text(file.read_text("utf-8").replace("hand.dae", "hand.stl"), encoding="utf-8")
    assert main(["robot", "--from", str(file), str(tmp_path / "rov")]) == 0
    out = capsys.readouterr().out
    assert "left out, for they reach beyond 10 m, as in millimetres: hand.stl" in out
    assert "the shapes of 'hand' in your file, scale: 240 × 60 × 60 m" in out
    assert main(["robot", str(tmp_path / "rov")]) == 0
    tip = uv.UvmsModel(uv.Robot.load(tmp_path / "rov").uvms).task_pose(np.zeros(8))[0]
    assert 0.2 < tip - 0.8 < 0.3


def test_a_hull_along_another_axis_than_its_added_mass_is_asked_about(tmp_path):
    """As of a published glider, whose meshes have their length along y, and its water along x."""
    turned = HULL.replace("0 1.5707963 0", "1.5707963 0 0")
    for text, asked in ((GLIDER, False), (GLIDER.replace(HULL, turned), True)):
        (tmp_path / "glider.urdf").write_text(text, encoding="utf-8")
        lines = import_robot(tmp_path / "glider.urdf", "glider").notes.asked
        assert any("slender along x, by the shadows of its shapes along y" in line
                   for line in lines) == asked


@pytest.mark.parametrize("axis", ["Y_UP", "Z_UP"])
def test_an_axis_that_others_leave_out_is_told(axis, tmp_path):
    shutil.copytree(CASES / "collada_nodes", tmp_path / "files")
    mesh = tmp_path / "files" / "prop.dae"
    mesh.write_text(mesh.read_text("utf-8").replace("Z_UP", axis), encoding="utf-8")
    changed = import_robot(tmp_path / "files" / "rov.urdf", "rov").notes.changed
    told = [line for line in changed if "RViz and Gazebo do not" in line]
    assert told == [] if axis == "Z_UP" else "COLLADA with Y_UP" in told[0]
