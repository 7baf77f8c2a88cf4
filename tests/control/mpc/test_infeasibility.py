"""Tests of `uvms_drake.control.mpc.infeasibility`."""

import numpy as np
import pytest

import uvms_drake as uv
from uvms_drake.control.mpc.infeasibility import first_violation, infeasibility_reason
from uvms_drake.control.mpc.planner import FIRST_SOLVE_ITERATIONS
from uvms_drake.control.ocp.ocp import FEASIBLE
from uvms_drake.control.ocp.scp import SequentialConvexSolver


def first_guess(*overrides):
    scenario = uv.load_scenario("girona500_ideal", overrides)
    ocp = uv.make_ocp(scenario)
    return ocp, ocp.resting_plan(0.0, uv.start_state(scenario, ocp))


@pytest.mark.slow
def test_a_task_out_of_reach_differs_from_limits_that_cannot_be_kept():
    ocp, guess = first_guess("start.eta.0=-50")
    plan = SequentialConvexSolver(ocp).solve(guess, FIRST_SOLVE_ITERATIONS).plan
    why = infeasibility_reason(ocp, guess, plan, FEASIBLE)
    assert "to stay is within the limits, but the terminal set" in why
    assert "out of the reach of a plan of 3 s" in why
    assert "limits.u_" in why


def test_a_limit_that_is_broken_at_rest_is_named_with_its_first_instant_and_the_tube():
    ocp, guess = first_guess("start.eta.3=0.14")  # To hold this roll takes more than is left.
    ocp.limits["u"].bound[3] = 0.161
    why = infeasibility_reason(ocp, guess, None, FEASIBLE)
    assert why.startswith("at rest, limits.u_roll (tightened by 0.16) is ")
    assert why.endswith("from t = 0.00 s on")


def test_a_force_is_too_large_by_newtons():
    """Of the surface, not by the depth that its rows are in."""
    ocp, guess = first_guess()
    inside = guess.redone(guess.start + 0.5 * np.eye(20)[0], guess.decision)
    force = ocp.limits["static_force"]
    ocp.limits = {"static_force": force}
    pressed = float(force.surface.static_force(ocp.model.task_pose(inside.config[0])[:6]))
    assert f"is exceeded by {pressed - force.upper[0]:.3g} N from t = 0.20 s" in (
        infeasibility_reason(ocp, inside, None, FEASIBLE))


def test_a_start_within_the_wall_is_named():
    ocp, guess = first_guess()
    inside = guess.redone(guess.start + 0.5 * np.eye(20)[0], guess.decision)
    assert infeasibility_reason(ocp, inside, None, FEASIBLE).endswith(
        "; the tip starts 0.203 m deep in the surface")


def test_a_solver_that_finds_nothing_where_nothing_is_broken_is_to_blame_itself():
    reason = infeasibility_reason(*first_guess(), None, FEASIBLE)
    assert reason.startswith("the solver finds no plan")


@pytest.mark.parametrize("name", ["nu1", "roll", "u"])
def test_the_first_instant_of_an_excess_is_where_it_begins(name):
    ocp, guess = first_guess()
    plan = guess.redone(guess.start, 0.2 * np.sin(np.arange(guess.decision.size)).reshape(
        guess.decision.shape))
    found = {limit.name: (times, excess) for limit, times, excess in ocp.excesses(plan)}
    times, excess = found[name]
    middle = float(np.sort(np.max(excess, axis=1))[len(excess) // 2])
    ocp.limits = {name: ocp.limits[name]}
    first = first_violation(ocp, plan, middle)
    exceeded = np.max(excess, axis=1) > middle
    assert first.time <= times[np.argmax(exceeded)]
    assert any(excess[list(times).index(first.time), first.part] > middle
               and first.amount == np.max(excess[:, first.part])
               for _, times, excess in ocp.excesses(plan) if first.time in times)
    assert first_violation(ocp, plan, np.inf) is None
