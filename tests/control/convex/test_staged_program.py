"""Tests of `uvms_drake.control.convex.staged_program`, against the program written out in full."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.solvers import ClarabelSolver
from support.tracking import DIRECTION, POSITION, at_rest, follow, tracking_ocp

from uvms_drake.control.convex.least_norm_conic import least_norm
from uvms_drake.control.convex.regulator import Regulator, motion, riccati
from uvms_drake.control.convex.staged_program import (
    ActiveLimits,
    LinearLimits,
    NormLimit,
    RadiusBound,
    StagedProgram,
    TerminalLimit,
    WorkingSet,
)
from uvms_drake.control.convex.staged_solver import solve_staged
from uvms_drake.control.ocp.tracking_ocp import TrackingTarget
from uvms_drake.control.plan.plan import Plan
from uvms_drake.model.surface.surface_class import SurfaceClass


def in_full(program: StagedProgram) -> tuple[np.ndarray, float, float, float] | None:
    """Returns w, s, v and the cost: every variable and every limit goes to the conic solver."""
    prog = program.mathematical_program()
    result = ClarabelSolver().Solve(prog)
    if not result.is_success():
        return None
    return (result.GetSolution(prog.w), *result.GetSolution(prog.s), *result.GetSolution(prog.v),
            result.get_optimal_cost())


def value(program: StagedProgram, w: np.ndarray, slack: float, excess: float) -> float:
    """Returns the cost of a change."""
    x, total = np.zeros(program.A.shape[1]), 0.0
    for A, B, H, g, w_k in zip(program.A, program.B, program.H, program.g, w, strict=True):
        z = np.concatenate([x, w_k])
        total += 0.5 * z @ H @ z + g @ z
        x = A @ x + B @ w_k
    total += 0.5 * x @ program.H_end @ x + program.g_end @ x
    return total + program.slack_penalty * slack + program.excess_penalty * excess


def random_program(seed: int, scale: float, radius: float = 0.2) -> StagedProgram:
    """Returns a program of 5 stages, 4 states and 2 decisions; more `scale` leaves more free."""
    rng = np.random.default_rng(seed)
    N, nx, nw, m = 5, 4, 2, 3
    roots = rng.normal(size=(N, nx + nw, nx + nw))
    C = rng.normal(size=(N + 1, m, nx + nw))
    C[N, :, nx:] = 0.0
    bound = scale * rng.uniform(0.5, 1.5, size=(N + 1, m))
    bound[0] = np.inf
    T = rng.normal(size=(3, nx))
    return StagedProgram(
        A=np.eye(nx) + 0.3 * rng.normal(size=(N, nx, nx)), B=rng.normal(size=(N, nx, nw)),
        H=np.swapaxes(roots, 1, 2) @ roots + 0.1 * np.eye(nx + nw),
        g=rng.normal(size=(N, nx + nw)), H_end=np.eye(nx), g_end=rng.normal(size=nx),
        linear=LinearLimits(C, 0.2 * rng.uniform(-1, 1, size=(N + 1, m)), -bound, bound,
                            np.array([True, False, False])),
        norms=(NormLimit(np.hstack([rng.normal(size=(2, nx)), np.zeros((2, nw))]),
                         0.1 * rng.normal(size=(N + 1, 2)),
                         np.concatenate([[np.inf], np.full(N, scale)])),
               NormLimit(np.eye(6)[4:], 0.1 * rng.normal(size=(N + 1, 2)),
                         np.concatenate([np.full(N, scale), [np.inf]]))),
        terminal=TerminalLimit(T, 0.1 * rng.normal(size=3), radius * scale),
        slack_penalty=1.0, excess_penalty=2.0)


def end_of(program: StagedProgram, w: np.ndarray) -> np.ndarray:
    """Returns x_N after a change w."""
    x = np.zeros(program.A.shape[1])
    for A, B, w_k in zip(program.A, program.B, w, strict=True):
        x = A @ x + B @ w_k
    return x


def test_multipliers_of_named_limits_belong_to_the_limits_that_are_reached():
    """Complementary slackness, and the sum of the soft ones where they are relaxed."""
    reached, relaxed = 0, 0
    for seed in range(8):
        staged = random_program(seed, 0.3)
        program = staged.mathematical_program()
        result = ClarabelSolver().Solve(program)
        if not result.is_success():
            continue
        soft = 0.0
        for binding in program.linear_constraints():
            assert binding.evaluator().get_description().startswith("limits[")
            rows, A = binding.evaluator(), binding.evaluator().GetDenseA()
            value = A @ result.GetSolution(binding.variables())
            dual = result.GetDualSolution(binding)
            room = np.where(dual < 0.0, rows.upper_bound() - value, value - rows.lower_bound())
            active = np.abs(dual) > 1e-6
            assert np.all(np.abs(dual * room)[active] < 1e-5)
            reached += np.count_nonzero(active)
            by_v = [v.get_id() == program.v[0].get_id() for v in binding.variables()]
            soft += np.sum(np.abs(dual)[:, None] * np.abs(A[:, by_v]))
        v = result.GetSolution(program.v)[0]
        if v > 1e-4:
            relaxed += 1
            assert soft == pytest.approx(staged.excess_penalty, rel=1e-4)
    assert reached > 5
    assert relaxed > 0


KINDS = ("free", "by rows", "by cones", "infeasible")


def compare(program: StagedProgram) -> str:
    """Checks a solution against that in full; returns which limits had a say."""
    found, reference = solve_staged(program), in_full(program)
    if reference is None:
        assert found is None
        return "infeasible"
    w, slack, excess, cost = reference
    scale = max(1.0, abs(cost))
    assert value(program, found.w, found.slack, found.excess) == pytest.approx(
        cost, abs=1e-6 * scale)
    np.testing.assert_allclose(found.w, w, atol=1e-3 * max(1.0, np.max(np.abs(w))))
    assert found.slack == pytest.approx(slack, abs=1e-4)
    assert found.excess == pytest.approx(excess, abs=1e-5)
    if found.rows == 0:
        return "free"
    return "by rows" if found.cone_programs == 0 else "by cones"


@pytest.mark.parametrize("seeds", [12, pytest.param(80, marks=pytest.mark.long)])
def test_random_programs_have_the_solution_of_the_program_in_full(seeds):
    kinds = [compare(random_program(seed, scale))
             for scale in (0.03, 0.3, 1.0, 100.0) for seed in range(seeds)]
    kinds += [compare(random_program(seed, scale, radius=100.0))
              for scale in (0.3, 1.0) for seed in range(seeds)]
    assert set(KINDS) == {kind for kind in KINDS if kinds.count(kind) > 5}


@pytest.mark.parametrize("seeds", [8, pytest.param(80, marks=pytest.mark.long)])
def test_a_terminal_set_that_matters_needs_no_conic_program(seeds):
    """With a radius that is constant or falls with the end, and penalties that forbid a slack."""
    kinds = []
    for seed in range(seeds):
        for scale in (0.1, 1.0, 3.0):
            program = replace(random_program(seed, scale), slack_penalty=100.0,
                              excess_penalty=1000.0)
            row = np.random.default_rng(seed).normal(size=(1, 4))
            falling = program.terminal._replace(
                radius_bound=RadiusBound(np.array([0.2 * scale]), row))
            for each in (program, replace(program, terminal=falling)):
                kind, found = compare(each), solve_staged(each)
                ends = found is not None and each.terminal.excess(
                    end_of(each, found.w)) > found.slack - 1e-6
                kinds.append((kind, ends, found is not None and found.slack > 1e-6))
    without_slack = [kind for kind, ends, slack in kinds if ends and not slack]
    assert without_slack.count("by rows") >= 0.97 * len(without_slack) > 0.5 * len(kinds)


def test_plans_at_the_safe_region_end_at_a_terminal_radius_of_zero():
    """The kink of the terminal set's cone, which is no cone there but equalities."""
    facets = SurfaceClass(DIRECTION, angle=0.2).facets
    ocp = tracking_ocp(facets=facets)
    aim = TrackingTarget(POSITION + [0.3, 0.1, 0.0], facets @ (POSITION + [0.02, 0.0, 0.0]))
    kinds = []
    start = ocp.resting_plan(0.0, at_rest(ocp, POSITION))
    for problem, guess, _ in follow(ocp, 8 * [aim], start, 3):
        kinds.append(compare(problem.staged_program(guess)))
    assert kinds.count("by rows") > 4


def test_both_relaxations_and_more_than_one_conic_program_occur():
    """Otherwise the comparison would say nothing about them."""
    found = [solve_staged(random_program(seed, scale))
             for scale in (0.1, 0.3, 1.0) for seed in range(12)]
    found = [solution for solution in found if solution is not None]
    assert max(solution.slack for solution in found) > 0.1
    assert min(solution.slack for solution in found) < 1e-6
    assert max(solution.excess for solution in found) > 1e-3
    assert max(solution.cone_programs for solution in found) > 1


def test_without_an_excess_the_price_of_one_is_the_derivative_by_it():
    """Checked by widening the soft rows a little."""
    seen = []
    for seed in range(20):
        program = random_program(seed, 0.3)
        regulator, wide = riccati(program), 1e-4 * program.linear.soft
        z = motion(program, regulator)
        kept = WorkingSet.broken(program, z, 0.0)
        widened = replace(program, linear=program.linear._replace(
            lower=program.linear.lower - wide, upper=program.linear.upper + wide))
        here, there = (least_norm(each, regulator, z, kept, softened=False)
                       for each in (program, widened))
        if here is not None and there is not None:
            saved = [0.5 * np.sum(each.r**2) + program.slack_penalty * each.slack
                     for each in (here, there)]
            assert (saved[0] - saved[1]) / 1e-4 == pytest.approx(
                here.multiplier, rel=0.05, abs=1e-2)
            seen.append(here.multiplier)
    assert max(seen) > program.excess_penalty > min(seen)


def test_a_solution_knows_its_active_limits_and_any_guess_of_them_leads_to_it():
    """All active ones are at their bounds."""
    rng, count = np.random.default_rng(0), 0
    for seed in range(30):
        program = random_program(seed, 1.0)
        found = solve_staged(program)
        if found is None or found.active is None:
            continue
        linear, z = program.linear, np.zeros((6, 6))
        z[:-1, 4:] = found.w
        for k in range(5):
            z[k + 1, :4] = program.A[k] @ z[k, :4] + program.B[k] @ z[k, 4:]
        value = linear.value + np.einsum("kij,kj->ki", linear.C, z)
        np.testing.assert_allclose((value - linear.upper)[found.active.upper], 0.0, atol=1e-6)
        np.testing.assert_allclose((value - linear.lower)[found.active.lower], 0.0, atol=1e-6)
        for limit, stages in zip(program.norms, found.active.norms, strict=True):
            norms = np.linalg.norm(limit.value + z @ limit.C.T, axis=1)
            np.testing.assert_allclose((norms - limit.bound)[stages], 0.0, atol=1e-6)
        wrong = ActiveLimits(*(rng.random(each.shape) < 0.3 for each in found.active))
        for guess in (None, found.active, wrong):
            again = solve_staged(replace(program, similar=guess))
            np.testing.assert_allclose(again.w, found.w, atol=1e-7)
        count += 1
    assert count > 10


@pytest.mark.parametrize("where", ["off", "before", "on"])
def test_programs_of_the_ideal_scenario_have_the_solution_of_the_program_in_full(
        short_ocp, start_plans, where):
    kinds = {compare(short_ocp.staged_program(guess)) for guess in start_plans[where]}
    assert kinds and "infeasible" not in kinds


def moved(program: StagedProgram, regulator: Regulator, r: np.ndarray) -> np.ndarray:
    """Returns states and decisions (6, 6) of the motion under the law, stage by stage."""
    z = np.zeros((6, 6))
    for k in range(5):
        z[k, 4:] = regulator.K[k] @ z[k, :4] + regulator.k[k] + regulator.W[k] @ r[k]
        z[k + 1, :4] = program.A[k] @ z[k, :4] + program.B[k] @ z[k, 4:]
    return z


def test_the_regulator_completes_the_square():
    """cost(r) − cost(0) = ½ ‖r‖², whatever r."""
    program = random_program(3, 100.0)
    regulator = riccati(program)
    r = np.random.default_rng(0).normal(size=(3, 5, 2)) * [[[0.0]], [[1.0]], [[2.0]]]
    costs = [value(program, moved(program, regulator, each)[:-1, 4:], 0.0, 0.0) for each in r]
    np.testing.assert_allclose(
        np.array(costs) - costs[0], 0.5 * np.sum(r**2, axis=(1, 2)), rtol=1e-9)


def test_the_program_is_the_first_order_model_of_the_problem(short_ocp, start_plans, derivative):
    """Along any change of the decision: gradient of the cost, and every limited value."""
    guess = start_plans["on"][1]
    program = short_ocp.staged_program(guess)
    rng = np.random.default_rng(2)
    change = rng.normal(size=guess.zeta_dot.shape)
    x, z, slope = np.zeros(20), [], 0.0
    for k in range(short_ocp.horizon):
        z.append(np.concatenate([x, change[k]]))
        slope += program.g[k] @ z[k]
        x = program.A[k] @ x + program.B[k] @ change[k]
    z.append(np.concatenate([x, np.zeros(10)]))
    slope += program.g_end @ x

    def moved(s: float) -> Plan:
        return guess.redone(guess.start, guess.zeta_dot + s * change)

    def smooth_cost(s: float) -> float:
        evaluation = short_ocp.evaluate(moved(s))
        return evaluation.cost - program.slack_penalty * evaluation.terminal_slack

    assert derivative(smooth_cost, 1e-4) == pytest.approx(slope, rel=1e-6)
    rows = derivative(lambda s: np.concatenate(short_ocp.inputs(moved(s)), axis=1), 1e-5)
    predicted = (program.linear.C @ np.array(z)[..., None])[..., 0]
    np.testing.assert_allclose(rows, predicted[:-1, :20], rtol=1e-4, atol=1e-4)
    y = derivative(lambda s: short_ocp.model.task_pose(moved(s).config), 1e-5)
    np.testing.assert_allclose(y[1:], np.array(z)[1:, :10], atol=1e-6)


def test_responses_and_gradients_of_rows_are_those_of_the_motion_under_the_law():
    """The motion stage by stage, for one entry of r after the other; rows of stages in any order.

    A later r does not change an earlier stage.
    """
    program = random_program(5, 1.0)
    regulator, rng = riccati(program), np.random.default_rng(0)
    at_rest = moved(program, regulator, np.zeros((5, 2)))
    np.testing.assert_allclose(motion(program, regulator), at_rest, atol=1e-12)
    by_r = np.stack([moved(program, regulator, unit.reshape(5, 2)) - at_rest
                     for unit in np.eye(10)], axis=-1)
    np.testing.assert_allclose(regulator.responses, by_r, atol=1e-12)
    r = rng.normal(size=(5, 2))
    np.testing.assert_allclose(
        regulator.moved(r), moved(program, regulator, r) - at_rest, atol=1e-12)
    stages = np.array([3, 5, 0, 5, 1, 3])
    C = rng.normal(size=(6, 6))
    C[stages == 5, 4:] = 0.0
    np.testing.assert_allclose(regulator.row_gradients(stages, C),
                               np.einsum("mz,mzr->mr", C, by_r[stages]), atol=1e-12)
    assert regulator.row_gradients(stages[:0], C[:0]).shape == (0, 10)
