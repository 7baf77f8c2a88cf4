"""Tests of `uvms_drake.control.ocp.nlp`; `test_scp` holds the fast solver against it."""


import numpy as np
import pytest
from comparison.nlp import NonlinearSolver
from pydrake.solvers import SnoptSolver
from support.limits import with_limits

from uvms_drake.control.plan.plan import Plan

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def nlp(short_ocp) -> NonlinearSolver:
    return NonlinearSolver(short_ocp, SnoptSolver())


@pytest.fixture(scope="module", params=["off", "on"])
def point(request, start_plans) -> tuple[Plan, np.ndarray]:
    """A guess, and values of the variables somewhere else."""
    guess = start_plans[request.param][0]
    rng = np.random.default_rng(1)
    return guess, np.append(rng.uniform(-0.1, 0.1, size=guess.decision.size), 0.4)


def test_the_gradient_of_the_cost_is_that_of_differences(nlp, point, derivative):
    guess, values = point
    _, gradient = nlp._cost(values, guess)
    expected = [derivative(lambda s, d=d: nlp._cost(values + s * d, guess)[0][0], 1e-5)
                for d in np.eye(len(values))]
    np.testing.assert_allclose(
        gradient[0], expected, rtol=1e-6, atol=1e-7 * np.max(np.abs(gradient)))


def test_the_jacobian_of_the_constraints_is_that_of_differences(nlp, point, derivative):
    guess, values = point
    _, jacobian = nlp._constraints(values, guess)
    scale = np.max(np.abs(jacobian), axis=1)
    for j, direction in enumerate(np.eye(len(values))):
        column = derivative(
            lambda s, d=direction: nlp._constraints(values + s * d, guess)[0], 1e-5)
        assert np.all(np.abs(jacobian[:, j] - column) <= 1e-5 * scale + 1e-8), f"column {j}"
    lower, upper = nlp._bounds(guess)
    limited = np.isfinite(lower) | np.isfinite(upper)
    assert np.min(scale[limited]) > 0.0


FORCES = np.array([60.0, 50.0, 60.0, 15.0, 40.0, 25.0, 5.0, 5.0, 2.0, 0.2])  # N, N m


@pytest.mark.parametrize("tau", [None, FORCES, 10.0 * FORCES])
def test_cost_and_limits_of_a_plan_are_those_of_the_problem(short_ocp, start_plans, tau):
    """The program says of a plan what `Ocp.evaluate` says, which computes it in another way."""
    free, short_ocp = short_ocp, with_limits(short_ocp, tau=tau)
    nlp = NonlinearSolver(short_ocp, SnoptSolver())
    forced = 0
    for guess in [*start_plans["off"], *start_plans["on"]]:
        evaluation = short_ocp.evaluate(guess)
        values = np.append(guess.decision.ravel(), evaluation.terminal_slack)
        assert nlp._cost(values, guess)[0][0] == pytest.approx(evaluation.cost, rel=1e-12)
        constraints = nlp._constraints(values, guess)[0]
        if evaluation.terminal_slack > 0.0:
            assert constraints[-1] == pytest.approx(0.0, abs=1e-9), "on the edge of the set"
        lower, upper = nlp._bounds(guess)
        excess = np.maximum(lower - constraints, constraints - upper)[:-1]
        assert (np.max(excess) > 1e-9) == (evaluation.violation > 1e-9)
        linear = np.maximum(excess[: short_ocp.staged_program(guess).linear.value.size], 0.0)
        assert np.max(linear) <= evaluation.violation + 1e-9
        forced += evaluation.violation > free.evaluate(guess).violation
    assert (forced > 0) == (tau is FORCES)


@pytest.mark.parametrize(("kind", "coordinate"), [("roll", 3), ("pitch", 4)])
def test_the_attitude_is_bounded_at_every_knot_but_the_first(short_ocp, start_plans, kind,
                                                             coordinate):
    """The start is given, and may be beyond the limit."""
    guess = start_plans["off"][0]
    start = abs(guess.config[0, coordinate])
    tight = with_limits(short_ocp, **{kind: 0.95 * start})
    solution = NonlinearSolver(tight, SnoptSolver()).solve(guess)
    assert solution.converged
    assert np.max(np.abs(solution.plan.config[1:, coordinate])) <= 0.95 * start + 1e-6


def test_a_limit_to_which_the_start_cannot_return_leaves_no_plan(short_ocp, start_plans):
    guess = start_plans["off"][0]
    tight = with_limits(short_ocp, pitch=1e-3 * abs(guess.config[0, 4]))
    assert NonlinearSolver(tight, SnoptSolver()).solve(guess).plan is None


def test_a_problem_without_a_solution_leaves_no_plan(short_ocp, start_plans):
    weak = with_limits(short_ocp, u=1e-3 * short_ocp.limits["u"].upper)
    solution = NonlinearSolver(weak, SnoptSolver()).solve(start_plans["on"][0])
    assert (solution.plan, solution.evaluation, solution.converged) == (None, None, False)
