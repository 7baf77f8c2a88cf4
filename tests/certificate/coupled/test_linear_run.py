"""Tests of `certificate.coupled.linear_run` against the Diagram with the same draws."""

from types import SimpleNamespace

import numpy as np
import pytest

from uvms_drake.certificate.coupled import linear_distance
from uvms_drake.certificate.coupled.linear_distance import check_linear_loop, linear_distances
from uvms_drake.certificate.coupled.linear_run import LinearRun, linear_run
from uvms_drake.common.errors import InvalidParameter
from uvms_drake.station.scenario.scenario import load_scenario
from uvms_drake.station.simulation import simulate
from uvms_drake.tube.settings import LinearLines


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


@pytest.mark.long
@pytest.mark.xfail(strict=True, reason="with the present gains the depth is off by 0.44 of its "
                   "largest error: the bound is that of the former ones")
def test_the_linear_loop_has_the_errors_of_a_press():
    """From the touch on, too; the run begins turned by a part of a radian and far from the task."""
    record = simulate(load_scenario("girona500_real_loop", [
        "duration=17.5", "surface.geometry.point=[-0.2, 0.0, 0.0]",
        "start.eta=[-1.40, -0.03, -0.12, 0.03, 0.04, -0.05]"]))
    run, touched = linear_run(record), record.penetration > 0.0
    assert np.count_nonzero(touched) > 100
    apart, of_record = (run.of_record - run.values)[touched], run.of_record[touched]
    for name, share in {"depth": 0.4, "tip y": 0.2, "tip z": 0.4, "q2": 0.6, "q3": 0.6}.items():
        i = run.rows.index(name)
        assert np.max(np.abs(apart[:, i])) < share * np.max(np.abs(of_record[:, i])), name


def test_the_distance_is_that_of_the_worst_row_of_a_group_over_its_line(monkeypatch):
    rows = ("depth", "tip y", "vehicle z", "roll", "q2", "depth speed", "q2 rate")
    linear = np.zeros((3, 7))
    record_rows = np.array([[9.0] * 7, [1e-4, -3e-4, 1e-3, 0.02, 0.0, 5.0, 5.0],
                            [2e-4, 0.0, 0.0, -0.01, 0.003, 0.0, 0.0]])
    monkeypatch.setattr(linear_distance, "linear_run", lambda record: LinearRun(
        np.array([0.0, 4.0, 5.0]), rows, linear, record_rows))
    record = SimpleNamespace(scenario=load_scenario("girona500_real_loop"), certified=False)
    assert linear_distances(record, LinearLines(1e-3, 2e-3, 0.01, 0.015)) == pytest.approx(
        {"tip": 0.3, "vehicle": 0.5, "attitude": 2.0, "joints": 0.2})


@pytest.mark.parametrize(("name", "allowed"), [
    ("girona500_real_loop", None), ("girona500_contact", "left out but for !TipFirst"),
    ("girona500_ideal", "left out without a sensed contact")])
def test_lines_without_a_linear_loop_are_refused(name, allowed):
    scenario = load_scenario(name, ["certificate.linear={}"])
    if allowed is None:
        check_linear_loop(scenario)
        return
    with pytest.raises(InvalidParameter, match=f"certificate.linear = .* must be {allowed}"):
        check_linear_loop(scenario)
