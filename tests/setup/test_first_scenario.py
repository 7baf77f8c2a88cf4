"""A scenario made for a robot: what it is made of, that it certifies, and advice where it fails."""

import re

import numpy as np
import pytest
from support.arms import write_arm
from support.robots import TEMPLATE, altered, copied, without_an_arm

import uvms_drake as uv
from uvms_drake.command.main import main
from uvms_drake.model.trim import middle_posture
from uvms_drake.report.robot.robot_sheet import sheet_of
from uvms_drake.setup import first_scenario as module
from uvms_drake.setup.first_scenario import MARGIN, find_posture, first_scenario, strength_of
from uvms_drake.setup.holding import Holding
from uvms_drake.station.problem import check_inputs, make_ocp
from uvms_drake.tube.row_gains import input_gain

ROBOTS = ("bluerov2_alpha5", "box_uvms", "girona500_arm5e")


def made(folder, robot: str, *options: str) -> uv.Scenario:
    """Returns the scenario that the command writes."""
    file = folder / "press.yaml"
    assert main(["scenario", "--uncertified", "--new", str(file), "--robot", robot, *options]) == 0
    return uv.load_scenario(str(file))


@pytest.mark.parametrize("robot", ROBOTS)
def test_it_is_a_scenario_in_which_the_task_can_be_held(robot, tmp_path):
    scenario = made(tmp_path, robot, "--force", "6")
    model = check_inputs(scenario)
    # The tip is 0.2 m in front of the wall, not much aside, and the vehicle level at the task.
    chi = model.task_pose(scenario.start.config)
    assert chi[0] == pytest.approx(-0.2, abs=0.02)
    assert np.all(np.abs(chi[1:3]) < 0.05)
    ocp = make_ocp(scenario, model)
    config = model.configuration(ocp.y_des)
    np.testing.assert_allclose(config[3:5], 0.0, atol=1e-3)
    np.testing.assert_allclose(config[6:], scenario.start.q)
    np.testing.assert_allclose(scenario.task.force, [6.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    # What holds the task, by the contact's own model, leaves half of every input at least.
    assert np.all(np.abs(ocp.u_eq) < 0.5 * np.asarray(scenario.limits.u))
    # Along one axis more, nobody gives more than he can.
    M = np.diag(model.mass_matrix(model.kinematics(config)))
    strength = strength_of(uv.read_uvms(robot)).force
    assert np.all(M * (scenario.limits.u - np.abs(ocp.u_eq)) < strength)


def test_a_posture_is_level_bent_and_off_the_limits():
    model = uv.UvmsModel(uv.read_uvms("box_uvms"))
    q, dexterity = find_posture(model)
    assert np.sum(q) == pytest.approx(0.0, abs=0.02)  # Both pitch, and the tool is level.
    # Of two links of 0.3 m, the elbow at q2: the area that they span, and the largest value.
    J = 0.3 * np.array([[np.sin(q[0]), 0.0], [np.cos(q[0]) + 1.0, 1.0]])
    assert dexterity == pytest.approx(np.linalg.svd(J, compute_uv=False)[-1], rel=1e-2)
    assert np.all(q > model.q_lower + MARGIN - 0.01)
    assert np.all(q < model.q_upper - MARGIN + 0.01)


def test_a_wall_is_turned_to_a_tool_that_cannot_be_level(tmp_path):
    robot = altered(tmp_path, (".sdf", "<lower>-1.5</lower> <upper>0.5</upper>",
                               "<lower>-1.3</lower> <upper>-0.9</upper>"),
                    (".sdf", "<lower>0.1</lower> <upper>2.2</upper>",
                     "<lower>0.0</lower> <upper>0.2</upper>"))
    scenario = made(tmp_path, str(robot))
    model = check_inputs(scenario)
    tilt = scenario.task.frame[1]
    assert tilt == pytest.approx(np.sum(scenario.task.posture), abs=1e-3)
    assert abs(tilt) > 0.8
    config = model.configuration(make_ocp(scenario, model).y_des)
    np.testing.assert_allclose(config[3:6], 0.0, atol=1e-3)
    into = np.array([np.cos(tilt), 0.0, -np.sin(tilt)])
    np.testing.assert_allclose(scenario.task.force[:3], 5.0 * into, atol=1e-9)
    tips = model.task_pose(scenario.start.config)[:3]
    assert tips @ into == pytest.approx(-0.2, abs=0.03)


def test_what_thrusters_cannot_hold_against_is_not_promised(monkeypatch):
    uvms = uv.read_uvms("bluerov2_alpha5")
    assert first_scenario(uvms, 5.0).covered == 1.0
    monkeypatch.setattr(module, "CURRENT", 1.0)
    found = first_scenario(uvms, 5.0)
    assert 0.2 < found.covered < 1.0
    # One axis has nothing to spare: its input holds the task, the disturbance and a manoeuvre.
    model = uv.UvmsModel(uvms)
    config = np.concatenate([np.zeros(6), found.posture])
    M = np.diag(model.mass_matrix(model.kinematics(config)))
    left = module.SHARES[0] * (found.strength.force - np.abs(found.tau_eq))[:3] / M[:3]
    needs = module.TAKEN * input_gain(1.0, 1.0) * found.disturbance[:3] + module.MANOEUVRE[0]
    assert np.min(left - needs) == pytest.approx(0.0, abs=1e-9)
    # A metre per second drags with (10 + 40 · 1) N in surge, (12 + 40 · 1) N in sway, of the hull.
    drag = found.disturbance[0] / found.covered * M[0]
    assert 50.0 < drag < 1.3 * 50.0


@pytest.mark.parametrize(("args", "expected"), [
    (["--new", "there.yaml", "--robot", TEMPLATE], "--new = 'there.yaml': must be a .yaml file "
     "that is not there yet"),
    (["--new", "new", "--robot", TEMPLATE], "--new = 'new': must be a .yaml file"),
    (["--new", "new.yaml", "--robot", "submarine"], "model = 'submarine': must be one of"),
    (["--new", "new.yaml", "--robot", TEMPLATE, "--force", "0"], "--force = 0.0: must be positive"),
    (["--new", "new.yaml"], "--robot = None: must be a robot, with --new")])
def test_bad_input_is_refused_in_a_line(args, expected, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there.yaml").touch()
    assert main(["scenario", *args]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith(f"uvms-drake: error: {expected}")
    assert err.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["there.yaml"]


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("robot", ["arm3", "bluerov2_alpha5", "box_uvms", "girona500_arm5e"])
def test_the_first_certificate_holds(robot, tmp_path):
    """Of a made-up arm, of a BlueROV2 in another posture than that of its shipped scenarios, ..."""
    model = str(write_arm(tmp_path, 3)) if robot == "arm3" else robot
    certificate = uv.certify(made(tmp_path, model))
    assert certificate.certified, certificate.verdict


@pytest.mark.long
def test_a_vehicle_without_an_arm_certifies_presses_and_feels(tmp_path, monkeypatch):
    """A tool that is bolted on: n = 0."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    robot, file, felt = without_an_arm(tmp_path), tmp_path / "press.yaml", tmp_path / "felt.yaml"
    assert main(["scenario", "--uncertified", "--new", str(file), "--robot", str(robot)]) == 0
    assert main(["run", str(file), "--duration", "0.2", "--output", str(tmp_path / "run")]) == 0
    assert not (tmp_path / "run" / "joints.png").exists()
    felt.write_text("""
base: press.yaml
contact: !SensedContact {direction: [1, 0, 0], angle: 0.08, force: 20, speed: 0.06, delay: 0.03}
surface: !ShapedSurface {geometry: !Plane {point: [0.05, 0, 0], normal: [-1, 0, 0]}}
sensing: [!ForceSensor {rate: 500, lag: 0.004}]
limits: {static_force: null}
simulator: {max_step_size: 0.004}
""")
    found = uv.certify(uv.load_scenario(str(felt), [
        "certificate.tube_samples=50", "certificate.constant_samples=50"]))
    assert found.tube.depth > 0.0
    assert main(["run", str(felt), "--uncertified", "--duration", "0.2", "--no-figures",
                 "--output", str(tmp_path / "felt")]) == 0


def tip_of(q: np.ndarray) -> np.ndarray:
    """Returns the tip (..., 3) of the template's arm: two links of 0.3 m, z down."""
    first, both = q[..., 0], q[..., 0] + q[..., 1]
    return np.stack([0.42 + 0.3 * (np.cos(first) + np.cos(both)), 0.0 * both,
                     0.12 - 0.3 * (np.sin(first) + np.sin(both))], axis=-1)


@pytest.mark.parametrize(("name", "limits"), [
    ("above", (3.4, 5.0)), ("wide", (-5.7, 0.0)), ("one_end", (3.4, np.inf)),
    pytest.param("below", (-5.0, -3.4), marks=pytest.mark.long),
    pytest.param("turns", (5.0, 15.0), marks=pytest.mark.long)])
def test_joints_beyond_half_a_turn_have_a_sheet_and_a_scenario(name, limits, tmp_path):
    """Reach by plain NumPy on a grid of postures; a joint with one limit turns once from there."""
    case = f"limits_beyond_pi/{name if name in ('above', 'below', 'wide') else 'above'}"
    changes = [] if case.endswith(name) else [(
        ".sdf", "<lower>3.4</lower> <upper>5.0</upper>", f"<lower>{limits[0]}</lower>" + (
            f" <upper>{limits[1]}</upper>" if np.isfinite(limits[1]) else ""))]
    robot = copied(case, tmp_path, *changes)
    uvms = uv.read_uvms(str(robot))
    high = min(limits[1], limits[0] + 2.0 * np.pi)
    tips = tip_of(np.stack(np.meshgrid(np.linspace(-1.5, 0.5, 800), np.linspace(
        limits[0], high, 800)), axis=-1).reshape(-1, 2))
    sheet = sheet_of(uvms, name, middle_posture(uvms))
    np.testing.assert_allclose(
        sheet.reach, [tips.min(axis=0), tips.max(axis=0)], atol=5e-3)
    if name == "wide":
        assert sheet.reach[0, 2] == pytest.approx(-0.324, abs=2e-3)
    if np.isfinite(limits[1]):
        scenario = made(tmp_path, str(robot))
        assert limits[0] <= scenario.limits.q_lower[1] < scenario.limits.q_upper[1] <= limits[1]
        assert limits[0] <= scenario.start.q[1] <= limits[1]


def test_the_arm_of_the_bluerov2_presses_straight_ahead(tmp_path):
    """Its first joint has 0.032 .. 6.02 and looks ahead at π; the vehicle stands square."""
    scenario = made(tmp_path, "bluerov2_alpha5")
    assert scenario.start.q[0] == pytest.approx(np.pi, abs=0.03)
    assert scenario.limits.q_upper[0] > np.pi
    yaw = scenario.start.eta[5] - 0.02  # By which a start is off on purpose.
    assert abs(yaw) < np.deg2rad(1.0)


def test_what_a_run_would_refuse_is_not_written(tmp_path, capsys, monkeypatch):
    wild = tmp_path / "wild.template"
    wild.write_text(module.TEMPLATE.read_text("utf-8").replace("k: {gain}", "k: 1000000000.0"),
                    encoding="utf-8")
    monkeypatch.setattr(module, "TEMPLATE", wild)
    file = tmp_path / "press.yaml"
    assert main(["scenario", "--uncertified", "--new", str(file), "--robot", "box_uvms"]) == 2
    assert "simulator.max_step_size = 0.01: must be at most 1.1e-09" in capsys.readouterr().err
    assert not file.exists()


G = 9.81
UP = "weight_called_force/up_arm"


def said(folder, robot, force, capsys) -> str:
    """Returns what `scenario --new` says to a robot; empty if it writes the file."""
    file = folder / "press.yaml"
    file.unlink(missing_ok=True)
    status = main(["scenario", "--uncertified", "--new", str(file), "--robot", str(robot),
                   "--force", f"{force:g}"])
    err = capsys.readouterr().err
    assert (status == 0) == file.exists() == (err == "")
    assert err.count("\n") <= 1
    return err


def in_air(q: np.ndarray, mass: float) -> tuple[float, float]:
    """Returns τ₁ of two links of 0.3 m by weight, and by each newton that the tip pushes ahead.

    Joints turn about starboard, z is down: a positive angle raises what is ahead.
    """
    first, both = q[0], q[0] + q[1]
    weight = G * mass * (0.15 * np.cos(first) + 0.3 * np.cos(first) + 0.15 * np.cos(both))
    # The wall pushes the tip back: above the shoulder that raises the arm, too.
    height = 0.3 * np.sin(first) + 0.3 * np.sin(both)
    return weight, -height


@pytest.mark.parametrize("force", [1.0, 60.0])
def test_weight_and_force_are_told_apart(force, tmp_path, capsys):
    robot = copied(UP, tmp_path)
    q, _ = find_posture(uv.UvmsModel(uv.read_uvms(str(robot))))
    weight, by_newton = in_air(q, 2.0)
    assert weight == pytest.approx(6.14, abs=0.005)
    assert by_newton == pytest.approx(-0.28, abs=0.005)
    numbers = re.search(r"gives 7 N m along q1, of which weight and buoyancy take ([\d.]+) N m, "
                        rf"and {force:g} N on the wall (take|add) ([\d.]+)( off)? at rest",
                        said(tmp_path, robot, force, capsys))
    assert float(numbers[1]) == pytest.approx(weight, abs=0.005)
    change = abs(weight + force * by_newton) - weight
    assert float(numbers[3]) == pytest.approx(abs(change), rel=5e-3)
    assert (numbers[2], numbers[4]) == (("add", None) if change > 0.0 else ("take", " off"))


def test_the_forces_that_are_advised_can_be_done_and_those_beyond_cannot(tmp_path, capsys):
    robot = copied(UP, tmp_path)
    least, most = map(float, re.search(
        r"what would help: a force from ([\d.]+) to ([\d.]+) N;",
        said(tmp_path, robot, 1.0, capsys)).groups())
    for force, possible in ((least, True), (most, True), (0.9 * least, False),
                            (1.05 * most, False)):
        assert (said(tmp_path, robot, force, capsys) == "") == possible, force


@pytest.mark.parametrize("force", [1.0, pytest.param(60.0, marks=pytest.mark.long)])
def test_the_motor_that_is_advised_is_strong_enough(force, tmp_path, capsys):
    needed = re.search(r"or ([\d.]+) N m along q1\n", said(
        tmp_path, copied(UP, tmp_path / "weak"), force, capsys))[1]
    assert float(needed) > 7.0
    robot = copied(UP, tmp_path, (".urdf", 'effort="7"', f'effort="{needed}"'))
    assert said(tmp_path, robot, force, capsys) == ""


def test_water_for_the_dry_links_is_advised_where_it_helps(tmp_path, capsys):
    advice = "water in hydrodynamics.yaml of the dry links forearm, upper_arm"
    dry = copied(UP, tmp_path / "dry")
    assert advice in said(tmp_path, dry, 1.0, capsys)
    assert advice not in said(tmp_path, dry, 60.0, capsys)  # The force is too much by itself.
    robot = copied(UP, tmp_path, ("hydrodynamics.yaml", "bodies:\n", """bodies:
  upper_arm: {displaced_volume: 0.002, center_of_buoyancy: [0.15, 0, 0]}
  forearm: {displaced_volume: 0.002, center_of_buoyancy: [0.15, 0, 0]}
"""))
    assert said(tmp_path, robot, 1.0, capsys) == ""


def test_the_heave_of_a_heavy_vehicle_is_its_weight(tmp_path, capsys):
    """Thrusters carry what the water does not: with 30 N they cannot, with any force ahead."""
    robot = altered(tmp_path, ("hydrodynamics.yaml", "displaced_volume: 61.6e-3",
                               "displaced_volume: 57.6e-3"))
    (robot / "thrusters.yaml").write_text("""
dead_time: 0.05
voltage: 24
bias: 0
undriven: []
kinds: {t: {lag: 0.1, smallest: 0.0, curves: [
  {voltage: 24, command: [-1, 0, 1], force: [-12, 0, 12]}]}}
thrusters:
""" + "".join(f"  {name}: {{kind: t, position: {place}, axis: {axis}}}\n" for name, place, axis in (
        ("ahead_1", [0, 0.3, 0], [1, 0, 0]), ("ahead_2", [0, -0.3, 0], [1, 0, 0]),
        ("aside_1", [0, 0, 0.1], [0, 1, 0]), ("aside_2", [0, 0, -0.1], [0, 1, 0]),
        ("down_1", [0.3, 0, 0], [0, 0, 1]), ("down_2", [-0.3, 0, 0], [0, 0, 1]))),
        encoding="utf-8")
    line = said(tmp_path, robot, 2.0, capsys)
    net = G * (63.0 - 57.6 - 1.7)
    taken = float(re.search(r"thrusters.yaml gives .* along heave, of which weight and buoyancy "
                            r"take ([\d.]+) N, and 2 N on the wall", line)[1])
    assert taken == pytest.approx(net, rel=5e-3)
    assert "a force" not in line  # None would help.


def test_the_forces_are_those_of_the_inequality():
    """On a fine grid of forces, for random robots."""
    rng, grid = np.random.default_rng(0), np.linspace(0.0, 60.0, 6001)
    seen = 0
    for _ in range(200):
        holding = Holding(rng.normal(size=8), rng.normal(size=8) * 0.2, np.full(8, 0.3),
                          np.full(8, 0.3), rng.uniform(0.2, 8.0, 8))
        possible = np.all(np.abs(holding.weight + grid[:, None] * holding.by_newton)
                          <= holding.strength - holding.reserve, axis=1)
        least, most = holding.forces()
        inside = (grid >= least) & (grid <= most)
        assert np.sum(possible != inside) <= 2
        seen += bool(np.any(possible))
    assert 20 < seen < 180


def test_limits_on_forces_tell_weight_and_force_apart(tmp_path, capsys):
    """Also on accelerations, M⁻¹ of them: there the line is the same, its numbers are not."""
    robot = copied(UP, tmp_path)
    assert said(tmp_path, robot, 14.0, capsys) == ""
    q, _ = find_posture(uv.UvmsModel(uv.read_uvms(str(robot))))
    weight, by_newton = in_air(q, 2.0)
    command = ["run", str(tmp_path / "press.yaml"), "--uncertified", "--quiet",
               "--output", str(tmp_path / "out"), "--set", f"tube.tau={[0.1] * 8}"]
    assert main([*command, "--set", "limits.tau=[60, 20, 32, 20, 32, 20, 1, 30]"]) == 2
    found = re.search(r"limits.tau = .*: must be such that tau_q1, ([-\d.]+) to hold the task, "
                      r"is within -0.9 to 0.9; weight and buoyancy take ([-\d.]+) of it, "
                      r"the force ([-\d.]+) \(", capsys.readouterr().err)
    np.testing.assert_allclose([float(each) for each in found.groups()], [
        weight + 14.0 * by_newton, weight, 14.0 * by_newton], rtol=5e-3)
    assert main([*command, "--set", "limits.u.6=0.5", "--set", "tube.u.6=0.1"]) == 2
    found = re.search(r"limits.u = .* such that u_q1, ([-\d.]+) to hold the task, is within "
                      r"-0.4 to 0.4; weight and buoyancy take ([-\d.]+) of it, the force "
                      r"([-\d.]+) \(", capsys.readouterr().err)
    total, by_weight, by_force = (float(each) for each in found.groups())
    assert by_weight + by_force == pytest.approx(total, abs=0.02)
    assert by_weight > 0.0 > by_force
