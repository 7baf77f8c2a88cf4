"""Tests of `station.linear_run` against the Diagram with the same draws."""

import numpy as np
import pytest

from uvms_drake.station.linear_run import linear_run
from uvms_drake.station.scenario.scenario import load_scenario
from uvms_drake.station.simulation import simulate


@pytest.mark.slow
def test_the_linear_loop_has_the_errors_of_a_run():
    """Within a tenth of their standard deviation while the vehicle hovers, and starts to move."""
    run = linear_run(simulate(load_scenario("girona500_real_loop", ["duration=7.0"])))
    settled = run.time > 3.0
    apart, values = (run.of_record - run.values)[settled], run.values[settled]
    for name in ("depth", "tip y", "tip z", "vehicle x", "vehicle z", "q1", "q2", "q3"):
        i = run.rows.index(name)
        assert np.std(apart[:, i]) < 0.1 * np.std(values[:, i]), name
