"""Measurements in other axes: the same motion, and a frame that is flipped is refused."""

import numpy as np
import pytest
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

import uvms_drake as uv
from uvms_drake.common.errors import InvalidFile
from uvms_drake.model.end_effector import force_in_tip
from uvms_drake.sensing.conventions import Conventions, check_frames, load_conventions

ENU = RotationMatrix(np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]]))  # NED axes in ENU.
FLU = RotationMatrix(np.diag([1.0, -1, -1]))  # FRD axes in FLU.
RPY, P = [0.1, -0.2, 2.5], [1.0, -2.0, 30.0]
V, W = np.array([0.3, -0.1, 0.05]), np.array([0.02, -0.07, 0.2])
JOINTS, RATES = np.array([0.1, 0.9, 0.4, -0.2]), np.array([0.01, 0.2, -0.3, 0.04])


def measured(world: str, body: str, attitude: str) -> dict:
    """Returns the motion above as other axes have it, by Drake's transforms."""
    to_world = RotationMatrix() if world == "NED" else ENU
    to_body = RotationMatrix() if body == "FRD" else FLU
    R_NB = RotationMatrix(RollPitchYaw(RPY))
    R = to_world @ R_NB @ to_body.inverse()
    q: Quaternion = R.ToQuaternion()
    return {"position": to_world @ np.array(P), "velocity": to_body @ V, "turning": to_body @ W,
            "attitude": {"rpy": RollPitchYaw(R).vector(), "wxyz": q.wxyz(),
                         "xyzw": q.wxyz()[[1, 2, 3, 0]]}[attitude]}


@pytest.mark.parametrize("world", ["NED", "ENU"])
@pytest.mark.parametrize("body", ["FRD", "FLU"])
@pytest.mark.parametrize("attitude", ["rpy", "wxyz", "xyzw"])
def test_the_same_motion_in_all_axes_is_the_same_state(world, body, attitude):
    conventions = Conventions(world, body, attitude, joint_signs=np.array([1.0, -1, 1, 1]),
                              joint_offsets=np.array([0.0, 0.5, 0, 0]))
    signs, offsets = conventions.joint_signs, conventions.joint_offsets
    given = measured(world, body, attitude)
    expected = np.concatenate([P, RPY, JOINTS, V, W, RATES])
    others = {"joints": signs * (JOINTS - offsets), "joint_rates": signs * RATES}
    np.testing.assert_allclose(conventions.state(**given, **others), expected, atol=1e-12)
    # The same with the velocity in the axes of the world.
    conventions.velocity = "world"
    R_NB = RotationMatrix(RollPitchYaw(RPY))
    given["velocity"] = (ENU if world == "ENU" else RotationMatrix()) @ R_NB @ V
    np.testing.assert_allclose(conventions.state(**given, **others), expected, atol=1e-12)


def test_a_force_on_the_sensor_is_minus_that_on_the_surface_about_the_tip():
    """By virtual power, in the axes of the tip: the sensor's wrench, moved by Drake's transform."""
    model = uv.load_model(uv.load_scenario("girona500_ideal"))
    mounting, wrench = np.array([0.0, 0.02, -0.1, 0.3, -0.2, 0.5]), np.array(
        [3.0, -1.0, 20.0, 0.1, 0.2, -0.3])
    conventions = Conventions(force="on_sensor", mounting=mounting)
    state = conventions.state(P, [0.1, -0.2, 0.3], JOINTS, V, W, RATES)
    force = conventions.contact_force(model, state, wrench)
    X_ES = RigidTransform(RollPitchYaw(mounting[3:]), mounting[:3])
    f = X_ES.rotation() @ -wrench[:3]
    moment = X_ES.rotation() @ -wrench[3:] + np.cross(mounting[:3], f)
    np.testing.assert_allclose(force_in_tip(model.task_pose(state[:10])[:6], force),
                               np.concatenate([f, moment]), atol=1e-9)


def samples(world: str, body: str, turn: np.ndarray) -> tuple:
    """Returns time, attitude, accelerometer and gyro over a turn of the body [rad] in 1 s."""
    to_world, to_body = ENU if world == "ENU" else RotationMatrix(), (
        FLU if body == "FLU" else RotationMatrix())
    time, attitudes, forces = np.linspace(0.0, 1.0, 21), [], []
    start = RotationMatrix(RollPitchYaw(0.05, -0.04, 1.0))
    for t in time:
        R = start @ RotationMatrix(RollPitchYaw(turn * t))
        forces.append(to_body @ (R.inverse() @ np.array([0.0, 0.0, -9.81])))
        attitudes.append(RollPitchYaw(to_world @ R @ to_body.inverse()).vector())
    return time, np.array(attitudes), np.array(forces), np.tile(to_body @ turn, (21, 1))


@pytest.mark.parametrize("world", ["NED", "ENU"])
@pytest.mark.parametrize("body", ["FRD", "FLU"])
def test_samples_in_the_declared_axes_pass_and_tell_which_axes_they_have_shown(world, body):
    seen = check_frames(Conventions(world, body), *samples(world, body, np.array([0, 0, 0.2])))
    assert seen == "yaw"
    still = samples(world, body, np.zeros(3))
    assert check_frames(Conventions(world, body), *still) == "none but up"


@pytest.mark.parametrize(("declared", "real", "turn"), [
    (("NED", "FLU"), ("NED", "FRD"), 0.0), (("NED", "FRD"), ("NED", "FLU"), 0.0),
    (("NED", "FRD"), ("ENU", "FRD"), 0.0), (("ENU", "FLU"), ("NED", "FLU"), 0.0),
    (("ENU", "FRD"), ("NED", "FRD"), 0.2), (("ENU", "FLU"), ("NED", "FRD"), 0.2)])
def test_a_flipped_frame_is_refused_in_one_line(declared, real, turn):
    with pytest.raises(uv.InvalidParameter, match=r"signals\.yaml = .*other axes") as caught:
        check_frames(Conventions(*declared), *samples(*real, np.array([0.0, 0.0, turn])))
    assert "\n" not in str(caught.value)


def test_a_gyro_of_the_wrong_sense_is_refused_once_the_vehicle_turns():
    time, attitude, force, gyro = samples("NED", "FRD", np.array([0.0, 0.0, 0.2]))
    with pytest.raises(uv.InvalidParameter, match=r"turns by 0\.2 rad in yaw where the gyro turns"):
        check_frames(Conventions(), time, attitude, force, -gyro)


@pytest.mark.parametrize(("line", "text"), [
    ("world: NWU", "line 1: world = 'NWU': must be"), ("joint_signs: [1.0, 0.5]", "1 or -1 each"),
    ("frame: NED", "frame")])
def test_a_bad_file_is_one_line(tmp_path, line, text):
    path = tmp_path / "signals.yaml"
    path.write_text(f"{line}\n")
    with pytest.raises(InvalidFile, match=text) as caught:
        load_conventions(path)
    assert "\n" not in str(caught.value)
    path.write_text("world: ENU\nbody: FLU\nattitude: xyzw\n")
    assert load_conventions(path).attitude == "xyzw"
