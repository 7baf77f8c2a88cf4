"""With an observer a nominal MPC has no steady error of the force on a wall of wrong stiffness."""

import numpy as np
import pytest

from uvms_drake.benchmark.cases import Case, drawn_case
from uvms_drake.benchmark.controllers import CONTROLLERS
from uvms_drake.benchmark.loop import run_loop
from uvms_drake.station.problem import load_model

WRONG = Case("", "", (
    "surface_error.stiffness=0.5", "model_error.mass=1.1",
    "disturbance=!ConstantDisturbance {bound: 0.02}"), ideal=True)


def steady_error(controller: str, robot: str = "girona500_arm5e") -> float:
    """Returns the mean error of the force in the last second of a press [N]."""
    scenario, events = drawn_case(robot, WRONG, 977, 0)
    model = load_model(scenario)
    trace = run_loop(scenario, model, CONTROLLERS[controller](scenario, model), events)
    last = trace.time > trace.time[-1] - 1.0
    return float(np.mean(trace.signals["force"][last, 0]) - scenario.task.force[0])


@pytest.mark.slow
def test_the_observer_removes_the_steady_error_of_a_nominal_mpc():
    assert abs(steady_error("nominal_mpc")) > 1.0
    assert steady_error("nominal_mpc_offset_free") == pytest.approx(0.0, abs=0.02)
