"""Tests of `uvms_drake.control.limits.plan_acceleration`."""

from types import SimpleNamespace

import numpy as np

from uvms_drake.control.limits.plan_acceleration import PlanAcceleration


def test_it_is_a_limit_of_plans_and_none_of_the_robot_in_a_run():
    limit = PlanAcceleration(bound=np.full(2, 0.1))
    at = SimpleNamespace(u=np.array([3.0, -3.0]), config=None, zeta=None,
                         model=SimpleNamespace(drift=lambda config, zeta: np.zeros(2)))
    np.testing.assert_array_equal(limit.values(at), [3.0, -3.0])
    assert limit.signals(at) == {}
