"""Files as they are found: what is taken of them, what is said of the rest, and who is the arm."""

import itertools
import shutil
from pathlib import Path

import numpy as np
import pytest
from support.pages import ROOT
from support.robot_files import FILES

import uvms_drake as uv
from uvms_drake.command.main import main
from uvms_drake.model.description.robot_files import model_dir
from uvms_drake.model.propulsion.thrusters import curve_at
from uvms_drake.report.robot.robot_sheet import format_sheet, sheet_of

CASES = ROOT / "tests" / "field_cases"
INERTIA = "<inertia><ixx>0.5</ixx><iyy>0.6</iyy><izz>0.7</izz></inertia>"
BOX = '<visual name="v"><geometry><box><size>0.4 0.3 0.168</size></box></geometry></visual>'
HULL = f'<link name="hull"><inertial><mass>20</mass>{INERTIA}</inertial>{BOX}</link>'


def sdf(folder: Path, *parts: str, version: str = "1.9") -> Path:
    """Returns a file of a model with parts."""
    file = folder / "found.sdf"
    file.write_text(f'<sdf version="{version}"><model name="m">{"".join(parts)}</model></sdf>',
                    encoding="utf-8")
    return file


def body(name: str, more: str = "", mass: float = 1.0) -> str:
    return (f'<link name="{name}"><pose>0.1 0 0 0 0 0</pose><inertial><mass>{mass}</mass><inertia>'
            "<ixx>0.01</ixx><iyy>0.01</iyy><izz>0.01</izz></inertia></inertial>"
            f"{more}</link>")


def joint(name: str, parent: str, child: str, effort: float = 9.0, more: str = "") -> str:
    return (f'<joint name="{name}" type="revolute"><parent>{parent}</parent><child>{child}</child>'
            f"<axis><xyz>0 1 0</xyz><limit><lower>-1</lower><upper>1</upper><effort>{effort}"
            f"</effort></limit>{more}</axis></joint>")


def chain(names: str, effort: float = 9.0) -> str:
    """Returns a chain of links from the hull on, each with a joint of its name and `_j`."""
    links = names.split()
    return "".join(body(link) + joint(f"{link}_j", before, link, effort)
                   for before, link in itertools.pairwise(["hull", *links]))


def taken(file: Path, folder: Path, capsys) -> str:
    """Returns the list of an import whose robot is sound."""
    capsys.readouterr()
    assert main(["robot", "--from", str(file), str(folder / "robot")]) == 0, capsys.readouterr()
    out = capsys.readouterr().out
    assert main(["robot", str(folder / "robot")]) == 0
    return out


def refused(file: Path, folder: Path, capsys) -> str:
    """Returns the complaint about a file of which nothing is written."""
    before = sorted(folder.iterdir())
    assert main(["robot", "--from", str(file), str(folder / "robot")]) == 2
    assert sorted(folder.iterdir()) == before
    return capsys.readouterr().err


def curve(robot: Path, name: str):
    thrusters = uv.Robot.load(robot).uvms.thrusters
    return curve_at(thrusters.kinds[thrusters.thrusters[name].kind], None)


# Numbers of plugins -------------------------------------------------------------------------------


def test_no_force_in_the_dead_band_of_gz_sim(tmp_path, capsys):
    taken(CASES / "dead_band" / "boxrov.sdf", tmp_path, capsys)
    for name in ("thruster1", "thruster2"):
        found = curve(tmp_path / "robot", name)
        assert [found.force_of(u) for u in (-2.9, 0.0, 2.9)] == [0.0, 0.0, 0.0]
        assert [found.force_of(u) for u in (-41, -3.1, 3.1, 60)] == pytest.approx(
            [-40, -3.1, 3.1, 50])
    # The others as they were: against the axis by a negative gain, 0.02 ρ D⁴ ω² = 45 N.
    assert curve(tmp_path / "robot", "thruster3").force_of(2.0) == pytest.approx(2.0)
    robot = uv.Robot.load(tmp_path / "robot").uvms.thrusters
    np.testing.assert_allclose(robot.thrusters["thruster1"].axis, [1, 0, 0], atol=1e-9)
    np.testing.assert_allclose(robot.thrusters["thruster4"].axis, [0, 0, 1], atol=1e-7)
    assert curve(tmp_path / "robot", "thruster4").force_of(150.0) == pytest.approx(45.0)


ROTOR = body("prop") + (
    '<joint name="prop_joint" type="revolute"><parent>hull</parent><child>prop</child>'
    "<axis><xyz>1 0 0</xyz></axis></joint>")


def thruster(*numbers: str) -> str:
    return ('<plugin filename="gz-sim-thruster-system" name="gz::sim::systems::Thruster">'
            f"<joint_name>prop_joint</joint_name>{''.join(numbers)}</plugin>")


def uuv(conversion: str, *numbers: str) -> str:
    return ('<plugin name="t" filename="libuuv_thruster_ros_plugin.so"><linkName>prop</linkName>'
            "<jointName>prop_joint</jointName><thrusterID>7</thrusterID><gain>1</gain>"
            f"<conversion>{conversion}</conversion>{''.join(numbers)}</plugin>")


BASIC = "<type>Basic</type><rotorConstant>0.02</rotorConstant>"
TABLE = ("<type>LinearInterp</type><inputValues>-100 0 100</inputValues>"
         "<outputValues>-20 0 40</outputValues>")
SPEED = ("<use_angvel_cmd>true</use_angvel_cmd><thrust_coefficient>0.02</thrust_coefficient>"
         "<propeller_diameter>0.1</propeller_diameter>")  # 0.002 N s².


@pytest.mark.parametrize(("plugin", "points", "said"), [
    (thruster("<max_thrust_cmd>30</max_thrust_cmd>"), {30: 30, 99: 30, -99: -30}, "one limit alon"),
    (thruster("<min_thrust_cmd>-25</min_thrust_cmd>"), {99: 25, -99: -25}, "one limit alone of pr"),
    (thruster("<min_thrust_cmd>-20</min_thrust_cmd>", "<max_thrust_cmd>30</max_thrust_cmd>",
              "<wake_fraction>0.3</wake_fraction>"), {30: 30}, "left out: wake_fraction = 0.3 (l"),
    (thruster(SPEED, "<max_thrust_cmd>100</max_thrust_cmd>", "<deadband>5</deadband>"),
     {49: 0.0, 51: 5.2, 100: 20, -100: -20}, "one limit alone"),
    (thruster("<deadband>4</deadband>"), {3.9: 0.0, 4.1: 4.1, -3.9: 0.0}, "no limit of prop in th"),
    (uuv(BASIC, "<clampMax>50</clampMax>"), {50: 50, -50: -50}, "one limit alone of prop"),
    (uuv(BASIC, "<thrustMax>32</thrustMax>"), {40: 32, 99: 32, -99: -32}, "one limit alone of p"),
    (uuv(TABLE, "<clampMin>-50</clampMin>", "<clampMax>75</clampMax>"), {99: 30, -99: -10}, ""),
    (uuv(TABLE, "<thrustMin>-15</thrustMin>", "<thrustMax>30</thrustMax>"), {99: 30, -99: -15}, ""),
    (uuv(BASIC.replace("0.02", "-0.02"), "<clampMin>-50</clampMin>", "<clampMax>50</clampMax>",
         "<thrustMin>-15</thrustMin>", "<thrustMax>30</thrustMax>"), {99: 15, -99: -30}, ""),
    (uuv(BASIC, "<clampMax>50</clampMax>", "<rotor_drag>7</rotor_drag>"), {}, "rotor_drag = 7 (li"),
])
def test_limits_of_thrusters_are_taken_or_named(plugin, points, said, tmp_path, capsys):
    file = sdf(tmp_path, HULL, ROTOR, plugin)
    out = taken(file, tmp_path, capsys)
    assert said in out
    assert "thrusterID" not in out  # It is a name.
    found = curve(tmp_path / "robot", "prop")
    for command, force in points.items():
        assert found.force_of(command) == pytest.approx(force, rel=0.02), command


@pytest.mark.parametrize(("numbers", "pilot", "ends"), [
    ("", "<offset>-0.5</offset><multiplier>100</multiplier>", (-50, 50)),
    ("", "<offset>-0.5</offset><multiplier>-80</multiplier>", (-40, 40)),
    ("<min_thrust_cmd>-30</min_thrust_cmd><max_thrust_cmd>90</max_thrust_cmd>",
     "<offset>-0.4</offset><multiplier>100</multiplier>", (-30, 60)),
    (SPEED, "<offset>-0.5</offset><multiplier>200</multiplier>", (-20, 20))])
def test_limits_of_an_autopilot_are_those_of_its_channels(numbers, pilot, ends, tmp_path, capsys):
    """The command is multiplier · (x + offset), 0 ≤ x ≤ 1."""
    control = ('<control channel="0"><jointName>prop_joint</jointName><type>COMMAND</type>'
               f"<servo_min>1100</servo_min><servo_max>1900</servo_max>{pilot}</control>")
    file = sdf(tmp_path, HULL, ROTOR, thruster(numbers),
               f'<plugin name="ArduPilotPlugin" filename="ArduPilotPlugin">{control}</plugin>')
    out = taken(file, tmp_path, capsys)
    assert "limits of commands of ArduPilotPlugin: prop_joint" in out
    assert "no limit of prop" not in out
    found = curve(tmp_path / "robot", "prop")
    assert (found.force_of(-1e3), found.force_of(1e3)) == pytest.approx(ends)


def test_a_current_of_a_plugin_is_named(tmp_path, capsys):
    file = sdf(tmp_path, HULL, '<plugin name="gz::sim::systems::Hydrodynamics" filename="h">'
               "<link_name>hull</link_name><default_current>0 0.5 0</default_current>"
               "<xDotU>-9</xDotU><yDotV>-9</yDotV><zDotW>-9</zDotW></plugin>")
    assert "left out: default_current = 0 0.5 0 (line 1)" in taken(file, tmp_path, capsys)


def test_a_spring_and_the_density_of_buoyancy_are_not_lost(tmp_path, capsys):
    springs = "<dynamics><spring_stiffness>40</spring_stiffness></dynamics>"
    file = sdf(tmp_path, HULL, body("a"), joint("a_j", "hull", "a", more=springs),
               '<plugin name="gz::sim::systems::Buoyancy" filename="gz-sim-buoyancy-system">'
               "<uniform_fluid_density>1025</uniform_fluid_density></plugin>")
    assert "spring of joint a_j left out" in taken(file, tmp_path, capsys)
    assert uv.Robot.load(tmp_path / "robot").uvms.hydrodynamics.fluid_density == 1025.0


# What ROS forgives --------------------------------------------------------------------------------


def test_limits_of_a_rotor_lose_nothing(tmp_path, capsys):
    out = taken(CASES / "limits_of_a_rotor" / "duct.urdf", tmp_path, capsys)
    (line,) = [line for line in out.split("For you")[0].splitlines() if "limits" in line]
    assert "not read for a mistake in them: line 8: joint thruster_left_joint: limits" in line
    assert set(uv.Robot.load(tmp_path / "robot").uvms.thrusters.thrusters) == {
        "thruster_left", "thruster_right"}


@pytest.mark.parametrize(("old", "new", "said"), [
    ('<limits effort="-1" velocity="-1"/>', '<limit effort="9,5"/>', "limit.effort = '9,5'"),
    ('<limits effort="-1" velocity="-1"/>', '<dynamic damping="1"/>', "joint: dynamic"),
    ('<limits effort="-1" velocity="-1"/>', "", None),
    ('<origin xyz="0.4 0 0"/>', '<origin xyz="0.4 0 0"/><origin xyz=" 0.40 0.0 -0"/>',
     "there twice and equal, taken once: origin (line 10)"),
    ('<mass value="20"/>', '<mass value="20"/><mass value="2e1"/>', "equal, taken once: mass"),
    ("<visual>", '<visual name="">', None)])
def test_what_loses_nothing_is_said_and_read_on(old, new, said, tmp_path, capsys):
    text = (CASES / "limits_of_a_rotor" / "duct.urdf").read_text("utf-8")
    assert old in text
    file = tmp_path / "duct.urdf"
    file.write_text(text.replace(old, new), encoding="utf-8")
    out = taken(file, tmp_path, capsys)
    assert said is None or said in out
    sheet = uv.Robot.load(tmp_path / "robot")
    assert sheet.uvms.plant.CalcTotalMass(
        sheet.uvms.plant.CreateDefaultContext()) == pytest.approx(20.1)


@pytest.mark.parametrize(("old", "new", "expected"), [
    ('<origin xyz="0.4 0 0"/>', '<origin xyz="0.4 0 0"/><origin xyz="0.4 0 1"/>', "there once"),
    ('name="tt" type="fixed"', 'name="tt" type="revolute"', "limits"),
    ('<origin xyz="-0.2 0.2 0"/>', '<orgin xyz="-0.2 0.2 0"/>', "did you mean 'origin'"),
    ('<mass value="20"/>', '<mass value="20"/><mass value="21"/>', "mass: must be there once")])
def test_what_loses_something_is_refused(old, new, expected, tmp_path, capsys):
    text = (CASES / "limits_of_a_rotor" / "duct.urdf").read_text("utf-8")
    file = tmp_path / "duct.urdf"
    text = text.replace(old, new)
    if expected == "limits":
        text = text.replace('link="tool_tip"/>', 'link="tool_tip"/><limits upper="1"/>')
    file.write_text(text, encoding="utf-8")
    assert expected in refused(file, tmp_path, capsys)


# Masses that SDFormat computes --------------------------------------------------------------------


def test_an_automatic_inertia_is_that_of_the_collision_shapes(tmp_path, capsys):
    out = taken(CASES / "inertial_auto" / "auto.sdf", tmp_path, capsys)
    assert "mass and inertia of 'hull': of its collision shapes" in out
    hull = uv.Robot.load(tmp_path / "robot").uvms.vehicle
    assert hull.default_mass() == pytest.approx(59.4)
    moments = hull.default_rotational_inertia().CopyToFullMatrix3()
    np.testing.assert_allclose(moments, 59.4 / 12.0 * np.diag(
        [0.4**2 + 0.25**2, 0.6**2 + 0.25**2, 0.6**2 + 0.4**2]), atol=1e-9)


def solid(name: str, geometry: str, pose: str = "0 0 0", density: str = "") -> str:
    return (f'<collision name="{name}"><pose>{pose} 0 0 0</pose>{density}'
            f"<geometry>{geometry}</geometry></collision>")


SPHERE = "<sphere><radius>0.2</radius></sphere>"
ROD = "<cylinder><radius>0.1</radius><length>0.8</length></cylinder>"


@pytest.mark.parametrize(("inertial", "shapes", "mass", "height"), [
    ("<density>800</density>", solid("a", SPHERE), 800 * 4 / 3 * np.pi * 0.008, 0.0),
    ("", solid("a", ROD, "0 0 0.3"), 1000 * np.pi * 0.008, -0.3),
    ("", solid("a", SPHERE, "0 0 0.5", "<density>600</density>")
     + solid("b", SPHERE, "0 0 -0.5", "<density>200</density>"),
     800 * 4 / 3 * np.pi * 0.008, -0.25)])
def test_densities_count_by_shape(inertial, shapes, mass, height, tmp_path, capsys):
    link = f'<link name="hull"><inertial auto="true">{inertial}</inertial>{shapes}</link>'
    taken(sdf(tmp_path, link, version="1.11"), tmp_path, capsys)
    hull = uv.Robot.load(tmp_path / "robot").uvms.vehicle
    assert hull.default_mass() == pytest.approx(mass)
    np.testing.assert_allclose(hull.default_com(), [0, 0, height], atol=1e-9)  # z is down here.


@pytest.mark.parametrize("shapes", [
    "", solid("a", "<mesh><uri>hull.stl</uri></mesh>"), solid("a", SPHERE) + solid(
        "b", "<mesh><uri>hull.stl</uri></mesh>")])
def test_an_automatic_inertia_of_a_mesh_is_refused_with_the_reason(shapes, tmp_path, capsys):
    file = sdf(tmp_path, f'<link name="hull"><inertial auto="true"/>{shapes}</link>')
    assert "auto = 'true': must be left out, with mass and inertia given: that of a mesh, or of " \
        "no collision shape, is not computed here" in refused(file, tmp_path, capsys)


# The arm ------------------------------------------------------------------------------------------


def test_a_camera_is_not_the_arm(tmp_path, capsys):
    out = taken(CASES / "camera_before_arm" / "inspector.urdf", tmp_path, capsys)
    assert "arm: 2 joints, joint1, joint2\n" in out
    assert "fixed, a camera: camera_pan_joint, camera_tilt_joint, camera_roll_joint\n" in out
    assert "the arm: camera_pan_joint, " in out.split("For you to give")[1]


EYE = '<sensor name="eye" type="camera"/>'


@pytest.mark.parametrize(("parts", "arm", "fixed"), [
    # By a sensor, whatever the names are.
    ([chain("a b"), chain("c d e").replace("</inertial></link><joint name=\"e_j\"",
                                           f"</inertial>{EYE}</link><joint name=\"e_j\"")],
     "2 joints, a_j, b_j", "fixed, a camera: c_j, d_j, e_j"),
    # By what drives it: motors of a few newton metres.
    ([chain("a b", 40.0), chain("c d e", 2.0)], "2 joints, a_j, b_j", "not in the chain: c_j"),
    # By what it carries, though another one is longer.
    ([chain("a b c"), chain("d e"), '<frame name="tool0" attached_to="e"/>'], "2 joints, d_j, e_j",
     "another arm, of 'a_j' to 'c_j', is fixed"),
    # Names of an arm that pans, and a camera on a wrist.
    ([chain("shoulder_pan elbow wrist_tilt"), chain("x y")],
     "3 joints, shoulder_pan_j, elbow_j, wrist_tilt_j", "'x_j' to 'y_j'"),
    ([chain("a b camera_flange"), '<frame name="tcp" attached_to="camera_flange"/>'],
     "3 joints, a_j, b_j, camera_flange_j", ""),
    ([chain("arm_rov/tilt arm_rov/camera"), chain("a")], "1 joints, a_j", "arm_rov/camera_j"),
    # Nothing but a camera: the tool is bolted on.
    ([chain("tilt camera")], "none, for no joint moves; the tool is bolted on",
     "fixed, a camera: tilt_j, camera_j")])
def test_an_arm_is_chosen_by_what_it_carries_and_drives(parts, arm, fixed, tmp_path, capsys):
    out = taken(sdf(tmp_path, HULL, *parts), tmp_path, capsys)
    assert f"arm: {arm}\n" in out
    assert fixed in out


# Robots' folders that are ones already ------------------------------------------------------------


def sheet(robot: Path | str) -> str:
    loaded = uv.Robot.load(robot)
    return format_sheet(sheet_of(loaded.uvms, "robot", np.full(len(loaded.uvms.joints), 0.3)), ())


@pytest.mark.parametrize("name", ["girona500_arm5e", "bluerov2_alpha5", "box_uvms"])
def test_the_file_of_a_shipped_robot_is_that_robot(name, tmp_path, capsys):
    out = taken(model_dir(name) / f"{name}.sdf", tmp_path, capsys)
    assert "it is a robot's already" in out
    assert "ESTIMATE" not in out.replace("ESTIMATE): nothing", "")
    assert sheet(tmp_path / "robot") == sheet(name)


def test_what_it_has_written_is_the_same_robot_again(tmp_path, capsys):
    """With its meshes, and from a copy with a changed name."""
    taken(FILES / "heavy_rov.urdf", tmp_path, capsys)
    (tmp_path / "robot").rename(tmp_path / "first")
    (tmp_path / "first" / "robot.sdf").rename(tmp_path / "first" / "edited.sdf")
    taken(tmp_path / "first" / "edited.sdf", tmp_path, capsys)
    shutil.copytree(tmp_path / "robot", tmp_path / "copy" / "robot")
    assert "mesh" in (tmp_path / "robot" / "robot.sdf").read_text("utf-8")
    assert uv.Robot.load(tmp_path / "robot").notes == ()


def test_a_file_of_ours_that_is_alone_is_not_turned(tmp_path, capsys):
    file = tmp_path / "girona.sdf"
    shutil.copy(model_dir("girona500_arm5e") / "girona500_arm5e.sdf", file)
    out = taken(file, tmp_path, capsys)
    assert "axes: FRD, z down, for a link 'vehicle' and a frame 'tip'" in out

    def tip(robot: Path | str) -> np.ndarray:
        return uv.UvmsModel(uv.read_uvms(str(robot))).task_pose(np.full(10, 0.2))

    np.testing.assert_allclose(tip(tmp_path / "robot"), tip("girona500_arm5e"), atol=1e-8)


def test_a_joint_may_have_the_name_of_a_link(tmp_path, capsys):
    """In URDF; SDFormat has one name for one thing."""
    inertial = ('<inertial><mass value="{}"/><inertia ixx="0.5" iyy="0.6" izz="0.7" ixy="0" '
                'ixz="0" iyz="0"/></inertial>')
    file = tmp_path / "found.urdf"
    file.write_text('<robot name="m">' + "".join(
        f'<link name="{name}">{inertial.format(mass)}</link>'
        for name, mass in (("hull", 20), ("elbow", 1), ("hand", 1))) + "".join(
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
        '<origin xyz="0.3 0 0"/><axis xyz="0 1 0"/>'
        '<limit lower="-1" upper="1" effort="9" velocity="1"/></joint>'
        for name, parent, child in (("shoulder", "hull", "elbow"), ("elbow", "elbow", "hand")))
        + "</robot>", encoding="utf-8")
    taken(file, tmp_path, capsys)
    names = [joint.name() for joint in uv.Robot.load(tmp_path / "robot").uvms.joints]
    assert names == ["shoulder", "elbow_2"]


# What the checks say ------------------------------------------------------------------------------


@pytest.mark.parametrize(("parts", "expected"), [
    ([HULL, '<plugin name="p" filename="libuuv_underwater_object_ros_plugin.so">'
      '<link name="hull"><volume>20</volume><center_of_buoyancy>0 0 0.05</center_of_buoyancy>'
      "</link></plugin>"], "displaced_volume of all bodies, as mass of water over that"),
    ([HULL, chain("a b").replace("<lower>-1<", "<lower>-90<")], "limits = [-90.0, 1.0]: must be"),
    ([HULL.replace("<mass>20</mass>", "<mass>1</mass>").replace(INERTIA, INERTIA.replace(
        "0.5", "1").replace("0.6", "1").replace("0.7", "1"))], "these are SDFormat's defaults")])
def test_a_robot_that_would_be_refused_is_refused_at_once(parts, expected, tmp_path, capsys):
    """With the list, and with the place where the number would be."""
    file = sdf(tmp_path, *parts)
    assert main(["robot", "--from", str(file), str(tmp_path / "robot")]) == 2
    out, err = capsys.readouterr()
    assert "Taken from the file:" in out and "Refused, and nothing is written" in out
    assert expected in err
    assert f": error: {tmp_path}/robot/" in err
    assert [path.name for path in tmp_path.iterdir()] == ["found.sdf"]


@pytest.mark.parametrize("mass", [0.4, 9.0, 3e4])
@pytest.mark.parametrize("arm", ["", "a", "a b c d"])
def test_numbers_that_it_writes_itself_are_never_refused(mass, arm, tmp_path, capsys):
    size = (mass / 1000.0) ** (1.0 / 3.0)
    inertia = mass * size**2 / 6.0
    hull = (f'<link name="hull"><inertial><mass>{mass}</mass><inertia><ixx>{inertia}</ixx><iyy>'
            f"{inertia}</iyy><izz>{inertia}</izz></inertia></inertial></link>")
    taken(sdf(tmp_path, hull, chain(arm) if arm else ""), tmp_path, capsys)


def test_a_robot_of_stonefish_is_refused_with_the_reason(tmp_path, capsys):
    file = tmp_path / "auv.scn"
    file.write_text('<scenario><robot name="auv"/></scenario>', encoding="utf-8")
    assert "not <scenario>: Stonefish has the masses" in refused(file, tmp_path, capsys)
