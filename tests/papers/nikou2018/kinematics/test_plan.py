"""Tests of `kinematics.plan`: a plan of velocities."""

import numpy as np
import pytest

from uvms_drake.control.plan.plan import DynamicPlan
from uvms_drake.papers.nikou2018.kinematics.plan import KinematicPlan

H = 0.2  # s
SPEEDS = np.repeat([0.21, 0.16, 0.26], [3, 3, 4])  # m/s, rad/s: nominal limits of the scenarios


def random_velocities(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns a configuration (10,) and velocities of 6 intervals (6, 10)."""
    rng = np.random.default_rng(seed)
    return rng.uniform(-0.5, 0.5, 10), rng.uniform(-1.0, 1.0, (6, 10)) * SPEEDS


def test_a_plan_of_velocities_is_that_of_accelerations_without_any():
    start, zeta = random_velocities(6)
    plan = KinematicPlan.from_velocities(1.0, H, start, zeta)
    for k in range(6):
        same = DynamicPlan.from_accelerations(
            1.0 + k * H, H, plan.config[k], zeta[k], np.zeros((1, 10)))
        np.testing.assert_allclose(plan.config[k + 1], same.config[1], atol=1e-14)
        time = 1.0 + (k + 0.3) * H
        config, velocity = plan.at(time)
        np.testing.assert_allclose(config, same.at(time)[0], atol=1e-14)
        np.testing.assert_array_equal(velocity, zeta[k])
    np.testing.assert_array_equal(plan.at(1.0 + 2 * H)[1], zeta[1])  # the interval that ends there


def test_a_shifted_plan_of_velocities_goes_on_with_the_last_decision():
    _, zeta = random_velocities(7)
    plan = KinematicPlan.from_velocities(1.0, H, np.zeros(10), zeta)
    last = np.full(10, 0.1)
    shifted = plan.shifted(last)
    assert shifted.start_time == pytest.approx(1.0 + H)
    np.testing.assert_array_equal(shifted.decision, [*zeta[1:], last])
    again = shifted.redone(shifted.start, shifted.decision)
    np.testing.assert_allclose(again.config, shifted.config, atol=1e-14)
