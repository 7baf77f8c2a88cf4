"""Weight and force apart where a robot is too weak, and that the advice helps: by plain NumPy."""

import re

import numpy as np
import pytest
from support.robots import altered, copied

from uvms_drake.command.main import main
from uvms_drake.model.uvms_model import UvmsModel, read_uvms
from uvms_drake.setup.first_scenario import find_posture
from uvms_drake.setup.holding import Holding

G = 9.81
UP = "weight_called_force/up_arm"


def said(folder, robot, force, capsys) -> str:
    """Returns what `scenario --new` says to a robot; empty if it writes the file."""
    file = folder / "press.yaml"
    file.unlink(missing_ok=True)
    status = main(["scenario", "--new", str(file), "--robot", str(robot), "--force", f"{force:g}"])
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
    q, _ = find_posture(UvmsModel(read_uvms(str(robot))))
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


def test_a_force_that_carries_the_arm_can_be_done(tmp_path, capsys):
    robot = copied(UP, tmp_path)
    assert [said(tmp_path, robot, force, capsys) == "" for force in (1.0, 5.0, 10.0, 14.0)] == [
        False, True, True, True]


def test_the_forces_that_are_advised_can_be_done_and_those_beyond_cannot(tmp_path, capsys):
    robot = copied(UP, tmp_path)
    least, most = map(float, re.search(
        r"what would help: a force from ([\d.]+) to ([\d.]+) N;",
        said(tmp_path, robot, 1.0, capsys)).groups())
    for force, possible in ((least, True), (most, True), (0.9 * least, False),
                            (1.05 * most, False)):
        assert (said(tmp_path, robot, force, capsys) == "") == possible, force


@pytest.mark.parametrize("force", [1.0, 60.0])
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


def test_of_a_weak_motor_of_a_hanging_arm_less_force_is_advised(tmp_path, capsys):
    """Weight and force act the same way, and a stronger motor has more friction, too."""
    robot = altered(tmp_path, (".sdf", "<effort>30</effort>", "<effort>4.5</effort>"))
    line = said(tmp_path, robot, 20.0, capsys)
    most = float(re.search(r"what would help: a force of ([\d.]+) N at most", line)[1])
    assert 0.0 < most < 20.0
    assert said(tmp_path, robot, most, capsys) == ""
    assert said(tmp_path, robot, 1.1 * most, capsys) != ""
    needed = dict(re.findall(r"([\d.]+) N m along (q\d)", line.rpartition("; or ")[2]))
    by_joint = {joint: float(value) for value, joint in needed.items()}
    strong = altered(tmp_path / "strong", (".sdf", "<effort>30</effort>",
                                           f"<effort>{max(by_joint.values()):g}</effort>"))
    assert said(tmp_path, strong, 20.0, capsys) == ""


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
    q, _ = find_posture(UvmsModel(read_uvms(str(robot))))
    weight, by_newton = in_air(q, 2.0)
    command = ["run", str(tmp_path / "press.yaml"), "--uncertified", "--quiet",
               "--output", str(tmp_path / "out"), "--set", f"tube.tau={[0.1] * 8}"]
    assert main([*command, "--set", "limits.tau=[60, 20, 32, 20, 32, 20, 1, 30]"]) == 2
    found = re.search(r"limits.tau = .*: must be such that tau\[6\], ([-\d.]+) to hold the task, "
                      r"is within -0.9 to 0.9; weight and buoyancy take ([-\d.]+) of it, "
                      r"the force ([-\d.]+) \(", capsys.readouterr().err)
    np.testing.assert_allclose([float(each) for each in found.groups()], [
        weight + 14.0 * by_newton, weight, 14.0 * by_newton], rtol=5e-3)
    assert main([*command, "--set", "limits.u.6=0.5", "--set", "tube.u.6=0.1"]) == 2
    found = re.search(r"limits.u = .* such that u\[6\], ([-\d.]+) to hold the task, is within "
                      r"-0.4 to 0.4; weight and buoyancy take ([-\d.]+) of it, the force "
                      r"([-\d.]+) \(", capsys.readouterr().err)
    total, by_weight, by_force = (float(each) for each in found.groups())
    assert by_weight + by_force == pytest.approx(total, abs=0.02)
    assert by_weight > 0.0 > by_force
