"""Files of others with one random mistake: thrusters, limits of joints and tip.

A file with a mistake is refused, has a line that the file without it has not, or is read as a
second reader reads it: poses by NumPy, numbers by their elements, without Drake.
"""

import random
import re
from collections import Counter
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from support.robot_files import FILES, FLIP, PlainUrdf, turn
from support.robot_mutations import mutated_xml

import uvms_drake as uv
from uvms_drake.model.propulsion.thrusters import curve_at
from uvms_drake.model.robot_import.importer import import_robot
from uvms_drake.model.robot_import.tree import Notes
from uvms_drake.plant.model_check import sound_robot

COMMANDS = np.array([-300.0, -80.0, -40.0, -2.4, -0.01, 0.0, 0.01, 2.4, 2.6, 40.0, 80.0, 300.0])
SOURCES = {
    "pilot.sdf": ("base_link", ["shoulder", "upper", "fore"]),
    "dead_band.sdf": ("base_link", ["boom", "stick"]),
    "light_rov.urdf": ("base_link", ["alpha_joint_shoulder", "alpha_joint_upper_arm",
                                     "alpha_joint_forearm", "alpha_joint_wrist"])}
"""Files, their vehicles, and the joints of their arms (of SDFormat without `_joint`)."""


def words(node: ElementTree.Element, path: str, default: str = "") -> np.ndarray:
    return np.array([float(word) for word in (node.findtext(path) or default).split()])


def pose(node: ElementTree.Element) -> np.ndarray:
    """Returns the pose (4, 4) of an element of SDFormat."""
    x, y, z, roll, pitch, yaw = words(node, "pose", "0 0 0 0 0 0")
    X = np.eye(4)
    X[:3, :3] = turn([0, 0, 1], yaw) @ turn([0, 1, 0], pitch) @ turn([1, 0, 0], roll)
    X[:3, 3] = x, y, z
    return X


def of_sdf(file: Path, arm: list[str]) -> dict[str, np.ndarray]:
    """Returns limits of the arm, tip, and of each thruster its place, axis and forces."""
    model = ElementTree.parse(file).getroot().find("model")
    links = {link.get("name"): pose(link) for link in model.iterfind("link")}
    joints = {joint.get("name"): joint for joint in model.iterfind("joint")}
    inverse = np.linalg.inv(links["base_link"])
    (tip,) = model.iterfind("frame")
    found = {"tip": FLIP @ (inverse @ links[tip.get("attached_to")] @ pose(tip))[:3, 3],
             "limits": np.array([[words(joints[f"{name}_joint"], f"axis/limit/{key}")[0]
                                  for key in ("lower", "upper")] for name in arm])}
    pilots = {control.findtext("jointName"): sorted(
        float(control.findtext("multiplier", "1")) * (float(control.findtext("offset", "0")) + x)
        for x in (0.0, 1.0)) for control in model.iterfind("plugin/control")
        if control.findtext("type") == "COMMAND"}
    for plugin in model.iterfind("plugin"):
        if (name := plugin.findtext("joint_name")) is None:
            continue
        joint = joints[name]
        X = inverse @ links[joint.findtext("child")]
        least, most = (words(plugin, key) for key in ("min_thrust_cmd", "max_thrust_cmd"))
        ends = pilots.get(name) if not least.size and not most.size else [
            *(least if least.size else -most), *(most if most.size else -least)]
        force = np.clip(COMMANDS, *ends)
        band = words(plugin, "deadband", "0")
        force = np.where(np.abs(force) < band, 0.0, force)
        axis = X[:3, :3] @ words(joint, "axis/xyz", "0 0 1")
        found[joint.findtext("child")] = np.concatenate(
            [FLIP @ X[:3, 3], FLIP @ axis / np.linalg.norm(axis), force])
    return found


def of_urdf(file: Path, arm: list[str]) -> dict[str, np.ndarray]:
    """The same of a URDF whose rotors push along their axes; their forces are not known."""
    tree = PlainUrdf(file, {})
    found = {"tip": tree.in_frd("base_link", "alpha_tcp")[:3, 3],
             "limits": np.array([[float(tree.joints[name].find("limit").get(key))
                                  for key in ("lower", "upper")] for name in arm])}
    for name, joint in tree.joints.items():
        if name.startswith("thruster"):
            link = joint.find("child").get("link")
            X = tree.in_frd("base_link", link)
            axis = X[:3, :3] @ np.array([float(x) for x in joint.find("axis").get("xyz").split()])
            found[link] = np.concatenate([X[:3, 3], axis / np.linalg.norm(axis)])
    return found


def of_robot(robot: uv.Robot, forces: bool) -> dict[str, np.ndarray]:
    """Returns the same of a robot that was imported."""
    model, thrusters = uv.UvmsModel(robot.uvms), robot.uvms.thrusters
    found = {"tip": model.task_pose(np.zeros(model.size))[:3],
             "limits": np.stack([model.q_lower, model.q_upper], axis=1)}
    for name, thruster in thrusters.thrusters.items():
        curve = curve_at(thrusters.kinds[thruster.kind], None)
        axis = np.asarray(thruster.axis) / np.linalg.norm(thruster.axis)
        found[name] = np.concatenate([thruster.position, axis, [
            curve.force_of(u) for u in COMMANDS] if forces else []])
    return found


def outcome(file: Path, known: set[str], arm: list[str], folder: Path) -> str:
    """Returns what becomes of a file with a mistake, or what is wrong with that."""
    try:
        imported = import_robot(file, "found")
        for path, data in imported.files.items():
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            (folder / path).write_bytes(data)
        robot = sound_robot(str(folder))
    except uv.InvalidParameter as error:
        return "refused" if str(error) and "\n" not in str(error) else "refused without a line"
    if {*without_lines(imported.notes)} - known:
        return "noted"
    is_sdf = file.suffix == ".sdf"
    try:
        expected = (of_sdf if is_sdf else of_urdf)(file, arm)
    except (ValueError, TypeError, KeyError, AttributeError, IndexError) as error:
        return f"read, though the file is not legal: {error!r}"
    found = of_robot(robot, is_sdf)
    if found.keys() != expected.keys():
        return f"silent in names: {found.keys() ^ expected.keys()}"
    silent = [key for key, value in expected.items() if value.shape != found[key].shape
              or not np.allclose(value, found[key], rtol=1e-6, atol=1e-6)]
    return f"silent in {silent}" if silent else "read as it is"


def test_both_readers_agree_on_files_without_mistakes(tmp_path):
    for name, (_, arm) in SOURCES.items():
        folder = tmp_path / name.split(".")[0] / "found"
        assert outcome(FILES / name, {*lines(name)}, arm, folder) == "read as it is", name


def without_lines(notes: Notes) -> list[str]:
    """Returns the list of an import without line numbers, which a mistake may move."""
    return [re.sub(r"line \d+", "line", each)
            for each in (*notes.taken, *notes.changed, *notes.asked)]


def lines(name: str) -> list[str]:
    return without_lines(import_robot(FILES / name, "found").notes)


@pytest.mark.parametrize("seeds", [
    range(20), pytest.param(range(20, 1020), marks=pytest.mark.long)], ids=["few", "many"])
def test_no_mistake_is_silent_in_thrusters_limits_and_tip(seeds, tmp_path):
    known, found = {name: {*lines(name)} for name in SOURCES}, dict[str, list[str]]()
    for seed in seeds:
        rng = random.Random(seed)
        name = rng.choice(list(SOURCES))
        text, mistake = mutated_xml((FILES / name).read_text("utf-8"), rng)
        file = tmp_path / name
        file.write_text(text, encoding="utf-8")
        end = outcome(file, known[name], SOURCES[name][1], tmp_path / str(seed) / "found")
        found.setdefault(end, []).append(f"{seed}, {name}: {mistake}")
    counts = Counter({key: len(cases) for key, cases in found.items()})
    print(counts)
    assert {key: cases for key, cases in found.items()
            if key not in ("refused", "noted", "read as it is")} == {}
    assert counts["refused"] + counts["noted"] > 0.2 * len(seeds)
    assert counts["read as it is"] > 0.1 * len(seeds)
