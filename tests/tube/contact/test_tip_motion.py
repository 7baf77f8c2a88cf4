"""Tests of `uvms_drake.tube.contact.tip_motion`, against the motion of plans."""

from dataclasses import replace

import numpy as np
import pytest
from support.force_reading import reading_off

from uvms_drake.control.plan.plan import Plan, off_parabola
from uvms_drake.model.frames.euler import rotation_matrix
from uvms_drake.tube.contact.sensor_error import MeasuredForceBounds
from uvms_drake.tube.contact.tip_motion import SAFETY, TipAcceleration, tip_jerk, unevenness
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


H, STEPS = 0.01, 20
FORCE = MeasuredForceBounds(
    size=50.0, rate=160.0, ripple=7.0, tangential_rate=40.0, tangential_ripple=2.0,
    reading=reading_off(2.8, 0.05, 0.02, H), tool_angle=0.25)
STILL = replace(FORCE, rate=0.0, ripple=0.0, tangential_rate=0.0, tangential_ripple=0.0, size=0.0)
TIP = TipAcceleration(by_force=(0.2, 0.3), by_normal=(0.18, 0.25), turning=0.7, other=0.17)


def off_chord(velocity):
    """Largest distance of velocities (..., m) from the line between their ends."""
    share = np.linspace(0.0, 1.0, velocity.shape[-1])
    line = velocity[..., :1] + share * (velocity[..., -1:] - velocity[..., :1])
    return np.max(np.abs(velocity - line))


def integral(rate, step):
    """Values (..., m + 1) of an integral from 0, of a rate that is constant in each step."""
    return np.concatenate([np.zeros((*rate.shape[:-1], 1)), np.cumsum(rate, axis=-1) * step], -1)


def test_what_jumps_takes_the_velocity_off_its_line_by_a_quarter_of_its_width():
    """Accelerations of any signs, also the worst: first up, then down."""
    a = unevenness(TIP, STILL, H, 0.0)
    assert a == pytest.approx(2.0 * TIP.other)
    signs = np.random.default_rng(0).choice([-1.0, 1.0], (20_000, STEPS))
    signs[0] = np.sign(np.arange(STEPS) - 0.5 * STEPS + 0.5)
    worst = off_chord(integral(TIP.other * signs, H / STEPS))
    assert worst == pytest.approx(0.25 * H * a)


def test_what_changes_steadily_counts_half():
    """A force that rises at its rate: the acceleration is a ramp, the velocity a parabola."""
    steady = replace(STILL, rate=FORCE.rate)
    a = unevenness(replace(TIP, other=0.0), steady, H, 0.0)
    t = np.linspace(0.0, H, STEPS + 1)
    assert off_chord(0.5 * TIP.by_normal[0] * FORCE.rate * t**2) == pytest.approx(0.25 * H * a)


def test_across_the_direction_a_deviation_counts_by_the_tilt():
    """⟨v⟩ = n·v + α‖P_t v‖ of forces of any signs, by their rows along n and across it."""
    tilt, rng = 0.48, np.random.default_rng(1)
    steady = replace(STILL, ripple=FORCE.ripple)
    a = unevenness(replace(TIP, other=0.0), steady, H, 0.0, tilt)
    rows = np.array([TIP.by_normal[0], np.sqrt(TIP.by_normal[1]**2 - TIP.by_normal[0]**2)])
    jumps = FORCE.ripple * rng.choice([0.0, 1.0], (20_000, STEPS))
    jumps[0] = FORCE.ripple * (np.arange(STEPS) < 0.5 * STEPS)
    along, across = (integral(row * jumps, H / STEPS) for row in rows)
    share = np.linspace(0.0, 1.0, STEPS + 1)
    off = [each - share * each[:, -1:] for each in (along, across)]
    worst = np.max(off[0] + tilt * np.abs(off[1]))
    assert 0.25 * H * unevenness(replace(TIP, other=0.0), steady, H, 0.0) < (
        worst) <= 0.25 * H * a * (1.0 + 1e-9)


def test_every_part_adds_to_it():
    base = unevenness(TIP, STILL, H, 0.0)
    for change in ({"ripple": 1.0}, {"tangential_ripple": 1.0}, {"tangential_rate": 1.0},
                   {"size": 1.0}):
        force = replace(STILL, **change)
        assert unevenness(TIP, force, H, 0.0) > base
    assert unevenness(TIP, STILL, H, 0.3) == pytest.approx(base + 0.3)
