"""Tests of `uvms_drake.control.scp`, against SNOPT on the whole nonlinear program."""

import copy
from dataclasses import replace

import numpy as np
import pytest
from pydrake.solvers import SnoptSolver

from uvms_drake.control.nlp import NonlinearSolver
from uvms_drake.control.ocp import Evaluation, Ocp
from uvms_drake.control.scp import VIOLATION_PENALTY, SequentialConvexSolver, Solution

TOLERANCE = 1e-9  # of the merit, for a converged solution


def merit(evaluation: Evaluation) -> float:
    return evaluation.cost + VIOLATION_PENALTY * evaluation.total_violation


@pytest.fixture(scope="module")
def solver(short_ocp) -> SequentialConvexSolver:
    return SequentialConvexSolver(short_ocp)


@pytest.fixture(scope="module")
def fast(solver, start_plans) -> dict[str, list[Solution]]:
    """The converged solutions from the 20 states."""
    return {where: [solver.solve(guess, 100, TOLERANCE) for guess in guesses]
            for where, guesses in start_plans.items()}


@pytest.fixture(scope="module")
def reference(short_ocp, start_plans) -> dict[str, list[Solution]]:
    """SNOPT's solutions from the same guesses."""
    nlp = NonlinearSolver(short_ocp, SnoptSolver())
    return {where: [nlp.solve(guess) for guess in guesses]
            for where, guesses in start_plans.items()}


@pytest.mark.parametrize("where", ["off", "before", "on"])
def test_every_state_is_solved_to_a_feasible_plan_by_both_solvers(
        start_plans, fast, reference, where):
    for guess, one, other in zip(start_plans[where], fast[where], reference[where], strict=True):
        assert one.converged
        assert other.converged
        for solution in (one, other):
            assert solution.evaluation.violation < 1e-6
            np.testing.assert_array_equal(solution.plan.config[0], guess.config[0])
            np.testing.assert_array_equal(solution.plan.zeta[0], guess.zeta[0])


@pytest.mark.parametrize("where", ["off", "on"])
def test_the_converged_cost_is_that_of_the_nonlinear_program(fast, reference, where):
    for one, other in zip(fast[where], reference[where], strict=True):
        assert one.evaluation.cost == pytest.approx(other.evaluation.cost, rel=1e-6)
        assert one.evaluation.terminal_slack == pytest.approx(
            other.evaluation.terminal_slack, abs=1e-5)
        np.testing.assert_allclose(one.plan.zeta_dot, other.plan.zeta_dot, atol=2e-3)


def test_where_contact_is_made_each_solver_confirms_the_others_optimum(
        short_ocp, solver, fast, reference):
    """In which interval to touch the wall is a choice: there are several local optima.

    From the same guess the two may take different ones, some percent apart; started at the other's
    plan neither finds anything better.
    """
    nlp = NonlinearSolver(short_ocp, SnoptSolver())
    for one, other in zip(fast["before"], reference["before"], strict=True):
        costs = one.evaluation.cost, other.evaluation.cost
        assert nlp.solve(one.plan).evaluation.cost == pytest.approx(costs[0], rel=1e-3)
        assert solver.solve(other.plan, 100, TOLERANCE).evaluation.cost == pytest.approx(
            costs[1], rel=1e-3)
        assert costs[0] <= 1.1 * costs[1]


def test_some_limits_and_the_terminal_set_are_active(short_ocp, fast):
    """Otherwise the comparison would say nothing about them."""
    limits = short_ocp.limits
    plans = [solution.plan for each in fast.values() for solution in each]
    u = np.abs(np.vstack([np.vstack(short_ocp.inputs(plan)) for plan in plans]))
    assert np.sum(np.max(u, axis=0) > limits.u - 1e-6) >= 3
    zeta = np.vstack([plan.zeta for plan in plans])
    assert np.max(np.linalg.norm(zeta[:, :3], axis=1)) > limits.nu1 - 1e-6
    slacks = [solution.evaluation.terminal_slack for each in fast.values() for solution in each]
    assert np.min(slacks) == 0.0
    assert np.max(slacks) > 0.1


@pytest.mark.parametrize("where", ["off", "before", "on"])
def test_no_iteration_makes_the_plan_worse(short_ocp, solver, start_plans, where):
    """The merit is that of the true problem; a violation that the guess has may shrink."""
    for guess in start_plans[where]:
        plan, value = guess, merit(short_ocp.evaluate(guess))
        for _ in range(6):
            solution = solver.solve(plan, 1)
            after = short_ocp.evaluate(solution.plan)
            assert solution.iterations == 1
            assert merit(after) <= value
            assert solution.evaluation == after
            plan, value = solution.plan, merit(after)


def test_a_solution_is_kept(solver, fast):
    """Solving from it neither moves the plan nor its cost."""
    for solution in [*fast["before"], *fast["on"]]:
        again = solver.solve(solution.plan, 5)
        assert again.converged
        assert again.iterations == 1
        assert again.evaluation.cost == pytest.approx(solution.evaluation.cost, rel=1e-6)
        np.testing.assert_allclose(again.plan.zeta_dot, solution.plan.zeta_dot, atol=1e-2)


def test_the_solver_remembers_nothing(short_ocp, solver, start_plans):
    """The same guess gives the same plan, bit for bit, whatever was solved before."""
    guess = start_plans["on"][0]
    first = SequentialConvexSolver(short_ocp).solve(guess, 3)
    solver.solve(start_plans["off"][1], 2)
    again = solver.solve(guess, 3)
    np.testing.assert_array_equal(first.plan.zeta_dot, again.plan.zeta_dot)
    assert first.evaluation == again.evaluation


def with_limits(ocp: Ocp, **limits: object) -> Ocp:
    other = copy.copy(ocp)
    other.limits = replace(ocp.limits, **limits)
    return other


def test_inputs_that_cannot_hold_the_robot_leave_no_plan(short_ocp, start_plans):
    weak = with_limits(short_ocp, u=1e-3 * short_ocp.limits.u)
    solution = SequentialConvexSolver(weak).solve(start_plans["on"][0], 10)
    assert (solution.plan, solution.evaluation, solution.converged) == (None, None, False)
    assert solution.iterations >= 1


def test_a_start_too_fast_to_brake_leaves_no_plan(short_ocp, solver, start_plans):
    guess = start_plans["off"][0]
    zeta = guess.zeta[0].copy()
    zeta[0] = 1.0  # m/s, with 0.2 s to come down to 0.21 m/s
    fast_start = short_ocp.resting_plan(0.0, guess.config[0], zeta)
    assert solver.solve(fast_start, 10).plan is None
