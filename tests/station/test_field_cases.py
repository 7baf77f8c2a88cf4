"""Robots' files as people write them: each mistake is one line that names its place and its cure.

The kinds are those of reports about this and other programs; what is accepted is what is run.
"""

import re
from pathlib import Path

import numpy as np
import pytest
from support.random_robots import OBJ
from support.robots import altered, diver

import uvms_drake as uv
from uvms_drake.command.main import main
from uvms_drake.model.description.hydrodynamics_file import added_mass_about_origin
from uvms_drake.model.trim import trim_of
from uvms_drake.plant.model_check import complaints_about, sound_robot
from uvms_drake.report.robot.robot_sheet import notes_of, sheet_of

STL = """solid box
facet normal 0 0 1 outer loop vertex 0 0 0 vertex 0.4 0 0 vertex 0 0.2 0.1 endloop endfacet
endsolid box
"""
DAE = """<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema"><asset>
<unit meter="0.001"/><up_axis>Z_UP</up_axis></asset><library_geometries><geometry><mesh>
<source id="p"><float_array id="a" count="6">0 0 0 400 200 100</float_array></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
</mesh></geometry></library_geometries></COLLADA>"""
BOX = '<geometry> <box size="0.6 0.4 0.3"/> </geometry>'
SHAPE = "<visual>\n      " + BOX
UPPER, FORE = '<origin xyz="0.32 0 0.1" rpy="0 0 0"/>', '<origin xyz="0.3 0 0"/>'
ELBOW = '<limit lower="0.1" upper="2.1"'
END = "</robot>"


def mesh(uri: str) -> tuple[str, str, str]:
    """Returns the change by which the visual of the hull is a mesh."""
    return ".urdf", BOX, f'<geometry> <mesh filename="{uri}"/> </geometry>'


def collision(uri: str) -> tuple[str, str, str]:
    """Returns the change that gives the hull a collision shape."""
    return ".urdf", "<visual>", f'<collision><geometry><mesh filename="{uri}"/></geometry>' \
                                "</collision><visual>"


def side(name: str, kind: str, parent: str = "vehicle", more: str = "") -> tuple[str, str, str]:
    """Returns the change that adds a small link on a joint of its own."""
    return ".urdf", END, (
        f'<link name="{name}"><inertial><mass value="0.01"/><inertia ixx="1e-6" iyy="1e-6" '
        f'izz="1e-6"/></inertial></link><joint name="{name}_joint" type="{kind}"><parent '
        f'link="{parent}"/><child link="{name}"/><axis xyz="1 0 0"/>{more}</joint>{END}')


MATRIX = ("hydrodynamics.yaml", "matrix: [20, 40, 50, 1, 2, 2]",
          "matrix: [[20, 0, 0, 0, {}, 0], [0, 40, 0, 0, 0, 0], [0, 0, 50, 0, 0, 0], "
          "[0, 0, 0, 1, 0, 0], [{}, 0, 0, 0, 2, 0], [0, 0, 0, 0, 0, 2]]")


def added(upper: str, lower: str) -> tuple[str, str, str]:
    """Returns the change by which surge and pitch of the hull are coupled."""
    return MATRIX[0], MATRIX[1], MATRIX[2].format(upper, lower)


REFUSED = {
    # Keys that stand twice, of which the last one won.
    "a thruster twice": ([("thrusters.yaml", "  stern:", "  bow:")],
                         "thrusters.yaml: line 9: the key 'bow' is there already, in line 8"),
    # Errors of YAML's readers, told by line, key and what is allowed.
    "a short row": ([(MATRIX[0], MATRIX[1], "matrix: [[1, 0], [0]]")],
                    "yaml: line 6: bodies.vehicle.added_mass[0].matrix = [[1, 0], [0]]: must be a "
                    "list of numbers, or of rows of equal length"),
    "a comma in YAML": ([("hydrodynamics.yaml", "41.0e-3", "0,041")],
                        "yaml: line 3: bodies.vehicle.displaced_volume = '0,041': must be a"),
    # Exceptions of Drake's parsers, and what ends a program.
    "a planar joint": ([(".urdf", '"elbow" type="revolute"', '"elbow" type="planar"')],
                       "urdf: line 30: joint elbow: type = 'planar': must be one of revolute"),
    "commas between numbers": ([(".urdf", FORE, '<origin xyz="0.3, 0, 0"/>')],
                               "joint elbow: origin.xyz = '0.3, 0, 0': must be 3 numbers with "
                               "spaces between them, decimals after a point"),
    "limits the wrong way": ([(".urdf", ELBOW, '<limit lower="2.1" upper="0.1"')],
                             "joint elbow: limit = [2.1, 0.1]: must be lower below upper"),
    "a link without an end": ([(".urdf", '</link>\n  <link name="fore">', '<link name="fore">')],
                              "diver.urdf: line 47: must be XML: mismatched tag"),
    # Joints that are not in the chain.
    "a propeller": ([side("prop", "continuous")],
                    "joint prop_joint: must be of type fixed, as 'prop' is not in the chain "
                    "vehicle → shoulder → elbow → tip on fore"),
    "a root above the vehicle": ([(".urdf", END, '<link name="base"/><joint name="to_base" '
                                   'type="fixed"><parent link="base"/><child link="vehicle"/>'
                                   f"</joint>{END}")],
                                 "and the root is 'base': the vehicle must be the root, a floating "
                                 "body: name 'base' vehicle, or leave it and joint to_base out"),
    "a loop": ([side("prop", "fixed"), (".urdf", END, '<joint name="again" type="fixed"><parent '
                f'link="fore"/><child link="prop"/></joint>{END}')],
               "link prop: hangs on two joints, prop_joint and again: it must hang on one"),
    # Elements that were read by none.
    "a mimicking jaw": ([side("jaw", "revolute", "fore", '<mimic joint="elbow"/>')],
                        "joint jaw_joint: mimic: must be left out: the arm is a chain without"),
    "an origin twice": ([(".urdf", FORE, FORE + '<origin xyz="0.2 0 0"/>')],
                        "joint elbow: origin: must be there once, and is in line 32"),
    # Numbers in other units.
    "kg mm²": ([(".urdf", 'iyy="0.009" izz="0.009"', 'iyy="9000" izz="9000"'),
                (".urdf", 'ixx="0.0006"', 'ixx="600"')],
               "urdf: link upper: inertial, as a radius of gyration = 86.6: must be 10 m or less"),
    "a pose in degrees": ([(".urdf", 'rpy="0 0 0"/> <axis', 'rpy="90 0 0"/> <axis')],
                          "joint shoulder: origin.rpy = '90 0 0': must be angles in radians"),
    "a place in millimetres": ([(".urdf", FORE, '<origin xyz="300 0 0"/>')],
                               "joint elbow: origin.xyz = '300 0 0': must be in metres and within "
                               "10 m: it is 300 m away"),
    "a centre in millimetres": ([("hydrodynamics.yaml", "[0.01, 0, -0.03]", "[10, 0, -30]")],
                                "line 4: bodies.vehicle.center_of_buoyancy"),
    "a decimal comma": ([(".urdf", '<mass value="1.2"/>', '<mass value="1,2"/>')],
                        "link upper: inertial.mass.value = '1,2': must be a number, decimals"),
    "no range": ([(".urdf", ELBOW, '<limit lower="0" upper="0"')],
                 "line 33: joint elbow: limit = [0.0, 0.0]: must be a range: lower is upper, and "
                 "the joint cannot move: type fixed, or give limits"),
    "thrusters in millimetres": ([("thrusters.yaml", "position: [0.2, 0, 0]",
                                   "position: [200, 0, 0]")],
                                 "thrusters.yaml: line 8: thrusters.bow.position = [200., 0., "
                                 "0.]: must be within 10 m"),
    "an element that is mistyped": ([(".urdf", FORE, FORE.replace("origin", "orgin"))],
                                    "joint elbow: orgin: must be one of name, type, origin,"),
    # Matrices beyond their rounding.
    "a sign that is lost": ([added("2.5", "-2.5")],
                            "bodies.vehicle.added_mass[0].matrix = 'row 1, column 5: 2.5 against "
                            "-2.5 in row 5, column 1': must be symmetric, to 0.1 % of an entry"),
}


SDF = {
    "a nested model": ([(".sdf", "</model>", '<model name="camera"><link name="eye"/></model>'
                         "</model>")], "model = 'camera': must be merged: nested models are"),
    "added mass of SDFormat": ([(".sdf", "<mass>60.0</mass>", "<fluid_added_mass><xx>30</xx>"
                                 "</fluid_added_mass><mass>60.0</mass>")],
                               "link vehicle: inertial.fluid_added_mass: must be left out: added "
                               "mass is in hydrodynamics.yaml, bodies.<link>.added_mass"),
    "an include": ([(".sdf", "</model>", "<include><uri>package://box_uvms/arm.sdf</uri></include>"
                     "</model>")], "include = 'package://box_uvms/arm.sdf': must be merged"),
    "a mimicking joint": ([(".sdf", "<xyz>0 1 0</xyz>", "<xyz>0 1 0</xyz><mimic joint='shoulder'>"
                            "<multiplier>-1</multiplier></mimic>")],
                          "joint shoulder: axis.mimic: must be left out"),
    "a pose of four numbers": ([(".sdf", "<pose>0 0 0.02 0 0 0</pose>", "<pose>0 0 0.02 0</pose>")],
                               "link vehicle: inertial.pose = '0 0 0.02 0': must be 6 numbers"),
}


@pytest.mark.parametrize("mistake", [*REFUSED, *SDF])
def test_a_mistake_is_refused_in_a_line_that_names_it(mistake, tmp_path):
    changes, expected = (REFUSED | SDF)[mistake]
    make = altered if mistake in SDF else diver
    with pytest.raises(uv.InvalidParameter, match=re.escape(expected)) as caught:
        sound_robot(str(make(tmp_path, *changes)))
    assert "\n" not in str(caught.value)


def test_all_that_is_wrong_is_told_in_one_list(tmp_path, capsys):
    robot = diver(tmp_path, (".urdf", FORE, '<origin xyz="0,3 0 0"/>'),
                  (".urdf", ELBOW, '<limit lower="0" upper="0"'),
                  ("hydrodynamics.yaml", "41.0e-3", "a lot"),
                  ("thrusters.yaml", "  stern:", "  bow:"))
    assert main(["robot", str(robot)]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert [line.split(": ")[2].rsplit("/", 1)[-1] for line in err.splitlines()] == [
        "diver.urdf", "hydrodynamics.yaml", "thrusters.yaml"]


def test_the_order_of_a_urdf_is_no_matter(tmp_path):
    """Shoulder and elbow change places in the file, and not in the robot."""
    source = diver(tmp_path / "a")
    text = (source / "diver.urdf").read_text(encoding="utf-8")
    first, last = text.index('  <joint name="shoulder"'), text.index("  <transmission")
    second = text.index('  <joint name="elbow"')
    turned = diver(tmp_path / "b", (".urdf", text[first:last], text[second:last]
                                    + text[first:second]))
    known, other = uv.Robot.load(source), uv.Robot.load(turned)
    assert [joint.name() for joint in other.uvms.joints] == ["shoulder", "elbow"]
    assert complaints_about(other) == []
    q = np.array([-0.6, 0.9])
    np.testing.assert_array_equal(trim_of(known.uvms, q).center_of_mass,
                                  trim_of(other.uvms, q).center_of_mass)


# Which file.

def test_two_files_of_a_robot_are_refused(tmp_path):
    robot = diver(tmp_path, diver__sdf="<sdf version='1.9'><model name='diver'/></sdf>")
    with pytest.raises(uv.InvalidParameter, match=r"diver\.sdf and diver\.urdf are both there"):
        uv.Robot.load(robot)


@pytest.mark.parametrize("name", ["diver.urdf", "hydrodynamics.yaml", "package.xml"])
def test_a_file_that_is_missing_is_named(name, tmp_path):
    robot = diver(tmp_path)
    (robot / name).rename(robot / f"my_{name}")
    with pytest.raises(uv.InvalidParameter, match=rf"{name} is not there") as caught:
        uv.Robot.load(robot)
    assert "\n" not in str(caught.value)


def test_files_that_are_not_read_are_noted(tmp_path):
    robot = diver(tmp_path, other__urdf="<robot/>", thruster__yaml="{}", notes__txt="")
    assert uv.Robot.load(robot).notes == tuple(
        f"{name} is not read: the robot's file is diver.urdf"
        for name in ("other.urdf", "thruster.yaml"))


# What is accepted is what is run, and what is not read is told once.

ACCEPTED = {
    "a collision of STL": ([collision("package://diver/hull.stl")],
                           "not read: collision of link", "drawn as it is"),
    "a collision that is missing": ([collision("package://nowhere/hull.obj")],
                                    "not read: collision of link", "drawn as it is"),
    "a visual of STL": ([mesh("package://diver/hull.stl")],
                        ".stl is no format that can be drawn", "box"),
    "a visual of COLLADA": ([mesh("hull.dae")], ".dae is no format that can be drawn", "box"),
    "a visual that is broken": ([mesh("package://diver/hull.obj")], "hull.obj cannot be", None),
    "an unknown package": ([mesh("package://rov_description/hull.obj")],
                           "package rov_description is unknown: package.xml is", None),
}


@pytest.mark.parametrize("case", ACCEPTED)
def test_a_shape_that_cannot_be_drawn_is_a_note_and_stops_nothing(case, tmp_path):
    changes, note, drawn = ACCEPTED[case]
    robot = diver(tmp_path, *changes, hull__stl=STL, hull__dae=DAE, hull__obj="v 0 0\nf 1 2 3\n")
    loaded = uv.Robot.load(robot)
    assert complaints_about(loaded) == []
    (told,) = loaded.notes
    assert note in told
    assert drawn != "box" or told.endswith("its bounding box is drawn")
    assert drawn is not None or told.endswith("it is left out")
    assert "mesh" not in loaded.files.text or drawn is None
    uv.make_uvms_plant(str(robot), surface=None, disturbance=None)


def test_a_mesh_is_found_wherever_the_robot_is_named_from(tmp_path, monkeypatch):
    robot = diver(tmp_path, mesh("package://diver/the hull.obj"))
    (robot / "the hull.obj").write_text(OBJ, encoding="utf-8")
    for folder, path in ((tmp_path, "diver"), (robot, "."), (robot, "../diver")):
        monkeypatch.chdir(folder)
        loaded = uv.Robot.load(path)
        assert loaded.notes == ()
        assert f"file://{robot.resolve()}/the hull.obj" in loaded.files.text
        uv.make_uvms_plant(path, surface=None, disturbance=None)


def test_the_box_of_a_mesh_is_where_the_mesh_is(tmp_path):
    """From (0, 0, 0) to (0.4, 0.2, 0.1) m, turned by a quarter about z, and 1 m along x."""
    robot = diver(tmp_path, (".urdf", SHAPE, '<visual><origin xyz="1 0 0" rpy="0 0 1.5707963268"/>'
                             '<geometry> <mesh filename="hull.stl" scale="1 2 1"/> </geometry>'),
                  hull__stl=STL)
    text = uv.Robot.load(robot).files.text
    size = np.array(re.search(r'<box size="([^"]*)"', text)[1].split(), dtype=float)
    place = np.array(re.search(r'<visual><origin xyz="([^"]*)"', text)[1].split(), dtype=float)
    np.testing.assert_allclose(size, [0.4, 0.4, 0.1], atol=1e-7)
    np.testing.assert_allclose(place, [0.8, 0.2, 0.05], atol=1e-7)


def test_pictures_are_drawn_of_a_robot_with_meshes(tmp_path, capsys):
    robot = diver(tmp_path, mesh("hull.stl"), hull__stl=STL)
    assert main(["robot", str(robot), "--output", str(tmp_path / "out")]) == 0
    assert all((tmp_path / "out" / name).is_file() for name in ("robot.png", "robot.html"))
    assert capsys.readouterr().out.count("bounding box is drawn") == 1


def test_friction_is_told_once_for_all_joints(tmp_path):
    urdf = diver(tmp_path, (".urdf", 'damping="1"', 'damping="1" friction="2"'))
    sdf = altered(tmp_path, (".sdf", "<damping>1.0</damping>",
                             "<damping>1.0</damping><friction>2</friction>"))
    for robot in (urdf, sdf):
        (note,) = uv.Robot.load(robot).notes
        assert re.search(r"lines \d+, \d+: not read: friction of joint", note)


def test_what_others_read_is_told_once_for_each_kind(tmp_path, capfd):
    sensors = "".join(f'<gazebo reference="{i}"><sensor name="s"/></gazebo>' for i in range(9))
    robot = diver(tmp_path, (".urdf", END, f"{sensors}<ros2_control/>{END}"))
    notes = uv.Robot.load(robot).notes
    assert [note.split("not read: ")[1] for note in notes] == [
        "gazebo of the model", "ros2_control of the model"]
    assert "and 5 more" in notes[0]
    assert capfd.readouterr().err == ""  # Drake's warnings are no others.


def test_dry_bodies_are_one_note_and_frames_none(tmp_path):
    robot = diver(tmp_path, *(side(f"part{i}", "fixed") for i in range(5)),
                  (".urdf", END, '<link name="frame"/><joint name="to_frame" type="fixed"><parent '
                                 f'link="fore"/><child link="frame"/></joint>{END}'))
    uvms = uv.Robot.load(robot).uvms
    (note,) = notes_of(sheet_of(uvms, "diver", np.array([-0.4, 0.9])))
    assert note == ("dry, as hydrodynamics.yaml does not name them: part0, part1, part2, part3, "
                    "part4")


def test_a_rounded_matrix_is_symmetrised_and_the_entry_is_told(tmp_path):
    robot = uv.Robot.load(diver(tmp_path, added("2.501", "2.502")))
    (note,) = robot.notes
    assert note == ("hydrodynamics.yaml: bodies.vehicle.added_mass[0].matrix: row 1, column 5 is "
                    "2.501, and mirrored 2.502: their mean is taken")
    M = added_mass_about_origin(robot.uvms.hydrodynamics.bodies["vehicle"].added_mass)
    assert M[0, 4] == M[4, 0] == pytest.approx(2.5015)


PART = """<sdf version="1.9"><model name="part"><link name="hook"><pose>0.1 0 0 0 0 0</pose>
<inertial><mass>{}</mass><inertia><ixx>1e-3</ixx><iyy>1e-3</iyy><izz>1e-3</izz></inertia></inertial>
<collision name="c"><geometry><mesh><uri>hook.stl</uri></mesh></geometry></collision></link>
</model></sdf>"""


def merged(folder: Path, mass: str) -> Path:
    """Returns a robot whose file includes another one, with a mass."""
    robot = altered(folder, (".sdf", "</model>", """<include merge="true">
        <uri>package://box_uvms/part.sdf</uri></include><joint name="hold" type="fixed">
        <parent>vehicle</parent><child>hook</child></joint></model>"""))
    (robot / "part.sdf").write_text(PART.format(mass), encoding="utf-8")
    return robot


def test_an_included_file_is_held_to_the_same(tmp_path):
    robot = uv.Robot.load(merged(tmp_path / "a", "2.0"))
    assert trim_of(robot.uvms, np.zeros(2)).mass == pytest.approx(65.0)
    (note,) = robot.notes
    assert note == "part.sdf: line 3: not read: collision of link"
    with pytest.raises(uv.InvalidParameter, match=r"part\.sdf: line 2: link hook: inertial\.mass"):
        uv.Robot.load(merged(tmp_path / "b", "2,0"))


def test_a_centre_in_centimetres_is_noted(tmp_path):
    robot = uv.Robot.load(diver(
        tmp_path, ("hydrodynamics.yaml", "[0.01, 0, -0.03]", "[0.01, 0, -3]")))
    (note,) = notes_of(sheet_of(robot.uvms, "diver", np.array([-0.4, 0.9])))
    assert note.startswith("the centre of buoyancy is 2.9")


def test_all_joints_beside_the_chain_are_told_at_once(tmp_path, capsys):
    robot = diver(tmp_path, side("prop_1", "continuous"), side("prop_2", "continuous"),
                  side("jaw", "prismatic", "fore"), side("camera", "revolute"))
    assert main(["robot", str(robot)]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert [line.split("joint ")[1].split(":")[0] for line in lines] == [
        "prop_1_joint", "prop_2_joint", "camera_joint", "jaw_joint"]
    assert all("must be of type fixed" in line for line in lines)
