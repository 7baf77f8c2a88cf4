"""Tests of a reference that turns about the vertical, too (`control.ocp.tracking_ocp`)."""

import copy
import dataclasses

import numpy as np
import pytest
from support.tracking import DIRECTION, POSITION, SURFACE, at_rest, follow, tracking_ocp

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.control.ocp.scp import SequentialConvexSolver
from uvms_drake.control.ocp.tracking_ocp import TURNED_FREELY, TrackingOcp, TrackingTarget
from uvms_drake.control.plan.plan import DynamicPlan
from uvms_drake.control.plan.tracking_plan import TrackingPlan
from uvms_drake.model.frames.euler import rotation_matrix
from uvms_drake.tube.terminal_set import TerminalLoop, boundary_samples, largest_radius

TURN = 0.25
"""Largest turn of the reference [rad]."""
EXCEEDED = 1e-6


@pytest.fixture(scope="module")
def ocp() -> TrackingOcp:
    return tracking_ocp(turn=TURN)


def about_the_vertical(turn: float) -> np.ndarray:
    return rotation_matrix(np.array([0.0, 0.0, turn]))


def in_motion(ocp: TrackingOcp, seed: int) -> TrackingPlan:
    """Returns a plan from a state in motion, with accelerations of any kind."""
    rng = np.random.default_rng(seed)
    state = at_rest(ocp, POSITION)
    state[:10] += rng.uniform(-1.0, 1.0, 10) * np.array([0.05] * 3 + [0.02] * 3 + [0.04] * 4)
    state[10:] = rng.uniform(-1.0, 1.0, 10) * np.repeat([0.04, 0.02, 0.04], [3, 3, 4])
    plan = ocp.resting_plan(0.0, state)
    return plan.redone(plan.start, plan.decision + rng.uniform(-0.01, 0.01, plan.decision.shape)
                       * (np.arange(len(plan.decision)) > 0)[:, None])


def turned(plan: TrackingPlan, turn: float) -> TrackingPlan:
    """Returns the same motion of a robot that is turned about the vertical through `POSITION`."""
    R, start = about_the_vertical(turn), plan.start.copy()
    start[:3], start[5] = POSITION + R @ (start[:3] - POSITION), start[5] + turn
    decision = plan.decision.copy()
    decision[0, :3], decision[0, 3] = R @ plan.a[:3], plan.a[3] + turn
    return plan.redone(start, decision)


@pytest.mark.parametrize("turn", [-0.2, 0.1])
def test_a_turned_problem_has_the_same_cost_and_motion(turn):
    """Without forces of a wall, whose direction stays: the whole loop turns with the robot."""
    ocp = tracking_ocp(force=0.0, turn=TURN)
    plan, place = in_motion(ocp, 1), np.array([0.1, -0.05, 0.05])
    plan = dataclasses.replace(plan, a=np.append(plan.a[:3], 0.01))
    one = ocp.aimed(TrackingTarget(POSITION + place, turn=0.02))
    other = ocp.aimed(TrackingTarget(POSITION + about_the_vertical(turn) @ place, turn=0.02 + turn))
    here, there = one.evaluate(plan), other.evaluate(turned(plan, turn))
    assert here.cost == pytest.approx(there.cost, rel=1e-9)
    assert here.total_violation == pytest.approx(there.total_violation, abs=1e-9)
    np.testing.assert_allclose(other.continued(turned(plan, turn)).zeta_dot,
                               one.continued(plan).zeta_dot, atol=1e-9)
    solved = [SequentialConvexSolver(problem).solve(guess, 30, 1e-10).plan
              for problem, guess in ((one, plan), (other, turned(plan, turn)))]
    np.testing.assert_allclose(solved[1].zeta_dot, solved[0].zeta_dot, atol=2e-4)
    np.testing.assert_allclose(solved[1].a, turned(solved[0], turn).a, atol=2e-5)


def test_it_turns_as_asked_about_a_tip_at_its_place(ocp):
    """All of the robot turns: the joints are what they were, the tip where it was."""
    start = ocp.resting_plan(0.0, at_rest(ocp, POSITION))
    targets = 150 * [TrackingTarget(POSITION, POSITION[0] + 0.02, 0.15)]
    *_, (problem, _, plan) = follow(ocp, targets, start)
    y = problem.model.task_pose(plan.config)[0]
    np.testing.assert_allclose(y[:3], POSITION, atol=5e-4)
    np.testing.assert_allclose(y[3:6], [0.0, 0.0, 0.15], atol=3e-3)
    np.testing.assert_allclose(y[6:], ocp.y_des[6:], atol=3e-3)
    assert plan.config[0, 5] == pytest.approx(at_rest(ocp, POSITION)[5] + 0.15, abs=3e-3)


def test_it_turns_no_further_than_it_may_and_keeps_its_terminal_set_there(ocp):
    start = ocp.resting_plan(0.0, at_rest(ocp, POSITION))
    *_, (problem, _, plan) = follow(ocp, 200 * [TrackingTarget(POSITION, turn=2.0)], start)
    assert plan.a[3] == pytest.approx(TURNED_FREELY * TURN, abs=3e-3)
    assert problem.terminal_radius(plan) == pytest.approx(ocp.terminal.radius, rel=0.05)
    assert problem.terminal_radius(dataclasses.replace(plan, a=np.append(plan.a[:3], TURN))) == (
        pytest.approx(0.0, abs=1e-12))


@pytest.mark.parametrize("facets", [DIRECTION[None], SURFACE.facets])
def test_turns_and_places_at_random_leave_every_problem_feasible(facets):
    """Another place and another turn at every sample; the safe region never shrinks."""
    ocp = tracking_ocp(overrides=("mpc.horizon=3",), facets=facets, turn=TURN)
    rng, depth = np.random.default_rng(5), POSITION[0] + 0.02

    def aims():
        nonlocal depth
        for _ in range(60):
            depth += rng.choice([0.0, 0.0, 0.0005, 0.004])
            off = rng.uniform([-0.1, -0.4, -0.4], 0.4)
            apex = np.array([depth, *POSITION[1:]])
            yield TrackingTarget(apex + off, facets @ apex, rng.uniform(-0.5, 0.5))

    way = 0.0
    for problem, guess, plan in follow(ocp, aims(), ocp.resting_plan(0.0, at_rest(ocp, POSITION))):
        for each in (guess, plan):
            value = problem.evaluate(each)
            assert max(value.violation, value.terminal_slack) <= EXCEEDED
        way += abs(plan.config[1, 5] - plan.config[0, 5])
    assert way > 0.1, "it does turn"


@pytest.fixture(scope="module")
def found(ocp) -> float:
    radius, check = largest_radius(ocp, samples=100)
    assert check.holds
    return radius


@pytest.mark.slow
def test_there_is_one_terminal_set_for_all_turns(ocp, found):
    """Its margins are the worst of those of the turned problems, and no set is larger for it."""
    straight = largest_radius(tracking_ocp(), samples=100)[0]
    assert 0.2 < found <= 1.02 * straight
    loop = TerminalLoop(ocp)
    states = found * boundary_samples(loop.P, 50, np.random.default_rng(4))
    others = np.array([TerminalLoop(other, T).margins(states) for T, other in ocp.turned()])
    np.testing.assert_allclose(loop.margins(states), np.min(others, axis=0), atol=1e-12)
    decrease = loop.names.index("decrease")
    np.testing.assert_allclose(others[:, :, decrease], others[:1, :, decrease].repeat(5, axis=0),
                               rtol=1e-6, atol=1e-6, err_msg="it turns with the robot")
    assert np.ptp(others[:, :, loop.names.index("u[7] pressed, most end")], axis=0).max() > 1e-4


@pytest.mark.slow
def test_in_that_set_the_continued_plan_keeps_safe_region_and_inputs_for_every_turn(ocp, found):
    """At fresh states and turns, between those that were looked at, too."""
    rng = np.random.default_rng(83)
    states = boundary_samples(ocp.terminal.P, 120, rng)
    for local in found * rng.uniform(0.01, 1.0, size=(len(states), 1)) * states:
        size = np.sqrt(local @ ocp.terminal.P @ local)
        a = np.append(rng.uniform(-5.0, 5.0, 3), rng.uniform(-0.95, 0.95) * TURN)
        xi = local.copy()
        xi[:3] = about_the_vertical(a[3]) @ local[:3]
        y = ocp.y_des + np.concatenate([a[:3], np.zeros(2), a[3:], np.zeros(4)])
        one = ocp.aimed(TrackingTarget(rng.uniform(-5.0, 5.0, 3),
                            DIRECTION @ y[:3] + size * ocp.depth_reach, rng.uniform(-0.2, 0.2)))
        one.horizon, one.terminal = 1, dataclasses.replace(one.terminal, radius=found)
        start = np.concatenate([one.model.configuration(y + xi[:10]), xi[10:]])
        plan = TrackingPlan(**vars(DynamicPlan.from_accelerations(
            0.0, one.time_step, *np.split(start, 2), (one.terminal.gain @ local)[None])), a=a)
        value = one.evaluate(plan)
        assert max(value.violation, value.terminal_slack) <= 1e-9


def test_what_changes_with_the_heading_is_refused(ocp):
    with pytest.raises(InvalidParameter, match="weight_y"):
        tracking_ocp(turn=TURN, overrides=("mpc.weight_y=[1,2,1,1,1,1,1,1,1,1]",))
    with pytest.raises(InvalidParameter, match="turn"):
        tracking_ocp(turn=2.0)
    lying = copy.copy(ocp.model)
    lying.R_WT = rotation_matrix(np.array([0.0, -0.5 * np.pi, 0.0]))
    other = copy.copy(ocp)
    other.model = lying
    with pytest.raises(InvalidParameter, match=r"task\.frame"):
        other._require_the_same_everywhere()
