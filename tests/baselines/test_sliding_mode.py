"""Sliding is reached, and the parallel composition has no steady error of the force."""

import numpy as np
import pytest
from support.baseline_press import ROBOT, run

from uvms_drake.baselines.baseline import BASELINES, read_gains


@pytest.mark.slow
@pytest.mark.parametrize(("name", "stiffness"), [
    ("sliding_decoupled", 1000.0),
    pytest.param("sliding_decoupled", 5000.0, marks=pytest.mark.long),
    pytest.param("sliding_coupled", 1000.0, marks=pytest.mark.long)])
def test_sliding_is_reached_and_the_force_is_exact(name, stiffness):
    gains = read_gains(ROBOT)
    if name == "sliding_coupled":  # Here no thruster lags: the gains of the decoupled law.
        gains.coupled.integral, gains.coupled.rate = gains.decoupled.integral, gains.decoupled.rate
    laws = BASELINES[name](gains)
    press = run(laws, gains, seconds=12.0, stiffness=stiffness, depth=15.0 / stiffness,
                step=0.01)
    law = laws["law"]
    reached = [np.max(np.abs(law.surface(now, memory))) <= law.gains.layer
               for now, memory in zip(press.now, press.memory, strict=True)]
    assert all(reached[-100:])
    assert press.now[-1].force == pytest.approx(20.0, rel=0.02)
