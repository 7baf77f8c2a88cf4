"""Tests of `tube.search.ascent` and `tube.search.second_search`."""

import numpy as np
import pytest
from support.tube_bounds import contains

from uvms_drake.model.surface import BilateralSpring
from uvms_drake.tube.laws.resolved_remainders import (
    RemainderProblem,
    jacobian_rate_times,
    turning,
)
from uvms_drake.tube.search.ascent import Climb, first_order, supremum
from uvms_drake.tube.search.constraint_set import ConstraintSet
from uvms_drake.tube.search.search_problem import norm_problem
from uvms_drake.tube.search.second_search import by_flips, claimed, second_search

U_LIMITS = np.array([0.4, 0.3, 0.35, 0.4, 0.5, 0.4, 6.0, 8.0, 8.0, 6.0])
NU_1, U_1 = 0, 5
"""Channels of ν₁ and u[1]."""


@pytest.fixture(autouse=True)
def two_climbers(monkeypatch):
    monkeypatch.setattr("uvms_drake.tube.search.ascent.LEADERS", 2)


@pytest.fixture(scope="module")
def declared() -> ConstraintSet:
    return ConstraintSet(
        q_lower=np.array([-0.4, 0.6, -0.1, -0.8]), q_upper=np.array([0.4, 1.3, 0.72, 0.8]),
        roll=0.15, pitch=0.15, tip_pitch=0.4, nu1=0.25, nu2=0.2, qdot=0.3, force_max=32.0)


@pytest.fixture(scope="module")
def problem(model, declared) -> RemainderProblem:
    eye = np.eye(20)
    parts = [(eye[:, 0:3], 0.0017), (eye[:, 3:6], 0.0018), (eye[:, 6:10], 0.001),
             (eye[:, 10:], 0.005)]
    return RemainderProblem(
        model, declared, parts, U_LIMITS, 20.0, 5.0, largest_rate=np.full(10, 3.0))


def test_the_rate_of_the_jacobian_is_the_models(model, declared):
    rng = np.random.default_rng(0)
    config, zeta = declared.sample(model, 20, rng)
    w = rng.normal(size=zeta.shape)
    expected = (model.task_motion(config, zeta)[2] @ w[..., None])[..., 0]
    found = jacobian_rate_times(model.kinematics(config), zeta, w)
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_climbers_stay_in_the_set_and_reach_what_they_claim(problem, declared):
    rng = np.random.default_rng(1)
    x = problem.draw(4, rng)
    climb = Climb(problem, x, np.zeros((len(x), 20)), [problem.channels[U_1]] * 4)
    for _ in range(4):
        climb.step()
    pose, zeta, share = np.split(climb.x, 3, axis=1)
    assert np.all(contains(declared, problem.model, problem.config(pose), zeta, tolerance=1e-6))
    assert np.all(np.abs(share) <= 1.0)
    for matrix, radius in problem.parts:
        assert np.all(np.linalg.norm(climb.error @ matrix, axis=1) <= radius * (1.0 + 1e-9))
    np.testing.assert_allclose(
        np.abs(problem.values(climb.x, climb.error)[:, problem.channels[U_1]])[:, 0], climb.value)
    assert np.all(climb.value > 1.2 * first_order(problem, x)[:, U_1])


def test_climbers_move_where_no_limit_of_the_pose_is_near(problem):
    class Anywhere(RemainderProblem):
        def bounded(self, pose):
            return np.zeros((len(pose), 3))

    problem = Anywhere(**vars(problem))
    x = problem.draw(3, np.random.default_rng(5))
    climb = Climb(problem, x, np.zeros((len(x), 20)), [problem.channels[U_1]] * 3)
    for _ in range(3):  # The first one is to errors alone: at none, no pose is better.
        climb.step()
    assert np.any(climb.x[:, 3:10] != x[:, 3:10])


def test_two_searches_agree_where_the_maximum_is_plain(problem):
    """‖ν₁ − ν̄₁‖: one climbs from the worst of samples, the other flips coordinates."""
    x = problem.draw(30, np.random.default_rng(2))
    values = np.zeros((30, len(problem.channels)))
    values[:, NU_1] = first_order(problem, x)[:, NU_1]
    found = supremum(problem, x, values)
    assert not np.any(found[1:])
    second = second_search(problem, np.array([NU_1]), np.random.default_rng(3))[0]
    assert second == pytest.approx(found[NU_1], rel=0.05)


def test_flips_alone_come_near_and_stay_within_reach(problem, monkeypatch):
    monkeypatch.setattr("uvms_drake.tube.search.second_search.STEPS", 0)
    x = problem.draw(30, np.random.default_rng(2))
    values = first_order(problem, x) * (np.arange(len(problem.channels)) == U_1)
    found = supremum(problem, x, values)[U_1]
    second = second_search(problem, np.array([U_1]), np.random.default_rng(3))[0]
    assert 0.7 * found < second < 1.1 * found


def test_flips_find_the_corner_of_an_affine_function_and_the_top_of_a_hill():
    rng = np.random.default_rng(1)
    slope, top = rng.normal(size=30), rng.uniform(-0.9, 0.9, 30)

    def values(z: np.ndarray) -> np.ndarray:
        return np.stack([z @ slope, 1.0 - np.sum((z - top) ** 2, axis=1)], axis=1)

    start = rng.uniform(-1.0, 1.0, (2, 30))
    largest, point = by_flips(values, start, rng, 6, 2)
    assert largest[0] == pytest.approx(np.sum(np.abs(slope)))
    np.testing.assert_array_equal(point[0], np.sign(slope))
    assert 0.7 < largest[1] <= 1.0 and largest[1] > np.max(values(start)[:, 1]) + 10.0


def test_a_claim_is_the_factor_times_what_was_found_and_is_searched_for_again(problem):
    x = problem.draw(10, np.random.default_rng(2))
    values = first_order(problem, x) * (np.arange(len(problem.channels)) == NU_1)
    names = [str(i) for i in range(len(problem.channels))]
    claim, check = claimed(problem, names, x, values, 1.3, seed=4)
    np.testing.assert_allclose(claim, 1.3 * supremum(problem, x, values))
    (estimate,) = check()
    assert (estimate.name, estimate.claim) == (str(NU_1), claim[NU_1])
    assert 0.7 < estimate.ratio <= 1.0


def test_the_largest_turning_rate_is_a_norm_that_is_reached(model, declared):
    """ω against the singular values at many samples; Ŵ scales the columns."""
    weights = np.concatenate([np.full(6, 0.2), np.ones(4)])
    config, zeta = declared.sample(model, 2000, np.random.default_rng(4))
    _, J, J_dot = model.task_motion(config, zeta)
    for each in (np.ones(10), weights):
        problem = norm_problem(model, declared, turning, each)
        x = problem.draw(40, np.random.default_rng(5))
        found = supremum(problem, x, first_order(problem, x), 2)[0]
        sampled = np.linalg.norm(np.linalg.solve(J, J_dot) * each, 2, axis=(1, 2)).max()
        assert 0.97 * sampled < found < 1.5 * sampled


def test_attitudes_near_the_jump_of_a_springs_torque_do_not_count():
    spring = BilateralSpring(np.eye(6), np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.5])).checked()
    chi = np.zeros((3, 6))
    chi[:, 5] = 0.5, 0.5 - np.pi / 2.0, 0.5 + np.pi
    np.testing.assert_allclose(spring.turned(chi), [0.0, 0.5, 1.0])
