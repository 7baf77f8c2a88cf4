"""Tests of `uvms_drake.campaign.outside_assumptions`."""

from dataclasses import replace

import numpy as np
import pytest

from uvms_drake.campaign.outside_assumptions import kinds_outside, step_outside
from uvms_drake.campaign.run import run_one
from uvms_drake.campaign.summary import (
    all_well,
    format_campaign,
    summarise_campaign,
    summarise_times,
)
from uvms_drake.station.scenario.scenario import load_scenario

pytestmark = pytest.mark.long


def test_nothing_happens_while_the_robot_hovers():
    scenario = load_scenario("girona500_ideal", ["mpc.hover=6", "duration=10"])
    rng = np.random.default_rng(0)
    instants = [step_outside("state lost", scenario, 0.2, rng).faults[0].start for _ in range(50)]
    assert 6.4 <= min(instants) < 6.6
    assert 8.6 < max(instants) <= 8.8


def test_outside_of_the_bounds_every_promise_is_kept(campaign):
    """Every kind of event occurs once; each exit of a bound is in the log."""
    kinds = kinds_outside(has_forces=True, num_joints=len(campaign.base.start.q))
    beyond = replace(campaign, outside=True, model_error=0.2,
                     scenario=campaign.scenario.replace("duration: 0.6", "duration: 1.6"))
    results = [run_one(beyond, index)["result"] for index in range(len(kinds))]
    assert [result["outside"] for result in results] == list(kinds)
    summary = summarise_campaign(beyond, results)
    assert all_well(summary), summary["counts"]
    by_kind = dict(zip(kinds, results, strict=True))
    assert "state_lost" in by_kind["state lost"]["noted"]
    assert by_kind["d of 5 bounds"]["worst_disturbance"] == pytest.approx(5.0, rel=1e-3)
    assert by_kind["state frozen"]["exits_set"] > 0
    for result in results:
        assert ("tube_left" in result["noted"]) == (result["exits_set"] > 0)
        assert ("disturbance_exceeded" in result["noted"]) != result["inside"]
    assert sum(result["worst_disturbance"] > 1.0 for result in results) > 5
    for kind in kinds:
        assert kind in format_campaign(summary, summarise_times([]), "DIR")
