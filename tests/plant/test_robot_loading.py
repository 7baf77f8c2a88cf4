"""`plant.model_check`."""

import re
from dataclasses import replace

import numpy as np
import pytest
from support.robots import TEMPLATE, altered

import uvms_drake as uv
from uvms_drake.model import uvms_model
from uvms_drake.model.description.robot_files import models_dir
from uvms_drake.model.links import read_links
from uvms_drake.model.trim import middle_posture, trim_of
from uvms_drake.plant.model_check import complaints_about, model_complaints, sound_robot

TIP = '<frame name="tip" attached_to="forearm">'
END = "</model>"
BODY = ("<inertial><mass>0.2</mass><inertia><ixx>1e-4</ixx><iyy>1e-4</iyy><izz>1e-4</izz></inertia>"
        "</inertial>")
SHOULDER, ELBOW = (f'<joint name="{name}" type="revolute">' for name in ("shoulder", "elbow"))


def link(name: str, joint: str = "") -> tuple[str, str, str]:
    """Returns the change that adds a link, and something after it."""
    return ".sdf", END, f'<link name="{name}">{BODY}</link>{joint}{END}'


def gripper(kind: str) -> tuple[str, str, str]:
    return link("jaw", f'<joint name="jaws" type="{kind}"><parent>forearm</parent>'
                       "<child>jaw</child><axis><xyz>0 0 1</xyz></axis></joint>")


BROKEN = {
    "tip on a middle link": ([(".sdf", TIP, TIP.replace("forearm", "upper_arm"))],
                             "sdf: frame tip = 'upper_arm': must be attached to 'forearm'"),
    "a gripper that opens": ([gripper("revolute")],
                             "frame tip = 'forearm': must be attached to 'jaw', which the last "
                             "joint, 'jaws', moves: joints beyond the tip, as of a gripper, are"),
    "a link by itself": ([link("payload")],
                         "sdf: link = 'payload': must be joined to the vehicle by joints"),
    "limits in degrees": ([(".sdf", "<upper>0.5</upper>", "<upper>90</upper>")],
                          "sdf: joint shoulder: limits = [-1.5, 90.0]: must be in radians, up to"),
    "a spring": ([(".sdf", "<damping>1.0</damping>",
                   "<damping>1.0</damping><spring_stiffness>5</spring_stiffness>")],
                 "sdf: joint shoulder: spring_stiffness = 5.0: must be 0"),
    "a bushing": ([(".sdf", END, """<frame name="a" attached_to="vehicle"/><frame name="b"
        attached_to="forearm"/><drake:linear_bushing_rpy><drake:bushing_frameA>a</drake:bushing_frameA>
        <drake:bushing_frameC>b</drake:bushing_frameC>
        <drake:bushing_torque_stiffness>1 1 1</drake:bushing_torque_stiffness>
        <drake:bushing_torque_damping>0 0 0</drake:bushing_torque_damping>
        <drake:bushing_force_stiffness>1 1 1</drake:bushing_force_stiffness>
        <drake:bushing_force_damping>0 0 0</drake:bushing_force_damping>
        </drake:linear_bushing_rpy></model>""")],
                  "sdf: force element = 'LinearBushingRollPitchYaw': must be left out"),
    "moments of no body": ([(".sdf", "<ixx>2.05</ixx>", "<ixx>20.5</ixx>")],
                           "sdf = 'an inertia that Drake replaces': must be one that a body can"),
    "no inertial": ([(".sdf", END, '<link name="hook"/><joint name="fix" type="fixed"><parent>'
                      f"forearm</parent><child>hook</child></joint>{END}")],
                    "sdf: link hook: inertial = '1 kg, 1 kg m²': must be given"),
    "a joint that moves nothing": (
        [(".sdf", "<mass>1.5</mass>", "<mass>1e-9</mass>"), (".sdf", "0.000675", "1e-11"),
         (".sdf", "0.01159", "1e-11"), (".sdf", ">5e-5<", ">0<")],
        "sdf: joint shoulder: inertia about its axis = "),
    "volumes in litres": ([(".yaml", "61.6e-3", "61.6")],
                          "yaml: displaced_volume of all bodies, as mass of water over that of the "
                          "robot = 977.8: must be between 0.8 and 1.25 (volumes are in m³"),
    "numbers with z up": ([(".yaml", "[0.014, 0.0, -0.03]", "[0.014, 0.0, 0.03]"),
                           (".sdf", "<pose>0 0 0.02 0 0 0</pose>", "<pose>0 0 -0.02 0 0 0</pose>")],
                          "yaml: center_of_buoyancy of all bodies, above the centre of mass by = "
                          "'-0.0445 m': must be zero or positive, or the vehicle turns over: axes "
                          "are FRD, z down (numbers with z up are turned by diag(1, -1, -1))"),
    "added mass that gives energy": ([(".yaml", "[30.0, 60.0", "[-30.0, 60.0")],
                                     "bodies.vehicle.added_mass[0].matrix = "),
    "negative drag": ([(".yaml", "linear: [20.0", "linear: [-20.0")],
                      "bodies.vehicle.drag[0].linear = "),
    "a body that is not there": ([(".yaml", "  forearm:", "  fore_arm:")],
                                 "yaml: line 31: bodies = 'fore_arm': must be a link of "
                                 "box_uvms.sdf: forearm, upper_arm, vehicle (did you mean 'fore"),
    "no tip": ([(".sdf", 'name="tip"', 'name="tool"')],
               "box_uvms.sdf: must have a frame 'tip': its frames are"),
    "no vehicle": ([(".sdf", '"vehicle"', '"hull"'), (".sdf", ">vehicle<", ">hull<")],
                   "box_uvms.sdf: must have a frame 'vehicle': its"),
    "a vehicle that is held": ([(".sdf", END, '<joint name="held" type="fixed"><parent>world'
                                 f"</parent><child>vehicle</child></joint>{END}")],
                               "link vehicle: joint held of type 'weld' fixes it to 'world': it "),
    "a ball joint": ([(".sdf", ELBOW, ELBOW.replace("revolute", "ball"))],
                     "sdf: line 92: joint elbow: type = 'ball': must be one of revolute, "
                     "continuous, prismatic, fixed"),
    "a joint without a motor": ([(".sdf", "<effort>30", "<effort>0")],
                                "sdf: joint shoulder: actuator = None: must be there"),
}


@pytest.mark.parametrize("mistake", BROKEN)
def test_a_broken_robot_is_refused_by_the_name_of_its_mistake(mistake, tmp_path):
    changes, expected = BROKEN[mistake]
    robot = altered(tmp_path, *changes)
    with pytest.raises(uv.InvalidParameter, match=re.escape(expected)) as caught:
        sound_robot(str(robot))
    assert "\n" not in str(caught.value)


def test_every_shipped_robot_is_sound():
    folders = [path.parent.name for path in models_dir().glob("*/package.xml")]
    assert TEMPLATE in folders
    for name in folders:
        assert complaints_about(uv.Robot.load(name)) == []


def test_the_robot_is_checked_wherever_a_scenario_is_run_or_certified(tmp_path):
    """`load_model` is what `run`, `certify`, `simulate` and `make_station` share."""
    robot = altered(tmp_path, *BROKEN["tip on a middle link"][0])
    with pytest.raises(uv.InvalidParameter, match="frame tip = 'upper_arm'"):
        uv.load_model(uv.load_scenario("paper_dynamic", [f"model={robot}"]))
    with pytest.raises(uv.InvalidParameter, match="frame tip = 'upper_arm'"):
        uv.make_scenario(uv.Robot.load(robot), force=5.0)


@pytest.mark.parametrize(("change", "seen"), [
    ((".sdf", "<damping>1.0</damping>",
      "<damping>1.0</damping><spring_stiffness>5</spring_stiffness>"),
     {"force in shoulder", "force in elbow", "balance of power"}),
    ((".sdf", TIP, TIP.replace("forearm", "upper_arm")),
     {"pose of the tip", "velocity of the tip"}),
    (gripper("revolute"), {"pose of the tip", "velocity of the tip"})])
def test_model_and_plant_alone_would_show_it(change, seen, tmp_path):
    """The net below the other checks: two descriptions of one robot, in random states."""
    complaints = model_complaints(uv.read_uvms(str(altered(tmp_path, change))))
    assert seen <= {complaint.key.removeprefix("model of the controller, ")
                    for complaint in complaints}


@pytest.mark.parametrize("joints", [(SHOULDER,), (ELBOW,), (SHOULDER, ELBOW)])
def test_joints_that_slide_are_those_of_the_plant_to_rounding(joints, tmp_path, monkeypatch):
    monkeypatch.setattr("uvms_drake.plant.model_check.AGREEMENT", 1e-12)
    monkeypatch.setattr("uvms_drake.plant.model_check.STATES", 5)
    robot = uv.read_uvms(str(altered(tmp_path, *(
        (".sdf", joint, joint.replace("revolute", "prismatic")) for joint in joints))))
    assert [joint.type_name() for joint in robot.joints].count("prismatic") == len(joints)
    assert model_complaints(robot) == []


@pytest.mark.parametrize(("part", "factor"), [
    ("inertia", 1.001), ("weight", 1.001), ("drag_quadratic", 1.01), ("joint_damping", 1.01)])
def test_a_wrong_model_is_seen_in_its_forces_and_in_its_power(part, factor, uvms, monkeypatch):
    """The power needs no equation of motion, only that energy is kept but for what drag takes."""
    def scaled(robot):
        links = read_links(robot)
        return replace(links, **{part: factor * getattr(links, part)})

    monkeypatch.setattr(uvms_model, "read_links", scaled)
    keys = " ".join(complaint.key for complaint in model_complaints(uvms))
    assert "force in" in keys
    assert "balance of power" in keys


def test_the_trim_is_that_of_the_parts_one_by_one():
    """Shoulder and elbow at (-0.5, 1.15) rad: the upper arm points down, the forearm up again."""
    uvms = uv.read_uvms(TEMPLATE)
    posture = middle_posture(uvms)
    np.testing.assert_allclose(posture, [-0.5, 1.15])
    trim = trim_of(uvms, posture)
    down = 0.15 * np.sin(0.5)
    upper = np.array([0.42 + 0.15 * np.cos(0.5), 0.0, 0.12 + down])
    fore = np.array([0.42 + 0.3 * np.cos(0.5) + 0.15 * np.cos(0.65), 0.0,
                     0.12 + 2.0 * down - 0.15 * np.sin(0.65)])
    com = (60.0 * np.array([0.0, 0.0, 0.02]) + 1.5 * (upper + fore)) / 63.0
    cob = (61.6 * np.array([0.014, 0.0, -0.03]) + 0.85 * (upper + fore)) / 63.3
    assert (trim.mass, trim.displaced_mass) == pytest.approx((63.0, 63.3))
    np.testing.assert_allclose(trim.center_of_mass, com, atol=1e-12)
    np.testing.assert_allclose(trim.center_of_buoyancy, cob, atol=1e-12)
    assert trim.righting_lever == pytest.approx(com[2] - cob[2])
