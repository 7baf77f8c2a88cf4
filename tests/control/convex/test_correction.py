"""Tests of `control.convex.correction`: steps of the solver that stay within curved limits."""


import numpy as np
import pytest
from support.tracking import DIRECTION, POSITION, at_rest, follow, tracking_ocp

import uvms_drake as uv
from uvms_drake.control.convex.correction import (
    Correction,
    excess_rows,
    excesses,
)
from uvms_drake.control.convex.staged_solver import solve_staged
from uvms_drake.control.ocp.scp import SequentialConvexSolver
from uvms_drake.control.ocp.tracking_ocp import TrackingOcp, TrackingTarget
from uvms_drake.control.plan.plan import TrackingPlan
from uvms_drake.model.surface.surface_class import SurfaceClass
from uvms_drake.station.problem import first_problem


@pytest.fixture(scope="module")
def ocp() -> TrackingOcp:
    """A problem whose tip has far to go and soon reaches its speed limit."""
    return tracking_ocp().aimed(TrackingTarget(POSITION + 0.6 * DIRECTION, POSITION[0] + 0.5))


@pytest.fixture(scope="module")
def guess(ocp) -> TrackingPlan:
    """A plan within all limits that has far to go: at rest."""
    plan = ocp.resting_plan(0.0, at_rest(ocp, POSITION))
    assert ocp.is_sound(ocp.evaluate(plan))
    return plan


def test_excesses_are_those_of_the_problem(ocp, guess):
    """For a plan that exceeds some limits."""
    program = ocp.staged_program(guess)
    wild = guess.redone(guess.start, guess.decision + 3.0 * solve_staged(program).w)
    value, there = ocp.evaluate(wild), excesses(ocp.staged_program(wild))
    assert np.max(there) == pytest.approx(value.violation, rel=1e-9)
    assert value.violation > 1e-3


def revalued_is_the_program(ocp, guess) -> None:
    """Checks the values that a program gets from another plan against those of that plan's own."""
    rng = np.random.default_rng(0)
    other = guess.redone(guess.start, guess.decision + 0.05 * rng.normal(size=guess.decision.shape))
    own = ocp.staged_program(other)
    moved = ocp.revalued(ocp.staged_program(guess), other, ocp.points(other))
    np.testing.assert_allclose(moved.linear.value, own.linear.value, atol=1e-12)
    np.testing.assert_allclose(moved.terminal.value, own.terminal.value, atol=1e-12)
    for one, another in zip(moved.norms, own.norms, strict=True):
        np.testing.assert_allclose(one.value, another.value, atol=1e-12)
    if own.terminal.radius_bound is not None:
        np.testing.assert_allclose(
            moved.terminal.radius_bound.size, own.terminal.radius_bound.size, atol=1e-12)


@pytest.mark.parametrize("name", ["girona500_contact", "girona500_ideal",
                                  "paper_dynamic_resolved"])
def test_another_plan_has_the_values_of_its_own_program(name):
    scenario = uv.load_scenario(name)
    model = uv.load_model(scenario)
    ocp = uv.make_ocp(scenario, model)
    start = uv.start_state(scenario, ocp)[: ocp.state_size]
    if isinstance(ocp, TrackingOcp):
        ocp = first_problem(scenario, ocp, start)
    revalued_is_the_program(ocp, ocp.resting_plan(0.0, start))


def test_the_gradients_of_excesses_are_those_of_differences(ocp, guess, derivative):
    program = ocp.staged_program(guess)
    shape = (ocp.horizon + 2, program.H.shape[-1])
    at, along = np.random.default_rng(0).normal(size=(2, *shape))
    at[-1, program.B.shape[1]:] = along[-1, program.B.shape[1]:] = 0.0
    used = np.isfinite(excesses(program, at))
    slope = derivative(lambda s: np.where(used, excesses(program, at + s * along), 0.0), 1e-6)
    expected = np.sum(excess_rows(program, used, at) * along[np.nonzero(used)[0]], axis=1)
    assert np.count_nonzero(used) > used.size // 2
    np.testing.assert_allclose(slope[used], expected, rtol=1e-5, atol=1e-6)


def test_a_corrected_step_is_within_the_limits_at_the_same_cost(ocp, guess):
    """The remainder is of the order of the square of that of the step."""
    program = ocp.staged_program(guess)
    step = solve_staged(program)
    plan = guess.redone(guess.start, guess.decision + step.w)
    moved = plan.redone(plan.start, plan.decision + Correction(
        program, step.regulator, step.w).of(ocp.staged_program(plan)))
    before, after = ocp.evaluate(plan), ocp.evaluate(moved)
    assert before.violation > 5e-4
    assert after.violation < 2.0 * before.violation**2
    assert after.terminal_slack < 1e-6
    assert after.cost == pytest.approx(before.cost, rel=1e-3)


def test_at_a_terminal_radius_of_zero_the_end_is_corrected_all_the_same():
    """At the apex of a safe region, where the terminal set is the kink of a cone."""
    facets = SurfaceClass(DIRECTION, angle=0.2).facets
    ocp = tracking_ocp(facets=facets)
    aim = TrackingTarget(POSITION + [0.3, 0.1, 0.0], facets @ (POSITION + [0.02, 0.0, 0.0]))
    start = at_rest(ocp, POSITION)
    start[3:6] += [0.02, -0.03, 0.1]
    outside = []
    for problem, guess, _ in follow(ocp, 20 * [aim], ocp.resting_plan(0.0, start), 5):
        program = problem.staged_program(guess)
        step = solve_staged(program)
        plan = guess.redone(guess.start, guess.decision + step.w)
        moved = plan.redone(plan.start, plan.decision + Correction(
            program, step.regulator, step.w).of(problem.staged_program(plan)))
        before, after = (problem.evaluate(each).terminal_slack for each in (plan, moved))
        if before > 1e-5 and problem.is_sound(problem.evaluate(guess)):
            outside.append(after / before)
            radius_bound = np.min(problem.staged_program(moved).terminal.radius_bound.size)
    assert len(outside) > 3
    assert radius_bound < 1e-3
    assert max(outside) < 0.1


def test_a_sound_plan_takes_the_whole_step_in_one_iteration(ocp, guess):
    """Almost all of its gain; a step cut until it is sound gains a part of it."""
    whole = ocp.evaluate(guess.redone(
        guess.start, guess.decision + solve_staged(ocp.staged_program(guess)).w))
    assert not ocp.is_sound(whole)
    solution = SequentialConvexSolver(ocp).solve(guess, 1)
    assert ocp.is_sound(solution.evaluation)
    before = ocp.evaluate(guess).cost
    assert before - solution.evaluation.cost > 0.9 * (before - whole.cost) > 0.0
