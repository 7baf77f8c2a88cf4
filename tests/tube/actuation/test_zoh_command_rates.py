"""Tests of `tube.actuation.zoh_command_rates`."""

from dataclasses import replace

import numpy as np
import pytest

from uvms_drake.control.laws.law import pair_of
from uvms_drake.control.laws.outputs import outputs_of
from uvms_drake.control.laws.tip_first import BlockGains, TipFirst
from uvms_drake.control.laws.tip_rows import tip_rows
from uvms_drake.model.uvms_model import configuration_rate
from uvms_drake.station.problem import load_model
from uvms_drake.station.scenario.scenario import load_scenario
from uvms_drake.tube.actuation.zoh_command_rates import (
    PlanProblem,
    ZohCommandProblem,
    jumping_plan,
    plan_rates,
    turning_task,
    zoh_command_rates,
    zoh_plan_rate,
)
from uvms_drake.tube.rows.remainders import output_bias, output_jacobian, tip_first_remainders
from uvms_drake.tube.search.constraint_set import ConstraintSet
from uvms_drake.tube.search.nominal_motion import nominal_motion

BOUNDS = ConstraintSet(
    q_lower=np.array([-0.2, 1.0, 0.2, -0.3]), q_upper=np.array([0.2, 1.2, 0.45, 0.3]), roll=0.1,
    pitch=0.1, tip_pitch=0.4, nu1=0.1, nu2=0.05, qdot=0.5)
LIMITS = np.repeat([0.5, 20.0], [6, 4])
CONFIG = np.array([-1.4, 0.0, 0.0, 0.02, -0.03, 0.1, 0.1, 1.1, 0.3, 0.2])


@pytest.fixture(scope="module")
def free():
    """The robot far from any wall."""
    return load_model(load_scenario("girona500_contact"))


class Course:
    """A motion by formulas: 𝔮 is smooth, and 𝔮̇ has a kink of `jump` at a time."""

    def __init__(self, amplitude, omega, jump=0.0, when=0.0):
        self.amplitude, self.omega, self.jump, self.when = amplitude, omega, jump, when

    def __call__(self, t):
        """Returns 𝔮, ζ and ζ̇."""
        step, after = 1e-5, t > self.when
        config, rate = self._at(t, after)
        zeta = _body(config, rate)
        rates = [_body(*self._at(t + each, after)) for each in (-step, step)]
        return config, zeta, (rates[1] - rates[0]) / (2.0 * step)

    def _at(self, t, after):
        since = after * (t - self.when)
        return (CONFIG + self.amplitude * np.sin(self.omega * t) + 0.5 * self.jump * since**2,
                self.amplitude * self.omega * np.cos(self.omega * t) + self.jump * since)


def _body(config, rate):
    Gamma = np.column_stack([configuration_rate(config, unit) for unit in np.eye(10)])
    return np.linalg.solve(Gamma, rate)


def test_between_a_sample_and_its_effect_there_is_what_is_listed_and_nothing_else(free):
    """(1) of `zoh_command` on a given motion, by the law itself, with the d that it needs."""
    model, rows, rng = free, tip_rows(free), np.random.default_rng(0)
    s, t, knot = 0.1, 0.125, 0.112
    jump = np.repeat([0.05, 0.3], [6, 4])
    plan = Course(0.03 * rng.normal(size=10), 2.0, jump, knot)
    real = Course(plan.amplitude + 2e-3 * rng.normal(size=10), 2.1)
    law = TipFirst(BlockGains(5.0, 4.0), BlockGains(20.0, 15.0))
    read, felt = rng.normal(size=(2, 6)) * np.repeat([10.0, 0.1], [3, 3])

    def states(time):
        return [np.concatenate(each(time)[:2]) for each in (real, plan)]

    now = pair_of(model, *states(s))
    kinematics = model.kinematics(real(s)[0])
    to_world = kinematics.J_chi @ np.linalg.pinv(kinematics.J_links[-1])  # χ̇ by V_E
    now = now._replace(contact=np.linalg.solve(to_world.T, read))
    tau = law.command(model, now, lambda: plan(s)[2], None).tau
    out = outputs_of(now, rows)
    k, sigma = law.gains("k", 4), law.gains("sigma", 4)
    w = -(k + sigma) * (out.rate[0] - out.rate[1]) - k * sigma * out.error

    def acceleration(course, time):
        config, zeta, zeta_dot = course(time)
        kinematics = model.kinematics(config)
        J = output_jacobian(model, config, kinematics, rows)
        return J @ zeta_dot + output_bias(config, kinematics, zeta, rows)

    config, zeta, zeta_dot = real(t)
    kinematics = model.kinematics(config)
    M, J_E = model.mass_matrix(kinematics), kinematics.J_links[-1]
    J = output_jacobian(model, config, kinematics, rows)
    d = zeta_dot + np.linalg.solve(M, model.inverse_dynamics(
        kinematics, zeta, np.zeros(10)) + J_E.T @ felt - tau)

    def leaves(time):  # ρ, by what is held at that time
        config, zeta, zeta_dot = real(time)
        kinematics = model.kinematics(config)
        J = output_jacobian(model, config, kinematics, rows)
        free_fall = np.linalg.solve(model.mass_matrix(kinematics), tau - kinematics.J_links[
            -1].T @ read - model.inverse_dynamics(kinematics, zeta, np.zeros(10)))
        off = J @ free_fall + output_bias(config, kinematics, zeta, rows)
        before = (acceleration(plan, time + 1e-5) - acceleration(plan, time - 1e-5)) / 2e-5
        return zoh_command_rates(model, rows, config, zeta, zeta_dot, off, read) - before

    nodes, weights = np.polynomial.legendre.leggauss(4)
    rho = sum(0.5 * (end - start) * weight * leaves(0.5 * (start + end) + 0.5 * (end - start) * x)
              for start, end in ((s, knot - 1e-5), (knot + 1e-5, t))
              for x, weight in zip(nodes, weights, strict=True))
    config_knot, _, zeta_dot_knot = plan(knot + 1e-9)
    jumped = output_jacobian(model, config_knot, model.kinematics(config_knot), rows) @ (
        zeta_dot_knot - plan(knot)[2])
    contact = J @ np.linalg.solve(M, J_E.T @ (read - felt))
    terms = [w, rho, -jumped, contact, J @ d]
    error = acceleration(real, t) - acceleration(plan, t)
    np.testing.assert_allclose(sum(terms), error, atol=2e-3 * np.max(np.abs(rho)))
    assert all(np.max(np.abs(term)) > 20e-3 * np.max(np.abs(rho)) for term in terms)


@pytest.fixture(scope="module")
def problem(free):
    return ZohCommandProblem(free, BOUNDS, [], tip_rows(free), LIMITS, 3.0)


def test_errors_make_of_a_plan_what_the_robot_does_where_they_put_it(problem):
    model, rows, rng = problem.model, problem.rows, np.random.default_rng(1)
    x = problem.draw(1, rng)
    np.testing.assert_allclose(problem.values(x, np.zeros((1, 46))), 0.0, atol=1e-9)
    config_bar, zeta_bar, zeta_dot = (each[0] for each in problem.plan(x))
    error = 0.02 * rng.normal(size=46)
    by_x, by_rate, moved, off, wrench = np.split(error, [10, 20, 30, 40])
    u = zeta_dot - model.drift(config_bar, zeta_bar)
    rest = tip_first_remainders(
        model, rows, nominal_motion(model, config_bar, zeta_bar), u, by_x, by_rate)
    zeta, config = zeta_bar + rest[:10], config_bar + np.append(by_x[:6], rest[10:14])
    kinematics = model.kinematics(config)
    J = output_jacobian(model, config, kinematics, rows)
    y_ddot, jerk, J_bar = plan_rates(model, rows, config_bar, zeta_bar, zeta_dot)

    def of_outputs(each):
        return np.append(each[:6], J[6:, 6:] @ each[6:])

    bias = output_bias(config, kinematics, zeta, rows)
    real = zoh_command_rates(model, rows, config, zeta, np.linalg.solve(
        J, y_ddot + of_outputs(moved) - bias), y_ddot + of_outputs(off), wrench) - jerk
    late = zoh_command_rates(
        model, rows, config_bar, zeta_bar, zeta_dot, y_ddot, np.zeros(6)) - jerk
    expected = np.concatenate([real - late, np.linalg.solve(J[6:, 6:], real[6:])
                               - np.linalg.solve(J_bar[6:, 6:], late[6:])])
    np.testing.assert_allclose(
        problem.values(x, error[None])[0], expected, rtol=1e-6, atol=1e-6)
    # And with drags, what the accelerations of the rows and of the joints make of it.
    dragging = replace(problem, drags=(2.0, 5.0)).values(x, error[None])[0] - expected
    np.testing.assert_allclose(dragging, np.concatenate([
        np.zeros(6), 2.0 * of_outputs(moved)[6:], 5.0 * moved[6:]]), atol=1e-6)


def test_a_plan_that_is_held_lags_by_its_forces(free, problem):
    """ρ of a plan is −J_yM⁻¹ times how fast its forces vary, by differences."""
    x = problem.draw(1, np.random.default_rng(2))
    one = [(np.eye(1), 1.0)]
    fields = vars(problem) | {"parts": one}
    held, jumps, turns = (PlanProblem(**fields, of=of) for of in (
        zoh_plan_rate, jumping_plan, turning_task))
    config, zeta, zeta_dot = (each[0] for each in problem.plan(x))

    def at(step):
        moved, faster = config + step * configuration_rate(config, zeta), zeta + step * zeta_dot
        kinematics = free.kinematics(moved)
        return (free.inverse_dynamics(kinematics, faster, zeta_dot), output_jacobian(
            free, moved, kinematics, problem.rows))

    tau_rate = (at(1e-4)[0] - at(-1e-4)[0]) / 2e-4
    J, M = at(0.0)[1], free.mass_matrix(free.kinematics(config))
    np.testing.assert_allclose(held.values(x, np.ones((1, 1)))[0, :10],
                               -J @ np.linalg.solve(M, tau_rate), rtol=1e-3, atol=1e-4)
    np.testing.assert_allclose(jumps.values(x, np.ones((1, 1)))[0, :10], J @ zeta_dot)
    rate = (at(1e-4)[1] - at(-1e-4)[1])[6:, 6:] / 2e-4
    np.testing.assert_allclose(turns.of(turns, x)[0, 10:], np.linalg.solve(J[6:, 6:], rate),
                               rtol=1e-3, atol=1e-5)
