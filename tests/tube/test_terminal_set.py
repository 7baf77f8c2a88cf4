"""Tests of `uvms_drake.tube.terminal_set`."""

import copy
import dataclasses

import numpy as np
import pytest
from support.limits import bounded
from support.terminal_checks import check_penalty, check_terminal
from support.tracking import DIRECTION, tracking_ocp

from uvms_drake.control.costs.costs import TaskCost
from uvms_drake.control.limits.inputs import Accelerations
from uvms_drake.control.limits.pose import Joints, TipPitch, VehicleAngle
from uvms_drake.control.limits.speeds import Speed
from uvms_drake.control.ocp import ocp as ocp_module
from uvms_drake.control.ocp.ocp import TERMINAL_PENALTY, Ocp
from uvms_drake.control.ocp.tracking_ocp import TrackingOcp, TrackingTarget
from uvms_drake.control.plan.plan import Plan, TrackingPlan
from uvms_drake.control.plan.terminal import INFLATION, terminal_ingredients
from uvms_drake.model.surface.law import check_surface
from uvms_drake.model.surface.plane import UnilateralPlane
from uvms_drake.model.surface.spring import BilateralSpring
from uvms_drake.station.problem import make_ocp
from uvms_drake.station.scenario.scenario import load_scenario
from uvms_drake.tube import terminal_set
from uvms_drake.tube.terminal_set import (
    TerminalCheck,
    TerminalLoop,
    boundary_samples,
    largest_radius,
    linear_radius,
)

pytestmark = pytest.mark.slow

FRESH = 10_000


def inflated(ocp: Ocp, inflation: float) -> Ocp:
    """Returns the problem with P = (1 + inflation) times the Riccati solution."""
    P = (1.0 + inflation) / (1.0 + INFLATION) * ocp.terminal.P
    return changed(ocp, terminal=dataclasses.replace(ocp.terminal, P=P))


def changed(ocp: Ocp, **values: object) -> Ocp:
    """Returns a copy of the problem with other values."""
    other = copy.copy(ocp)
    vars(other).update(values)
    return other


def broken(ocp: Ocp, radius: float, xi: np.ndarray) -> dict[str, np.ndarray]:
    """Returns which of the states ξ (m, 20) break what, as the problem itself judges it.

    It evaluates a plan of one interval with the terminal controller's acceleration.
    """
    one = changed(ocp, horizon=1, terminal=dataclasses.replace(ocp.terminal, radius=radius))
    out: dict[str, list[bool]] = {"decrease": [], "limits": [], "invariance": []}
    limits = {name: limit.upper[0] for name, limit in ocp.limits.items()}
    P = ocp.terminal.P
    for state in xi:
        config, zeta = ocp.model.configuration(ocp.y_des + state[:10]), state[10:]
        plan = Plan.from_accelerations(
            0.0, ocp.time_step, config, zeta, (ocp.terminal.gain @ state)[None])
        evaluation = one.evaluate(plan)
        cost = evaluation.cost - TERMINAL_PENALTY * evaluation.terminal_slack
        out["decrease"].append(cost > state @ P @ state)
        out["invariance"].append(evaluation.terminal_slack > 0.0)
        out["limits"].append(max(
            evaluation.violation, np.linalg.norm(zeta[:3]) - limits["nu1"],
            np.linalg.norm(zeta[3:6]) - limits["nu2"], np.linalg.norm(zeta[6:]) - limits["qdot"],
            abs(config[3]) - limits["roll"], abs(config[4]) - limits["pitch"],
            ocp.model.surface.static_force(ocp.y_des[:6] + state[:6])
            - limits["static_force"]) > 0.0)
    return {name: np.array(where) for name, where in out.items()}


@pytest.fixture(scope="module")
def robot() -> Ocp:
    """The ideal scenario, with weights under which the terminal set is wide."""
    return make_ocp(load_scenario("girona500_ideal", [
        "mpc.weight_zeta=[5, 5, 5, 5, 5, 5, 10, 10, 10, 10]",
        "mpc.weight_u=[10, 10, 10, 10, 10, 10, 0.01, 0.01, 0.01, 0.01]"]))


@pytest.fixture(scope="module")
def found(robot) -> tuple[float, TerminalCheck]:
    return largest_radius(robot)


def test_there_is_a_terminal_set_and_what_limits_it_is_named(robot, found):
    radius, check = found
    assert 0.0 < radius < linear_radius(TerminalLoop(robot))
    assert check.holds and check.failures == () and check.radius == radius
    assert check.limiting.startswith("u_")
    assert 0.0 <= check.margins[check.limiting] < 0.02
    assert check.margins["decrease at rest"] == pytest.approx(1.0, abs=1e-6)
    assert check.samples > 2000 and check.refinements >= 3


def test_fresh_states_on_the_boundary_meet_every_condition(robot, found):
    radius, _ = found
    loop = TerminalLoop(robot)
    xi = radius * boundary_samples(robot.terminal.P, FRESH, np.random.default_rng(77))
    assert np.min(loop.margins(xi)) >= 0.0
    after, *_ = robot.move(xi, xi @ robot.terminal.gain.T)
    assert np.max(np.sum((after @ robot.terminal.P) * after, axis=1)) <= radius**2


def test_the_problem_itself_finds_nothing_broken_in_the_set(robot, found):
    """Its own evaluation of a plan of one interval, at the worst states and at fresh ones."""
    radius, check = found
    xi = radius * boundary_samples(robot.terminal.P, 200, np.random.default_rng(78))
    xi[:100] *= np.random.default_rng(79).uniform(0.0, 1.0, size=(100, 1))
    states = np.concatenate([xi, *(state[None] for state in check.worst.values())])
    for name, where in broken(robot, radius, states).items():
        assert not np.any(where), name


def test_a_wider_set_is_refused(robot, found):
    check = check_terminal(robot, 1.5 * found[0])
    assert not check.holds
    assert check.failures[0] == "static_force"
    worst = check.worst[next(name for name in check.failures if name.startswith("u_"))]
    assert broken(robot, 1.5 * found[0], worst[None])["limits"][0]


def test_the_margins_are_those_of_a_plan_of_one_interval(robot):
    """(V − V⁺)/ℓ − 1, and what the two inputs and the vehicle's pitch leave of their limits."""
    u, tau = robot.limits["u"].upper, np.linspace(80.0, 90.0, 10)
    robot = changed(robot, limits=bounded(robot, tau=tau, roll=0.25, pitch=0.28))
    limits, P, loop = np.concatenate([u, u, tau, tau]), robot.terminal.P, TerminalLoop(robot)
    for state in 0.5 * boundary_samples(P, 5, np.random.default_rng(82)):
        config = robot.model.configuration(robot.y_des + state[:10])
        plan = Plan.from_accelerations(
            0.0, robot.time_step, config, state[10:], (robot.terminal.gain @ state)[None])
        (begin,), (end,) = robot.inputs(plan)
        w, y = begin - robot.u_eq, robot.model.task_pose(plan.config[1])
        after = np.concatenate([y - robot.y_des, plan.zeta[1]])
        forces = [robot.model.inverse_dynamics(
            robot.model.kinematics(at), zeta, plan.zeta_dot[0])
            for at, zeta in zip(plan.config, plan.zeta, strict=True)]
        stage = robot.time_step * (state @ robot.Q @ state + w @ robot.R @ w)
        expected = [(state @ P @ state - after @ P @ after) / stage - 1.0,
                    *(1.0 - np.abs(np.concatenate([begin, end, *forces])) / limits),
                    1.0 - abs(config[3]) / 0.25, 1.0 - abs(config[4]) / 0.28]
        np.testing.assert_allclose(loop.margins(state), expected, rtol=1e-9, atol=1e-9)
        # A task that is given by an angle beyond π is the same task.
        turned = TerminalLoop(changed(robot, y_des=robot.y_des + 2.0 * np.pi * np.eye(10)[5]))
        np.testing.assert_allclose(turned.margins(state), expected, rtol=1e-6, atol=1e-6)


def test_near_the_worst_states_nothing_in_the_set_is_worse(robot, found):
    """So they are local minima of the margins."""
    radius, check = found
    loop, rng = TerminalLoop(robot), np.random.default_rng(83)
    root = np.linalg.inv(np.linalg.cholesky(robot.terminal.P))
    for column, name in enumerate(loop.names):
        if name == "decrease" or check.margins[name] < 0.3:
            near = check.worst[name] / radius + 0.02 * rng.normal(size=(500, 20)) @ root
            size = np.sqrt(np.sum((near @ robot.terminal.P) * near, axis=1, keepdims=True))
            margins = loop.margins(radius * near / np.maximum(size, 1.0))[:, column]
            assert np.min(margins) > check.margins[name] - 1e-5, name


def test_without_inflation_there_is_no_terminal_set(robot):
    """The Riccati solution falls by exactly the stage cost; the cubic terms decide."""
    radius, check = largest_radius(inflated(robot, 0.0))
    assert radius == 0.0 and not check.holds
    assert "decrease" in check.failures


def test_with_little_inflation_the_decrease_limits_the_set(robot, found):
    little = inflated(robot, 0.1)
    radius, check = largest_radius(little, samples=500)
    assert check.limiting == "decrease"
    assert 0.0 < radius / np.sqrt(1.1) < 0.9 * found[0] / np.sqrt(1.0 + INFLATION)
    fresh = boundary_samples(little.terminal.P, FRESH, np.random.default_rng(81))
    assert np.min(TerminalLoop(little).margins(radius * fresh)) >= 0.0
    assert check_terminal(little, 1.5 * radius).failures[0] == "decrease"


def test_the_penalty_of_the_paper_fails_whatever_the_controller(robot):
    """P = ½I: at rest and off the task no input lowers ‖ξ‖² enough; below −1 it even rises."""
    for gain in (None, robot.terminal.gain):
        check = check_penalty(robot, 0.5 * np.eye(20), gain)
        assert set(check.failures) == {"decrease", "decrease at rest"}
        assert check.margins["decrease"] < -1.0 and check.margins["decrease at rest"] < -1.0
        assert check.radius == pytest.approx(linear_radius(
            TerminalLoop(changed(robot, terminal=dataclasses.replace(
                robot.terminal, P=0.5 * np.eye(20))))))


def test_an_input_that_is_used_up_at_the_equilibrium_leaves_no_set(robot):
    u = robot.limits["u"].upper.copy()
    u[4] = abs(robot.u_eq[4])
    tight = changed(robot, limits=bounded(robot, u=u))
    radius, check = largest_radius(tight)
    assert radius == 0.0
    assert set(check.failures) == {
        "u_pitch, begin of a step", "u_pitch, end of a step"}


class Linear:
    """A model that is linear in everything: y = 𝔮, f = −2y − 3ζ about y = 0, with coupling."""

    size = 7
    couple = 0.3 * np.random.default_rng(3).normal(size=(7, 7))

    def configuration(self, y: np.ndarray) -> np.ndarray:
        return y.copy()

    task_pose = configuration

    def drift(self, config: np.ndarray, zeta: np.ndarray) -> np.ndarray:
        return -2.0 * config - 3.0 * zeta + config @ self.couple.T


@pytest.fixture
def toy(monkeypatch) -> Ocp:
    """A problem whose map is exactly its linearisation, with inputs that never matter."""
    monkeypatch.setattr(ocp_module, "advance",
                        lambda config, zeta, a, h: config + h * zeta + 0.5 * h**2 * a)
    model, eye, h = Linear(), np.eye(7), 0.2
    Q, R = np.diag(np.linspace(1.0, 3.0, 14)), np.diag(np.linspace(0.5, 2.0, 7))
    limits = {limit.name: limit for limit in (
        Speed("nu1", 0.4), Speed("nu2", 0.5), Speed("qdot", 0.6), VehicleAngle("roll", 1.4),
        VehicleAngle("pitch", 1.4), TipPitch(0.7), Joints(np.array([-0.8]), np.array([0.5])),
        Accelerations(np.full(7, 1e3)))}
    return changed(
        Ocp.__new__(Ocp), model=model, y_des=np.zeros(7), u_eq=np.zeros(7),
        time_step=h, limits=limits, task_cost=TaskCost(Q, R, np.zeros(7), np.zeros(7)),
        terminal=terminal_ingredients(eye, model.couple - 2.0 * eye, -3.0 * eye, Q, R, h, 1.0))


def test_of_a_linear_system_the_set_is_as_large_as_the_linear_limits_allow(toy):
    radius, check = largest_radius(toy)
    assert radius == linear_radius(TerminalLoop(toy))
    assert check.holds
    assert check.margins["decrease"] == pytest.approx(1.0, rel=1e-6)
    assert check.margins["decrease at rest"] == pytest.approx(1.0, rel=1e-6)
    assert check.margins[check.limiting] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(("name", "bound", "columns"), [
    ("nu1", 0.4, [7, 8, 9]), ("nu2", 0.5, [10, 11, 12]), ("qdot", 0.6, [13]),
    ("tip_pitch", 0.7, [4]), ("q_upper", np.array([0.5]), [6]), ("q_lower", np.array([-0.8]), [6]),
])
def test_the_linear_radius_is_where_the_set_touches_a_limit(toy, name, bound, columns):
    """By brute force: the largest of the limited quantity at the support points of many rows."""
    wide = {"q_lower": np.array([-1e3]), "q_upper": np.array([1e3])} | dict.fromkeys(
        ("nu1", "nu2", "qdot", "tip_pitch"), 1e3)
    toy.limits = bounded(toy, **{**wide, name: bound})
    rows = np.zeros((5000, 14))
    rows[:, columns] = np.random.default_rng(4).normal(size=(5000, len(columns)))
    xi = linear_radius(TerminalLoop(toy)) * boundary_samples(
        toy.terminal.P, 1, np.random.default_rng(5), rows)
    largest = np.max(np.linalg.norm(xi[:, columns], axis=1))
    assert largest == pytest.approx(np.abs(bound).item(), rel=1e-3)


@pytest.mark.parametrize("surface", [
    UnilateralPlane(np.array([-0.012, 0.0, 0.016]), np.array([-0.6, 0.0, 0.8]), 500.0),
    BilateralSpring(np.diag([300.0, 200.0, 100.0, 5.0, 4.0, 3.0]) + 0.5, np.full(6, 0.01))],
    ids=["plane", "spring"])
def test_in_the_set_the_force_on_the_surface_is_within_its_limit(toy, surface):
    """By brute force, as above; of a spring, whose force is not along one line, it may be less."""
    law = toy.model.surface = check_surface(surface)
    wide = dict.fromkeys(("nu1", "nu2", "qdot", "tip_pitch"), 1e3)
    toy.limits = bounded(
        toy, **wide, q_lower=np.array([-1e3]), q_upper=np.array([1e3]), static_force=30.0)
    G = law.force_jacobian()
    rows = np.zeros((5000, 14))
    rows[:, :6] = np.random.default_rng(4).normal(size=(5000, len(G))) @ G
    xi = linear_radius(TerminalLoop(toy)) * boundary_samples(
        toy.terminal.P, 1, np.random.default_rng(5), rows)
    largest = np.max(law.static_force(xi[:, :6]))
    at_rest = law.static_force(np.zeros(6))
    assert 0.5 < at_rest < 15.0
    assert 0.9 * 30.0 < largest < 30.0 + 1e-9
    if law.force_jacobian().shape == (1, 6):
        assert largest == pytest.approx(30.0, rel=1e-6)


def test_a_linear_input_limit_is_found_to_the_tolerance(toy):
    """Its support function is the answer: ε = limit/‖row‖_{P⁻¹}."""
    loop = TerminalLoop(toy)
    reach = np.sqrt(np.sum((loop.rows @ np.linalg.inv(toy.terminal.P)) * loop.rows, axis=1))
    expected = 0.5 * linear_radius(TerminalLoop(toy))
    toy.limits = bounded(toy, u=expected * np.maximum(reach[:7], reach[7:14]))
    radius, check = largest_radius(toy, tolerance=1e-3)
    assert radius == pytest.approx(expected, rel=1e-3) and radius <= expected
    assert check.limiting.startswith("u_")


def test_a_minimum_that_the_samples_miss_bounds_the_set(toy, monkeypatch):
    """A state that breaks a condition is known to the search alone, at a third of the radius."""
    whole, searched = linear_radius(TerminalLoop(toy)), []
    broken = whole / 3.0 * boundary_samples(toy.terminal.P, 1, np.random.default_rng(6))[0]

    def search(loop, radius, column, start):
        searched.append(radius)
        return (broken, -0.1) if radius >= whole / 3.0 else (start, np.inf)

    monkeypatch.setattr(terminal_set, "_refine", search)
    radius, check = largest_radius(toy, samples=100)
    assert check.holds and 0.99 * whole / 3.0 < radius < whole / 3.0
    assert check.radius == radius and radius in searched


def test_no_set_passes_with_a_state_that_is_known_to_break_a_condition(toy, monkeypatch):
    """It lies inside of the first set, where samples of a smaller one could miss it."""
    at = TerminalLoop.margins
    inner = 0.5 * linear_radius(TerminalLoop(toy))
    hidden = []

    def margins(loop, xi):
        found = at(loop, xi)
        if not hidden:  # The first set with a state inside of it.
            norms = np.sqrt(np.sum(xi @ loop.P * xi, axis=1))
            if np.max(norms) > 1.9 * inner:
                i = int(np.argmin(np.abs(norms - 0.6 * inner)))
                hidden.append(norms[i])
                found[i] = -0.1
        return found

    monkeypatch.setattr(TerminalLoop, "margins", margins)
    radius, _ = largest_radius(toy, samples=400)
    assert hidden and 0.98 * hidden[0] < radius < hidden[0]


@pytest.fixture(scope="module")
def tracking() -> TrackingOcp:
    return tracking_ocp()


@pytest.fixture(scope="module")
def found_anywhere(tracking) -> tuple[float, TerminalCheck]:
    return largest_radius(tracking)


def test_there_is_a_terminal_set_for_all_places_and_forces(tracking, found_anywhere):
    """The decrease does not depend on the force, nor on the place; the inputs' limits do."""
    radius, check = found_anywhere
    assert check.holds and radius > 0.4
    assert {"safe_depth", "safe_depth_between_knots",
            "u_q2, largest in contact, end of a step"} <= set(check.margins)
    free = TerminalLoop(tracking_ocp(force=0.0))
    loop = TerminalLoop(tracking)
    states = 0.5 * boundary_samples(tracking.terminal.P, 20, np.random.default_rng(1))
    decrease = loop.names.index("decrease")
    np.testing.assert_array_equal(
        loop.margins(states)[:, decrease], free.margins(states)[:, decrease])
    there = copy.copy(tracking)
    there.y_des = tracking.y_des + np.pad([-50.0, 20.0, 7.0], (0, 7))
    np.testing.assert_allclose(TerminalLoop(there).margins(states), loop.margins(states),
                               rtol=1e-6, atol=1e-6)
    aimed = tracking.aimed(TrackingTarget(np.zeros(3), 1.0))
    np.testing.assert_array_equal(TerminalLoop(aimed).margins(states), loop.margins(states))


def test_in_that_set_the_continued_plan_keeps_front_and_inputs(tracking, found_anywhere):
    """At fresh states of sets of all sizes, the front as close as it may be.

    The problem itself evaluates a plan of one interval.
    """
    radius, check = found_anywhere
    rng = np.random.default_rng(83)
    states = boundary_samples(tracking.terminal.P, 150, rng)
    states = radius * rng.uniform(0.01, 1.0, size=(len(states), 1)) * states
    states = np.concatenate([states, *(state[None] for state in check.worst.values())])
    for xi in states:
        size = np.sqrt(xi @ tracking.terminal.P @ xi)
        a = rng.uniform(-5.0, 5.0, 3)
        y = tracking.y_des + np.pad(a, (0, 7))
        aim = TrackingTarget(
            rng.uniform(-5.0, 5.0, 3), DIRECTION @ y[:3] + size * tracking.depth_reach)
        one = tracking.aimed(aim)
        one.horizon, one.terminal = 1, dataclasses.replace(one.terminal, radius=radius)
        start = np.concatenate([one.model.configuration(y + xi[:10]), xi[10:]])
        plan = TrackingPlan(**vars(Plan.from_accelerations(
            0.0, one.time_step, *np.split(start, 2), (one.terminal.gain @ xi)[None])), a=a)
        value = one.evaluate(plan)
        assert max(value.violation, value.terminal_slack) <= 1e-9
        knots = one.points(plan).knots
        for limit in one.limits.values():
            assert limit.about == "input" or np.all(limit.excess(knots) <= 1e-9)


def test_a_force_that_the_arm_cannot_hold_leaves_no_terminal_set():
    radius, check = largest_radius(tracking_ocp(force=40.0), samples=200)
    assert radius == 0.0
    assert check.failures[0].startswith("u_q2, smallest in contact")


def test_where_the_tip_is_beyond_its_reach_the_set_is_refused(tracking):
    """The reach of the linearisation less a tenth: it is left however small the set is."""
    loop = TerminalLoop(tracking)
    assert np.all(loop.margins(0.1 * tracking.terminal.radius * boundary_samples(
        tracking.terminal.P, 100, np.random.default_rng(3), loop.rows))[:, -2:] > 0.0)
    short = copy.copy(tracking)
    short.depth_reach = 0.9 * short.depth_reach
    check = check_terminal(short, 0.01)
    assert {"safe_depth", "safe_depth_between_knots"} & set(check.failures)


@pytest.mark.parametrize("kind", ["robot", "tracking"])
def test_a_margin_alone_is_its_column_of_all_margins(kind, request):
    loop = TerminalLoop(request.getfixturevalue(kind))
    xi = 0.3 * boundary_samples(loop.P, 3, np.random.default_rng(5))[:3] + 1e-30j
    margins = loop.margins(xi)
    for column in range(len(loop.names)):
        np.testing.assert_array_equal(loop.margin(xi, column), margins[:, column])
