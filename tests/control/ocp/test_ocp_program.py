"""Tests of `uvms_drake.control.ocp.ocp_program` and of its solver `nonlinear_solver`.

`test_scp` holds the fast solver against it.
"""

import gc
import weakref
from typing import Any

import numpy as np
import pytest
from pydrake.autodiffutils import ExtractGradient, ExtractValue, InitializeAutoDiff
from pydrake.solvers import MathematicalProgram, SnoptSolver
from support.limits import with_limits
from support.tracking import POSITION, at_rest, tracking_ocp

import uvms_drake as uv
from uvms_drake.control.ocp.solvers import NonlinearSolver
from uvms_drake.control.ocp.tracking_ocp import TrackingTarget


def scattered(program: uv.OcpProgram, size: float = 0.02) -> np.ndarray:
    """Returns values near the initial guess; knots do not meet, and the slack is not zero."""
    values = program.initial_guess()
    rng = np.random.default_rng(1)
    return values + size * rng.uniform(-1.0, 1.0, size=len(values)) + 0.3 * np.eye(
        len(values))[program.FindDecisionVariableIndex(program.s[0])]


@pytest.mark.parametrize("where", ["off", "on"])
def test_costs_and_limits_have_the_derivatives_of_differences(short_ocp, start_plans, where):
    program = uv.OcpProgram(short_ocp, start_plans[where][0])
    assert check_derivatives(program, scattered(program, 1e-3)) > 20


def test_those_of_a_reference_that_is_decided_too():
    ocp = tracking_ocp(overrides=("mpc.horizon=3",)).aimed(
        TrackingTarget(POSITION + [0.4, -0.1, 0.2], POSITION[0] + 0.12))
    program = uv.OcpProgram.at(ocp, at_rest(ocp, POSITION - [0.1, 0.0, 0.0]))
    assert check_derivatives(program, scattered(program)) > 10
    assert len(program.a) == 3


def test_variables_and_bindings_are_named_by_stage_and_limit(short_ocp, start_plans):
    guess = start_plans["off"][0]
    program = uv.OcpProgram(short_ocp, guess)
    constraints = names(program.GetAllConstraints())
    assert len(set(constraints)) == len(constraints)
    expected = {"start", "start_speed", "slack", "terminal_set"}
    expected |= {f"{kind}[{k}]" for k in range(5) for kind in ("motion", "speed", "limits.u")}
    expected |= {f"limits.{name}[{k}]" for k in range(1, 6) for name in short_ocp.limits
                 if name != "u"}
    assert set(constraints) == expected
    assert set(names(program.GetAllCosts())) == {"stage_costs", "terminal_cost", "slack_penalty"}
    convex = short_ocp.staged_program(guess).mathematical_program()
    assert set(names(convex.GetAllConstraints())) == {
        *(expected - {"start_speed", "slack"} - {f"speed[{k}]" for k in range(5)}), "relaxations"}


def test_a_program_is_freed_after_its_use(short_ocp, start_plans):
    """Its functions do not refer to it: one is made at every sample."""
    program = uv.OcpProgram(short_ocp, start_plans["off"][0])
    gone = weakref.ref(program._stages)
    del program
    gc.collect()
    assert gone() is None


FORCES = np.array([60.0, 50.0, 60.0, 15.0, 40.0, 25.0, 5.0, 5.0, 2.0, 0.2])  # N, N m


@pytest.mark.parametrize("tau", [None, FORCES, 10.0 * FORCES])
def test_cost_and_limits_of_a_plan_are_those_of_the_problem(short_ocp, start_plans, tau):
    """The program says of a plan what `Ocp.evaluate` says, which computes it in another way."""
    free, short_ocp = short_ocp, with_limits(short_ocp, tau=tau)
    forced = 0
    for guess in [*start_plans["off"], *start_plans["on"]]:
        evaluation = short_ocp.evaluate(guess)
        program = uv.OcpProgram(short_ocp, guess)
        values = program.initial_guess()
        assert cost(program, values) == pytest.approx(evaluation.cost, rel=1e-12)
        assert excess(program, values, "motion") < 1e-12
        assert excess(program, values, "speed") < 1e-12
        if evaluation.terminal_slack > 0.0:
            assert excess(program, values, "terminal_set") == pytest.approx(0.0, abs=1e-9)
        violation = excess(program, values, "limits.")
        assert violation == pytest.approx(evaluation.violation, rel=1e-9, abs=1e-9)
        forced += evaluation.violation > free.evaluate(guess).violation
    assert (forced > 0) == (tau is FORCES)


def test_a_guess_that_is_better_than_the_solution_is_kept(short_ocp, start_plans):
    """Also where the solver stops early, which is then no failure if the plan is sound."""
    solver = NonlinearSolver(short_ocp, SnoptSolver())
    first = solver.solve(start_plans["on"][1])
    assert first.converged
    again = solver.solve(first.plan)
    assert again.evaluation.merit <= first.evaluation.merit
    other = with_limits(short_ocp, pitch=0.1)
    assert solver.of(other).ocp is other


@pytest.mark.slow
def test_a_limit_to_which_the_start_cannot_return_leaves_no_plan(short_ocp, start_plans):
    guess = start_plans["off"][0]
    tight = with_limits(short_ocp, pitch=1e-3 * abs(guess.config[0, 4]))
    assert NonlinearSolver(tight, SnoptSolver()).solve(guess).plan is None


# Checks of a `MathematicalProgram`: derivatives, and what it says of a plan -----------------------


def names(bindings: list[Any]) -> list[str]:
    """Returns the names of bindings."""
    return [binding.evaluator().get_description() for binding in bindings]


def check_derivatives(program: MathematicalProgram, values: np.ndarray, step: float = 1e-5) -> int:
    """Compares the derivatives of costs and constraints that are functions with differences.

    Args:
        program: The program.
        values: Of all its variables.
        step: Of the central differences, of fourth order.

    Returns:
        Number of the functions.
    """
    checked = [*program.generic_costs(), *program.generic_constraints()]
    for binding in checked:
        evaluator = binding.evaluator()
        x = values[program.FindDecisionVariableIndices(binding.variables())]
        dual = evaluator.Eval(InitializeAutoDiff(x).ravel())
        value, jacobian = ExtractValue(dual).ravel(), ExtractGradient(dual)
        np.testing.assert_array_equal(value, evaluator.Eval(x))
        scale = 1.0 + np.max(np.abs(jacobian), axis=1)
        # A few directions that move all variables, and some of the variables alone.
        rng = np.random.default_rng(0)
        directions = [*rng.normal(size=(3, len(x))), *np.eye(len(x))[:: max(1, len(x) // 8)]]
        for e in directions:
            near, far = (evaluator.Eval(x + n * step * e) - evaluator.Eval(x - n * step * e)
                         for n in (1, 2))
            slope = (8.0 * near - far) / (12.0 * step)
            error = np.abs(jacobian @ e - slope)
            assert np.all(error <= 1e-6 * scale * np.linalg.norm(e)), (
                f"{evaluator.get_description()}: {error}")
    return len(checked)


def cost(program: MathematicalProgram, values: np.ndarray) -> float:
    """Returns the sum of all costs."""
    return float(sum(program.EvalBindings(program.GetAllCosts(), values)))


def excess(program: MathematicalProgram, values: np.ndarray, prefix: str = "") -> float:
    """Returns the largest violation of the constraints whose names have this prefix.

    A cone counts as it is evaluated, by its norm's excess over its bound.
    """
    out = 0.0
    for binding in program.GetAllConstraints():
        evaluator = binding.evaluator()
        if evaluator.get_description().startswith(prefix):
            value = program.EvalBinding(binding, values)
            lower, upper = evaluator.lower_bound(), evaluator.upper_bound()
            out = max(out, float(np.max(lower - value)), float(np.max(value - upper)))
    return out
