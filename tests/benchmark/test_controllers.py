"""The nominal MPC of the benchmark is the plan alone; data declared to controllers are listed."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from uvms_drake.benchmark.cases import CASES, drawn_case
from uvms_drake.benchmark.controllers import CONTROLLERS, declared_to
from uvms_drake.control.mpc.planner import MPC_REPORT
from uvms_drake.control.ocp.scp import SequentialConvexSolver
from uvms_drake.control.ocp.solvers import make_solver
from uvms_drake.station.problem import load_model


def test_the_nominal_mpc_sends_its_plan_from_the_measured_state(monkeypatch):
    """The command is ζ̄̇ − f, whatever the deviation; the plan is an optimum, which SNOPT keeps."""
    found = []
    solve = SequentialConvexSolver.solve

    def recording(self, guess, *args):
        found.append((self.ocp, solve(self, guess, *args)))
        return found[-1][1]

    monkeypatch.setattr(SequentialConvexSolver, "solve", recording)
    scenario, _ = drawn_case("girona500_arm5e", CASES["ideal"], 1, 0)
    model = load_model(scenario)
    controller = CONTROLLERS["nominal_mpc"](scenario, model)
    simulator = Simulator(controller)
    context = simulator.get_mutable_context()
    state = np.concatenate([scenario.start.config, np.zeros(model.size)])
    for name, value in (("state", state), ("force_measured", np.zeros(6)),
                        ("force_valid", np.zeros(6))):
        controller.GetInputPort(name).FixValue(context, value)
    simulator.Initialize()
    ((ocp, solution),) = found
    other = make_solver(ocp, "snopt").solve(solution.plan)
    assert other.converged
    assert solution.evaluation.cost == pytest.approx(other.evaluation.cost, rel=1e-6)
    planned = controller.GetOutputPort("nominal_input").Eval(context)
    assert np.max(np.abs(planned)) > 0.01
    report = dict(zip(MPC_REPORT, controller.GetOutputPort("report").Eval(context), strict=True))
    assert report["status"] == 0.0 and report["violation"] < 1e-6
    moved = state + 0.003 * np.eye(2 * model.size)[1]
    for measured in (state, moved):
        controller.GetInputPort("state").FixValue(context, measured)
        u = controller.GetOutputPort("u").Eval(context)
        due = planned + model.drift(*np.split(controller.GetOutputPort(
            "nominal_state").Eval(context), 2)) - model.drift(*np.split(measured, 2))
        assert u == pytest.approx(due, abs=2e-3)


def test_what_a_controller_is_given_is_listed_once_and_unknown_for_ones_own():
    assert declared_to("sliding_decoupled", "girona500_arm5e") == ["direction", "model"]
    assert "model" not in declared_to("prescribed_performance", "girona500_arm5e")
    assert declared_to("my_law.py", "girona500_arm5e") == ["not known"]
