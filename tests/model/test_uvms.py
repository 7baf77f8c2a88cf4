"""Tests of `uvms_drake.model.uvms`."""

import shutil
from pathlib import Path

import pytest
from pydrake.multibody.plant import MultibodyPlant

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.model.description.robot_files import model_dir
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
