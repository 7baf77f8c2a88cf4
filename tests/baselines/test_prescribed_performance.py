"""Funnels are kept in the loop of the theory, whatever the gains; elsewhere exits are counted."""

import numpy as np
import pytest
from support.baseline_press import ROBOT, run, task

import uvms_drake as uv
from uvms_drake.baselines.baseline import BASELINES, read_gains
from uvms_drake.baselines.law import Measured, Reference
from uvms_drake.baselines.prescribed_performance import (
    PrescribedPerformance,
    funnel,
    transformed,
)


def of_theory(scale: float):
    """Returns gains for a wrench without limit on all axes, those of the law scaled."""
    gains = read_gains(ROBOT)
    gains.largest = np.full(10, 1e6)
    performance = gains.performance
    performance.velocity_gain[3] = performance.velocity_gain[5]
    for name in ("force_gain", "position_gain", "velocity_gain"):
        setattr(performance, name, scale * getattr(performance, name))
    return gains


@pytest.mark.slow
@pytest.mark.parametrize(("scale", "gravity"), [
    (1.0, False), (3.0, False), pytest.param(0.3, True, marks=pytest.mark.long)])
def test_no_funnel_is_left_in_continuous_time_without_limits(scale, gravity):
    """From contact, with f_d − f within ρ₀. Gains of 0.3 alone need a ξ beyond its clamp."""
    gains = of_theory(scale)
    laws = BASELINES["prescribed_performance_gravity"](gains) if gravity else {
        "law": PrescribedPerformance(gains.performance, 10)}
    press = run(laws, gains, seconds=1.2, depth=0.016, step=0.001)
    assert press.memory[-1, 0] == 0.0
    assert min(now.force for now in press.now) > 0.0


def test_an_exit_is_counted_once_and_the_command_stays_finite():
    law, model = PrescribedPerformance(read_gains(ROBOT).performance, 10), uv.UvmsModel(
        uv.read_uvms(ROBOT))
    pressed = task()
    config = model.configuration(np.concatenate([[0.01, 0.5, 0.0], np.zeros(3), pressed.posture]))
    now = Measured(model, pressed, 1.0, config, np.zeros(10), np.array([90.0, 0, 0, 0, 0, 0]),
                   Reference(np.zeros(3), np.zeros(3), 20.0, True, 0.0))
    first = law.updated(now, np.zeros(law.memory), False)
    assert first[0] >= 2.0 and first[1] == 1.0  # Of the force, and of the position.
    assert law.updated(now, first, False)[0] == first[0]
    assert np.all(np.isfinite(law.tau(now, first)))


def test_a_funnel_narrows_and_the_transformed_error_rises_without_bound_inside():
    assert funnel(3.0, 1.0, 2.0, 0.0) == 3.0
    assert funnel(3.0, 1.0, 2.0, 50.0) == pytest.approx(1.0)
    xi = np.array([0.0, 0.5, 0.9])
    assert transformed(xi, np.ones(3)) == pytest.approx(np.log((1 + xi) / (1 - xi)))
    assert np.all(np.isfinite(transformed(np.array([5.0, -5.0]), np.ones(2))))
