"""Arms of other numbers of joints: robots of made-up links, their certificates.

`pytest -s -m long tests/certificate/test_arms.py` prints their verdicts and times.
"""

import time

import numpy as np
import pytest
from support.arms import write_arm, write_press

from uvms_drake.certificate.certify import certify, first_plan
from uvms_drake.control.ocp.scp import SequentialConvexSolver
from uvms_drake.model.robot import Robot
from uvms_drake.model.uvms import slides
from uvms_drake.plant.model_check import complaints_about
from uvms_drake.station.problem import load_model, make_ocp, start_state
from uvms_drake.station.scenario.scenario import Scenario, load_scenario


@pytest.mark.parametrize(("n", "telescope"), [
    (1, False), (2, False), (3, False), (4, True), (5, False), (6, False), (7, False)])
def test_the_made_up_robots_are_sound(n, telescope, tmp_path):
    robot = write_arm(tmp_path, n, telescope=telescope)
    loaded = Robot.load(robot)
    assert [slides(joint) for joint in loaded.uvms.joints] == [False] * (n - 1) + [telescope]
    assert complaints_about(loaded) == []


def step_time(scenario: Scenario) -> float:
    """Returns the processor time of an iteration of the MPC at the first plan [s], the median."""
    ocp = make_ocp(scenario, load_model(scenario))
    plan, _ = first_plan(ocp, start_state(scenario, ocp))
    solver, seconds = SequentialConvexSolver(ocp), []
    for _ in range(20):
        start = time.process_time()
        solver.solve(plan, 1)
        seconds.append(time.process_time() - start)
    return float(np.median(seconds))


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize(("n", "telescope"), [
    (3, False), (4, False), (4, True), (6, False), (7, False)])
def test_an_arm_of_other_numbers_of_joints_is_certified_at_once(n, telescope, tmp_path):
    scenario = load_scenario(str(write_press(tmp_path, n, telescope=telescope)))
    start = time.process_time()
    certificate = certify(scenario)
    certifying = time.process_time() - start
    assert certificate.certified, [each for each in certificate.conditions if not each.holds]
    name = f"{n}, the last one slides" if telescope else n
    print(f"\n| {name} | {len(certificate.conditions)} | {certifying:.0f} s | "
          f"{1e3 * step_time(scenario):.0f} ms | {certificate.bounds['force']:.2g} N |")
