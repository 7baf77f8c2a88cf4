"""The sub-command `robot`."""

from pathlib import Path

import numpy as np
import pytest
from support.robots import TEMPLATE, altered
from support.snapshot import check_snapshot

from uvms_drake.command.main import main
from uvms_drake.model.robot import Robot
from uvms_drake.plant.model_check import complaints_about
from uvms_drake.report.robot.robot_page import sweeps


def test_a_new_robot_is_sound_and_has_the_name_of_its_folder(tmp_path, capsys):
    robot = tmp_path / "robots" / "my_robot"
    assert main(["robot", "--new", str(robot)]) == 0
    assert capsys.readouterr().out == (
        f"written to {robot}; 'uvms-drake robot {robot}' shows it\n")
    assert {path.name for path in robot.iterdir()} == {
        "my_robot.sdf", "hydrodynamics.yaml", "package.xml"}
    assert not any(TEMPLATE in path.read_text(encoding="utf-8") for path in robot.iterdir())
    assert main(["robot", str(robot)]) == 0
    assert capsys.readouterr().out.startswith("my_robot: 2 joints, no thrusters.yaml\nmass  ")


@pytest.mark.parametrize("robot", ["box_uvms", "bluerov2_alpha5", "girona500_arm5e"])
def test_a_sheet_reads_as_stored(robot, capsys):
    assert main(["robot", robot]) == 0
    check_snapshot(f"robot_{robot}", capsys.readouterr().out)


def test_a_new_robot_that_cannot_be_written_whole_leaves_nothing(tmp_path, monkeypatch, capsys):
    write = Path.write_bytes

    def full(path: Path, content: bytes) -> int:
        if path.suffix == ".xml":
            raise OSError(28, "No space left on device")
        return write(path, content)

    monkeypatch.setattr(Path, "write_bytes", full)
    assert main(["robot", "--new", str(tmp_path / "my_robot")]) == 2
    assert "a path that can be written to (No space left" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("args", "expected"), [
    (["--new", "my-robot"], "--new = 'my-robot': must be a folder by the name of the robot"),
    (["--new", "."], "--new = '.': must be a folder by the name of the robot"),
    (["--new", "there"], "--new = 'there': must be a folder that is not there yet"),
    (["--new", "/dev/null/mine"], "--new = '/dev/null/mine': must be a path that can be written"),
    (["box_uvms", "--new", "mine"], "ROBOT = 'box_uvms': must be a robot's name or folder; or"),
    ([], "ROBOT = None: must be a robot's name or folder"),
    (["--new", "mine", "--output", "out"], "--output = 'out': must be left out, with --new"),
    (["box_uvms", "--posture", "0.1"], "--posture = [0.1]: must be 2 finite numbers"),
    (["submarine"], "model = 'submarine': must be one of bluerov2_alpha5, box_uvms,")])
def test_bad_input_is_refused_in_a_line(args, expected, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there").mkdir()
    assert main(["robot", *args]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith(f"uvms-drake: error: {expected}")
    assert err.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["there"]


def test_every_mistake_has_a_line(tmp_path, capsys):
    robot = altered(tmp_path, (".yaml", "61.6e-3", "61.6"),
                    (".sdf", "<pose>0 0 0.02", "<pose>0 0 -9"))
    assert main(["robot", str(robot)]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    first, second = err.splitlines()
    assert "hydrodynamics.yaml: displaced_volume of all bodies" in first
    assert "hydrodynamics.yaml: center_of_buoyancy of all bodies" in second


def test_the_tip_is_told_for_a_posture(capsys):
    """Shoulder at (0.42, 0.12) m, the upper arm 0.6 rad down, the forearm level."""
    assert main(["robot", "box_uvms", "--posture", "-0.6", "0.6"]) == 0
    assert "\ntip         (0.968, 0, 0.289) m, (roll, pitch, yaw) (0, 0, 0)°" in (
        capsys.readouterr().out)


def test_each_joint_goes_through_its_limits_alone():
    posture, lower, upper = np.array([0.2, 0.0]), np.array([-1.0, -np.inf]), np.array([0.5, np.inf])
    frames = sweeps(posture, lower, upper)
    np.testing.assert_allclose(frames.min(axis=0), [-1.0, -np.pi], atol=0.01)
    np.testing.assert_allclose(frames.max(axis=0), [0.5, np.pi], atol=0.01)
    assert np.all(np.any(np.isclose(frames, posture), axis=1))
    np.testing.assert_array_equal(frames[[0, -1]], [posture, posture])


URDF = """<robot name="urdf_robot">
  <link name="vehicle"><inertial><mass value="20"/>
    <inertia ixx="1" iyy="1" izz="1.2" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="arm"><inertial><origin xyz="0.2 0 0"/><mass value="1"/>
    <inertia ixx="0.001" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="vehicle"/><child link="arm"/>
    <origin xyz="0.4 0 0.1"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="10" velocity="1"/></joint>
  <frame name="tip" link="arm" xyz="0.4 0 0" rpy="0 0 0"/>
  <transmission name="t"><type>transmission_interface/SimpleTransmission</type>
    <joint name="shoulder"><hardwareInterface>effort</hardwareInterface></joint>
    <actuator name="motor"><drake:rotor_inertia xmlns:drake="drake" value="0.1"/></actuator>
  </transmission>
</robot>"""


def test_a_robot_may_be_a_urdf(tmp_path, capsys):
    robot = tmp_path / "urdf_robot"
    robot.mkdir()
    (robot / "urdf_robot.urdf").write_text(URDF, encoding="utf-8")
    (robot / "package.xml").write_text("<package><name>urdf_robot</name></package>")
    (robot / "hydrodynamics.yaml").write_text(
        "bodies: {vehicle: {displaced_volume: 21.0e-3, center_of_buoyancy: [0, 0, -0.05]}}")
    assert complaints_about(Robot.load(robot)) == []
    assert main(["robot", str(robot)]) == 0
    out = capsys.readouterr().out
    assert out.startswith("urdf_robot: 1 joints")
    assert "note: dry, as hydrodynamics.yaml does not name it: arm\n" in out
