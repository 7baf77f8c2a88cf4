"""Tests of `uvms_drake.model.uvms`."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.model.description.robot_folder import model_dir, models_dir
from uvms_drake.model.uvms import Uvms, add_uvms

SHIPPED = "girona500_arm5e"


def _add(model: str) -> Uvms:
    plant = MultibodyPlant(time_step=0.0)
    uvms = add_uvms(plant, model)
    plant.Finalize()
    return uvms


def _write_robot(folder: Path, joints: list[tuple[str, str, str]], *, tip: str = "tip") -> Path:
    """Writes a robot of unit bodies, with (type, parent, child) of each joint.

    Returns:
        Its folder.
    """
    names = dict.fromkeys(["vehicle", *(name for _, *pair in joints for name in pair)])
    links = "".join(
        f"<link name='{name}'><inertial><mass>1</mass><inertia><ixx>1</ixx><iyy>1</iyy><izz>1</izz>"
        "</inertia></inertial></link>" for name in names)
    elements = "".join(
        f"<joint name='to_{child}' type='{kind}'><parent>{parent}</parent><child>{child}</child>"
        + ("" if kind == "fixed" else "<axis><xyz>0 0 1</xyz></axis>") + "</joint>"
        for kind, parent, child in joints)
    folder.mkdir()
    (folder / f"{folder.name}.sdf").write_text(
        f"<sdf version='1.9'><model name='{folder.name}'>{links}{elements}"
        f"<frame name='{tip}' attached_to='{list(names)[-1]}'/></model></sdf>")
    (folder / "package.xml").write_text(f"<package><name>{folder.name}</name></package>")
    (folder / "hydrodynamics.yaml").write_text("fluid_density: 1025.0\n")
    return folder


def test_handles_of_a_shipped_robot():
    uvms = _add(SHIPPED)
    assert uvms.vehicle.name() == "vehicle"
    assert uvms.vehicle.is_floating_base_body()
    assert [joint.name() for joint in uvms.joints] == ["joint1", "joint2", "joint3", "joint4"]
    assert len(uvms.joints) == 4
    assert uvms.tip.name() == "tip"
    assert uvms.tip.body().name() == "link4"
    assert uvms.plant.GetModelInstanceName(uvms.model_instance) == SHIPPED
    assert "vehicle" in uvms.hydrodynamics.bodies


def test_gravity_points_along_z_because_the_world_is_ned():
    plant = _add(SHIPPED).plant
    np.testing.assert_array_equal(plant.gravity_field().gravity_vector(), [0.0, 0.0, 9.81])


def test_an_unknown_robot_is_refused_with_the_names_of_those_shipped():
    with pytest.raises(InvalidParameter, match=f"^model = 'titan': must be one of .*{SHIPPED}"):
        add_uvms(MultibodyPlant(time_step=0.0), "titan")


def test_every_shipped_robot_is_found_by_its_name():
    folders = [path.parent for path in models_dir().glob("*/package.xml")]
    assert folders
    for folder in folders:
        assert model_dir(folder.name) == folder


def test_a_robot_may_be_given_by_its_folder(tmp_path):
    copy = shutil.copytree(model_dir(SHIPPED), tmp_path / SHIPPED)
    hydrodynamics = copy / "hydrodynamics.yaml"
    hydrodynamics.write_text(
        hydrodynamics.read_text().replace("fluid_density: 1000.0", "fluid_density: 1025.0"))
    assert _add(str(copy)).hydrodynamics.fluid_density == 1025.0
    assert _add(SHIPPED).hydrodynamics.fluid_density == 1000.0


def test_a_folder_without_a_robot_is_refused(tmp_path):
    with pytest.raises(InvalidParameter, match="or a folder with <name>"):
        add_uvms(MultibodyPlant(time_step=0.0), str(tmp_path))


def test_a_serial_arm_may_hang_on_welded_bodies(tmp_path):
    robot = _write_robot(tmp_path / "welded", [
        ("fixed", "vehicle", "mount"), ("fixed", "mount", "base"),
        ("revolute", "base", "upper"), ("fixed", "upper", "sensor"),
        ("revolute", "sensor", "lower")])
    uvms = _add(str(robot))
    assert [joint.name() for joint in uvms.joints] == ["to_upper", "to_lower"]
    assert uvms.tip.body().name() == "lower"


def test_a_vehicle_without_an_arm_has_no_joints(tmp_path):
    assert _add(str(_write_robot(tmp_path / "bare", []))).joints == ()


def test_a_second_arm_is_refused_by_the_name_of_its_joint(tmp_path):
    robot = _write_robot(tmp_path / "two_arms", [
        ("revolute", "vehicle", "left"), ("revolute", "vehicle", "right")])
    with pytest.raises(
            InvalidParameter, match=r"joint to_left: must be of type fixed, as 'left' is not in"):
        add_uvms(MultibodyPlant(time_step=0.0), str(robot))


def test_a_robot_without_a_tip_is_refused(tmp_path):
    robot = _write_robot(tmp_path / "no_tip", [("revolute", "vehicle", "link")], tip="tool")
    with pytest.raises(InvalidParameter, match="must have a frame 'tip': its frames are"):
        add_uvms(MultibodyPlant(time_step=0.0), str(robot))
