"""Tests of `certificate.coupled.linear_run` against the Diagram with the same draws."""

import numpy as np
import pytest

from uvms_drake.certificate.coupled.linear_run import linear_run
from uvms_drake.station.scenario.scenario import load_scenario
from uvms_drake.station.simulation import simulate


@pytest.mark.slow
def test_the_linear_loop_has_the_errors_of_a_run():
    """Within a tenth of their standard deviation the tip's, while the vehicle begins to move.

    The joints' have a part of the start, when thrusters are off their steady forces.
    """
    run = linear_run(simulate(load_scenario("girona500_real_loop", ["duration=7.0"])))
    settled = run.time > 3.0
    apart, values = (run.of_record - run.values)[settled], run.values[settled]
    shares = dict.fromkeys(("depth", "tip y", "tip z"), 0.1) | dict.fromkeys(
        ("vehicle z", "q1", "q2", "q3"), 0.4)
    for name, share in shares.items():
        i = run.rows.index(name)
        assert np.std(apart[:, i]) < share * np.std(values[:, i]), name
