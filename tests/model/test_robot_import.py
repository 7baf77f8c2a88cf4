"""Robots' folders out of files as they are found, against plain NumPy."""

import re
import shutil
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from support.robot_files import FILES, FLIP, NAMES, PlainUrdf, turn

import uvms_drake as uv
from uvms_drake.command.robot import write_robot
from uvms_drake.common.schema import load_typed, parse_yaml
from uvms_drake.model.description.hydrodynamics_file import added_mass_about_origin
from uvms_drake.model.description.meshes import bounding_box, format_obj, mesh_volume
from uvms_drake.model.description.thruster_file import ThrusterParameters, thrust_map
from uvms_drake.model.robot_import.importer import import_robot
from uvms_drake.model.robot_import.plugins import symmetric
from uvms_drake.model.robot_import.tree import Notes

URDFS = {"heavy_rov.urdf": "base_link", "light_rov.urdf": "base_link", "dummy_root.urdf": "hull",
         "rounded.urdf": "rov/base_link", "wide_limits.urdf": "base_link"}
"""Files and their vehicles."""


@pytest.fixture(scope="module")
def robots(tmp_path_factory) -> dict[str, uv.Robot]:
    """All robots of the files, loaded from the folders that were made of them."""
    folder = tmp_path_factory.mktemp("robots")
    for name in NAMES:
        assert write_robot(FILES / name, folder / name.split(".")[0]) == 0
    return {name: uv.Robot.load(folder / name.split(".")[0]) for name in NAMES}


def notes_of(name: str) -> Notes:
    return import_robot(FILES / name, "robot").notes


def joint_values(robot: uv.Robot, posture: np.ndarray) -> dict[str, float]:
    """The posture by the names that the joints have in a URDF; here they end alike."""
    return {joint.name(): float(q) for joint, q in zip(robot.uvms.joints, posture, strict=True)}


def plain(name: str, robot: uv.Robot, posture: np.ndarray) -> PlainUrdf:
    """The URDF at a posture; its other joints are where they are fixed."""
    values = joint_values(robot, posture)
    long = {joint: values[joint.rsplit("/", 1)[-1]] for joint in PlainUrdf(
        FILES / name, {}).joints if joint.rsplit("/", 1)[-1] in values}
    return PlainUrdf(FILES / name, long)


def drakes_inertia(robot: uv.Robot, posture: np.ndarray) -> np.ndarray:
    """The 6×6 inertia of the whole robot about the vehicle's origin, by Drake (Fossen's order)."""
    plant = robot.uvms.plant
    context = plant.CreateDefaultContext()
    q = plant.GetPositions(context)
    q[[joint.position_start() for joint in robot.uvms.joints]] = posture
    plant.SetPositions(context, q)
    frame = robot.uvms.vehicle.body_frame()
    M = plant.CalcSpatialInertia(
        context, frame, plant.GetBodyIndices(robot.uvms.model_instance)).CopyToFullMatrix6()
    order = [3, 4, 5, 0, 1, 2]
    return M[np.ix_(order, order)]


@pytest.mark.parametrize("name", URDFS)
def test_masses_and_inertias_are_those_of_the_file_in_any_posture(name, robots):
    rng = np.random.default_rng(1)
    for posture in rng.uniform(-1.0, 1.0, (3, len(robots[name].uvms.joints))):
        expected = plain(name, robots[name], posture).inertia_about(URDFS[name])
        np.testing.assert_allclose(drakes_inertia(robots[name], posture), expected,
                                   rtol=1e-6, atol=1e-7 * np.max(np.abs(expected)))


@pytest.mark.parametrize(("name", "frame", "R_FE"), [
    ("heavy_rov.urdf", "m7_end_effector", None),  # Its z is along the tool.
    ("light_rov.urdf", "alpha_tcp", FLIP), ("rounded.urdf", "rov/arm/end_effector", FLIP),
    ("wide_limits.urdf", "tool_link", None)])
def test_the_tip_is_the_frame_of_the_file_with_x_along_the_tool(name, frame, R_FE, robots):
    model = uv.UvmsModel(robots[name].uvms)
    posture = np.random.default_rng(2).uniform(-1.0, 1.0, model.num_joints)
    at = model.kinematics(np.concatenate([np.zeros(6), posture]))
    X = plain(name, robots[name], posture).in_frd(URDFS[name], frame)
    R, p = X[:3, :3], X[:3, 3]
    np.testing.assert_allclose(at.chi[:3], p, atol=1e-8)
    if R_FE is None:
        np.testing.assert_allclose(at.R_BL[-1][:, 0], R[:, 2], atol=1e-8)
    else:
        np.testing.assert_allclose(at.R_BL[-1], R @ R_FE, atol=1e-8)


def test_a_thruster_of_uuv_simulator_pushes_along_the_axis_of_its_joint(tmp_path, robots):
    """As its later versions have it; limits of which the least is not the smaller are none."""
    shutil.copytree(FILES, tmp_path / "files")
    file, text = tmp_path / "files" / "rounded.urdf", (FILES / "rounded.urdf").read_text("utf-8")
    head, tail = text.split('<child link="rov/thruster_0"/>')
    file.write_text(head + '<child link="rov/thruster_0"/>' + tail.replace(
        '<axis xyz="1 0 0"/>', '<axis xyz="0 0 -1"/>', 1).replace(
        "<clampMin>", "<thrustMin>0</thrustMin><thrustMax>0</thrustMax><clampMin>"), "utf-8")
    found = import_robot(file, "rounded")
    text = found.files["thrusters.yaml"].decode("utf-8")
    thrusters = load_typed(ThrusterParameters, parse_yaml(text))
    old = robots["rounded.urdf"].uvms.thrusters
    np.testing.assert_allclose(thrusters.thrusters["thruster_0"].axis, [0.0, 0.0, 1.0], atol=1e-9)
    for name in list(old.thrusters)[1:]:
        np.testing.assert_allclose(thrusters.thrusters[name].axis, old.thrusters[name].axis)
    assert [line for line in found.notes.changed if "thruster_0: pushes along" in line]
    (kind,), (before,) = thrusters.kinds.values(), old.kinds.values()
    np.testing.assert_array_equal(kind.curves[0].force, before.curves[0].force)


def test_a_collision_in_the_frame_of_another_is_refused(tmp_path):
    shutil.copytree(FILES, tmp_path / "files")
    file = tmp_path / "files" / "plugins.sdf"
    text = (FILES / "plugins.sdf").read_text("utf-8")
    head, collision, tail = text.partition("<collision")
    file.write_text(head + collision + re.sub(
        "<pose>", '<pose relative_to="foam">', tail, count=1), "utf-8")
    with pytest.raises(uv.InvalidParameter, match=r"collision.* pose relative_to = 'foam'"):
        import_robot(file, "plugins")


@pytest.mark.parametrize("name", ["light_rov.urdf", "rounded.urdf"])
def test_thrusters_push_as_the_frames_of_their_rotors(name, robots):
    tree, columns = PlainUrdf(FILES / name, {}), {}
    for link in tree.links:
        if (short := link.rsplit("/", 1)[-1]).startswith("thruster"):
            X = tree.in_frd(URDFS[name], link)
            columns[short] = np.concatenate([X[:3, 0], np.cross(X[:3, 3], X[:3, 0])])
    found = robots[name].uvms.thrusters
    assert list(found.thrusters) == list(columns)
    np.testing.assert_allclose(thrust_map(list(found.thrusters.values())),
                               np.stack(list(columns.values()), axis=1), atol=1e-9)


def test_limits_of_thrusters_are_those_of_the_plugins(robots):
    gz = robots["plugins.sdf"].uvms.thrusters
    (kind,) = gz.kinds.values()
    assert (list(kind.curves[0].command), list(kind.curves[0].force)) == (
        [-70, 0, 90], [-70, 0, 90])
    uuv = robots["rounded.urdf"].uvms.thrusters
    (kind,) = uuv.kinds.values()
    assert kind.lag == 0.2
    command = np.asarray(kind.curves[0].command, dtype=float)
    assert (command[0], command[-1]) == (-180.0, 180.0)
    np.testing.assert_allclose(kind.curves[0].force, 0.0265 * command * np.abs(command), rtol=1e-9)


def test_water_of_gz_sim_is_turned_to_positive_numbers(robots):
    body = robots["plugins.sdf"].uvms.hydrodynamics.bodies["vehicle"]
    np.testing.assert_allclose(added_mass_about_origin(body.added_mass), np.diag(
        [22.1, 41.7, 60.3, 1.1, 2.4, 2.2]), atol=1e-12)
    (drag,) = body.drag
    np.testing.assert_allclose(drag.linear, [12.4, 18.0, 24.5, 3.1, 3.6, 3.2])
    np.testing.assert_allclose(drag.quadratic, [81.0, 132.0, 171.0, 9.0, 14.0, 12.0])
    # The volume is that of the only collision shape, which is 0.06 m above the origin.
    assert body.displaced_volume == pytest.approx(0.7 * 0.45 * 0.181)
    np.testing.assert_allclose(body.center_of_buoyancy, [0.02, 0.0, -0.06], atol=1e-12)


def test_a_rounded_matrix_is_made_symmetric_and_stays_frd(robots):
    """uuv_simulator applies it in FRD, see `sources`: it was turned once more before."""
    text = (FILES / "rounded.urdf").read_text("utf-8")
    given = np.array(text.split("<added_mass>")[1].split("</added_mass>")[0].split(),
                     dtype=float).reshape(6, 6)
    body = robots["rounded.urdf"].uvms.hydrodynamics.bodies["vehicle"]
    expected = 0.5 * (given + given.T)
    np.testing.assert_allclose(added_mass_about_origin(body.added_mass), expected, atol=1e-6)
    assert np.count_nonzero(given - given.T) == 2
    (line,) = [line for line in notes_of("rounded.urdf").changed if "made symmetric" in line]
    assert "[3][6] is 9.8836, [6][3] is 9.8837" in line
    assert robots["rounded.urdf"].uvms.hydrodynamics.fluid_density == 1028.0
    assert body.displaced_volume == 1.772
    np.testing.assert_allclose(body.center_of_buoyancy, [0.024, -0.006, -0.25], atol=1e-12)


def test_nested_models_are_where_their_poses_have_them(robots):
    """The foot is put on the mount: 0.36 + 0.06 + 0.3 + 0.26 + 0.12 m ahead, 0.1 m below."""
    model = uv.UvmsModel(robots["nested.sdf"].uvms)
    np.testing.assert_allclose(model.task_pose(np.zeros(9))[:6], [1.10, 0.0, 0.1, 0.0, 0.0, 0.0],
                               atol=1e-9)
    q = np.array([0.3, 0.5, -0.4])
    R, p = np.eye(3), np.array([0.42, 0.0, -0.1])
    for axis, angle, length in zip(([0, 1, 0], [0, 1, 0], [0, 0, 1]), q, (0.3, 0.26, 0.12),
                                   strict=True):
        R = R @ turn(axis, angle)
        p = p + R @ [length, 0.0, 0.0]
    np.testing.assert_allclose(model.task_pose(np.concatenate([np.zeros(6), q]))[:3], FLIP @ p,
                               atol=1e-9)
    (line,) = [line for line in notes_of("nested.sdf").taken if line.startswith("included")]
    assert line == "included models: wrist (nested_wrist/model.sdf), arm (nested_arm/model.sdf)"


@pytest.mark.parametrize("merge", ["true", "false"])
def test_a_urdf_that_is_included_is_the_same_robot(merge, tmp_path, robots):
    """At a pose, which is nothing to a vehicle that floats."""
    file = tmp_path / "around.sdf"
    file.write_text(f"""<sdf version="1.10"><world name="sea"><model name="around">
      <include merge="{merge}"><uri>file://{FILES / "dummy_root.urdf"}</uri><name>inner</name>
      <pose degrees="true">1 2 3 10 20 30</pose></include></model>
      <include><uri>model://sun</uri></include></world></sdf>""", encoding="utf-8")
    assert write_robot(file, tmp_path / "around") == 0
    robot, posture = uv.Robot.load(tmp_path / "around"), np.array([0.3, -0.4, 0.7])
    np.testing.assert_allclose(drakes_inertia(robot, posture),
                               drakes_inertia(robots["dummy_root.urdf"], posture), atol=1e-7)
    config = np.concatenate([np.zeros(6), posture])
    np.testing.assert_allclose(
        uv.UvmsModel(robot.uvms).task_pose(config),
        uv.UvmsModel(robots["dummy_root.urdf"].uvms).task_pose(config), atol=1e-7)


def test_limits_beyond_half_a_turn_are_kept(robots):
    limits = [(joint.position_lower_limits()[0], joint.position_upper_limits()[0])
              for joint in robots["wide_limits.urdf"].uvms.joints]
    assert limits == [(0.03, 6.02), (-1.5, 1.5), (1.0, 5.7), (0.02, 6.26)]


def test_meshes_are_converted_or_give_way_to_boxes():
    imported = import_robot(FILES / "heavy_rov.urdf", "heavy")
    obj = imported.files["meshes/hull.stl.obj"].decode()
    corners = np.array([line.split()[1:] for line in obj.splitlines() if line[0] == "v"], float)
    assert len(corners) == 8
    np.testing.assert_allclose(np.ptp(corners, axis=0), [1000.0, 600.0, 500.0])
    assert "<scale>0.001 0.001 0.001</scale>" in imported.files["heavy.sdf"].decode()
    light = import_robot(FILES / "light_rov.urdf", "light").files["light.sdf"].decode()
    assert "<box><size>0.46 0.34 0.25</size></box>" in light  # COLLADA, y up.
    assert not any("prop.dae" in name for name in import_robot(
        FILES / "light_rov.urdf", "light").files)


def test_a_closed_surface_has_its_volume_and_its_corners_once(tmp_path):
    corners = np.array([[0, 0, 0], [2, 0, 0], [0, 3, 0], [0, 0, 4]], dtype=float)
    triangles = corners[[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]] + [5.0, 5.0, 5.0]
    assert mesh_volume(triangles) == pytest.approx(2.0 * 3.0 * 4.0 / 6.0)
    file = tmp_path / "tetrahedron.obj"
    file.write_text(format_obj(triangles), encoding="utf-8")
    assert file.read_text("utf-8").count("v ") == 4
    np.testing.assert_allclose(bounding_box(file), [[5, 5, 5], [7, 8, 9]])


def test_a_robot_of_estimates_floats(robots):
    robot = robots["dummy_root.urdf"]
    mass = drakes_inertia(robot, np.zeros(3))[0, 0]
    volume = sum(body.displaced_volume for body in robot.uvms.hydrodynamics.bodies.values())
    assert 1000.0 * volume == pytest.approx(1.002 * mass, rel=1e-6)


def test_a_matrix_that_is_no_rounding_is_refused():
    M = np.diag([10.0, 20.0, 30.0, 1.0, 2.0, 3.0])
    M[0, 4], M[4, 0] = 2.0, -2.0
    with pytest.raises(uv.InvalidParameter, match=r"added_mass\[1\]\[5\] = 2.0: must be that of"):
        symmetric("added_mass", M, Notes("robot.sdf"))
    M[4, 0] = 2.0
    M[5, 5] = -3.0
    with pytest.raises(uv.InvalidParameter, match="smallest eigenvalue -3"):
        symmetric("added_mass", M, Notes("robot.sdf"))


def test_old_signs_of_gz_sim_and_drag_that_would_speed_up_are_turned(tmp_path):
    text = (FILES / "plugins.sdf").read_text("utf-8")
    for sign in ("DotU>", "DotV>", "DotW>", "DotP>", "DotQ>", "DotR>", "xU>", "yV>", "zW>", "kP>",
                 "mQ>", "nR>"):
        text = text.replace(f"{sign}-", sign)
    file = tmp_path / "old.sdf"
    file.write_text(text, encoding="utf-8")
    old, new = import_robot(file, "plugins"), import_robot(FILES / "plugins.sdf", "plugins")
    assert old.files["hydrodynamics.yaml"] == new.files["hydrodynamics.yaml"]
    assert any("positive, as old files have them" in line for line in old.notes.changed)
    assert any("linear drag that would speed up" in line for line in old.notes.changed)


@pytest.mark.parametrize("name", NAMES)
def test_a_random_mistake_is_a_line_or_a_robot(name, tmp_path):
    """Elements that are dropped, doubled, swapped or mistyped, and texts that are no numbers."""
    rng = np.random.default_rng(sum(name.encode()))
    shutil.copytree(FILES, tmp_path / "robot_files")
    refused = 0
    for _ in range(25):
        tree = ET.parse(FILES / name)
        spoil(tree.getroot(), rng)
        tree.write(tmp_path / "robot_files" / name)
        try:
            import_robot(tmp_path / "robot_files" / name, "robot")
        except uv.InvalidParameter as error:
            refused += 1
            assert "\n" not in str(error)
    assert 0 < refused < 25


def spoil(root: ET.Element, rng: np.random.Generator) -> None:
    """Makes a mistake somewhere in an element."""
    pairs = [(parent, child) for parent in root.iter() for child in parent]
    (parent, child), (_, other) = (pairs[i] for i in rng.integers(len(pairs), size=2))
    wrong = rng.choice(["0", "-1", "1e300", "nan", "1,5", "", "abc", "1 2 3 4"])
    match rng.integers(6):
        case 0:
            parent.remove(child)
        case 1:
            parent.append(child)
        case 2:
            child.attrib, other.attrib = other.attrib, child.attrib
            child.text, other.text = other.text, child.text
        case 3:
            child.tag = child.tag[:-1] or "x"
        case 4 if child.attrib:
            child.attrib[str(rng.choice(list(child.attrib)))] = str(wrong)
        case _:
            child.text = str(wrong)
