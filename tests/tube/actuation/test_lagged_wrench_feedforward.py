"""Tests of `tube.actuation.lagged_wrench_feedforward`."""


import numpy as np
import pytest

from uvms_drake.control.laws.law import pair_of
from uvms_drake.control.laws.outputs import outputs_of
from uvms_drake.control.laws.tip_first import BlockGains, TipFirst
from uvms_drake.control.laws.tip_rows import tip_rows
from uvms_drake.model.uvms_model import configuration_rate
from uvms_drake.station.problem import load_model
from uvms_drake.station.scenario.scenario import load_scenario
from uvms_drake.tube.actuation.lagged_wrench_feedforward import (
    LaggedWrenchProblem,
    PostureMap,
    arm_and_wrench,
    joints_for_vehicle,
    planned_feedforward,
    turning_map,
    turning_reading,
)
from uvms_drake.tube.rows.remainders import configuration_of, output_bias, output_jacobian
from uvms_drake.tube.search.constraint_set import ConstraintSet

BOUNDS = ConstraintSet(
    q_lower=np.array([-0.2, 1.0, 0.2, -0.3]), q_upper=np.array([0.2, 1.2, 0.45, 0.3]), roll=0.1,
    pitch=0.1, tip_pitch=0.4, nu1=0.1, nu2=0.05, qdot=0.5)
LIMITS = np.repeat([0.5, 20.0], [6, 4])
LAW = TipFirst(BlockGains(1e-5, 1e-5), BlockGains(1e-5, 1e-5))
"""Hardly any feedback: what it would be is put in by hand, as an observer's estimate."""


@pytest.fixture(scope="module")
def free():
    """The robot far from any wall."""
    return load_model(load_scenario("girona500_contact"))


@pytest.fixture(scope="module")
def problem(free):
    return LaggedWrenchProblem(free, BOUNDS, [], tip_rows(free), LIMITS, 3.0)


def of_posture(problem, of):
    return PostureMap(problem.model, BOUNDS, [(np.eye(1), 1.0)], problem.rows, LIMITS, 3.0,
                     of=of, each=3, count=1)


class Motion:
    """A plan and the robot beside it, with errors that are given, and the law there."""

    def __init__(self, problem, seed):
        rng = np.random.default_rng(seed)
        model, rows = problem.model, problem.rows
        self.model, self.rows, self.x = model, rows, problem.draw(1, rng)[0]
        self.error = 0.02 * rng.normal(size=40)
        self.error[34:] *= 50.0  # N, N m
        self.bar = of_posture(problem, planned_feedforward).plan(self.x)
        config, zeta, rate = self.bar
        kinematics = model.kinematics(config)
        x, x_dot, x_ddot = (each.copy() for each in np.split(self.error[:30], 3))
        real = configuration_of(model, rows, config, kinematics, x)
        at = model.kinematics(real)
        J_bar = output_jacobian(model, config, kinematics, rows)
        J = output_jacobian(model, real, at, rows)
        for each in (x_dot, x_ddot):
            each[6:] = J[6:, 6:] @ each[6:]
        fast = np.linalg.solve(J, J_bar @ zeta + x_dot)
        rate = np.linalg.solve(J, J_bar @ rate + output_bias(config, kinematics, zeta, rows)
                               + x_ddot - output_bias(real, at, fast, rows))
        self.real = real, fast, rate
        self.w = np.append(np.zeros(6), J[6:, 6:] @ self.error[30:34])

    def tau(self, step, wrench=None, w=None):
        """Returns A, and the law's τ with w and F̂ as they are, a time later."""
        states = [np.append(config + step * configuration_rate(config, zeta), zeta + step * rate)
                  for config, zeta, rate in (self.real, self.bar)]
        now = pair_of(self.model, *states)
        at = self.model.kinematics(states[0][:10])
        to_world = at.J_chi @ np.linalg.pinv(at.J_links[-1])
        now = now._replace(contact=np.linalg.solve(to_world.T, self.error[34:]), wrench=wrench,
                           estimate=-(self.w if w is None else w))
        tau = LAW.command(self.model, now, lambda: self.bar[2], None).tau
        J, M = outputs_of(now, self.rows).J[0], self.model.mass_matrix(at)
        A = J[:6, :6] @ np.linalg.inv(M[:6, :6] - M[:6, 6:] @ np.linalg.solve(
            J[6:, 6:], J[6:, :6]))
        return A, tau, M, J


def test_what_the_law_asks_of_the_thrusters_varies_as_the_parts_say(problem):
    """(2): the law's own τ_c, its feedback, ζ̄̇ and the reading standing still, is their sum."""
    for seed in range(3):
        motion, step = Motion(problem, seed), 1e-4
        A = motion.tau(0.0)[0]
        rate = A @ (motion.tau(step)[1] - motion.tau(-step)[1])[:6] / (2.0 * step)
        planned = planned_feedforward(
            of_posture(problem, planned_feedforward), motion.x)[:, 0].reshape(3, 6)
        off = problem.values(motion.x, motion.error).reshape(3, 6)
        parts = planned[1], planned[2], off[1], off[2]
        np.testing.assert_allclose(sum(parts), rate, atol=1e-4 * np.max(np.abs(rate)))
        assert all(np.max(np.abs(part)) > 1e-3 * np.max(np.abs(rate)) for part in parts)

        # What jumps with ζ̄̇, at the errors that there are.
        bar = motion.bar
        motion.bar = (*bar[:2], 0.0 * bar[2])
        still = motion.tau(0.0)[1]
        motion.bar = bar
        jump = A @ (motion.tau(0.0)[1] - still)[:6]
        np.testing.assert_allclose(planned[0] + off[0], jump, atol=1e-6 * np.max(np.abs(jump)))


def test_without_errors_there_is_nothing_off_the_plan(problem):
    x = problem.draw(2, np.random.default_rng(0))
    np.testing.assert_allclose(problem.values(x, np.zeros((2, 40))), 0.0, atol=1e-8)


def test_thrusters_push_the_vehicle_as_they_give_more_or_less_and_leave_the_tip_alone(problem):
    """(1), and what the joints do about it, by the law that is told what the thrusters give."""
    motion, given = Motion(problem, 7), np.array([5.0, -3.0, 2.0, 1.0, 2.0, -1.0])
    A, tau, M, J = motion.tau(0.0)
    told = motion.tau(0.0, tau[:6] + given)[1]
    told[:6] = tau[:6] + given
    moved = J @ np.linalg.solve(M, told - tau)
    np.testing.assert_allclose(moved[6:], 0.0, atol=1e-9)
    np.testing.assert_allclose(moved[:6], A @ given, rtol=1e-8)
    pose = motion.real[0].copy()
    pose[:3] = problem.model.task_pose(pose)[:3]
    at = np.concatenate([pose, motion.real[1], np.zeros(10)])
    follows = joints_for_vehicle(of_posture(problem, joints_for_vehicle), at)
    u = np.linalg.solve(M, np.append(np.zeros(6), (told - tau)[6:]))
    np.testing.assert_allclose(follows @ (A @ given), np.append(u, np.append(
        np.zeros(6), (told - tau)[6:])), rtol=1e-7, atol=1e-9)

    # The arm's feedback and the reading, and how A turns.
    maps = arm_and_wrench(of_posture(problem, arm_and_wrench), at)
    other = np.random.default_rng(0).normal(size=4)
    more = motion.tau(0.0, w=np.append(np.zeros(6), J[6:, 6:] @ other) + motion.w)[1]
    np.testing.assert_allclose(maps[:, :4] @ other, A @ (more - tau)[:6], atol=1e-9)
    motion.error[34:] += 1.0
    np.testing.assert_allclose(maps[:, 4:] @ np.ones(6), A @ (motion.tau(0.0)[1] - tau)[:6],
                               atol=1e-9)
    later = replace_rate(motion).tau(1e-4)[0]
    np.testing.assert_allclose(turning_map(of_posture(problem, turning_map), at) @ A,
                               (later - A) / 1e-4, atol=1e-4 * np.max(np.abs(A)))
    then = at.copy()
    then[:10] = motion.real[0] + 1e-5 * configuration_rate(motion.real[0], motion.real[1])
    ahead = problem.model.kinematics(then[:10]).J_links[-1, :, :6]
    here = problem.model.kinematics(motion.real[0]).J_links[-1, :, :6]
    np.testing.assert_allclose(turning_reading(of_posture(problem, turning_reading), at),
                               A @ (ahead - here).T / 1e-5, atol=1e-3 * np.max(np.abs(A)))


def replace_rate(motion):
    """Returns the motion with the robot's ζ standing still."""
    motion.real = (*motion.real[:2], np.zeros(10))
    return motion
