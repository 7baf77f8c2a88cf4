"""`plant.model_error`: what is multiplied, and by what."""

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant
from support.true_model import model_with_error

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.model.surface.law import check_surface
from uvms_drake.model.uvms import model_dir
from uvms_drake.plant.model_error import (
    ModelError,
    add_simulated_uvms,
    check_model_error,
    scaled_inertias,
)

ROBOT = "girona500_arm5e"
LEVEL = np.array([-3.0, 0.0, 0.0, 0.0, 0.0, 0.3, 0.1, 0.9, 0.4, 0.2])


@pytest.fixture(scope="module")
def load(plane):
    return lambda error=None: model_with_error(ROBOT, check_surface(plane), error)


def mass_matrix(model):
    return model.mass_matrix(model.kinematics(LEVEL))


def force_at_rest(model, config=LEVEL):
    return model.inverse_dynamics(model.kinematics(config), np.zeros(10), np.zeros(10))


def test_no_error_is_the_same_robot(load):
    np.testing.assert_array_equal(mass_matrix(load(ModelError())), mass_matrix(load()))
    np.testing.assert_allclose(force_at_rest(load(ModelError())), force_at_rest(load()), atol=1e-9)
    assert ModelError(share=0.5).size == 0.0
    assert ModelError(drag=0.8, mass=1.1).size == pytest.approx(0.2)


def test_the_inertia_is_what_the_two_masses_make_of_it(load):
    """It is linear in both, but for the reflected inertia of the motors, which has no error."""
    whole = mass_matrix(load())
    dry = mass_matrix(load(ModelError(mass=2.0))) - whole
    wet = mass_matrix(load(ModelError(added_mass=2.0))) - whole
    both = mass_matrix(load(ModelError(mass=1.1, added_mass=0.8)))
    np.testing.assert_allclose(both, whole + 0.1 * dry - 0.2 * wet, atol=1e-9)
    assert dry[0, 0] > 180.0
    assert wet[0, 0] > 100.0


def test_the_trim_scales_with_the_mass_and_the_lever_turns(load):
    weight = force_at_rest(load())
    np.testing.assert_allclose(force_at_rest(load(ModelError(mass=1.2))), 1.2 * weight, atol=1e-6)
    rolled = LEVEL + np.eye(10)[3] * 0.1
    stiffer = force_at_rest(load(ModelError(buoyancy_lever=1.5)), rolled)
    np.testing.assert_allclose(stiffer[:3], force_at_rest(load(), rolled)[:3], atol=1e-9)
    assert stiffer[3] > force_at_rest(load(), rolled)[3] + 5.0  # N m, to hold the roll


def test_drag_is_all_that_changes_with_the_drag(load):
    zeta = np.repeat([0.2, 0.1, 0.3], [3, 3, 4])

    def force(error, speed):
        model = load(error)
        return model.inverse_dynamics(model.kinematics(LEVEL), speed, np.zeros(10))

    off = ModelError(drag=1.3)
    np.testing.assert_allclose(force(off, 0.0 * zeta), force(None, 0.0 * zeta), atol=1e-9)
    assert force(off, zeta)[0] > force(None, zeta)[0] + 1.0


def test_the_files_of_the_robot_are_read_as_they_are():
    text = (model_dir(ROBOT) / f"{ROBOT}.sdf").read_text(encoding="utf-8")
    assert scaled_inertias(text, 1.1).count("<mass>198.0") == 1
    assert "<ixx>1.0</ixx> <izz>0.004" in scaled_inertias("<ixx>0.5</ixx> <izz> 2e-3 </izz>", 2.0)


WHOLE = """<link name="vehicle"><inertial><mass>3</mass><inertia><ixx>1</ixx><iyy>1</iyy>
  <izz>1</izz><ixy>0</ixy><ixz>0</ixz><iyz>0</iyz></inertia></inertial></link>"""
ARM = """<robot name="arm"><link name="upper"><inertial><mass value="2"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"""


@pytest.mark.parametrize(("rest", "body"), [
    ("", ""),
    ("<include merge='true'><uri>package://diver/arm.urdf</uri></include>", "upper"),
    ("<include><uri>package://diver/arm.urdf</uri></include>", "upper"),
    ("<link name='base'/>", "base"),
    ("<link name='base'><inertial><mass>2</mass></inertial></link>", "base")])
def test_a_mass_that_is_not_written_in_the_file_itself_is_not_scaled_by_halves(
        tmp_path, rest, body):
    """It would leave the inertia of an included arm as it is, but not the volume."""
    folder = tmp_path / "diver"
    folder.mkdir()
    (folder / "diver.sdf").write_text(
        f'<sdf version="1.9"><model name="diver">{WHOLE}{rest}'
        '<frame name="tip" attached_to="vehicle"/></model></sdf>')
    (folder / "arm.urdf").write_text(ARM)
    (folder / "hydrodynamics.yaml").write_text("{}")
    (folder / "package.xml").write_text("<package><name>diver</name></package>")
    add_simulated_uvms(MultibodyPlant(0.0), str(folder), ModelError(drag=1.1))
    if not body:
        plant = MultibodyPlant(0.0)
        add_simulated_uvms(plant, str(folder), ModelError(mass=1.1))
        assert plant.GetBodyByName("vehicle").default_mass() == pytest.approx(3.3)
        return
    with pytest.raises(InvalidParameter,
                       match=rf"^model_error\.mass = 1\.1: must be 1 .* '{body}' by numbers"):
        add_simulated_uvms(MultibodyPlant(0.0), str(folder), ModelError(mass=1.1))


@pytest.mark.parametrize(("error", "key"), [
    (ModelError(mass=0.0), "mass"), (ModelError(drag=-1.0), "drag"),
    (ModelError(added_mass=np.inf), "added_mass"), (ModelError(buoyancy_lever=np.nan), "buoyancy"),
    (ModelError(share=1.0), "share")])
def test_what_no_robot_has_is_refused(error, key):
    with pytest.raises(InvalidParameter, match=f"^{key}"):
        check_model_error(error)
