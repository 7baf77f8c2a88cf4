"""A scenario with an unknown wall made for a robot: its numbers, that it certifies, refusals."""

import re

import numpy as np
import pytest
from support.quick import few_in_all_files
from support.robot_files import FILES
from support.robots import copied

import uvms_drake as uv
from uvms_drake.campaign.draws import first_feasible
from uvms_drake.command.main import main
from uvms_drake.model.frames.euler import rotation_matrix
from uvms_drake.setup.calibrate import check_real, with_gains
from uvms_drake.setup.first_scenario import first_scenario, strength_of
from uvms_drake.setup.settle import forbidding
from uvms_drake.station.contact.bounds import largest_force, largest_reading_error
from uvms_drake.station.contact.tube_in_contact import force_bounds
from uvms_drake.station.problem import make_ocp
from uvms_drake.tube.conditions import Condition

FORCE = 20.0
KINDS = {"unknown": "--unknown-wall", "real": "--real-loop"}


@pytest.fixture(scope="module")
def rov(tmp_path_factory):
    """A made-up ROV of eight thrusters with an arm of five joints."""
    folder = tmp_path_factory.mktemp("robots") / "rov"
    assert main(["robot", "--from", str(FILES / "five_joints.urdf"), str(folder)]) == 0
    return folder


@pytest.fixture(scope="module")
def made(rov):
    """Scenarios that the command writes, by kind."""
    out = {}
    for kind, option in KINDS.items():
        file = rov.parent / f"{kind}.yaml"
        assert main(["scenario", "--new", str(file), "--robot", str(rov), "--force", f"{FORCE:g}",
                     option, "--uncertified"]) == 0
        out[kind] = uv.load_scenario(str(file))
    return out


@pytest.mark.parametrize("kind", KINDS)
def test_it_passes_the_check_and_has_a_first_plan(kind, made, rov, capsys):
    scenario = made[kind]
    assert main(["scenario", "--check", str(rov.parent / f"{kind}.yaml")]) == 0
    assert "a valid scenario" in capsys.readouterr().out
    ocp = make_ocp(scenario, uv.load_model(scenario))
    assert first_feasible(scenario, ocp) is not None


@pytest.mark.parametrize("kind", KINDS)
def test_the_class_admits_the_force_with_the_error_of_its_sensor(kind, made):
    scenario = made[kind]
    contact = scenario.contact
    assert contact.force_error >= largest_reading_error(scenario, force_bounds(scenario), 0.0)
    depth = {"unknown": 0.003, "real": 0.008}[kind]
    least = ((FORCE + 2.0 * contact.force_error) / (np.cos(0.0873) - 0.5 * np.sin(0.0873))
             + 2.0 * contact.stiffness * depth)
    assert contact.force == pytest.approx(1.1 * least, rel=6e-3)
    assert largest_force(scenario) > FORCE


@pytest.mark.parametrize("kind", KINDS)
def test_the_inputs_hold_every_force_of_the_class(kind, made):
    """Random tilts, frictions and sizes; what is left is what thrusters and motors have."""
    scenario = made[kind]
    model, rng, contact = uv.load_model(scenario), np.random.default_rng(0), scenario.contact
    config = model.configuration(np.concatenate([scenario.task.pose, scenario.task.posture]))
    at, rest = model.kinematics(config), np.zeros(model.size)
    M, J = model.mass_matrix(at), model.task_jacobian(config)[:3]
    bias = model.inverse_dynamics(at, rest, rest)
    strength = strength_of(uv.read_uvms(scenario.model)).force
    for _ in range(500):
        tilt, turn, slip = rng.uniform(-0.0873, 0.0873, 2), rng.uniform(0.0, 6.3), rng.uniform()
        R = rotation_matrix(np.array([0.0, *tilt / np.sqrt(2.0)]))
        unit = np.array([1.0, 0.5 * slip * np.cos(turn), 0.5 * slip * np.sin(turn)])
        tau = bias + J.T @ (R @ unit * rng.uniform(0.0, contact.force))
        assert np.all(np.abs(np.linalg.solve(M, tau)) < scenario.limits.u)
        assert np.all(np.abs(tau) < strength)
    assert np.all(np.diag(M) * scenario.limits.u < 1.5 * strength)


def test_a_real_loop_is_what_calibrate_takes(made):
    scenario = made["real"]
    model = check_real(scenario)
    assert with_gains(scenario, 0.16, model).ancillary == scenario.ancillary
    # In 0.15 + 0.01 + 0.01 + 0.005 s, and at 1000 N/m, a touch adds 0.3 of the force.
    assert scenario.draws.speed == pytest.approx(0.3 * FORCE / (1000.0 * 0.175), rel=1e-2)
    assert scenario.contact.speed == pytest.approx(
        scenario.draws.speed + scenario.tube.depth_speed, rel=2e-2)
    assert scenario.disturbance.bound == 0.0
    assert [type(part).__name__ for part in (*scenario.sensing, *scenario.actuation)] == [
        "Navigation", "ForceSensor", "SampledCommand", "Thrusters"]


@pytest.mark.long
def test_objects_make_the_same_as_the_command(made, rov):
    scenario = uv.make_scenario(str(rov), force=FORCE, real_loop=True)
    for key in ("contact", "limits", "tube", "ancillary", "draws"):
        now, before = (vars(getattr(each, key)) for each in (scenario, made["real"]))
        for name, value in before.items():
            if isinstance(value, float | np.ndarray):
                np.testing.assert_allclose(now[name], value, rtol=1e-6, err_msg=f"{key}.{name}")


@pytest.mark.parametrize(("old", "new", "said"), [
    ("85</clamp", "30</clamp", "thrusters.yaml gives .* along pitch: an unknown wall, of up to"),
    ('effort="30"', 'effort="4"', "the motor of joint wrist_joint gives 4 N m along q4: an "
     "unknown wall, of up to .* N m more than there is")])
def test_a_robot_that_cannot_is_told_which_number_and_by_how_much(
        old, new, said, tmp_path, capsys):
    file, robot = tmp_path / "wall.yaml", tmp_path / "rov"
    text = (FILES / "five_joints.urdf").read_text("utf-8")
    (tmp_path / "rov.urdf").write_text(text.replace(old, new), encoding="utf-8")
    assert main(["robot", "--from", str(tmp_path / "rov.urdf"), str(robot)]) == 0
    capsys.readouterr()
    status = main(["scenario", "--new", str(file), "--robot", str(robot), "--force", "20",
                   "--real-loop"])
    err = capsys.readouterr().err
    assert status in (1, 2) and err.count("\n") == 1 and re.search(said, err), err
    assert not file.exists()


def test_a_real_loop_needs_thrusters(tmp_path, capsys):
    file = tmp_path / "wall.yaml"
    assert main(["scenario", "--new", str(file), "--robot", "box_uvms", "--real-loop"]) == 2
    assert "the robot has no thrusters.yaml" in capsys.readouterr().err
    assert not file.exists()


def test_a_slow_arm_is_refused_by_its_speed(rov, tmp_path, capsys):
    robot, file = copied(rov, tmp_path, (
        ".sdf", "<velocity>1</velocity>", "<velocity>0.05</velocity>")), tmp_path / "wall.yaml"
    assert main(["scenario", "--new", str(file), "--robot", str(robot), "--force", "20",
                 "--unknown-wall"]) == 2
    assert re.search(r"limits.qdot = 0.05: must be larger than the tube's 0\.\d+",
                     capsys.readouterr().err)
    assert not file.exists()


def test_what_the_certificate_forbids_is_told_by_the_number_of_the_robot():
    found = first_scenario(uv.read_uvms("box_uvms"), 5.0)
    for about, said in (("qdot", "because of the velocity of its joints"),
                        ("u_q2", "because of the motor of joint elbow"), ("roll", "robot: tube")):
        failed = Condition(f"tube in limits.{about}", 0.5, "<", 0.3, about=about, theorem="")
        assert re.match(f"not with this .*{said}.* 0.5 < 0.3 does not hold by 0.2",
                        forbidding(found, failed))


@pytest.mark.long
def test_an_unknown_wall_certifies(rov, tmp_path, monkeypatch, capsys):
    few_in_all_files(monkeypatch)
    file = tmp_path / "wall.yaml"
    assert main(["scenario", "--new", str(file), "--robot", str(rov), "--force", "20",
                 "--unknown-wall", "--quiet"]) == 0
    assert "; certified: all " in capsys.readouterr().out
    assert 0.0 < uv.load_scenario(str(file)).tube.depth < 0.003


@pytest.mark.long
def test_the_certificate_of_an_unknown_wall_holds_with_full_searches(made):
    assert uv.certify(made["unknown"]).certified
