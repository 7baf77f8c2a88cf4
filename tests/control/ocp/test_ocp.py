"""Tests of `uvms_drake.control.ocp.ocp`: the problem of the ideal scenario."""

import numpy as np
import pytest
from support import dh
from support.limits import with_limits

import uvms_drake as uv
from uvms_drake.control.ocp.ocp import TERMINAL_PENALTY, Ocp
from uvms_drake.control.plan.plan import Plan, advance

H = 0.2  # s
MPC = uv.load_scenario("girona500_ideal").mpc
Q = np.concatenate([MPC.weight_y, MPC.weight_zeta])
R = MPC.weight_u


def plan_around(ocp, seed: int, depth: float = 0.0) -> Plan:
    """Returns a plan of 4 intervals that moves in all coordinates near the wall."""
    rng = np.random.default_rng(seed)
    y = ocp.y_des + rng.uniform(-0.2, 0.2, size=10)
    y[0] = depth
    zeta = rng.uniform(-0.1, 0.1, size=10)
    zeta[:3] = 0.01, -0.02, 0.015
    zeta_dot = rng.uniform(-0.1, 0.1, size=(4, 10))
    zeta_dot[:, :3] *= 0.01
    return Plan.from_accelerations(0.0, H, ocp.model.configuration(y), zeta, zeta_dot)


@pytest.fixture(params=["free", "in contact"])
def plan(request, ocp) -> Plan:
    plan = plan_around(ocp, 1, depth={"free": -0.3, "in contact": 0.05}[request.param])
    touches = ocp.model.surface.penetration(ocp.model.task_pose(plan.config)[:, :6]) > 0.01
    assert np.all(touches) if request.param == "in contact" else not np.any(touches)
    return plan


@pytest.fixture
def limited_forces(ocp) -> Ocp:
    """The problem with limits on the forces, of some size."""
    return with_limits(ocp, tau=np.full(10, 50.0))


def forces(ocp, plan) -> np.ndarray:
    """Returns M(𝔮̄)ū (2, N, 10) at the beginning and at the end of every interval."""
    model, N = ocp.model, len(plan.zeta_dot)
    return np.array([[
        model.mass_matrix(model.kinematics(plan.config[k + end]))
        @ (plan.zeta_dot[k] - model.drift(plan.config[k + end], plan.zeta[k + end]))
        for k in range(N)] for end in (0, 1)])


# First-order model -------------------------------------------------------------------------------


def test_every_derivative_is_that_of_differences(plan, derivative):
    """Of the next y and of the drift, by y with the 𝔮 that belongs to it, by ζ and by ζ̇."""
    ocp = uv.make_ocp(uv.load_scenario("girona500_ideal", ["mpc.horizon=4"]))
    model, knots, program = ocp.model, ocp.points(plan).knots, ocp.staged_program(plan)
    y, zeta, (f_y, f_zeta) = knots.y, plan.zeta, ocp._drift_slopes(plan, knots)
    y_y, y_zeta, y_zeta_dot = program.A[:, :10, :10], program.A[:, :10, 10:], program.B[:, :10]

    def after(dy=0.0, dzeta=0.0, da=0.0):
        start = model.configuration(y[:-1] + dy)
        return model.task_pose(advance(start, zeta[:-1] + dzeta, plan.zeta_dot + da, H))

    def drift(dy=0.0, dzeta=0.0):
        return model.drift(model.configuration(y + dy), zeta + dzeta)

    for of, argument, found, step in (
            (after, "dy", y_y, 1e-3), (after, "dzeta", y_zeta, 1e-3),
            (after, "da", y_zeta_dot, 1e-3), (drift, "dy", f_y, 1e-4),
            (drift, "dzeta", f_zeta, 1e-6),
            (lambda dy: model.configuration(y + dy), "dy", knots.config_y, 1e-3)):
        for j, d in enumerate(np.eye(10)):
            expected = derivative(lambda s, of=of, key=argument, d=d: of(**{key: s * d}), step)
            np.testing.assert_allclose(
                found[..., j], expected, rtol=1e-6, atol=1e-8 * max(1.0, np.max(np.abs(found)))
                if argument != "dzeta" or of is after else 2e-6)


# Objective and limits ----------------------------------------------------------------------------


def test_the_cost_is_the_sum_that_the_documentation_says(ocp, plan):
    def xi(k: int) -> np.ndarray:
        y = np.concatenate([dh.chi(plan.config[k]), plan.config[k, 6:]])
        return np.concatenate([y - ocp.y_des, plan.zeta[k]])

    cost = 0.0
    for k in range(4):
        u = plan.zeta_dot[k] - ocp.model.drift(plan.config[k], plan.zeta[k])
        cost += H * (np.sum(Q * xi(k) ** 2) + np.sum(R * (u - ocp.u_eq) ** 2))
    terminal = xi(4) @ ocp.terminal.P @ xi(4)
    slack = max(0.0, np.sqrt(terminal) - MPC.terminal_radius)
    evaluation = ocp.evaluate(plan)
    assert slack > 0.0
    assert evaluation.terminal_slack == pytest.approx(slack, rel=1e-9)
    assert evaluation.cost == pytest.approx(
        cost + terminal + TERMINAL_PENALTY * slack, rel=1e-9)


def extremes(ocp, plan) -> dict[str, object]:
    """Returns the limits that a plan just touches at its knots after the first."""
    zeta, config = plan.zeta[1:], plan.config[1:]
    u = np.vstack([plan.zeta_dot - ocp.model.drift(plan.config[k: k + 4], plan.zeta[k: k + 4])
                   for k in (0, 1)])
    return {
        "nu1": np.max(np.linalg.norm(zeta[:, :3], axis=1)),
        "nu2": np.max(np.linalg.norm(zeta[:, 3:6], axis=1)),
        "qdot": np.max(np.linalg.norm(zeta[:, 6:], axis=1)),
        "roll": np.max(np.abs(config[:, 3])),
        "pitch": np.max(np.abs(config[:, 4])),
        "tip_pitch": np.max(np.abs([dh.chi(c)[4] for c in config])),
        "q_lower": np.min(config[:, 6:], axis=0),
        "q_upper": np.max(config[:, 6:], axis=0),
        "u": np.max(np.abs(u), axis=0),
        "tau": np.max(np.abs(forces(ocp, plan)), axis=(0, 1)),
        "static_force": np.max([force_of(ocp, dh.chi(c)) for c in config]),
    }


def force_of(ocp, chi: np.ndarray) -> float:
    """Returns the force on the wall at rest [N]; at least that of the transition's end."""
    return max(float(ocp.model.surface.force(chi, np.zeros(6))[0]), 1.0)


@pytest.mark.parametrize("kind", ["nu1", "nu2", "qdot", "roll", "pitch", "tip_pitch"])
def test_a_plan_that_exceeds_a_limit_is_seen_to(ocp, plan, kind):
    touched = extremes(ocp, plan)
    tight = with_limits(ocp, **touched)
    assert tight.evaluate(plan).violation == pytest.approx(0.0, abs=1e-12)
    evaluation = with_limits(tight, **{kind: touched[kind] - 1e-3}).evaluate(plan)
    assert evaluation.violation == pytest.approx(1e-3, rel=1e-6)
    assert 1e-3 <= evaluation.total_violation * (1.0 + 1e-9) <= 5e-3


@pytest.mark.parametrize(
    ("kind", "inwards"), [("q_lower", 1.0), ("q_upper", -1.0), ("u", -1.0), ("tau", -1.0)])
def test_every_joint_every_input_and_every_force_has_its_own_limit(ocp, plan, kind, inwards):
    touched = extremes(ocp, plan)
    for i in range(len(touched[kind])):
        bound = touched[kind].copy()
        bound[i] += inwards * 1e-3
        tight = with_limits(ocp, **{**touched, kind: bound})
        assert tight.evaluate(plan).violation == pytest.approx(1e-3, rel=1e-6)


def test_a_plan_that_presses_too_hard_is_deeper_by_so_much(ocp):
    plan = plan_around(ocp, 1, depth=0.05)
    touched = extremes(ocp, plan)
    tight = with_limits(ocp, **{**touched, "static_force": touched["static_force"] - 1.0})
    assert tight.evaluate(plan).violation == pytest.approx(1e-3, rel=1e-6)  # 1 N at 1000 N/m
    free = with_limits(tight, static_force=None)
    assert free.evaluate(plan).violation == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("end", [0, 1])
def test_forces_are_limited_at_both_ends_of_every_interval(ocp, plan, end):
    """A limit that is exceeded at one of the ends only, half-way between the two's largest."""
    tau = np.max(np.abs(forces(ocp, plan)), axis=1)
    gap = tau[end] - tau[1 - end]
    channel = np.argmax(gap)
    assert gap[channel] > 1e-3
    limit = np.full(10, np.inf)
    limit[channel] = np.mean(tau[:, channel])
    tight = with_limits(ocp, **{**extremes(ocp, plan), "tau": limit})
    assert tight.evaluate(plan).violation == pytest.approx(0.5 * gap[channel], rel=1e-6)


def test_the_first_knot_is_given_and_violates_nothing(ocp):
    """A limit on the initial velocity could not be kept by any plan."""
    config, zeta = ocp.model.configuration(ocp.y_des), np.zeros(10)
    config[0] -= 0.5
    zeta[0] = ocp.limits["nu1"].upper[0] + 0.02
    zeta_dot = np.zeros((4, 10))
    zeta_dot[0, 0] = -0.12
    plan = Plan.from_accelerations(0.0, H, config, zeta, zeta_dot)
    assert plan.zeta[1, 0] < ocp.limits["nu1"].upper[0]
    assert ocp.evaluate(plan).violation == 0.0


# Guesses -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("inside", [True, False])
def test_a_plan_is_continued_by_the_terminal_controller_from_the_edge_of_its_set_at_most(
        ocp, inside):
    plan = plan_around(ocp, 2)
    if inside:
        plan = ocp.resting_plan(0.0, np.concatenate(
            [ocp.model.configuration(ocp.y_des + 1e-4), np.zeros(10)]))
    continued = ocp.continued(plan)
    y = np.concatenate([dh.chi(plan.config[-1]), plan.config[-1, 6:]])
    xi = np.concatenate([y - ocp.y_des, plan.zeta[-1]])
    size = np.sqrt(xi @ ocp.terminal.P @ xi)
    assert (size < ocp.terminal.radius) == inside
    last = ocp.terminal.gain @ xi * (1.0 if inside else ocp.terminal.radius / size)
    np.testing.assert_allclose(continued.zeta_dot[-1], last, rtol=1e-9, atol=1e-12)
    np.testing.assert_array_equal(continued.zeta_dot[:-1], plan.zeta_dot[1:])
    np.testing.assert_array_equal(continued.config[:-1], plan.config[1:])


def test_near_the_task_the_continued_plan_costs_less_by_what_it_leaves_behind_or_more(ocp):
    """The terminal penalty is at least the cost to go, so the tail is paid for."""
    rng = np.random.default_rng(6)
    config = ocp.model.configuration(ocp.y_des + 1e-4 * rng.uniform(-1.0, 1.0, size=10))
    plan = ocp.resting_plan(0.0, np.concatenate([config, np.zeros(10)]))
    y = np.concatenate([dh.chi(config), config[6:]]) - ocp.y_des
    begin, _ = ocp.inputs(plan)
    first = H * (np.sum(Q[:10] * y**2) + np.sum(R * (begin[0] - ocp.u_eq) ** 2))
    fall = ocp.evaluate(plan).cost - ocp.evaluate(ocp.continued(plan)).cost
    assert fall > 0.99 * first > 0.0
