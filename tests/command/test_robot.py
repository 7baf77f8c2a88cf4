"""The sub-command `robot`, and `robot --from`: robots' folders out of files as they are found."""

import json
import re
import runpy
import shutil
from pathlib import Path

import numpy as np
import pytest
from support.robot_files import FILES, NAMES
from support.robots import TEMPLATE, altered
from support.snapshot import check_snapshot

from uvms_drake.command.main import main
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


CASES = runpy.run_path(str(
    Path(__file__).parents[2] / "examples" / "results" / "robot_import.py"))["CASES"]


def take(file: Path, robot: Path) -> int:
    return main(["robot", "--from", str(file), str(robot)])


@pytest.mark.parametrize("name", NAMES)
def test_what_it_writes_is_accepted_without_an_edit(name, tmp_path, capsys):
    robot = tmp_path / "robots" / "found"
    assert take(FILES / name, robot) == 0
    out = capsys.readouterr().out
    check_snapshot(f"robot_from_{name.split('.')[0]}", out, tmp_path / "robots")
    assert out.split("\nwritten to ")[0].strip() in (robot / "README.md").read_text("utf-8")
    assert main(["robot", str(robot)]) == 0
    assert capsys.readouterr().err == ""


def test_a_folder_may_be_named_from_where_one_is(tmp_path, monkeypatch, capsys):
    """Its meshes are found, too."""
    monkeypatch.chdir(tmp_path)
    assert take(FILES / "heavy_rov.urdf", Path("found")) == 0
    assert main(["robot", "found"]) == 0
    assert "hull" not in capsys.readouterr().out.split("written to")[1]


def changed(name: str, folder: Path, *changes: tuple[str, str]) -> Path:
    """Returns a copy of a file, in a copy of its folder, in which texts are replaced once."""
    shutil.copytree(FILES, folder / "files")
    file = folder / "files" / name
    text = file.read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new, 1)
    file.write_text(text, encoding="utf-8")
    return file


FIRST_MASS = '<mass value="62"/>'


@pytest.mark.parametrize(("name", "old", "new", "expected"), [
    ("dummy_root.urdf", "<robot", "<rabbit", "must be XML"),
    ("dummy_root.urdf", FIRST_MASS, '<mass value="6,2"/>', "value = '6,2': must be a number, deci"),
    ("dummy_root.urdf", FIRST_MASS, '<mass value="${m}"/>', "a number: xacro has to be run first"),
    ("dummy_root.urdf", FIRST_MASS, '<mass value="-62"/>', "mass = -62.0: must be zero or positi"),
    ("dummy_root.urdf", FIRST_MASS, FIRST_MASS + '<mass value="6"/>', "mass: must be there once"),
    ("dummy_root.urdf", FIRST_MASS, '<mas value="62"/>', "(did you mean 'mass'?)"),
    ("dummy_root.urdf", 'xyz="0.01 0 -0.02"', 'xyz="10 0 -20"', "within 10 m of the origin"),
    ("dummy_root.urdf", 'ixx="2.1183"', 'ixx="2118300"', "that of 62 kg within 10 m (units"),
    ("dummy_root.urdf", '<child link="boom"/>', '<child link="bom"/>', "find link named 'bom'"),
    ("dummy_root.urdf", '<child link="boom"/>', '<child link="stick"/>', "(a closed loop)"),
    ("dummy_root.urdf", '<link name="skid">', '<link name="hull">', "name = 'hull': must be given"),
    ("dummy_root.urdf", "<link", '<xacro:arm x="1"/><link', "must be expanded: by the program xa"),
    ("dummy_root.urdf", 'lower="-1.2" upper="1.2"', 'lower="1" upper="-1"', "lower, then upper"),
    ("nested.sdf", "model://nested_arm", "model://arm_of_others", "must be the file of a model"),
    ("nested.sdf", "model://nested_arm", "nested.sdf", "a file that does not include itself"),
    ("nested.sdf", "arm_mount\">0", "mount\">0", "mount] specified by model with name[arm] does"),
    ("nested.sdf", '<joint name="lamp_joint" type="fixed"><parent>base</parent>'
     "<child>lamp::housing</child></joint>", "", "'lamp::housing': must be joined to 'base'"),
    ("plugins.sdf", "<mass>56</mass>", "", "inertial.mass: must be there"),
    ("plugins.sdf", "<xDotU>-22.1", "<xDotU>22,1", " xDotU = '22,1': must be one number"),
    ("rounded.urdf", " 9.8837 ", " 98.837 ", "added_mass[3][6] = 9.8836: must be that of [6][3]"),
    ("rounded.urdf", " 9.8837 ", " ", "'35 numbers': must be 6 or 36 numbers")])
def test_a_mistake_is_a_line_and_nothing_is_written(name, old, new, expected, tmp_path, capsys):
    file = changed(name, tmp_path, (old, new))
    assert take(file, tmp_path / "found") == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert expected in err
    assert err.startswith("uvms-drake: error: ")
    assert err.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["files"]


def test_what_a_format_would_take_by_default_and_what_is_not_known_are_told(tmp_path, capsys):
    text = (FILES / "plugins.sdf").read_text("utf-8").replace("<xDotU>", "<xDotX>", 1).replace(
        "</xDotU>", "</xDotX>", 1)
    before, _, after = text.partition("<inertia>")
    file = tmp_path / "plain.sdf"
    file.write_text(before + after.partition("</inertia>")[2], encoding="utf-8")
    assert take(file, tmp_path / "found") == 0
    out = capsys.readouterr().out
    assert "base_link: no <inertia>, for which SDFormat takes 1 kg m²; taken as a po" in out
    assert "numbers of these plugins left out: xDotX = -22.1 (line 1" in out


def test_of_two_arms_one_is_held_fast_and_told(tmp_path, capsys):
    """A second arm of as many joints; that of the better names is taken."""
    text = (FILES / "dummy_root.urdf").read_text("utf-8")
    second = "".join(
        f'<link name="b{i}"><inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01"/>'
        f'</inertial></link><joint name="j{i}" type="revolute"><parent link="{before}"/>'
        f'<child link="b{i}"/><origin xyz="0.1 0 0"/><axis xyz="0 1 0"/>'
        '<limit lower="0.5" upper="1" effort="9" velocity="1"/></joint>'
        for i, before in enumerate(("hull", "b0", "b1")))
    file = tmp_path / "two.urdf"
    file.write_text(text.replace("</robot>", f"{second}</robot>"), encoding="utf-8")
    assert take(file, tmp_path / "found") == 0
    out = capsys.readouterr().out
    assert "arm: 3 joints, shoulder_joint, boom_joint, stick_joint" in out
    assert "another arm, of 'j0' to 'j2', is fixed" in out
    assert "fixed, not in the chain: j0 at 0.5, j1 at 0.5, j2 at 0.5" in out


def test_rotors_that_nothing_turns_and_an_arm_on_the_side_are_asked_about(tmp_path, capsys):
    text = (FILES / "light_rov.urdf").read_text("utf-8")
    text = text.replace('type="continuous"', 'type="fixed"').replace("0.2 0 -0.12", "0 0.4 -0.12")
    file = tmp_path / "side.urdf"
    file.write_text(text, encoding="utf-8")
    assert take(file, tmp_path / "found") == 0
    asked = capsys.readouterr().out.split("For you to give")[1]
    assert "thruster8_joint are of rotors by their names" in asked
    assert re.search(r"the axes: the arm begins at \(0\.0\d, -0\.3\d, 0\.1\d\) m", asked)
    assert not (tmp_path / "found" / "thrusters.yaml").exists()


def test_a_vehicle_without_an_arm_is_a_robot(tmp_path, capsys):
    text = (FILES / "dummy_root.urdf").read_text("utf-8").replace('type="revolute"', 'type="fixed"')
    file = tmp_path / "still.urdf"
    file.write_text(text, encoding="utf-8")
    assert take(file, tmp_path / "found") == 0
    assert "arm: none, for no joint moves" in capsys.readouterr().out
    assert main(["robot", str(tmp_path / "found")]) == 0


@pytest.mark.long
@pytest.mark.parametrize("name", NAMES)
def test_from_the_file_to_a_certified_press(name, tmp_path, monkeypatch, capsys):
    """Every step with what the one before has written, and no edit in between."""
    monkeypatch.chdir(tmp_path)
    force = CASES[name].force
    for command in (f"robot --from {FILES / name} found", "robot found",
                    f"scenario --new press.yaml --robot found --force {force:g}",
                    "certify press.yaml --quiet",
                    "run press.yaml --quiet --no-figures --no-replay --output out/run"):
        assert main(command.split()) == 0, (command, capsys.readouterr())
    summary = json.loads((tmp_path / "out/run/summary.json").read_text("utf-8"))
    assert summary["tube"]["certified"]
    assert summary["force"]["settling_time_s"] < 6.0
    assert summary["force"]["worst_error_norm_after_settling"] <= 0.1 * force
    assert summary["tube"]["exits"] == summary["tube"]["exits_along_the_run"] == 0
