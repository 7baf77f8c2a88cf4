"""Robots that are not tuned: made-up arms certify at once, and advice helps a spoilt scenario."""

import copy
import re

import numpy as np
import pytest
import yaml
from support.arms import write_arm, write_press
from support.quick import FEW, search_less

import uvms_drake as uv
from uvms_drake.certificate.certify import between_knots, certify, longer, roomier, safer, stronger
from uvms_drake.command.main import main
from uvms_drake.control.ocp.scp import SequentialConvexSolver
from uvms_drake.model.uvms import slides
from uvms_drake.plant.model_check import complaints_about
from uvms_drake.tube.conditions import setting
from uvms_drake.tube.estimates import LEAST_SHARE, CertificateSettings


@pytest.mark.parametrize(("n", "telescope"), [
    (1, False), (2, False), (3, False), (4, True), (5, False), (6, False), (7, False)])
def test_the_made_up_robots_are_sound(n, telescope, tmp_path):
    robot = write_arm(tmp_path, n, telescope=telescope)
    loaded = uv.Robot.load(robot)
    assert [slides(joint) for joint in loaded.uvms.joints] == [False] * (n - 1) + [telescope]
    assert complaints_about(loaded) == []


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize(("n", "telescope"), [
    (3, False), (4, False), (4, True), (6, False), (7, False)])
def test_an_arm_of_other_numbers_of_joints_is_certified_at_once(n, telescope, tmp_path):
    scenario = uv.load_scenario(str(write_press(tmp_path, n, telescope=telescope)))
    certificate = certify(scenario)
    assert certificate.certified, [each for each in certificate.conditions if not each.holds]


IDEAL = "girona500_ideal"
STEPS = 5


def overrides(advice: str) -> list[str]:
    """Returns what follows every --set."""
    return re.findall(r"--set (\S+)", advice)


@pytest.fixture(scope="module")
def planned():
    scenario = uv.load_scenario(IDEAL)
    ocp = uv.make_ocp(scenario)
    return ocp, SequentialConvexSolver(ocp).solve(
        ocp.resting_plan(0.0, uv.start_state(scenario, ocp)), 20).plan


@pytest.mark.parametrize(("name", "label", "key"), [
    ("pitch", "pitch", "limits.pitch"), ("static_force", "static_force", "limits.static_force"),
    ("q", "q3", "limits.q_upper")])
def test_a_limit_that_a_plan_leaves_is_named_with_the_bound_that_it_keeps(
        name, label, key, planned):
    ocp, plan = planned
    narrow, limit = copy.copy(ocp), copy.copy(ocp.limits[name])
    narrow.limits = {name: limit}
    if name == "q":
        limit.q_upper = np.where(np.arange(4) == 2, np.max(plan.config[:, 8]) - 0.01, limit.q_upper)
    else:
        limit.bound = {"pitch": 0.5 * float(np.max(np.abs(plan.config[:, 4]))),
                       "static_force": 9.0}[name]
    found = between_knots(narrow, plan)
    assert found.label == label
    assert 0.0 < found.time < plan.start_time + plan.time_step * (len(plan.config) - 1)
    (text,) = overrides(found.advice)
    assert text.startswith(f"{key}=")
    value = yaml.safe_load(text.partition("=")[2])
    if name == "q":
        limit.q_upper = np.array(value)
    else:
        limit.bound = value
    assert between_knots(narrow, plan).excess == 0.0
    uv.load_scenario(IDEAL, [text])  # The command line takes it.


def test_a_joint_gets_no_more_than_the_robot_has(planned):
    ocp, plan = planned
    narrow, limit = copy.copy(ocp), copy.copy(ocp.limits["q"])
    narrow.limits, narrow.model = {"q": limit}, copy.copy(ocp.model)
    narrow.model.q_upper = limit.q_upper = ocp.model.q_upper.copy()
    limit.q_upper[2] = float(np.max(plan.config[:, 8])) - 0.01
    assert (between_knots(narrow, plan).label, between_knots(narrow, plan).advice) == ("q3", "")


def test_a_disturbance_whose_tube_takes_too_much_is_made_less_by_as_much_and_a_fifth():
    bound = uv.load_scenario(IDEAL).disturbance.bound
    assert roomier(bound, 0.0, 2.0 / 3.0) == setting(
        disturbance__bound=float(f"{bound / 1.8:.2g}"))
    assert roomier(bound, 0.5, 2.0 / 3.0).startswith("smaller declared unknowns")
    for share in (1.1, 0.0, -0.2):
        assert roomier(bound, 0.0, share) == ""


def test_a_horizon_and_a_safety_factor_are_given_as_numbers():
    assert longer(15) == "--set mpc.horizon=23"
    settings = {factor: CertificateSettings(safety_factor=factor) for factor in (1.05, 1.1, 1.2)}
    factor = float(overrides(safer(settings[1.05], 1.03))[0].partition("=")[2])
    assert 1.03 * 1.05 < factor <= 1.0 / LEAST_SHARE
    assert safer(settings[1.2], 1.1) == "--set certificate.tube_samples=3000"
    assert safer(settings[1.2], 5.0) == safer(settings[1.2], 0.9) == safer(settings[1.1], 0.5) == ""
    less = float(overrides(safer(settings[1.2], 0.8))[0].partition("=")[2])
    assert 0.85 <= 0.8 * 1.2 / less < 0.86


def test_a_limit_of_an_acceleration_is_advised_that_has_the_missing_margin():
    scenario = uv.load_scenario("girona500_ideal", ["limits.u.1=0.5"])
    assert stronger(scenario, "u_sway, end of a step", -0.1) == "--set limits.u.1=0.62"
    assert stronger(scenario, "u_q2, largest in contact, begin of a step", -0.1).startswith(
        "--set limits.u.7=")
    assert stronger(scenario, "u_sway, end of a step", 0.0) == ""
    assert stronger(scenario, "decrease", -1.0) == ""


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize(("robot", "spoilt"), [
    ("box_uvms", ["mpc.horizon=5"]), ("bluerov2_alpha5", ["disturbance.bound=2"]),
    ("girona500_arm5e", ["disturbance.bound=3"])])
def test_who_follows_the_advice_arrives_at_a_certificate(robot, spoilt, tmp_path, monkeypatch):
    search_less(monkeypatch)
    file = tmp_path / "press.yaml"
    assert main(["scenario", "--uncertified", "--new", str(file), "--robot", robot]) == 0
    said = []
    for _ in range(STEPS + 1):
        certificate = certify(uv.load_scenario(str(file), [*FEW, *spoilt]))
        said.append(certificate.verdict)
        if certificate.certified:
            break
        advised = overrides(certificate.failed.advice)
        assert advised, said
        spoilt = [*spoilt, *advised]
    assert certificate.certified, said
    assert len(said) > 1, "nothing was spoilt"
