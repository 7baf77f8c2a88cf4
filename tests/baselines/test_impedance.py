"""The impedance of the tip is the one that was asked for."""

import numpy as np
import pytest
from support.baseline_press import ROBOT, run

from uvms_drake.baselines.baseline import BASELINES, read_gains


def test_the_tip_yields_as_the_stiffness_says_and_as_damped_as_stated():
    """A pull F moves the tip by F/K_d, along the step response of Λ ẍ + D ẋ + K x = F."""
    gains, pull = read_gains(ROBOT), 1.0  # N; the posture hardly changes.
    gains.approach.wait = 100.0  # The reference stands still, and so does the vehicle.
    gains.hold.k = gains.hold.sigma = 10.0
    press = run(BASELINES["impedance"](gains), gains, seconds=2.5, pull=pull)
    moved = np.array([now.x - press.now[0].x for now in press.now])
    due = pull / gains.impedance.stiffness
    assert moved[-1] == pytest.approx([due, 0.0, 0.0], abs=0.05 * due)
    first = press.now[0]
    J, M = first.J[:, 6:], first.M[6:, 6:]
    inverse = J @ np.linalg.solve(M, J.T)  # Λ⁻¹ of the arm.
    D = np.diag([gains.impedance.damping, *[gains.impedance.damping_across] * 2])
    x, v, step, due_step = np.zeros(3), np.zeros(3), 1e-3, []
    for _ in range(round(press.time[-1] / step) + 1):
        due_step.append(x)
        v = v + step * inverse @ (
            [pull, 0.0, 0.0] - gains.impedance.stiffness * x - D @ v)
        x = x + step * v
    due_step = np.array(due_step)[::20]
    assert moved[:, 0] == pytest.approx(due_step[: len(moved), 0], abs=0.05 * due)


@pytest.mark.slow
def test_the_force_has_no_steady_error():
    gains = read_gains(ROBOT)
    press = run(BASELINES["impedance"](gains), gains, seconds=6.0, depth=0.005)
    assert press.now[-1].force == pytest.approx(20.0, rel=0.02)


@pytest.mark.slow
def test_an_admittance_has_no_steady_error():
    gains = read_gains(ROBOT)
    press = run(BASELINES["admittance"](gains), gains, seconds=6.0, depth=0.005)
    assert press.now[-1].force == pytest.approx(20.0, rel=0.02)
