"""Tests of `uvms_drake.tube.contact.tip_motion`, against the motion of plans."""

import numpy as np
import pytest

from uvms_drake.control.plan.plan import Plan, off_parabola
from uvms_drake.model.frames.euler import rotation_matrix
from uvms_drake.tube.contact.tip_motion import SAFETY, tip_jerk
from uvms_drake.tube.search.constraint_set import ConstraintSet

SET = ConstraintSet(q_lower=np.array([-0.2, 0.7, 0.2, -0.4]),
                    q_upper=np.array([0.2, 1.2, 0.7, 0.4]), roll=0.1, pitch=0.1, tip_pitch=0.3,
                    nu1=0.1, nu2=0.08, qdot=0.2)
H = 0.2


@pytest.fixture(scope="module")
def jerk(model) -> float:
    return tip_jerk(model, SET, H, 0.2, 3000)[0] / SAFETY


def test_no_interval_of_a_plan_is_further_off_a_parabola(model, jerk):
    """The tip along n between two knots, against Hermite's parabola by its ends and its start."""
    rng, t = np.random.default_rng(1), np.linspace(0.0, H, 9)
    config, before = SET.sample(model, 60, rng)
    after = np.where(np.arange(60)[:, None] % 2, -before, SET.sample(model, 60, rng)[1])
    worst = 0.0
    for q, first, last in zip(config, before, after, strict=True):
        plan = Plan.from_accelerations(0.0, H, q, first, ((last - first) / H)[None])
        states = [plan.at(float(time))[:2] for time in t]
        tips = np.array([model.task_pose(each)[:3] for each, _ in states])
        start = model.kinematics(states[0][0]).J_chi[:3] @ states[0][1]
        curve = (tips[-1] - tips[0] - H * start) / H**2
        off = tips - (tips[0] + np.outer(t, start) + np.outer(t**2, curve))
        tool = rotation_matrix(model.task_pose(q)[3:6])[:, 0]
        worst = max(worst, float(np.max(np.abs(off @ tool))))
    assert 0.1 * off_parabola(jerk, H) < worst <= 1.5 * off_parabola(jerk, H)


def test_it_is_that_of_longer_steps_and_slower_sets(model, jerk):
    claim, check = tip_jerk(model, SET, 2.0 * H, 0.2, 3000)
    assert claim < SAFETY * jerk
    assert 0.85 < check()[0].ratio <= 1.0
    assert off_parabola(2.0, H) == pytest.approx(4.0 / 81.0 * H**3)
