"""Tests of `uvms_drake.control.ocp.tracking_ocp`: one problem for every target."""

import copy
from dataclasses import replace

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.solvers import SnoptSolver
from support.tracking import DIRECTION, POSITION, at_rest, follow, tracking_ocp

import uvms_drake as uv
from uvms_drake.control.contact.press_control import PlanExtent, plan_extent
from uvms_drake.control.costs.costs import OffsetCost
from uvms_drake.control.ocp.ocp import MpcConfig
from uvms_drake.control.ocp.scp import SequentialConvexSolver
from uvms_drake.control.ocp.solvers import NonlinearSolver
from uvms_drake.control.ocp.tracking_ocp import TrackingOcp, TrackingTarget
from uvms_drake.control.plan.plan import TrackingPlan
from uvms_drake.model.surface.surface_class import SurfaceClass

EXCEEDED = 1e-6


@pytest.fixture(scope="module")
def ocp() -> TrackingOcp:
    return tracking_ocp()


def somewhere(ocp: TrackingOcp, seed: int, scatter: float = 1.0) -> TrackingPlan:
    """Returns a guess from a random state in motion."""
    rng = np.random.default_rng(seed)
    state = at_rest(ocp, POSITION)
    state[:10] += scatter * rng.uniform(-1.0, 1.0, 10) * np.array(
        [0.05] * 3 + [0.02] * 3 + [0.04] * 4)
    state[10:] = scatter * rng.uniform(-1.0, 1.0, 10) * np.repeat([0.04, 0.02, 0.04], [3, 3, 4])
    return ocp.resting_plan(0.0, state)


def mpc_of(ocp: TrackingOcp) -> MpcConfig:
    """Returns the settings that the problem was made with."""
    weight_y, weight_zeta = np.split(np.diag(ocp.Q), 2)
    return MpcConfig(horizon=ocp.horizon, time_step=ocp.time_step, weight_y=weight_y,
                     weight_zeta=weight_zeta, weight_u=np.diag(ocp.R),
                     terminal_radius=ocp.terminal.radius)


def tip(ocp: TrackingOcp, config: np.ndarray) -> np.ndarray:
    return ocp.model.task_pose(config)[..., :3]


AIMS = {"free": TrackingTarget(POSITION + [0.4, -0.1, 0.2]),
        "safe_depth": TrackingTarget(POSITION + [0.4, -0.1, 0.2], POSITION[0] + 0.12)}


@pytest.mark.parametrize(("seed", "aim"), [
    (0, TrackingTarget(POSITION + [0.1, -0.05, 0.05])),
    (1, TrackingTarget(POSITION + [0.2, -0.1, 0.1], POSITION[0] + 0.05))])
def test_the_optimum_is_that_of_the_nonlinear_program(seed, aim):
    """Of 0.6 s and a wider V_o, which SNOPT, that knows nothing of its curvature, is fast with."""
    ocp = tracking_ocp(offset=OffsetCost(60.0, 0.05), overrides=("mpc.horizon=3",)).aimed(aim)
    guess = somewhere(ocp, seed, 0.4)
    one = SequentialConvexSolver(ocp).solve(guess, 200, 1e-10)
    other = NonlinearSolver(ocp, SnoptSolver()).solve(guess)
    assert one.converged and other.converged
    for solution in (one, other):
        assert solution.evaluation.violation < EXCEEDED
        assert solution.evaluation.terminal_slack < EXCEEDED
        np.testing.assert_array_equal(solution.plan.start, guess.start)
    assert one.evaluation.cost == pytest.approx(other.evaluation.cost, rel=1e-7)
    np.testing.assert_allclose(one.plan.a, other.plan.a, atol=1e-5)
    np.testing.assert_allclose(one.plan.zeta_dot, other.plan.zeta_dot, atol=1e-3)
    radius = ocp.terminal.radius if np.isinf(aim.safe_depth) else (
        aim.safe_depth - ocp.reference(one.plan)[0]) / ocp.depth_reach
    assert ocp.terminal_radius(one.plan) == pytest.approx(radius)
    if seed:  # The safe region leaves less than the whole set, and all of that is used.
        end = ocp.errors(one.plan, ocp.model.task_pose(one.plan.config))[-1]
        assert np.linalg.norm(ocp.terminal.root @ end) == pytest.approx(radius, abs=EXCEEDED)
        assert radius < ocp.terminal.radius


@pytest.mark.slow
def test_300_random_retargets_leave_every_problem_feasible_and_no_limit_exceeded():
    """The target jumps at every sample; the safe depth never falls."""
    ocp = tracking_ocp(overrides=("mpc.horizon=3",))
    rng, depth = np.random.default_rng(0), POSITION[0] + 0.02

    def aims():
        nonlocal depth
        for _ in range(300):
            depth += rng.choice([0.0, 0.0, 0.0005, 0.004])
            off = rng.uniform([-0.1, -0.4, -0.4], 0.4)
            yield TrackingTarget(np.array([depth, *POSITION[1:]]) + off, depth)

    start = ocp.resting_plan(0.0, at_rest(ocp, POSITION))
    moved, closest = 0.0, np.inf
    for problem, guess, plan in follow(ocp, aims(), start):
        for each in (guess, plan):
            value = problem.evaluate(each)
            assert value.violation <= EXCEEDED
            assert value.terminal_slack <= EXCEEDED
        positions = tip(problem, plan.config)
        assert np.all(positions @ DIRECTION <= problem.aim.safe_depth + EXCEEDED)
        moved += np.linalg.norm(positions[1] - positions[0])
        closest = min(closest, problem.aim.safe_depth - np.max(positions @ DIRECTION))
    assert moved > 1.0, "it does go somewhere"
    assert closest < 0.02, "and plans close to the boundary"


def test_each_problem_has_a_continuation_for_the_next_whatever_that_asks_for(ocp):
    """The same plan, continued, for aims that have nothing in common but the safe region."""
    problem = ocp.aimed(TrackingTarget(POSITION + DIRECTION, POSITION[0] + 0.05))
    plan = SequentialConvexSolver(problem).solve(
        problem.resting_plan(0.0, at_rest(ocp, POSITION)), 20).plan
    for _ in range(40):
        plan = problem.continued(plan)
        for target in (POSITION - 10.0 * DIRECTION, POSITION + 10.0 * np.ones(3)):
            value = ocp.aimed(TrackingTarget(target, POSITION[0] + 0.05)).evaluate(plan)
            assert max(value.violation, value.terminal_slack) <= EXCEEDED


@pytest.mark.parametrize("iterations", [1, 3])
def test_it_converges_to_a_target_within_reach(ocp, iterations):
    target = POSITION + [0.15, -0.1, 0.05]
    aims = 60 * [TrackingTarget(target, POSITION[0] + 0.2)]
    start = ocp.resting_plan(0.0, at_rest(ocp, POSITION))
    *_, (problem, _, plan) = follow(ocp, aims, start, iterations)
    np.testing.assert_allclose(tip(problem, plan.config)[0], target, atol=5e-4)
    np.testing.assert_allclose(problem.reference(plan)[:3], target, atol=5e-4)
    assert np.max(np.abs(plan.zeta)) < 1e-3


def test_within_the_safe_region_it_converges_to_the_place_nearest_to_the_target(ocp):
    """For a V_o that is a function of the distance, the projection of the target."""
    depth = POSITION[0] + 0.05
    aims = 70 * [TrackingTarget(POSITION + [0.2, -0.1, 0.05], depth)]
    start = ocp.resting_plan(0.0, at_rest(ocp, POSITION))
    for problem, _, plan in follow(ocp, aims, start):
        assert tip(problem, plan.config)[0] @ DIRECTION <= depth + EXCEEDED
    nearest = np.array([depth, POSITION[1] - 0.1, POSITION[2] + 0.05])
    np.testing.assert_allclose(tip(problem, plan.config)[0], nearest, atol=5e-4)


def test_between_knots_the_tip_stays_in_the_safe_region_but_for_its_third_derivative(ocp):
    """It runs into the boundary as fast as it may."""
    depth = POSITION[0] + 0.06
    start = ocp.resting_plan(0.0, at_rest(ocp, POSITION))
    deepest, jerk = -np.inf, 0.0
    targets = 20 * [TrackingTarget(POSITION + DIRECTION, depth)]
    for problem, _, plan in follow(ocp, targets, start, 2):
        times = plan.start_time + np.linspace(0.0, 0.2, 81)
        x = np.array([tip(problem, plan.at(t, plan.start_time)[0]) @ DIRECTION for t in times])
        deepest = max(deepest, np.max(x) - depth)
        jerk = max(jerk, np.max(np.abs(np.diff(x[::8], 3))) / 0.02**3)
    assert -2e-3 < deepest <= 2.0 / 81.0 * 0.2**3 * 1.5 * jerk + EXCEEDED


def test_what_is_not_the_same_everywhere_is_refused(ocp, model):
    box = uv.limits.TipBox(lower_corner=POSITION - 1.0, upper_corner=POSITION + 1.0)
    mpc = mpc_of(ocp)
    with pytest.raises(uv.InvalidParameter, match=r"limits\.tip"):
        TrackingOcp(ocp.model, mpc, ocp.y_des, {**ocp.limits, "tip": box}, DIRECTION)
    with pytest.raises(uv.InvalidParameter, match="model = 'ContactModel'"):
        TrackingOcp(model, mpc, ocp.y_des, ocp.limits, DIRECTION)
    with pytest.raises(uv.InvalidParameter, match="direction"):
        TrackingOcp(ocp.model, mpc, ocp.y_des, ocp.limits, 2.0 * DIRECTION)
    for key, value in (("terms", [uv.costs.LevelVehicle()]), ("terminal_set", False),
                       ("terminal_weight", np.ones(20))):
        other = replace(mpc, **{key: value})
        with pytest.raises(uv.InvalidParameter, match=key):
            TrackingOcp(ocp.model, other, ocp.y_des, ocp.limits, DIRECTION)
    with pytest.raises(uv.InvalidParameter, match="slope"):
        TrackingOcp(ocp.model, mpc, ocp.y_des, ocp.limits, DIRECTION,
                    offset=OffsetCost(slope=0.0))


def test_a_strict_problem_never_leaves_a_sound_plan_for_another(ocp):
    """Where a full step breaks a limit by curvature alone, a shorter one is taken."""
    problem = ocp.aimed(AIMS["safe_depth"])
    lax = copy.copy(problem)
    lax.strict = False
    guess = problem.resting_plan(0.0, at_rest(ocp, POSITION))
    one, other = (SequentialConvexSolver(each).solve(guess, 1).evaluation
                  for each in (problem, lax))
    assert problem.is_sound(one) and one.merit < problem.evaluate(guess).merit
    assert not problem.is_sound(other)


# Where across a plan goes -------------------------------------------------------------------------


WALLS = SurfaceClass(DIRECTION, angle=0.1)


@pytest.fixture(scope="module")
def planned():
    """A plan off to the side, and its problem."""
    ocp = tracking_ocp(overrides=("mpc.horizon=4",)).aimed(
        TrackingTarget(POSITION + [0.0, 0.3, -0.2], POSITION[0] + 0.1))
    guess = ocp.resting_plan(0.0, at_rest(ocp, POSITION))
    return ocp, SequentialConvexSolver(ocp).solve(guess, 20).plan


def test_no_instant_of_the_plan_is_further_across_than_its_places(planned):
    ocp, plan = planned
    places = plan_extent(ocp, plan) @ WALLS.axes[1:].T
    for time in np.linspace(0.0, 4.0 * plan.time_step, 81):
        tip = WALLS.axes[1:] @ ocp.model.task_pose(plan.at(time)[0])[:3]
        assert np.all(tip <= places.max(axis=0) + 1e-4)
        assert np.all(tip >= places.min(axis=0) - 1e-4)
    assert np.ptp(places, axis=0).max() > 0.01, "it does go somewhere"


def test_its_places_are_between_the_ends_that_are_put_out(planned):
    ocp, plan = planned
    system = PlanExtent(ocp, WALLS)
    context = system.CreateDefaultContext()
    system.GetInputPort("plan").FixValue(context, Value(plan))
    places = plan_extent(ocp, plan) @ WALLS.axes[1:].T
    ends = system.get_output_port().Eval(context).reshape(2, 2)
    np.testing.assert_allclose(ends, [places.min(axis=0), places.max(axis=0)])
    resting = ocp.resting_plan(0.0, at_rest(ocp, POSITION))
    system.GetInputPort("plan").FixValue(context, Value(resting))
    ends = system.get_output_port().Eval(context).reshape(2, 2)
    np.testing.assert_allclose(ends, np.tile(WALLS.axes[1:] @ POSITION, (2, 1)), atol=1e-9)
